//! Where vertices go.

use super::*;
use glam::DVec3;
use protocol::rig::Rig;
use shaders::project::methods::{FaceOptics, Method};

#[test]
fn vertices_are_where_the_projector_says() {
    let rig = Rig::parse(include_str!("../../../rigs/reference.toml")).unwrap();
    let size = [rig.projector.width_px, rig.projector.height_px];
    let points = [[0.0, 0.0, 0.0], [0.03, -0.02, 0.01], [-0.01, 0.05, 0.02], [0.1, 0.2, -0.3], [9.0, 0.0, 0.0]];
    let inks = Inks { each: vec![Ink::Shaded], ..Inks::default() };
    let figure = Figure::new(&points.map(DVec3::from_array), [[0, 1, 4]].into_iter(), &[false], inks);
    assert_eq!(figure.radius_m, 9.0);
    let grid = Grid::new(size, figure.radius_m);
    for method in [Method::Planar, Method::ConeNewton] {
        let projector = FaceOptics::<f32>::new(&rig, 0, method).slice(rig.slice_angle(39));
        let mut vertices = Vertices::default();
        vertices.project(&figure, &projector, &grid);
        for (index, (point, packed)) in (0..).zip(points.iter().zip(vertices.packed())) {
            let state = packed >> 48;
            let Some(vertex) = projector.vertex(point.map(|axis| axis as f32)) else {
                assert_eq!(state & 0x20, 0x20, "{point:?}");
                continue;
            };
            assert_eq!(state & 0xF, u64::from(vertex.sides), "{point:?}");
            if state & 0x80 == 0 {
                let [x, y, depth] = [packed << 48, packed << 32, packed << 16].map(|part| part as i64 >> 48);
                let steps = [0, 1].map(|axis| (vertex.pixel[axis] - size[axis] as f32 / 2.0) * grid.steps() as f32);
                assert!((x as f32 - steps[0]).abs() < 0.51 && (y as f32 - steps[1]).abs() < 0.51, "{point:?}");
                let fine = vertices.fine(index).map(|place| place as f32 / 8.0);
                assert!((0..2).all(|axis| (fine[axis] - steps[axis]).abs() < 0.51 / 8.0), "{point:?}");
                assert!(
                    (depth as f32 * depth_step_m(figure.radius_m) / 2.0 - vertex.depth_m).abs() < 1e-3,
                    "{point:?}"
                );
            }
        }
        let states: Vec<_> = vertices.packed()[..points.len()].iter().map(|packed| packed >> 48 & 0xFF).collect();
        assert!(states[..3] == [0; 3] && states[3..].iter().all(|state| *state != 0), "{states:?}");
    }
}
