//! What the demo shows: pictures of what eyes saw, of the slices, of the lock.

use super::show::Show;
use crate::commands::Failure;
use crate::commands::args::progress;
use crate::measure::{Likeness, compare};
use crate::output::Folder;
use crate::picture::Picture;
use crate::render::truth::{Caster, Pinhole};
use crate::render::turn::Turn;
use crate::scene::{ShadedScene, luminance};
use crate::seen::{self, Brightness, View};
use crate::sheet::{Panel, Tile, animation, plot, sheet};
use crate::volume::display_radius_m;
use core::f64::consts::TAU;
use glam::DVec3;
use hil_sim::eye::{Flash, expose};
use protocol::message::State;
use protocol::rig::{Rig, Viewers};
use serde::Serialize;

/// The files.
pub(super) const NAMES: [&str; 4] = ["eyes.png", "orbit.gif", "slices.png", "lock.png"];
const ORBIT_FRAMES: u32 = 60;

/// Where eyes stand around a rig.
pub(super) struct Places {
    viewers: Viewers,
    window_m: f64,
}

/// A picture seen from one place.
#[derive(Serialize)]
pub(super) struct Seen {
    /// Of the eye, from the front of the display toward its right.
    pub azimuth_deg: f64,
    from_m: [f64; 3],
    /// Against the pinhole render.
    #[serde(flatten)]
    pub likeness: Likeness,
}

impl Places {
    pub(super) fn new(rig: &Rig) -> Self {
        // 130 mm on the reference rig, as in the measure.
        Self { viewers: rig.viewers(), window_m: (display_radius_m(rig) * 1875.0).round() / 1000.0 }
    }

    fn view(&self, azimuth: f64, pixels: u32, rays: u32) -> View {
        // As good as infinity for what an eye can tell, near enough for the picture to have digits.
        let from = self.viewers.place(azimuth, 100.0);
        View { from, look_at: DVec3::ZERO, window_m: self.window_m, pixels, rays }
    }
}

/// Writes all pictures; gives how alike eye and pinhole are.
pub(super) fn write(
    folder: &Folder,
    rig: &Rig,
    scene: &ShadedScene,
    show: &Show,
    turn: &Turn,
    places: &Places,
) -> Result<Vec<Seen>, Failure> {
    let flashes = show.flashes();
    let (tiles, seen) = eyes(rig, scene, &flashes, places)?;
    folder.write(NAMES[0], &sheet(&tiles, tiles.len() / 2))?;
    folder.write(NAMES[1], &orbit(rig, &flashes, places))?;
    folder.write(NAMES[2], &slices(rig, turn))?;
    folder.write(NAMES[3], &lock(rig, show))?;
    Ok(seen)
}

/// What makes white of white: the light of several faces adds, each through its filter.
fn white_gain(rig: &Rig) -> f32 {
    let of_face = |face| luminance(DVec3::from_array(rig.filter_colour(face)).as_vec3());
    1.0 / (0..rig.mirror.face.len()).map(of_face).sum::<f32>()
}

/// A row of what the eye sees above a row of what a pinhole sees, from three places; by the measure.
fn eyes(
    rig: &Rig,
    scene: &ShadedScene,
    flashes: &[Flash<'_>],
    places: &Places,
) -> Result<(Vec<Tile>, Vec<Seen>), Failure> {
    let (caster, gain) = (Caster::new(scene), white_gain(rig));
    let (mut above, mut below, mut all) = (Vec::new(), Vec::new(), Vec::new());
    let bar = progress("looking", 3);
    for third in 0..3 {
        // 0.01 m aside at 0.9 m, as in the measure: an eye does not stand where a slice was rendered for.
        let azimuth = f64::from(third) * TAU / 3.0 + 0.01 / 0.9;
        let view = places.view(azimuth, 256, 4);
        let picture = seen::picture(expose(rig, flashes, 1.0, 4, &view, Brightness::Divided, &|| ())).exposed(gain);
        let View { from, look_at, window_m, pixels, rays } = view;
        let truth = caster.picture(&Pinhole { from, look_at, window_m, pixels, rays }, &|| ());
        let likeness = compare(&picture, &truth)?;
        let azimuth_deg = azimuth.to_degrees();
        above.push(Tile { title: format!("eye at {azimuth_deg:.0}°, {:.1} dB", likeness.psnr_db), picture });
        below.push(Tile { title: format!("pinhole at {azimuth_deg:.0}°"), picture: truth });
        all.push(Seen { azimuth_deg, from_m: from.to_array(), likeness });
        bar.inc(1);
    }
    bar.finish_and_clear();
    above.append(&mut below);
    Ok((above, all))
}

fn orbit(rig: &Rig, flashes: &[Flash<'_>], places: &Places) -> Vec<u8> {
    let gain = white_gain(rig);
    let bar = progress("walking around", ORBIT_FRAMES.into());
    let frames: Vec<Picture> = (0..ORBIT_FRAMES)
        .map(|frame| {
            let view = places.view(TAU * f64::from(frame) / f64::from(ORBIT_FRAMES), 256, 2);
            let picture = seen::picture(expose(rig, flashes, 1.0, 2, &view, Brightness::Divided, &|| ())).exposed(gain);
            bar.inc(1);
            picture
        })
        .collect();
    bar.finish_and_clear();
    animation(&frames, 8)
}

/// Every so many slices, 24 in all, small.
fn slices(rig: &Rig, turn: &Turn) -> Vec<u8> {
    let step = (turn.slices() / 24).max(1);
    let tile = |slice: u32| Tile {
        title: format!("slice {slice}, {:.0}°", rig.slice_angle(slice).to_degrees()),
        picture: reduced(turn, slice, 128),
    };
    sheet(&(0..24).map(|index| tile(index * step)).collect::<Vec<_>>(), 6)
}

/// A binary slice at `side` pixels' width or height, whichever is larger: means of boxes.
fn reduced(turn: &Turn, slice: u32, side: u32) -> Picture {
    let box_px = turn.width().max(turn.height()).div_ceil(side);
    let (width, height) = (turn.width().div_ceil(box_px), turn.height().div_ceil(box_px));
    let stride = turn.slice_bytes() / turn.height() as usize;
    let bytes = turn.slice(slice);
    let lit = |x: u32, y: u32| bytes[y as usize * stride + x as usize / 8] >> (x % 8) & 1;
    let mean = |cell: u32| {
        let (left, top) = (cell % width * box_px, cell / width * box_px);
        let (right, bottom) = ((left + box_px).min(turn.width()), (top + box_px).min(turn.height()));
        let sum: u32 = (top..bottom).map(|y| (left..right).map(|x| u32::from(lit(x, y))).sum::<u32>()).sum();
        sum as f32 / ((right - left) * (bottom - top)) as f32
    };
    Picture::grey(width, height, (0..width * height).map(mean).collect())
}

/// Speed, then phase error, then the same while locked, enlarged.
fn lock(rig: &Rig, show: &Show) -> Vec<u8> {
    let (speeds, errors) = (show.speeds(), show.phase_errors());
    let end = speeds.last().map_or(1.0, |(at, _)| *at).max(1e-3);
    let near = errors.first().map_or(0.0, |(at, _)| *at).min(end * 0.99);
    let states = show.statistics.states.iter().filter(|(_, state)| *state != State::Idle);
    let marks: Vec<_> = states.map(|(at, state)| (*at, format!("{state:?}"))).collect();
    let locked = show.statistics.states.iter().find(|(_, state)| *state == State::Locked);
    let locked = locked.map_or(near, |(at, _)| *at).min(end * 0.99);
    let pulled_in = (locked + 2.0 * (locked - near)).clamp(near + 0.02, end.max(near + 0.02));
    let peak = (show.statistics.peak_slices * 1.2).max(0.005);
    let panel = |title: &str, unit, points, seconds, values, limits| Panel {
        title: title.to_string(),
        unit,
        points,
        seconds,
        values,
        limits,
        marks: &marks,
    };
    let speed = rig.turns_per_second();
    plot(&[
        panel(
            "Mirror speed (red: what the projector asks for)",
            "turns/s",
            &speeds,
            (0.0, end),
            (0.0, speed * 1.1),
            &[speed][..],
        ),
        panel(
            "Phase error, pulling in (red: half a slice, beyond which nothing may be lit)",
            "slices",
            &errors,
            (near, pulled_in),
            (-1.0, 1.0),
            &[-0.5, 0.5][..],
        ),
        panel("Phase error while locked", "slices", &errors, (locked, end), (-peak, peak), &[][..]),
    ])
}
