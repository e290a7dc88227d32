//! A bus of which a test decides when a transfer ends, and how.

use super::*;
use proptest::prelude::*;
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::rc::Rc;

const OUT: Size = Size { endpoint: 0x01, transfers: 3, bytes: 8 };
const IN: Size = Size { endpoint: 0x82, transfers: 2, bytes: 4 };

#[derive(Clone, Default)]
struct FakeBus(Rc<Wire>);

#[derive(Default)]
struct Wire {
    /// In flight, by direction, the oldest first.
    outward: RefCell<VecDeque<Flight>>,
    inward: RefCell<VecDeque<Flight>>,
    /// What happens at the next events: one each.
    script: RefCell<VecDeque<Event>>,
    sent: RefCell<Vec<Vec<u8>>>,
    halts_cleared: RefCell<Vec<u8>>,
    freed_in_flight: Cell<usize>,
    cancelled: Cell<usize>,
    is_deaf: Cell<bool>,
}

enum Event {
    Sent(Result<(), Error>),
    Came(Result<&'static [u8], Error>),
}

#[derive(Clone)]
struct Flight {
    buffer: Rc<RefCell<Vec<u8>>>,
    outcome: Rc<Cell<Option<Result<usize, Error>>>>,
    length: usize,
}

struct FakeTransfer {
    bus: FakeBus,
    endpoint: u8,
    /// The caller's own, copied where it is submitted and where it is ended.
    bytes: Vec<u8>,
    flight: Option<Flight>,
    is_fetched: bool,
}

impl FakeTransfer {
    fn queue(&self) -> &RefCell<VecDeque<Flight>> {
        if self.endpoint == OUT.endpoint { &self.bus.0.outward } else { &self.bus.0.inward }
    }
}

impl Transfer for FakeTransfer {
    fn buffer(&mut self) -> &mut [u8] {
        if let Some(flight) = &self.flight
            && !self.is_fetched
        {
            assert!(flight.outcome.get().is_some(), "the buffer of a transfer in flight");
            self.bytes.copy_from_slice(&flight.buffer.borrow());
            self.is_fetched = true;
        }
        &mut self.bytes
    }

    fn submit(&mut self, length: usize) -> Result<(), Error> {
        assert!(self.flight.is_none() || self.outcome().is_some(), "submitted twice");
        if self.bus.0.is_deaf.get() {
            return Err(Error::NoDevice);
        }
        let buffer = Rc::new(RefCell::new(self.bytes.clone()));
        let flight = Flight { buffer, outcome: Rc::default(), length };
        self.queue().borrow_mut().push_back(flight.clone());
        (self.flight, self.is_fetched) = (Some(flight), false);
        Ok(())
    }

    fn outcome(&self) -> Option<Result<usize, Error>> {
        self.flight.as_ref()?.outcome.get()
    }

    fn cancel(&mut self) {
        self.bus.0.cancelled.set(self.bus.0.cancelled.get() + 1);
        let Some(flight) = &self.flight else { return };
        if !self.bus.0.is_deaf.get() {
            flight.outcome.set(Some(Err(Error::Interrupted)));
            self.queue().borrow_mut().retain(|other| !Rc::ptr_eq(&other.outcome, &flight.outcome));
        }
    }
}

impl Drop for FakeTransfer {
    fn drop(&mut self) {
        let in_flight = self.flight.is_some() && self.outcome().is_none();
        self.bus.0.freed_in_flight.set(self.bus.0.freed_in_flight.get() + usize::from(in_flight));
    }
}

impl Bus for FakeBus {
    type Transfer = FakeTransfer;

    fn transfer(&self, endpoint: u8, bytes: usize) -> Result<FakeTransfer, Error> {
        let bytes = vec![0; bytes];
        Ok(FakeTransfer { bus: self.clone(), endpoint, bytes, flight: None, is_fetched: true })
    }

    fn handle_events(&self, _: Duration) -> Result<(), Error> {
        match self.0.script.borrow_mut().pop_front() {
            Some(Event::Sent(result)) => {
                if let Some(flight) = self.0.outward.borrow_mut().pop_front() {
                    let bytes = flight.buffer.borrow()[..flight.length].to_vec();
                    flight.outcome.set(Some(result.map(|()| bytes.len())));
                    self.0.sent.borrow_mut().push(bytes);
                }
            }
            Some(Event::Came(result)) => {
                let flight = self.0.inward.borrow_mut().pop_front().expect("somebody listens");
                flight.outcome.set(Some(result.map(|bytes| {
                    flight.buffer.borrow_mut()[..bytes.len()].copy_from_slice(bytes);
                    bytes.len()
                })));
            }
            // A deaf device ends nothing: as after a long wait.
            None if self.0.is_deaf.get() => return Err(Error::Io),
            None => {}
        }
        Ok(())
    }

    fn clear_halt(&self, endpoint: u8) -> Result<(), Error> {
        self.0.halts_cleared.borrow_mut().push(endpoint);
        Ok(())
    }
}

impl FakeBus {
    fn then(&self, event: Event) {
        self.0.script.borrow_mut().push_back(event);
    }
}

fn bulk() -> (FakeBus, Bulk<FakeBus>) {
    let bus = FakeBus::default();
    (bus.clone(), Bulk::new(bus, OUT, IN).unwrap())
}

fn received(bulk: &mut Bulk<FakeBus>) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    bulk.receive(&mut bytes, Duration::ZERO).map(|_| bytes)
}

#[test]
fn small_pieces_leave_at_once_while_the_wire_is_idle_and_gather_while_it_is_not() {
    let (bus, mut bulk) = bulk();
    for byte in 0..6 {
        assert_eq!(bulk.send(&[byte]), Ok(1));
    }
    let lengths = || bus.0.outward.borrow().iter().map(|flight| flight.length).collect::<Vec<_>>();
    assert_eq!(lengths(), [1, 1]);
    // A look at what has come is no reason to send what has gathered; one transfer fewer in flight is, and so is waiting.
    assert_eq!(received(&mut bulk), Ok(vec![]));
    assert_eq!(lengths(), [1, 1]);
    bus.then(Event::Sent(Ok(())));
    assert_eq!(received(&mut bulk), Ok(vec![]));
    assert_eq!(lengths(), [1, 4]);
    assert_eq!(bulk.send(&[9]), Ok(1));
    assert_eq!(lengths(), [1, 4]);
    bulk.receive(&mut Vec::new(), Duration::from_nanos(1)).unwrap();
    assert_eq!(lengths(), [1, 4, 1]);
}

#[test]
fn a_full_link_takes_nothing_and_says_so_until_a_transfer_has_ended() {
    let (bus, mut bulk) = bulk();
    assert_eq!(bulk.send(&[7; 30]), Ok(24));
    assert_eq!(bulk.send(&[7; 30]), Ok(0));
    bus.then(Event::Sent(Ok(())));
    // Returns before its time: there is room.
    assert_eq!(bulk.receive(&mut Vec::new(), Duration::MAX), Ok(0));
    assert_eq!(bulk.send(&[7; 30]), Ok(8));
}

#[test]
fn what_comes_is_given_in_order_and_listened_for_again() {
    let (bus, mut bulk) = bulk();
    for bytes in [&[1, 2, 3, 4][..], &[5], &[], &[6, 7]] {
        bus.then(Event::Came(Ok(bytes)));
    }
    let mut all = Vec::new();
    while bulk.receive(&mut all, Duration::from_secs(1)).unwrap() > 0 && all.len() < 7 {}
    assert_eq!(all, [1, 2, 3, 4, 5, 6, 7]);
    assert_eq!(bus.0.inward.borrow().len(), IN.transfers);
}

#[test]
fn a_stall_is_told_once_and_ended() {
    let (bus, mut bulk) = bulk();
    assert_eq!(bulk.send(&[1; 24]), Ok(24));
    bus.then(Event::Sent(Err(Error::Pipe)));
    assert_eq!(bulk.send(&[2; 8]), Err(Error::Pipe));
    assert_eq!((bus.0.cancelled.get(), &bus.0.halts_cleared.borrow()[..]), (2, &[OUT.endpoint][..]));
    assert_eq!(bulk.send(&[3; 24]), Ok(24));
    assert_eq!(received(&mut bulk), Ok(vec![]));
    bus.then(Event::Came(Err(Error::Pipe)));
    assert_eq!(received(&mut bulk), Err(Error::Pipe));
    assert_eq!(&bus.0.halts_cleared.borrow()[..], &[OUT.endpoint, IN.endpoint]);
    bus.then(Event::Came(Ok(&[9])));
    assert_eq!(received(&mut bulk), Ok(vec![9]));
}

#[test]
fn what_came_before_an_error_is_given_first() {
    let (bus, mut bulk) = bulk();
    assert_eq!(received(&mut bulk), Ok(vec![]));
    bus.then(Event::Came(Ok(&[1, 2])));
    bus.then(Event::Came(Err(Error::Overflow)));
    assert_eq!((bulk.send(&[]), bulk.send(&[])), (Ok(0), Ok(0)));
    assert_eq!(received(&mut bulk), Ok(vec![1, 2]));
    assert_eq!(received(&mut bulk), Err(Error::Overflow));
}

#[test]
fn a_device_that_is_gone_is_told_and_its_transfers_are_not_waited_for_for_ever() {
    let (bus, mut bulk) = bulk();
    assert_eq!(bulk.send(&[1; 24]), Ok(24));
    bus.then(Event::Sent(Err(Error::NoDevice)));
    bus.0.is_deaf.set(true);
    assert_eq!(bulk.send(&[1]), Err(Error::NoDevice));
    assert_eq!(received(&mut bulk), Err(Error::NoDevice));
    drop(bulk);
    // What libusb would still have; the transfer leaks its own memory then.
    assert_eq!(bus.0.freed_in_flight.get(), 2);
}

#[test]
fn nothing_is_in_flight_after_the_end() {
    let (bus, mut bulk) = bulk();
    assert_eq!(bulk.send(&[1; 30]), Ok(24));
    assert_eq!(received(&mut bulk), Ok(vec![]));
    drop(bulk);
    assert_eq!((bus.0.cancelled.get(), bus.0.freed_in_flight.get()), (OUT.transfers + IN.transfers, 0));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// However the pieces are cut and whenever transfers end, what leaves is what was taken.
    #[test]
    fn bytes_leave_whole_and_in_order(steps in prop::collection::vec((0usize..20, any::<bool>(), any::<bool>()), 1..60)) {
        let (bus, mut bulk) = bulk();
        let mut next = 0u8;
        let mut taken = Vec::new();
        for (length, ends, listens) in steps {
            if ends {
                bus.then(Event::Sent(Ok(())));
            }
            let piece: Vec<u8> = (0..length).map(|at| next.wrapping_add(at as u8)).collect();
            let count = bulk.send(&piece).unwrap();
            taken.extend_from_slice(&piece[..count]);
            next = next.wrapping_add(count as u8);
            if listens {
                received(&mut bulk).unwrap();
            }
            prop_assert!(bus.0.outward.borrow().len() <= OUT.transfers);
        }
        bulk.receive(&mut Vec::new(), Duration::from_nanos(1)).unwrap();
        let mut left = bus.0.sent.borrow().concat();
        for flight in bus.0.outward.borrow().iter() {
            left.extend_from_slice(&flight.buffer.borrow()[..flight.length]);
        }
        prop_assert_eq!(left, taken);
    }
}
