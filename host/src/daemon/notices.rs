//! What is worth telling of a controller's states: a mirror that falls out of step, a video without numbers.

use super::telemetry::EventKind;
use protocol::message::State;
use std::time::{Duration, Instant};

/// A video without numbers is told of after so long: another host may be about to begin.
const DARK_TOLD: Duration = Duration::from_secs(2);

/// Whether the mirror keeps step, since it was in step.
#[derive(Clone, Copy, Debug, Default)]
pub enum InStep {
    /// It was not yet.
    #[default]
    Away,
    /// It does.
    Yes,
    /// Since then it does not.
    No(Instant),
}

impl InStep {
    /// What there is to tell at `now` of a controller in `state`: where the mirror falls out of step by itself, and when it is back.
    pub fn hear(&mut self, state: State, now: Instant) -> Option<(EventKind, String)> {
        let (next, notice) = match (*self, state) {
            (Self::Yes, State::Holdover) => {
                let text = "pulses are missing: the mirror turns on by what was learnt";
                (Self::No(now), Some((EventKind::Warning, text.into())))
            }
            (Self::Yes, State::SpinUp | State::Acquire) => {
                (Self::No(now), Some((EventKind::Warning, "the mirror fell out of step, dark".into())))
            }
            (Self::No(since), State::Locked | State::OpenLoop) => {
                let text = format!("in step again after {:.1} s", (now - since).as_secs_f64());
                (Self::Yes, Some((EventKind::Note, text)))
            }
            (_, State::Locked | State::OpenLoop) => (Self::Yes, None),
            // Stopped, or in a fault, which is told by itself.
            (_, State::Idle | State::Fault | State::Service) => (Self::Away, None),
            (as_before, _) => (as_before, None),
        };
        *self = next;
        notice
    }
}

/// For how long it has been dark for no reason, and whether that was told.
#[derive(Clone, Copy, Debug, Default)]
pub enum Darkness {
    /// It is not.
    #[default]
    No,
    /// Since then.
    Since(Instant),
    /// That was told.
    Told,
}

impl Darkness {
    /// What there is to tell at `now`, once, of a mirror that is in step with a video and dark where `is_dark`.
    pub fn watch(&mut self, is_dark: bool, now: Instant) -> Option<&'static str> {
        let (next, notice) = match *self {
            _ if !is_dark => (Self::No, None),
            Self::No => (Self::Since(now), None),
            Self::Since(since) if now - since > DARK_TOLD => {
                let text = "the controller reads no numbers in the video's frames: is the monitor the projector, and does nothing between them \
                            change a bit of the picture?";
                (Self::Told, Some(text))
            }
            as_before => (as_before, None),
        };
        *self = next;
        notice
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mirror_that_falls_out_of_step_is_told_of_once_and_when_it_is_back() {
        let start = Instant::now();
        let mut in_step = InStep::default();
        let mut hear = |state, seconds| {
            let notice = in_step.hear(state, start + Duration::from_secs(seconds));
            notice.map(|(_, text)| text).unwrap_or_default()
        };
        // The first start is none of it.
        for state in [State::Idle, State::SpinUp, State::Acquire, State::Locked] {
            assert_eq!(hear(state, 0), "");
        }
        assert!(hear(State::Holdover, 1).starts_with("pulses are missing"));
        assert_eq!(hear(State::SpinUp, 2), "");
        assert_eq!(hear(State::Locked, 4), "in step again after 3.0 s");
        assert!(hear(State::Acquire, 5).contains("out of step"));
        // A fault tells itself, and what follows is a start.
        for state in [State::Fault, State::SpinUp, State::Locked] {
            assert_eq!(hear(state, 6), "");
        }
    }

    #[test]
    fn a_dark_video_is_told_of_once_until_it_was_lit() {
        let start = Instant::now();
        let mut darkness = Darkness::default();
        let mut watch = |is_dark, seconds| darkness.watch(is_dark, start + Duration::from_secs(seconds)).is_some();
        assert!(!watch(true, 0) && !watch(true, 2) && watch(true, 3) && !watch(true, 9));
        assert!(!watch(false, 10) && !watch(true, 11) && watch(true, 14));
    }
}
