use super::*;
use core::f64::consts::TAU;

const REFERENCE: &str = include_str!("../../../host/rigs/reference.toml");
const TENT: &str = include_str!("../../../host/rigs/tent.toml");

fn view(height: f64) -> View {
    View { from: DVec3::new(0.01, height, 0.9), look_at: DVec3::ZERO, window_m: 0.13, pixels: 48, rays: 2 }
}

fn ideal<'a>(rig: &Rig, picture: impl Fn(u32) -> Picture<'a>) -> Vec<Flash<'a>> {
    let slices = rig.rotation.slices;
    let half = TAU / f64::from(slices) / 2.0;
    let flash = |slice| Flash {
        start: rig.slice_angle(slice) - half,
        end: rig.slice_angle(slice) + half,
        picture: picture(slice),
    };
    (0..slices).map(flash).collect()
}

#[test]
fn a_white_scene_is_flat() {
    let rig = Rig::parse(REFERENCE).unwrap();
    let white = vec![255; 768 * 768];
    let flashes = ideal(&rig, |_| Picture::Grey(&white));
    let seen = expose(&rig, &flashes, 1.0, 4, &view(0.35), Brightness::Divided, &|| ());
    assert!(seen.reached.iter().all(|reached| *reached));
    assert!(seen.luminance().iter().all(|value| (value - 1.0).abs() < 1e-6));
}

#[test]
fn the_plain_sum_averages_what_the_prototype_measured() {
    // rig.md: 1.08 at h = 0.35 m.
    let rig = Rig::parse(REFERENCE).unwrap();
    let white = vec![255; 768 * 768];
    let flashes = ideal(&rig, |_| Picture::Grey(&white));
    let seen = expose(&rig, &flashes, 1.0, 4, &view(0.35), Brightness::Physical, &|| ());
    let mean = seen.luminance().iter().sum::<f32>() / seen.luminance().len() as f32;
    assert!((mean - 1.08).abs() < 0.03, "{mean}");
}

#[test]
fn blanked_planes_count_as_dark() {
    let rig = Rig::parse(REFERENCE).unwrap();
    let white = vec![0xFF; 768 * 96];
    let flashes = ideal(&rig, |slice| if slice % 2 == 0 { Picture::Binary(&white) } else { Picture::Dark });
    let seen = expose(&rig, &flashes, 1.0, 8, &view(0.35), Brightness::Divided, &|| ());
    let mean = seen.luminance().iter().sum::<f32>() / seen.luminance().len() as f32;
    assert!((mean - 0.5).abs() < 0.02, "{mean}");
}

#[test]
fn a_pixel_on_the_axis_is_seen_in_the_middle_from_all_sides() {
    // The projector's axis meets the mirror at the origin in every slice.
    let rig = Rig::parse(REFERENCE).unwrap();
    let mut dot = vec![0; 768 * 768];
    for y in 372..396 {
        dot[y * 768 + 372..y * 768 + 396].fill(255);
    }
    let flashes = ideal(&rig, |_| Picture::Grey(&dot));
    for azimuth in [0.0, 0.9, 2.5, 4.4] {
        let from = DVec3::new(0.9 * f64::sin(azimuth), 0.35, 0.9 * f64::cos(azimuth));
        let view = View { from, pixels: 33, ..view(0.35) };
        let seen = expose(&rig, &flashes, 1.0, 2, &view, Brightness::Divided, &|| ());
        let luminance = seen.luminance();
        assert!(luminance[16 * 33 + 16] > 0.1, "{azimuth}");
        assert!(luminance.iter().enumerate().all(|(cell, value)| {
            *value == 0.0 || ((cell % 33).abs_diff(16) <= 2 && (cell / 33).abs_diff(16) <= 2)
        }));
    }
}

#[test]
fn squares_leave_nothing_out() {
    // With one square for every pixel the list of moments is as exact as it gets; a whole picture must not differ.
    for text in [REFERENCE, TENT] {
        let rig = Rig::parse(text).unwrap();
        let apparatus = Apparatus::new(&rig);
        let white = vec![255; 768 * 768];
        let flashes = ideal(&rig, |_| Picture::Grey(&white));
        let view = View { pixels: 20, rays: 1, ..view(0.5) };
        let seen = expose(&rig, &flashes, 1.0, 1, &view, Brightness::Physical, &|| ());
        for cell in 0..400 {
            let direction = view.ray(cell % 20, cell / 20, 0, 0);
            let mut expected = [0.0; 3];
            for (flash, face) in flashes.iter().flat_map(|flash| (0..apparatus.faces()).map(move |face| (flash, face)))
            {
                let at = apparatus.face_at(face, (flash.start + flash.end) / 2.0);
                if let Some((weight, _)) = apparatus.arrival(face, &at, view.from, direction) {
                    expected =
                        core::array::from_fn(|channel| expected[channel] + weight * apparatus.colour(face)[channel]);
                }
            }
            let found = seen.colours[cell as usize];
            assert!((0..3).all(|channel| (f64::from(found[channel]) - expected[channel]).abs() < 1e-5), "{cell}");
        }
    }
}

#[test]
fn a_measured_lobe_takes_the_triangles_place() {
    let hat = Rig::parse(REFERENCE).unwrap();
    let lobe =
        REFERENCE.replace("diffuser_hat_radius_deg = 1.25", "diffuser_lobe = [[-1.25, 0.0], [0.0, 1.0], [1.25, 0.0]]");
    let lobe = Rig::parse(&lobe).unwrap();
    let white = vec![255; 768 * 768];
    let [hat, lobe] = [hat, lobe].map(|rig| {
        let flashes = ideal(&rig, |_| Picture::Grey(&white));
        expose(&rig, &flashes, 1.0, 2, &view(0.35), Brightness::Physical, &|| ()).colours
    });
    assert_eq!(hat, lobe);
}
