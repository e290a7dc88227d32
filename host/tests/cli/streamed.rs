//! `praxi stream` and `praxi order`.

use crate::desk::Desk;
use serde_json::Value;

#[test]
fn turns_are_streamed_and_every_one_is_accounted_for() {
    let desk = Desk::new();
    let run = desk.run("stream boxes --device sim --rig small.toml --animate spin --turns 30 --json");
    let text = String::from_utf8(run.stdout).unwrap();
    assert_eq!(run.status.code(), Some(0), "{text}");
    let end: Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
    let number = |name: &str| end[name].as_u64().unwrap();
    let dropped = |name: &str| end["dropped"][name].as_u64().unwrap();
    assert_eq!((end["end"].as_bool(), number("turns")), (Some(true), 30), "{end}");
    let before = dropped("replaced") + dropped("late") + dropped("failed");
    assert_eq!(dropped("all"), before + dropped("passed_over"));
    // One may be on its way, and one may lie there, when there are enough.
    assert!((30..=32).contains(&(number("turns_rendered") - before)), "{end}");
    assert_eq!(number("turns_shown") + dropped("passed_over"), 30, "{end}");
    assert!(number("bytes_raw") > number("bytes_on_wire"), "{end}");
    assert!(end["phase_error_slices"].as_f64().unwrap().abs() < 1.0, "{end}");
}

#[test]
fn a_picture_that_stands_still_is_rendered_and_sent_once() {
    let desk = Desk::new();
    let run = desk.run("stream boxes --device sim --rig small.toml --turns 12 --at-end stop --standby attract");
    let text = String::from_utf8(run.stdout).unwrap();
    assert_eq!(run.status.code(), Some(0), "{text}");
    assert!(text.contains("planes stayed") && text.contains("turns    12 sent"), "{text}");
    assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
    let order = desk.run("order stop --device sim");
    assert_eq!(String::from_utf8(order.stdout).unwrap(), "sim: idle\n");
}

#[test]
fn what_cannot_be_streamed_is_refused_in_one_line() {
    let desk = Desk::new();
    desk.refuses("stream boxes --device usb:ffff:fffe", &["usb:ffff:fffe"]);
    desk.refuses("stream boxes --device /dev/tty-of-nobody", &["/dev/tty-of-nobody"]);
    desk.refuses("stream boxes --device lpt1", &["lpt1", "allowed"]);
    desk.refuses("stream nowhere.glb --device sim", &["nowhere.glb"]);
    desk.refuses("stream boxes --device sim --animate clip", &["boxes", "no clip", "it has none"]);
    desk.refuses("stream boxes --device sim --turns 0", &["--turns"]);
    desk.refuses("stream boxes --device sim --halftone grey", &["grey"]);
    desk.refuses("stream --device sim", &["SCENE"]);
    desk.refuses("order shift-phase --device sim --degrees 200", &["180"]);
    desk.refuses("order shift-phase --device sim", &["--degrees"]);
    desk.refuses("stream boxes --device sim --clip Walk", &["--animate"]);
}
