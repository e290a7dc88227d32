//! Fit for Miri, which sees what is out of bounds, not initialised or not aligned.

mod blocks;
mod pictures;
mod places;

use super::*;
use proptest::test_runner::Config;

/// The instructions that this machine has. Miri's has those that the compiler was told of.
fn levels() -> impl Iterator<Item = Level> {
    Level::ALL.into_iter().filter(|level| level.is_available())
}

/// Few cases for an interpreter, which has no folder to keep them in either.
fn config() -> Config {
    match cfg!(miri) {
        true => Config { cases: 2, failure_persistence: None, ..Config::default() },
        false => Config::default(),
    }
}
