//! What a run of a scenario must come to. Besides, the checkers must find nothing wrong, whatever the scenario.

use crate::check::{Range, ValueError};
use crate::statistics::LockStatistics;
use protocol::message::{Fault, State};
use serde::{Deserialize, Serialize};

/// Part of a scenario's file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expectation {
    /// How long it must be run to tell, seconds.
    pub seconds: f64,
    /// What the controller is doing then.
    pub ends: State,
    /// The faults that it reports on the way, all of them, in order.
    #[serde(default)]
    pub faults: Vec<Fault>,
    /// No lit plane is farther from its place, slices.
    #[serde(default = "half")]
    pub farthest_slices: f64,
    /// Every disturbance is made good in so many seconds. `None`: it need not be.
    pub settled_s: Option<f64>,
}

fn half() -> f64 {
    0.5
}

impl Expectation {
    pub(crate) fn check(&self) -> Result<(), ValueError> {
        Range { least: 0.0, most: 1e6 }.check("expect.seconds", self.seconds)?;
        Range { least: 0.0, most: 0.5 }.check("expect.farthest_slices", self.farthest_slices)?;
        Range { least: 0.0, most: 1e6 }.check("expect.settled_s", self.settled_s.unwrap_or(0.0))
    }

    /// What `run` did that it must not, or did not and must; `None` where all is well.
    pub fn broken_by(&self, run: &LockStatistics) -> Option<String> {
        let verdict = &run.verdict;
        let ended = run.states.last().map(|&(_, state)| state);
        let faults: Vec<Fault> = run.faults.iter().map(|&(_, fault)| fault).collect();
        if !verdict.is_clean() {
            Some(verdict.first.clone().unwrap_or_default())
        } else if verdict.farthest_slices > self.farthest_slices {
            Some(format!("a plane {:.3} slices off: at most {}", verdict.farthest_slices, self.farthest_slices))
        } else if faults != self.faults {
            Some(format!("faults {:?}: must be {:?}", run.faults, self.faults))
        } else if ended != Some(self.ends) {
            Some(format!("states {:?}: must end with {:?}", run.states, self.ends))
        } else {
            let limit_s = self.settled_s?;
            let slow = run.recoveries.iter().find(|recovery| recovery.settled_s.is_none_or(|s| s > limit_s))?;
            Some(format!("{} at {} s settled after {:?} s: at most {limit_s}", slow.cause, slow.at_s, slow.settled_s))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checkers::Verdict;
    use crate::statistics::Collector;

    #[test]
    fn each_part_can_be_broken() {
        let well = Expectation {
            seconds: 1.0,
            ends: State::Locked,
            faults: Vec::new(),
            farthest_slices: 0.1,
            settled_s: Some(0.5),
        };
        let mut collector = Collector::default();
        collector.disturbed("start".to_owned(), 0.0, 0.1);
        collector.plane(0.2, 1.0, 1e6, State::SpinUp, false);
        collector.state(0.3, State::Locked, None);
        let run = collector.summary(1.0, Verdict { farthest_slices: 0.05, ..Verdict::default() });
        assert_eq!(well.broken_by(&run), None);
        for (broken, told) in [
            (Expectation { ends: State::Idle, ..well.clone() }, "must end with Idle"),
            (Expectation { faults: vec![Fault::Stall], ..well.clone() }, "must be [Stall]"),
            (Expectation { farthest_slices: 0.04, ..well.clone() }, "at most 0.04"),
            (Expectation { settled_s: Some(0.1), ..well.clone() }, "settled after Some(0.2)"),
        ] {
            assert!(broken.broken_by(&run).unwrap().contains(told), "{told}");
        }
        let torn = Verdict { torn: 1, first: Some("torn".to_owned()), ..Verdict::default() };
        assert_eq!(well.broken_by(&collector.summary(1.0, torn)).unwrap(), "torn");
    }
}
