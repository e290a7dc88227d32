//! What the whole-system tests share. The tests themselves live in `tests/`.

pub mod agree;
pub mod rule;
pub mod soaking;

use glam::{DVec3, Vec2, Vec3};
use host::measure::{Likeness, compare};
use host::picture::Picture;
use host::render::Renderer;
use host::render::clear::ClearRenderer;
use host::render::plan::{Edges, Halftone, Plan, Projection};
use host::render::truth::{Caster, Pinhole};
use host::render::turn::Turn;
use host::scene::{Scene, ShadedScene, ShadedTriangle, Shading, shade};
use host::seen::{Brightness, View, see};
use protocol::rig::Rig;
use std::path::{Path, PathBuf};

/// A built-in rig.
pub fn rig(name: &str) -> Rig {
    host::rigs::find(name).expect("a built-in rig")
}

/// A file of the data folder that is not part of the project; says so where it is missing.
pub fn shared(path: &str) -> Option<PathBuf> {
    let default = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let folder = std::env::var_os("PRAXI_SHARED").map_or(default, PathBuf::from);
    let file = folder.join(path);
    if file.exists() {
        return Some(file);
    }
    println!("skipped: {} is missing", file.display());
    None
}

/// The bunny of rig.md's measure: fitted to 100 mm, flat normals.
pub fn bunny() -> Option<ShadedScene> {
    let mut scene = Scene::load(shared("data/meshes/stanford-bunny.obj")?).expect("the bunny");
    scene.fit(0.1);
    Some(shade(&scene, Shading::Lambert, false))
}

/// The built-in scene, lit.
pub fn builtin() -> ShadedScene {
    shade(&Scene::builtin(), Shading::Lambert, false)
}

/// One of the scenes that need no file, lit.
pub fn scene(name: &str) -> ShadedScene {
    shade(&Scene::load(name).expect("a built-in scene"), Shading::Lambert, false)
}

/// One turn by `plan`.
pub fn turn(scene: &ShadedScene, rig: &Rig, plan: &Plan) -> Turn {
    ClearRenderer.render_turn(scene, rig, plan, &|| ()).expect("a scene of moderate size")
}

/// The measure's view from `from`: a window of 130 mm, 256 × 256 pixels of 4 × 4 rays.
pub fn view(from: DVec3) -> View {
    View { from, look_at: DVec3::ZERO, window_m: 0.13, pixels: 256, rays: 4 }
}

/// The pinhole render with the same rays.
pub fn truth(scene: &ShadedScene, from: DVec3) -> Picture {
    let View { from, look_at, window_m, pixels, rays } = view(from);
    Caster::new(scene).picture(&Pinhole { from, look_at, window_m, pixels, rays }, &|| ())
}

/// The measure: what an eye at `from` sees of `turn` against the pinhole render, with four exposures a slice.
pub fn measure(scene: &ShadedScene, rig: &Rig, turn: &Turn, from: DVec3) -> Likeness {
    let seen = see(rig, turn, &view(from), 4, Brightness::Divided, &|| ());
    compare(&seen, &truth(scene, from)).expect("pictures of one size")
}

/// A plan in single precision, with linear depth.
pub fn plan(projection: Projection, edges: Edges, bow_px: f64) -> Plan {
    Plan { projection, edges, bow_px, ..Plan::default() }
}

/// Slices of a turn that show every side.
pub const SLICES: [u32; 3] = [3, 110, 230];

/// Slices drawn by a plan, in grey.
pub fn grey_slices(scene: &ShadedScene, rig: &Rig, plan: &Plan, slices: &[u32]) -> Vec<Vec<u8>> {
    let plan = Plan { halftone: Halftone::Grey, ..*plan };
    let turn = ClearRenderer.render_slices(scene, rig, &plan, slices, &|| ()).unwrap();
    slices.iter().map(|slice| turn.slice(*slice).to_vec()).collect()
}

/// Lit pixels of `exact`, and those in which `drawn` differs by more than rounding.
pub fn differing(exact: &[Vec<u8>], drawn: &[Vec<u8>]) -> (usize, usize) {
    let pairs = || exact.iter().flatten().zip(drawn.iter().flatten());
    (
        pairs().filter(|(exact, _)| **exact > 0).count(),
        pairs().filter(|(exact, drawn)| exact.abs_diff(**drawn) > 2).count(),
    )
}

/// A triangle of one luminance.
pub fn triangle(positions: [[f32; 3]; 3], luminance: f32) -> ShadedTriangle {
    ShadedTriangle {
        positions: positions.map(Vec3::from),
        radiance: [Vec3::splat(luminance); 3],
        uv: [Vec2::ZERO; 3],
        texture: None,
    }
}

/// A scene of triangles without textures.
pub fn scene_of(triangles: Vec<ShadedTriangle>) -> ShadedScene {
    ShadedScene { triangles, textures: Vec::new() }
}
