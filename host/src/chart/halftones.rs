//! Ways to make luminance into bits: time against what an eye sees, and how well the result compresses.

use super::{Effort, Job, exposure, median, truth, view};
use crate::halftoned::Halftoned;
use crate::measure::{compare, flicker};
use crate::picture::Picture;
use crate::render::fast::FastRenderer;
use crate::render::halftone::halftone_slices;
use crate::render::plan::{Halftone, Plan, Projection};
use crate::render::truth::Caster;
use crate::render::turn::Turn;
use crate::render::{RenderError, Renderer};
use crate::seen::{Brightness, View, reaching, see_turns};
use crate::stream::TurnPlanes;
use protocol::codec::{ByteStatistics, Compressor, ImageSize, Mask};
use serde::Serialize;
use std::time::Instant;

/// A method on a scene and a rig.
#[derive(Clone, Debug, Serialize)]
pub struct Point {
    /// The scene.
    pub scene: String,
    /// The rig.
    pub rig: String,
    /// How the slices were projected.
    pub projection: Projection,
    /// The method; grey for what no halftone can exceed.
    pub halftone: Halftone,
    /// Turns that make up one picture: more than one flickers.
    pub turns: u32,
    /// Median time for a turn, without rendering it, in milliseconds.
    pub turn_ms: f64,
    /// The same as a ratio to the baseline's, which is [`Halftone::Bayer`].
    pub ratio: f64,
    /// Mean over eyes that nothing was tuned to, in dB.
    pub psnr_db: f64,
    /// The worst of them, in dB.
    pub worst_db: f64,
    /// Mean structural similarity.
    pub ssim: f64,
    /// By the fine measure, 8 × 8 rays and 8 exposures, in the middle half of the window (a quarter of it in quick runs), in dB.
    pub fine_db: f64,
    /// Root of the mean square of the difference that an eye sees between one turn and the next; 0 for patterns of one turn.
    pub flicker: f64,
    /// Bytes of a turn on the wire.
    pub wire_bytes: f64,
    /// Bytes of a turn compressed by zstd at level 1, as a yardstick.
    pub zstd_bytes: f64,
}

/// Azimuths of the eyes in degrees; nothing is tuned to them.
const EYES_DEG: [f64; 3] = [0.64, 3.1, -4.4];

/// Measures all halftones on one scene and rig, on slices by the cone.
pub fn measure(job: &Job<'_>, effort: Effort, done: &mut dyn FnMut(f64)) -> Result<Vec<Point>, RenderError> {
    let bench = Bench::new(job, effort)?;
    let methods: Vec<Halftone> = Halftone::ALL.into_iter().filter(|method| *method != Halftone::Grey).collect();
    let steps = methods.len() as f64 + 1.0;
    let mut times = vec![Vec::new(); methods.len()];
    let mut turns = Vec::new();
    let rounds = match effort {
        Effort::Quick => 1,
        Effort::Full => 3,
    };
    let binary = |method, turn| halftone_slices(&bench.grey, job.rig, method, turn, &bench.lit, &|| ());
    // Masks are made once, on first use.
    for method in methods.iter().filter(|method| method.is_mask()) {
        halftone_slices(&bench.grey, job.rig, *method, 0, &bench.lit[..1], &|| ());
    }
    for round in 0..rounds {
        for (index, method) in methods.iter().enumerate() {
            let start = Instant::now();
            let turn = binary(*method, 0);
            times[index].push(start.elapsed().as_secs_f64() * 1e3 * bench.per_turn());
            if round == 0 {
                turns.push(turn);
            }
        }
    }
    let mut points = vec![bench.point(job, Halftone::Grey, &[&bench.grey])];
    done(1.0 / steps);
    for (index, (method, turn)) in methods.iter().zip(&turns).enumerate() {
        let others: Vec<Turn> = (1..method.turns()).map(|turn| binary(*method, turn)).collect();
        let all: Vec<&Turn> = core::iter::once(turn).chain(&others).collect();
        points.push(Point { turn_ms: median(&mut times[index]), ..bench.point(job, *method, &all) });
        done((index as f64 + 2.0) / steps);
    }
    let baseline =
        points.iter().find(|point| point.halftone == Halftone::Bayer).map_or(f64::NAN, |point| point.turn_ms);
    for point in &mut points {
        point.ratio = point.turn_ms / baseline;
    }
    Ok(points)
}

/// The slices that some eyes see, in grey, and what they should see.
struct Bench {
    grey: Turn,
    lit: Vec<u32>,
    exposure: f32,
    exposures: u32,
    eyes: Vec<(View, Picture)>,
    fine: (View, Picture),
}

impl Bench {
    fn new(job: &Job<'_>, effort: Effort) -> Result<Self, RenderError> {
        let (pixels, rays, exposures, eyes) = match effort {
            Effort::Quick => (128, 3, 3, &EYES_DEG[..1]),
            Effort::Full => (256, 4, 4, &EYES_DEG[..]),
        };
        let caster = Caster::new(job.scene);
        let seen = |view: View| (view, truth(&caster, &view));
        let eyes: Vec<_> = eyes.iter().map(|azimuth| seen(view(job.rig, *azimuth, pixels, rays))).collect();
        let part = match effort {
            Effort::Quick => 4,
            Effort::Full => 2,
        };
        let wide = view(job.rig, EYES_DEG[0], pixels / part, 8);
        let fine = seen(View { window_m: wide.window_m / f64::from(part), ..wide });
        // Methods that hand errors on get some slices before those that are seen.
        const BEFORE: u32 = 8;
        let slices = job.rig.rotation.slices;
        let mut lit: Vec<u32> = eyes
            .iter()
            .flat_map(|(view, _)| reaching(job.rig, &View { pixels: 32, rays: 2, ..*view }))
            .flat_map(|slice| (0..=2 * BEFORE).map(move |step| (slice + slices + step - BEFORE) % slices))
            .collect();
        lit.sort_unstable();
        lit.dedup();
        let plan = Plan { halftone: Halftone::Grey, ..Plan::default() };
        let grey = FastRenderer::new().render_slices(job.scene, job.rig, &plan, &lit, &|| ())?;
        Ok(Self { grey, lit, exposure: exposure(job.rig), exposures, eyes, fine })
    }

    /// By what a figure of the lit slices is multiplied for a whole turn.
    fn per_turn(&self) -> f64 {
        f64::from(self.grey.slices()) / self.lit.len() as f64
    }

    fn point(&self, job: &Job<'_>, halftone: Halftone, turns: &[&Turn]) -> Point {
        let look = |turns: &[&Turn], view: &View, exposures: u32| {
            see_turns(job.rig, turns, view, exposures, Brightness::Divided, &|| ()).exposed(self.exposure)
        };
        let (mut likenesses, mut swing) = (Vec::new(), 0.0f64);
        for (view, truth) in &self.eyes {
            likenesses.extend(compare(&look(turns, view, self.exposures), truth));
            if let [first, second, ..] = turns {
                let [first, second] = [first, second].map(|turn| look(&[turn], view, self.exposures));
                swing = swing.max(flicker(&first, &second).unwrap_or(f64::NAN));
            }
        }
        let fine = compare(&look(turns, &self.fine.0, 8), &self.fine.1);
        let count = likenesses.len() as f64;
        let (wire, zstd) = self.bytes(&Halftoned { turn: turns[0], halftone, number: 0 });
        Point {
            scene: job.name.into(),
            rig: job.rig.name.clone(),
            projection: Plan::default().projection,
            halftone,
            turns: turns.len() as u32,
            turn_ms: 0.0,
            ratio: f64::NAN,
            psnr_db: likenesses.iter().map(|likeness| likeness.psnr_db).sum::<f64>() / count,
            worst_db: likenesses.iter().map(|likeness| likeness.psnr_db).fold(f64::INFINITY, f64::min),
            ssim: likenesses.iter().map(|likeness| likeness.ssim).sum::<f64>() / count,
            fine_db: fine.map_or(f64::NAN, |likeness| likeness.psnr_db),
            flicker: swing,
            wire_bytes: wire * self.per_turn(),
            zstd_bytes: zstd * self.per_turn(),
        }
    }

    /// Bytes of the lit slices on the wire, once the device knows what they are compressed by, and by zstd.
    fn bytes(&self, turn: &Halftoned<&Turn>) -> (f64, f64) {
        let Ok(size) = ImageSize::new(turn.turn.width(), turn.turn.height()) else { return (f64::NAN, f64::NAN) };
        let planes: Vec<&[u8]> = self.lit.iter().map(|slice| turn.plane_bytes(*slice)).collect();
        let (mut mask, mut statistics) = (Mask::NONE, ByteStatistics::default());
        let mut compressor = Compressor::new(size);
        if mask.set(turn.mask_ranks().iter().copied()).is_ok() {
            compressor.set_mask(mask);
        }
        planes.iter().for_each(|plane| statistics.add(plane, size.row_bytes()));
        // Complete, as they were made to be.
        let _ = compressor.set_codes(&statistics.lengths());
        let mut wire = Vec::new();
        for (slice, plane) in self.lit.iter().zip(&planes) {
            compressor.compress(plane, turn.hint(*slice), &mut wire);
        }
        let zstd = zstd::bulk::compress(&planes.concat(), 1).map_or(f64::NAN, |bytes| bytes.len() as f64);
        (wire.len() as f64, zstd)
    }
}
