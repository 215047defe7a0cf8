//! Sparse symmetric equations, factored once and solved for many right sides.
//!
//! The factor `L` of `L L^T` is found group by group of unknowns, each in a dense front: Duff and Reid, "The multifrontal solution of
//! indefinite sparse symmetric linear equations" (1983); Liu, "The multifrontal method for sparse matrix solution: theory and practice"
//! (1992). Unknowns are ordered and grouped by nested dissection, which keeps the factors of a mesh's equations small. Sums are in one
//! order, for any number of threads.

use std::collections::BTreeMap;

pub use dissection::{Dissection, Links};
use front::Front;
use maquette_node::{Cancelled, Progress};
use maquette_value::parallel::*;

mod dissection;
mod front;

/// A symmetric matrix: each row's entries, both halves given.
pub struct Symmetric {
    /// Where each row begins in the other two lists, with the end behind the last.
    pub starts: Vec<u32>,
    /// The columns of entries.
    pub indices: Vec<u32>,
    /// The entries.
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

/// The factors of a matrix.
pub struct Cholesky {
    /// The unknown that is eliminated at each place.
    order: Vec<u32>,
    factors: Vec<Factor>,
}

/// The columns of `L` of one group of unknowns.
struct Factor {
    /// The place of the first one.
    first: usize,
    /// How many they are.
    count: usize,
    /// The places of their rows behind the group, ascending.
    below: Vec<u32>,
    columns: Front,
}

/// Below this share of a row's diagonal entry a pivot counts as zero: what is left is rounding.
const LEAST_PIVOT: f64 = 1e-13;

/// In place of a parent that does not exist.
const ROOT: u32 = u32::MAX;

/// Equations of at most so many unknowns are solved on one thread.
const ALONE: usize = 500;

impl Cholesky {
    /// The factors; none if the matrix is not positive definite.
    pub fn new(matrix: &Symmetric) -> Option<Self> {
        let links = Links { starts: &matrix.starts, neighbors: &matrix.indices };
        Self::ordered(matrix, &Dissection::new(links, 1), &Progress::none()).ok().flatten()
    }

    /// As [`new`](Self::new), with an order that is known.
    ///
    /// # Errors
    /// If the evaluation is told to stop.
    pub fn ordered(
        matrix: &Symmetric,
        dissection: &Dissection,
        progress: &Progress<'_>,
    ) -> Result<Option<Self>, Cancelled> {
        let order = &dissection.order;
        let mut place = vec![0u32; order.len()];
        (0..).zip(order).for_each(|(at, &unknown)| place[unknown as usize] = at);
        let tree = Tree::new(matrix, dissection, &place);
        let elimination = Elimination { matrix, order, place: &place, tree: &tree, progress };
        let (tasks, last) = tree.tasks(order.len());
        let done = tasks
            .par_iter()
            .map(|groups| elimination.run(groups, BTreeMap::new()))
            .collect::<Result<Vec<_>, Cancelled>>()?;
        let Some(done) = done.into_iter().collect::<Option<Vec<_>>>() else { return Ok(None) };
        let mut factors = Vec::with_capacity(tree.below.len());
        let mut left = BTreeMap::new();
        for (done, rest) in done {
            factors.extend(done);
            left.extend(rest);
        }
        let Some((done, _)) = elimination.run(&last, left)? else { return Ok(None) };
        factors.extend(done);
        factors.sort_by_key(|factor| factor.first);
        Ok(Some(Self { order: order.clone(), factors }))
    }

    /// Turns right sides into solutions, three at once.
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
    /// Solves for the group, and leaves in the rows below what this takes from their right sides.
    fn forwards(&self, x: &mut [[f64; 3]]) {
        for (k, column) in self.columns.entries.chunks_exact(self.columns.height).enumerate() {
            let known = x[k].map(|right| right / column[k]);
            x[k] = known;
            for (x, factor) in x[k + 1..].iter_mut().zip(&column[k + 1..]) {
                (0..3).for_each(|axis| x[axis] -= factor * known[axis]);
            }
        }
    }

    /// Solves for the group what the rows below leave.
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

/// The assembly tree: to the front of which later group each group of unknowns passes its update.
struct Tree {
    /// Where each group begins in the order, with the end behind the last.
    starts: Vec<u32>,
    /// For each group the rows below its own, by place in the order, ascending.
    below: Vec<Vec<u32>>,
    /// The first later group that each updates; [`ROOT`] if there is none.
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

    /// Groups that can be eliminated side by side, in parts that need nothing of each other, and those that need the parts.
    fn tasks(&self, unknowns: usize) -> (Vec<Vec<u32>>, Vec<u32>) {
        let count = self.parents.len();
        let mut sizes: Vec<u32> = self.starts.windows(2).map(|ends| ends[1] - ends[0]).collect();
        for k in 0..count {
            if self.parents[k] != ROOT {
                sizes[self.parents[k] as usize] += sizes[k];
            }
        }
        let most = if unknowns <= ALONE { 0 } else { unknowns * 3 / 5 };
        let (mut tasks, mut last) = (Vec::new(), Vec::new());
        let mut task = vec![ROOT; count];
        for k in (0..count).rev() {
            let parent = self.parents[k];
            let above = if parent == ROOT { ROOT } else { task[parent as usize] };
            if above != ROOT {
                task[k] = above;
            } else if sizes[k] as usize <= most {
                task[k] = tasks.len() as u32;
                tasks.push(Vec::new());
            }
            match task[k] {
                ROOT => last.push(k as u32),
                own => tasks[own as usize].push(k as u32),
            }
        }
        tasks.iter_mut().chain([&mut last]).for_each(|groups: &mut Vec<u32>| groups.reverse());
        (tasks, last)
    }
}

/// What groups leave to their parents.
type Rest = BTreeMap<u32, Front>;

struct Elimination<'a> {
    matrix: &'a Symmetric,
    order: &'a [u32],
    place: &'a [u32],
    tree: &'a Tree,
    progress: &'a Progress<'a>,
}

/// The columns of some groups, and what they leave to others; none if a pivot is not positive.
type Eliminated = Option<(Vec<Factor>, Rest)>;

impl Elimination<'_> {
    /// Eliminates groups in order, `rest` being what others have left to them.
    fn run(&self, groups: &[u32], mut rest: Rest) -> Result<Eliminated, Cancelled> {
        let mut local = vec![0u32; self.order.len()];
        let mut factors = Vec::with_capacity(groups.len());
        for &group in groups {
            let [first, end] = [0, 1].map(|k| self.tree.starts[group as usize + k] as usize);
            let below = &self.tree.below[group as usize];
            let count = end - first;
            (0..).zip(first..end).for_each(|(row, place)| local[place] = row);
            (count as u32..).zip(below).for_each(|(row, &place)| local[place as usize] = row);
            let mut front = Front::new(count + below.len());
            let mut least = vec![0.0; count];
            for k in 0..count {
                let column = front.column(k);
                for (other, entry) in self.matrix.row(self.order[first + k] as usize) {
                    let row = self.place[other] as usize;
                    if first + k <= row {
                        column[local[row] as usize] += entry;
                    }
                }
                least[k] = LEAST_PIVOT * column[k];
            }
            for &child in &self.tree.children[group as usize] {
                let Some(left) = rest.remove(&child) else { continue };
                let rows = &self.tree.below[child as usize];
                front.add(&left, rows, &local);
            }
            if !front.eliminate(&least, self.progress)? {
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
        let links = Links { starts: &matrix.starts, neighbors: &matrix.indices };
        let mut order = Dissection::new(links, 1).order;
        order.sort_unstable();
        assert!(order.into_iter().eq(0..1226));
        assert!(Cholesky::new(&matrix).is_some());
    }

    #[test]
    fn dissection_fills_far_less_than_the_given_order() {
        let factors = Cholesky::new(&grid(100, 100, 1.0)).unwrap();
        // In the given order the factor is a full band: 100 entries in each of 10 000 columns.
        let entries: usize =
            factors.factors.iter().map(|factor| factor.columns.entries.len()).sum();
        assert!(entries < 500_000, "{entries}");
    }

    #[test]
    fn unknowns_around_one_hub_fill_little() {
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
        // Two in each column, but for one small group. With the hub first it would be half a million.
        assert!(entries < 3000, "{entries}");
        // All are 1: a leaf has 2 - 1, the hub nothing.
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
    fn any_number_of_threads_finds_the_same_factors() {
        let matrix = grid(60, 50, 0.01);
        fn solved(threads: usize, matrix: &Symmetric) -> Vec<[f64; 3]> {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut x = vec![[1.0, 2.0, 3.0]; 3000];
            pool.install(|| Cholesky::new(matrix).unwrap().solve(&mut x));
            x
        }
        assert_eq!(solved(1, &matrix), solved(3, &matrix));
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_has_no_factors() {
        assert!(Cholesky::new(&grid(20, 20, 0.0)).is_none());
        assert!(Cholesky::new(&grid(20, 20, -1.0)).is_none());
        assert!(Cholesky::new(&grid(4, 4, f64::NAN)).is_none());
    }
}
