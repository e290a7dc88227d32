//! Single packets to a device and their answers with their times, which a stream does not tell.

use crate::link::{Link, LinkError};
use protocol::message::{Ack, Faults, HelloReply, Message, Nack, Reason, Status};
use protocol::packet::{Decoder, FRAME_BYTES_MAX, PACKET_BYTES_MAX, PacketError, encode};
use std::collections::VecDeque;
use std::time::Duration;
use thiserror::Error;

/// How long an answer may take on a line that carries everything at once.
const PATIENCE: Duration = Duration::from_secs(2);

/// Why there is no answer.
#[derive(Debug, Error)]
pub enum ProbeError {
    /// See the message.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// See the message.
    #[error(transparent)]
    Packet(#[from] PacketError),
    /// See the message.
    #[error("the device takes no more bytes")]
    Stuck,
    /// See the message.
    #[error("the device does not answer")]
    Silent,
}

/// What the device said to a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// The version and the schema that it speaks.
    Hello {
        /// The device's.
        version: u16,
        /// The device's.
        schema: u64,
    },
    /// It is done.
    Ack,
    /// It is refused.
    Nack(Reason),
}

/// A packet that was sent and not answered yet.
#[derive(Clone, Copy, Debug)]
pub struct Asked {
    sequence: u32,
    /// Its bytes on the wire.
    pub bytes: usize,
    /// The device's clock when its first byte was given to the link.
    pub at: Duration,
}

/// One end of a conversation.
pub struct Probe<'a> {
    link: &'a mut dyn Link,
    decoder: Box<Decoder<PACKET_BYTES_MAX>>,
    frame: Vec<u8>,
    sequence: u32,
    answers: VecDeque<(u32, Answer, Duration)>,
    /// The latest status.
    pub status: Option<Status>,
    /// What the device remembers of its faults.
    pub faults: Option<Faults>,
}

impl<'a> Probe<'a> {
    /// Ends what an earlier conversation left unfinished.
    pub fn new(link: &'a mut dyn Link) -> Result<Self, ProbeError> {
        // Not 0: answers to an earlier conversation must not look like answers to this one.
        let sequence = link.now().as_micros() as u32;
        let (answers, frame) = (VecDeque::new(), vec![0; FRAME_BYTES_MAX]);
        let mut probe = Self { link, decoder: Box::default(), frame, sequence, answers, status: None, faults: None };
        probe.hand_over(&[0])?;
        Ok(probe)
    }

    /// Bytes a second that the link says it carries.
    pub fn bytes_per_second(&self) -> Option<f64> {
        self.link.bytes_per_second()
    }

    /// The device's clock.
    pub fn now(&self) -> Duration {
        self.link.now()
    }

    /// Sends `message` and does not wait for its answer.
    pub fn send<'m>(&mut self, message: impl Into<Message<'m>>) -> Result<Asked, ProbeError> {
        let (sequence, at) = (self.sequence, self.link.now());
        self.sequence = self.sequence.wrapping_add(1);
        let mut frame = std::mem::take(&mut self.frame);
        let bytes = encode(sequence, &message.into(), &mut frame)?;
        let sent = self.hand_over(&frame[..bytes]);
        self.frame = frame;
        sent.map(|()| Asked { sequence, bytes, at })
    }

    /// The answer to `asked`, and when it was there; `under_way` bytes may come before it. Answers to earlier packets are forgotten.
    pub fn answer(&mut self, asked: Asked, under_way: usize) -> Result<(Answer, Duration), ProbeError> {
        let until = self.link.now() + self.patience(under_way);
        loop {
            while let Some((sequence, answer, at)) = self.answers.pop_front() {
                if sequence == asked.sequence {
                    return Ok((answer, at));
                }
            }
            let left = until.saturating_sub(self.link.now());
            if left.is_zero() {
                return Err(ProbeError::Silent);
            }
            self.listen(left)?;
        }
    }

    /// Sends `message` and waits for its answer.
    pub fn ask<'m>(&mut self, message: impl Into<Message<'m>>) -> Result<Answer, ProbeError> {
        let asked = self.send(message)?;
        Ok(self.answer(asked, asked.bytes)?.0)
    }

    /// Waits up to `wait` for bytes and reads what came.
    pub fn listen(&mut self, wait: Duration) -> Result<(), ProbeError> {
        let mut incoming = Vec::new();
        self.link.receive(&mut incoming, wait)?;
        let (mut bytes, now) = (&incoming[..], self.link.now());
        while let Some(packet) = self.decoder.next(&mut bytes) {
            let (answers, answer) = match packet.ok().and_then(|packet| packet.message().ok()) {
                Some(Message::Ack(Ack { answers })) => (answers, Answer::Ack),
                Some(Message::Nack(Nack { answers, reason })) => (answers, Answer::Nack(reason)),
                Some(Message::HelloReply(HelloReply { answers, version, schema })) => {
                    (answers, Answer::Hello { version, schema })
                }
                Some(Message::Status(status)) => {
                    self.status = Some(status);
                    continue;
                }
                Some(Message::Faults(faults)) => {
                    self.faults = Some(faults);
                    continue;
                }
                _ => continue,
            };
            self.answers.push_back((answers, answer, now));
        }
        Ok(())
    }

    /// How long `bytes` and an answer may take: four times what the line needs, as others may hold it up.
    pub fn patience(&self, bytes: usize) -> Duration {
        let line_s = self.link.bytes_per_second().map_or(0.0, |rate| bytes as f64 / rate);
        PATIENCE + Duration::from_secs_f64(4.0 * line_s)
    }

    fn hand_over(&mut self, mut bytes: &[u8]) -> Result<(), ProbeError> {
        let until = self.link.now() + self.patience(bytes.len());
        while !bytes.is_empty() {
            let taken = self.link.send(bytes)?;
            bytes = &bytes[taken..];
            if taken == 0 {
                if self.link.now() >= until {
                    return Err(ProbeError::Stuck);
                }
                self.listen(Duration::from_millis(1))?;
            }
        }
        Ok(())
    }
}
