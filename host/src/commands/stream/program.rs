//! What is to be seen when: scenes one after the other, still or moving.

use super::{Args, Motion, Picture};
use crate::commands::args::{busy, filling_extent_m};
use crate::commands::{Failure, warn};
use crate::halftoned::Halftoned;
use crate::render::bow::reach_m;
use crate::render::plan::{Halftone, Plan};
use crate::render::precut::Precut;
use crate::render::turn::Turn;
use crate::render::{Renderer, Wanted, dark_turn};
use crate::scene::{Animated, BUILTIN, Scene, ShadedScene, Shading, shade};
use crate::stream::mailbox::Mailbox;
use protocol::rig::Rig;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A turn that nobody took for so long is not what is to be seen now: it is rendered anew.
const STALE: Duration = Duration::from_millis(250);

/// A scene and how it moves.
struct Act {
    name: String,
    scene: Animated,
    /// The clip that is played.
    clip: Option<usize>,
    /// Degrees that it turns in a turn of the mirror.
    spin_deg: f64,
    plan: Plan,
    /// Its cuts, where they stay the same while it moves.
    cut: Option<Precut>,
}

/// Scenes, each for so many turns of the mirror.
pub(super) struct Program {
    acts: Vec<Act>,
    hold: u64,
    turns_per_second: f64,
}

/// How rendering went.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rendering {
    /// Turns that were rendered.
    pub turns: u64,
    /// What they took.
    pub time: Duration,
}

impl Program {
    /// The scenes of the command line.
    pub(super) fn load(args: &Args, rig: &Rig) -> Result<Self, Failure> {
        let load = |name: &String| Act::load(name, args.animate, args, rig);
        let acts = args.scenes.iter().map(load).collect::<Result<Vec<_>, _>>()?;
        if args.animate == Some(Motion::Clip) {
            let still: Vec<_> = acts.iter().filter(|act| act.clip.is_none()).collect();
            match &still[..] {
                [first, ..] if still.len() == acts.len() => return Err(first.no_clip(args.clip.as_deref())),
                still => {
                    for act in still {
                        let Failure(why) = act.no_clip(args.clip.as_deref());
                        warn(format!("{why}: stands still"));
                    }
                }
            }
        }
        Ok(Self { acts, hold: args.hold, turns_per_second: rig.turns_per_second() })
    }

    /// What stands when turns stop coming.
    pub(super) fn attract(args: &Args, rig: &Rig) -> Result<Self, Failure> {
        let acts = vec![Act::load(BUILTIN, None, args, rig)?];
        Ok(Self { acts, hold: 1, turns_per_second: rig.turns_per_second() })
    }

    /// Which act is on in turn `number` of the mirror, and in which of its moments. What stands still has one moment.
    fn moment(&self, number: u64) -> (usize, u64) {
        let act = (number / self.hold % self.acts.len() as u64) as usize;
        (act, if self.acts[act].moves() { number } else { 0 })
    }

    /// What is to be seen in turn `number` of the mirror.
    pub(super) fn picture(&self, renderer: &dyn Renderer, rig: &Rig, number: u64) -> Result<Picture, Failure> {
        self.picture_in(&mut Vec::new(), renderer, rig, number)
    }

    /// The same, in the memory of one of `kept` that nobody else holds any more, if there is one; new ones are added.
    fn picture_in(
        &self,
        kept: &mut Vec<Arc<Turn>>,
        renderer: &dyn Renderer,
        rig: &Rig,
        number: u64,
    ) -> Result<Picture, Failure> {
        let (act, moment) = self.moment(number);
        let act = &self.acts[act];
        let (pieces, plan) = act.pieces(moment, self.turns_per_second)?;
        let free = kept.iter().position(|turn| Arc::strong_count(turn) == 1);
        let mut turn = match free {
            Some(free) => kept.swap_remove(free),
            None => Arc::new(dark_turn(rig, &act.plan)?),
        };
        let slices: Vec<_> = (0..rig.rotation.slices).collect();
        let wanted = Wanted { slices: &slices, number: 0, done: &|| () };
        renderer.prepare(&pieces, rig, &plan)?.render(wanted, Arc::make_mut(&mut turn))?;
        kept.push(Arc::clone(&turn));
        Ok(Halftoned { turn, halftone: act.plan.halftone, number: 0 })
    }

    /// Renders into `mailbox` what is to be seen now, until nobody wants more.
    pub(super) fn render(
        &self,
        renderer: &dyn Renderer,
        rig: &Rig,
        mailbox: &Mailbox<Picture>,
    ) -> Result<Rendering, Failure> {
        let (start, mut rendering) = (Instant::now(), Rendering::default());
        let mut last: Option<((usize, u64), Picture)> = None;
        let (mut next, mut kept) = (0, Vec::new());
        loop {
            mailbox.wait(STALE);
            if mailbox.is_closed() {
                return Ok(rendering);
            }
            // At most one for each turn of the mirror.
            let turns = start.elapsed().as_secs_f64() * self.turns_per_second;
            if turns < next as f64 {
                std::thread::sleep(Duration::from_secs_f64((next as f64 - turns) / self.turns_per_second));
            }
            let number = next.max(turns as u64);
            let moment = self.moment(number);
            next = number + 1;
            if mailbox.is_full() && last.as_ref().is_some_and(|(rendered, _)| *rendered == moment) {
                continue;
            }
            let picture = match last.take().filter(|(rendered, _)| *rendered == moment) {
                Some((_, picture)) => picture,
                None => {
                    let began = Instant::now();
                    let picture = self.picture_in(&mut kept, renderer, rig, number)?;
                    rendering.turns += 1;
                    rendering.time += began.elapsed();
                    picture
                }
            };
            mailbox.offer(picture.clone());
            last = Some((moment, picture));
        }
    }
}

impl Act {
    fn load(name: &str, motion: Option<Motion>, args: &Args, rig: &Rig) -> Result<Self, Failure> {
        let mut scene = {
            let _busy = busy("loading the scene");
            Animated::load(name)?
        };
        for note in &scene.at_rest().notes {
            warn(format!("{name}: {note}"));
        }
        let clip = match motion {
            Some(Motion::Clip) => clip(&scene, args.clip.as_deref()),
            _ => None,
        };
        if let Some(extent_m) = filling_extent_m(name, scene.at_rest(), rig)? {
            scene.fit(extent_m)?;
        }
        let lit = shade(scene.at_rest(), Shading::Lambert, false);
        let plan = args.plan.choose(&lit, rig)?.choice.chosen.plan;
        let plan = Plan { halftone: args.halftone, ..plan };
        if plan.halftone == Halftone::Grey {
            return Err(Failure("--halftone grey: a projector shows bits; allowed is any other".into()));
        }
        let spin_deg = if motion == Some(Motion::Spin) { args.spin_deg } else { 0.0 };
        let mut cut = if clip.is_none() && spin_deg != 0.0 { Precut::new(&lit, &plan, reach_m(rig)) } else { None };
        if let Some(cut) = &mut cut {
            cut.refine(rig)?;
        }
        Ok(Self { name: name.into(), scene, clip, spin_deg, plan, cut })
    }

    /// That it has no such clip, and which it has.
    fn no_clip(&self, wanted: Option<&str>) -> Failure {
        let names: Vec<_> = self.scene.clips().iter().map(|clip| clip.name.as_str()).collect();
        let allowed = if names.is_empty() { "it has none".into() } else { format!("it has {}", names.join(", ")) };
        let wanted = wanted.map(|name| format!(" {name}")).unwrap_or_default();
        Failure(format!("{}: no clip{wanted}: {allowed}", self.name))
    }

    fn moves(&self) -> bool {
        self.clip.is_some() || self.spin_deg != 0.0
    }

    /// What is drawn in turn `number` of a mirror that turns so often a second, and by which plan.
    fn pieces(&self, number: u64, turns_per_second: f64) -> Result<(ShadedScene, Plan), Failure> {
        let lit = shade(&self.at(number, turns_per_second)?, Shading::Lambert, false);
        Ok(match &self.cut {
            Some(cut) => (cut.of(&lit, self.turned_deg(number).to_radians()), cut.plan()),
            None => (lit, self.plan),
        })
    }

    fn turned_deg(&self, number: u64) -> f64 {
        (number as f64 * self.spin_deg) % 360.0
    }

    /// The scene in turn `number` of a mirror that turns so often a second.
    fn at(&self, number: u64, turns_per_second: f64) -> Result<Scene, Failure> {
        let scene = match self.clip {
            Some(clip) => {
                let length = self.scene.clips()[clip].seconds;
                let seconds = number as f64 / turns_per_second;
                let moment = if length > 0.0 { seconds % length } else { 0.0 };
                self.scene.at(clip, moment).map_err(|error| Failure(format!("{}: {error}", self.name)))?
            }
            None => self.scene.at_rest().clone(),
        };
        let degrees = self.turned_deg(number);
        Ok(if degrees == 0.0 { scene } else { scene.turned(degrees as f32) })
    }
}

/// The clip of this name, or the first.
fn clip(scene: &Animated, wanted: Option<&str>) -> Option<usize> {
    scene.clips().iter().position(|clip| wanted.is_none_or(|wanted| clip.name == wanted))
}
