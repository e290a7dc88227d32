//! Images made here go into the simulated controller, through everything that may go wrong with a block.

use super::*;
use hil_sim::dfu::{Accept, BLOCK_BYTES, Controller, Fault, Owner, Port, UsbError};

const SECRET: [u8; 32] = [9; 32];

struct Bench(Controller);

impl Device for Bench {
    type Error = UsbError;
    type Io = Port;

    fn running(&mut self) -> Result<Option<Identity>, FlashError> {
        self.open(false)?;
        Ok(self.0.identity())
    }

    fn open(&mut self, takes_any: bool) -> Result<Port, FlashError> {
        let accept = if takes_any { Accept::Any } else { Accept::Newer };
        self.0.open(accept).map_err(|error| FlashError::Device(error.to_string()))
    }
}

fn controller() -> Bench {
    Bench(Controller::new(Owner { board: Board::new("bench").unwrap(), key: public(&SECRET) }))
}

fn image(secret: &[u8; 32], board: &str, version: &str) -> Vec<u8> {
    let code = (0..5000).map(|at| at as u8).collect();
    sign(secret, Board::new(board).unwrap(), version.parse().unwrap(), code).unwrap()
}

fn good(version: &str) -> Vec<u8> {
    image(&SECRET, "bench", version)
}

fn put(device: &mut Bench, image: &[u8], force: bool) -> Result<String, String> {
    let outcome = flash(device, image, force, |_| {});
    outcome.map(|header| header.version.to_string()).map_err(|error| error.to_string())
}

#[test]
fn newer_images_run_and_older_ones_with_force() {
    let mut device = controller();
    assert_eq!(put(&mut device, &good("1.2.0"), false), Ok("1.2.0".into()));
    assert_eq!(put(&mut device, &good("1.10.0"), false), Ok("1.10.0".into()));
    let refusal = put(&mut device, &good("1.9.9"), false).unwrap_err();
    assert!(refusal.contains("1.9.9 is not newer than 1.10.0") && refusal.contains("--force"), "{refusal}");
    assert_eq!(put(&mut device, &good("1.9.9"), true), Ok("1.9.9".into()));
}

#[test]
fn images_of_others_are_refused() {
    let mut device = controller();
    let blank = put(&mut device, &image(&SECRET, "other", "1.0.0"), false).unwrap_err();
    assert!(blank.contains("for another board"), "{blank}");
    put(&mut device, &good("1.0.0"), false).unwrap();
    let board = put(&mut device, &image(&SECRET, "other", "2.0.0"), true).unwrap_err();
    assert!(board.contains("for the board other") && board.contains("bench"), "{board}");
    let stranger = put(&mut device, &image(&[1; 32], "bench", "2.0.0"), true).unwrap_err();
    assert!(stranger.contains("verification"), "{stranger}");
    assert_eq!(device.running().unwrap().unwrap().version.to_string(), "1.0.0");
}

#[test]
fn an_image_that_fails_its_test_goes_away() {
    let mut device = controller();
    put(&mut device, &good("1.0.0"), false).unwrap();
    device.0.set_test(false);
    let error = put(&mut device, &good("2.0.0"), false).unwrap_err();
    assert!(error.contains("runs bench 1.0.0+") && error.contains("again"), "{error}");
    // Of the same version, too.
    let other = sign(&SECRET, Board::new("bench").unwrap(), "1.0.0".parse().unwrap(), vec![7; 5000]).unwrap();
    let error = put(&mut device, &other, true).unwrap_err();
    assert!(error.contains("runs bench 1.0.0+") && error.contains("again"), "{error}");
}

/// Every block, the empty one at the end too, in every way.
#[test]
fn a_disturbed_block_is_sent_again() {
    let whole = good("2.0.0");
    for fault in [Fault::Stall, Fault::WrongNumber, Fault::FlippedBit, Fault::PowerCut] {
        for block in 0..=whole.len().div_ceil(usize::from(BLOCK_BYTES)) as u32 {
            let mut device = controller();
            put(&mut device, &good("1.0.0"), false).unwrap();
            device.0.break_at(block, fault);
            let outcome = put(&mut device, &whole, false);
            // A header that arrives changed looks like no image, which is final; the old one still runs.
            if (fault, block) == (Fault::FlippedBit, 0) {
                assert!(outcome.unwrap_err().contains("refuses"), "{fault:?}");
                assert_eq!(device.running().unwrap().unwrap().version.to_string(), "1.0.0");
            } else {
                assert_eq!(outcome, Ok("2.0.0".into()), "{fault:?} at block {block}");
            }
        }
    }
}

#[test]
fn what_was_changed_is_not_verified() {
    let whole = good("1.0.0");
    assert!(verify(&public(&SECRET), &whole).is_ok());
    assert!(verify(&public(&[1; 32]), &whole).is_err());
    for at in (0..whole.len()).step_by(97) {
        let mut changed = whole.clone();
        changed[at] ^= 0x10;
        assert!(verify(&public(&SECRET), &changed).is_err(), "byte {at}");
    }
}

#[test]
fn a_device_that_is_not_there_is_named() {
    let mut nobody = usb::Usb::new("ffff:fffe".parse().unwrap());
    let error = flash(&mut nobody, &good("1.0.0"), false, |_| {}).unwrap_err().to_string();
    assert!(error.starts_with("no device usb:ffff:fffe: "), "{error}");
}

#[test]
fn keys_are_hexadecimal() {
    assert_eq!(from_hex(&to_hex(&SECRET)), Some(SECRET));
    for text in ["", "zz", &"0".repeat(63), &"0".repeat(65), &"0".repeat(66)] {
        assert_eq!(from_hex(text), None, "{text}");
    }
}
