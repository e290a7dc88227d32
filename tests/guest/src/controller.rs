//! What is plugged in.

use hil_sim::device::Endpoint;
use hil_sim::dfu::{Controller, Owner};
use hil_sim::usb::board::Board;
use protocol::image;

/// Swallows what comes and says nothing.
pub struct Sink;

impl Endpoint for Sink {
    fn receive(&mut self, bytes: &[u8]) -> usize {
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
    Board::new(endpoint, Controller::new(Owner { board, key: [0; 32] }), serial).expect("a flash that works")
}
