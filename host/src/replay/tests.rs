use super::*;
use crate::daemon::painter::{Key, Painter, View};
use crate::daemon::stage::{Cast, Stage};
use crate::daemon::telemetry::{Event, EventKind, SeenViewer, Telemetry};
use crate::daemon::wish::Wish;
use crate::recording::file::{Entries, Writer};
use crate::recording::{Eye, Layer, Sent, Stroke};
use crate::render::fast::FastRenderer;
use crate::render::plan::Halftone;
use glam::DVec3;
use proptest::prelude::*;
use protocol::message::Command;
use protocol::rig::Rig;
use std::collections::BTreeMap;
use std::time::Duration;

const BEGAN_NS: u64 = 1_700_000_000_123_456_789;

fn rig() -> Rig {
    let mut rig = crate::rigs::find("reference").unwrap();
    (rig.rotation.slices, rig.rotation.refresh_hz) = (48, 40.0);
    rig.mirror.face[0].diffuser_hat_radius_deg = Some(7.5);
    (rig.projector.width_px, rig.projector.height_px) = (96, 96);
    (rig.projector.focal_px, rig.projector.principal_px) = (Some(384.0), Some([48.0; 2]));
    rig.checked().unwrap()
}

fn setup(heads: BTreeMap<u16, crate::tracking::filter::Filter>) -> Entry {
    Entry::Setup(Box::new(Setup {
        version: "0".into(),
        began_unix_ns: BEGAN_NS,
        rig: rig(),
        device: "sim".into(),
        seed: 3,
        by_video: false,
        triangles_max: 1_000_000,
        heads,
    }))
}

fn means(folder: &tempfile::TempDir) -> Means {
    Means { renderer: Box::new(FastRenderer::new()), scene: None, folder: folder.path().join("scenes") }
}

/// A second in which somebody walks past a knot that turns: half the slices in each turn, the others round and round.
fn recorded() -> Vec<Timed> {
    let folder = tempfile::tempdir().unwrap();
    let rig = Arc::new(rig());
    let library = Library::open(folder.path().into(), Default::default(), PathBuf::new()).unwrap();
    let wish = Wish { scene: "boxes".into(), ..crate::daemon::wish::tests::wish() };
    let wish = Wish { animation: crate::daemon::wish::Animation::SPIN, ..wish };
    let cast = Cast::of(&wish);
    let stage = Stage::prepare(&cast, None, &library, &rig, display_radius_m(&rig), 1_000_000).unwrap();
    let mut painter = Painter::new(Arc::clone(&rig), Box::new(FastRenderer::new()));
    painter.set_stage(stage);
    let mut viewers = Viewers::new(&Default::default());
    let mut entries = vec![setup(BTreeMap::new()), Entry::Stage(cast), Entry::Order(Command::Start)];
    for moment in 0..12 {
        let at = Duration::from_millis(1_000 + 50 * moment);
        let angle = 0.03 * moment as f64;
        let eye = Eye { id: 2049, position_m: DVec3::new(0.8 * angle.sin(), 0.41, 0.8 * angle.cos()), at };
        let taken = viewers.take_eye(eye.id, eye.position_m, eye.at);
        entries.push(Entry::Eye(Arrived::new(Some(eye), taken)));
        let light_at = at + Duration::from_millis(73);
        let there = viewers.at(light_at);
        let seen = crate::daemon::followed::Followed { viewers: there.clone() }.seen();
        entries.push(Entry::Viewers(Expected { light_at, viewers: there }));
        let view = |moment: u64, viewers: Vec<SeenViewer>| View { wish: wish.clone(), rung: 0, moment, viewers };
        let front = view(moment, seen.clone());
        let slices: Vec<u32> = if moment == 0 { (0..48).collect() } else { (0..24).collect() };
        let key = Key::Scene(Box::new(front));
        let planes = painter.paint(&key, &slices).unwrap();
        let took = Duration::from_millis(3);
        let stroke = Stroke::new(moment + 1, &key, Layer::Front, &slices, Some(&planes.turn), took);
        entries.push(Entry::Stroke(Box::new(stroke)));
        let ahead = view(moment + 1, seen);
        let first = 24 + 6 * (moment as u32 % 4);
        let slices: Vec<u32> = (first..first + 6).collect();
        painter.paint_ahead(&ahead, &slices).unwrap();
        let key = Key::Scene(Box::new(ahead));
        entries.push(Entry::Stroke(Box::new(Stroke::new(moment + 1, &key, Layer::Ahead, &slices, None, took))));
    }
    (0..).zip(entries).map(|(number, entry)| (BEGAN_NS + number * 20_000_000, entry)).collect()
}

fn told(entries: impl IntoIterator<Item = Timed>) -> Report {
    let folder = tempfile::tempdir().unwrap();
    let mut entries = entries.into_iter();
    let mut replay = Replay::begin(entries.next().unwrap(), means(&folder)).unwrap();
    entries.for_each(|entry| replay.tell(entry).unwrap());
    replay.end(false).unwrap()
}

fn written(entries: &[Timed]) -> Vec<u8> {
    let mut writer = Writer::new(Vec::new()).unwrap();
    for (place, entry) in entries.iter().enumerate() {
        writer.write(entry).unwrap();
        if place % 7 == 6 {
            writer.flush().unwrap();
        }
    }
    writer.finish().unwrap()
}

#[test]
fn numbers_come_back_from_a_file_bit_for_bit() {
    let entries = recorded();
    let bytes = written(&entries);
    let mut read = Entries::new(bytes.as_slice());
    assert_eq!(Vec::from_iter(read.by_ref().map(Result::unwrap)), entries);
    assert!(!read.is_cut());
}

#[test]
fn every_kind_of_entry_comes_back() {
    let wish = crate::daemon::wish::tests::wish();
    let event = Event { number: 3, unix_s: 0.1, kind: EventKind::Note, text: "text".into() };
    let kinds = vec![
        Entry::Wish(Box::new(wish)),
        Entry::Reading(Arrived::new(None, Err(Refusal::Malformed))),
        Entry::Action(serde_json::json!({ "load": { "torque_nm": -0.2 } })),
        Entry::Controller(Controller { state: Some("locked".into()), ..Controller::default() }),
        Entry::Sent(Sent { stroke: 4, turn: 9 }),
        Entry::telemetry(&Telemetry::default()),
        Entry::Event(event),
        Entry::Lost { entries: 7 },
    ];
    let entries: Vec<Timed> = recorded().into_iter().chain(kinds.into_iter().map(|entry| (u64::MAX, entry))).collect();
    let bytes = written(&entries);
    assert_eq!(Vec::from_iter(Entries::new(bytes.as_slice()).map(Result::unwrap)), entries);
}

#[test]
fn what_no_daemon_records_is_told_or_refused() {
    let spoilt = |spoil: &dyn Fn(&mut Stroke)| {
        let mut entries = recorded();
        for (_, entry) in &mut entries {
            if let Entry::Stroke(stroke) = entry {
                spoil(stroke);
            }
        }
        told(entries).turns
    };
    fn view(stroke: &mut Stroke) -> &mut View {
        match &mut stroke.key {
            Key::Scene(view) => view,
            key => panic!("{key:?}"),
        }
    }
    let first = |turns: Compared| turns.first[0].what.clone();
    // All there are, and no more memory than that.
    assert_eq!(spoilt(&|stroke| stroke.slices = vec![[0, u32::MAX]]).count, 12);
    assert!(first(spoilt(&|stroke| view(stroke).wish.halftone = Halftone::Grey)).contains("halftone"));
    assert!(first(spoilt(&|stroke| view(stroke).viewers[0].distance_m = -1.0)).contains("distance_m"));
    let folder = tempfile::tempdir().unwrap();
    let mut replay = Replay::begin((0, setup(BTreeMap::new())), means(&folder)).unwrap();
    let wish = Wish { budget_px: -1.0, ..crate::daemon::wish::tests::wish() };
    assert!(matches!(replay.tell((1, Entry::Stage(Cast::of(&wish)))), Err(ReplayError::Scene(..))));
    assert!(matches!(replay.tell((u64::MAX, Entry::Lost { entries: 1 })), Err(ReplayError::Gap { .. })));
}

#[test]
fn the_same_comes_of_it() {
    let report = told(recorded());
    assert!(report.is_same(), "{report:#?}");
    let counts = report.parts().map(|(_, part)| part.count);
    assert_eq!((counts, report.orders), ([12, 12, 12, 0], 1));
}

#[test]
fn what_differs_is_named_with_its_time_and_place() {
    let mut entries = recorded();
    for (_, entry) in &mut entries {
        match entry {
            Entry::Stroke(stroke) if stroke.number == 5 => {
                stroke.sectors = stroke.sectors.map(|mut sectors| {
                    sectors[2] ^= 1;
                    sectors
                })
            }
            Entry::Eye(eye) if eye.what.is_some_and(|eye| eye.at == Duration::from_millis(1_300)) => {
                eye.refused = Some("jump".into());
            }
            Entry::Viewers(expected) if expected.light_at == Duration::from_millis(1_473) => {
                expected.viewers[0].position_m.y += 0.002;
            }
            _ => {}
        }
    }
    let report = told(entries);
    let first = |part: &Compared| part.first.iter().map(|difference| difference.what.clone()).collect::<Vec<_>>();
    assert_eq!(first(&report.turns), ["turn 5: other planes at mirror angles 90\u{2013}135°"]);
    assert_eq!(first(&report.readings), ["a posted viewer was refused: jump; here taken"]);
    assert_eq!(first(&report.viewers), ["viewers are 2.000 mm elsewhere"]);
    assert!(!report.is_same() && report.turns.first[0].at_s > 0.1);
}

#[test]
fn another_course_of_the_controller_is_told_from_its_first_difference_on() {
    let state = |name: &str| Entry::Controller(Controller { state: Some(name.into()), ..Controller::default() });
    let fault = Entry::Controller(Controller {
        state: Some("fault".into()),
        fault: Some("the guard is open".into()),
        cause: None,
    });
    let at = |seconds: f64, entry: &Entry| (BEGAN_NS + (seconds * 1e9) as u64, entry.clone());
    let known = [at(0.0, &setup(BTreeMap::new())), at(0.1, &state("idle")), at(1.0, &Entry::Order(Command::Start))];
    let telemetry = Entry::Lost { entries: 0 };
    let late = told(known.iter().cloned().chain([at(9.0, &state("spin-up")), at(10.0, &telemetry)]));
    let [one] = late.controller.first.as_slice() else { panic!("{late:#?}") };
    assert!(one.what.starts_with("spin-up; here at 1.0"), "{}", one.what);
    let other = told(known.iter().cloned().chain([at(1.02, &state("spin-up")), at(2.1, &fault), at(3.0, &telemetry)]));
    let [one] = other.controller.first.as_slice() else { panic!("{other:#?}") };
    assert!(one.what.contains("the guard is open; here"), "{}", one.what);
    let opened = serde_json::json!("guard-opened");
    let same = known.iter().cloned().chain([
        at(1.02, &state("spin-up")),
        at(2.0, &Entry::Action(opened)),
        at(2.1, &fault),
        at(3.0, &telemetry),
    ]);
    let report = told(same);
    assert!(report.is_same() && report.controller.count == 3, "{report:#?}");
}

#[test]
fn a_recording_begins_with_what_it_needs() {
    let folder = tempfile::tempdir().unwrap();
    let begun = Replay::begin((0, Entry::Lost { entries: 1 }), means(&folder));
    assert!(matches!(begun, Err(ReplayError::NoSetup)));
    let mut replay = Replay::begin((0, setup(BTreeMap::new())), means(&folder)).unwrap();
    let wish = Wish { scene: "fox".into(), ..crate::daemon::wish::tests::wish() };
    let told = replay.tell((1, Entry::Stage(Cast::of(&wish))));
    assert!(matches!(&told, Err(ReplayError::NoScene(name)) if name == "fox"), "{told:?}");
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 64, ..ProptestConfig::default() })]
    #[test]
    fn damaged_files_end_with_an_error_or_sooner(cut in 0_usize..20_000, flips in prop::collection::vec((0_usize..20_000, any::<u8>()), 0..4)) {
        let entries = vec![(1, setup(BTreeMap::new())), (2, Entry::Lost { entries: 4 }), (3, Entry::Order(Command::Stop))];
        let mut bytes = written(&entries);
        bytes.truncate(cut);
        for (place, value) in flips {
            if let Some(byte) = bytes.get_mut(place) {
                *byte = value;
            }
        }
        prop_assert!(Entries::new(bytes.as_slice()).take(100).filter(Result::is_ok).count() <= 3);
    }
}
