//! A controller in this process, in simulated time.

pub use hil_sim::device::Endpoint;

use super::{Connect, Link, LinkError};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// How far simulated time goes at once while a host waits.
const STEP: Duration = Duration::from_millis(1);

/// A link to `endpoint`. Sending takes no simulated time; waiting does.
#[derive(Debug)]
pub struct SimLink<E> {
    endpoint: E,
    now: Duration,
    plug: Option<u32>,
}

impl<E: Endpoint> SimLink<E> {
    /// At time 0.
    pub fn new(endpoint: E) -> Self {
        Self::at(endpoint, Duration::ZERO)
    }

    /// At time `now`.
    fn at(endpoint: E, now: Duration) -> Self {
        Self { plug: endpoint.plug(), endpoint, now }
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
        let plug = self.endpoint.plug();
        if plug.is_some() && plug == self.plug { Ok(()) } else { Err(LinkError::Gone) }
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

/// A device that lives on while nothing is connected to it.
#[derive(Debug)]
pub struct Shared<E>(Arc<Mutex<(E, Duration)>>);

impl<E> Clone for Shared<E> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<E> Shared<E> {
    /// Switched on now: its time is 0.
    pub fn new(endpoint: E) -> Self {
        Self(Arc::new(Mutex::new((endpoint, Duration::ZERO))))
    }

    /// Looks at it, or does something to it.
    pub fn with<T>(&self, act: impl FnOnce(&mut E) -> T) -> T {
        act(&mut self.lock().0)
    }

    fn lock(&self) -> MutexGuard<'_, (E, Duration)> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<E: Endpoint> Endpoint for Shared<E> {
    fn receive(&mut self, bytes: &[u8]) -> usize {
        self.lock().0.receive(bytes)
    }

    fn transmit(&mut self) -> Vec<u8> {
        self.lock().0.transmit()
    }

    fn advance(&mut self, seconds: f64) {
        let mut device = self.lock();
        device.0.advance(seconds);
        device.1 += Duration::from_secs_f64(seconds);
    }

    fn lose_link(&mut self) {
        self.lock().0.lose_link();
    }

    fn plug(&self) -> Option<u32> {
        self.lock().0.plug()
    }
}

impl<E: Endpoint> Connect for Shared<E> {
    type Link = SimLink<Self>;

    fn connect(&mut self) -> Result<Self::Link, LinkError> {
        let (plug, now) = {
            let device = self.lock();
            (device.0.plug(), device.1)
        };
        match plug {
            Some(_) => Ok(SimLink::at(self.clone(), now)),
            None => Err(LinkError::Gone),
        }
    }

    fn wait(&mut self, time: Duration) {
        self.advance(time.as_secs_f64());
    }
}
