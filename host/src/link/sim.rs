//! A controller in this process, in simulated time.

pub use hil_sim::device::Endpoint;
pub use hil_sim::scenario::Action;
pub use hil_sim::simulator::Injector;

use super::{Connect, Link, LinkError};
use hil_sim::motor::Motor;
use hil_sim::paced::{Pace, Paced};
use hil_sim::scenario::{Pacing, Scenario};
use hil_sim::served::{self, Pump};
use hil_sim::simulator::Simulator;
use protocol::rig::Rig;
use std::convert::Infallible;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How far simulated time goes at once while a host waits: first the least, so that quick answers have their time, then twice as far each time.
const STEPS: [Duration; 2] = [Duration::from_micros(50), Duration::from_millis(1)];

/// How a simulated device's time passes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Clock {
    /// As fast as the simulation can, and only while a host waits: the same every time.
    #[default]
    Simulated,
    /// As the wall's does.
    Wall,
}

/// A link to `endpoint`. Sending takes no simulated time; waiting does.
#[derive(Debug)]
pub struct SimLink<E> {
    endpoint: E,
    began: Duration,
    now: Duration,
    plug: Option<u32>,
    bytes_per_second: Option<f64>,
    wall: Option<(Instant, Pump)>,
}

impl<E: Endpoint> SimLink<E> {
    /// At time 0 of a clock that is the simulation's.
    pub fn new(endpoint: E) -> Self {
        Self::at(endpoint, Duration::ZERO)
    }

    /// The same at time `now`.
    fn at(endpoint: E, now: Duration) -> Self {
        Self { plug: endpoint.plug(), endpoint, began: now, now, bytes_per_second: None, wall: None }
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

    /// Lets at most `most` pass, in simulated time; what the device said meanwhile goes to `into`.
    fn pass(&mut self, most: Duration, into: &mut Vec<u8>) {
        let Some((start, pump)) = &mut self.wall else {
            self.endpoint.advance(most.as_secs_f64());
            self.now += most;
            return;
        };
        std::thread::sleep(most.min(served::STEP));
        let Ok(()) = pump.catch_up(start.elapsed(), &mut self.endpoint, |endpoint| {
            into.extend(endpoint.transmit());
            Ok::<_, Infallible>(())
        });
        self.now = self.began + pump.simulated();
    }
}

impl<E: Endpoint> Link for SimLink<E> {
    fn send(&mut self, bytes: &[u8]) -> Result<usize, LinkError> {
        self.check()?;
        Ok(self.endpoint.receive(bytes))
    }

    fn receive(&mut self, into: &mut Vec<u8>, wait: Duration) -> Result<usize, LinkError> {
        let (before, until) = (into.len(), self.now + wait);
        let [mut step, longest] = STEPS;
        loop {
            self.check()?;
            into.extend(self.endpoint.transmit());
            let left = until.saturating_sub(self.now);
            if into.len() > before || left.is_zero() {
                return Ok(into.len() - before);
            }
            self.pass(step.min(left), into);
            step = longest.min(2 * step);
        }
    }

    fn now(&self) -> Duration {
        self.now
    }

    fn bytes_per_second(&self) -> Option<f64> {
        self.bytes_per_second
    }
}

/// An endpoint that several links lead to, one after the other, with its time.
#[derive(Debug)]
pub struct Shared<E>(Arc<Mutex<(E, Duration)>>);

impl<E> Clone for Shared<E> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<E> Shared<E> {
    /// At time 0.
    pub fn new(endpoint: E) -> Self {
        Self(Arc::new(Mutex::new((endpoint, Duration::ZERO))))
    }

    /// Looks at it, or does something to it.
    pub fn with<T>(&self, act: impl FnOnce(&mut E) -> T) -> T {
        act(&mut self.lock().0)
    }

    /// The endpoint, and how much time has passed there.
    fn lock(&self) -> MutexGuard<'_, (E, Duration)> {
        // Whoever panicked with it is not this link's matter: every packet is checked.
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
        let (endpoint, passed) = &mut *self.lock();
        endpoint.advance(seconds);
        *passed += Duration::from_secs_f64(seconds);
    }

    fn lose_link(&mut self) {
        self.lock().0.lose_link();
    }

    fn plug(&self) -> Option<u32> {
        self.lock().0.plug()
    }

    fn is_at_rest(&self) -> bool {
        self.lock().0.is_at_rest()
    }
}

/// Links to one endpoint, which lives on between them: its time goes on where the last link ended.
#[derive(Debug)]
pub struct SimConnect<E> {
    endpoint: Shared<E>,
    clock: Clock,
    bytes_per_second: Option<f64>,
}

impl<E> Clone for SimConnect<E> {
    fn clone(&self) -> Self {
        Self { endpoint: self.endpoint.clone(), ..*self }
    }
}

impl<E: Endpoint> SimConnect<E> {
    /// To `endpoint`, over a line that carries `bytes_per_second` if anything limits it.
    pub fn new(endpoint: Shared<E>, clock: Clock, bytes_per_second: Option<f64>) -> Self {
        Self { endpoint, clock, bytes_per_second }
    }
}

impl<E: Endpoint> Connect for SimConnect<E> {
    type Link = SimLink<Shared<E>>;

    fn connect(&mut self) -> Result<Self::Link, LinkError> {
        if self.endpoint.plug().is_none() {
            let remedy = "its plug is out: it must come back first".into();
            return Err(LinkError::Absent { name: "sim".into(), remedy });
        }
        let began = self.endpoint.lock().1;
        let mut link = SimLink::at(self.endpoint.clone(), began);
        link.bytes_per_second = self.bytes_per_second;
        link.wall = (self.clock == Clock::Wall).then(|| (Instant::now(), Pump::new()));
        Ok(link)
    }

    fn wait(&mut self, time: Duration) {
        if self.clock == Clock::Wall {
            std::thread::sleep(time);
        }
        self.endpoint.advance(time.as_secs_f64());
    }
}

/// How a simulated controller is connected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cable {
    /// By none: bytes take no time.
    None,
    /// As USB high speed carries them: [`Pace::USB`].
    Usb,
    /// A serial line of so many bits a second.
    Serial(u32),
}

/// What a simulated controller is.
#[derive(Clone, Debug)]
pub struct Simulated {
    /// What it drives.
    pub rig: Rig,
    /// All noise follows from it.
    pub seed: u64,
    /// How its time passes.
    pub clock: Clock,
    /// What happens to it from outside.
    pub injector: Injector,
    /// Whether its projector shows video, which arrives there as it should: as that of this rig, in its own time.
    pub by_video: bool,
}

impl Simulated {
    /// One to which nothing happens, and to which turns come over the wire.
    pub fn new(rig: Rig, seed: u64, clock: Clock) -> Self {
        Self { rig, seed, clock, injector: Injector::default(), by_video: false }
    }

    /// The way to one with the reference motor, which nobody has started. A rig that the controller refuses is no device, and the error says why.
    pub fn connect_by(&self, cable: Cable) -> Result<SimConnect<Box<dyn Endpoint + Send>>, LinkError> {
        let pacing = if self.by_video { Pacing::VideoLocked } else { Pacing::FrameLocked };
        let scenario = Scenario { pacing, ..Scenario::without_events() };
        let simulator = Simulator::new(&self.rig, Motor::reference(), scenario, self.seed);
        let simulator = simulator.map_err(|error| LinkError::Absent {
            name: "sim".into(),
            remedy: format!("the simulated controller refuses rig {}: {error}", self.rig.name),
        })?;
        let simulator = simulator.with_injector(self.injector.clone());
        let pace = match cable {
            Cable::None => None,
            Cable::Usb => Some(Pace::USB),
            Cable::Serial(baud) => Some(Pace::serial(baud)),
        };
        let endpoint: Box<dyn Endpoint + Send> = match pace {
            None => Box::new(simulator),
            Some(pace) => Box::new(Paced::new(simulator, pace)),
        };
        Ok(SimConnect::new(Shared::new(endpoint), self.clock, pace.map(|pace| pace.bytes_per_second)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::{Stream, StreamError, TurnPlanes};
    use protocol::codec::ImageSize;
    use protocol::message::{Command, State};

    const RIG: &str = include_str!("../../rigs/reference.toml");

    fn simulated(clock: Clock) -> Simulated {
        Simulated::new(Rig::parse(RIG).unwrap(), 1, clock)
    }

    #[test]
    fn a_simulated_device_lives_on_between_links() {
        let size = ImageSize::new(64, 48).unwrap();
        for cable in [Cable::None, Cable::Usb, Cable::Serial(3_000_000)] {
            let Simulated { rig, .. } = simulated(Clock::Simulated);
            let mut way = simulated(Clock::Simulated).connect_by(cable).unwrap();
            let mut stream = Stream::new(way.connect().unwrap(), &rig.rotation(), size).unwrap();
            stream.command(Command::Start).unwrap();
            let until = stream.link().now() + Duration::from_secs(1);
            while stream.link().now() < until {
                stream.poll(Duration::from_millis(100)).unwrap();
            }
            let (left_at, speed) = (stream.link().now(), stream.status().unwrap().speed_microhertz);
            assert!(speed > 100_000, "{cable:?}: {speed}");
            drop(stream);
            let link = way.connect().unwrap();
            assert_eq!(link.now(), left_at, "{cable:?}");
            let mut stream = Stream::new(link, &rig.rotation(), size).unwrap();
            let status = loop {
                if let Some(status) = stream.poll(Duration::from_millis(20)).unwrap() {
                    break status;
                }
            };
            assert!(status.speed_microhertz >= speed, "{cable:?}: {status:?}");
        }
    }

    struct Dark(Vec<u8>);

    impl TurnPlanes for Dark {
        fn slices(&self) -> u32 {
            288
        }

        fn plane_bytes(&self, _slice: u32) -> &[u8] {
            &self.0
        }
    }

    #[test]
    fn another_rigs_turns_are_in_the_way_only_while_the_mirror_is_driven() {
        let mut way = simulated(Clock::Simulated).connect_by(Cable::None).unwrap();
        let rotation = simulated(Clock::Simulated).rig.rotation();
        let mut connect = |side| Stream::new(way.connect().unwrap(), &rotation, ImageSize::new(side, side).unwrap());
        let shows = |stream: &mut Stream<_>, side: usize, state: State| {
            stream.submit(&Dark(vec![0; side.div_ceil(8) * side])).unwrap();
            while stream.poll(Duration::from_millis(50)).unwrap().is_none_or(|status| status.state != state) {}
        };
        shows(&mut connect(16).unwrap(), 16, State::Idle);
        let mut stream = connect(24).unwrap();
        stream.command(Command::Start).unwrap();
        shows(&mut stream, 24, State::Locked);
        drop(stream);
        assert!(matches!(connect(16), Err(StreamError::OtherTurns)));
        let mut stream = connect(24).unwrap();
        stream.command(Command::Stop).unwrap();
        drop(stream);
        let mut stream = connect(16).unwrap();
        stream.command(Command::Start).unwrap();
        shows(&mut stream, 16, State::Locked);
        while stream.poll(Duration::from_millis(50)).unwrap().is_none_or(|status| status.turn_on_screen.is_none()) {}
    }

    #[test]
    fn a_paced_device_says_its_rate() {
        let rate = |cable| simulated(Clock::Simulated).connect_by(cable).unwrap().connect().unwrap().bytes_per_second();
        let cables = [Cable::None, Cable::Usb, Cable::Serial(9_600)];
        assert_eq!(cables.map(rate), [None, Some(45e6), Some(960.0)]);
    }

    #[test]
    fn by_the_wall_simulated_time_is_never_ahead() {
        let mut way = simulated(Clock::Wall).connect_by(Cable::None).unwrap();
        let start = Instant::now();
        let mut link = way.connect().unwrap();
        for _ in 0..20 {
            let before = link.now();
            link.receive(&mut Vec::new(), Duration::from_millis(3)).unwrap();
            assert!(link.now() >= before + Duration::from_millis(3));
            assert!(link.now() <= start.elapsed(), "{:?}", link.now());
        }
    }
}
