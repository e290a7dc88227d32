//! Any rig, point and slice, by any projection method: a refusal, or an answer that keeps the rule.

#![no_main]

#[path = "../../src/rule.rs"]
mod rule;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    // A rig that is refused is an answer too; the refusal must not panic.
    if let Ok(case) = rule::Case::from_bytes(bytes) {
        case.check().unwrap_or_else(|problem| panic!("{problem}"));
    }
});
