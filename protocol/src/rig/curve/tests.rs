use super::*;
use proptest::prelude::*;

const REST: Spot = Spot { distance_m: 0.9, height_m: 0.35 };

fn viewer(azimuth_deg: f64, distance_m: f64, height_m: f64) -> TrackedViewer {
    TrackedViewer { azimuth_deg, distance_m, height_m }
}

fn curve(viewers: &[TrackedViewer]) -> ViewingCurve {
    ViewingCurve::new(REST, viewers)
}

/// At an azimuth in degrees.
fn at(curve: &ViewingCurve, azimuth_deg: f64) -> [f64; 2] {
    let Spot { distance_m, height_m } = curve.spot(azimuth_deg.to_radians());
    [distance_m, height_m]
}

#[test]
fn nobody_leaves_the_circle() {
    for azimuth in -400..400 {
        assert_eq!(at(&curve(&[]), f64::from(azimuth)), [0.9, 0.35]);
    }
}

#[test]
fn a_viewer_has_a_flat_piece_and_the_rest_is_15_degrees_away() {
    let curve = curve(&[viewer(30.0, 1.2, 0.6)]);
    for aside in [-4.999, -2.0, 0.0, 2.0, 4.999] {
        assert_eq!(at(&curve, 30.0 + aside), [1.2, 0.6]);
        assert_eq!(at(&curve, 30.0 + aside - 360.0), [1.2, 0.6]);
    }
    for aside in [-180.0, -15.001, 15.001, 90.0] {
        assert_eq!(at(&curve, 30.0 + aside), [0.9, 0.35]);
    }
    // Half way, and three quarters: 3/4² · 3 − 2 · 3/4³.
    let [distance, height] = at(&curve, 40.0);
    assert!((distance - 1.05).abs() < 1e-12 && (height - 0.475).abs() < 1e-12);
    assert!((at(&curve, 42.5)[0] - (1.2 - 0.3 * 0.84375)).abs() < 1e-12);
}

#[test]
fn near_viewers_blend_between_each_other() {
    for gap in [8.0, 12.0, 20.0] {
        let curve = curve(&[viewer(-gap / 2.0, 0.9, 0.8), viewer(gap / 2.0, 0.9, 0.6)]);
        assert_eq!([at(&curve, -gap / 2.0), at(&curve, gap / 2.0)], [[0.9, 0.8], [0.9, 0.6]]);
        assert!((at(&curve, 0.0)[1] - 0.7).abs() < 1e-12);
        let least = (-100..100).map(|part| at(&curve, gap / 200.0 * f64::from(part))[1]).fold(1.0, f64::min);
        assert!(least >= 0.6, "{least}: it goes down to the circle between them");
    }
    // Farther apart it rests between them.
    let far = curve(&[viewer(-15.0, 0.9, 0.8), viewer(15.0, 0.9, 0.6)]);
    assert!((at(&far, 0.0)[1] - 0.35).abs() < 1e-12);
}

#[test]
fn of_viewers_in_one_place_the_nearer_counts_and_then_the_first() {
    let [tall, child] = [viewer(10.0, 1.4, 0.8), viewer(12.0, 0.8, 0.2)];
    for viewers in [[tall, child], [child, tall]] {
        assert_eq!(curve(&viewers), curve(&[child]));
    }
    let beside = viewer(10.0, 0.8, 0.5);
    assert_eq!(curve(&[beside, child]), curve(&[beside]));
    assert_eq!(curve(&[child, beside]), curve(&[child]));
    // The one in the middle is nobody's neighbour any more.
    let three = [viewer(0.0, 1.0, 0.1), viewer(6.0, 1.1, 0.2), viewer(12.0, 0.9, 0.3)];
    assert_eq!(curve(&three), curve(&[three[0], three[2]]));
}

#[test]
fn viewers_all_around_make_a_circle() {
    let all: Vec<_> = (0..18).map(|index| viewer(20.0 * f64::from(index), 1.1, 0.6)).collect();
    for part in 0..3600 {
        let [distance, height] = at(&curve(&all), f64::from(part) / 10.0);
        assert!((distance - 1.1).abs() < 1e-12 && (height - 0.6).abs() < 1e-12, "{part}: {distance} {height}");
    }
}

#[test]
fn curves_differ_where_a_viewer_has_moved() {
    let [still, before, after] = [viewer(100.0, 1.0, 0.5), viewer(0.0, 1.0, 0.5), viewer(0.0, 1.0, 0.6)];
    let [before, after] = [before, after].map(|moving| curve(&[still, moving]));
    let is_alike = |from: f64, to: f64| before.is_alike(&after, [from, to].map(f64::to_radians));
    assert!(is_alike(16.0, 344.0) && is_alike(80.0, 120.0) && is_alike(-200.0, -16.0));
    assert!(!is_alike(14.0, 30.0) && !is_alike(330.0, 346.0) && !is_alike(-90.0, 90.0) && !is_alike(-1.0, 1.0));
}

fn viewers() -> impl Strategy<Value = Vec<TrackedViewer>> {
    let one = (-360.0f64..360.0, 0.2f64..4.0, -1.0f64..2.0);
    prop::collection::vec(one.prop_map(|(azimuth, distance, height)| viewer(azimuth, distance, height)), 0..12)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn it_passes_through_viewers_with_flat_pieces(viewers in viewers()) {
        let curve = curve(&viewers);
        prop_assert!(viewers.is_empty() || !curve.stays.is_empty());
        for stay in curve.stays.iter() {
            prop_assert!(viewers.iter().any(|viewer| (viewer.distance_m, viewer.height_m) == (stay.spot.distance_m, stay.spot.height_m)));
            for aside in [-1.999, -1.0, 0.0, 1.0, 1.999] {
                prop_assert_eq!(curve.spot(stay.azimuth + aside * DEGREE), stay.spot);
            }
        }
    }

    #[test]
    fn it_never_overshoots(viewers in viewers(), azimuth in -7.0f64..7.0) {
        let curve = curve(&viewers);
        let Spot { distance_m, height_m } = curve.spot(azimuth);
        let [least, most] = curve.distances();
        let heights = || curve.spots().map(|spot| spot.height_m);
        let (low, high) = (heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max));
        prop_assert!((least - 1e-12..=most + 1e-12).contains(&distance_m), "{} {} {}", distance_m, least, most);
        prop_assert!((low - 1e-12..=high + 1e-12).contains(&height_m), "{} {} {}", height_m, low, high);
    }

    /// Its slope to the left is its slope to the right, and it closes.
    #[test]
    fn it_is_smooth_and_closed(viewers in viewers(), azimuth in -7.0f64..7.0, at_bend: prop::sample::Index, at_end: bool) {
        let curve = curve(&viewers);
        let bends: Vec<_> = curve.bends().collect();
        let place = match bends.is_empty() {
            true => azimuth,
            false => bends[at_bend.index(bends.len())].start + if at_end { bends[at_bend.index(bends.len())].width } else { 0.0 },
        };
        const STEP: f64 = 1e-6;
        for azimuth in [azimuth, place] {
            let around = [-STEP, 0.0, STEP].map(|aside| curve.spot(azimuth + aside));
            for values in [around.map(|spot| spot.distance_m), around.map(|spot| spot.height_m)] {
                let [left, right] = [values[1] - values[0], values[2] - values[1]].map(|rise| rise / STEP);
                // At a bend of 3 m within 4° the slope changes by 6 · 3 / 0.07² · STEP.
                prop_assert!((left - right).abs() < 0.02, "{} {} at {}", left, right, azimuth);
            }
            let closed = curve.spot(azimuth + TAU);
            prop_assert!((closed.distance_m - around[1].distance_m).abs() < 1e-9);
        }
    }

    /// A sector's bends make up the same curve.
    #[test]
    fn a_sector_has_the_curves_places(viewers in viewers(), from in -7.0f64..7.0, width in 0.01f64..3.0, part in 0.0f64..1.0) {
        let curve = curve(&viewers);
        let (mut spot, bends) = curve.sector([from, from + width]);
        let azimuth = from + part * width;
        for bend in bends {
            let way = ((azimuth - bend.start) / bend.width).clamp(0.0, 1.0);
            let share = way * way * (3.0 - 2.0 * way);
            spot.distance_m += share * (bend.to.distance_m - bend.from.distance_m);
            spot.height_m += share * (bend.to.height_m - bend.from.height_m);
        }
        let expected = curve.spot(azimuth);
        prop_assert!((spot.distance_m - expected.distance_m).abs() < 1e-9, "{} {}", spot.distance_m, expected.distance_m);
        prop_assert!((spot.height_m - expected.height_m).abs() < 1e-9, "{} {}", spot.height_m, expected.height_m);
    }

    /// Where curves are alike they have the same bits.
    #[test]
    fn alike_is_the_same(mut viewers in viewers(), other in (-360.0f64..360.0, 0.2f64..4.0), from in -7.0f64..7.0, width in 0.01f64..3.0, part in 0.0f64..1.0) {
        let before = curve(&viewers);
        viewers.push(viewer(other.0, other.1, 0.3));
        let after = curve(&viewers);
        let sector = [from, from + width];
        if before.is_alike(&after, sector) {
            let azimuth = from + part * width;
            prop_assert_eq!(before.spot(azimuth), after.spot(azimuth));
            prop_assert_eq!(before.sector(sector), after.sector(sector));
        }
    }
}
