use super::*;
use glam::DQuat;
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};

/// The tracker's x, y, z are the world's -z, x, -y; its origin stands 1 m behind the axis and 0.5 m up. The eye is 0.1 m along the
/// sensor's x.
fn tracking() -> Tracking {
    Tracking {
        world_from_tracker: [[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.5], [-1.0, 0.0, 0.0, -1.0]],
        sensor_to_eye_m: [0.1, 0.0, 0.0],
        source: Vec::new(),
        plausible_distance_m: [0.2, 3.0],
        plausible_height_m: [-1.0, 2.0],
    }
}

fn ms(at: u64) -> Duration {
    Duration::from_millis(at)
}

fn reading(viewer: u16, position: [f64; 3], at: u64) -> Reading {
    Reading { viewer, position_m: position.into(), orientation: DQuat::IDENTITY, at: ms(at) }
}

#[test]
fn a_reading_becomes_an_eye() {
    let mut viewers = Viewers::new(&tracking());
    viewers.take(&reading(3, [-2.0, 0.0, 0.2], 0)).unwrap();
    let [viewer] = viewers.at(ms(0))[..] else { panic!() };
    // Sensor at -2 along the tracker's x, the eye at -1.9: z = 1.9 - 1; 0.2 down from 0.5.
    assert!(viewer.position_m.distance(DVec3::new(0.0, 0.3, 0.9)) < 1e-12, "{viewer:?}");
    assert!((viewer.distance_m - 0.9).abs() < 1e-12 && (viewer.height_m - 0.3).abs() < 1e-12);
    assert_eq!((viewer.id, viewer.azimuth, viewer.read_at), (3, 0.0, ms(0)));
    // The head turns about its sensor: the offset turns with it.
    let orientation = DQuat::from_rotation_z(FRAC_PI_2);
    viewers.take(&Reading { orientation, ..reading(4, [-1.0, 0.9, 0.0], 0) }).unwrap();
    let viewer = viewers.at(ms(0))[1];
    assert!(viewer.position_m.distance(DVec3::new(1.0, 0.5, 0.0)) < 1e-12, "{viewer:?}");
    assert!((viewer.azimuth - FRAC_PI_2).abs() < 1e-12);
}

#[test]
fn azimuths_are_as_mirror_angles() {
    let place = Place::new(&tracking());
    for (position, azimuth) in
        [([0.0, 0.0, 1.0], 0.0), ([1.0, 0.0, 0.0], FRAC_PI_2), ([0.0, 0.0, -1.0], PI), ([-1.0, 0.0, 0.0], -FRAC_PI_2)]
    {
        let head = Filter::new(position.into(), ms(0));
        assert!((Viewer::new(0, &head, ms(0), &place).azimuth - azimuth).abs() < 1e-12);
    }
}

#[test]
fn nobody_is_predicted_where_no_head_may_be() {
    let mut viewers = Viewers::new(&tracking());
    // Toward the axis at 2 m/s, last seen 0.3 m from it.
    (0..=50u32).for_each(|index| {
        let z = 2.3 - 0.04 * f64::from(index);
        viewers.take_eye(0, DVec3::new(0.0, 0.4, z), ms(20 * u64::from(index))).unwrap();
    });
    let now = viewers.at(ms(1000))[0];
    assert!((now.distance_m - 0.3).abs() < 0.01, "{now:?}");
    // Before, in, and beyond it.
    for ahead in [70, 150, 250, 600] {
        let viewer = viewers.at(ms(1000 + ahead))[0];
        assert_eq!((viewer.distance_m, viewer.azimuth), (0.2, 0.0), "{ahead}");
        assert!(viewer.position_m.distance(DVec3::new(0.0, 0.4, 0.2)) < 1e-9, "{viewer:?}");
    }
}

#[test]
fn predictions_end_where_heads_do() {
    let mut viewers = Viewers::new(&tracking());
    // Up and away at 1.5 m/s, last seen 1.95 m up and 2.95 m away.
    (0..=50u32).for_each(|index| {
        let left = 0.03 * f64::from(50 - index);
        viewers.take_eye(0, DVec3::new(2.95 - left, 1.95 - left, 0.0), ms(20 * u64::from(index))).unwrap();
    });
    let viewer = viewers.at(ms(1200))[0];
    assert_eq!((viewer.distance_m, viewer.height_m), (3.0, 2.0));
}

#[test]
fn what_is_refused_is_counted_by_its_reason() {
    let mut viewers = Viewers::new(&tracking());
    let eye = DVec3::new(0.0, 0.35, 0.9);
    viewers.take_eye(0, eye, ms(100)).unwrap();
    assert_eq!(viewers.take_eye(0, eye, ms(100)), Err(Refusal::Backwards));
    assert_eq!(viewers.take_eye(0, -eye, ms(110)), Err(Refusal::Jump));
    for outside in
        [DVec3::new(0.0, 2.1, 0.9), DVec3::new(0.1, 0.3, 0.1), DVec3::new(0.0, 0.0, -3.1), DVec3::NAN, DVec3::INFINITY]
    {
        assert_eq!(viewers.take_eye(0, outside, ms(120)), Err(Refusal::Outside));
    }
    assert_eq!(viewers.arrive(Err(ParseError::Kind(0))), Err(Refusal::Malformed));
    let absurd = ParseError::Absurd { field: "x", value: f64::NAN, limit: 1.0 };
    assert_eq!(viewers.arrive(Err(absurd)), Err(Refusal::Absurd));
    for id in 1..8 {
        viewers.take_eye(id, eye, ms(200)).unwrap();
    }
    assert_eq!(viewers.take_eye(8, eye, ms(200)), Err(Refusal::TooMany));
    let counters = viewers.counters();
    assert_eq!(counters.taken, 8);
    let counted = Refusal::ALL.map(|reason| (reason.name(), counters.refused(reason)));
    let expected = [("malformed", 1), ("absurd", 1), ("outside", 5), ("backwards", 1), ("jump", 1), ("too_many", 1)];
    assert_eq!(counted, expected);
}

#[test]
fn who_is_silent_leaves_and_makes_room() {
    let mut viewers = Viewers::new(&tracking());
    let eye = DVec3::new(0.0, 0.35, 0.9);
    (0..8).for_each(|id| viewers.take_eye(id, eye, ms(if id == 5 { 900 } else { 0 })).unwrap());
    assert_eq!(viewers.at(ms(1000)).len(), 8);
    assert_eq!(viewers.take_eye(8, eye, ms(1000)), Err(Refusal::TooMany));
    assert_eq!(viewers.at(ms(1001)).len(), 1);
    // Whoever asks who is there changes nothing: readings told again without that come out the same.
    assert_eq!(viewers.take_eye(8, eye, ms(1000)), Err(Refusal::TooMany));
    viewers.take_eye(8, eye, ms(1001)).unwrap();
    let ids: Vec<u16> = viewers.at(ms(1001)).iter().map(|viewer| viewer.id).collect();
    assert_eq!(ids, [5, 8]);
    // Who comes back begins anew, wherever that is, though nobody asked meanwhile.
    viewers.take_eye(5, -eye, ms(6000)).unwrap();
    assert_eq!(viewers.at(ms(6000))[0].azimuth.abs(), PI);
    assert_eq!(viewers.at(ms(7001)), []);
}

#[test]
fn a_time_that_cannot_be_true_passes() {
    let mut viewers = Viewers::new(&tracking());
    let eye = DVec3::new(0.0, 0.35, 0.9);
    viewers.take_eye(1, eye, ms(50)).unwrap();
    viewers.take_eye(0, eye, Duration::from_secs(3600)).unwrap();
    assert_eq!(viewers.take_eye(0, eye, ms(100)), Err(Refusal::Backwards));
    // Nobody else is touched.
    assert_eq!(viewers.at(ms(100)).len(), 1);
    viewers.take_eye(0, eye, ms(110)).unwrap();
    assert_eq!(viewers.at(ms(110))[0].read_at, ms(110));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
    /// Everything is taken or counted as refused, there are never more than eight, and each is where heads may be.
    #[test]
    fn nothing_gets_lost(
        readings in prop::collection::vec((0..20u16, prop::array::uniform3(-4.0..4.0f64), 0..3000u64), 0..80),
    ) {
        let mut viewers = Viewers::new(&tracking());
        for (id, position, at) in &readings {
            let _ = viewers.take(&reading(*id, *position, *at));
            let seen = viewers.at(ms(*at));
            prop_assert!(seen.len() <= VIEWERS_MAX);
            for viewer in seen {
                prop_assert!((0.2..=3.0).contains(&viewer.distance_m) && (-1.0..=2.0).contains(&viewer.height_m));
                let flat = DVec3 { y: 0.0, ..viewer.position_m };
                prop_assert!((flat.length() - viewer.distance_m).abs() < 1e-9 && viewer.position_m.y == viewer.height_m);
            }
        }
        let counters = viewers.counters();
        let refused: u64 = Refusal::ALL.iter().map(|reason| counters.refused(*reason)).sum();
        prop_assert_eq!(counters.taken + refused, readings.len() as u64);
    }
}
