//! Which Gaussians count where: the others are left out, with a bound for what that changes.
//!
//! Space is divided into cells. In a cell, the Gaussian that is greatest at its middle is compared with each other one: the
//! difference of two exponents is a sum of parabolas, one per axis, whose maximum over the cell is exact. So the test holds for
//! points far from all handles, too, where only the ratio of two vanishing powers counts.

use maquette_value::parallel::*;
use maquette_value::simd::{Kernel, ROUGHLY, widest};
use nalgebra::{Matrix3, Point3, Vector3};

use super::deformation::{Deformation, NONE_NEAR, Term};
use super::layout::Bounds;

/// Cells, and for each the terms that count in it.
pub(crate) struct Cells {
    low: Point3<f64>,
    /// Cells per mm.
    pitch: Vector3<f64>,
    counts: [usize; 3],
    /// The terms of all cells, by number, those of one after those of the other.
    lists: Vec<u16>,
    starts: Vec<u32>,
    /// Whether powers may be rough, too.
    roughly: bool,
}

/// Rough powers are taken where what they are off by is at most this part of what may be left out.
const ROUGH_PART: f64 = 0.05;

/// Points per cell, if they lay evenly: fewer make shorter lists of terms, but take longer to prepare.
const POINTS_PER_CELL: usize = 256;

/// More cells leave so few points of a chunk in each that lanes of the processor stay empty.
const MOST_CELLS: f64 = 512.0;

/// Points of each cell that a chunk has if they lay evenly: several times the lanes, but few enough for the chunk to stay near the
/// processor.
const MEMBERS: usize = 32;

impl Cells {
    /// Cells in `bounds`, for about `points` points. What is left out of the sums at a point is less than this share of them.
    pub(crate) fn new(
        deformation: &Deformation,
        bounds: Bounds,
        points: usize,
        share: f64,
    ) -> Self {
        let extent = bounds.1 - bounds.0;
        let wanted = ((points / POINTS_PER_CELL) as f64).clamp(1.0, MOST_CELLS);
        let side = libm::cbrt(extent.iter().filter(|side| **side > 0.0).product::<f64>() / wanted);
        let counts: [usize; 3] =
            extent.map(|length| (length / side).ceil().clamp(1.0, 32.0) as usize).into();
        let size = Vector3::from_fn(|axis, _| extent[axis] / counts[axis] as f64);
        let terms = &deformation.terms;
        let roughly = ROUGHLY <= ROUGH_PART * share;
        let share = if roughly { share - ROUGHLY } else { share };
        let total = counts.iter().product::<usize>();
        let all: Vec<Vec<u16>> = (0..total)
            .into_par_iter()
            .map(|cell: usize| {
                let place =
                    [cell % counts[0], cell / counts[0] % counts[1], cell / counts[0] / counts[1]];
                fn corner(
                    step: usize,
                    size: Vector3<f64>,
                    place: [usize; 3],
                    bounds_0: Point3<f64>,
                ) -> Vector3<f64> {
                    Vector3::from_fn(|axis, _| {
                        bounds_0[axis] + size[axis] * (place[axis] + step) as f64
                    })
                }
                relevant(
                    terms,
                    corner(0, size, place, bounds.0),
                    corner(1, size, place, bounds.0),
                    share,
                )
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
            roughly,
        }
    }

    /// How many points should be given to [`Cells::apply`] at once, so that there are some of each cell among them.
    pub(crate) fn chunk(&self) -> usize {
        MEMBERS * (self.starts.len() - 1)
    }

    /// [`Deformation::apply`], with the terms of each point's cell alone.
    pub(crate) fn apply(
        &self,
        deformation: &Deformation,
        points: &[Point3<f64>],
        moved: &mut [Point3<f64>],
        mut jacobians: Option<&mut [Matrix3<f64>]>,
    ) {
        let (order, ends) = self.sorted(points);
        let mut terms = Vec::with_capacity(deformation.terms.len());
        let mut together = NONE_NEAR;
        let (mut near, mut there, mut derivatives) = (Vec::new(), Vec::new(), Vec::new());
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
                deformation.apply_to(&terms, members, points, moved, self.roughly, &mut together);
                continue;
            };
            near.clear();
            near.extend(members.iter().map(|&member| points[member as usize]));
            there.resize(members.len(), Point3::origin());
            derivatives.resize(members.len(), Matrix3::zeros());
            deformation.apply(&terms, &near, &mut there, Some(&mut derivatives));
            for (&member, (point, derivative)) in members.iter().zip(there.iter().zip(&derivatives))
            {
                moved[member as usize] = *point;
                jacobians[member as usize] = *derivative;
            }
        }
    }

    /// The points' numbers by cell, and where each cell's end.
    fn sorted(&self, points: &[Point3<f64>]) -> (Vec<u32>, Vec<u32>) {
        let mut cells = vec![0; points.len()];
        widest(Numbers { cells: self, points, numbers: &mut cells });
        let mut ends = vec![0_u32; self.starts.len() - 1];
        cells.iter().for_each(|&cell| ends[cell as usize] += 1);
        let mut start = 0;
        for end in &mut ends {
            (start, *end) = (start + *end, start);
        }
        let mut order = vec![0; points.len()];
        for (index, &cell) in (0..).zip(&cells) {
            let place = &mut ends[cell as usize];
            order[*place as usize] = index;
            *place += 1;
        }
        (order, ends)
    }
}

/// The number of each point's cell; one of those at the border for a point outside.
struct Numbers<'a> {
    cells: &'a Cells,
    points: &'a [Point3<f64>],
    numbers: &'a mut [u32],
}

/// Added to a number that is not negative and smaller, it leaves the nearest integer in the sum's lowest bits.
const ROUND: f64 = (1_u64 << 52) as f64;

impl Kernel for Numbers<'_> {
    #[inline(always)]
    fn run(self) {
        let Self { cells: Cells { low, pitch, counts, .. }, points, numbers } = self;
        let last = counts.map(|count| (count - 1) as f64);
        let [row, layer] = [counts[0] as f64, (counts[0] * counts[1]) as f64];
        for (number, point) in numbers.iter_mut().zip(points) {
            // Half a cell less, rounded, is the cell; a point between two cells belongs to either.
            let place = |axis: usize| {
                let place = (point[axis] - low[axis]) * pitch[axis] - 0.5;
                (place.max(0.0).min(last[axis]) + ROUND) - ROUND
            };
            let cell = place(0) + row * place(1) + layer * place(2);
            *number = (cell + ROUND).to_bits() as u32;
        }
    }
}

/// The terms without which less than this share of the sum of all is left out, anywhere between the corners.
fn relevant(terms: &[Term], low: Vector3<f64>, high: Vector3<f64>, share: f64) -> Vec<u16> {
    let middle: [f64; 3] = ((low + high) / 2.0).into();
    let greatest = terms.iter().map(|term| (term.bump.exponent(middle), term));
    let Some((_, greatest)) = greatest.reduce(|a, b| if b.0 > a.0 { b } else { a }) else {
        return Vec::new();
    };
    // The logarithm of the most that a term has of the greatest.
    let mut terms: Vec<_> = (0..)
        .zip(terms.iter().map(|term| {
            let most = |axis: usize| most_on_axis(term, greatest, axis, low[axis], high[axis]);
            term.bump.level - greatest.bump.level + most(0) + most(1) + most(2)
        }))
        .collect();
    terms.sort_unstable_by(|a: &(u16, f64), b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
    let sums = terms.iter().scan(0.0, |sum, (_, most)| {
        *sum += libm::exp2(*most);
        Some(*sum)
    });
    // What is not a number is never left out.
    let out = sums.take_while(|sum| *sum < share).count();
    let mut kept = Vec::from_iter(terms[out..].iter().map(|(index, _)| *index));
    kept.sort_unstable();
    kept
}

/// The greatest difference of the parts of two exponents that belong to an axis, between two coordinates.
fn most_on_axis(a: &Term, b: &Term, axis: usize, low: f64, high: f64) -> f64 {
    fn of(term: &Term, axis: usize) -> (f64, f64) {
        (term.bump.factor[axis], term.bump.center[axis])
    }
    let ((fa, ca), (fb, cb)) = (of(a, axis), of(b, axis));
    let difference = |x: f64| fa * (x - ca) * (x - ca) - fb * (x - cb) * (x - cb);
    let ends = f64::max(difference(low), difference(high));
    let top = (fa * ca - fb * cb) / (fa - fb);
    if fa < fb && low < top && top < high { ends.max(difference(top)) } else { ends }
}
