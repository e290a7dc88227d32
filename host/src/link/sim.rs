//! A controller in this process, in simulated time.

pub use hil_sim::device::Endpoint;

use super::{Link, LinkError};
use std::time::Duration;

/// How far simulated time goes at once while a host waits.
const STEP: Duration = Duration::from_millis(1);

/// A link to `endpoint`. Sending takes no simulated time; waiting does.
#[derive(Debug)]
pub struct SimLink<E> {
    endpoint: E,
    now: Duration,
}

impl<E: Endpoint> SimLink<E> {
    /// At time 0.
    pub fn new(endpoint: E) -> Self {
        Self { endpoint, now: Duration::ZERO }
    }

    /// The far end.
    pub fn endpoint(&self) -> &E {
        &self.endpoint
    }

    /// The far end, for good.
    pub fn into_endpoint(self) -> E {
        self.endpoint
    }

    /// The far end.
    pub fn endpoint_mut(&mut self) -> &mut E {
        &mut self.endpoint
    }

    fn check(&self) -> Result<(), LinkError> {
        if self.endpoint.is_there() { Ok(()) } else { Err(LinkError::Gone) }
    }
}

impl<E: Endpoint> Link for SimLink<E> {
    fn send(&mut self, bytes: &[u8]) -> Result<usize, LinkError> {
        self.check()?;
        Ok(self.endpoint.receive(bytes))
    }

    fn receive(&mut self, into: &mut Vec<u8>, wait: Duration) -> Result<usize, LinkError> {
        let until = self.now + wait;
        loop {
            self.check()?;
            let bytes = self.endpoint.transmit();
            let left = until.saturating_sub(self.now);
            if !bytes.is_empty() || left.is_zero() {
                into.extend_from_slice(&bytes);
                return Ok(bytes.len());
            }
            let step = STEP.min(left);
            self.endpoint.advance(step.as_secs_f64());
            self.now += step;
        }
    }

    fn now(&self) -> Duration {
        self.now
    }
}
