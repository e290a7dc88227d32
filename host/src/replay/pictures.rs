//! What was painted is painted again.

use super::{Compared, ReplayError};
use crate::daemon::library::Library;
use crate::daemon::painter::{Failed, Key, Painter, View, around};
use crate::daemon::stage::{Cast, Stage};
use crate::halftoned::Halftoned;
use crate::recording::{Layer, SECTORS, Stroke, sectors};
use crate::render::Renderer;
use crate::render::turn::Turn;
use protocol::rig::Rig;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Arc;

/// So many turns are kept until they are sent.
const KEPT: usize = 8;

/// A painter who follows a recording.
pub(super) struct Pictures {
    rig: Arc<Rig>,
    painter: Painter,
    library: Library,
    scene: Option<PathBuf>,
    display_radius_m: f64,
    triangles_max: usize,
    /// Whether what follows depends on nothing before the recording.
    is_begun: bool,
    turns: VecDeque<(u64, Halftoned<Arc<Turn>>)>,
}

impl Pictures {
    pub(super) fn new(
        rig: Arc<Rig>,
        renderer: Box<dyn Renderer>,
        (library, scene): (Library, Option<PathBuf>),
        (display_radius_m, triangles_max): (f64, usize),
    ) -> Self {
        let painter = Painter::new(Arc::clone(&rig), renderer);
        let (is_begun, turns) = (false, VecDeque::new());
        Self { rig, painter, library, scene, display_radius_m, triangles_max, is_begun, turns }
    }

    /// Brings `cast` on the stage.
    pub(super) fn stage(&mut self, cast: &Cast) -> Result<(), ReplayError> {
        let failed = |reason: String| ReplayError::Scene(cast.scene().into(), reason);
        cast.check().map_err(|error| failed(error.to_string()))?;
        let Self { library, rig, .. } = self;
        if let Some(scene) = self.scene.as_ref().filter(|_| library.find(cast.scene()).is_err()) {
            library.give_as(cast.scene(), scene)?;
        }
        library.find(cast.scene())?;
        let stage = Stage::prepare(cast, self.painter.stage(), library, rig, self.display_radius_m, self.triangles_max);
        self.painter.set_stage(stage.map_err(|error| failed(error.to_string()))?);
        self.is_begun = true;
        Ok(())
    }

    /// Paints `stroke` again.
    pub(super) fn paint(&mut self, at_s: f64, stroke: &Stroke, turns: &mut Compared) {
        if stroke.view().is_some() && !self.is_begun {
            return;
        }
        if let Err(reason) = stroke.view().map_or(Ok(()), |view| self.check(view)) {
            turns.differs(at_s, format!("turn {}: {reason}", stroke.number));
            return;
        }
        let slices = stroke.slices(self.rig.rotation.slices);
        let painted = match (stroke.layer, &stroke.key) {
            (Layer::Ahead, Key::Scene(view)) => self.painter.paint_ahead(view, &slices),
            (Layer::Ahead, _) => Ok(()),
            (Layer::Front, key) => self.painter.paint(key, &slices).map(|planes| {
                turns.count += 1;
                let (here, was) = (sectors(&planes.turn), stroke.sectors);
                if was != Some(here) {
                    turns.differs(at_s, format!("turn {}: {}", stroke.number, elsewhere(&here, was.as_ref())));
                }
                self.turns.push_back((stroke.number, planes));
                if self.turns.len() > KEPT {
                    self.turns.pop_front();
                }
            }),
        };
        if let Err(Failed(reason)) = painted {
            turns.differs(at_s, format!("turn {}: {reason}", stroke.number));
        }
    }

    /// Whether `view` can be painted: a file may say anything.
    fn check(&self, view: &View) -> Result<(), String> {
        view.wish.check().map_err(|error| error.to_string())?;
        around(&self.rig, &view.viewers).checked().map(drop).map_err(|error| error.to_string())
    }

    /// The turn whose stroke has this number, if it was among the last.
    pub(super) fn of(&self, stroke: u64) -> Option<Halftoned<Arc<Turn>>> {
        self.turns.iter().find(|(number, _)| *number == stroke).map(|(_, planes)| planes.clone())
    }
}

/// Where two turns differ, by their sectors.
fn elsewhere(here: &[u32; SECTORS], was: Option<&[u32; SECTORS]>) -> String {
    let Some(was) = was else { return "without checksums".into() };
    let degrees = 360 / SECTORS;
    let differ = (0..SECTORS).filter(|sector| here[*sector] != was[*sector]);
    let ranges: Vec<_> =
        differ.map(|sector| format!("{}\u{2013}{}°", sector * degrees, (sector + 1) * degrees)).collect();
    format!("other planes at mirror angles {}", ranges.join(", "))
}
