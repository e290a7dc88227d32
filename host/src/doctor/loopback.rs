//! A turn that the device checks and never shows: noise that it must expand to the last bit, and then a check that is wrong on purpose.

use super::probe::{Answer, Asked, Probe};
use crate::stream::StreamError;
use protocol::codec::{Compressor, Hint, ImageSize, plane_check, turn_check};
use protocol::message::{BeginTurn, Configure, EndTurn, PLANE_PART_BYTES, PlaneData, Reason};
use protocol::rig::Rig;
use std::collections::VecDeque;

/// How long the line may be busy with it, seconds: each plane is noise for so many bytes, and dark from there on.
const BUSY_S: f64 = 1.0;
/// Bytes of a packet besides its planes', about.
const PACKET_BYTES: f64 = 40.0;
/// A line on which the packets alone take longer than this, in seconds, is not put to it.
const LONGEST_S: f64 = 30.0;
/// Bytes under way at most, in seconds of the line and in bytes.
const AHEAD_S: f64 = 0.2;
const AHEAD_BYTES: f64 = (512 * 1024) as f64;

/// What came of it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Loopback {
    /// Every plane arrived, and what was wrong on purpose was refused.
    Whole {
        /// Planes.
        planes: u16,
        /// Bytes on the wire, with their framing.
        bytes: u64,
        /// Seconds by the device's clock.
        seconds: f64,
    },
    /// The device was left alone, for that reason.
    Skipped(String),
    /// Something is wrong.
    Wrong(String),
}

/// Runs it with turns of `rig`. Whatever is shown stays; a display at rest gives up turns of another rig.
pub(crate) fn run(probe: &mut Probe<'_>, rig: &Rig) -> Result<Loopback, StreamError> {
    if let Some(status) = probe.status()
        && (status.turn_on_screen.is_some() || !status.state.is_at_rest())
    {
        return Ok(Loopback::Skipped(format!(
            "the display is running (state {:?}), and is not disturbed",
            status.state
        )));
    }
    let rotation = rig.rotation();
    let packets_s = f64::from(rotation.slices()) * PACKET_BYTES / probe.bytes_per_second().unwrap_or(f64::INFINITY);
    if packets_s > LONGEST_S {
        return Ok(Loopback::Skipped(format!("a turn's packets alone would take {packets_s:.0} s")));
    }
    let Ok(size) = ImageSize::new(rig.projector.width_px, rig.projector.height_px) else {
        return Ok(Loopback::Skipped(format!("no device holds pictures of rig {}", rig.name)));
    };
    let turn = probe.now().as_micros() as u32;
    let begin = BeginTurn { turn, slices: rotation.slices() as u16 };
    let configure = Configure::new(&rotation, size);
    let mut configured = probe.ask(configure)?;
    if configured == Answer::Nack(Reason::Busy) {
        // It was asked to give them up.
        configured = probe.ask(configure)?;
    }
    for answer in [configured, probe.ask(begin)?] {
        match answer {
            Answer::Nack(Reason::Busy) => return Ok(Loopback::Skipped("it keeps another host's turns".into())),
            Answer::Nack(reason) => return Ok(Loopback::Wrong(format!("turns of rig {}: {reason}", rig.name))),
            _ => {}
        }
    }
    let mut sender = Sender::new(probe, size, begin);
    let began = sender.probe.now();
    if let Some(reason) = sender.send_all()? {
        return Ok(Loopback::Wrong(format!("a plane was sent whole and refused: {reason}")));
    }
    let (bytes, seconds) = (sender.bytes, (sender.probe.now() - began).as_secs_f64());
    let planes = begin.slices;
    Ok(sender.send_what_is_wrong()?.map_or(Loopback::Whole { planes, bytes, seconds }, Loopback::Wrong))
}

struct Sender<'a, 'b> {
    probe: &'a mut Probe<'b>,
    size: ImageSize,
    begin: BeginTurn,
    noise_bytes: usize,
    ahead_bytes: usize,
    compressor: Compressor,
    under_way: VecDeque<Asked>,
    bytes_under_way: usize,
    bytes: u64,
    checks: Vec<u64>,
}

impl<'a, 'b> Sender<'a, 'b> {
    fn new(probe: &'a mut Probe<'b>, size: ImageSize, begin: BeginTurn) -> Self {
        let rate = probe.bytes_per_second().unwrap_or(f64::INFINITY);
        let noise = (rate * BUSY_S / f64::from(begin.slices) - PACKET_BYTES).max(1.0);
        Self {
            probe,
            size,
            begin,
            noise_bytes: (noise as usize).min(size.plane_bytes()),
            ahead_bytes: (rate * AHEAD_S).min(AHEAD_BYTES) as usize,
            compressor: Compressor::new(size),
            under_way: VecDeque::new(),
            bytes_under_way: 0,
            bytes: 0,
            checks: Vec::new(),
        }
    }

    /// The first `noise_bytes` are random (a xorshift of 32 bits, Marsaglia 2003).
    fn plane(&self, slice: u16) -> Vec<u8> {
        let mut state = (self.begin.turn ^ u32::from(slice) << 16).wrapping_mul(0x9e37_79b9) | 1;
        let mut plane = vec![0; self.size.plane_bytes()];
        for byte in &mut plane[..self.noise_bytes] {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            *byte = (state >> 8) as u8;
        }
        plane
    }

    /// Every plane of the turn; the first refusal ends it.
    fn send_all(&mut self) -> Result<Option<Reason>, StreamError> {
        for slice in 0..self.begin.slices {
            let plane = self.plane(slice);
            let check = plane_check(&plane);
            self.checks.push(check);
            let refused = self.send_plane(slice, &plane, check)?;
            if refused.is_some() {
                return Ok(refused);
            }
        }
        self.settle(0)
    }

    fn send_plane(&mut self, slice: u16, plane: &[u8], check: u64) -> Result<Option<Reason>, StreamError> {
        let mut compressed = Vec::new();
        self.compressor.compress(plane, Hint::None, &mut compressed);
        let (turn, total) = (self.begin.turn, compressed.len() as u32);
        for (offset, bytes) in (0..).step_by(PLANE_PART_BYTES).zip(compressed.chunks(PLANE_PART_BYTES)) {
            let asked = self.probe.send(PlaneData { turn, slice, offset, total, check, bytes })?;
            self.under_way.push_back(asked);
            self.bytes_under_way += asked.bytes;
            self.bytes += asked.bytes as u64;
            let refused = self.settle(self.ahead_bytes)?;
            if refused.is_some() {
                return Ok(refused);
            }
        }
        Ok(None)
    }

    /// Waits until at most so many bytes are under way. The first refusal ends it.
    fn settle(&mut self, bytes: usize) -> Result<Option<Reason>, StreamError> {
        while self.bytes_under_way > bytes
            && let Some(asked) = self.under_way.pop_front()
        {
            let (answer, _) = self.probe.answer(asked, self.bytes_under_way)?;
            self.bytes_under_way -= asked.bytes;
            if let Answer::Nack(reason) = answer {
                return Ok(Some(reason));
            }
        }
        Ok(None)
    }

    /// A turn and a plane whose checks are another's: neither may be taken. What happened in place of that, if so.
    fn send_what_is_wrong(&mut self) -> Result<Option<String>, StreamError> {
        let check = turn_check(self.begin.turn, self.checks.iter().copied());
        let answer = self.probe.ask(EndTurn { turn: self.begin.turn, check: !check })?;
        if answer != Answer::Nack(Reason::TurnDamaged) {
            return Ok(Some(format!("a turn with another's check was answered with {answer:?}")));
        }
        let plane = self.plane(0);
        let refused = match self.send_plane(0, &plane, !self.checks[0])? {
            None => self.settle(0)?,
            reason => reason,
        };
        let is_right = refused == Some(Reason::PlaneDamaged);
        Ok((!is_right).then(|| format!("a plane with another's check was answered with {refused:?}")))
    }
}
