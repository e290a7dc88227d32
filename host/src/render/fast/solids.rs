//! Which triangles bound solids.

use super::super::mesh::Mesh;

/// For each triangle, whether it belongs to a solid whose outside is where its corners run counter-clockwise: to a part of the mesh, joined
/// by edges, every edge of which two triangles share that run through it in opposite directions, and whose volume is positive. Of such a
/// part no sight line from outside meets an inner side first.
pub fn solids(mesh: &Mesh) -> Vec<bool> {
    let edges = Edges::new(mesh);
    let mut parts = Parts((0..mesh.triangles.len() as u32).collect());
    for uses in edges.each() {
        uses[1..].iter().for_each(|other| parts.join(triangle(*other), triangle(uses[0])));
    }
    let mut volumes = vec![0.0; mesh.triangles.len()];
    for (index, triangle) in (0..).zip(&mesh.triangles) {
        let [a, b, c] = mesh.corners(triangle);
        volumes[parts.of(index) as usize] += a.dot(b.cross(c));
    }
    for uses in edges.each() {
        let is_shared = uses.len() == 2 && (uses[0] ^ uses[1]) & 1 != 0;
        if !is_shared {
            volumes[parts.of(triangle(uses[0])) as usize] = f64::NEG_INFINITY;
        }
    }
    (0..mesh.triangles.len() as u32).map(|index| volumes[parts.of(index) as usize] > 0.0).collect()
}

/// Edges by their lower corner: 8 bytes a use, where a table of edges took 14 and more.
struct Edges {
    /// Where the uses of each lower corner's edges begin; and the end.
    starts: Vec<u32>,
    /// From above: 32 bits of the higher corner, 31 of the triangle, and 1 for those that run from it to the lower one. In order.
    uses: Vec<u64>,
}

/// The triangle of a use.
fn triangle(of_use: u64) -> u32 {
    of_use as u32 >> 1
}

impl Edges {
    fn new(mesh: &Mesh) -> Self {
        assert!(mesh.triangles.len() <= u32::MAX as usize / 3, "tessellation stops far below");
        let edges = || {
            (0u64..).zip(&mesh.triangles).flat_map(|(index, triangle)| {
                let [a, b, c] = triangle.corners;
                [[a, b], [b, c], [c, a]].map(|[from, to]| {
                    (from.min(to) as usize, u64::from(from.max(to)) << 32 | index << 1 | u64::from(from > to))
                })
            })
        };
        let mut starts = vec![0; mesh.positions.len() + 1];
        edges().for_each(|(lower, _)| starts[lower] += 1);
        let mut end = 0;
        for start in &mut starts {
            end += *start;
            *start = end;
        }
        let mut uses = vec![0; 3 * mesh.triangles.len()];
        for (lower, of_use) in edges() {
            starts[lower] -= 1;
            uses[starts[lower] as usize] = of_use;
        }
        starts.windows(2).for_each(|ends| uses[ends[0] as usize..ends[1] as usize].sort_unstable());
        Self { starts, uses }
    }

    /// The uses of each edge.
    fn each(&self) -> impl Iterator<Item = &[u64]> {
        let of_lower = self.starts.windows(2).map(|ends| &self.uses[ends[0] as usize..ends[1] as usize]);
        of_lower.flat_map(|uses| uses.chunk_by(|one, other| one >> 32 == other >> 32))
    }
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
