//! A scene on a rig, rendered slice by slice: a task a frame, or as many slices as are diffused together.

use super::clock::{Clock, Part};
use super::figure::figure;
use super::front::front;
use crate::render::blur::eye_blur;
use crate::render::canvas::shade;
use crate::render::clear::owner;
use crate::render::mesh::Mesh;
use crate::render::plan::{Halftone, Plan};
use crate::render::tessellate::tessellate;
use crate::render::turn::Turn;
use crate::render::{Prepared, RenderError, Wanted};
use crate::scene::ShadedScene;
use core::time::Duration;
use glam::DVec2;
use protocol::rig::Rig;
use raster::{
    Bits, Block, FAR_PX, Figure, Greys, Grid, Level, Panel, Scene, Surface, Touched, Vertices, View, WHITE, Work, draw,
};
use rayon::prelude::*;
use shaders::halftone::diffusion::{Kernel, Slices, diffuse_lanes};
use shaders::halftone::mask::Mask;
use shaders::halftone::{Slot, halftone};
use shaders::project::methods::{FaceOptics, SliceProjector};
use shaders::project::{Model, SliceOptics};
use std::sync::{Mutex, PoisonError};

/// Slices that one task makes, one after the other.
const FRAME: usize = 24;
/// Slices whose errors are diffused together.
const TOGETHER: usize = 16;
/// Fewer are diffused one by one: what is computed for lanes without a slice is lost.
const TOGETHER_MIN: usize = 4;

/// A scene on a rig.
pub struct Job<'a> {
    level: Level,
    scene: &'a ShadedScene,
    rig: Rig,
    halftone: Halftone,
    mesh: Mesh,
    figure: Figure,
    faces: Vec<FaceOptics<f32>>,
    /// One for each task at work; they are kept from turn to turn.
    rooms: Mutex<Vec<Room>>,
    /// Where the time of the last turn went.
    clock: Mutex<Clock>,
}

/// What a task works in.
#[derive(Default)]
struct Room {
    clock: Clock,
    vertices: Vertices,
    panel: Panel,
    /// The faces of a slice, where there are several.
    panels: Vec<SliceOptics>,
    bits: Option<Bits>,
    greys: Option<Greys>,
    luminances: Vec<f32>,
    /// Of slices that are diffused together, dark between tasks; and planes for lanes without a slice.
    levels: [Vec<i16>; TOGETHER],
    spare: Vec<u8>,
}

impl<'a> Job<'a> {
    /// The distance of the farthest corner from the origin, of what was left when long edges had been cut and far pieces left out.
    pub fn radius_m(&self) -> f32 {
        self.figure.radius_m
    }

    /// How pixels and depths of a turn's slices become whole numbers.
    fn grid(&self, turn: &Turn) -> Grid {
        Grid::new([turn.width(), turn.height()], self.figure.radius_m)
    }

    /// `scene` by `plan`, with the instructions of `level`, which this machine must have.
    pub fn new(level: Level, scene: &'a ShadedScene, rig: &Rig, plan: &Plan) -> Result<Self, RenderError> {
        let optics = |face| FaceOptics::new(rig, face, plan.projection.into());
        let mesh = tessellate(scene, rig, plan)?;
        Ok(Self {
            level,
            scene,
            rig: rig.clone(),
            halftone: plan.halftone,
            figure: figure(&mesh, &scene.textures),
            mesh,
            faces: (0..rig.mirror.face.len()).map(optics).collect(),
            rooms: Mutex::default(),
            clock: Mutex::default(),
        })
    }
}

impl Prepared for Job<'_> {
    fn render(&mut self, wanted: Wanted<'_>, turn: &mut Turn) -> Result<(), RenderError> {
        let grid = self.grid(turn);
        let slice_bytes = turn.slice_bytes();
        let kernel = self.halftone.binary().and_then(|method| method.diffusion(wanted.number));
        let slices = if kernel.is_some() { TOGETHER } else { FRAME };
        let job: &Self = self;
        *job.clock.lock().unwrap_or_else(PoisonError::into_inner) = Clock::default();
        turn.bytes_mut().par_chunks_mut(slice_bytes * slices).enumerate().for_each(|(task, bytes)| {
            let mut room = job.rooms.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default();
            room.clock.start();
            let of_task = (task * slices..).map(|slice| slice as u32).zip(bytes.chunks_exact_mut(slice_bytes));
            let mut planes: Vec<_> = of_task.filter(|(slice, _)| wanted.slices.contains(slice)).collect();
            match kernel {
                Some(kernel) if planes.len() >= TOGETHER_MIN => {
                    let done = wanted.done;
                    job.level.run(Diffused { job, grid, kernel, room: &mut room, planes: &mut planes, done });
                }
                _ => {
                    for (slice, bytes) in planes {
                        let slot = Slot { slice, turn: wanted.number, blur: eye_blur(&job.rig, slice) };
                        job.level.run(Slice { job, grid, slot, room: &mut room, bytes });
                        (wanted.done)();
                    }
                }
            }
            room.clock.end(Part::Planes);
            job.clock.lock().unwrap_or_else(PoisonError::into_inner).take(&mut room.clock);
            job.rooms.lock().unwrap_or_else(PoisonError::into_inner).push(room);
        });
        Ok(())
    }

    fn stages(&self) -> Option<Vec<(&'static str, Duration)>> {
        Some(self.clock.lock().unwrap_or_else(PoisonError::into_inner).stages())
    }
}

/// Slices whose errors are diffused together.
struct Diffused<'a, 'b, 'c> {
    job: &'a Job<'b>,
    grid: Grid,
    kernel: &'a Kernel,
    room: &'a mut Room,
    planes: &'a mut [(u32, &'c mut [u8])],
    done: &'a (dyn Fn() + Sync),
}

impl Work for Diffused<'_, '_, '_> {
    #[inline(always)]
    fn run<B: Block, const N: usize>(self) {
        let Self { job, grid, kernel, room, planes, done } = self;
        let [width, height] = grid.size.map(|side| side as usize);
        let mut greys = room.greys.take().unwrap_or_else(|| Greys::new(grid.size));
        let mut levels = core::mem::take(&mut room.levels);
        let mut seeds = [0; TOGETHER];
        let mut lit = Touched::NONE;
        for (lane, levels) in levels.iter_mut().enumerate() {
            levels.resize(width * height, 0);
            let Some((slice, _)) = planes.get(lane) else { continue };
            seeds[lane] = *slice;
            let touched = job.draw::<B, N, _>(&grid, *slice, room, &mut greys);
            greys.take([touched.first[1], touched.end[1]], grid.size, |y, values| {
                levels[y * width..][..width].copy_from_slice(values);
            });
            lit.add(touched.first, touched.end);
        }
        let slice_bytes = planes[0].1.len();
        room.spare.resize((TOGETHER - planes.len()) * slice_bytes, 0);
        let count = planes.len();
        let mut all = planes.iter_mut().map(|(_, plane)| &mut **plane).chain(room.spare.chunks_exact_mut(slice_bytes));
        let lanes = core::array::from_fn(|_| all.next().expect("a plane a lane"));
        let luminance = levels.each_ref().map(Vec::as_slice);
        let lit = lit.within(grid.size);
        let [_, rows] = lit.clone();
        diffuse_lanes(kernel, Slices { seeds, width: width as u32, luminance, lit, shade: linear }, lanes);
        levels.iter_mut().for_each(|levels| levels[rows.start * width..rows.end * width].fill(0));
        (0..count).for_each(|_| done());
        room.greys = Some(greys);
        room.levels = levels;
    }
}

/// One slice to be made.
struct Slice<'a, 'b> {
    job: &'a Job<'b>,
    grid: Grid,
    slot: Slot,
    room: &'a mut Room,
    bytes: &'a mut [u8],
}

impl Work for Slice<'_, '_> {
    #[inline(always)]
    fn run<B: Block, const N: usize>(self) {
        let Self { job, grid, slot, room, bytes } = self;
        let size = grid.size;
        if let Some(mask) = job.halftone.binary().and_then(|method| Mask::new(method, slot.slice, slot.turn)) {
            let mut bits = room.bits.take().unwrap_or_else(|| Bits::new(size));
            bits.tile.set(mask, size);
            let touched = job.draw::<B, N, _>(&grid, slot.slice, room, &mut bits);
            bytes.fill(0);
            bits.take::<B>([touched.first[0], touched.end[0]], [touched.first[1], touched.end[1]], size, bytes);
            room.bits = Some(bits);
            return;
        }
        let mut greys = room.greys.take().unwrap_or_else(|| Greys::new(size));
        let touched = job.draw::<B, N, _>(&grid, slot.slice, room, &mut greys);
        let rows = [touched.first[1], touched.end[1]];
        let width = size[0] as usize;
        match job.halftone.binary() {
            None => {
                bytes.fill(0);
                greys.take(rows, size, |y, values| {
                    for (byte, value) in bytes[y * width..].iter_mut().zip(values) {
                        *byte = (linear(*value) * 255.0 + 0.5) as u8;
                    }
                });
            }
            Some(method) => {
                room.luminances.clear();
                room.luminances.resize(width * size[1] as usize, 0.0);
                greys.take(rows, size, |y, values| {
                    for (luminance, value) in room.luminances[y * width..].iter_mut().zip(values) {
                        *luminance = linear(*value);
                    }
                });
                halftone(method, slot, size[0] as u32, &room.luminances, bytes);
            }
        }
        room.greys = Some(greys);
    }
}

/// A luminance from what [`raster::level`] made of it, or a gradient that has been rounded.
#[inline(always)]
fn linear(level: i16) -> f32 {
    f32::from(level).max(0.0) / (WHITE - 1.0)
}

impl Job<'_> {
    /// Draws a slice, and tells which pixels it has touched.
    #[inline(always)]
    fn draw<B: Block, const N: usize, S: Surface>(
        &self,
        grid: &Grid,
        slice: u32,
        room: &mut Room,
        surface: &mut S,
    ) -> Touched {
        let theta = self.rig.slice_angle(slice);
        let is_shared = self.faces.len() > 1;
        room.panels.clear();
        if is_shared {
            // Whose a pixel is does not depend on how V' is found.
            let panel = |face| SliceOptics::new(&self.rig, face, theta, Model::Planar);
            room.panels.extend((0..self.faces.len()).map(panel));
        }
        let shade = |index: usize, weights| shade(&self.mesh.triangles[index], &self.scene.textures, weights);
        let scene = Scene { figure: &self.figure, shade: &shade, grid: *grid };
        let mut touched = Touched::NONE;
        for (face, optics) in self.faces.iter().enumerate() {
            let projector = optics.slice(theta);
            room.panel.forget(grid.size);
            room.clock.end(Part::Planes);
            room.vertices.project(&self.figure, &projector, grid);
            room.clock.end(Part::Vertices);
            let panels = &room.panels;
            let shows = |[x, y]: [i32; 2]| {
                let centre = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                (!is_shared || owner(panels, centre) == Some(face))
                    && projector.sight(centre.as_vec2().to_array()).is_some()
            };
            let corner = |index: u32| self.corner(grid, &projector, index);
            let front = front(&self.rig, face, theta, &projector);
            let view = View { shows: &shows, is_shared, front, corner: &corner };
            draw::<B, N, S>(&scene, &view, &room.vertices, &mut room.panel, surface, &mut touched);
            room.clock.end(Part::Triangles);
        }
        touched
    }

    /// A vertex that 16 bits may be too narrow for, in the steps of [`Grid::finer`]: the same numbers as in [`Vertices`], but for their
    /// range.
    fn corner(&self, grid: &Grid, projector: &SliceProjector<f32>, index: u32) -> [i32; 3] {
        let position = self.mesh.positions[index as usize].as_vec3().to_array();
        let vertex = projector.vertices(position.each_ref().map(core::array::from_ref::<f32>));
        let place = |axis: usize| {
            let pixel = vertex.pixel[axis][0].clamp(-FAR_PX, FAR_PX);
            let steps = (pixel - grid.origin[axis] as f32) * grid.finer().steps() as f32;
            f64::from(steps).round_ties_even() as i32
        };
        [place(0), place(1), grid.depth(vertex.depth_m[0])]
    }
}
