//! Pictures without a scene, on the projector's own pixels: to align it by, and to prove which plane was lit when.

pub mod block;
pub mod sequence;
pub mod trace;

use crate::render::turn::{Depth, Turn, TurnTooLarge};
use block::Block;
use clap::ValueEnum;
use protocol::rig::Rig;
use sequence::Sequence;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Pattern {
    /// Lines through the middle of the image, a ring and its border
    CrossHairs,
    /// Lines at every twelfth of the image's width
    Grid,
    /// The number of each slice
    Numbers,
    /// For a photodiode and for a camera: which plane is lit
    Markers,
}

/// A turn of `pattern` for `rig`, the same in every slice but for what names the slice.
pub fn draw(rig: &Rig, pattern: Pattern) -> Result<Turn, TurnTooLarge> {
    let (width, height) = (rig.projector.width_px, rig.projector.height_px);
    let mut turn = Turn::dark(rig.rotation.slices, width, height, Depth::Binary)?;
    let sequence = Sequence::new(rig.rotation.slices);
    for slice in 0..rig.rotation.slices {
        let mut sheet = Sheet { bytes: turn.slice_mut(slice), width, height };
        match pattern {
            Pattern::CrossHairs => sheet.cross_hairs(),
            Pattern::Grid => sheet.grid(),
            Pattern::Numbers => sheet.number(slice),
            Pattern::Markers => {
                Block::of(slice).draw(&mut sheet);
                sheet.patch(sequence.is_lit(slice));
            }
        }
    }
    Ok(turn)
}

/// One slice, to be drawn on.
pub(crate) struct Sheet<'a> {
    bytes: &'a mut [u8],
    width: u32,
    height: u32,
}

/// Digits as rows of three pixels, from the top.
const DIGITS: [[u8; 5]; 10] = [
    [0b111, 0b101, 0b101, 0b101, 0b111],
    [0b010, 0b110, 0b010, 0b010, 0b111],
    [0b111, 0b001, 0b111, 0b100, 0b111],
    [0b111, 0b001, 0b111, 0b001, 0b111],
    [0b101, 0b101, 0b111, 0b001, 0b001],
    [0b111, 0b100, 0b111, 0b001, 0b111],
    [0b111, 0b100, 0b111, 0b101, 0b111],
    [0b111, 0b001, 0b001, 0b010, 0b010],
    [0b111, 0b101, 0b111, 0b101, 0b111],
    [0b111, 0b101, 0b111, 0b001, 0b111],
];

impl Sheet<'_> {
    pub(crate) fn width(&self) -> u32 {
        self.width
    }

    /// Lights the pixels of a rectangle that are in the image.
    pub(crate) fn fill(&mut self, [left, top]: [u32; 2], [width, height]: [u32; 2]) {
        let stride = self.width.div_ceil(8) as usize;
        for row in top..(top + height).min(self.height) {
            for column in left..(left + width).min(self.width) {
                self.bytes[row as usize * stride + column as usize / 8] |= 1 << (column % 8);
            }
        }
    }

    /// Lines are as wide as a pixel in 400.
    fn line(&self) -> u32 {
        (self.width.max(self.height) / 400).max(1)
    }

    fn border(&mut self) {
        let (width, height, line) = (self.width, self.height, self.line());
        self.fill([0, 0], [width, line]);
        self.fill([0, height.saturating_sub(line)], [width, line]);
        self.fill([0, 0], [line, height]);
        self.fill([width.saturating_sub(line), 0], [line, height]);
    }

    fn cross_hairs(&mut self) {
        let (width, height, line) = (self.width, self.height, self.line());
        self.border();
        self.fill([0, (height - line.min(height)) / 2], [width, line]);
        self.fill([(width - line.min(width)) / 2, 0], [line, height]);
        // A ring of a quarter of the image: what is round stays round only where pixels are square.
        let radius = f64::from(width.min(height)) / 4.0;
        let middle = [f64::from(width) / 2.0, f64::from(height) / 2.0];
        for (row, column) in (0..height).flat_map(|row| (0..width).map(move |column| (row, column))) {
            let distance = (f64::from(column) + 0.5 - middle[0]).hypot(f64::from(row) + 0.5 - middle[1]);
            if (distance - radius).abs() <= f64::from(line) / 2.0 {
                self.fill([column, row], [1, 1]);
            }
        }
    }

    fn grid(&mut self) {
        let (width, height, line) = (self.width, self.height, self.line());
        self.border();
        let step = (width / 12).max(2);
        (1..=width / step).for_each(|column| self.fill([column * step, 0], [line, height]));
        (1..=height / step).for_each(|row| self.fill([0, row * step], [width, line]));
    }

    /// The number in the middle, half as wide as the image.
    fn number(&mut self, number: u32) {
        let text = format!("{number:03}");
        let cell = (self.width / 2 / (4 * text.len() as u32)).max(1);
        let size = [cell * (4 * text.len() as u32 - 1), cell * 5];
        let corner = [self.width.saturating_sub(size[0]) / 2, self.height.saturating_sub(size[1]) / 2];
        for (place, digit) in (0..).zip(text.bytes()) {
            for (row, bits) in (0..).zip(DIGITS[usize::from(digit - b'0')]) {
                for column in (0..3).filter(|column| bits >> (2 - column) & 1 == 1) {
                    self.fill([corner[0] + cell * (4 * place + column), corner[1] + cell * row], [cell, cell]);
                }
            }
        }
    }

    /// What a photodiode looks at: the lower half of the image, lit or dark as a whole.
    fn patch(&mut self, is_lit: bool) {
        if is_lit {
            let (width, height) = (self.width, self.height);
            self.fill([0, height / 2], [width, height - height / 2]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rigs;

    fn is_lit(turn: &Turn, slice: u32, [column, row]: [u32; 2]) -> bool {
        let stride = turn.width().div_ceil(8) as usize;
        turn.slice(slice)[row as usize * stride + column as usize / 8] >> (column % 8) & 1 == 1
    }

    #[test]
    fn the_middle_is_crossed_and_the_border_whole() {
        let rig = rigs::find("reference").unwrap();
        let turn = draw(&rig, Pattern::CrossHairs).unwrap();
        let [right, bottom] = [turn.width() - 1, turn.height() - 1];
        for pixel in [[0, 0], [right, 0], [0, bottom], [right, bottom], [right / 2, 10], [10, bottom / 2], [192, 383]] {
            assert!(is_lit(&turn, 7, pixel), "{pixel:?}");
        }
        assert!(!is_lit(&turn, 7, [100, 100]));
        assert_eq!(turn.slice(0), turn.slice(287));
    }

    #[test]
    fn a_grid_has_eleven_lines_each_way() {
        let turn = draw(&rigs::find("reference").unwrap(), Pattern::Grid).unwrap();
        let lines = (2..766).filter(|column| is_lit(&turn, 0, [*column, 40]) && !is_lit(&turn, 0, [*column - 1, 40]));
        assert_eq!(lines.count(), 11);
    }

    #[test]
    fn each_slice_has_a_number_of_its_own() {
        let turn = draw(&rigs::find("reference").unwrap(), Pattern::Numbers).unwrap();
        let slices: std::collections::HashSet<_> = (0..288).map(|slice| turn.slice(slice)).collect();
        assert_eq!(slices.len(), 288);
        // The right stroke of the 7 in 287, and nothing where the left one of an 8 would be.
        assert!(
            is_lit(&turn, 287, [384 + 5 * 32 - 16, 384 - 32]) && !is_lit(&turn, 287, [384 + 3 * 32 - 16, 384 - 32])
        );
    }

    #[test]
    fn tiny_images_are_drawn_too() {
        let mut rig = rigs::find("reference").unwrap();
        (rig.projector.width_px, rig.projector.height_px) = (3, 2);
        for pattern in [Pattern::CrossHairs, Pattern::Grid, Pattern::Numbers, Pattern::Markers] {
            assert_eq!(draw(&rig, pattern).unwrap().slices(), 288, "{pattern:?}");
        }
    }
}
