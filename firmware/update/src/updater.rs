//! Takes an image block by block into the spare slot, and asks for the swap when it is whole and signed.

use crate::image::{Owner, Refusal, flash, read_header, read_signature};
use crate::loader::{LoaderError, Slots, Stage};
use embassy_boot::{BlockingFirmwareUpdater, FirmwareUpdaterConfig, FirmwareUpdaterError};
use embedded_storage::nor_flash::{NorFlash, NorFlashErrorKind};
use protocol::image::{BLOCK, HEADER_BYTES, Header};

/// Which versions are taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Accept {
    /// Those newer than what runs; any where nothing runs.
    Newer,
    /// Any, as its user insists.
    Any,
}

/// One image on its way in. What is dropped half-way is never run.
#[derive(Clone, Copy, Debug)]
pub struct Transfer {
    owner: Owner,
    accept: Accept,
    header: Option<Header>,
    at: u32,
}

impl Transfer {
    /// Awaits the first block.
    pub fn new(owner: Owner, accept: Accept) -> Self {
        Self { owner, accept, header: None, at: 0 }
    }

    /// Bytes that have come so far.
    pub fn received(&self) -> u32 {
        self.at
    }

    /// Writes the next `block`, whole blocks of [`BLOCK`] bytes. The first one holds the header; only after it has been accepted the
    /// slot is erased.
    pub fn take<A: NorFlash, D: NorFlash, S: NorFlash>(
        &mut self,
        slots: &mut Slots<A, D, S>,
        block: &[u8],
    ) -> Result<(), Refusal> {
        let order = Refusal::Order { at: self.at, bytes: block.len() as u32 };
        if block.is_empty() || !block.len().is_multiple_of(BLOCK) {
            return Err(order);
        }
        let header = match self.header {
            Some(header) => header,
            None if block.len() < HEADER_BYTES => return Err(order),
            None => self.begin(slots, block)?,
        };
        if block.len() as u32 > header.image_bytes() - self.at {
            return Err(order);
        }
        slots.spare.write(self.at, block).map_err(flash)?;
        self.at += block.len() as u32;
        Ok(())
    }

    fn begin<A: NorFlash, D: NorFlash, S: NorFlash>(
        &mut self,
        slots: &mut Slots<A, D, S>,
        block: &[u8],
    ) -> Result<Header, Refusal> {
        let header = Header::parse(block)?;
        self.may_take(slots, &header)?;
        // All of it: swapping reads pages beyond the image as well, and a torn word there would stop it.
        updater(slots, &mut [0]).prepare_update().map_err(refusal)?;
        self.header = Some(header);
        Ok(header)
    }

    fn may_take<A: NorFlash, D: NorFlash, S: NorFlash>(
        &self,
        slots: &mut Slots<A, D, S>,
        header: &Header,
    ) -> Result<(), Refusal> {
        self.owner.accepts(header, slots.active.capacity() as u32)?;
        if slots.stage().map_err(stage_refusal)? != Stage::Settled {
            return Err(Refusal::OnTrial);
        }
        match read_header(&mut slots.active, 0) {
            Ok(here) if self.accept == Accept::Newer && header.version <= here.version => {
                Err(Refusal::Version { image: header.version, here: here.version })
            }
            _ => Ok(()),
        }
    }

    /// After the last block: reads the image back, verifies it, and asks for the swap at the next start.
    pub fn finish<A: NorFlash, D: NorFlash, S: NorFlash>(self, slots: &mut Slots<A, D, S>) -> Result<Header, Refusal> {
        let sent = self.header.filter(|header| header.image_bytes() == self.at);
        let sent = sent.ok_or(Refusal::Order { at: self.at, bytes: 0 })?;
        let header = read_header(&mut slots.spare, 0)?;
        self.may_take(slots, &header)?;
        if header != sent {
            return Err(Refusal::Signature);
        }
        let signature = read_signature(&mut slots.spare, 0, &header)?;
        let marked =
            updater(slots, &mut [0]).verify_and_mark_updated(&self.owner.key, &signature, header.signed_bytes());
        marked.map(|()| header).map_err(refusal)
    }
}

fn updater<'a, A: NorFlash, D: NorFlash, S: NorFlash>(
    slots: &'a mut Slots<A, D, S>,
    word: &'a mut [u8; 1],
) -> BlockingFirmwareUpdater<'a, &'a mut D, &'a mut crate::record::Record<S>> {
    let Slots { spare, record, .. } = slots;
    BlockingFirmwareUpdater::new(FirmwareUpdaterConfig { dfu: spare, state: record }, word)
}

fn refusal(error: FirmwareUpdaterError) -> Refusal {
    match error {
        FirmwareUpdaterError::Flash(kind) => Refusal::Flash(kind),
        FirmwareUpdaterError::Signature(_) => Refusal::Signature,
        FirmwareUpdaterError::BadState => Refusal::OnTrial,
    }
}

fn stage_refusal(error: LoaderError) -> Refusal {
    match error {
        LoaderError::Flash(kind) => Refusal::Flash(kind),
        _ => Refusal::Flash(NorFlashErrorKind::Other),
    }
}
