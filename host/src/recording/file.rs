//! Recordings as files.

use super::Entry;
use mcap::records::MessageHeader;
use mcap::sans_io::LinearReaderOptions;
use mcap::write::NoSeek;
use mcap::{Compression, McapError, WriteOptions};
use std::collections::{BTreeMap, HashMap};
use std::io::{self, Read, Write};
use thiserror::Error;

/// What the header says of the kind of messages.
const PROFILE: &str = "praxinoscope";
/// The largest message or chunk that is read.
const RECORD_BYTES_MAX: usize = 64 << 20;

/// Why a recording cannot be read or written.
#[derive(Debug, Error)]
pub enum FileError {
    /// Reading or writing fails.
    #[error("{}", crate::output::reason(.0))]
    Io(#[from] io::Error),
    /// See the message.
    #[error("no recording: MCAP files begin otherwise")]
    NoMcap,
    /// See the message.
    #[error("damaged after {messages} messages: {reason}")]
    Damaged {
        /// Messages that could be read.
        messages: u64,
        /// Why the next one could not.
        reason: String,
    },
}

impl FileError {
    fn new(error: McapError, messages: u64) -> Self {
        match error {
            McapError::Io(error) => Self::Io(error),
            McapError::BadMagic if messages == 0 => Self::NoMcap,
            error => Self::Damaged { messages, reason: error.to_string() },
        }
    }
}

/// Something that happened, and when: nanoseconds since 1970, UTC.
pub type Timed = (u64, Entry);

/// A recording in the making.
pub struct Writer<W: Write> {
    inner: mcap::Writer<NoSeek<W>>,
    channels: HashMap<String, u16>,
    sequence: u32,
}

impl<W: Write> Writer<W> {
    /// Begins one.
    pub fn new(to: W) -> Result<Self, FileError> {
        let options = WriteOptions::new().compression(Some(Compression::Zstd)).profile(PROFILE).disable_seeking(true);
        let inner = options.create(NoSeek::new(to)).map_err(|error| FileError::new(error, 0))?;
        Ok(Self { inner, channels: HashMap::new(), sequence: 0 })
    }

    /// Adds an entry.
    pub fn write(&mut self, (at_ns, entry): &Timed) -> Result<(), FileError> {
        let failed = |error| FileError::new(error, 0);
        let (topic, json) = entry.message();
        let channel_id = match self.channels.get(&topic) {
            Some(id) => *id,
            None => {
                let id = self.inner.add_channel(0, &format!("/{topic}"), "json", &BTreeMap::new()).map_err(failed)?;
                *self.channels.entry(topic).or_insert(id)
            }
        };
        self.sequence += 1;
        let header = MessageHeader { channel_id, sequence: self.sequence, log_time: *at_ns, publish_time: *at_ns };
        self.inner.write_to_known_channel(&header, &json).map_err(failed)
    }

    /// What was added can be read from here on, whatever becomes of this program.
    pub fn flush(&mut self) -> Result<(), FileError> {
        self.inner.flush().map_err(|error| FileError::new(error, 0))
    }

    /// Ends it.
    pub fn finish(mut self) -> Result<W, FileError> {
        self.inner.finish().map_err(|error| FileError::new(error, 0))?;
        Ok(self.inner.into_inner().into_inner())
    }
}

/// The entries of a recording, in order. One that ends in the middle ends with its last whole entry: see [`Entries::is_cut`].
pub struct Entries<R> {
    inner: mcap::io::MessageReader<R>,
    messages: u64,
    is_cut: bool,
}

impl<R: Read> Entries<R> {
    /// Of what `from` holds.
    pub fn new(from: R) -> Self {
        let options = LinearReaderOptions::default().with_record_length_limit(RECORD_BYTES_MAX);
        Self { inner: mcap::io::MessageReader::new_with_options(from, options), messages: 0, is_cut: false }
    }

    /// Whether the recording ended in the middle; known at its end.
    pub fn is_cut(&self) -> bool {
        self.is_cut
    }
}

impl<R: Read> Iterator for Entries<R> {
    type Item = Result<Timed, FileError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let message = match self.inner.next()? {
                Ok(message) => message,
                Err(McapError::UnexpectedEof) if self.messages > 0 => {
                    self.is_cut = true;
                    return None;
                }
                Err(McapError::UnexpectedEof) => return Some(Err(FileError::NoMcap)),
                Err(error) => return Some(Err(FileError::new(error, self.messages))),
            };
            let topic = message.channel.topic.trim_start_matches('/');
            match Entry::read(topic, &message.data) {
                Ok(None) => {}
                Ok(Some(entry)) => {
                    self.messages += 1;
                    return Some(Ok((message.log_time, entry)));
                }
                Err(error) => {
                    let reason = format!("/{topic}: {error}");
                    return Some(Err(FileError::Damaged { messages: self.messages, reason }));
                }
            }
        }
    }
}
