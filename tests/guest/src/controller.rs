//! What is plugged in.

use hil_sim::device::Endpoint;
use hil_sim::dfu::{Controller, Owner};
use hil_sim::usb::board::Board;
use protocol::image;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Swallows what comes, counts it, and says nothing.
#[derive(Default)]
pub struct Sink(pub Arc<AtomicUsize>);

impl Endpoint for Sink {
    fn receive(&mut self, bytes: &[u8]) -> usize {
        self.0.fetch_add(bytes.len(), Ordering::Relaxed);
        bytes.len()
    }

    fn transmit(&mut self) -> Vec<u8> {
        Vec::new()
    }

    fn advance(&mut self, _seconds: f64) {}
}

/// A board with that application, of nobody's.
pub fn board<E: Endpoint>(endpoint: E, serial: &str) -> Board<E> {
    let board = image::Board::new("guest").expect("a short name");
    board_of(Owner { board, key: [0; 32] }, endpoint, serial)
}

/// The same of that owner's.
pub fn board_of<E: Endpoint>(owner: Owner, endpoint: E, serial: &str) -> Board<E> {
    Board::new(endpoint, Controller::new(owner), serial).expect("a flash that works")
}
