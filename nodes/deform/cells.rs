//! Which Gaussians count where: the others are left out, with a bound for what that changes.
//!
//! Space is divided into cells. In a cell, the Gaussian that is greatest at its middle is compared with each other one: the
//! difference of two exponents is a sum of parabolas, one per axis, whose maximum over the cell is exact. So the test holds for
//! points far from all handles, too, where only the ratio of two vanishing powers counts.

use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;

use super::deformation::{Deformation, Term};
use super::layout::Bounds;

/// Cells, and for each the terms that count in it.
pub(super) struct Cells {
    low: Point3<f64>,
    /// Cells per mm.
    pitch: Vector3<f64>,
    counts: [usize; 3],
    /// The terms of all cells, by number, those of one after those of the other.
    lists: Vec<u16>,
    starts: Vec<u32>,
}

/// Points per cell, if they lay evenly: fewer make shorter lists of terms, but take longer to prepare.
const POINTS_PER_CELL: usize = 256;

/// More cells leave so few points of a chunk in each that lanes of the processor stay empty.
const MOST_CELLS: f64 = 1024.0;

/// Points of each cell that a chunk has if they lay evenly: several times the lanes.
const MEMBERS: usize = 64;

impl Cells {
    /// Cells in `bounds`, for about `points` points. What is left out of the sums at a point is less than this share of them.
    pub(super) fn new(
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
        let least = libm::log2(share / terms.len() as f64);
        let total = counts.iter().product::<usize>();
        let list = |cell: usize| {
            let place =
                [cell % counts[0], cell / counts[0] % counts[1], cell / counts[0] / counts[1]];
            let corner = |step: usize| {
                Vector3::from_fn(|axis, _| {
                    bounds.0[axis] + size[axis] * (place[axis] + step) as f64
                })
            };
            relevant(terms, corner(0), corner(1), least)
        };
        let all: Vec<Vec<u16>> = (0..total).into_par_iter().map(list).collect();
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
        }
    }

    /// How many points should be given to [`Cells::apply`] at once, so that there are some of each cell among them.
    pub(super) fn chunk(&self) -> usize {
        MEMBERS * (self.starts.len() - 1)
    }

    /// The cell of a point; one of those at the border for a point outside.
    fn cell(&self, point: &Point3<f64>) -> usize {
        let place = |axis: usize| {
            let place = (point[axis] - self.low[axis]) * self.pitch[axis];
            (place as usize).min(self.counts[axis] - 1)
        };
        (place(2) * self.counts[1] + place(1)) * self.counts[0] + place(0)
    }

    /// [`Deformation::apply`], with the terms of each point's cell alone.
    pub(super) fn apply(
        &self,
        deformation: &Deformation,
        points: &[Point3<f64>],
        moved: &mut [Point3<f64>],
        mut jacobians: Option<&mut [Matrix3<f64>]>,
    ) {
        let (order, ends) = self.sorted(points);
        let mut terms = Vec::with_capacity(deformation.terms.len());
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
            near.clear();
            near.extend(members.iter().map(|&member| points[member as usize]));
            there.resize(members.len(), Point3::origin());
            if let Some(jacobians) = &mut jacobians {
                derivatives.resize(members.len(), Matrix3::zeros());
                deformation.apply(&terms, &near, &mut there, Some(&mut derivatives));
                for (&member, derivative) in members.iter().zip(&derivatives) {
                    jacobians[member as usize] = *derivative;
                }
            } else {
                deformation.apply(&terms, &near, &mut there, None);
            }
            for (&member, point) in members.iter().zip(&there) {
                moved[member as usize] = *point;
            }
        }
    }

    /// The points' numbers by cell, and where each cell's end.
    fn sorted(&self, points: &[Point3<f64>]) -> (Vec<u32>, Vec<u32>) {
        let cells: Vec<u32> = points.iter().map(|point| self.cell(point) as u32).collect();
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

/// The terms that somewhere between the corners have more than `2^least` of what the greatest has there.
fn relevant(terms: &[Term], low: Vector3<f64>, high: Vector3<f64>, least: f64) -> Vec<u16> {
    let middle: [f64; 3] = ((low + high) / 2.0).into();
    let greatest = terms.iter().map(|term| (term.bump.exponent(middle), term));
    let Some((_, greatest)) = greatest.reduce(|a, b| if b.0 > a.0 { b } else { a }) else {
        return Vec::new();
    };
    let counts = |term: &Term| {
        let most = |axis: usize| most_on_axis(term, greatest, axis, low[axis], high[axis]);
        let most = term.bump.level - greatest.bump.level + most(0) + most(1) + most(2);
        least <= most || most.is_nan()
    };
    (0..).zip(terms).filter(|(_, term)| counts(term)).map(|(index, _)| index).collect()
}

/// The greatest difference of the parts of two exponents that belong to an axis, between two coordinates.
fn most_on_axis(a: &Term, b: &Term, axis: usize, low: f64, high: f64) -> f64 {
    let of = |term: &Term| (term.bump.factor[axis], term.bump.center[axis]);
    let ((fa, ca), (fb, cb)) = (of(a), of(b));
    let difference = |x: f64| fa * (x - ca) * (x - ca) - fb * (x - cb) * (x - cb);
    let ends = f64::max(difference(low), difference(high));
    let top = (fa * ca - fb * cb) / (fa - fb);
    if fa < fb && low < top && top < high { ends.max(difference(top)) } else { ends }
}
