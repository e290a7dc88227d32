use super::*;
use proptest::prelude::*;

fn seconds(at: f64) -> Duration {
    Duration::from_secs_f64(at)
}

/// Readings of `path` at 60 Hz for two seconds.
fn following(path: impl Fn(f64) -> DVec3) -> Filter {
    let mut filter = Filter::new(path(0.0), Duration::ZERO);
    (1..=120).for_each(|index| filter.take(path(f64::from(index) / 60.0), seconds(f64::from(index) / 60.0)).unwrap());
    filter
}

#[test]
fn who_rests_is_where_he_is() {
    let place = DVec3::new(0.1, 0.4, 0.9);
    let filter = following(|_| place);
    for ahead in [0.0, 0.1, 10.0] {
        assert!(filter.predicted(seconds(2.0 + ahead)).distance(place) < 1e-12);
    }
    assert_eq!(filter.predicted(Duration::ZERO), filter.predicted(seconds(2.0)));
}

#[test]
fn who_goes_on_is_seen_ahead() {
    let path = |t: f64| DVec3::new(0.8 * t - 0.8, 0.4, 0.9);
    let filter = following(path);
    assert!(
        (filter.velocity - 0.8 * DVec3::X).length() < 1e-3 && filter.position.distance(path(2.0)) < 1e-3,
        "{filter:?}"
    );
    // Ahead it fades: 0.8 m/s times 0.5 s (1 - exp(-ahead / 0.5 s)), less 8 σ² / v² of it.
    let trust = 0.64 / (0.64 + 8.0 * filter.covariance[2]);
    assert!(trust > 0.9, "{filter:?}");
    for ahead in [0.05f64, 0.1, 5.0] {
        let gone = trust * 0.8 * 0.5 * (1.0 - (-ahead / 0.5).exp());
        let error = filter.predicted(seconds(2.0 + ahead)).distance(path(2.0) + DVec3::X * gone);
        assert!(error < 1e-3, "{ahead} s: {error}");
    }
}

#[test]
fn noise_is_smoothed() {
    // Steps of 5 mm up and down.
    let noise = |t: f64| if ((t * 60.0).round() as u32).is_multiple_of(2) { 5e-3 } else { -5e-3 };
    let filter = following(|t| DVec3::new(noise(t), 0.4, 0.9));
    assert!(filter.predicted(seconds(2.0)).x.abs() < 1.5e-3, "{filter:?}");
    // Its velocity is noise: hardly anything of it counts.
    let drift = filter.predicted(seconds(2.1)).distance(filter.predicted(seconds(2.0)));
    assert!(drift < 0.1 * 0.1 * filter.velocity.length(), "{drift} {filter:?}");
}

#[test]
fn time_runs_forward() {
    let mut filter = following(|_| DVec3::Z);
    let before = filter.clone();
    for at in [2.0, 1.9, 0.0] {
        assert_eq!(filter.take(DVec3::Z, seconds(at)), Err(Refused::Backwards));
    }
    assert_eq!(filter, before);
}

#[test]
fn a_jump_is_refused_until_it_stays() {
    let mut filter = following(|_| DVec3::Z);
    let at = |index: u32| seconds(2.0 + f64::from(index) / 60.0);
    // One wrong reading changes nothing.
    let before = filter.clone();
    assert_eq!(filter.take(-DVec3::Z, at(1)), Err(Refused::Jump));
    assert_eq!((filter.position, filter.velocity, filter.at), (before.position, before.velocity, before.at));
    filter.take(DVec3::Z, at(2)).unwrap();
    // Neither do many that agree with nothing.
    for index in 3..40 {
        let scattered = DVec3::new(f64::from(index % 7), f64::from(index % 5), f64::from(index % 2) - 5.0);
        assert_eq!(filter.take(scattered, at(index)), Err(Refused::Jump), "{index}");
    }
    // Five in a row at one place are where the head is, without the old velocity. (By then it might have walked far: start anew.)
    let mut filter = following(|_| DVec3::Z);
    for index in 1..5 {
        assert_eq!(filter.take(-DVec3::Z, at(index)), Err(Refused::Jump));
    }
    filter.take(-DVec3::Z, at(5)).unwrap();
    assert_eq!(filter.predicted(at(10)), -DVec3::Z);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
    /// Whatever comes, in whatever order: places stay numbers near what was taken, and time stays forward.
    #[test]
    fn any_readings_leave_numbers(
        readings in prop::collection::vec((prop::array::uniform3(-5.0..5.0f64), 0..5_000_000u64), 1..60),
        ahead in 0..10_000_000u64,
    ) {
        let mut filter = Filter::new(DVec3::ZERO, Duration::ZERO);
        for (position, at) in readings {
            let (before, at) = (filter.at(), Duration::from_micros(at));
            match filter.take(position.into(), at) {
                Ok(()) => prop_assert!(filter.at() == at && at > before),
                Err(_) => prop_assert_eq!(filter.at(), before),
            }
            let predicted = filter.predicted(filter.at() + Duration::from_micros(ahead));
            prop_assert!(predicted.is_finite() && predicted.abs().max_element() < 1e3, "{predicted}");
            let [pp, pv, vv] = filter.covariance;
            prop_assert!(pp > 0.0 && vv > 0.0 && pp * vv >= pv * pv, "{:?}", filter.covariance);
        }
    }
}
