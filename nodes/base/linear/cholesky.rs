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
    schedule: Schedule,
}

/// The columns of `L` for one group of unknowns.
struct Factor {
    /// The position of the group's first unknown in the elimination order.
    first: usize,
    /// The number of unknowns in the group.
    count: usize,
    /// The rows below the group that have nonzero entries in its columns, as positions in the elimination order, ascending.
    below: Vec<u32>,
    /// The number of rows below the group that belong to the same task of the schedule.
    inside: usize,
    columns: Front,
}

/// A pivot that is less than this fraction of its row's diagonal entry counts as zero, because such a pivot consists only of rounding
/// errors.
const MIN_PIVOT: f64 = 1e-13;

/// Marks a group that has no parent in the assembly tree.
const ROOT: u32 = u32::MAX;

/// A system with at most this many unknowns is factored on one thread.
const MAX_SEQUENTIAL_UNKNOWNS: usize = 500;

/// A system with at least this many unknowns is solved on several threads.
const MIN_PARALLEL_SOLVE: usize = 5000;
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
        let schedule = Schedule::new(&tree, order.len());
        schedule.count_inside(&mut factors, order.len());
        Ok(Some(Self { order: order.clone(), factors, schedule }))
    }

    /// Replaces right sides (one per coordinate) by their solutions.
    pub fn solve<const N: usize>(&self, right: &mut [[f64; N]]) {
        let mut x: Vec<[f64; N]> = self.order.iter().map(|&k| right[k as usize]).collect();
        let still = &x;
        let tasks = self.schedule.tasks.par_iter();
        let done: Vec<_> = tasks.map(|task| self.forwards_in(task, still)).collect();
        let mut own = Vec::new();
        for step in &self.schedule.steps {
            match *step {
                Step::Task(task) => {
                    let (known, changes) = &done[task as usize];
                    self.scatter(&self.schedule.tasks[task as usize], known, &mut x);
                    changes.iter().for_each(|(row, change)| add(&mut x[*row as usize], change));
                }
                Step::Group(group) => {
                    let factor = &self.factors[group as usize];
                    let rows = factor.first..factor.first + factor.count;
                    factor.forwards(&x[rows.clone()], &mut own);
                    x[rows].copy_from_slice(&own[..factor.count]);
                    for (&row, change) in factor.below.iter().zip(&own[factor.count..]) {
                        add(&mut x[row as usize], change);
                    }
                }
            }
        }
        for step in self.schedule.steps.iter().rev() {
            if let Step::Group(group) = *step {
                let factor = &self.factors[group as usize];
                let rows = factor.first..factor.first + factor.count;
                own.clear();
                own.extend_from_slice(&x[rows.clone()]);
                own.extend(factor.below.iter().map(|&row| x[row as usize]));
                factor.backwards(&mut own);
                x[rows].copy_from_slice(&own[..factor.count]);
            }
        }
        let still = &x;
        let tasks = self.schedule.tasks.par_iter();
        let done: Vec<_> = tasks.map(|task| self.backwards_in(task, still)).collect();
        for (task, known) in self.schedule.tasks.iter().zip(&done) {
            self.scatter(task, known, &mut x);
        }
        self.order.iter().zip(x).for_each(|(&k, x)| right[k as usize] = x);
    }

    /// Forward substitution for the unknowns of a task. Returns them, and the changes of the right sides of later unknowns, in order.
    fn forwards_in<const N: usize>(
        &self,
        task: &[u32],
        x: &[[f64; N]],
    ) -> (Vec<[f64; N]>, Vec<(u32, [f64; N])>) {
        let (mut known, mut changes, mut own) = (self.gather(task, x), Vec::new(), Vec::new());
        let mut first = 0;
        for factor in self.factors_of(task) {
            let rows = first..first + factor.count;
            factor.forwards(&known[rows.clone()], &mut own);
            known[rows].copy_from_slice(&own[..factor.count]);
            let (inside, outside) = factor.below.split_at(factor.inside);
            let (of_inside, of_outside) = own[factor.count..].split_at(factor.inside);
            for (&row, change) in inside.iter().zip(of_inside) {
                add(&mut known[self.schedule.places[row as usize] as usize], change);
            }
            changes.extend(outside.iter().copied().zip(of_outside.iter().copied()));
            first += factor.count;
        }
        (known, changes)
    }

    /// Back substitution for the unknowns of a task, when those of later groups are known.
    fn backwards_in<const N: usize>(&self, task: &[u32], x: &[[f64; N]]) -> Vec<[f64; N]> {
        let (mut known, mut own) = (self.gather(task, x), Vec::new());
        let mut first = known.len();
        for factor in self.factors_of(task).rev() {
            first -= factor.count;
            let rows = first..first + factor.count;
            let (inside, outside) = factor.below.split_at(factor.inside);
            own.clear();
            own.extend_from_slice(&known[rows.clone()]);
            own.extend(
                inside.iter().map(|&row| known[self.schedule.places[row as usize] as usize]),
            );
            own.extend(outside.iter().map(|&row| x[row as usize]));
            factor.backwards(&mut own);
            known[rows].copy_from_slice(&own[..factor.count]);
        }
        known
    }

    fn factors_of(&self, task: &[u32]) -> impl DoubleEndedIterator<Item = &Factor> {
        task.iter().map(|&group| &self.factors[group as usize])
    }

    /// Returns the unknowns of a task, group by group.
    fn gather<const N: usize>(&self, task: &[u32], x: &[[f64; N]]) -> Vec<[f64; N]> {
        let rows = self.factors_of(task).map(|factor| factor.first..factor.first + factor.count);
        rows.flat_map(|rows| &x[rows]).copied().collect()
    }

    /// Sets the unknowns of a task, given group by group.
    fn scatter<const N: usize>(&self, task: &[u32], mut known: &[[f64; N]], x: &mut [[f64; N]]) {
        for factor in self.factors_of(task) {
            let (own, rest) = known.split_at(factor.count);
            x[factor.first..factor.first + factor.count].copy_from_slice(own);
            known = rest;
        }
    }
}

fn add<const N: usize>(sum: &mut [f64; N], change: &[f64; N]) {
    (0..N).for_each(|axis| sum[axis] += change[axis]);
}

impl Factor {
    /// Forward substitution: solves for the unknowns of the group with the right sides `right`. `x` becomes the solution, followed by the
    /// changes of the right sides of the rows below.
    fn forwards<const N: usize>(&self, right: &[[f64; N]], x: &mut Vec<[f64; N]>) {
        x.clear();
        x.extend_from_slice(right);
        x.resize(self.columns.height, [0.0; N]);
        for (k, column) in self.columns.entries.chunks_exact(self.columns.height).enumerate() {
            let known = x[k].map(|right| right / column[k]);
            x[k] = known;
            for (x, factor) in x[k + 1..].iter_mut().zip(&column[k + 1..]) {
                (0..N).for_each(|axis| x[axis] -= factor * known[axis]);
            }
        }
    }

    /// Back substitution: solves for the unknowns of the group, given the solution for the rows below.
    fn backwards<const N: usize>(&self, x: &mut [[f64; N]]) {
        for (k, column) in self.columns.entries.chunks_exact(self.columns.height).enumerate().rev()
        {
            let mut sum = x[k];
            for (x, factor) in x[k + 1..].iter().zip(&column[k + 1..]) {
                (0..N).for_each(|axis| sum[axis] -= factor * x[axis]);
            }
            x[k] = sum.map(|sum| sum / column[k]);
        }
    }
}

/// The order in which groups of unknowns are solved.
struct Schedule {
    /// Groups that are solved independently of those of other tasks: parts of the assembly tree.
    tasks: Vec<Vec<u32>>,
    /// All tasks and the remaining groups, in elimination order.
    steps: Vec<Step>,
    /// The index of each unknown, given by its position in the elimination order, among those of its task.
    places: Vec<u32>,
}

#[derive(Clone, Copy)]
enum Step {
    Task(u32),
    Group(u32),
}

impl Schedule {
    fn new(tree: &Tree, unknowns: usize) -> Self {
        let max_unknowns = if unknowns < MIN_PARALLEL_SOLVE { 0 } else { unknowns / 5 };
        let (tasks, last) = tree.tasks(max_unknowns);
        let ends = (0..).zip(&tasks).map(|(task, groups)| (groups.last(), Step::Task(task)));
        let rest = last.iter().map(|group| (Some(group), Step::Group(*group)));
        let mut steps: Vec<_> = ends.chain(rest).collect();
        steps.sort_by_key(|step| step.0);
        let steps = steps.into_iter().map(|step| step.1).collect();
        let mut places = vec![0; unknowns];
        for groups in &tasks {
            let rows = groups
                .iter()
                .flat_map(|&group| tree.starts[group as usize]..tree.starts[group as usize + 1]);
            (0..).zip(rows).for_each(|(place, row)| places[row as usize] = place);
        }
        Self { tasks, steps, places }
    }

    /// Counts for each factor the rows below it that belong to its task. They come first, because they are those of earlier ancestors.
    fn count_inside(&self, factors: &mut [Factor], unknowns: usize) {
        let mut tasks = vec![ROOT; unknowns];
        for (task, groups) in (0..).zip(&self.tasks) {
            for factor in groups.iter().map(|&group| &factors[group as usize]) {
                tasks[factor.first..factor.first + factor.count].fill(task);
            }
        }
        for factor in factors {
            let task = tasks[factor.first];
            factor.inside =
                factor.below.partition_point(|&row| task != ROOT && tasks[row as usize] == task);
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

    /// Divides the groups of unknowns into independent tasks, whose groups can be eliminated in parallel. Also returns the remaining
    /// groups, which depend on these tasks. A task has at most `max_unknowns` unknowns.
    fn tasks(&self, max_unknowns: usize) -> (Vec<Vec<u32>>, Vec<u32>) {
        let count = self.parents.len();
        let mut sizes: Vec<u32> = self.starts.windows(2).map(|ends| ends[1] - ends[0]).collect();
        for k in 0..count {
            if self.parents[k] != ROOT {
                sizes[self.parents[k] as usize] += sizes[k];
            }
        }
        let (mut tasks, mut last) = (Vec::new(), Vec::new());
        let mut task = vec![ROOT; count];
        for k in (0..count).rev() {
            let parent = self.parents[k];
            let above = if parent == ROOT { ROOT } else { task[parent as usize] };
            if above != ROOT {
                task[k] = above;
            } else if sizes[k] as usize <= max_unknowns {
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

    /// Divides the groups of unknowns into waves of tasks. The tasks of a wave, lists of groups, are independent of each other; they depend
    /// on the tasks of earlier waves. The tasks of the first wave are small subtrees, those of later waves single groups.
    fn waves(&self, unknowns: usize) -> Vec<Vec<Vec<u32>>> {
        let count = self.parents.len();
        if unknowns <= MAX_SEQUENTIAL_UNKNOWNS {
            return vec![vec![(0..count as u32).collect()]];
        }
        let (subtrees, rest) = self.tasks((unknowns / MIN_TASKS).max(MIN_TASK_UNKNOWNS));
        let mut waves = vec![subtrees];
        // For each group the number of waves before its own.
        let mut waves_before = vec![0; count];
        for group in rest {
            let children = self.children[group as usize].iter();
            let after = children.map(|&child| waves_before[child as usize] + 1).max().unwrap_or(1);
            waves_before[group as usize] = after;
            if waves.len() <= after {
                waves.push(Vec::new());
            }
            waves[after].push(vec![group]);
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
            factors.push(Factor { first, count, below: below.clone(), inside: 0, columns: front });
        }
        Ok(Some((factors, rest)))
    }
}

#[cfg(test)]
mod tests;
