//! The virtual cable to the image's Ethernet controller: frames over a socket, each after its length.

use super::ImageError;
use firmware::lockstep::{self, Answer, FRAME_BYTES_MAX, Request};
use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// To everybody, from a made-up address, of the type that is free for experiments.
const HEADER: [u8; 14] = [0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 2, 0, 0, 0, 0, 2, 0x88, 0xb5];
const LENGTH_BYTES: usize = 4;
/// The emulator carries no longer ones.
const ETHERNET_BYTES_MAX: usize = 2_048;

/// One end of it.
#[derive(Debug)]
pub struct Cable {
    stream: TcpStream,
    patience: Duration,
    serial: u8,
    received: Vec<u8>,
}

impl Cable {
    /// Over `stream`; an answer may take `patience`.
    pub fn new(stream: TcpStream, patience: Duration) -> Result<Self, ImageError> {
        stream.set_nodelay(true).map_err(ImageError::Cable)?;
        let mut cable = Self { stream, patience, serial: 0, received: Vec::new() };
        cable.set_patience(patience)?;
        Ok(cable)
    }

    /// An answer may take this long from now on.
    pub fn set_patience(&mut self, patience: Duration) -> Result<(), ImageError> {
        self.patience = patience;
        self.stream.set_read_timeout(Some(patience)).map_err(ImageError::Cable)
    }

    /// The answer to `request`. Late answers to earlier ones are passed over.
    pub fn ask(&mut self, request: Request<'_>) -> Result<Answer, ImageError> {
        self.serial = self.serial.wrapping_add(1);
        let mut payload = [0; FRAME_BYTES_MAX];
        let payload = lockstep::write(self.serial, &request, &mut payload)
            .ok_or_else(|| ImageError::Garbage(format!("to nothing: {request:?} does not fit a frame")))?;
        let length = (HEADER.len() + payload.len()) as u32;
        let frame = [&length.to_be_bytes()[..], &HEADER, payload].concat();
        self.stream.write_all(&frame).map_err(|error| self.broken(error))?;
        loop {
            let (serial, answer) = self.receive()?;
            if serial == self.serial {
                return Ok(answer);
            }
        }
    }

    fn receive(&mut self) -> Result<(u8, Answer), ImageError> {
        self.fill(LENGTH_BYTES)?;
        let length = self.received.iter().take(LENGTH_BYTES).fold(0, |sum, byte| sum << 8 | usize::from(*byte));
        if !(HEADER.len()..=ETHERNET_BYTES_MAX).contains(&length) {
            return Err(ImageError::Garbage(format!("with a frame of {length} bytes")));
        }
        self.fill(LENGTH_BYTES + length)?;
        let frame: Vec<u8> = self.received.drain(..LENGTH_BYTES + length).skip(LENGTH_BYTES + HEADER.len()).collect();
        lockstep::read(&frame).ok_or_else(|| ImageError::Garbage(format!("with {frame:02x?}")))
    }

    /// Reads until `bytes` have been received. What came stays where an error ends it.
    fn fill(&mut self, bytes: usize) -> Result<(), ImageError> {
        let mut chunk = [0; ETHERNET_BYTES_MAX];
        while self.received.len() < bytes {
            match self.stream.read(&mut chunk) {
                Ok(0) => return Err(ImageError::HungUp),
                Ok(count) => self.received.extend_from_slice(&chunk[..count]),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(self.broken(error)),
            }
        }
        Ok(())
    }

    fn broken(&self, error: std::io::Error) -> ImageError {
        match error.kind() {
            ErrorKind::WouldBlock | ErrorKind::TimedOut => ImageError::Silent(self.patience),
            ErrorKind::BrokenPipe | ErrorKind::ConnectionReset | ErrorKind::ConnectionAborted => ImageError::HungUp,
            _ => ImageError::Cable(error),
        }
    }
}
