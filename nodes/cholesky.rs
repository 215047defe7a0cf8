//! Sparse symmetric equations, factored once and solved for many right sides.
//!
//! The factors `L D L^T` are found row by row along the elimination tree: Liu, "The role of elimination trees in sparse
//! factorization" (1990); Davis, "Algorithm 849: a concise sparse Cholesky factorization package" (2005). Unknowns are ordered by
//! nested dissection, which keeps the factors of a mesh's equations small: George, "Nested dissection of a regular finite element
//! mesh" (1973), with the middle level of a breadth-first search as separator. Everything runs in one order on one thread.

/// A symmetric matrix: each row's entries, both halves given.
pub(crate) struct Symmetric {
    pub(crate) starts: Vec<u32>,
    pub(crate) indices: Vec<u32>,
    pub(crate) entries: Vec<f64>,
}

impl Symmetric {
    /// The number of rows.
    fn len(&self) -> usize {
        self.starts.len() - 1
    }

    fn row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> {
        let entries = self.starts[row] as usize..self.starts[row + 1] as usize;
        let indices = self.indices[entries.clone()].iter().map(|&index| index as usize);
        indices.zip(self.entries[entries].iter().copied())
    }

    fn neighbors(&self, row: usize) -> &[u32] {
        &self.indices[self.starts[row] as usize..self.starts[row + 1] as usize]
    }
}

/// The factors of a matrix.
pub(crate) struct Cholesky {
    /// The unknown that is eliminated at each place.
    order: Vec<u32>,
    /// The columns of `L` below its diagonal of ones: column `k` has the entries `starts[k]..starts[k + 1]`.
    starts: Vec<usize>,
    indices: Vec<u32>,
    entries: Vec<f64>,
    /// The diagonal of `D`.
    diagonal: Vec<f64>,
}

/// Below this share of a row's diagonal entry a pivot counts as zero: what is left is rounding.
const LEAST_PIVOT: f64 = 1e-13;

/// In place of a parent that does not exist.
const ROOT: u32 = u32::MAX;

impl Cholesky {
    /// The factors; none if the matrix is not positive definite.
    pub(crate) fn new(matrix: &Symmetric) -> Option<Self> {
        let count = matrix.len();
        let order = dissection(matrix);
        let mut place = vec![0u32; count];
        (0..).zip(&order).for_each(|(at, &unknown)| place[unknown as usize] = at);
        let (parents, lengths) = elimination_tree(matrix, &order, &place);
        let mut starts = vec![0usize; count + 1];
        for k in 0..count {
            starts[k + 1] = starts[k] + lengths[k] as usize;
        }
        let mut factors = Self {
            order,
            indices: vec![0; starts[count]],
            entries: vec![0.0; starts[count]],
            diagonal: vec![0.0; count],
            starts,
        };
        factors.fill(matrix, &place, &parents).then_some(factors)
    }

    /// Computes row after row of `L`; false if a pivot is not positive.
    fn fill(&mut self, matrix: &Symmetric, place: &[u32], parents: &[u32]) -> bool {
        let count = matrix.len();
        let mut ends = self.starts.clone();
        let mut row = vec![0.0; count];
        let mut met = vec![ROOT; count];
        let (mut way, mut pattern) = (Vec::new(), Vec::new());
        for k in 0..count {
            met[k] = k as u32;
            pattern.clear();
            let mut size = 0.0;
            for (column, entry) in matrix.row(self.order[k] as usize) {
                let column = place[column] as usize;
                if column > k {
                    continue;
                }
                if column == k {
                    size = entry;
                }
                row[column] += entry;
                // What the entry fills on its way to the diagonal, deepest last.
                let mut at = column;
                while met[at] != k as u32 {
                    way.push(at);
                    met[at] = k as u32;
                    at = parents[at] as usize;
                }
                pattern.extend(way.drain(..).rev());
            }
            let mut pivot = std::mem::take(&mut row[k]);
            // Backwards each column comes before those that it changes.
            for &column in pattern.iter().rev() {
                let entry = std::mem::take(&mut row[column]);
                let below = self.starts[column]..ends[column];
                for (&index, factor) in self.indices[below.clone()].iter().zip(&self.entries[below])
                {
                    row[index as usize] -= factor * entry;
                }
                let factor = entry / self.diagonal[column];
                pivot -= factor * entry;
                self.indices[ends[column]] = k as u32;
                self.entries[ends[column]] = factor;
                ends[column] += 1;
            }
            // A pivot that is NaN divides no better.
            let divides = pivot > LEAST_PIVOT * size;
            if !divides {
                return false;
            }
            self.diagonal[k] = pivot;
        }
        true
    }

    /// Turns right sides into solutions, three at once.
    pub(crate) fn solve(&self, right: &mut [[f64; 3]]) {
        let mut x: Vec<[f64; 3]> = self.order.iter().map(|&k| right[k as usize]).collect();
        for k in 0..x.len() {
            let known = x[k];
            for (index, factor) in self.column(k) {
                (0..3).for_each(|axis| x[index][axis] -= factor * known[axis]);
            }
        }
        for k in (0..x.len()).rev() {
            let mut sum = x[k].map(|right| right / self.diagonal[k]);
            for (index, factor) in self.column(k) {
                (0..3).for_each(|axis| sum[axis] -= factor * x[index][axis]);
            }
            x[k] = sum;
        }
        self.order.iter().zip(x).for_each(|(&k, x)| right[k as usize] = x);
    }

    fn column(&self, k: usize) -> impl Iterator<Item = (usize, f64)> {
        let entries = self.starts[k]..self.starts[k + 1];
        let indices = self.indices[entries.clone()].iter().map(|&index| index as usize);
        indices.zip(self.entries[entries].iter().copied())
    }
}

/// For each place the next one that its column of `L` reaches, and how many it reaches.
fn elimination_tree(matrix: &Symmetric, order: &[u32], place: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let count = order.len();
    let (mut parents, mut lengths) = (vec![ROOT; count], vec![0u32; count]);
    let mut met = vec![ROOT; count];
    for k in 0..count {
        met[k] = k as u32;
        for &column in matrix.neighbors(order[k] as usize) {
            let mut at = place[column as usize] as usize;
            while at < k && met[at] != k as u32 {
                if parents[at] == ROOT {
                    parents[at] = k as u32;
                }
                lengths[at] += 1;
                met[at] = k as u32;
                at = parents[at] as usize;
            }
        }
    }
    (parents, lengths)
}

/// Parts of at most so many unknowns are not divided further.
const SMALL: usize = 48;

/// The unknowns in an order in which few entries are filled: two halves, each ordered alike, and then what separates them.
fn dissection(matrix: &Symmetric) -> Vec<u32> {
    let count = matrix.len();
    let mut order = vec![0u32; count];
    let mut part = vec![0u32; count];
    let mut parts = 1;
    // Each job is a part of the unknowns and where it ends in the order.
    let mut jobs = vec![((0..count as u32).collect::<Vec<u32>>(), count, 0u32)];
    while let Some((members, end, own)) = jobs.pop() {
        let mut put = |members: &[u32], end: usize| {
            order[end - members.len()..end].copy_from_slice(members);
        };
        let Some(first) = members.first().filter(|_| SMALL < members.len()) else {
            put(&members, end);
            continue;
        };
        let mut search = Search { matrix, part: &mut part, own, new: parts };
        // From far out, so that levels are many and small.
        let (far, _) = search.levels(*first);
        search.own = search.new;
        search.new += 1;
        let (reached, levels) = search.levels(far[far.len() - 1]);
        let inside = search.new + 1;
        parts = inside + 3;
        let [before, after, apart] = [inside, inside + 1, inside + 2];
        let rest: Vec<u32> = members.iter().copied().filter(|&k| part[k as usize] == own).collect();
        rest.iter().for_each(|&k| part[k as usize] = apart);
        let middle = (1..levels.len()).find(|&level| levels[level] >= reached.len() / 2);
        let middle = middle.unwrap_or(1);
        let (low, high) = (levels[middle - 1], levels[middle]);
        if levels.len() < 4 {
            // No level divides it.
            put(&reached, end);
            jobs.push((rest, end - reached.len(), apart));
            continue;
        }
        let (first, second, separator) = (&reached[..low], &reached[high..], &reached[low..high]);
        first.iter().for_each(|&k| part[k as usize] = before);
        second.iter().for_each(|&k| part[k as usize] = after);
        put(separator, end);
        let end = end - separator.len();
        jobs.push((rest, end - first.len() - second.len(), apart));
        jobs.push((first.to_vec(), end - second.len(), before));
        jobs.push((second.to_vec(), end, after));
    }
    order
}

/// A breadth-first search in one part of the unknowns, which makes what it reaches a new part.
struct Search<'a> {
    matrix: &'a Symmetric,
    part: &'a mut [u32],
    own: u32,
    new: u32,
}

impl Search<'_> {
    /// What can be reached, nearest first, and where each level begins, with the end behind the last.
    fn levels(&mut self, start: u32) -> (Vec<u32>, Vec<usize>) {
        let mut reached = vec![start];
        let mut levels = vec![0];
        self.part[start as usize] = self.new;
        let mut next = 0;
        while next < reached.len() {
            let end = reached.len();
            levels.push(end);
            while next < end {
                for &neighbor in self.matrix.neighbors(reached[next] as usize) {
                    if self.part[neighbor as usize] == self.own {
                        self.part[neighbor as usize] = self.new;
                        reached.push(neighbor);
                    }
                }
                next += 1;
            }
        }
        (reached, levels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The equations of a membrane on a grid, with a spring at each point.
    fn grid(width: usize, height: usize, spring: f64) -> Symmetric {
        let mut matrix = Symmetric { starts: vec![0], indices: vec![], entries: vec![] };
        for k in 0..width * height {
            let (row, column) = (k / width, k % width);
            let mut around = Vec::new();
            if row > 0 {
                around.push(k - width);
            }
            if column > 0 {
                around.push(k - 1);
            }
            if column + 1 < width {
                around.push(k + 1);
            }
            if row + 1 < height {
                around.push(k + width);
            }
            matrix.indices.extend(around.iter().map(|&k| k as u32));
            matrix.entries.extend(around.iter().map(|_| -1.0));
            matrix.indices.push(k as u32);
            matrix.entries.push(around.len() as f64 + spring);
            matrix.starts.push(matrix.indices.len() as u32);
        }
        matrix
    }

    #[test]
    fn a_solution_solves() {
        for [width, height] in [[1, 1], [3, 2], [40, 31], [1, 300], [200, 7]] {
            let matrix = grid(width, height, 0.01);
            let expected: Vec<[f64; 3]> = (0..width * height)
                .map(|k| [k as f64, libm::sin(k as f64), 1.0 / (1.0 + k as f64)])
                .collect();
            let mut x: Vec<[f64; 3]> = (0..expected.len())
                .map(|row| {
                    matrix.row(row).fold([0.0; 3], |sum, (k, entry)| {
                        [0, 1, 2].map(|axis| sum[axis] + entry * expected[k][axis])
                    })
                })
                .collect();
            Cholesky::new(&matrix).unwrap().solve(&mut x);
            for (x, expected) in x.iter().zip(&expected) {
                for axis in 0..3 {
                    let scale = (width * height) as f64;
                    assert!((x[axis] - expected[axis]).abs() <= 1e-11 * scale, "{width} {height}");
                }
            }
        }
    }

    #[test]
    fn every_unknown_has_its_place_in_the_order_also_of_separate_parts() {
        let mut matrix = grid(30, 20, 1.0);
        // A second grid that nothing links to the first, and a lonely unknown.
        let other = grid(25, 25, 1.0);
        let (rows, entries) = (600u32, matrix.indices.len() as u32);
        matrix.starts.extend(other.starts[1..].iter().map(|start| start + entries));
        matrix.indices.extend(other.indices.iter().map(|index| index + rows));
        matrix.entries.extend(other.entries);
        matrix.indices.push(600 + 625);
        matrix.entries.push(2.0);
        matrix.starts.push(matrix.indices.len() as u32);
        let mut order = dissection(&matrix);
        order.sort_unstable();
        assert!(order.into_iter().eq(0..1226));
        assert!(Cholesky::new(&matrix).is_some());
    }

    #[test]
    fn dissection_fills_far_less_than_the_given_order() {
        let factors = Cholesky::new(&grid(100, 100, 1.0)).unwrap();
        // In the given order the factor is a full band: 100 entries in each of 10 000 columns.
        assert!(factors.indices.len() < 300_000, "{}", factors.indices.len());
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_has_no_factors() {
        assert!(Cholesky::new(&grid(20, 20, 0.0)).is_none());
        assert!(Cholesky::new(&grid(20, 20, -1.0)).is_none());
        assert!(Cholesky::new(&grid(4, 4, f64::NAN)).is_none());
    }
}
