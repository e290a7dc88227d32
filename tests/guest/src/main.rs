//! The first program of a virtual machine: its kernel attaches simulated controllers as USB devices, and this program uses them as any
//! host does. It prints what `cargo test` prints, a last line `N passed, N failed`, and switches the machine off.

mod bare;
mod cable;
mod controller;
mod flash;
mod link;
mod machine;
mod stream;

use std::panic::catch_unwind;
use std::time::Instant;

const CHECKS: [(&str, fn()); 8] = [
    ("bare::errors_arrive", bare::errors_arrive),
    ("link::is_as_fast_as_a_bare_loop", link::is_as_fast_as_a_bare_loop),
    ("link::finds_one_of_two", link::finds_one_of_two),
    ("stream::turns_arrive_whole", stream::turns_arrive_whole),
    ("stream::a_bad_port_only_delays", stream::a_bad_port_only_delays),
    ("stream::goes_on_after_the_plug_was_pulled", stream::goes_on_after_the_plug_was_pulled),
    ("flash::a_blank_board_waits", flash::a_blank_board_waits),
    ("flash::images_run", flash::images_run),
];

fn main() {
    if let Err(error) = machine::set_up() {
        println!("the machine does not start: {error}");
    } else {
        run();
    }
    if let Err(error) = machine::power_off() {
        println!("the machine does not stop: {error}");
    }
}

fn run() {
    let mut passed = 0;
    for (name, check) in CHECKS {
        let start = Instant::now();
        let is_good = catch_unwind(check).is_ok();
        passed += usize::from(is_good);
        println!("test {name} ... {} ({:.1} s)", if is_good { "ok" } else { "FAILED" }, start.elapsed().as_secs_f64());
    }
    println!("{passed} passed, {} failed", CHECKS.len() - passed);
}
