//! Streams that go on.

use super::*;
use crate::stream::live::{Live, Progress, Source, Standby, Step, Totals};
use hil_sim::paced::{Pace, Paced};

type Line = Paced<Faulty<Player>>;

/// A turn each `every`; the newest is that of the time.
struct Film {
    every: Duration,
    last: Option<u32>,
}

impl Film {
    fn newest(&self, now: Duration) -> u32 {
        // Seeds 0, 3, 6 … have no mask and no codes to be learnt.
        3 * (now.as_millis() / self.every.as_millis()) as u32
    }
}

impl Source for Film {
    type Turn = Pictures;

    fn take(&mut self, now: Duration) -> Option<Pictures> {
        let newest = self.newest(now);
        let is_new = self.last.replace(newest) != Some(newest);
        is_new.then(|| Pictures::new(newest, SLICES, small()))
    }

    fn has_newer(&mut self, now: Duration) -> bool {
        self.last != Some(self.newest(now))
    }
}

/// Notes how many planes of a turn have arrived, each time it is told.
struct Watched(Film, Vec<u64>);

impl Source for Watched {
    type Turn = Pictures;

    fn take(&mut self, now: Duration) -> Option<Pictures> {
        self.0.take(now)
    }

    fn has_newer(&mut self, now: Duration) -> bool {
        self.0.has_newer(now)
    }

    fn watch(&mut self, progress: &Progress) {
        self.1.push(progress.planes);
    }
}

#[test]
fn a_turn_is_watched_while_it_is_under_way() {
    let line = line(20_000.0);
    let mut live = open_live(&line, 20_000.0, Duration::from_secs(1));
    let mut source = Watched(Film { every: Duration::from_secs(3_600), last: None }, Vec::new());
    while !matches!(live.step(&mut source).unwrap(), Step::Delivered(_)) {}
    let seen = &source.1;
    assert!(seen.is_sorted() && seen[0] == 0 && seen.len() >= SLICES as usize, "{seen:?}");
    // One by one, but for those that are under way when the last one is sent.
    assert!(seen.windows(2).all(|pair| pair[1] - pair[0] <= 1) && seen.last() > Some(&10), "{seen:?}");
    assert_eq!(live.statistics().planes, u64::from(SLICES));
}

/// No turns any more.
struct Nothing;

impl Source for Nothing {
    type Turn = Pictures;

    fn take(&mut self, _now: Duration) -> Option<Pictures> {
        None
    }

    fn has_newer(&mut self, _now: Duration) -> bool {
        false
    }
}

fn line(bytes_per_second: f64) -> Shared<Line> {
    let player = Player::new(true, small());
    let pace = Pace { bytes_per_second, buffer_bytes: 1024 };
    Shared::new(Paced::new(Faulty::new(player, FaultRates::default(), 1), pace))
}

fn open_live(line: &Shared<Line>, bytes_per_second: f64, look_for: Duration) -> Live<SimConnect<Line>, Pictures> {
    let way = SimConnect::new(line.clone(), Clock::Simulated, Some(bytes_per_second));
    Live::new(way, &rotation(SLICES), small(), [Duration::from_millis(100), look_for]).unwrap()
}

#[test]
fn a_slow_line_shows_fewer_turns_and_each_of_them_whole() {
    let rate = 20_000.0;
    let line = line(rate);
    let mut live = open_live(&line, rate, Duration::from_secs(9));
    let mut film = Film { every: Duration::from_millis(50), last: None };
    while live.now() < Duration::from_secs(4) {
        live.step(&mut film).unwrap();
    }
    // A turn has some 900 bytes of noise and more of framing: about a tenth of a second, which is late, and not left.
    let Totals { delivered, late, failed, .. } = live.totals();
    assert!(delivered > 20 && late <= delivered / 4 && failed == 0, "{:?}", live.totals());
    line.with(|line| {
        for (_, planes) in &line.endpoint().endpoint().shown {
            assert!((0..400).any(|seed| Pictures::new(3 * seed, SLICES, small()).planes == *planes));
        }
    });
}

#[test]
fn the_standby_follows_when_no_turns_come_and_goes_when_they_do() {
    let line = line(1e6);
    let mut live = open_live(&line, 1e6, Duration::from_secs(9));
    live.set_standby(Standby { after: Duration::from_millis(300), turn: Pictures::new(999, SLICES, small()) });
    let mut film = Film { every: Duration::from_millis(50), last: None };
    while live.totals().delivered < 3 {
        live.step(&mut film).unwrap();
    }
    let since = live.now();
    while !live.stands_by() {
        assert!(matches!(live.step(&mut Nothing).unwrap(), Step::Idle));
    }
    assert!(live.now() - since >= Duration::from_millis(290), "{:?}", live.now() - since);
    for _ in 0..100 {
        live.step(&mut Nothing).unwrap();
    }
    let last = || line.with(|line| line.endpoint().endpoint().shown.last().unwrap().1.clone());
    assert!(last() == Pictures::new(999, SLICES, small()).planes);
    live.step(&mut film).unwrap();
    assert!(!live.stands_by());
    for _ in 0..50 {
        live.step(&mut Nothing).unwrap();
    }
    assert!(last() != Pictures::new(999, SLICES, small()).planes);
}

#[test]
fn a_device_that_stays_away_is_given_up_and_one_that_comes_back_is_not() {
    let line = line(1e6);
    let mut live = open_live(&line, 1e6, Duration::from_secs(2));
    let mut film = Film { every: Duration::from_millis(50), last: None };
    for (away, is_back) in [(1.0, true), (60.0, false)] {
        line.with(|line| line.endpoint_mut().unplug(away));
        let outcome = loop {
            match live.step(&mut film) {
                Ok(Step::Back) => break Ok(()),
                Ok(_) => {}
                Err(error) => break Err(error),
            }
        };
        assert_eq!(outcome.is_ok(), is_back, "{outcome:?}");
    }
    assert_eq!(live.totals().reconnects, 1);
}

#[test]
fn a_device_that_starts_anew_is_greeted_anew() {
    let line = line(1e6);
    let mut live = open_live(&line, 1e6, Duration::from_secs(9));
    let mut film = Film { every: Duration::from_millis(50), last: None };
    while live.totals().delivered < 3 {
        live.step(&mut film).unwrap();
    }
    // The plug stays, and the device has forgotten the host.
    line.with(|line| line.endpoint_mut().endpoint_mut().device.lose_link());
    while live.totals().delivered < 6 {
        live.step(&mut film).unwrap();
    }
    assert_eq!(live.totals().reconnects, 1);
}
