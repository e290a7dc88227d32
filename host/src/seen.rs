//! What an eye sees of a turn: the host's one door to the simulator's forward model.

use crate::picture::Picture;
use crate::render::turn::{Depth, Turn};
use core::f64::consts::PI;
use hil_sim::eye::{self, Flash, Seen};
pub use hil_sim::eye::{Brightness, View};
use protocol::rig::Rig;

/// What `view` sees of `turn` on a mirror in perfect step, each slice taken at `exposures` mirror angles. `done` is called
/// after each of [`View::parts`] parts of the work.
pub fn see(
    rig: &Rig,
    turn: &Turn,
    view: &View,
    exposures: u32,
    brightness: Brightness,
    done: &(dyn Fn() + Sync),
) -> Picture {
    see_turns(rig, &[turn], view, exposures, brightness, done)
}

/// The same of several turns, for an eye that is too slow to tell them apart.
pub fn see_turns(
    rig: &Rig,
    turns: &[&Turn],
    view: &View,
    exposures: u32,
    brightness: Brightness,
    done: &(dyn Fn() + Sync),
) -> Picture {
    let half = PI / f64::from(rig.rotation.slices);
    let slices = turns.iter().flat_map(|turn| (0..rig.rotation.slices).map(move |slice| (turn, slice)));
    let flashes: Vec<_> = slices
        .map(|(turn, slice)| Flash {
            start: rig.slice_angle(slice) - half,
            end: rig.slice_angle(slice) + half,
            picture: match turn.depth() {
                Depth::Binary => eye::Picture::Binary(turn.slice(slice)),
                Depth::Grey => eye::Picture::Grey(turn.slice(slice)),
            },
        })
        .collect();
    picture(eye::expose(rig, &flashes, turns.len() as f64, exposures, view, brightness, done))
}

/// The eye's answer as a picture.
pub fn picture(seen: Seen) -> Picture {
    Picture { width: seen.pixels, height: seen.pixels, colours: seen.colours, known: seen.reached }
}

/// The slices of a turn that reach some ray of `view` at some moment of their exposure.
pub fn reaching(rig: &Rig, view: &View) -> Vec<u32> {
    let half = PI / f64::from(rig.rotation.slices);
    (0..rig.rotation.slices).filter(|slice| reaches(rig, view, *slice, half)).collect()
}

/// How many slices of a turn reach some ray of `view` in the middle of their exposure.
pub fn reaching_slices(rig: &Rig, view: &View) -> usize {
    (0..rig.rotation.slices).filter(|slice| reaches(rig, view, *slice, 0.0)).count()
}

/// Whether light of `slice` reaches some ray of `view` while the mirror is within `half` radians of the slice's angle.
fn reaches(rig: &Rig, view: &View, slice: u32, half: f64) -> bool {
    let angle = rig.slice_angle(slice);
    let flash = Flash { start: angle - half, end: angle + half, picture: eye::Picture::Dark };
    let moments = if half > 0.0 { 4 } else { 1 };
    eye::expose(rig, &[flash], 1.0, moments, view, Brightness::Divided, &|| ()).reached.contains(&true)
}
