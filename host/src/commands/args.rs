//! Arguments that several commands share.

use super::{Failure, warn};
use crate::machine::check_memory;
use crate::picture::Picture;
use crate::render::Renderer;
use crate::render::pick::{Asked, pick};
use crate::render::plan::choose::{Budget, Choice, Fixed, PlanError, choose};
use crate::render::plan::speed::ms_per_cost;
use crate::render::plan::{DepthTest, Edges, Precision, Projection};
use crate::render::truth::Pinhole;
use crate::rigs;
use crate::scene::{Scene, ShadedScene, Shading, shade};
use crate::seen::View;
use crate::volume::display_radius_m;
use clap::ValueEnum;
use glam::DVec3;
use indicatif::{ProgressBar, ProgressStyle};
use protocol::rig::{Rig, TrackedViewer};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Every seed is allowed that a number of 64 bits can be.
pub(super) fn seed(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| format!("must be a whole number from 0 to {}", u64::MAX))
}

/// A scene and how it is lit.
#[derive(clap::Args)]
pub(super) struct SceneArgs {
    /// A .gltf, .glb, .obj or .ply file in metres, or `builtin`, `boxes`, `knot-5k`, `knot-20k` or `knot-70k`
    pub scene: String,
    /// Centre the bounding box at the origin and scale its largest extent to M metres
    #[arg(long, value_name = "M", value_parser = positive, allow_negative_numbers = true)]
    pub fit_m: Option<f64>,
    /// How surfaces are lit
    #[arg(long, value_enum, default_value = "lambert")]
    pub shading: ShadingArg,
    /// Use the file's normals, where it has them, in place of the triangles'
    #[arg(long)]
    pub smooth: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum ShadingArg {
    /// The measure's light: 0.1 + 0.85 max(0, n·l)
    Lambert,
    /// Every surface keeps its own luminance
    Unlit,
}

impl ShadingArg {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Lambert => "lambert",
            Self::Unlit => "unlit",
        }
    }
}

impl SceneArgs {
    /// Loads, fits and lights the scene; prints its notes as warnings.
    pub(super) fn load(&self) -> Result<(Scene, ShadedScene), Failure> {
        let mut scene = load(&self.scene)?;
        if let Some(extent) = self.fit_m {
            scene.fit(extent as f32);
        }
        let shading = match self.shading {
            ShadingArg::Lambert => Shading::Lambert,
            ShadingArg::Unlit => Shading::Unlit,
        };
        let shaded = shade(&scene, shading, self.smooth);
        Ok((scene, shaded))
    }

    /// Warns of a scene that `rig` cannot show whole, or that is lost in it, with the size that fits.
    pub(super) fn warn_of_size(&self, scene: &Scene, rig: &Rig) {
        let allowed = display_radius_m(rig);
        let radius = f64::from(scene.radius());
        if (0.05 * allowed..=allowed).contains(&radius) {
            return;
        }
        let (low, high) = scene.bounds();
        let (centre, extent) = ((low + high) / 2.0, f64::from((high - low).max_element()));
        let corners = scene.triangles.iter().flatten().map(|corner| scene.positions[*corner as usize]);
        let about_centre = f64::from(corners.map(|position| position.distance(centre)).fold(0.0, f32::max));
        let fit = extent * allowed / about_centre;
        warn(format!(
            "{}: reaches {:.3} mm from the origin; rig {} shows {:.1} mm from every side: --fit-m {:.3} fits",
            self.scene,
            radius * 1e3,
            rig.name,
            allowed * 1e3,
            (fit * 1e3).floor() / 1e3,
        ));
    }
}

/// Bytes for a triangle of a scene that is loaded, lit and cut: 310 by a process with 4 million of them, and room for a renderer's own.
const TRIANGLE_BYTES: u64 = 400;

/// Loads a scene, if there is memory to render it; prints its notes as warnings.
fn load(path: &str) -> Result<Scene, Failure> {
    let scene = {
        let _busy = busy("loading the scene");
        Scene::load(path)?
    };
    check_memory("rendering so many triangles", TRIANGLE_BYTES * scene.triangles.len() as u64)
        .map_err(|error| Failure(format!("{path}: {} triangles: {error}", scene.triangles.len())))?;
    for note in &scene.notes {
        warn(format!("{path}: {note}"));
    }
    Ok(scene)
}

/// The largest extent with which `scene` fills what `rig` shows from every side; nothing for a built-in scene that fits as it is.
pub(super) fn filling_extent_m(name: &str, scene: &Scene, rig: &Rig) -> Result<Option<f32>, Failure> {
    let allowed = display_radius_m(rig) as f32;
    if allowed == 0.0 {
        return Err(Failure(format!("rig {} shows no point from every side: see praxi rig check", rig.name)));
    }
    if Path::new(name).extension().is_none() && scene.radius() <= allowed {
        return Ok(None);
    }
    let mut unit = scene.clone();
    unit.fit(1.0);
    // The ball about the scene fills the window that the eyes look at, which is a little smaller than the display.
    Ok(Some(0.92 * allowed / unit.radius()))
}

/// The name of a scene, and the scene in the measure's light; one from a file scaled to `fit_m` metres.
pub(super) fn load_fitted(path: &str, fit_m: f64) -> Result<(String, ShadedScene), Failure> {
    let mut scene = load(path)?;
    let is_file = std::path::Path::new(path).extension().is_some();
    if is_file {
        scene.fit(fit_m as f32);
    }
    Ok((scene.name.clone(), shade(&scene, Shading::Lambert, false)))
}

/// A rig, and who stands around it.
#[derive(clap::Args)]
pub(super) struct RigArgs {
    /// A rig file, or reference, reference-180hz, high-viewer, tent
    #[arg(long)]
    pub rig: String,
    /// Somebody whose perspective is to be right: degrees from the front toward the right, metres from the axis, metres above the
    /// mirror's middle; as often as there are viewers
    #[arg(long, value_name = "AZIMUTH_DEG:DISTANCE_M:HEIGHT_M", value_parser = viewer, allow_hyphen_values = true)]
    pub viewer: Vec<TrackedViewer>,
}

impl RigArgs {
    /// The rig, with these viewers beside its own.
    pub(super) fn find(&self) -> Result<Rig, Failure> {
        let mut rig = rigs::find(&self.rig)?;
        rig.viewing.tracked.extend_from_slice(&self.viewer);
        rig.checked().map_err(|error| Failure(format!("--viewer: {error}")))
    }
}

/// By which methods a turn is rendered: chosen within a budget, or fixed.
#[derive(clap::Args)]
pub(super) struct PlanArgs {
    /// Take the cheapest methods that draw everything within E projector pixels of where it belongs [default: 0.5]
    #[arg(long, value_name = "E", value_parser = budget, allow_negative_numbers = true)]
    pub budget_px: Option<f64>,
    /// Take the most accurate methods that render a turn on this machine in T milliseconds, without the halftone
    #[arg(long, value_name = "T", value_parser = budget, allow_negative_numbers = true, conflicts_with = "budget_px")]
    pub budget_ms: Option<f64>,
    /// Fix how the diffuser's light is followed to its viewer
    #[arg(long, value_enum)]
    pub projection: Option<Projection>,
    /// Fix the precision of projection
    #[arg(long, value_enum)]
    pub precision: Option<Precision>,
    /// Fix how straight edges are brought to the curves that the optics make of them
    #[arg(long, value_enum)]
    pub edges: Option<Edges>,
    /// Fix how depth is compared
    #[arg(long, value_enum)]
    pub depth: Option<DepthTest>,
}

/// How far things may lie from where they belong, in projector pixels, where nothing else is asked for.
pub(super) const DEFAULT_BUDGET_PX: f64 = 0.5;

/// What was chosen, and how a plan's cost becomes milliseconds here, where that was measured.
pub(super) struct Planned {
    pub choice: Choice,
    pub ms_per_cost: Option<f64>,
}

impl PlanArgs {
    /// Chooses within the budget that was asked for; without one, within the default or, where what is fixed cannot keep that, as
    /// accurately as it can.
    pub(super) fn choose(&self, scene: &ShadedScene, rig: &Rig) -> Result<Planned, Failure> {
        let _busy = busy("choosing methods");
        let planned = |choice, ms_per_cost| Ok(Planned { choice, ms_per_cost });
        let Some(ms) = self.budget_ms else {
            let px = self.budget_px.unwrap_or(DEFAULT_BUDGET_PX);
            return match self.with_budget(scene, rig, Budget::Error(px)) {
                Err(PlanError::TooAccurate { reached, .. }) if self.budget_px.is_none() => {
                    warn(format!(
                        "what is fixed errs by up to {reached:.2} px, more than the default budget of {px} px"
                    ));
                    planned(self.with_budget(scene, rig, Budget::Error(1.001 * reached))?, None)
                }
                choice => planned(choice?, None),
            };
        };
        let ms_per_cost = ms_per_cost(scene, rig)?;
        let choice = self.with_budget(scene, rig, Budget::Cost(ms / ms_per_cost)).map_err(|error| match error {
            PlanError::TooFast { possible, fastest, .. } => {
                PlanError::TooFast { asked: ms, possible: possible * ms_per_cost, fastest }
            }
            other => other,
        })?;
        planned(choice, Some(ms_per_cost))
    }

    /// Chooses within another budget.
    pub(super) fn with_budget(&self, scene: &ShadedScene, rig: &Rig, budget: Budget) -> Result<Choice, PlanError> {
        let Self { projection, precision, edges, depth, .. } = *self;
        choose(scene, rig, Fixed { projection, precision, edges, depth }, budget)
    }
}

/// Who renders.
#[derive(clap::Args)]
pub(super) struct RendererArgs {
    /// Who renders
    #[arg(long, value_enum, default_value = "auto")]
    pub renderer: Asked,
    /// Render on the GPU whose name contains NAME, in any case
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
}

impl RendererArgs {
    /// The renderer; a warning where the GPU that was asked for cannot be had, or as soon as it fails.
    pub(super) fn open(&self) -> Result<Box<dyn Renderer>, Failure> {
        if let (Asked::Cpu, Some(name)) = (self.renderer, &self.adapter) {
            return Err(Failure(format!(
                "--adapter {name}: with --renderer cpu no GPU renders, allowed are auto and gpu"
            )));
        }
        let notice = |error: &_| warn(format!("{error}: rendering on the CPU"));
        Ok(pick(self.renderer, self.adapter.as_deref(), Box::new(notice)))
    }
}

/// Where an eye is and what it looks at.
#[derive(clap::Args)]
pub(super) struct ViewArgs {
    /// The eye in metres; +y is up, +z the front of the display
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, required_unless_present = "viewer")]
    pub from: Option<DVec3>,
    /// The eye by degrees from the front toward the right, metres from the axis, and metres above the mirror's middle
    #[arg(
        long,
        value_name = "AZIMUTH_DEG:DISTANCE_M:HEIGHT_M",
        value_parser = viewer,
        allow_hyphen_values = true,
        conflicts_with = "from"
    )]
    pub viewer: Option<TrackedViewer>,
    /// The middle of the window that it looks at
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, default_value = "0,0,0")]
    pub look_at: DVec3,
    /// The side of the window, which stands at right angles to the line of sight
    #[arg(long, value_name = "M", value_parser = positive, allow_negative_numbers = true, default_value = "0.13")]
    pub window_m: f64,
    /// The side of the picture
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096), default_value = "256")]
    pub pixels: u32,
    /// N × N rays are averaged in a pixel
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=16), default_value = "4")]
    pub rays: u32,
}

impl ViewArgs {
    pub(super) fn view(&self) -> Result<View, Failure> {
        let Self { from, viewer, look_at, window_m, pixels, rays } = *self;
        let from = viewer.map(|viewer| viewer.place()).or(from).unwrap_or_default();
        if from.distance(look_at) < 1e-6 {
            return Err(Failure("--from and --look-at are the same point: they must differ".into()));
        }
        Ok(View { from, look_at, window_m, pixels, rays })
    }

    pub(super) fn pinhole(&self) -> Result<Pinhole, Failure> {
        let View { from, look_at, window_m, pixels, rays } = self.view()?;
        Ok(Pinhole { from, look_at, window_m, pixels, rays })
    }
}

/// A picture to write.
#[derive(clap::Args)]
pub(super) struct PictureArgs {
    /// The PNG to write: 8-bit sRGB; transparent where nothing is known
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Write 16-bit linear luminance
    #[arg(long)]
    pub linear: bool,
}

impl PictureArgs {
    pub(super) fn png(&self, picture: &Picture) -> Vec<u8> {
        if self.linear { picture.linear_png() } else { picture.srgb_png() }
    }
}

/// An error in pixels, as people read it.
pub(super) fn pixels(error: f64) -> String {
    if error < 0.01 { format!("{error:.0e}") } else { format!("{error:.3}") }
}

/// A budget.
pub(super) fn budget(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "must be a number above 0".to_string())?;
    if value > 0.0 && value.is_finite() { Ok(value) } else { Err("must be a number above 0".into()) }
}

/// A length in metres.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "must be a number of metres".to_string())?;
    if (1e-6..=1e6).contains(&value) { Ok(value) } else { Err("must be from 0.000001 to 1000000 metres".into()) }
}

/// Three numbers with commas.
pub(super) fn point(text: &str) -> Result<DVec3, String> {
    let numbers: Vec<f64> = text.split(',').map_while(|part| part.trim().parse().ok()).collect();
    match numbers[..] {
        [x, y, z] if text.split(',').count() == 3 && numbers.iter().all(|value| value.abs() <= 1e9) => {
            Ok(DVec3::new(x, y, z))
        }
        _ => Err("must be three numbers of metres with commas, as in 0.01,0.35,0.9, each from -1e9 to 1e9".into()),
    }
}

/// A viewer.
pub(super) fn viewer(text: &str) -> Result<TrackedViewer, String> {
    let numbers: Option<Vec<f64>> = text.split(':').map(|part| part.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[azimuth_deg, distance_m, height_m])
            if [azimuth_deg, distance_m, height_m].iter().all(|n| n.is_finite()) =>
        {
            Ok(TrackedViewer { azimuth_deg, distance_m, height_m })
        }
        _ => Err("must be degrees, metres and metres with colons, as in 20:0.9:0.6".into()),
    }
}

/// A sign of life and the time since, on standard error, until it is dropped; nothing where that is no terminal. For what has no steps.
pub(super) fn busy(what: &'static str) -> Busy {
    let style = ProgressStyle::with_template("{prefix:<22} {spinner} {elapsed:>4}").expect("a fixed template");
    let bar = ProgressBar::new_spinner().with_style(style).with_prefix(what);
    bar.enable_steady_tick(Duration::from_millis(100));
    Busy(bar)
}

/// What [`busy`] shows.
pub(super) struct Busy(ProgressBar);

impl Busy {
    /// Takes it away while `print` prints.
    pub(super) fn aside(&self, print: impl FnOnce()) {
        self.0.suspend(print);
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// A bar on standard error, which vanishes when it is done; nothing where that is no terminal.
pub(super) fn progress(what: &'static str, steps: u64) -> ProgressBar {
    let style =
        ProgressStyle::with_template("{prefix:<22} {bar:32} {pos:>5}/{len} {eta:>4}").expect("a fixed template");
    ProgressBar::new(steps).with_style(style.progress_chars("█▌ ")).with_prefix(what)
}
