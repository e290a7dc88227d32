//! Blue-noise masks on a torus of columns, rows and slices by void and cluster (Ulichney 1993).

use super::hash;

/// Columns, rows and slices of a mask.
pub type Size = [usize; 3];

/// A mask of `size` that holds every rank from 0 once, columns first, then rows, then slices. Points repel each other
/// by a Gaussian of `sigma` pixels and `sigma_slices` slices. At most 65,536 cells.
pub fn void_and_cluster(size: Size, sigma: f64, sigma_slices: f64) -> Vec<u16> {
    let kernel = kernel(size, [sigma, sigma, sigma_slices]);
    let cells = size.iter().product();
    let mut start = Pattern { size, set: vec![false; cells], energy: vec![0; cells] };
    for index in 0..cells as u32 / 10 {
        let cell = hash(index, 1, 2) as usize % cells;
        if !start.set[cell] {
            start.toggle(cell, &kernel);
        }
    }
    // Each move lowers the pattern's energy, an integer: it ends.
    loop {
        let cluster = start.tightest_cluster();
        start.toggle(cluster, &kernel);
        let void = start.largest_void();
        if start.energy[void] >= start.energy[cluster] {
            start.toggle(cluster, &kernel);
            break;
        }
        start.toggle(void, &kernel);
    }
    let minority = start.set.iter().filter(|set| **set).count();
    let mut ranks = vec![0; cells];
    let mut thinned = start.clone();
    for rank in (0..minority).rev() {
        let cluster = thinned.tightest_cluster();
        thinned.toggle(cluster, &kernel);
        ranks[cluster] = rank as u16;
    }
    for rank in minority..cells {
        let void = start.largest_void();
        start.toggle(void, &kernel);
        ranks[void] = rank as u16;
    }
    ranks
}

/// How much a point adds at an offset.
struct Tap {
    offset: Size,
    energy: i32,
}

/// The Gaussian in whole numbers, so that a mask does not depend on the machine nor on the order of sums; without its
/// tail beyond 4 σ.
fn kernel(size: Size, sigma: [f64; 3]) -> Vec<Tap> {
    let axis = |axis: usize| {
        let fold = move |offset: usize| offset.min(size[axis] - offset) as f64 / sigma[axis];
        (0..size[axis]).map(move |offset| (offset, fold(offset))).filter(|(_, distance)| *distance <= 4.0)
    };
    let rows = axis(2).flat_map(|slice| axis(1).map(move |row| (slice, row)));
    rows.flat_map(|(slice, row)| axis(0).map(move |column| [column, row, slice]))
        .map(|axes| {
            let exponent = axes.map(|(_, distance)| distance * distance / 2.0).iter().sum::<f64>();
            Tap { offset: axes.map(|(offset, _)| offset), energy: (65_536.0 * (-exponent).exp()).round() as i32 }
        })
        .collect()
}

/// A pattern of minority pixels, with the energy that they cause everywhere.
#[derive(Clone)]
struct Pattern {
    size: Size,
    set: Vec<bool>,
    energy: Vec<i32>,
}

impl Pattern {
    fn toggle(&mut self, cell: usize, kernel: &[Tap]) {
        self.set[cell] = !self.set[cell];
        let sign = if self.set[cell] { 1 } else { -1 };
        let [columns, rows, _] = self.size;
        let place = [cell % columns, cell / columns % rows, cell / columns / rows];
        for tap in kernel {
            let [x, y, z] = core::array::from_fn(|axis| {
                let sum = place[axis] + tap.offset[axis];
                if sum < self.size[axis] { sum } else { sum - self.size[axis] }
            });
            self.energy[(z * rows + y) * columns + x] += sign * tap.energy;
        }
    }

    /// The first set cell with the most energy.
    fn tightest_cluster(&self) -> usize {
        let most = self.cells().fold(i32::MIN, |most, (set, energy)| most.max(if set { energy } else { i32::MIN }));
        self.cells().position(|cell| cell == (true, most)).unwrap_or(0)
    }

    /// The first unset cell with the least energy.
    fn largest_void(&self) -> usize {
        let least = self.cells().fold(i32::MAX, |least, (set, energy)| least.min(if set { i32::MAX } else { energy }));
        self.cells().position(|cell| cell == (false, least)).unwrap_or(0)
    }

    fn cells(&self) -> impl Iterator<Item = (bool, i32)> {
        self.set.iter().copied().zip(self.energy.iter().copied())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_rank_stands_once() {
        for size in [[16, 16, 1], [8, 16, 4]] {
            let mut ranks = void_and_cluster(size, 1.5, 0.8);
            ranks.sort_unstable();
            assert!(ranks.iter().enumerate().all(|(index, rank)| index == usize::from(*rank)), "{size:?}");
        }
    }

    #[test]
    fn energy_is_that_of_the_set_points() {
        let kernel = kernel([8, 8, 4], [1.0, 1.0, 0.7]);
        let mut pattern = Pattern { size: [8, 8, 4], set: vec![false; 256], energy: vec![0; 256] };
        for cell in [3, 200, 255, 3] {
            pattern.toggle(cell, &kernel);
        }
        let peak = pattern.energy[200];
        assert!(peak >= 65_536 && pattern.tightest_cluster() != 3, "{peak}");
        // The torus has no ends: cell 255 = (7, 7, 3) is a neighbour of (0, 7, 3), (7, 0, 3) and (7, 7, 0).
        for neighbour in [248, 199, 63] {
            assert!(pattern.energy[neighbour] > 20_000, "{neighbour}: {}", pattern.energy[neighbour]);
        }
        pattern.toggle(200, &kernel);
        pattern.toggle(255, &kernel);
        assert!(pattern.energy.iter().all(|energy| *energy == 0));
    }
}
