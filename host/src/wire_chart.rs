//! How small planes become on the wire, and how fast: the wire's own codings beside libraries', on scenes that turn and move.

use crate::halftoned::Halftoned;
use crate::render::plan::{Halftone, Plan};
use crate::render::turn::Turn;
use crate::render::{RenderError, Renderer};
use crate::scene::{Scene, Shading, shade};
use crate::stream::TurnPlanes;
use cpu_time::ThreadTime;
use protocol::codec::{ByteStatistics, Codebook, Compressor, Expander, Hint, ImageSize, Mask, plane_check};
use protocol::rig::Rig;
use serde::Serialize;
use std::fmt;
use std::time::Duration;

/// What USB high speed moves, bytes a second.
pub const USB_BYTES_A_SECOND: f64 = 40e6;

/// Ways to compress a plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Coding {
    /// The wire's own, by what is known of the halftone.
    Wire,
    /// The wire's runs of bytes, as controllers of mirror arrays have them.
    Runs,
    /// LZ4, by `lz4_flex`.
    Lz4,
    /// Zstandard at level 1.
    Zstd,
    /// The same of the difference to the plane of the turn before.
    XorZstd,
}

impl Coding {
    /// All, as they are drawn.
    pub const ALL: [Self; 5] = [Self::Wire, Self::Runs, Self::Lz4, Self::Zstd, Self::XorZstd];

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Wire => "wire",
            Self::Runs => "runs",
            Self::Lz4 => "lz4",
            Self::Zstd => "zstd -1",
            Self::XorZstd => "XOR + zstd -1",
        }
    }
}

/// What happens from turn to turn.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Motion {
    /// The scene turns by so many degrees.
    Degrees(f64),
    /// A clip of this name goes on.
    Clip(String),
}

impl fmt::Display for Motion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Degrees(degrees) => write!(f, "{degrees}°"),
            Self::Clip(name) => f.write_str(name),
        }
    }
}

/// A way to compress on a scene.
#[derive(Clone, Debug, Serialize)]
pub struct Point {
    /// The scene.
    pub scene: String,
    /// How it was halftoned.
    pub halftone: Halftone,
    /// What happens from turn to turn.
    pub motion: Motion,
    /// The way.
    pub coding: Coding,
    /// Bytes of planes over bytes of their compressed form.
    pub ratio: f64,
    /// Fresh turns a second that [`USB_BYTES_A_SECOND`] are.
    pub turns_a_second: f64,
    /// Planes compressed, 10⁶ bytes of them in a second of one core.
    pub compress_mb_s: f64,
    /// Planes expanded and checked, the same.
    pub expand_mb_s: f64,
}

/// What is compressed.
#[derive(Clone, Debug)]
pub struct Job<'a> {
    /// The scene at one turn and at the next, as large as it is to be.
    pub scenes: &'a [Scene; 2],
    /// What happened between them.
    pub motion: &'a Motion,
    /// What shows it.
    pub rig: &'a Rig,
    /// How luminance becomes bits.
    pub halftone: Halftone,
}

impl Job<'_> {
    /// Renders two turns, and compresses the second, plane by plane, in every way; each gives the planes back.
    pub fn measure(&self, renderer: &dyn Renderer) -> Result<Vec<Point>, RenderError> {
        let plan = Plan { halftone: self.halftone, ..Plan::default() };
        let turn = |scene| renderer.render_turn(&shade(scene, Shading::Lambert, false), self.rig, &plan, &|| ());
        let turns = [turn(&self.scenes[0])?, turn(&self.scenes[1])?];
        Ok(Coding::ALL.map(|coding| self.point(coding, &turns)).into())
    }

    fn point(&self, coding: Coding, turns: &[Turn; 2]) -> Point {
        let mut coder = Coder::new(coding, &Halftoned { turn: &turns[0], halftone: self.halftone, number: 0 });
        let turn = Halftoned { turn: &turns[1], halftone: self.halftone, number: 0 };
        let (mut times, mut bytes) = ([Duration::ZERO; 2], 0);
        let (mut compressed, mut expanded) = (Vec::new(), vec![0; turns[1].slice_bytes()]);
        for slice in 0..turn.slices() {
            let (plane, before) = (turn.plane_bytes(slice), turns[0].slice(slice));
            let check = plane_check(plane);
            let start = ThreadTime::now();
            compressed.clear();
            coder.compress(plane, before, turn.hint(slice), &mut compressed);
            times[0] += start.elapsed();
            let start = ThreadTime::now();
            coder.expand(&compressed, before, &mut expanded, check);
            times[1] += start.elapsed();
            assert!(expanded == plane, "{} gives back slice {slice}", coding.name());
            bytes += compressed.len();
        }
        let raw = f64::from(turn.slices()) * expanded.len() as f64;
        let [compress_mb_s, expand_mb_s] = times.map(|time| raw / 1e6 / time.as_secs_f64());
        Point {
            scene: self.scenes[0].name.clone(),
            halftone: self.halftone,
            motion: self.motion.clone(),
            coding,
            ratio: raw / bytes as f64,
            turns_a_second: USB_BYTES_A_SECOND / bytes as f64,
            compress_mb_s,
            expand_mb_s,
        }
    }
}

/// Both ends of a way to compress.
struct Coder {
    coding: Coding,
    size: ImageSize,
    compressor: Compressor,
    book: Box<Codebook>,
    difference: Vec<u8>,
}

impl Coder {
    /// What has to be known is learnt from the turn before, as a stream does.
    fn new(coding: Coding, before: &Halftoned<&Turn>) -> Self {
        let size = ImageSize::new(before.turn.width(), before.turn.height()).expect("a rig's pictures");
        let (mut compressor, mut book) = (Compressor::new(size), Box::new(Codebook::EMPTY));
        let mut mask = Mask::NONE;
        if mask.set(before.mask_ranks().iter().copied()).is_ok() {
            compressor.set_mask(mask.clone());
            book.mask = mask;
        }
        let mut statistics = ByteStatistics::default();
        for slice in (0..before.slices()).step_by(9) {
            statistics.add(before.plane_bytes(slice), size.row_bytes());
        }
        let lengths = statistics.lengths();
        compressor.set_codes(&lengths).and_then(|()| book.codes.set(&lengths)).expect("complete codes");
        Self { coding, size, compressor, book, difference: Vec::new() }
    }

    fn compress(&mut self, plane: &[u8], before: &[u8], hint: Hint, out: &mut Vec<u8>) {
        match self.coding {
            Coding::Wire => self.compressor.compress(plane, hint, out),
            Coding::Runs => self.compressor.compress(plane, Hint::None, out),
            Coding::Lz4 => *out = lz4_flex::block::compress(plane),
            Coding::Zstd => *out = zstd::bulk::compress(plane, 1).expect("memory"),
            Coding::XorZstd => {
                self.difference.clear();
                self.difference.extend(plane.iter().zip(before).map(|(byte, before)| byte ^ before));
                *out = zstd::bulk::compress(&self.difference, 1).expect("memory");
            }
        }
    }

    fn expand(&self, compressed: &[u8], before: &[u8], plane: &mut Vec<u8>, check: u64) {
        let bytes = plane.len();
        match self.coding {
            Coding::Wire | Coding::Runs => {
                let mut expander = Expander::new(self.size);
                let pushed = expander.push(compressed, &self.book, plane);
                pushed.and_then(|()| expander.finish(&self.book, plane, check)).expect("what was compressed");
                return;
            }
            Coding::Lz4 => *plane = lz4_flex::block::decompress(compressed, bytes).expect("what was compressed"),
            Coding::Zstd | Coding::XorZstd => {
                *plane = zstd::bulk::decompress(compressed, bytes).expect("what was compressed");
            }
        }
        if self.coding == Coding::XorZstd {
            plane.iter_mut().zip(before).for_each(|(byte, before)| *byte ^= before);
        }
        assert_eq!(plane_check(plane), check);
    }
}
