//! Pictures with words: sheets of labelled tiles, plots with axes, animations.

pub(crate) mod axis;

use crate::picture::{Picture, png, srgb_byte};
use axis::{Axis, axes};
use epaint_default_fonts::HACK_REGULAR;
use image::{DynamicImage, RgbImage};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};
use std::error::Error;
use std::sync::Once;

/// What a drawing library says when it fails; with a drawing in memory, only a programming error makes it.
pub(crate) type Drawing = Result<(), Box<dyn Error>>;

const PAPER: RGBColor = RGBColor(24, 24, 28);
pub(crate) const INK: RGBColor = RGBColor(222, 222, 226);
const FAINT: RGBColor = RGBColor(70, 70, 78);
const TITLE_PX: i32 = 22;

/// A generic family for SVG, and the name of the font inside the program.
const FONT: &str = "monospace";

/// Makes [`FONT`] known to the drawing library.
fn with_font() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // Refused only for bytes that are no font.
        let _ = register_font(FONT, FontStyle::Normal, HACK_REGULAR);
    });
}

/// Text of `size` px in the colour of ink.
pub(crate) fn ink(size: i32) -> TextStyle<'static> {
    (FONT, size).into_font().color(&INK)
}

/// Draws in memory and gives the PNG.
pub(crate) fn draw(
    width: u32,
    height: u32,
    paint: impl FnOnce(&DrawingArea<BitMapBackend<'_>, Shift>) -> Drawing,
) -> Vec<u8> {
    with_font();
    let mut pixels = vec![0; (width * height * 3) as usize];
    {
        let area = BitMapBackend::with_buffer(&mut pixels, (width, height)).into_drawing_area();
        area.fill(&PAPER).map_err(|error| error.to_string()).expect("drawing in memory");
        paint(&area).expect("drawing in memory");
    }
    png(&DynamicImage::from(RgbImage::from_raw(width, height, pixels).expect("as many bytes as pixels")))
}

/// Draws in memory and gives the SVG.
pub(crate) fn draw_svg(
    width: u32,
    height: u32,
    paint: impl FnOnce(&DrawingArea<SVGBackend<'_>, Shift>) -> Drawing,
) -> String {
    with_font();
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, (width, height)).into_drawing_area();
        area.fill(&PAPER).map_err(|error| error.to_string()).expect("drawing in memory");
        paint(&area).expect("drawing in memory");
    }
    text
}

/// A tile of a sheet.
#[derive(Clone, Debug)]
pub struct Tile {
    /// What stands above it.
    pub title: String,
    /// What is shown; unknown pixels stay the colour of the paper.
    pub picture: Picture,
}

/// Tiles of one size in rows of `columns`, as PNG.
pub fn sheet(tiles: &[Tile], columns: usize) -> Vec<u8> {
    let Some(first) = tiles.first() else { return draw(1, 1, |_| Ok(())) };
    const GAP: i32 = 8;
    let (width, height) = (first.picture.width as i32, first.picture.height as i32);
    let (step_x, step_y) = (width + GAP, height + GAP + TITLE_PX);
    let columns = columns.min(tiles.len());
    let rows = tiles.len().div_ceil(columns);
    let size = (step_x * columns as i32 + GAP, step_y * rows as i32 + GAP);
    draw(size.0 as u32, size.1 as u32, |area| {
        let style = ink(13);
        for (index, tile) in tiles.iter().enumerate() {
            let (x, y) = (GAP + (index % columns) as i32 * step_x, GAP + (index / columns) as i32 * step_y);
            area.draw(&Text::new(tile.title.clone(), (x, y), style.clone()))?;
            for (cell, (colour, known)) in tile.picture.colours.iter().zip(&tile.picture.known).enumerate() {
                let [r, g, b] = if *known { colour.map(srgb_byte) } else { [PAPER.0, PAPER.1, PAPER.2] };
                let at = (x + cell as i32 % width, y + TITLE_PX + cell as i32 / width);
                area.draw_pixel(at, &RGBColor(r, g, b))?;
            }
        }
        Ok(())
    })
}

/// A panel of a plot: points (seconds, value) against time.
#[derive(Clone, Debug)]
pub struct Panel<'a> {
    /// What is plotted, with its unit.
    pub title: String,
    /// The unit, on the axis.
    pub unit: &'static str,
    /// The points.
    pub points: &'a [(f64, f64)],
    /// Seconds shown.
    pub seconds: (f64, f64),
    /// Values shown; points beyond are drawn at the border.
    pub values: (f64, f64),
    /// Values at which a line is drawn across.
    pub limits: &'a [f64],
    /// Moments at which a line is drawn down, with their names.
    pub marks: &'a [(f64, String)],
}

/// Panels one below the other, as PNG.
pub fn plot(panels: &[Panel<'_>]) -> Vec<u8> {
    draw(960, 300 * panels.len() as u32, |area| {
        area.split_evenly((panels.len(), 1)).iter().zip(panels).try_for_each(|(area, panel)| plot_panel(area, panel))
    })
}

fn plot_panel(area: &DrawingArea<BitMapBackend<'_>, Shift>, panel: &Panel<'_>) -> Drawing {
    let ((from, to), (low, high)) = (panel.seconds, panel.values);
    let (x, y) = (Axis::over(from..to), Axis::over(low..high));
    let mut chart = axes(area, &panel.title, ("time (s)", x), (panel.unit, y))?;
    for limit in panel.limits {
        let line = [(from, *limit), (to, *limit)];
        chart.draw_series(LineSeries::new(line, RGBColor(230, 120, 90)))?;
    }
    for (row, (at, name)) in panel.marks.iter().filter(|(at, _)| (from..to).contains(at)).enumerate() {
        chart.draw_series(LineSeries::new([(*at, low), (*at, high)], RGBColor(120, 120, 130)))?;
        // Names of moments close together must not lie on each other.
        let height = low + (high - low) * (0.3 - 0.07 * (row % 4) as f64);
        chart.draw_series([Text::new(format!(" {name}"), (*at, height), ink(12))])?;
    }
    let visible = panel.points.iter().filter(|(at, _)| (from..=to).contains(at));
    let points = visible.map(|(at, value)| (*at, value.clamp(low, high)));
    chart.draw_series(LineSeries::new(points, RGBColor(110, 190, 255)))?;
    Ok(())
}

/// Frames of one size as an endless GIF of grey levels (luminance), `centiseconds` each.
pub fn animation(frames: &[Picture], centiseconds: u16) -> Vec<u8> {
    let mut bytes = Vec::new();
    let Some(first) = frames.first() else { return bytes };
    let side = |pixels: u32| u16::try_from(pixels).expect("animations are small");
    let (width, height) = (side(first.width), side(first.height));
    let greys: Vec<u8> = (0..=u8::MAX).flat_map(|level| [level; 3]).collect();
    let mut encoder = gif::Encoder::new(&mut bytes, width, height, &greys).expect("writing into memory");
    encoder.set_repeat(gif::Repeat::Infinite).expect("writing into memory");
    for picture in frames {
        let levels: Vec<u8> = picture.luminance().into_iter().map(srgb_byte).collect();
        let mut frame = gif::Frame::from_indexed_pixels(width, height, levels, None);
        frame.delay = centiseconds;
        encoder.write_frame(&frame).expect("writing into memory");
    }
    drop(encoder);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sheet_holds_its_tiles_and_their_titles() {
        let tile = |value: f32| Tile { title: "slice 7".into(), picture: Picture::grey(90, 30, vec![value; 2700]) };
        let sheet = image::load_from_memory(&sheet(&[tile(1.0), tile(0.0), tile(0.5)], 2)).unwrap().into_luma8();
        assert_eq!(sheet.dimensions(), (98 * 2 + 8, 60 * 2 + 8));
        assert_eq!(sheet.get_pixel(8 + 45, 8 + 22 + 15)[0], 255);
        assert_eq!(sheet.get_pixel(8 + 98 + 45, 8 + 22 + 15)[0], 0);
        let bright =
            (8..80).flat_map(|x| (8..28).map(move |y| (x, y))).filter(|(x, y)| sheet.get_pixel(*x, *y)[0] > 150);
        assert!(bright.count() > 30, "no title");
    }

    #[test]
    fn an_animation_has_its_frames() {
        let frames = [0.0, 0.5, 1.0].map(|value| Picture::grey(4, 4, vec![value; 16]));
        let bytes = animation(&frames, 5);
        let mut decoder = gif::DecodeOptions::new().read_info(bytes.as_slice()).unwrap();
        let mut levels = Vec::new();
        while let Some(frame) = decoder.read_next_frame().unwrap() {
            levels.push(frame.buffer[0]);
        }
        assert_eq!(levels, [0, 188, 255]);
    }
}
