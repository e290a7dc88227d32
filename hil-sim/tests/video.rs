//! Frames that come as video, on their way from a host over a graphics card and a link to the lock onto their numbers, with everything going wrong.

use firmware::pacing::Pacing;
use firmware::video_index::{AGREEING, Known, VideoIndex};
use hil_sim::motor::Motor;
use hil_sim::projector::video::{Video, VideoFault as Fault};
use hil_sim::scenario::{Action, Scenario};
use hil_sim::world::World;
use proptest::prelude::*;
use protocol::frame_mark::read;
use protocol::message::State;
use protocol::timing::{Direction, Rotation};
use protocol::units::{Nanos, Turns};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// A fault now and then, often several close together, but never a false mark beside another fault: two that happen to agree are beyond
/// any count of frames.
fn faults() -> impl Strategy<Value = Vec<(u32, Fault)>> {
    let fault = prop_oneof![
        3 => Just(Fault::Bit),
        1 => (0u32..4_096).prop_map(|number| Fault::Mark { number }),
        2 => Just(Fault::Late),
        2 => Just(Fault::Repeated),
        2 => Just(Fault::Dropped),
        1 => (0u32..60, 0u32..170).prop_map(|(gap, first)| Fault::Restart { gap, first }),
    ];
    let quiet = prop_oneof![3 => 1u32..4, 1 => 4u32..60];
    prop::collection::vec((quiet, fault), 0..40).prop_map(|mut faults| {
        for place in 0..faults.len() {
            let before = place.checked_sub(1).map(|before| faults[before].1);
            if let (Fault::Mark { .. }, _) | (_, Some(Fault::Mark { .. })) = (faults[place].1, before) {
                let gap = if let Some(Fault::Restart { gap, .. }) = before { gap } else { 0 };
                faults[place].0 += gap + AGREEING + 1;
            }
        }
        faults
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2_000) })]

    /// Whatever happens, no frame is known as another one than is on screen; a lost or false mark and a late frame cost their own frame; and
    /// after anything else the count is known again three frames after it is over.
    #[test]
    fn no_frame_is_taken_for_another(frames in 3u32..=170, first in 0u32..170, faults in faults(), seed: u64) {
        let rotation = Rotation::new(24 * frames, 24, 240_000_000, Turns::ZERO, Direction::CounterClockwise).unwrap();
        let mut index = VideoIndex::new(&rotation);
        let mut video = Video::new(&rotation, first, seed);
        // Frames with a mark that counts on from the one before: so many have come in a row.
        let (mut before, mut in_order) = (None, 0);
        let (mut is_locked, mut dark) = (false, 0);
        let quiet = |gap: u32| std::iter::repeat_n(None, gap as usize);
        for fault in faults.into_iter().flat_map(|(gap, fault)| quiet(gap).chain([Some(fault)])).chain(quiet(80)) {
            fault.into_iter().for_each(|fault| video.fail(fault));
            let mark = read(&video.refresh());
            let is_next = before.is_some_and(|before: u32| video.on_screen() == Some((before + 1) % frames));
            let is_told = video.on_screen().is_some() && mark == video.on_screen();
            in_order = if !is_told { 0 } else if is_next { in_order + 1 } else { 1 };
            before = video.on_screen();
            let known = index.frame(mark);
            match known {
                Known::Frame(number) => prop_assert_eq!(Some(number), video.on_screen()),
                Known::Doubtful(_) => prop_assert!(is_locked),
                Known::Nothing => {}
            }
            let is_lit = matches!(known, Known::Frame(_));
            prop_assert!(is_lit || in_order < AGREEING, "dark though {in_order} marks agree");
            (is_locked, dark) = (is_locked || is_lit, if is_lit { 0 } else { dark + 1 });
        }
        prop_assert_eq!(dark, 0);
    }

    /// A mark that is lost, and a frame that the host makes good, cost one frame and not the lock.
    #[test]
    fn what_the_host_makes_good_costs_one_frame(frames in 3u32..=170, bad in prop::sample::select(vec![Fault::Bit, Fault::Late])) {
        let rotation = Rotation::new(24 * frames, 24, 240_000_000, Turns::ZERO, Direction::CounterClockwise).unwrap();
        let mut index = VideoIndex::new(&rotation);
        let mut video = Video::new(&rotation, 0, 1);
        (0..AGREEING).for_each(|_| { index.frame(read(&video.refresh())); });
        video.fail(bad);
        let mut lit = || matches!(index.frame(read(&video.refresh())), Known::Frame(_));
        prop_assert!(!lit() && (0..10).all(|_| lit()));
    }
}

/// What goes wrong with pulses and video of a world, at most every tenth of a second for `seconds`. A false mark has no other fault beside it.
fn disturbed(random: &mut ChaCha8Rng, frames: u32, seconds: f64) -> Scenario {
    let mut scenario = Scenario { pacing: Pacing::VideoLocked, ..Scenario::default() };
    let mut at_s = 2.0;
    while at_s < seconds {
        let action = match random.random_range(0..10) {
            0 => Action::Video(Fault::Bit),
            1 => Action::Video(Fault::Mark { number: random.random_range(0..frames) }),
            2 => Action::Video(Fault::Late),
            3 => Action::Video(Fault::Repeated),
            4 => Action::Video(Fault::Dropped),
            5 => {
                Action::Video(Fault::Restart { gap: random.random_range(0..60), first: random.random_range(0..frames) })
            }
            6 => Action::LoseFramePulses { count: random.random_range(1..4) },
            7 => Action::ExtraFramePulse,
            8 => Action::LosePlanePulses { count: 2 },
            _ => Action::ProjectorRate { hz: random.random_range(230.0..242.0) },
        };
        scenario = scenario.with(at_s, action);
        at_s += random.random_range(0.1..1.0);
    }
    scenario
}

/// The whole controller: whatever a card, a link and the projector's pulses do, no plane is lit in another place than its own, no desktop, no
/// turn from its middle; and two seconds after the last of it there is light.
#[test]
fn no_frame_is_lit_out_of_its_place() {
    let broken: Vec<String> = (0..60u64)
        .into_par_iter()
        .filter_map(|seed| {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let direction = if seed % 2 == 0 { Direction::CounterClockwise } else { Direction::Clockwise };
            let frames = random.random_range(8..=16);
            let latency = Nanos(random.random_range(0..1_500_000));
            let rotation = Rotation::new(24 * frames, 24, 240_000_000, Turns::fraction(1, 9), direction).unwrap();
            let scenario = disturbed(&mut random, frames, 8.0);
            let mut world = World::new(&rotation, latency, &Motor::reference(), &scenario, seed).unwrap();
            world.advance(10.0);
            let before = world.statistics().verdict.lit;
            world.advance(0.5);
            let run = world.statistics();
            let is_lit = run.verdict.lit > before + u64::from(rotation.slices());
            let is_well = run.verdict.is_clean() && is_lit && world.state() == State::Locked;
            (!is_well)
                .then(|| format!("seed {seed}, lit {is_lit}, {:?}: {:?} {:?}", world.state(), run.verdict, run.states))
        })
        .collect();
    assert!(broken.is_empty(), "{broken:#?}");
}
