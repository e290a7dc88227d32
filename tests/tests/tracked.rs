//! Viewers who are tracked: each sees the scene from where they stand, as well as if the display were theirs alone.

use glam::DVec3;
use host::render::live::slices_seen_by;
use host::render::plan::error::geometric_error;
use host::render::plan::{Edges, Halftone, Plan};
use host::render::tessellate::tessellate;
use host::render::turn::Turn;
use host::scene::ShadedScene;
use protocol::rig::{Rig, TrackedViewer};
use tests::{builtin, bunny, measure, rig, turn};

fn viewer(azimuth_deg: f64, distance_m: f64, height_m: f64) -> TrackedViewer {
    TrackedViewer { azimuth_deg, distance_m, height_m }
}

/// The reference rig with these viewers.
fn with(viewers: &[TrackedViewer]) -> Rig {
    let mut rig = rig("reference");
    rig.viewing.tracked = viewers.to_vec();
    rig.checked().expect("a possible rig")
}

/// The reference rig with nobody but this viewer: the whole circle is his.
fn alone(viewer: TrackedViewer) -> Rig {
    let mut rig = rig("reference");
    (rig.viewing.distance_m, rig.viewing.height_m) = (Some(viewer.distance_m), Some(viewer.height_m));
    rig.checked().expect("a possible rig")
}

/// An eye of a viewer, this far to the right of the middle of both.
fn eye(viewer: TrackedViewer, aside_m: f64) -> DVec3 {
    viewer.place() + aside_m * viewer.place().with_y(0.0).normalize().cross(DVec3::NEG_Y)
}

/// Both eyes of a viewer, as far apart as people's are.
const EYES_M: [f64; 2] = [-0.032, 0.032];

/// What the eyes of `seer` see of `turn` against the truth there, dB.
fn seen(scene: &ShadedScene, rig: &Rig, turn: &Turn, seer: TrackedViewer) -> [f64; 2] {
    EYES_M.map(|aside_m| measure(scene, rig, turn, eye(seer, aside_m)).psnr_db)
}

fn shown(scene: &ShadedScene, rig: &Rig, halftone: Halftone) -> Turn {
    turn(scene, rig, &Plan { halftone, ..Plan::default() })
}

#[test]
fn eyes_are_beside_each_other() {
    let front = viewer(0.0, 0.9, 0.35);
    assert!((eye(front, 0.01) - DVec3::new(0.01, 0.35, 0.9)).length() < 1e-12);
}

#[test]
fn viewers_see_no_other_slices_than_those_that_are_rendered_first() {
    let (scene, tall, other) = (builtin(), viewer(40.0, 0.9, 0.6), viewer(-120.0, 1.4, 0.2));
    let rig = with(&[tall, other]);
    let whole = shown(&scene, &rig, Halftone::Grey);
    let own = slices_seen_by(&[tall], &rig, &Plan::default());
    assert!((20..100).contains(&own.len()), "{}", own.len());
    let mut part = whole.clone();
    for slice in (0..rig.rotation.slices).filter(|slice| !own.contains(slice)) {
        part.slice_mut(slice).fill(0);
    }
    assert_eq!(seen(&scene, &rig, &part, tall), seen(&scene, &rig, &whole, tall));
    assert_ne!(seen(&scene, &rig, &part, other), seen(&scene, &rig, &whole, other));
}

const HALFTONES: [Halftone; 2] = [Halftone::Grey, Halftone::OptimisedDiffusion];

/// Somebody 0.6 m high, where the circle is at 0.35 m, sees at least so much: dB in grey and by the default halftone.
fn sees_it_from_above(name: &str, scene: &ShadedScene, least: [f64; 2]) {
    let tall = viewer(40.0, 0.9, 0.6);
    for (halftone, least) in HALFTONES.into_iter().zip(least) {
        let [tracked, own, untracked] = [with(&[tall]), alone(tall), rig("reference")]
            .map(|rig| seen(scene, &rig, &shown(scene, &rig, halftone), tall));
        println!(
            "{name} {halftone}: {tracked:.2?} dB, {own:.2?} on a circle of that height, {untracked:.2?} untracked"
        );
        for eye in 0..2 {
            assert!(tracked[eye] > least && tracked[eye] > own[eye] - 0.2, "{name} {halftone} {tracked:?} {own:?}");
            assert!(untracked[eye] < tracked[eye] - 10.0, "{name} {halftone} {tracked:?} {untracked:?}");
        }
    }
}

#[test]
fn a_higher_viewer_sees_it_from_above() {
    sees_it_from_above("builtin", &builtin(), [44.0, 39.0]);
}

#[test]
fn a_higher_viewer_sees_the_bunny_from_above() {
    if let Some(bunny) = bunny() {
        sees_it_from_above("bunny", &bunny, [50.0, 40.0]);
    }
}

/// Two at different heights, as many degrees apart, see what each would see alone, but for 1 dB.
fn have_their_own_perspective(name: &str, scene: &ShadedScene, halftone: Halftone, gaps: &[f64]) {
    let own = [viewer(0.0, 0.9, 0.6), viewer(0.0, 1.1, 0.2)].map(|seer| {
        let rig = alone(seer);
        let turn = shown(scene, &rig, halftone);
        (rig, turn)
    });
    for gap in gaps {
        let pair = [viewer(100.0, 0.9, 0.6), viewer(100.0 + gap, 1.1, 0.2)];
        let rig = with(&pair);
        let turn = shown(scene, &rig, halftone);
        for (seer, (own_rig, own_turn)) in pair.into_iter().zip(&own) {
            let (both, single) = (seen(scene, &rig, &turn, seer), seen(scene, own_rig, own_turn, seer));
            println!("{name} {gap}° {halftone} {} m: {both:.2?} dB, alone {single:.2?}", seer.height_m);
            assert!((0..2).all(|eye| both[eye] > single[eye] - 1.0), "{name} {gap} {halftone} {both:?} {single:?}");
        }
    }
}

#[test]
fn two_viewers_have_their_own_perspective() {
    have_their_own_perspective("builtin", &builtin(), Halftone::Grey, &[20.0, 25.0, 40.0]);
    have_their_own_perspective("builtin", &builtin(), Halftone::OptimisedDiffusion, &[20.0, 25.0, 40.0]);
}

#[test]
fn two_viewers_have_their_own_perspective_of_the_bunny() {
    if let Some(bunny) = bunny() {
        have_their_own_perspective("bunny", &bunny, Halftone::Grey, &[20.0]);
    }
}

/// Edges bow more where the curve does: 5 mm by half a pixel, where 16 mm do on the circle.
#[test]
fn edges_are_cut_for_bends_too() {
    let rigs = [with(&[viewer(40.0, 0.9, 0.6)]), with(&[viewer(100.0, 0.9, 0.7), viewer(120.0, 1.2, 0.1)])];
    for rig in rigs {
        for edges in [Edges::Adaptive, Edges::Uniform] {
            let plan = Plan { edges, bow_px: 0.5, ..Plan::default() };
            let mesh = tessellate(&builtin(), &rig, &plan).unwrap();
            let error = geometric_error(&mesh, &rig, &plan, 40_000);
            println!("{edges:?}: {} pieces, {:.3} px", mesh.triangles.len(), error.worst_px);
            assert!(error.worst_px < 0.55 && error.lost == 0, "{edges:?}: {error:?}");
        }
    }
}
