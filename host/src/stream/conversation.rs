//! Questions and answers: packets out, packets in, who waits for what.

use super::round_trip::RoundTrip;
use super::{News, Statistics, StreamError};
use crate::link::Link;
use protocol::message::{Ack, Faults, HelloReply, Message, Missing, Nack, PLANE_PART_BYTES, Reason, Status};
use protocol::packet::{Decoder, FRAME_BYTES_MAX, PACKET_BYTES_MAX, encode};
use std::collections::VecDeque;
use std::ops::Range;
use std::time::Duration;

/// How often a packet is sent before the device counts as silent.
const ATTEMPTS: u32 = 10;
/// Packets of planes that may be under way unanswered: at most half a megabyte.
const WINDOW: usize = 32;
/// How long an answer may take at most, apart from the time that a slow link needs.
const ANSWER_WITHIN: Duration = Duration::from_millis(500);

/// A plane is cut so that a slow line carries a part in about this time: a part that is damaged is soon sent again.
const PART_S: f64 = 0.02;
/// Parts of planes that may be under way take a slow line so long.
const WINDOW_S: f64 = 0.25;

/// What the device said to a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Answer {
    Hello { version: u16, schema: u64 },
    Missing { from: u16, to: u16 },
    Ack,
    Nack(Reason),
}

/// A packet of planes that was sent.
#[derive(Clone, Debug)]
struct Unanswered {
    sequence: u32,
    /// The slices that are whole with it.
    slices: Range<u16>,
    at: Duration,
}

/// What became of a packet of planes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Outcome {
    /// The slices that are whole with it.
    pub(crate) slices: Range<u16>,
    pub(crate) answer: Answer,
}

impl Answer {
    fn is_to(self, message: &Message<'_>) -> bool {
        match self {
            Self::Hello { .. } => matches!(message, Message::Hello(_)),
            Self::Missing { .. } => matches!(message, Message::AskMissing(_)),
            Self::Ack => !matches!(message, Message::Hello(_) | Message::AskMissing(_)),
            Self::Nack(_) => !matches!(message, Message::Hello(_)),
        }
    }
}

/// One end of a link in conversation with a device.
#[derive(Debug)]
pub(crate) struct Conversation<L> {
    pub(crate) link: L,
    decoder: Box<Decoder<PACKET_BYTES_MAX>>,
    frame: Vec<u8>,
    incoming: Vec<u8>,
    /// What came and nobody asked for yet, with the sequence number that it answers.
    pub(crate) answers: VecDeque<(u32, Answer)>,
    /// Packets of planes without an answer, the oldest first.
    unanswered: VecDeque<Unanswered>,
    round_trip: RoundTrip,
    sequence: u32,
    pub(crate) status: Option<Status>,
    pub(crate) faults: Option<Faults>,
    pub(crate) statistics: Statistics,
    pub(crate) news: News,
}

impl<L: Link> Conversation<L> {
    pub(crate) fn new(link: L) -> Self {
        // Not 0: answers to an earlier conversation over the same link must not look like answers to this one.
        let sequence = link.now().as_micros() as u32;
        Self {
            link,
            decoder: Box::default(),
            frame: vec![0; FRAME_BYTES_MAX],
            incoming: Vec::new(),
            answers: VecDeque::new(),
            unanswered: VecDeque::new(),
            round_trip: RoundTrip::default(),
            sequence,
            status: None,
            faults: None,
            statistics: Statistics::default(),
            news: News::default(),
        }
    }

    /// Goes on over another link.
    pub(crate) fn replace(&mut self, link: L) {
        self.link = link;
        self.decoder.cut();
        self.answers.clear();
        self.unanswered.clear();
        self.round_trip = RoundTrip::default();
    }

    /// Ends whatever packet an earlier conversation left unfinished.
    pub(crate) fn greet(&mut self) -> Result<(), StreamError> {
        self.transfer(&[0], "Hello")
    }

    /// Sends `message`, again where no answer comes, and returns the answer.
    pub(crate) fn request(&mut self, message: &Message<'_>) -> Result<Answer, StreamError> {
        let sequence = self.sequence;
        self.sequence = self.sequence.wrapping_add(1);
        for attempt in 0..ATTEMPTS {
            self.statistics.retries += u64::from(attempt > 0);
            self.send(sequence, message)?;
            let start = self.link.now();
            let until = start + self.patience();
            loop {
                let left = until.saturating_sub(self.link.now());
                self.listen(left)?;
                let fits = |(answers, answer): &(u32, Answer)| *answers == sequence && answer.is_to(message);
                let found = self.answers.iter().copied().find(fits);
                self.answers.clear();
                if let Some((_, answer)) = found {
                    // What was sent twice may have been answered the first time.
                    if attempt == 0 {
                        self.round_trip.answered(self.link.now().saturating_sub(start));
                    }
                    return Ok(answer);
                }
                if left.is_zero() {
                    self.round_trip.lost();
                    break;
                }
            }
        }
        Err(StreamError::NoAnswer { message: message.entry().name, attempts: ATTEMPTS })
    }

    /// [`request`](Self::request) that must be acknowledged.
    pub(crate) fn ask(&mut self, message: &Message<'_>) -> Result<(), StreamError> {
        let answer = self.request(message)?;
        self.accepted(message, answer)
    }

    pub(crate) fn accepted(&mut self, message: &Message<'_>, answer: Answer) -> Result<(), StreamError> {
        let Answer::Nack(reason) = answer else { return Ok(()) };
        self.statistics.refused += 1;
        Err(StreamError::Refused { message: message.entry().name, reason })
    }

    /// Sends `message` once, and waits for nothing; its number.
    pub(crate) fn post(&mut self, message: &Message<'_>) -> Result<u32, StreamError> {
        let sequence = self.sequence;
        self.sequence = self.sequence.wrapping_add(1);
        self.send(sequence, message)?;
        Ok(sequence)
    }

    /// Sends `message` once, when there is room among those that are not answered yet. With its answer `slices` are done. What was
    /// answered meanwhile.
    pub(crate) fn send_next(&mut self, message: &Message<'_>, slices: Range<u16>) -> Result<Vec<Outcome>, StreamError> {
        let outcomes = self.settle_below(self.window())?;
        let sequence = self.post(message)?;
        self.unanswered.push_back(Unanswered { sequence, slices, at: self.link.now() });
        Ok(outcomes)
    }

    /// Waits until all that was sent is answered, or lost.
    pub(crate) fn settle(&mut self) -> Result<Vec<Outcome>, StreamError> {
        self.settle_below(1)
    }

    /// Waits until fewer than `below` packets are unanswered. The device answers in order: what was sent before an answered packet is
    /// answered or lost, and when no answer comes in time, all are lost.
    fn settle_below(&mut self, below: usize) -> Result<Vec<Outcome>, StreamError> {
        let mut outcomes = Vec::new();
        let mut until = self.link.now() + self.patience();
        self.listen(Duration::ZERO)?;
        loop {
            while let Some((sequence, answer)) = self.answers.pop_front() {
                let Some(at) = self.unanswered.iter().position(|sent| sent.sequence == sequence) else { continue };
                let Some(Unanswered { slices, at, .. }) = self.unanswered.drain(..=at).next_back() else { continue };
                self.round_trip.answered(self.link.now().saturating_sub(at));
                until = self.link.now() + self.patience();
                self.statistics.planes += if answer == Answer::Ack { slices.len() as u64 } else { 0 };
                outcomes.push(Outcome { slices, answer });
            }
            if self.unanswered.len() < below {
                return Ok(outcomes);
            }
            let left = until.saturating_sub(self.link.now());
            if left.is_zero() {
                self.unanswered.clear();
                self.round_trip.lost();
                return Ok(outcomes);
            }
            self.listen(left)?;
        }
    }

    /// The most compressed bytes of a plane in one packet.
    pub(crate) fn part_bytes(&self) -> usize {
        let bytes = self.link.bytes_per_second().map(|rate| (rate * PART_S) as usize);
        bytes.unwrap_or(PLANE_PART_BYTES).clamp(512, PLANE_PART_BYTES)
    }

    /// Packets that may be under way unanswered.
    fn window(&self) -> usize {
        let packets = self.link.bytes_per_second().map(|rate| (rate * WINDOW_S / self.part_bytes() as f64) as usize);
        packets.unwrap_or(WINDOW).clamp(2, WINDOW)
    }

    /// How long an answer may take. On a slow link, what is under way goes first.
    fn patience(&self) -> Duration {
        let under_way = ((self.window() + 1) * self.part_bytes()) as f64;
        let slow = self.link.bytes_per_second().map_or(0.0, |rate| under_way / rate);
        self.round_trip.timeout(ANSWER_WITHIN + Duration::from_secs_f64(slow))
    }

    pub(crate) fn refused_plane(&mut self, reason: Reason) -> Result<(), StreamError> {
        self.statistics.refused += 1;
        match reason {
            Reason::PartMissing | Reason::PlaneDamaged => Ok(()),
            // Sent again it would be refused again.
            reason => Err(StreamError::Refused { message: "PlaneData", reason }),
        }
    }

    /// Reads what came, waiting up to `wait` for it.
    pub(crate) fn listen(&mut self, wait: Duration) -> Result<(), StreamError> {
        self.incoming.clear();
        self.link.receive(&mut self.incoming, wait)?;
        let mut bytes = &self.incoming[..];
        while let Some(packet) = self.decoder.next(&mut bytes) {
            match packet.ok().and_then(|packet| packet.message().ok()) {
                Some(Message::Ack(Ack { answers })) => self.answers.push_back((answers, Answer::Ack)),
                Some(Message::Nack(Nack { answers, reason })) => {
                    self.answers.push_back((answers, Answer::Nack(reason)))
                }
                Some(Message::HelloReply(HelloReply { answers, version, schema })) => {
                    self.answers.push_back((answers, Answer::Hello { version, schema }))
                }
                Some(Message::Missing(Missing { answers, from, to })) => {
                    self.answers.push_back((answers, Answer::Missing { from, to }))
                }
                Some(Message::Status(status)) => self.status = Some(status),
                Some(Message::Faults(faults)) => self.faults = Some(faults),
                // Damaged, or not for a host: whoever waits for it asks again.
                _ => {}
            }
        }
        self.news.put(self.statistics, self.status);
        Ok(())
    }

    fn send(&mut self, sequence: u32, message: &Message<'_>) -> Result<(), StreamError> {
        let length = encode(sequence, message, &mut self.frame)?;
        self.statistics.packets += 1;
        let frame = std::mem::take(&mut self.frame);
        let sent = self.transfer(&frame[..length], message.entry().name);
        self.frame = frame;
        sent
    }

    /// Hands over all of `bytes`; reads while the link takes none, so that a device that waits to be read goes on.
    fn transfer(&mut self, mut bytes: &[u8], message: &'static str) -> Result<(), StreamError> {
        // A link that takes nothing may still be stalled for a moment.
        let patience = ANSWER_WITHIN.max(self.patience());
        let mut until = self.link.now() + patience;
        while !bytes.is_empty() {
            let sent = self.link.send(bytes)?;
            self.statistics.bytes_on_wire += sent as u64;
            bytes = &bytes[sent..];
            if sent > 0 {
                until = self.link.now() + patience;
            } else if self.link.now() >= until {
                return Err(StreamError::NoAnswer { message, attempts: 1 });
            } else {
                self.listen(Duration::from_millis(1))?;
            }
        }
        Ok(())
    }
}
