//! Rig files that a command changes: keys that it does not know, and comments, stay.

use super::Failure;
use crate::input;
use crate::output::File;
use protocol::rig::{Rig, toml_problem};
use std::fmt::Display;
use std::path::Path;
use toml_edit::{Array, DocumentMut, Item, Table, TableLike, Value};

/// Digits that a file keeps: a nanoradian, a nanometre.
pub(super) fn rounded(value: f64) -> f64 {
    // Plus 0: no minus before a nought.
    (value * 1e9).round() / 1e9 + 0.0
}

/// Rows of numbers, a line each.
pub(super) fn matrix(rows: [[f64; 4]; 3]) -> Value {
    let mut matrix = Array::new();
    for row in rows {
        let mut row = Value::from(Array::from_iter(row.map(rounded)));
        row.decor_mut().set_prefix("\n    ");
        matrix.push_formatted(row);
    }
    matrix.set_trailing("\n");
    matrix.set_trailing_comma(true);
    matrix.into()
}

/// Sets a key of a table; what stood around an old value stays.
pub(super) fn set(table: &mut dyn TableLike, key: &str, mut value: Value) {
    if let Some(Item::Value(old)) = table.get(key) {
        *value.decor_mut() = old.decor().clone();
    }
    table.insert(key, Item::Value(value));
}

/// The table `name`, made where there is none.
pub(super) fn table<'a>(document: &'a mut DocumentMut, name: &str) -> Result<&'a mut dyn TableLike, Failure> {
    let item = document.entry(name).or_insert_with(|| Item::Table(Table::new()));
    item.as_table_like_mut().ok_or_else(|| Failure(format!("{name} must be a table")))
}

/// The rig file `text`, which `whose` names, as `put` changes it.
pub(super) fn changed(
    whose: impl Display,
    text: &str,
    put: impl FnOnce(&mut DocumentMut) -> Result<(), Failure>,
) -> Result<String, Failure> {
    let refused = |error: &dyn Display| Failure(format!("{whose}: {error}"));
    toml::from_str::<toml::Table>(text).map_err(|error| refused(&toml_problem(text, &error)))?;
    let mut document: DocumentMut = text.parse().map_err(|error: toml_edit::TomlError| refused(&error))?;
    put(&mut document).map_err(|Failure(message)| refused(&message))?;
    let text = document.to_string();
    Rig::parse(&text).map_err(|error| refused(&error))?;
    Ok(text)
}

/// Changes the rig file at `path` as `put` says. A link stays one.
pub(super) fn change(path: &Path, put: impl FnOnce(&mut DocumentMut) -> Result<(), Failure>) -> Result<(), Failure> {
    let refused = |error: &dyn Display| Failure(format!("{}: {error}", path.display()));
    let place = path.canonicalize().map_err(|error| refused(&error))?;
    let text = input::read_text(&place).map_err(|error| refused(&error))?;
    let text = changed(path.display(), &text, put)?;
    Ok(File::begin_over(&place)?.finish(text.as_bytes())?)
}
