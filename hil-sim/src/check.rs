//! Values from files, checked by one rule.

use thiserror::Error;

/// A value that no file may hold.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{key} = {value}: must be from {} to {}", range.least, range.most)]
pub struct ValueError {
    /// The key, with its tables.
    pub key: String,
    /// What it held.
    pub value: f64,
    /// What is allowed.
    pub range: Range,
}

/// What is allowed, both ends included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// The smallest value.
    pub least: f64,
    /// The largest value.
    pub most: f64,
}

impl Range {
    /// Refuses what lies outside, and what is no number.
    pub fn check(self, key: &str, value: f64) -> Result<(), ValueError> {
        if (self.least..=self.most).contains(&value) {
            Ok(())
        } else {
            Err(ValueError { key: key.to_owned(), value, range: self })
        }
    }
}
