//! The thread that renders: what is wished for, once for each turn of the mirror, with as much detail as there is time for.

use super::detail::Detail;
use super::focus::Focus;
use super::followed::Followed;
use super::hub::{Hub, Picture};
use super::library::Library;
use super::painter::{Failed, Key, Painter, View};
use super::stage::{Cast, Stage, StageError, moves};
use super::telemetry::EventKind;
use super::wish::{Animation, Mode, Wish};
use crate::recording::{Entry, Layer, Stroke};
use crate::render::Renderer;
use crate::render::live::slices_seen_by;
use crate::stream::mailbox::Mailbox;
use protocol::rig::{Rig, TrackedViewer};
use std::collections::VecDeque;
use std::convert::Infallible;
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
/// What the thread has at hand.
pub struct Rendering {
    hub: Arc<Hub>,
    rig: Arc<Rig>,
    scenes: Arc<Library>,
    painter: Painter,
    mailbox: Mailbox<Picture>,
    display_radius_m: f64,
    triangles_max: usize,
    preparing: Option<(Cast, JoinHandle<Result<Stage, StageError>>)>,
    /// What was tried in vain: it is not tried again.
    refused: Option<Cast>,
    /// The wish that the stage follows.
    followed: Option<Wish>,
    detail: Detail,
    focus: Focus,
    /// What was painted last, or could not be.
    tried: Option<Key>,
    viewers: Followed,
    /// Counts turns.
    strokes: u64,
    /// Which recordings were told what is on the stage.
    recordings: u64,
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
            painter: Painter::new(Arc::clone(&rig), renderer),
            hub,
            rig,
            scenes,
            mailbox,
            display_radius_m,
            triangles_max: triangles_max as usize,
            preparing: None,
            refused: None,
            followed: None,
            detail: Detail::default(),
            focus: Focus::default(),
            tried: None,
            viewers: Followed::default(),
            strokes: 0,
            recordings: 0,
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
            self.tell_recordings();
            // Until another scene is ready the one that stands there goes on as it was.
            if self.painter.stage().is_none_or(|stage| stage.cast.scene() == wish.scene) {
                self.followed = Some(wish.clone());
            }
            let wish = match &self.followed {
                // Whoever chose another scene in the dark is not shown the old one meanwhile.
                Some(followed) if wish.mode == Mode::Scene => followed.clone(),
                Some(followed) => Wish { mode: wish.mode, pattern: wish.pattern, ..followed.clone() },
                None => wish,
            };
            let number = next.max((start.elapsed().as_secs_f64() / period) as u64);
            self.follow();
            let key = self.key(&wish, number);
            let Some(key) = key.filter(|key| self.tried.as_ref() != Some(key)) else {
                self.hub.wait_for_change(version, if self.preparing.is_some() { IDLE / 10 } else { IDLE });
                continue;
            };
            next = number + 1;
            let due = Duration::from_secs_f64(next as f64 * period).saturating_sub(start.elapsed());
            let rendered = catch_unwind(AssertUnwindSafe(|| self.render(&key, Instant::now() + due)));
            if let Err(Failed(reason)) = rendered.unwrap_or_else(|_| Err(Failed("the renderer failed".into()))) {
                self.fail(&wish, reason);
            }
            self.tried = Some(key);
        }
    }

    /// Sees who is there now.
    fn follow(&mut self) {
        self.viewers = Followed::now(&self.hub, &self.rig, &self.viewers);
        self.hub.tell(|telemetry| telemetry.viewers = self.viewers.seen());
    }

    /// A recording that has begun is told what is on the stage, and what follows depends on nothing before.
    fn tell_recordings(&mut self) {
        let recordings = self.hub.recordings();
        if recordings != self.recordings {
            self.recordings = recordings;
            self.painter.begin_anew();
            self.tried = None;
            if let Some(stage) = self.painter.stage() {
                self.hub.record(|| Entry::Stage(stage.cast.clone()));
            }
        }
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
        let is_there = self.painter.stage().is_some_and(|stage| stage.cast == cast);
        if is_there || self.preparing.is_some() || self.refused.as_ref() == Some(&cast) {
            return;
        }
        let (library, rig, before) = (Arc::clone(&self.scenes), Arc::clone(&self.rig), self.painter.stage().cloned());
        let (radius, triangles_max, wanted) = (self.display_radius_m, self.triangles_max, cast.clone());
        let is_new = before.as_ref().is_none_or(|before| before.cast.scene() != cast.scene());
        self.hub.tell(|telemetry| {
            telemetry.loading = is_new.then(|| cast.scene().into());
            telemetry.planning = !is_new;
        });
        let work = move || Stage::prepare(&wanted, before.as_ref(), &library, &rig, radius, triangles_max);
        let job = std::thread::spawn(move || apart(work));
        self.preparing = Some((cast, job));
    }

    fn take(&mut self, stage: Stage) {
        let is_new = self.painter.stage().is_none_or(|before| before.cast.scene() != stage.cast.scene());
        self.hub.tell(|telemetry| {
            (telemetry.loading, telemetry.planning, telemetry.scene_error) = (None, false, None);
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
        self.leave_clip(&stage);
        self.refused = None;
        (self.detail, self.focus, self.tried) = (Detail::default(), Focus::default(), None);
        self.hub.record(|| Entry::Stage(stage.cast.clone()));
        self.painter.set_stage(stage);
    }

    /// A scene without the clip that went on in the one before stands still.
    fn leave_clip(&self, stage: &Stage) {
        let (wish, _) = self.hub.wish();
        if wish.scene != stage.cast.scene() {
            return;
        }
        if let Err(error) = stage.clip(&wish.animation) {
            self.hub.event(EventKind::Warning, format!("{error}: it stands still"));
            let Ok(_) =
                self.hub.change_wish(|wish| Ok::<_, Infallible>(Wish { animation: Animation::Still, ..wish.clone() }));
        }
    }

    /// What is wished for cannot be shown: what stood there stays.
    fn refuse(&mut self, reason: String) {
        self.hub.event(EventKind::Warning, reason.clone());
        self.hub.tell(|telemetry| {
            (telemetry.loading, telemetry.planning, telemetry.scene_error) = (None, false, Some(reason));
        });
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
    fn key(&self, wish: &Wish, number: u64) -> Option<Key> {
        match wish.mode {
            Mode::Freeze => None,
            Mode::Blank => Some(Key::Dark),
            Mode::Pattern => Some(Key::Pattern(wish.pattern)),
            Mode::Scene => {
                // A transform is followed at once, by the plan that there is; another scene when it is ready.
                let rung = self.detail.rung().min(self.painter.stage()?.plans.len() - 1);
                let moment = if moves(&wish.animation) { number } else { 0 };
                let view = View { wish: wish.clone(), rung, moment, viewers: self.viewers.seen() };
                Some(Key::Scene(Box::new(view)))
            }
        }
    }

    /// Renders and offers what `key` says; the next turn is `due`.
    fn render(&mut self, key: &Key, due: Instant) -> Result<(), Failed> {
        let seen = self.focus_on(key);
        let slices = seen.clone().unwrap_or_else(|| self.painter.changed(key));
        let began = Instant::now();
        let planes = self.painter.paint(key, &slices)?;
        let mut took = began.elapsed();
        self.strokes += 1;
        let number = self.strokes;
        self.hub.record(|| {
            Entry::Stroke(Box::new(Stroke::new(number, key, Layer::Front, &slices, Some(&planes.turn), took)))
        });
        let picture = Picture { planes, seen_at: self.news(key), stroke: number };
        self.mailbox.offer(picture);
        let Key::Scene(view) = key else { return Ok(()) };
        let mut count = slices.len();
        match &seen {
            Some(seen) => {
                self.focus.took_seen(count, took);
                let ahead = self.paint_ahead(view, seen, due)?;
                (took, count) = (took + ahead.0, count + ahead.1);
            }
            None if count == self.rig.rotation.slices as usize => self.focus.took_whole(count, took),
            None => {}
        }
        let period = Duration::from_secs_f64(1.0 / self.rig.turns_per_second());
        let rungs = self.painter.stage().map_or(1, |stage| stage.plans.len());
        // What stands still has all the time that it needs.
        if moves(&view.wish.animation) && self.detail.after(took, period, rungs) {
            tracing::info!(rung = self.detail.rung(), "the detail follows the time that rendering takes");
        }
        self.tell(took, count as u32, view);
        tracing::trace!(number, took_ms = took.as_secs_f64() * 1e3, "rendered");
        Ok(())
    }

    /// The slices that those who are followed see, where only they are rendered in each turn.
    fn focus_on(&self, key: &Key) -> Option<Vec<u32>> {
        let Key::Scene(view) = key else { return None };
        let is_of_use = moves(&view.wish.animation) && !view.viewers.is_empty() && self.painter.may_join(view);
        let plan = self.painter.plan(view).filter(|_| is_of_use)?;
        let viewers: Vec<_> = view.viewers.iter().map(TrackedViewer::from).collect();
        let seen = slices_seen_by(&viewers, &self.rig, &plan);
        let period = Duration::from_secs_f64(1.0 / self.rig.turns_per_second());
        self.focus.applies(seen.len(), self.rig.rotation.slices as usize, period).then_some(seen)
    }

    /// Renders some of the slices that are not `seen` for the turn after `view`: how long it took, and how many.
    fn paint_ahead(&mut self, view: &View, seen: &[u32], due: Instant) -> Result<(Duration, usize), Failed> {
        let left = due.saturating_duration_since(Instant::now());
        let slices = self.focus.others(seen, self.rig.rotation.slices, left);
        let view = View { moment: view.moment + 1, ..view.clone() };
        let began = Instant::now();
        self.painter.paint_ahead(&view, &slices)?;
        let took = began.elapsed();
        self.focus.took_others(slices.len(), took);
        let (number, key) = (self.strokes, Key::Scene(Box::new(view)));
        self.hub.record(|| Entry::Stroke(Box::new(Stroke::new(number, &key, Layer::Ahead, &slices, None, took))));
        Ok((took, slices.len()))
    }

    /// When the newest of the tracker's readings was taken by which `key` is rendered, where that is news.
    fn news(&self, key: &Key) -> Option<Instant> {
        let viewers = |key: &Key| match key {
            Key::Scene(view) => view.viewers.clone(),
            Key::Dark | Key::Pattern(_) => Vec::new(),
        };
        let is_news = self.tried.as_ref().is_none_or(|tried| viewers(tried) != viewers(key));
        self.viewers.read_at().filter(|_| is_news).map(|at| self.hub.start() + at)
    }

    fn tell(&mut self, took: Duration, slices: u32, view: &View) {
        let now = Instant::now();
        self.finished.push_back(now);
        while self.finished.front().is_some_and(|at| now - *at > WINDOW) {
            self.finished.pop_front();
        }
        let budget_px = view.wish.budget_px * f64::from(1_u32 << view.rung.min(16));
        let plan = self.painter.plan(view).map(|plan| plan.to_string()).unwrap_or_default();
        let error_px = self.painter.stage().map_or(0.0, |stage| stage.plans[view.rung].error_px);
        self.hub.metrics.render_seconds.observe(took.as_secs_f64());
        self.hub.metrics.budget_px.set(budget_px);
        let is_cheapest = self.painter.stage().is_none_or(|stage| view.rung + 1 == stage.plans.len());
        let is_whole = self.refused.is_none();
        self.hub.tell(|telemetry| {
            telemetry.render_ms = took.as_secs_f64() * 1e3;
            telemetry.rendered_slices = slices;
            telemetry.renders_per_second = self.finished.len() as f64;
            (telemetry.plan, telemetry.error_px, telemetry.budget_px) = (plan, error_px, budget_px);
            telemetry.cheapest = is_cheapest;
            if is_whole {
                telemetry.scene_error = None;
            }
        });
    }
}

/// Does `work` on threads of its own: on those that render, each of its parts would wait for a whole turn, and a scene for a minute.
fn apart<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    match rayon::ThreadPoolBuilder::new().build() {
        Ok(threads) => threads.install(work),
        Err(_) => work(),
    }
}

fn later(time: Instant, seconds: f64) -> Instant {
    let by = Duration::from_secs_f64(seconds.abs());
    if seconds < 0.0 { time.checked_sub(by).unwrap_or(time) } else { time + by }
}
