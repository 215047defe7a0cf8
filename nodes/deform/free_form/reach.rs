//! Which points a deformation reaches where a background ends the pull of its handles: the others stay to the bit, and cost nothing.
//!
//! The boxes are remembered, so that a moved handle costs its own rows. There is no `Node::update`, because points that stay are those of
//! the input, not of the last result.

use std::ops::Range;

use maquette_node::Error;
use maquette_value::Memo;
use maquette_value::parallel::*;
use maquette_value::{Column, Encoder};
use nalgebra::{Point3, Vector3};

use super::object::{Ends, around, ends_of};
use crate::gaussian::deformation::{Deformation, Term};
use crate::gaussian::layout::Bounds;

/// Points that are judged together. Neighbors in a list are mostly neighbors in space, too.
const ROW: usize = 512;

/// Points in rows, and the box around each row.
#[derive(Clone)]
pub(crate) struct Boxes {
    boxes: Column<Ends>,
    points: usize,
}

impl Boxes {
    pub(crate) fn new(points: &[Point3<f64>]) -> Self {
        let boxes: Vec<_> = points.par_chunks(ROW).with_min_len(32).map(ends_of).collect();
        Self { boxes: boxes.into(), points: points.len() }
    }

    /// To be remembered.
    pub(crate) fn memo(places: &Places) -> Result<Self, Error> {
        Ok(Self::new(&places.0))
    }

    /// The box around all points; none without points.
    pub(crate) fn around(&self) -> Option<Bounds> {
        around(&self.boxes)
    }

    /// The rows of points that may move by more than `error` mm, those side by side as one.
    pub(crate) fn reached(&self, deformation: &Deformation, error: f64) -> Vec<Range<u32>> {
        let mut rows: Vec<Range<u32>> = Vec::new();
        // What is no number is computed, so that it is told.
        let stays: Vec<bool> = self
            .boxes
            .par_iter()
            .with_min_len(64)
            .map(|ends| farthest(deformation, ends) <= error)
            .collect();
        for row in (0..stays.len()).filter(|&row| !stays[row]) {
            let [start, end] = [row * ROW, self.points.min((row + 1) * ROW)].map(|at| at as u32);
            match rows.last_mut() {
                Some(last) if last.end == start => last.end = end,
                _ => rows.push(start..end),
            }
        }
        rows
    }
}

/// No point between these ends moves farther: the sum of all pulls, each where it is greatest, over the background alone.
fn farthest(deformation: &Deformation, [low, high]: &Ends) -> f64 {
    deformation
        .terms
        .iter()
        .map(|Term { bump, value }| {
            let nearest = [0, 1, 2].map(|axis| bump.center[axis].max(low[axis]).min(high[axis]));
            libm::exp2(bump.exponent(nearest)) * Vector3::from(*value).norm()
        })
        .sum::<f64>()
        / deformation.background
}

/// The items of some rows, one row after the other.
pub(crate) fn gathered<T: Copy>(items: &[T], rows: &[Range<u32>]) -> Vec<T> {
    let mut gathered = Vec::with_capacity(rows.iter().map(ExactSizeIterator::len).sum());
    for row in rows {
        gathered.extend_from_slice(&items[row.start as usize..row.end as usize]);
    }
    gathered
}

/// Points by whose hash their boxes are remembered.
#[derive(Clone)]
pub(crate) struct Places(pub(crate) Column<Point3<f64>>);

impl Memo for Places {
    const NAME: &'static str = "DeformedPlaces";

    fn encode(&self, to: &mut Encoder) {
        to.column(&self.0);
    }

    fn size(&self) -> usize {
        self.0.size()
    }
}

impl Memo for Boxes {
    const NAME: &'static str = "DeformedBoxes";

    fn encode(&self, to: &mut Encoder) {
        to.column(&self.boxes).counts(&[self.points]);
    }

    fn size(&self) -> usize {
        self.boxes.size()
    }
}
