//! A line that carries so many bytes a second each way, in simulated time, in front of what takes any number at once.

use crate::device::Endpoint;
use std::collections::VecDeque;

/// What a line carries.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// Bytes a second, each way; above 0.
    pub bytes_per_second: f64,
    /// Bytes that wait at either end of the line at most.
    pub buffer_bytes: usize,
}

impl Pace {
    /// USB 2.0 high speed: 45 MB/s is what a loop of bulk transfers of 1 MiB moved over USB/IP into an emulated machine; a bus's ceiling is 53 MB/s
    /// (USB 2.0, section 5.8.4: 13 packets of 512 bytes in each of 8,000 microframes). Two transfers of 64 KiB wait.
    pub const USB: Self = Self { bytes_per_second: 45e6, buffer_bytes: 128 * 1024 };

    /// A serial line of `baud` bits a second, at least 1: ten bits a byte (a start bit, 8, a stop bit), and the 4 KiB that Linux keeps for a port.
    pub fn serial(baud: u32) -> Self {
        Self { bytes_per_second: f64::from(baud.max(1)) / 10.0, buffer_bytes: 4096 }
    }
}

/// What a line has carried in one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Traffic {
    /// Bytes that arrived.
    pub bytes: u64,
    /// When the first byte left, seconds since the line was laid; `None` before it.
    pub began_s: Option<f64>,
    /// When the last byte arrived.
    pub ended_s: f64,
}

impl Traffic {
    /// Bytes a second from the first byte to the last, with every pause between them; 0 where there was none.
    pub fn bytes_per_second(&self) -> f64 {
        let span_s = self.ended_s - self.began_s.unwrap_or(self.ended_s);
        if span_s > 0.0 { self.bytes as f64 / span_s } else { 0.0 }
    }
}

/// One direction: bytes wait, and leave one after the other.
#[derive(Debug, Default)]
struct Lane {
    waiting: VecDeque<u8>,
    /// The part of the next byte that is through, 0 to 1.
    part: f64,
    traffic: Traffic,
}

impl Lane {
    fn room(&self, pace: Pace) -> usize {
        pace.buffer_bytes.saturating_sub(self.waiting.len())
    }

    /// Lets `seconds` pass from `start_s` on, and hands what comes through in them to `take`, which returns how many bytes it takes.
    fn carry(&mut self, pace: Pace, start_s: f64, seconds: f64, mut take: impl FnMut(&[u8]) -> usize) {
        if self.waiting.is_empty() {
            return;
        }
        let before = self.part;
        let allowed = before + pace.bytes_per_second * seconds;
        let through = (allowed as usize).min(self.waiting.len());
        let taken = take(&self.waiting.make_contiguous()[..through]).min(through);
        self.waiting.drain(..taken);
        // A line that waits for bytes, or for the far end, saves no time for later.
        let is_busy = taken == allowed as usize && !self.waiting.is_empty();
        self.part = if is_busy { allowed.fract() } else { 0.0 };
        self.traffic.bytes += taken as u64;
        self.traffic.began_s.get_or_insert(start_s);
        if taken > 0 {
            self.traffic.ended_s = start_s + (taken as f64 - before) / pace.bytes_per_second;
        }
    }
}

/// An endpoint at the end of a line. It is asked for what it has to say when the line to the host is free, so that its reports do not queue up on
/// a slow one.
#[derive(Debug)]
pub struct Paced<E> {
    endpoint: E,
    pace: Pace,
    to_device: Lane,
    to_host: Lane,
    arrived: Vec<u8>,
    said: Vec<u8>,
    now_s: f64,
}

impl<E: Endpoint> Paced<E> {
    /// At the end of an idle line.
    pub fn new(endpoint: E, pace: Pace) -> Self {
        let (arrived, said) = (Vec::new(), Vec::new());
        Self { endpoint, pace, to_device: Lane::default(), to_host: Lane::default(), arrived, said, now_s: 0.0 }
    }

    /// What is at the end of the line.
    pub fn endpoint(&self) -> &E {
        &self.endpoint
    }

    /// What is at the end of the line.
    pub fn endpoint_mut(&mut self) -> &mut E {
        &mut self.endpoint
    }

    /// What the line carries.
    pub fn pace(&self) -> Pace {
        self.pace
    }

    /// What came to the device and what came from it.
    pub fn traffic(&self) -> [Traffic; 2] {
        [self.to_device.traffic, self.to_host.traffic]
    }

    /// Counts from here on.
    pub fn forget_traffic(&mut self) {
        (self.to_device.traffic, self.to_host.traffic) = (Traffic::default(), Traffic::default());
    }

    /// Asks the device for bytes where the line to the host is free.
    fn listen(&mut self) {
        if self.said.is_empty() && self.to_host.waiting.is_empty() {
            self.said = self.endpoint.transmit();
        }
        let fits = self.said.len().min(self.to_host.room(self.pace));
        self.to_host.waiting.extend(self.said.drain(..fits));
    }
}

impl<E: Endpoint> Endpoint for Paced<E> {
    fn receive(&mut self, bytes: &[u8]) -> usize {
        let fits = bytes.len().min(self.to_device.room(self.pace));
        self.to_device.waiting.extend(&bytes[..fits]);
        fits
    }

    fn transmit(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.arrived)
    }

    fn advance(&mut self, seconds: f64) {
        self.listen();
        let Self { endpoint, pace, to_device, to_host, arrived, now_s, .. } = self;
        endpoint.advance(seconds);
        to_device.carry(*pace, *now_s, seconds, |bytes| endpoint.receive(bytes));
        to_host.carry(*pace, *now_s, seconds, |bytes| {
            arrived.extend_from_slice(bytes);
            bytes.len()
        });
        *now_s += seconds;
    }

    fn lose_link(&mut self) {
        (self.to_device.waiting, self.to_host.waiting) = Default::default();
        self.endpoint.lose_link();
    }

    fn plug(&self) -> Option<u32> {
        self.endpoint.plug()
    }

    fn is_at_rest(&self) -> bool {
        self.endpoint.is_at_rest()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Keeps what it hears and says it back, `room` bytes at once.
    #[derive(Debug)]
    struct Echo {
        heard: Vec<u8>,
        said: usize,
        room: usize,
    }

    impl Echo {
        fn new(room: usize) -> Self {
            Self { heard: Vec::new(), said: 0, room }
        }
    }

    impl Endpoint for Echo {
        fn receive(&mut self, bytes: &[u8]) -> usize {
            let taken = bytes.len().min(self.room);
            self.heard.extend(&bytes[..taken]);
            taken
        }

        fn transmit(&mut self) -> Vec<u8> {
            let said = self.heard[self.said..].to_vec();
            self.said = self.heard.len();
            said
        }

        fn advance(&mut self, _seconds: f64) {}
    }

    fn counted(count: usize) -> Vec<u8> {
        (0..count).map(|at| at as u8).collect()
    }

    #[test]
    fn a_full_line_carries_its_rate() {
        let pace = Pace { bytes_per_second: 1_000.0, buffer_bytes: 100_000 };
        for step_s in [0.000_3, 0.001, 0.25] {
            let mut line = Paced::new(Echo::new(usize::MAX), pace);
            assert_eq!(line.receive(&counted(10_000)), 10_000);
            let steps = (2.0 / step_s) as usize;
            (0..steps).for_each(|_| line.advance(step_s));
            let expected = steps as f64 * step_s * 1_000.0;
            assert!((line.endpoint().heard.len() as f64 - expected).abs() <= 1.0, "{step_s} s");
            let [to_device, _] = line.traffic();
            assert!((to_device.bytes_per_second() - 1_000.0).abs() < 1e-6, "{to_device:?}");
        }
    }

    #[test]
    fn what_does_not_fit_is_left_with_the_sender() {
        let mut line = Paced::new(Echo::new(usize::MAX), Pace { bytes_per_second: 1_000.0, buffer_bytes: 64 });
        assert_eq!((line.receive(&counted(100)), line.receive(&[1])), (64, 0));
        line.advance(0.010);
        assert_eq!(line.endpoint().heard.len(), 10);
        assert_eq!(line.receive(&counted(100)), 10);
    }

    #[test]
    fn an_idle_line_saves_nothing() {
        let mut line = Paced::new(Echo::new(usize::MAX), Pace { bytes_per_second: 1_000.0, buffer_bytes: 4096 });
        line.advance(100.0);
        line.receive(&counted(500));
        line.advance(0.1);
        assert_eq!(line.endpoint().heard.len(), 100);
        // Not the part of a byte either.
        let mut slow = Paced::new(Echo::new(usize::MAX), Pace { bytes_per_second: 1.0, buffer_bytes: 4096 });
        for seconds in [1.9, 0.5] {
            slow.receive(&[7]);
            slow.advance(seconds);
        }
        assert_eq!(slow.endpoint().heard, [7]);
        // 400 bytes and a pause of 0.6 s, then 100: 500 bytes and another 100 in 0.5, 0.6 and 0.1 s.
        line.advance(1.0);
        line.receive(&counted(100));
        line.advance(1.0);
        let [to_device, _] = line.traffic();
        assert_eq!((to_device.bytes, to_device.began_s), (600, Some(100.0)));
        assert!((to_device.ended_s - 101.2).abs() < 1e-9, "{to_device:?}");
        line.forget_traffic();
        assert_eq!(line.traffic(), [Traffic::default(); 2]);
    }

    #[test]
    fn a_device_that_takes_less_holds_the_line_up() {
        let mut line = Paced::new(Echo::new(3), Pace { bytes_per_second: 1_000.0, buffer_bytes: 4096 });
        line.receive(&counted(200));
        (0..10).for_each(|_| line.advance(0.010));
        assert_eq!(line.endpoint().heard, counted(30));
        let [to_device, _] = line.traffic();
        // Three bytes are through 3 ms after the last step began.
        assert!((to_device.bytes_per_second() - 30.0 / 0.093).abs() < 1e-6, "{to_device:?}");
    }

    #[test]
    fn rates_are_those_of_a_start_and_a_stop_bit() {
        assert_eq!(Pace::serial(115_200).bytes_per_second, 11_520.0);
        assert_eq!(Pace::serial(0).bytes_per_second, 0.1);
    }

    /// Says one byte whenever it is asked.
    struct Chatter(usize);

    impl Endpoint for Chatter {
        fn receive(&mut self, bytes: &[u8]) -> usize {
            bytes.len()
        }

        fn transmit(&mut self) -> Vec<u8> {
            self.0 += 1;
            vec![0]
        }

        fn advance(&mut self, _seconds: f64) {}
    }

    #[test]
    fn reports_do_not_queue_up() {
        let mut line = Paced::new(Chatter(0), Pace { bytes_per_second: 10.0, buffer_bytes: 4096 });
        (0..1_000).for_each(|_| line.advance(0.001));
        assert!((9..=11).contains(&line.transmit().len()) && line.endpoint().0 <= 11, "{}", line.endpoint().0);
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn every_byte_comes_back_once_and_in_order(
            rate in 10.0..1e6f64,
            buffer in 1usize..300,
            room in 1usize..300,
            steps in prop::collection::vec((0usize..200, 0.0..0.02f64), 1..200),
        ) {
            let pace = Pace { bytes_per_second: rate, buffer_bytes: buffer };
            let mut line = Paced::new(Echo::new(room), pace);
            let (mut sent, mut back, mut passed_s) = (0usize, Vec::new(), 0.0);
            for (count, seconds) in steps {
                let bytes: Vec<u8> = (sent..sent + count).map(|at| at as u8).collect();
                let taken = line.receive(&bytes);
                prop_assert!(taken <= count);
                sent += taken;
                line.advance(seconds);
                passed_s += seconds;
                back.extend(line.transmit());
                prop_assert!(line.endpoint().heard.len() as f64 <= rate * passed_s + 1.0);
                prop_assert!(sent - line.endpoint().heard.len() <= buffer);
            }
            prop_assert_eq!(&line.endpoint().heard[..], &counted(sent)[..line.endpoint().heard.len()]);
            prop_assert_eq!(&back[..], &counted(sent)[..back.len()]);
            let mut left = 0;
            while back.len() < sent && left < 1_000_000 {
                line.advance(0.5);
                back.extend(line.transmit());
                left += 1;
            }
            prop_assert_eq!(back, counted(sent));
        }
    }
}
