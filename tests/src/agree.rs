//! Whether two renderers show the same: bit by bit, but for what rounding may do.

use glam::{DVec2, DVec3};
use host::render::blur::eye_blur;
use host::render::clear::ClearRenderer;
use host::render::fast::{FastRenderer, Level};
use host::render::gpu::{GpuRenderer, Way};
use host::render::mesh::Mesh;
use host::render::plan::{Halftone, Plan, Projection};
use host::render::tessellate::tessellate;
use host::render::turn::Turn;
use host::render::{RenderError, Renderer};
use host::scene::ShadedScene;
use protocol::rig::Rig;
use shaders::halftone::{Slot, halftone};
use shaders::project::methods::{FaceOptics, Method};

/// How near the border of a triangle a pixel may show another one: a pixel for the snapping of vertices, and one for the bow, which two
/// renderers may cut differently.
const BORDER_PX: i64 = 2;
/// By how much two luminances of a surface may differ, of 1: the rounding of grey to a byte, and of colours to fixed point.
const SHADE: f32 = 2.0 / 255.0;
/// Of the lit bits, this share may differ; in a slice where few are lit, by chance some more.
pub const SHARE_MAX: f64 = 0.003;

/// What two renderers do in one slice.
#[derive(Clone, Copy, Debug)]
pub struct Agreement {
    /// Which slice.
    pub slice: u32,
    /// Bits that are lit in the exact one.
    pub lit: usize,
    /// Bits that differ.
    pub differing: usize,
    /// Those of them within a triangle whose luminance leaves no doubt.
    pub stray: usize,
}

impl Agreement {
    /// Whether so much may differ: the share, and three standard deviations of a count of so many.
    pub fn holds(&self) -> bool {
        let share = SHARE_MAX * self.lit as f64;
        self.stray == 0 && self.differing as f64 <= share + 3.0 * share.sqrt()
    }
}

/// A scene on a rig by a plan, with some slices of it by the clear renderer. The plan's halftone must be a mask, or grey.
pub struct Exact<'a> {
    /// The scene.
    pub scene: &'a ShadedScene,
    /// The rig.
    pub rig: &'a Rig,
    /// The methods.
    pub plan: Plan,
    /// The slices.
    pub slices: &'a [u32],
    binary: Turn,
    /// For each of the slices, the pixels that may show something else.
    doubtful: Vec<Vec<bool>>,
}

impl<'a> Exact<'a> {
    /// Renders it.
    pub fn new(scene: &'a ShadedScene, rig: &'a Rig, plan: Plan, slices: &'a [u32]) -> Self {
        assert!(plan.halftone.is_mask(), "{}: no mask", plan.halftone);
        let render = |halftone| {
            ClearRenderer.render_slices(scene, rig, &Plan { halftone, ..plan }, slices, &|| ()).expect("a small scene")
        };
        let mesh = tessellate(scene, rig, &plan).expect("a small scene");
        let grey = render(Halftone::Grey);
        let doubtful = slices.iter().map(|slice| {
            let [darker, brighter] =
                [-SHADE, SHADE].map(|change| halftoned(rig, plan.halftone, *slice, grey.slice(*slice), change));
            let mut doubtful = borders(&mesh, rig, plan.projection, *slice);
            for (pixel, doubtful) in doubtful.iter_mut().enumerate() {
                *doubtful |= is_lit(&darker, pixel, rig) != is_lit(&brighter, pixel, rig);
            }
            doubtful
        });
        Self { scene, rig, plan, slices, doubtful: doubtful.collect(), binary: render(plan.halftone) }
    }

    /// What `renderer` does, slice by slice.
    pub fn against(&self, renderer: &dyn Renderer) -> Result<Vec<Agreement>, RenderError> {
        let other = renderer.render_slices(self.scene, self.rig, &self.plan, self.slices, &|| ())?;
        Ok((0..self.slices.len()).map(|index| self.agreement(index, &other)).collect())
    }

    /// Panics where `renderer` shows something else; says how much differs. What a GPU does not render at all is passed over, and said.
    pub fn assert_same(&self, name: &str, renderer: &dyn Renderer) {
        let found = match self.against(renderer) {
            Err(RenderError::Gpu(error)) => return println!("skipped: {name}: {error}"),
            found => found.expect("a small scene"),
        };
        let sum = |count: fn(&Agreement) -> usize| found.iter().map(count).sum::<usize>();
        let (lit, differing) = (sum(|one| one.lit), sum(|one| one.differing));
        println!("{name}: {:.4} % of {lit} lit bits differ", 100.0 * differing as f64 / lit.max(1) as f64);
        let broken: Vec<_> = found.iter().filter(|one| !one.holds()).collect();
        assert!(broken.is_empty(), "{name}: {broken:?}");
        assert!(differing as f64 <= SHARE_MAX * lit as f64, "{name}: {differing} of {lit} bits differ");
        assert!(lit > 100, "{name}: hardly anything is seen");
    }

    fn agreement(&self, index: usize, other: &Turn) -> Agreement {
        let slice = self.slices[index];
        let (exact, other) = (self.binary.slice(slice), other.slice(slice));
        let mut found = Agreement { slice, lit: 0, differing: 0, stray: 0 };
        for (pixel, doubtful) in self.doubtful[index].iter().enumerate() {
            let lit = is_lit(exact, pixel, self.rig);
            found.lit += usize::from(lit);
            if lit != is_lit(other, pixel, self.rig) {
                found.differing += 1;
                found.stray += usize::from(!doubtful);
            }
        }
        found
    }
}

/// Bit `pixel`, counted row by row, of a slice for `rig`.
fn is_lit(plane: &[u8], pixel: usize, rig: &Rig) -> bool {
    let width = rig.projector.width_px as usize;
    plane[pixel / width * width.div_ceil(8) + pixel % width / 8] >> (pixel % width % 8) & 1 == 1
}

/// The bits of a slice were every luminance larger by `change`; what is dark stays so.
fn halftoned(rig: &Rig, method: Halftone, slice: u32, grey: &[u8], change: f32) -> Vec<u8> {
    let changed = |byte: &u8| if *byte == 0 { 0.0 } else { (f32::from(*byte) / 255.0 + change).clamp(0.0, 1.0) };
    let luminance: Vec<f32> = grey.iter().map(changed).collect();
    let width = rig.projector.width_px;
    let mut bits = vec![0; (width as usize).div_ceil(8) * rig.projector.height_px as usize];
    let slot = Slot { slice, turn: 0, blur: eye_blur(rig, slice) };
    halftone(method.binary().expect("a mask"), slot, width, &luminance, &mut bits);
    bits
}

/// Which pixels of `slice` lie within [`BORDER_PX`] of a border of any triangle.
fn borders(mesh: &Mesh, rig: &Rig, projection: Projection, slice: u32) -> Vec<bool> {
    let size = [rig.projector.width_px, rig.projector.height_px].map(i64::from);
    let mut near = vec![false; (size[0] * size[1]) as usize];
    let mut mark = |at: DVec2| {
        let [x, y] = [at.x.floor() as i64, at.y.floor() as i64];
        let clamped = |value: i64, axis: usize| value.clamp(0, size[axis]) as usize;
        for row in clamped(y - BORDER_PX, 1)..clamped(y + BORDER_PX + 1, 1) {
            let start = row * size[0] as usize;
            near[start + clamped(x - BORDER_PX, 0)..start + clamped(x + BORDER_PX + 1, 0)].fill(true);
        }
    };
    for face in 0..rig.mirror.face.len() {
        let projector = FaceOptics::<f64>::new(rig, face, Method::from(projection)).slice(rig.slice_angle(slice));
        let pixel = |position: &DVec3| projector.vertex(position.to_array()).map(|one| DVec2::from_array(one.pixel));
        let pixels: Vec<_> = mesh.positions.iter().map(pixel).collect();
        for triangle in &mesh.triangles {
            for [from, to] in [[0, 1], [1, 2], [2, 0]] {
                let ends = [from, to].map(|corner| pixels[triangle.corners[corner] as usize]);
                let [Some(from), Some(to)] = ends else { continue };
                let steps = from.distance(to).ceil().clamp(1.0, 4096.0) as u32;
                (0..=steps).for_each(|step| mark(from.lerp(to, f64::from(step) / f64::from(steps))));
            }
        }
    }
    near
}

/// Every renderer of this machine that is not the clear one, with a name; says which are missing.
pub fn renderers() -> Vec<(String, Box<dyn Renderer>)> {
    let mut renderers: Vec<(String, Box<dyn Renderer>)> = Vec::new();
    for level in Level::ALL {
        match FastRenderer::with(level) {
            Some(renderer) => renderers.push((format!("cpu {level}"), Box::new(renderer))),
            None => println!("skipped: this processor has no {level}"),
        }
    }
    for way in Way::ALL {
        match GpuRenderer::open(None, Some(way)) {
            Ok(renderer) => renderers.push((format!("gpu {way:?}").to_lowercase(), Box::new(renderer))),
            Err(error) => println!("skipped: gpu {way:?}: {error}"),
        }
    }
    renderers
}

/// Both optical models, each with its name.
pub const MODELS: [(&str, Projection); 2] = [("planar", Projection::Planar), ("cone", Projection::ConeNewton)];
