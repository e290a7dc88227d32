//! Single packets to a device and their answers, each sent once: what a stream makes up for is to be seen here.

use crate::link::Link;
use crate::stream::StreamError;
pub(crate) use crate::stream::conversation::Answer;
use crate::stream::conversation::Conversation;
use protocol::message::{Faults, Message, Status};
use std::time::Duration;

/// How long an answer may take on a line that carries everything at once.
const PATIENCE: Duration = Duration::from_secs(1);

/// A packet that was sent and not answered yet.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Asked {
    sequence: u32,
    message: &'static str,
    /// Its bytes on the wire.
    pub bytes: usize,
    /// The device's clock when its first byte was given to the link.
    pub at: Duration,
}

/// One end of a conversation.
pub(crate) struct Probe<'a>(Conversation<&'a mut dyn Link>);

impl<'a> Probe<'a> {
    /// Ends what an earlier conversation left unfinished.
    pub(crate) fn new(link: &'a mut dyn Link) -> Result<Self, StreamError> {
        let mut conversation = Conversation::new(link);
        conversation.greet()?;
        Ok(Self(conversation))
    }

    /// Bytes a second that the link says it carries.
    pub(crate) fn bytes_per_second(&self) -> Option<f64> {
        self.0.link.bytes_per_second()
    }

    /// The device's clock.
    pub(crate) fn now(&self) -> Duration {
        self.0.link.now()
    }

    /// The latest status.
    pub(crate) fn status(&self) -> Option<&Status> {
        self.0.status.as_ref()
    }

    /// What the device remembers of its faults.
    pub(crate) fn faults(&self) -> Option<&Faults> {
        self.0.faults.as_ref()
    }

    /// Sends `message` and does not wait for its answer.
    pub(crate) fn send<'m>(&mut self, message: impl Into<Message<'m>>) -> Result<Asked, StreamError> {
        let (message, at, before) = (message.into(), self.now(), self.0.statistics.bytes_on_wire);
        let sequence = self.0.post(&message)?;
        let bytes = (self.0.statistics.bytes_on_wire - before) as usize;
        Ok(Asked { sequence, message: message.entry().name, bytes, at })
    }

    /// The answer to `asked`, and when it was there; `under_way` bytes may come before it. Answers to earlier packets are forgotten.
    pub(crate) fn answer(&mut self, asked: Asked, under_way: usize) -> Result<(Answer, Duration), StreamError> {
        let until = self.now() + self.patience(under_way);
        loop {
            while let Some((sequence, answer)) = self.0.answers.pop_front() {
                if sequence == asked.sequence {
                    return Ok((answer, self.now()));
                }
            }
            let left = until.saturating_sub(self.now());
            if left.is_zero() {
                return Err(StreamError::NoAnswer { message: asked.message, attempts: 1 });
            }
            self.listen(left)?;
        }
    }

    /// Sends `message` and waits for its answer.
    pub(crate) fn ask<'m>(&mut self, message: impl Into<Message<'m>>) -> Result<Answer, StreamError> {
        let asked = self.send(message)?;
        Ok(self.answer(asked, asked.bytes)?.0)
    }

    /// Waits up to `wait` for bytes and reads what came.
    pub(crate) fn listen(&mut self, wait: Duration) -> Result<(), StreamError> {
        self.0.listen(wait)
    }

    /// How long `bytes` and an answer may take: four times what the line needs, as others may hold it up.
    fn patience(&self, bytes: usize) -> Duration {
        let line_s = self.bytes_per_second().map_or(0.0, |rate| bytes as f64 / rate);
        PATIENCE + Duration::from_secs_f64(4.0 * line_s)
    }
}
