//! Divides space into cells and finds the Gaussians that are relevant in each cell. The others are ignored with a bounded error.
//!
//! In each cell, the Gaussian with the maximum value at the center is compared with each of the others. The difference of their exponents
//! is a sum of parabolas, one per axis, and its maximum over the cell is computed exactly. So the test is valid even far from all handles,
//! where both powers vanish and only their ratio matters.

use maquette_value::parallel::*;
use maquette_value::simd::{Kernel, MAX_ROUGH_ERROR, widest};
use nalgebra::{Matrix3, Point3, Vector3};

use super::deformation::{Deformation, EMPTY_BUFFER, Term};
use super::layout::Bounds;

/// Cells of space, and the terms (Gaussians) that are relevant in each cell.
pub(crate) struct Cells {
    low: Point3<f64>,
    /// The number of cells per mm.
    pitch: Vector3<f64>,
    counts: [usize; 3],
    /// The indices of the relevant terms: the list of the first cell, then that of the second, and so on. `starts` has the start of each
    /// list.
    lists: Vec<u16>,
    starts: Vec<u32>,
    /// True if the allowed error is large enough to compute powers of 2 approximately.
    is_rough: bool,
}

/// Powers of 2 are approximated if this causes at most this fraction of the allowed error.
const MAX_ROUGH_RATIO: f64 = 0.05;

/// The mean number of points per cell. With fewer points, the lists of terms are shorter, but take longer to prepare.
const POINTS_PER_CELL: usize = 256;

/// Maximum number of cells. With more cells, a chunk of points has so few points per cell that SIMD lanes are unused.
const MAX_CELLS: f64 = 512.0;

/// The mean number of a chunk's points in each cell: several times the number of SIMD lanes, but few enough for the chunk to fit in the
/// cache.
const POINTS_PER_CHUNK_AND_CELL: usize = 32;

impl Cells {
    /// Creates cells in `bounds` for about `points` points. At each point, the sum of the ignored weights is less than `fraction` of the
    /// sum of all weights.
    pub(crate) fn new(
        deformation: &Deformation,
        bounds: Bounds,
        points: usize,
        fraction: f64,
    ) -> Self {
        let extent = bounds.1 - bounds.0;
        let wanted = ((points / POINTS_PER_CELL) as f64).clamp(1.0, MAX_CELLS);
        let side = libm::cbrt(extent.iter().filter(|side| **side > 0.0).product::<f64>() / wanted);
        let counts: [usize; 3] =
            extent.map(|length| (length / side).ceil().clamp(1.0, 32.0) as usize).into();
        let size = Vector3::from_fn(|axis, _| extent[axis] / counts[axis] as f64);
        let terms = &deformation.terms;
        let is_rough = MAX_ROUGH_ERROR <= MAX_ROUGH_RATIO * fraction;
        let fraction = if is_rough { fraction - MAX_ROUGH_ERROR } else { fraction };
        let total = counts.iter().product::<usize>();
        let all: Vec<Vec<u16>> = (0..total)
            .into_par_iter()
            .map(|cell: usize| {
                let index =
                    [cell % counts[0], cell / counts[0] % counts[1], cell / counts[0] / counts[1]];
                let [low, high] = [0, 1].map(|step| {
                    Vector3::from_fn(|axis, _| {
                        bounds.0[axis] + size[axis] * (index[axis] + step) as f64
                    })
                });
                relevant_terms(terms, low, high, fraction)
            })
            .collect();
        let mut starts = Vec::with_capacity(total + 1);
        starts.push(0);
        all.iter().fold(0, |start, list| {
            starts.push(start + list.len() as u32);
            start + list.len() as u32
        });
        Self {
            low: bounds.0,
            pitch: size.map(|size| if size > 0.0 { 1.0 / size } else { 0.0 }),
            counts,
            lists: all.concat(),
            starts,
            is_rough,
        }
    }

    /// Returns the number of points to pass to [`Cells::apply`] at once, so that each cell gets enough of these points to fill the SIMD
    /// lanes.
    pub(crate) fn chunk(&self) -> usize {
        POINTS_PER_CHUNK_AND_CELL * (self.starts.len() - 1)
    }

    /// Like [`Deformation::apply`], but uses for each point only the terms that are relevant in its cell.
    pub(crate) fn apply(
        &self,
        deformation: &Deformation,
        points: &[Point3<f64>],
        moved: &mut [Point3<f64>],
        mut jacobians: Option<&mut [Matrix3<f64>]>,
    ) {
        let (order, ends) = self.sort_by_cell(points);
        let mut terms = Vec::with_capacity(deformation.terms.len());
        let mut together = EMPTY_BUFFER;
        let (mut near, mut results, mut derivatives) = (Vec::new(), Vec::new(), Vec::new());
        let mut first = 0;
        for (cell, &end) in ends.iter().enumerate() {
            let members = &order[first..end as usize];
            first = end as usize;
            if members.is_empty() {
                continue;
            }
            let list = self.starts[cell] as usize..self.starts[cell + 1] as usize;
            terms.clear();
            terms.extend(self.lists[list].iter().map(|&term| deformation.terms[term as usize]));
            let Some(jacobians) = &mut jacobians else {
                deformation.apply_to(&terms, members, points, moved, self.is_rough, &mut together);
                continue;
            };
            near.clear();
            near.extend(members.iter().map(|&member| points[member as usize]));
            results.resize(members.len(), Point3::origin());
            derivatives.resize(members.len(), Matrix3::zeros());
            deformation.apply(&terms, &near, &mut results, Some(&mut derivatives));
            for (&member, (point, derivative)) in
                members.iter().zip(results.iter().zip(&derivatives))
            {
                moved[member as usize] = *point;
                jacobians[member as usize] = *derivative;
            }
        }
    }

    /// Returns the indices of the points sorted by cell, and for each cell the end of its range in this list.
    fn sort_by_cell(&self, points: &[Point3<f64>]) -> (Vec<u32>, Vec<u32>) {
        let mut cells = vec![0; points.len()];
        widest(CellNumbers { cells: self, points, numbers: &mut cells });
        let mut ends = vec![0_u32; self.starts.len() - 1];
        cells.iter().for_each(|&cell| ends[cell as usize] += 1);
        let mut start = 0;
        for end in &mut ends {
            (start, *end) = (start + *end, start);
        }
        let mut order = vec![0; points.len()];
        for (index, &cell) in (0..).zip(&cells) {
            let end = &mut ends[cell as usize];
            order[*end as usize] = index;
            *end += 1;
        }
        (order, ends)
    }
}

/// A kernel that computes the index of each point's cell; for a point outside all cells, that of the nearest cell.
struct CellNumbers<'a> {
    cells: &'a Cells,
    points: &'a [Point3<f64>],
    numbers: &'a mut [u32],
}

/// Adding this constant to a smaller nonnegative number leaves the nearest integer in the lowest bits of the sum.
const ROUND: f64 = (1_u64 << 52) as f64;

impl Kernel for CellNumbers<'_> {
    #[inline(always)]
    fn run(self) {
        let Self { cells: Cells { low, pitch, counts, .. }, points, numbers } = self;
        let last = counts.map(|count| (count - 1) as f64);
        let [row, layer] = [counts[0] as f64, (counts[0] * counts[1]) as f64];
        for (number, point) in numbers.iter_mut().zip(points) {
            // Subtracting 0.5 and rounding gives the cell's index. A point on the boundary of two cells may get either.
            let [x, y, z] = [0, 1, 2].map(|axis: usize| {
                let position = (point[axis] - low[axis]) * pitch[axis] - 0.5;
                (position.max(0.0).min(last[axis]) + ROUND) - ROUND
            });
            let cell = x + row * y + layer * z;
            *number = (cell + ROUND).to_bits() as u32;
        }
    }
}

/// Returns the indices of the terms that are relevant in a box. The sum of all other terms is less than `fraction` of the total sum.
fn relevant_terms(
    terms: &[Term],
    low: Vector3<f64>,
    high: Vector3<f64>,
    fraction: f64,
) -> Vec<u16> {
    let middle: [f64; 3] = ((low + high) / 2.0).into();
    let greatest = terms.iter().map(|term| (term.bump.exponent(middle), term));
    let Some((_, greatest)) = greatest.reduce(|a, b| if b.0 > a.0 { b } else { a }) else {
        return Vec::new();
    };
    // For each term its index, and the logarithm of the maximum, in the box, of the ratio of this term to the greatest term.
    let mut terms: Vec<_> = (0..)
        .zip(terms.iter().map(|term| {
            let [x, y, z] =
                [0, 1, 2].map(|axis| max_on_axis(term, greatest, axis, low[axis], high[axis]));
            term.bump.level - greatest.bump.level + x + y + z
        }))
        .collect();
    terms.sort_unstable_by(|a: &(u16, f64), b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
    let sums = terms.iter().scan(0.0, |sum, (_, ratio)| {
        *sum += libm::exp2(*ratio);
        Some(*sum)
    });
    // The comparison is false for NaN, so a term that gives NaN is always relevant.
    let out = sums.take_while(|sum| *sum < fraction).count();
    let mut kept: Vec<u16> = terms[out..].iter().map(|(index, _)| *index).collect();
    kept.sort_unstable();
    kept
}

/// Returns the maximum of the difference between the exponents of two terms along an axis, for coordinates from `low` to `high`.
fn max_on_axis(a: &Term, b: &Term, axis: usize, low: f64, high: f64) -> f64 {
    fn factor_and_center(term: &Term, axis: usize) -> (f64, f64) {
        (term.bump.factor[axis], term.bump.center[axis])
    }
    let ((fa, ca), (fb, cb)) = (factor_and_center(a, axis), factor_and_center(b, axis));
    let difference = |x: f64| fa * (x - ca) * (x - ca) - fb * (x - cb) * (x - cb);
    let ends = f64::max(difference(low), difference(high));
    let top = (fa * ca - fb * cb) / (fa - fb);
    if fa < fb && low < top && top < high { ends.max(difference(top)) } else { ends }
}
