//! A board's figures are those of a motor that is simulated too.

use hil_sim::motor::Motor;
use protocol::units::Nanos;

#[path = "../../firmware/boards/stm32h743/src/rig.rs"]
mod rig;

#[test]
fn the_board_drives_the_reference_motor() {
    // For another machine: its own file beside the reference's, by which `praxi sim` and `praxi tune` try it before the board does.
    let rotation = rig::rotation().unwrap();
    assert_eq!(rig::config(rotation), Motor::reference().firmware_config(&rotation, Nanos::ZERO));
}
