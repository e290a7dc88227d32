//! The thread that renders: what is wished for, once for each turn of the mirror, with as much detail as there is time for.

use super::cuts::Cuts;
use super::detail::Detail;
use super::followed::Followed;
use super::hub::{Hub, Picture};
use super::library::Library;
use super::stage::{Cast, Stage, StageError, moves};
use super::telemetry::EventKind;
use super::wish::{Mode, Wish};
use crate::halftoned::Halftoned;
use crate::pattern::{Pattern, draw};
use crate::render::live::slices_of_moved_viewers;
use crate::render::plan::{Halftone, Plan};
use crate::render::turn::Turn;
use crate::render::{RenderError, Renderer, Wanted, dark_turn};
use crate::stream::mailbox::Mailbox;
use protocol::rig::Rig;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A turn that nobody took for so long is not what is to be seen now: it is rendered anew.
const STALE: Duration = Duration::from_millis(250);
/// How often somebody who has nothing to render looks up.
const IDLE: Duration = Duration::from_millis(250);
/// Rates are of so long a time.
const WINDOW: Duration = Duration::from_secs(1);
/// Turns that may be in somebody's hands: on screen, waiting, being sent, in the mailbox, being rendered.
const TURNS: usize = 6;

/// What makes a picture: the same key is the same picture.
#[derive(Clone, Debug, PartialEq)]
enum Key {
    Dark,
    Pattern(Pattern),
    Scene { cast: Cast, wish: Box<Wish>, plan: Plan, moment: u64, followed: Followed },
}

impl Key {
    /// Whether it is the same as `other` but for where viewers are.
    fn is_of_same_scene(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Scene { followed, .. }, Self::Scene { cast, wish, plan, moment, .. }) => {
                let (cast, wish, followed) = (cast.clone(), wish.clone(), followed.clone());
                *self == Self::Scene { cast, wish, plan: *plan, moment: *moment, followed }
            }
            _ => false,
        }
    }

    fn followed(&self) -> Option<&Followed> {
        match self {
            Self::Scene { followed, .. } => Some(followed),
            Self::Dark | Self::Pattern(_) => None,
        }
    }
}

/// What the thread has at hand.
pub struct Rendering {
    hub: Arc<Hub>,
    rig: Arc<Rig>,
    scenes: Arc<Library>,
    renderer: Box<dyn Renderer>,
    mailbox: Mailbox<Picture>,
    display_radius_m: f64,
    triangles_max: usize,
    stage: Option<Stage>,
    preparing: Option<(Cast, JoinHandle<Result<Stage, StageError>>)>,
    /// What was tried in vain: it is not tried again.
    refused: Option<Cast>,
    /// The wish that the stage follows.
    followed: Option<Wish>,
    cuts: Cuts,
    detail: Detail,
    turns: Vec<Arc<Turn>>,
    /// What stands there: what it is, and its turn.
    last: Option<(Key, Option<Arc<Turn>>)>,
    finished: VecDeque<Instant>,
}

impl Rendering {
    /// A thread's worth of them.
    pub fn new(
        hub: Arc<Hub>,
        rig: Arc<Rig>,
        scenes: Arc<Library>,
        renderer: Box<dyn Renderer>,
        mailbox: Mailbox<Picture>,
        [display_radius_m, triangles_max]: [f64; 2],
    ) -> Self {
        hub.tell(|telemetry| telemetry.renderer = renderer.name());
        Self {
            hub,
            rig,
            scenes,
            renderer,
            mailbox,
            display_radius_m,
            triangles_max: triangles_max as usize,
            stage: None,
            preparing: None,
            refused: None,
            followed: None,
            cuts: Cuts::default(),
            detail: Detail::default(),
            turns: Vec::new(),
            last: None,
            finished: VecDeque::new(),
        }
    }

    /// Renders until the daemon ends.
    pub fn run(mut self) {
        let (mut start, period) = (Instant::now(), 1.0 / self.rig.turns_per_second());
        let mut next = 0;
        while !self.hub.is_stopping() {
            self.mailbox.wait(STALE);
            start = later(start, self.hub.take_delay_s());
            // At most one for each turn of the mirror.
            let early = next as f64 * period - start.elapsed().as_secs_f64();
            if early > 0.0 {
                std::thread::sleep(Duration::from_secs_f64(early));
            }
            let (wish, version) = self.hub.wish();
            self.prepare(&wish);
            // Until another scene is ready the one that stands there goes on as it was.
            if self.stage.as_ref().is_none_or(|stage| stage.cast.scene() == wish.scene) {
                self.followed = Some(wish.clone());
            }
            let wish = match &self.followed {
                // Whoever chose another scene in the dark is not shown the old one meanwhile.
                Some(followed) if wish.mode == Mode::Scene => followed.clone(),
                Some(followed) => Wish { mode: wish.mode, pattern: wish.pattern, ..followed.clone() },
                None => wish,
            };
            let number = next.max((start.elapsed().as_secs_f64() / period) as u64);
            let viewers = self.viewers();
            let key = self.key(&wish, number, viewers);
            let Some(key) = key.filter(|key| self.last.as_ref().is_none_or(|(last, _)| last != key)) else {
                self.hub.wait_for_change(version, if self.preparing.is_some() { IDLE / 10 } else { IDLE });
                continue;
            };
            next = number + 1;
            let rendered = catch_unwind(AssertUnwindSafe(|| self.render(&key, number)));
            let turn = match rendered.unwrap_or_else(|_| Err(Failed("the renderer failed".into()))) {
                Ok(picture) => {
                    let turn = Arc::clone(&picture.planes.turn);
                    self.mailbox.offer(picture);
                    Some(turn)
                }
                Err(Failed(reason)) => {
                    self.fail(&wish, reason);
                    None
                }
            };
            self.last = Some((key, turn));
        }
    }

    /// Who is there now.
    fn viewers(&self) -> Followed {
        let before = self.last.as_ref().and_then(|(key, _)| key.followed().cloned()).unwrap_or_default();
        let now = Followed::now(&self.hub, &self.rig, &before);
        self.hub.tell(|telemetry| telemetry.viewers = now.seen());
        now
    }

    /// Begins to prepare what is wished for, where it is not there, and takes what is ready.
    fn prepare(&mut self, wish: &Wish) {
        if let Some((cast, job)) = self.preparing.take_if(|(_, job)| job.is_finished()) {
            match job.join().unwrap_or_else(|_| {
                Err(StageError::Library(super::library::LibraryError::Refused {
                    name: cast.scene().into(),
                    reason: "preparing it failed".into(),
                }))
            }) {
                Ok(stage) => self.take(stage),
                Err(error) => {
                    self.refused = Some(cast);
                    self.refuse(error.to_string());
                }
            }
        }
        let cast = Cast::of(wish);
        let is_there = self.stage.as_ref().is_some_and(|stage| stage.cast == cast);
        if is_there || self.preparing.is_some() || self.refused.as_ref() == Some(&cast) {
            return;
        }
        let (library, rig, before) = (Arc::clone(&self.scenes), Arc::clone(&self.rig), self.stage.clone());
        let (radius, triangles_max, wanted) = (self.display_radius_m, self.triangles_max, cast.clone());
        if before.as_ref().is_none_or(|before| before.cast.scene() != cast.scene()) {
            self.hub.tell(|telemetry| telemetry.loading = Some(cast.scene().into()));
        }
        let job =
            std::thread::spawn(move || Stage::prepare(&wanted, before.as_ref(), &library, &rig, radius, triangles_max));
        self.preparing = Some((cast, job));
    }

    fn take(&mut self, stage: Stage) {
        let is_new = self.stage.as_ref().is_none_or(|before| before.cast.scene() != stage.cast.scene());
        self.hub.tell(|telemetry| {
            (telemetry.loading, telemetry.scene_error) = (None, None);
            telemetry.scene = Some(stage.cast.scene().into());
            telemetry.clips = stage.scene.clips().iter().map(|clip| clip.name.clone()).collect();
            telemetry.triangles = stage.scene.at_rest().triangles.len();
        });
        if is_new {
            self.hub.event(EventKind::Note, format!("scene {} is shown", stage.cast.scene()));
            for note in &stage.scene.at_rest().notes {
                self.hub.event(EventKind::Warning, format!("{}: {note}", stage.cast.scene()));
            }
        }
        self.refused = None;
        self.detail = Detail::default();
        self.cuts.clear();
        self.stage = Some(stage);
    }

    /// What is wished for cannot be shown: what stood there stays.
    fn refuse(&mut self, reason: String) {
        self.hub.event(EventKind::Warning, reason.clone());
        self.hub.tell(|telemetry| (telemetry.loading, telemetry.scene_error) = (None, Some(reason)));
    }

    fn fail(&mut self, wish: &Wish, reason: String) {
        let known = self.hub.telemetry().scene_error;
        if known.as_ref() != Some(&reason) {
            self.refuse(reason);
        }
        if !moves(&wish.animation) {
            return;
        }
        // What moves would fail again in the next turn.
        std::thread::sleep(IDLE);
    }

    /// What is to be seen in turn `number`; nothing where it is what stood there before, or not ready.
    fn key(&self, wish: &Wish, number: u64, followed: Followed) -> Option<Key> {
        match wish.mode {
            Mode::Freeze => None,
            Mode::Blank => Some(Key::Dark),
            Mode::Pattern => Some(Key::Pattern(wish.pattern)),
            Mode::Scene => {
                let stage = self.stage.as_ref()?;
                // A transform is followed at once, by the plan that there is; another scene when it is ready.
                let rung = self.detail.rung().min(stage.plans.len() - 1);
                let plan = Plan { halftone: wish.halftone, ..stage.plans[rung].plan };
                let moment = if moves(&wish.animation) { number } else { 0 };
                let (cast, wish) = (stage.cast.clone(), Box::new(wish.clone()));
                Some(Key::Scene { cast, wish, plan, moment, followed })
            }
        }
    }

    fn render(&mut self, key: &Key, number: u64) -> Result<Picture, Failed> {
        let (wish, plan, moment, followed) = match key {
            Key::Scene { wish, plan, moment, followed, .. } => (wish, plan, moment, followed),
            Key::Dark => {
                let plan = Plan { halftone: Halftone::BlueNoise, ..Plan::default() };
                return Ok(plain(dark_turn(&self.rig, &plan)?));
            }
            Key::Pattern(pattern) => return Ok(plain(draw(&self.rig, *pattern)?)),
        };
        let began = Instant::now();
        let stage = self.stage.as_ref().ok_or_else(|| Failed("there is no scene".into()))?;
        let clip = stage.clip(&wish.animation)?;
        let lit = stage.at(wish, clip, *moment, self.rig.turns_per_second())?;
        let (rungs, candidate) = (stage.plans.len(), stage.plans[self.detail.rung().min(stage.plans.len() - 1)]);
        let rig = followed.around(&self.rig);
        let (pieces, drawn) = self.cuts.of(lit, (stage, wish, *moment), &rig, plan)?;
        let mut turn = self.spare_turn(plan)?;
        let place = Arc::get_mut(&mut turn).ok_or_else(|| Failed("a turn in two hands".into()))?;
        let slices = self.changed(key, &rig, plan, place);
        let wanted = Wanted { slices: &slices, number: 0, done: &|| () };
        self.renderer.prepare(&pieces, &rig, &drawn)?.render(wanted, place)?;
        let took = began.elapsed();
        let period = Duration::from_secs_f64(1.0 / self.rig.turns_per_second());
        // What stands still has all the time that it needs.
        if moves(&wish.animation) && self.detail.after(took, period, rungs) {
            tracing::info!(rung = self.detail.rung(), "the detail follows the time that rendering takes");
        }
        self.tell(took, slices.len() as u32, candidate.error_px, plan, wish.budget_px);
        tracing::trace!(number, took_ms = took.as_secs_f64() * 1e3, "rendered");
        self.keep(&turn);
        let is_news = self.last.as_ref().is_none_or(|(last, _)| last.followed() != Some(followed));
        let seen_at = followed.read_at().filter(|_| is_news).map(|at| self.hub.start() + at);
        Ok(Picture { planes: Halftoned { turn, halftone: plan.halftone, number: 0 }, seen_at })
    }

    /// The slices that are other ones than in the turn that stands there; the others are copied from it into `turn`.
    fn changed(&self, key: &Key, rig: &Rig, plan: &Plan, turn: &mut Turn) -> Vec<u32> {
        let all = || (0..rig.rotation.slices).collect();
        match &self.last {
            Some((last, Some(standing))) if key.is_of_same_scene(last) => {
                let before = last.followed().unwrap_or(&Followed::default()).around(&self.rig);
                turn.bytes_mut().copy_from_slice(standing.bytes());
                slices_of_moved_viewers(&before, rig, plan)
            }
            _ => all(),
        }
    }

    /// A turn that nobody has in hand any more, or another one.
    fn spare_turn(&mut self, plan: &Plan) -> Result<Arc<Turn>, RenderError> {
        let spare = self.turns.iter().position(|turn| Arc::strong_count(turn) == 1);
        match spare {
            Some(place) => Ok(self.turns.swap_remove(place)),
            None => Ok(Arc::new(dark_turn(&self.rig, plan)?)),
        }
    }

    fn keep(&mut self, turn: &Arc<Turn>) {
        if self.turns.len() < TURNS {
            self.turns.push(Arc::clone(turn));
        }
    }

    fn tell(&mut self, took: Duration, slices: u32, error_px: f64, plan: &Plan, asked_px: f64) {
        let now = Instant::now();
        self.finished.push_back(now);
        while self.finished.front().is_some_and(|at| now - *at > WINDOW) {
            self.finished.pop_front();
        }
        let budget_px = asked_px * f64::from(1_u32 << self.detail.rung().min(16));
        self.hub.metrics.render_seconds.observe(took.as_secs_f64());
        self.hub.metrics.budget_px.set(budget_px);
        let is_whole = self.refused.is_none();
        self.hub.tell(|telemetry| {
            telemetry.render_ms = took.as_secs_f64() * 1e3;
            telemetry.rendered_slices = slices;
            telemetry.renders_per_second = self.finished.len() as f64;
            telemetry.plan = plan.to_string();
            telemetry.error_px = error_px;
            telemetry.budget_px = budget_px;
            if is_whole {
                telemetry.scene_error = None;
            }
        });
    }
}

fn later(time: Instant, seconds: f64) -> Instant {
    let by = Duration::from_secs_f64(seconds.abs());
    if seconds < 0.0 { time.checked_sub(by).unwrap_or(time) } else { time + by }
}

/// A turn without a scene.
fn plain(turn: Turn) -> Picture {
    Picture { planes: Halftoned { turn: Arc::new(turn), halftone: Halftone::BlueNoise, number: 0 }, seen_at: None }
}

/// Why there is no picture.
struct Failed(String);

impl<E: std::error::Error> From<E> for Failed {
    fn from(error: E) -> Self {
        Self(error.to_string())
    }
}
