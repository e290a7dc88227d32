use super::super::tests::{REFERENCE, rigs, scatter};
use super::super::{FaceOptics, Method};
use super::*;
use crate::project::{SliceOptics, Visibility};
use glam::DVec2;
use proptest::prelude::*;
use protocol::rig::{Rig, TrackedViewer};

const N: usize = 32;

/// Asserts that every lane has the bits of its own `vertex`, and returns how many are on the panel.
fn check(projector: &SliceProjector<f32>, points: [[f32; N]; 3]) -> Result<usize, TestCaseError> {
    let [x, y, z] = &points;
    let lanes = projector.vertices([x, y, z]);
    for lane in 0..N {
        let bits = |pixel: [f32; 2], depth: f32, state| ([pixel[0], pixel[1], depth].map(f32::to_bits), state);
        let expected = projector.vertex(points.map(|axis| axis[lane])).map(|vertex| {
            bits(vertex.pixel, vertex.depth_m, i32::from(vertex.sides) | if vertex.lit { 0 } else { UNLIT })
        });
        let found = (lanes.state[lane] != NOWHERE)
            .then(|| bits(lanes.pixel.map(|axis| axis[lane]), lanes.depth_m[lane], lanes.state[lane]));
        prop_assert_eq!(found, expected, "lane {} {:?}", lane, points.map(|axis| axis[lane]));
    }
    Ok(lanes.state.iter().filter(|state| **state == 0).count())
}

#[test]
fn lanes_have_the_bits_of_one_vertex_on_rigs_that_can_be_built() {
    for rig in rigs() {
        for method in [Method::Planar, Method::ConeNewton, Method::ConeRoot] {
            let mut seen = 0;
            for face in 0..rig.mirror.face.len() {
                let optics = FaceOptics::<f32>::new(&rig, face, method);
                let points: Vec<_> = scatter(&rig, 1600).map(|(point, _)| point.as_vec3().to_array()).collect();
                for (part, points) in points.chunks_exact(N).enumerate() {
                    let points = [0, 1, 2].map(|axis| core::array::from_fn(|lane| points[lane][axis]));
                    seen += check(&optics.slice(rig.slice_angle(part as u32)), points).unwrap();
                }
            }
            assert!(seen > 80, "{seen}");
        }
    }
}

#[test]
fn the_table_s_lanes_are_within_its_error() {
    for rig in rigs() {
        let optics = FaceOptics::<f32>::new(&rig, 0, Method::ConeTable);
        for (point, theta) in scatter(&rig, 400) {
            let exact = SliceOptics::new(&rig, 0, theta, Method::ConeTable.model()).project(point);
            let [x, y, z] = point.as_vec3().to_array().map(|coordinate| [coordinate; 1]);
            let lanes = optics.slice(theta).vertices([&x, &y, &z]);
            if exact.visibility == Visibility::Visible {
                let pixel = DVec2::from_array(lanes.pixel.map(|axis| axis[0].into()));
                assert!(lanes.state == [0] && pixel.distance(exact.pixel.unwrap()) < 0.05, "{pixel} {exact:?}");
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// Of rigs that can and cannot be built, and points on them, far off, at the projector's image, and nowhere.
    #[test]
    fn lanes_have_the_bits_of_one_vertex(
        tilt in 1.0f64..89.0, offset in -0.05f64..0.05, position in prop::array::uniform3(-0.5f64..0.5), height in 0.2f64..2.0,
        focal in 100.0f64..8000.0, radial in prop::option::of(prop::array::uniform2(-0.5f64..0.5)),
        distance in 0.2f64..1e4, viewer_height in -2.0f64..5.0, infinite: bool, slice in 0u32..288,
        method in prop::sample::select(vec![Method::Planar, Method::ConeNewton, Method::ConeRoot]),
        mut points in prop::array::uniform3(prop::array::uniform32(-0.1f32..0.1)), scale in prop::option::of(1e-3f32..30.0),
        odd in prop::array::uniform3(any::<f32>()),
        viewers in prop::collection::vec((-30.0f64..30.0, 0.3f64..2.0, -0.5f64..1.2), 0..4),
    ) {
        let viewing = if infinite {
            format!("elevation_deg = {:?}", viewer_height * 10.0)
        } else {
            format!("distance_m = {distance:?}\nheight_m = {viewer_height:?}")
        };
        let radial = radial.map_or(String::new(), |radial| format!("\nradial = {radial:?}"));
        let text = REFERENCE
            .replace("distance_m = 0.9", "")
            .replace("height_m = 0.35", &viewing)
            .replace("tilt_deg = 45.0", &format!("tilt_deg = {tilt:?}"))
            .replace("offset_m = 0.0 ", &format!("offset_m = {offset:?} "))
            .replace("[0.0, 0.6, 0.0]", &format!("[{:?}, {height:?}, {:?}]", position[0], position[2]))
            .replace("focal_px = 3072.0", &format!("focal_px = {focal:?}{radial}"));
        // A rig may be impossible; then it is refused.
        let Ok(mut rig) = Rig::parse(&text) else { return Ok(()) };
        if !infinite {
            let around = rig.slice_angle(slice).to_degrees();
            let viewer = |(aside, distance_m, height_m): &(f64, f64, f64)| TrackedViewer {
                azimuth_deg: (around + aside) % 360.0,
                distance_m: *distance_m,
                height_m: *height_m,
            };
            rig.viewing.tracked = viewers.iter().map(viewer).collect();
        }
        let theta = rig.slice_angle(slice);
        let frame = rig.mirror.face[0].frame(theta);
        let projector = rig.camera().position;
        let image = projector - 2.0 * (frame.normal.dot(projector) - offset) * frame.normal;
        for axis in 0..3 {
            points[axis].iter_mut().for_each(|coordinate| *coordinate *= scale.unwrap_or(1.0));
            points[axis][0] = odd[axis];
            points[axis][1] = image.to_array()[axis] as f32;
            points[axis][2] = 0.0;
        }
        check(&FaceOptics::<f32>::new(&rig, 0, method).slice(theta), points)?;
    }
}
