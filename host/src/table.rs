//! Tables that people write: lines of fields between commas. The first names the columns, in any order; what follows a # is a note.

use core::ops::RangeInclusive;
use thiserror::Error;

/// Why a text is no table.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum TableError {
    /// The first line does not name columns.
    #[error("line {line}: {found:?} is no column: must be {allowed}")]
    Column {
        /// The line.
        line: usize,
        /// What stands there.
        found: String,
        /// What may.
        allowed: String,
    },
    /// A column is not there, or twice.
    #[error("column {0} stands {1} times: must stand once")]
    Columns(&'static str, usize),
    /// A field is no number, or no sensible one.
    #[error("{place}: {field} = {found}: must be a number from {} to {}", allowed[0], allowed[1])]
    Number {
        /// The line, or what stands for it in other files.
        place: String,
        /// The column.
        field: &'static str,
        /// What stands there.
        found: String,
        /// The smallest and the largest, as they are said.
        allowed: [String; 2],
    },
    /// Not even a first line.
    #[error("no line that names the columns")]
    Empty,
}

/// A line of fields.
#[derive(Clone, Debug)]
pub struct Row<'a> {
    /// "line 3", counted from 1.
    pub label: String,
    columns: &'static [&'static str],
    fields: Vec<&'a str>,
}

/// The rows of `text`, whose columns are `columns`; those that `needed` names must be there.
pub fn rows<'a>(
    text: &'a str,
    columns: &'static [&'static str],
    needed: &[&'static str],
) -> Result<Vec<Row<'a>>, TableError> {
    let lines = text.lines().enumerate().map(|(index, line)| (index + 1, line.split('#').next().unwrap_or("").trim()));
    let mut lines = lines.filter(|(_, line)| !line.is_empty());
    let (line, head) = lines.next().ok_or(TableError::Empty)?;
    let place = |name: &str| {
        let unknown = || TableError::Column { line, found: clipped(name), allowed: listed(columns) };
        columns.iter().position(|column| *column == name).ok_or_else(unknown)
    };
    let places: Vec<usize> = head.split(',').map(str::trim).map(place).collect::<Result<_, _>>()?;
    for (index, name) in columns.iter().enumerate() {
        let count = places.iter().filter(|place| **place == index).count();
        if count > 1 || (count == 0 && needed.contains(name)) {
            return Err(TableError::Columns(name, count));
        }
    }
    let row = |(line, text): (usize, &'a str)| {
        let mut fields = vec![""; columns.len()];
        places.iter().zip(text.split(',')).for_each(|(place, field)| fields[*place] = field.trim());
        Row { label: format!("line {line}"), columns, fields }
    };
    Ok(lines.map(row).collect())
}

impl<'a> Row<'a> {
    /// What stands in column `name`, which must be one of the table's; nothing where the row or the table has not got it.
    pub fn field(&self, name: &str) -> &'a str {
        let place = self.columns.iter().position(|column| *column == name);
        self.fields[place.expect("a column of the table")]
    }

    /// The number in column `name`.
    pub fn number(&self, name: &'static str, allowed: RangeInclusive<f64>) -> Result<f64, TableError> {
        number(&self.label, name, self.field(name), allowed)
    }
}

/// `found`, which stands in `field` of `place`, as a number.
pub fn number(place: &str, field: &'static str, found: &str, allowed: RangeInclusive<f64>) -> Result<f64, TableError> {
    let value = found.parse().ok().filter(|value| allowed.contains(value));
    value.ok_or_else(|| TableError::Number {
        place: place.into(),
        field,
        found: clipped(found),
        allowed: [allowed.start(), allowed.end()].map(f64::to_string),
    })
}

fn clipped(text: &str) -> String {
    text.chars().take(40).collect()
}

/// "a, b or c".
fn listed(columns: &[&str]) -> String {
    match columns {
        [first @ .., last] if !first.is_empty() => format!("{} or {last}", first.join(", ")),
        _ => columns.concat(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLUMNS: &[&str] = &["a", "b", "c"];

    #[test]
    fn columns_come_in_any_order_and_some_may_be_left_out() {
        let rows = rows("# a note\n c, a # and another\n\n 3 , 1\n7\n", COLUMNS, &["a"]).unwrap();
        let fields: Vec<_> = rows.iter().map(|row| ["a", "b", "c"].map(|name| row.field(name))).collect();
        assert_eq!(fields, [["1", "", "3"], ["", "", "7"]]);
        assert_eq!((&rows[0].label[..], rows[0].number("a", 0.0..=1.0)), ("line 4", Ok(1.0)));
        for (value, words) in
            [("3", "line 4: c = 3: must be a number from 0 to 2.5"), ("x", "must be a number from -1 to 1")]
        {
            let range = if value == "3" { 0.0..=2.5 } else { -1.0..=1.0 };
            let refused = if value == "3" { rows[0].number("c", range) } else { rows[0].number("b", range) };
            assert!(refused.clone().unwrap_err().to_string().contains(words), "{refused:?}");
        }
    }

    #[test]
    fn what_is_no_table_is_refused_by_name() {
        let refused = |text: &str| rows(text, COLUMNS, &["a"]).unwrap_err().to_string();
        assert_eq!(refused("\n"), "no line that names the columns");
        assert_eq!(refused("a,d"), "line 1: \"d\" is no column: must be a, b or c");
        assert_eq!(refused("b,c"), "column a stands 0 times: must stand once");
        assert_eq!(refused("a,c,a"), "column a stands 2 times: must stand once");
    }
}
