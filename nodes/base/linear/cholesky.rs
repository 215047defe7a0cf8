//! Sparse Cholesky factorization, for symmetric systems that are factored once and solved for many right sides.
//!
//! The factor `L` in `L L^T` is computed for one group of unknowns after another, each in a dense matrix called its front: Duff and Reid,
//! "The multifrontal solution of indefinite sparse symmetric linear equations" (1983); Liu, "The multifrontal method for sparse matrix
//! solution: theory and practice" (1992). Unknowns are ordered and grouped by nested dissection, which keeps the factors of mesh equations
//! small. Sums are computed in a fixed order, so the result does not depend on the number of threads.

use std::collections::BTreeMap;

pub use dissection::{Dissection, Links};
use front::Front;
use maquette_node::{CancelledError, Progress};
use maquette_value::parallel::*;

mod dissection;
mod front;

/// A sparse symmetric matrix, stored by rows. Both halves are stored.
pub struct Symmetric {
    /// For each row the index at which it begins in `indices` and `entries`, followed by the length of these lists.
    pub starts: Vec<u32>,
    /// The column index of each stored entry, row by row.
    pub indices: Vec<u32>,
    /// The value of each stored entry, row by row.
    pub entries: Vec<f64>,
}

impl Symmetric {
    fn row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> {
        let entries = self.starts[row] as usize..self.starts[row + 1] as usize;
        let indices = self.indices[entries.clone()].iter().map(|&index| index as usize);
        indices.zip(self.entries[entries].iter().copied())
    }

    fn neighbors(&self, row: usize) -> &[u32] {
        &self.indices[self.starts[row] as usize..self.starts[row + 1] as usize]
    }
}

/// The Cholesky factor of a matrix.
pub struct Cholesky {
    /// The unknowns in elimination order.
    order: Vec<u32>,
    factors: Vec<Factor>,
}

/// The columns of `L` for one group of unknowns.
struct Factor {
    /// The position of the group's first unknown in the elimination order.
    first: usize,
    /// The number of unknowns in the group.
    count: usize,
    /// The rows below the group that have nonzero entries in its columns, as positions in the elimination order, ascending.
    below: Vec<u32>,
    columns: Front,
}

/// A pivot that is less than this fraction of its row's diagonal entry counts as zero, because such a pivot consists only of rounding
/// errors.
const MIN_PIVOT: f64 = 1e-13;

/// Marks a group that has no parent in the assembly tree.
const ROOT: u32 = u32::MAX;

/// A system with at most this many unknowns is factored on one thread.
const MAX_SEQUENTIAL_UNKNOWNS: usize = 500;

/// The minimum number of subtrees into which the assembly tree of a large system is divided, and the number of unknowns of a subtree that is
/// not worth dividing.
const MIN_TASKS: usize = 64;
const MIN_TASK_UNKNOWNS: usize = 200;

impl Cholesky {
    /// Factors a matrix. Returns `None` if the matrix is not positive definite.
    pub fn new(matrix: &Symmetric) -> Option<Self> {
        let links = Links { starts: &matrix.starts, neighbors: &matrix.indices };
        Self::with_ordering(matrix, &Dissection::new(links, 1), &Progress::silent()).ok().flatten()
    }

    /// Factors a matrix like [`new`](Self::new), with a given elimination order.
    ///
    /// # Errors
    /// If the evaluation is cancelled.
    pub fn with_ordering(
        matrix: &Symmetric,
        dissection: &Dissection,
        progress: &Progress<'_>,
    ) -> Result<Option<Self>, CancelledError> {
        let order = &dissection.order;
        let mut place = vec![0u32; order.len()];
        (0..).zip(order).for_each(|(at, &unknown)| place[unknown as usize] = at);
        let tree = Tree::new(matrix, dissection, &place);
        let elimination = Elimination { matrix, order, place: &place, tree: &tree, progress };
        let mut factors = Vec::with_capacity(tree.below.len());
        let mut left = PendingUpdates::new();
        for wave in tree.waves(order.len()) {
            let ready: Vec<_> =
                wave.into_iter().map(|task| tree.with_updates(task, &mut left)).collect();
            let done = ready
                .into_par_iter()
                .map(|(groups, updates): (Vec<u32>, _)| elimination.run(&groups, updates))
                .collect::<Result<Vec<_>, CancelledError>>()?;
            let Some(done) = done.into_iter().collect::<Option<Vec<_>>>() else { return Ok(None) };
            for (done, rest) in done {
                factors.extend(done);
                left.extend(rest);
            }
        }
        factors.sort_by_key(|factor| factor.first);
        Ok(Some(Self { order: order.clone(), factors }))
    }

    /// Replaces three right sides (one per coordinate) by their solutions.
    pub fn solve(&self, right: &mut [[f64; 3]]) {
        let mut x: Vec<[f64; 3]> = self.order.iter().map(|&k| right[k as usize]).collect();
        let mut own = Vec::new();
        for factor in &self.factors {
            own.clear();
            own.extend_from_slice(&x[factor.first..factor.first + factor.count]);
            own.resize(factor.columns.height, [0.0; 3]);
            factor.forwards(&mut own);
            x[factor.first..factor.first + factor.count].copy_from_slice(&own[..factor.count]);
            for (&row, change) in factor.below.iter().zip(&own[factor.count..]) {
                (0..3).for_each(|axis| x[row as usize][axis] += change[axis]);
            }
        }
        for factor in self.factors.iter().rev() {
            own.clear();
            own.extend_from_slice(&x[factor.first..factor.first + factor.count]);
            own.extend(factor.below.iter().map(|&row| x[row as usize]));
            own.resize(factor.columns.height, [0.0; 3]);
            factor.backwards(&mut own);
            x[factor.first..factor.first + factor.count].copy_from_slice(&own[..factor.count]);
        }
        self.order.iter().zip(x).for_each(|(&k, x)| right[k as usize] = x);
    }
}

impl Factor {
    /// Forward substitution: solves for the unknowns of the group, and subtracts their contributions from the right sides of the rows
    /// below.
    fn forwards(&self, x: &mut [[f64; 3]]) {
        for (k, column) in self.columns.entries.chunks_exact(self.columns.height).enumerate() {
            let known = x[k].map(|right| right / column[k]);
            x[k] = known;
            for (x, factor) in x[k + 1..].iter_mut().zip(&column[k + 1..]) {
                (0..3).for_each(|axis| x[axis] -= factor * known[axis]);
            }
        }
    }

    /// Back substitution: solves for the unknowns of the group, given the solution for the rows below.
    fn backwards(&self, x: &mut [[f64; 3]]) {
        for (k, column) in self.columns.entries.chunks_exact(self.columns.height).enumerate().rev()
        {
            let mut sum = x[k];
            for (x, factor) in x[k + 1..].iter().zip(&column[k + 1..]) {
                (0..3).for_each(|axis| sum[axis] -= factor * x[axis]);
            }
            x[k] = sum.map(|sum| sum / column[k]);
        }
    }
}

/// The assembly tree of the groups of unknowns. The elimination of a group leaves an update, which is added to the front (dense matrix) of
/// the group's parent. The parent is a later group.
struct Tree {
    /// For each group the position in the elimination order at which it begins, followed by the number of unknowns.
    starts: Vec<u32>,
    /// For each group the rows below it that have nonzero entries in its columns, as positions in the elimination order, ascending.
    below: Vec<Vec<u32>>,
    /// For each group its parent, which is the first later group that is updated by the elimination of the group; [`ROOT`] if there is
    /// none.
    parents: Vec<u32>,
    children: Vec<Vec<u32>>,
}

impl Tree {
    fn new(matrix: &Symmetric, dissection: &Dissection, place: &[u32]) -> Self {
        let starts = &dissection.groups;
        let count = starts.len() - 1;
        let mut group = Vec::with_capacity(place.len());
        for (k, ends) in starts.windows(2).enumerate() {
            group.resize(ends[1] as usize, k as u32);
        }
        let mut tree = Self {
            starts: starts.clone(),
            below: Vec::with_capacity(count),
            parents: vec![ROOT; count],
            children: vec![Vec::new(); count],
        };
        let mut met = vec![ROOT; place.len()];
        for k in 0..count {
            let [start, end] = [starts[k], starts[k + 1]];
            let own = &dissection.order[start as usize..end as usize];
            let linked = own.iter().flat_map(|&unknown| matrix.neighbors(unknown as usize));
            let linked = linked.map(|&other| place[other as usize]);
            let inherited = tree.children[k].iter().flat_map(|&child| &tree.below[child as usize]);
            let mut below: Vec<u32> = linked
                .chain(inherited.copied())
                .filter(|&row| {
                    end <= row && std::mem::replace(&mut met[row as usize], k as u32) != k as u32
                })
                .collect();
            below.sort_unstable();
            if let Some(&next) = below.first() {
                tree.parents[k] = group[next as usize];
                tree.children[group[next as usize] as usize].push(k as u32);
            }
            tree.below.push(below);
        }
        tree
    }

    /// Divides the groups of unknowns into waves of tasks. The tasks of a wave, lists of groups, are independent of each other; they depend
    /// on the tasks of earlier waves. The tasks of the first wave are small subtrees, those of later waves single groups.
    fn waves(&self, unknowns: usize) -> Vec<Vec<Vec<u32>>> {
        let count = self.parents.len();
        if unknowns <= MAX_SEQUENTIAL_UNKNOWNS {
            return vec![vec![(0..count as u32).collect()]];
        }
        let mut sizes: Vec<u32> = self.starts.windows(2).map(|ends| ends[1] - ends[0]).collect();
        for k in 0..count {
            if self.parents[k] != ROOT {
                sizes[self.parents[k] as usize] += sizes[k];
            }
        }
        let most = (unknowns / MIN_TASKS).max(MIN_TASK_UNKNOWNS);
        let mut subtrees = Vec::new();
        let mut subtree = vec![ROOT; count];
        for k in (0..count).rev() {
            let parent = self.parents[k];
            let above = if parent == ROOT { ROOT } else { subtree[parent as usize] };
            if above != ROOT {
                subtree[k] = above;
            } else if sizes[k] as usize <= most {
                subtree[k] = subtrees.len() as u32;
                subtrees.push(Vec::new());
            }
            if let Some(groups) = subtrees.get_mut(subtree[k] as usize) {
                groups.push(k as u32);
            }
        }
        subtrees.iter_mut().for_each(|groups: &mut Vec<u32>| groups.reverse());
        let mut waves = vec![subtrees];
        // For each group the number of waves before its own.
        let mut waves_before = vec![1; count];
        for k in 0..count {
            if subtree[k] != ROOT {
                continue;
            }
            let children = self.children[k].iter().map(|&child| child as usize);
            let after = children.filter(|&child| subtree[child] == ROOT);
            waves_before[k] = after.map(|child| waves_before[child] + 1).max().unwrap_or(1);
            if waves.len() <= waves_before[k] {
                waves.push(Vec::new());
            }
            waves[waves_before[k]].push(vec![k as u32]);
        }
        waves
    }

    /// Takes the updates for the groups of a task.
    fn with_updates(
        &self,
        task: Vec<u32>,
        pending: &mut PendingUpdates,
    ) -> (Vec<u32>, PendingUpdates) {
        let children = task.iter().flat_map(|&group| &self.children[group as usize]);
        let updates = children.filter_map(|child| pending.remove_entry(child)).collect();
        (task, updates)
    }
}

/// The updates that eliminated groups have left for their parents. The key is the eliminated group.
type PendingUpdates = BTreeMap<u32, Front>;

struct Elimination<'a> {
    matrix: &'a Symmetric,
    order: &'a [u32],
    place: &'a [u32],
    tree: &'a Tree,
    progress: &'a Progress<'a>,
}

/// The factor's columns for some groups, and the updates that these groups have left for their parents; `None` if a pivot is not positive.
type EliminationResult = Option<(Vec<Factor>, PendingUpdates)>;

impl Elimination<'_> {
    /// Eliminates groups in order. `rest` contains the updates that earlier eliminated groups have left for these groups.
    fn run(
        &self,
        groups: &[u32],
        mut rest: PendingUpdates,
    ) -> Result<EliminationResult, CancelledError> {
        let mut local = vec![0u32; self.order.len()];
        let mut factors = Vec::with_capacity(groups.len());
        for &group in groups {
            let [first, end] = [0, 1].map(|k| self.tree.starts[group as usize + k] as usize);
            let below = &self.tree.below[group as usize];
            let count = end - first;
            (0..).zip(first..end).for_each(|(row, place)| local[place] = row);
            (count as u32..).zip(below).for_each(|(row, &place)| local[place as usize] = row);
            let mut front = Front::new(count + below.len());
            let mut min_pivots = vec![0.0; count];
            for k in 0..count {
                let column = front.column(k);
                for (other, entry) in self.matrix.row(self.order[first + k] as usize) {
                    let row = self.place[other] as usize;
                    if first + k <= row {
                        column[local[row] as usize] += entry;
                    }
                }
                min_pivots[k] = MIN_PIVOT * column[k];
            }
            for &child in &self.tree.children[group as usize] {
                let Some(left) = rest.remove(&child) else { continue };
                let rows = &self.tree.below[child as usize];
                front.add(&left, rows, &local);
            }
            if !front.eliminate(&min_pivots, self.progress)? {
                return Ok(None);
            }
            if !below.is_empty() {
                rest.insert(group, front.split(count));
            }
            factors.push(Factor { first, count, below: below.clone(), columns: front });
        }
        Ok(Some((factors, rest)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the Laplace matrix of a grid, with `spring` added to the diagonal.
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
    fn the_order_contains_every_unknown_of_disconnected_matrices() {
        let mut matrix = grid(30, 20, 1.0);
        // The matrix has two grids that are not linked to each other, and an isolated unknown.
        let other = grid(25, 25, 1.0);
        let (rows, entries) = (600u32, matrix.indices.len() as u32);
        matrix.starts.extend(other.starts[1..].iter().map(|start| start + entries));
        matrix.indices.extend(other.indices.iter().map(|index| index + rows));
        matrix.entries.extend(other.entries);
        matrix.indices.push(600 + 625);
        matrix.entries.push(2.0);
        matrix.starts.push(matrix.indices.len() as u32);
        let links = Links { starts: &matrix.starts, neighbors: &matrix.indices };
        let mut order = Dissection::new(links, 1).order;
        order.sort_unstable();
        assert!(order.into_iter().eq(0..1226));
        assert!(Cholesky::new(&matrix).is_some());
    }

    #[test]
    fn dissection_gives_much_less_fill_than_the_given_order() {
        let factors = Cholesky::new(&grid(100, 100, 1.0)).unwrap();
        // With the rows in the given order, the factor would be a full band: 100 entries in each of 10 000 columns.
        let entries: usize =
            factors.factors.iter().map(|factor| factor.columns.entries.len()).sum();
        assert!(entries < 500_000, "{entries}");
    }

    #[test]
    fn unknowns_around_one_hub_give_little_fill() {
        let count = 1000;
        let mut matrix = Symmetric { starts: vec![0], indices: vec![], entries: vec![] };
        for k in 0..count {
            matrix.indices.extend([k, count]);
            matrix.entries.extend([2.0, -1.0]);
            matrix.starts.push(matrix.indices.len() as u32);
        }
        matrix.indices.extend(0..=count);
        matrix.entries.extend((0..count).map(|_| -1.0));
        matrix.entries.push(f64::from(count));
        matrix.starts.push(matrix.indices.len() as u32);
        let factors = Cholesky::new(&matrix).unwrap();
        let entries: usize =
            factors.factors.iter().map(|factor| factor.columns.entries.len()).sum();
        // Each column of the factor has two entries, except in one small group. If the hub were eliminated first, the factor would have
        // half a million entries.
        assert!(entries < 3000, "{entries}");
        // The solution is 1 for all unknowns: the row of a leaf gives 2 - 1 = 1, and the row of the hub gives 1000 - 1000 = 0.
        let mut x = vec![[1.0; 3]; count as usize];
        x.push([0.0; 3]);
        factors.solve(&mut x);
        assert!(x.iter().flatten().all(|x| (x - 1.0).abs() < 1e-12));
    }

    #[test]
    fn equations_that_no_level_divides_are_solved() {
        let count = 150;
        let matrix = Symmetric {
            starts: (0..=count).map(|k| k * count).collect(),
            indices: (0..count * count).map(|k| k % count).collect(),
            entries: (0..count)
                .flat_map(|k| (0..count).map(move |other| if other == k { 150.0 } else { -0.5 }))
                .collect(),
        };
        let mut x = vec![[150.0 - 0.5 * 149.0; 3]; count as usize];
        Cholesky::new(&matrix).unwrap().solve(&mut x);
        assert!(x.iter().flatten().all(|x| (x - 1.0).abs() < 1e-12));
    }

    #[test]
    fn factors_do_not_depend_on_the_number_of_threads() {
        let matrix = grid(60, 50, 0.01);
        fn solve_with_threads(threads: usize, matrix: &Symmetric) -> Vec<[f64; 3]> {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut x = vec![[1.0, 2.0, 3.0]; 3000];
            pool.install(|| Cholesky::new(matrix).unwrap().solve(&mut x));
            x
        }
        assert_eq!(solve_with_threads(1, &matrix), solve_with_threads(3, &matrix));
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_has_no_factors() {
        assert!(Cholesky::new(&grid(20, 20, 0.0)).is_none());
        assert!(Cholesky::new(&grid(20, 20, -1.0)).is_none());
        assert!(Cholesky::new(&grid(4, 4, f64::NAN)).is_none());
    }
}
