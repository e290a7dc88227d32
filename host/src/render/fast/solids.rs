//! Which triangles bound solids.

use super::super::mesh::Mesh;
use std::collections::HashMap;

/// For each triangle, whether it belongs to a solid whose outside is where its corners run counter-clockwise: to a part of the mesh, joined
/// by edges, every edge of which two triangles share that run through it in opposite directions, and whose volume is positive. Of such a
/// part no sight line from outside meets an inner side first.
pub fn solids(mesh: &Mesh) -> Vec<bool> {
    let mut parts = Parts((0..mesh.triangles.len() as u32).collect());
    let mut edges: HashMap<[u32; 2], Edge> = HashMap::with_capacity(mesh.triangles.len() * 3 / 2);
    for (index, triangle) in (0..).zip(&mesh.triangles) {
        let [a, b, c] = triangle.corners;
        for [from, to] in [[a, b], [b, c], [c, a]] {
            let edge = edges.entry([from.min(to), from.max(to)]).or_insert(Edge { triangle: index, uses: [0; 2] });
            edge.uses[usize::from(from > to)] += 1;
            parts.join(index, edge.triangle);
        }
    }
    let mut volumes = vec![0.0; mesh.triangles.len()];
    for (index, triangle) in (0..).zip(&mesh.triangles) {
        let [a, b, c] = mesh.corners(triangle);
        volumes[parts.of(index) as usize] += a.dot(b.cross(c));
    }
    for edge in edges.values().filter(|edge| edge.uses != [1; 2]) {
        volumes[parts.of(edge.triangle) as usize] = f64::NEG_INFINITY;
    }
    (0..mesh.triangles.len() as u32).map(|index| volumes[parts.of(index) as usize] > 0.0).collect()
}

/// Who uses an edge.
struct Edge {
    /// The first that did.
    triangle: u32,
    /// How often, from the lower index to the higher and back.
    uses: [u32; 2],
}

/// Sets of triangles, each known by one of them: of each triangle another of its set, or itself.
struct Parts(Vec<u32>);

impl Parts {
    fn of(&mut self, mut triangle: u32) -> u32 {
        while self.0[triangle as usize] != triangle {
            let next = self.0[triangle as usize];
            self.0[triangle as usize] = self.0[next as usize];
            triangle = next;
        }
        triangle
    }

    fn join(&mut self, one: u32, other: u32) {
        let (one, other) = (self.of(one), self.of(other));
        self.0[one as usize] = other;
    }
}
