use super::clicks::{read, write};
use super::meaning::meaning;
use super::simulated::{clicked, eight, shaken, sheet};
use super::*;
use crate::rigs;
use glam::{DVec3, Vec2Swizzles};
use protocol::timing::Direction;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

fn reference() -> Rig {
    rigs::find("reference").unwrap()
}

/// The reference rig as somebody may have built it.
fn built(tilt_deg: f64, offset_m: f64) -> Rig {
    let mut rig = reference();
    rig.mirror.face[0].tilt_deg += tilt_deg;
    rig.mirror.face[0].offset_m += offset_m;
    rig.projector.position_m = Some([0.004, 0.59, -0.006]);
    rig.projector.look_at_m = Some([-0.003, 0.0, 0.005]);
    rig.projector.image_down = Some([0.03, 0.0, 1.0]);
    rig.projector.focal_px = Some(3010.0);
    rig.projector.principal_px = Some([391.0, 377.0]);
    rig.checked().unwrap()
}

fn corners(rig: &Rig) -> Vec<Click> {
    clicked(rig, &eight(rig, 0))
}

/// The largest distance in the image of a point within 50 mm, along each axis, of the origin by two rigs.
fn apart_px(a: &Rig, b: &Rig) -> f64 {
    let steps = [-0.05, 0.0, 0.05];
    let points =
        steps.into_iter().flat_map(|x| steps.into_iter().flat_map(move |y| steps.map(|z| DVec3::new(x, y, z))));
    let apart = |point| a.camera().project(point).unwrap().distance(b.camera().project(point).unwrap());
    points.map(apart).fold(0.0, f64::max)
}

#[test]
fn eight_clicks_without_an_error_give_the_rig_back() {
    for (tilt, offset) in [(0.0, 0.0), (2.0, 0.0), (0.0, 0.005), (-3.0, -0.004)] {
        let rig = built(tilt, offset);
        let found = calibrate(&reference(), &corners(&rig), Free::default(), 1.0).unwrap();
        let [right, here] = [&rig, &found.rig].map(|rig| rig.mirror.face[0].clone());
        assert!(apart_px(&rig, &found.rig) < 1e-6, "{tilt} {offset}: {} px", apart_px(&rig, &found.rig));
        assert!((right.tilt_deg - here.tilt_deg).abs() < 1e-9 && (right.offset_m - here.offset_m).abs() < 1e-12);
        assert!(found.wrong.is_empty() && found.fit.rms_px() < 1e-9);
    }
    let found = calibrate(&reference(), &corners(&reference()), Free::default(), 1.0).unwrap();
    assert!(apart_px(&reference(), &found.rig) < 1e-6);
}

#[test]
fn places_in_the_world_do_too_and_so_does_a_lens() {
    let mut rig = built(0.0, 0.0);
    rig.projector.radial = [-0.3, 0.5];
    let steps = [-0.05, 0.0, 0.05];
    let places =
        steps.into_iter().flat_map(|x| steps.into_iter().flat_map(move |y| steps.map(|z| DVec3::new(x, y, z))));
    let places: Vec<_> = places.map(Place::World).collect();
    let free = Free { radial: true, ..Free::default() };
    let found = calibrate(&reference(), &clicked(&rig, &places), free, 1.0).unwrap();
    assert!(apart_px(&rig, &found.rig) < 1e-6, "{} px", apart_px(&rig, &found.rig));
    assert!(found.fit.spreads().iter().all(|spread| !spread.name.contains("tilt")));
    assert_eq!(found.rig.mirror.face[0].tilt_deg, reference().mirror.face[0].tilt_deg);
}

#[test]
fn the_faces_of_a_tent_are_found_each_on_its_own() {
    let mut rig = rigs::find("tent").unwrap();
    rig.mirror.face[0].tilt_deg = 44.2;
    rig.mirror.face[1].tilt_deg = 46.1;
    rig.mirror.face[1].offset_m = 0.047;
    let clicks: Vec<_> = (0..2).flat_map(|face| clicked(&rig, &sheet(&rig, face))).collect();
    let found = calibrate(&rigs::find("tent").unwrap(), &clicks, Free::default(), 1.0).unwrap();
    for (right, here) in rig.mirror.face.iter().zip(&found.rig.mirror.face) {
        assert!((right.tilt_deg - here.tilt_deg).abs() < 1e-9 && (right.offset_m - here.offset_m).abs() < 1e-12);
    }
    assert!(apart_px(&rig, &found.rig) < 1e-6);
}

#[test]
fn the_bound_of_cramer_and_rao_is_reached() {
    const TRIALS: u32 = 2000;
    const HAND_PX: f64 = 0.3;
    let rig = built(1.0, 0.003);
    let clicks = corners(&rig);
    let exact = Fit::new(&rig, &clicks, Free::default()).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut squares = vec![0.0; exact.spreads().len()];
    for _ in 0..TRIALS {
        let found = calibrate(&reference(), &shaken(&clicks, HAND_PX, &mut rng), Free::default(), 2.0).unwrap();
        assert!(found.wrong.is_empty());
        let differences = found.fit.differences(&exact);
        squares.iter_mut().zip(differences).for_each(|(square, difference)| *square += difference * difference);
    }
    for (spread, square) in exact.spreads().iter().zip(squares) {
        let (rms, bound) = ((square / f64::from(TRIALS)).sqrt(), spread.per_px * HAND_PX);
        println!("{}: {rms:.4} RMS, bound {bound:.4}, ratio {:.3}", spread.name, rms / bound);
        assert!((0.9..1.1).contains(&(rms / bound)), "{}: {rms} of {bound}", spread.name);
    }
}

#[test]
fn what_is_uncertain_of_a_picture_is_what_differs_in_it() {
    let rig = built(0.0, 0.0);
    let clicks = corners(&rig);
    let told = meaning(&calibrate(&rig, &clicks, Free::default(), 1.0).unwrap(), 0.05).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let optics =
        |rig: &Rig| shaders::project::SliceOptics::new(rig, 0, rig.slice_angle(0), shaders::project::Model::Cone);
    let right = optics(&rig).project(DVec3::ZERO).pixel.unwrap();
    let squares = (0..200).map(|_| {
        let found = calibrate(&rig, &shaken(&clicks, 0.1, &mut rng), Free::default(), 2.0).unwrap();
        optics(&found.rig).project(DVec3::ZERO).pixel.unwrap().distance_squared(right)
    });
    let rms = (squares.sum::<f64>() / 200.0).sqrt() / 0.1;
    assert!((0.5..1.2).contains(&(rms / told.picture_px)), "{rms} px in the middle, {} px RMS", told.picture_px);
    assert!((0.01..1.0).contains(&told.viewer_slices), "{}", told.viewer_slices);
}

#[test]
fn a_wrong_click_among_ten_is_found_and_among_eight_it_is_one_of_a_few() {
    let rig = built(1.0, 0.003);
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for (places, is_found) in [(sheet(&rig, 0), true), (eight(&rig, 0), false)] {
        let clicks = clicked(&rig, &places);
        for trial in 0..20 {
            let mut clicks = shaken(&clicks, 0.3, &mut rng);
            let place = trial % clicks.len();
            clicks[place].pixel.x += 15.0;
            let label = clicks[place].label.clone();
            match calibrate(&reference(), &clicks, Free::default(), 2.0) {
                Ok(found) => {
                    assert_eq!(found.wrong.iter().map(|wrong| &wrong.click.label).collect::<Vec<_>>(), [&label]);
                    assert!((10.0..20.0).contains(&found.wrong[0].off_px) || !is_found);
                }
                Err(CalibrationError::OneOf(labels)) if !is_found => {
                    assert!(labels.contains(&label), "{label}: {labels}")
                }
                Err(error) => panic!("{error}"),
            }
        }
    }
}

#[test]
fn degenerate_clicks_are_refused_by_name() {
    let rig = built(0.0, 0.0);
    let clicks = clicked(&rig, &sheet(&rig, 0));
    let refused = |clicks: &[Click]| calibrate(&reference(), clicks, Free::default(), 2.0).unwrap_err().to_string();
    assert!(refused(&clicks[..5]).contains("5 clicks: must be at least 6"));
    let flat: Vec<_> = clicks[..4].iter().chain(&clicks[..4]).cloned().collect();
    assert!(refused(&flat).contains("one plane: click them at a second stop"), "{}", refused(&flat));
    let mirrored = |change: fn(&mut Click)| {
        let mut clicks = clicks.clone();
        clicks.iter_mut().for_each(change);
        refused(&clicks)
    };
    for change in [
        (|click: &mut Click| click.pixel.x = 768.0 - click.pixel.x) as fn(&mut Click),
        |click| click.pixel = click.pixel.yx(),
        |click| {
            if let Place::Face(at) = &mut click.place {
                at.at_m.x = -at.at_m.x;
            }
        },
    ] {
        assert!(mirrored(change).contains("mirrored image"), "{}", mirrored(change));
    }
    // A pinhole that is twice as far and twice as long sees the same of two fiducials a pixel apart; no error is small enough.
    let mut far = clicks.clone();
    far.iter_mut().for_each(|click| click.pixel = DVec2::splat(384.0) + (click.pixel - 384.0) * 1e-9);
    assert!(calibrate(&reference(), &far, Free::default(), 2.0).is_err());
    let mut shaken_hard = clicks.clone();
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    shaken_hard = shaken(&shaken_hard, 20.0, &mut rng);
    let loose = refused(&shaken_hard);
    assert!(loose.contains("disagree by") || loose.contains("one of"), "{loose}");
    let mut elsewhere = clicks;
    elsewhere[0].place = Place::Face(OnFace { face: 1, at_m: DVec2::ZERO, stop_deg: 0.0, encoder_deg: None });
    assert!(refused(&elsewhere).contains("face 1 of point 1: the rig has 1, counted from 0"));
}

#[test]
fn the_encoder_tells_the_phase_and_corrects_the_stops() {
    for (direction, sense) in [(Direction::CounterClockwise, 1.0), (Direction::Clockwise, -1.0)] {
        let mut rig = built(0.0, 0.0);
        rig.rotation.direction = direction;
        // The hand stopped it half a degree too far and a degree too early; by the encoder both are known.
        let phase = 17.5;
        let places = sheet(&rig, 0).into_iter().map(|place| match place {
            Place::Face(at) => {
                let stop_deg = at.stop_deg + if at.stop_deg < 90.0 { 0.5 } else { -0.5 };
                Place::Face(OnFace { stop_deg, encoder_deg: Some(sense * (stop_deg - phase)), ..at })
            }
            world => world,
        });
        let mut clicks = clicked(&rig, &places.collect::<Vec<_>>());
        for click in &mut clicks {
            if let Place::Face(at) = &mut click.place {
                at.stop_deg = (at.stop_deg / 180.0).round() * 180.0;
            }
        }
        let mut asked = reference();
        asked.rotation.direction = direction;
        let found = calibrate(&asked, &clicks, Free::default(), 1.0).unwrap();
        assert!(
            (found.phase.phase_offset_deg.unwrap() - phase).abs() < 1e-9 && (found.phase.off_deg - 1.0).abs() < 1e-9
        );
        assert!((found.rig.rotation.phase_offset_deg - phase).abs() < 1e-9);
        assert!(apart_px(&rig, &found.rig) < 1e-6, "{direction:?}: {}", apart_px(&rig, &found.rig));

        let mut half = clicks.clone();
        let mut off = clicks;
        if let (Place::Face(half), Place::Face(off)) = (&mut half[0].place, &mut off[0].place) {
            half.encoder_deg = None;
            off.encoder_deg = Some(100.0);
        }
        let refused = |clicks: &[Click]| calibrate(&asked, clicks, Free::default(), 1.0).unwrap_err().to_string();
        assert!(refused(&half).contains("some clicks of face 0"));
        assert!(refused(&off).contains("the encoder puts the stops of face 0"), "{}", refused(&off));
    }
}

#[test]
fn a_table_says_the_same() {
    let rig = built(0.0, 0.0);
    let mut clicks = clicked(&rig, &sheet(&rig, 0));
    clicks.extend(clicked(&rig, &[Place::World(DVec3::new(0.01, -0.02, 0.03))]));
    if let Place::Face(at) = &mut clicks[0].place {
        at.encoder_deg = Some(12.25);
    }
    let told = read(&rig, &write(&clicks)).unwrap();
    for ((told, click), line) in told.iter().zip(&clicks).zip(2..) {
        assert_eq!((told.place, &told.label), (click.place, &format!("line {line}")));
        assert!(told.pixel.distance(click.pixel) < 1e-4);
    }
    assert_eq!(told.len(), clicks.len());
    for (text, words) in [
        ("u_px,v_px,x_m,y_m,z_m\n1,2,3,4", "line 2: z_m = : must be a number from -10 to 10"),
        ("u_px,v_px,x_m,y_m,z_m\n900,2,3,4,5", "line 2: u_px = 900: must be a number from 0 to 768"),
        ("u_px,v_px,x_m,y_m,z_m\n0.01,2,344,4,5", "line 2: x_m = 344: must be"),
        ("u_px,v_px,x_m,across_m\n1,2,3,4", "line 2: needs x_m, y_m and z_m, or across_m"),
        ("u_px,v_px\n1,2", "line 2: needs x_m"),
        ("u_px,v_px,across_m,slope_m,stop_deg,face\n1,2,0,0,0,-1", "face = -1"),
        ("u_px,x_m", "column v_px stands 0 times"),
    ] {
        let refused = read(&rig, text).unwrap_err().to_string();
        assert!(refused.contains(words), "{refused}");
    }
}
