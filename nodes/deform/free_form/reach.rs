//! Finds the points that a deformation with limited effect moves. All other points keep their exact positions and are not computed.
//!
//! The bounding boxes of the points are cached, so that moving a handle costs only the rows of points near it. `Node::update` is not used:
//! unmoved points must be those of the input, not those of the previous result.

use std::ops::Range;

use maquette_node::Error;
use maquette_value::Memo;
use maquette_value::parallel::*;
use maquette_value::{Column, Encoder};
use nalgebra::{Point3, Vector3};

use super::object::{Extent, extent, merge_extents};
use crate::gaussian::deformation::{Deformation, Term};
use crate::gaussian::layout::Bounds;

/// Number of points in a row, which share one bounding box. Points that are adjacent in a list are mostly near each other in space.
const ROW_SIZE: usize = 512;

/// The bounding boxes of the rows of a list of points. A row is [`ROW_SIZE`] consecutive points.
#[derive(Clone)]
pub(crate) struct Boxes {
    boxes: Column<Extent>,
    points: usize,
}

impl Boxes {
    pub(crate) fn new(points: &[Point3<f64>]) -> Self {
        let boxes: Vec<_> = points.par_chunks(ROW_SIZE).with_min_len(32).map(extent).collect();
        Self { boxes: boxes.into(), points: points.len() }
    }

    /// Computes the bounding boxes of the rows of points, with the signature that the cache expects.
    pub(crate) fn memo(places: &MemoPoints) -> Result<Self, Error> {
        Ok(Self::new(&places.0))
    }

    /// Returns the bounding box of all points; `None` if there are no points.
    pub(crate) fn bounds(&self) -> Option<Bounds> {
        merge_extents(&self.boxes)
    }

    /// Returns the rows of points that may move by more than `error` mm. Adjacent rows are merged.
    pub(crate) fn reached_rows(&self, deformation: &Deformation, error: f64) -> Vec<Range<u32>> {
        let mut rows: Vec<Range<u32>> = Vec::new();
        // Keep rows that contain NaN, so that the computation reports the NaN as an error.
        let stays: Vec<bool> = self
            .boxes
            .par_iter()
            .with_min_len(64)
            .map(|ends| max_displacement(deformation, ends) <= error)
            .collect();
        for row in (0..stays.len()).filter(|&row| !stays[row]) {
            let [start, end] =
                [row * ROW_SIZE, self.points.min((row + 1) * ROW_SIZE)].map(|at| at as u32);
            match rows.last_mut() {
                Some(last) if last.end == start => last.end = end,
                _ => rows.push(start..end),
            }
        }
        rows
    }
}

/// Returns an upper bound of the displacements inside a box: the sum of the maxima of all terms in the box, divided by the background.
fn max_displacement(deformation: &Deformation, [low, high]: &Extent) -> f64 {
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

/// Returns the items in the given rows, one row after the other.
pub(crate) fn gather_rows<T: Copy>(items: &[T], rows: &[Range<u32>]) -> Vec<T> {
    let mut gathered = Vec::with_capacity(rows.iter().map(ExactSizeIterator::len).sum());
    for row in rows {
        gathered.extend_from_slice(&items[row.start as usize..row.end as usize]);
    }
    gathered
}

/// The points from which [`Boxes`] are computed; their hash is the cache key.
#[derive(Clone)]
pub(crate) struct MemoPoints(pub(crate) Column<Point3<f64>>);

impl Memo for MemoPoints {
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
