//! Changes the density of the triangles that fill holes.

use maquette_node::{Cancelled, Progress};
use nalgebra::Point3;

use super::fairing::{Energy, fair};
use super::hole_fill::HoleFill;
use super::sizes::Sizes;
use crate::border::rim::{OneRings, Rim};
use crate::triangles::density::{Stop, refine};
use crate::triangles::filling::Filling;

/// The fills of some holes, as triangulations whose edges can be split and collapsed.
pub(crate) struct Remesh<'a> {
    pub(crate) one_rings: &'a OneRings,
    pub(crate) holes: &'a [Vec<u32>],
    pub(crate) fills: &'a mut [HoleFill],
    /// The final length of edges; none for that of the data's edges at the rim.
    pub(crate) edge: Option<f64>,
}

impl Remesh<'_> {
    /// Brings the filled edges to the length `least`, or to their final length where that is more. The surface stays where it is; its
    /// vertices get other numbers.
    ///
    /// # Errors
    /// If there would be too many triangles, or the evaluation is told to stop.
    pub(crate) fn refine(
        &mut self,
        filling: &mut Filling,
        least: f64,
        progress: &Progress<'_>,
    ) -> Result<(), Stop> {
        self.take_positions(filling);
        for (hole, fill) in self.holes.iter().zip(self.fills.iter_mut()) {
            let rim = Rim::new(filling, self.one_rings, hole);
            let sizes = Sizes::new(&rim, self.edge);
            refine(&mut fill.triangulation, |point| sizes.at(point).max(least), progress)?;
        }
        filling.add_all(self.holes, self.fills);
        Ok(())
    }

    /// The positions that the filled vertices would have on membranes. Takes over their present positions, too.
    ///
    /// # Errors
    /// If the evaluation is told to stop.
    pub(crate) fn membranes(
        &mut self,
        filling: &mut Filling,
        progress: &Progress<'_>,
    ) -> Result<Vec<Point3<f64>>, Cancelled> {
        self.take_positions(filling);
        let mut places = Vec::new();
        for (hole, fill) in self.holes.iter().zip(self.fills.iter()) {
            let rim = Rim::new(filling, self.one_rings, hole);
            let mut triangulation = fill.triangulation.clone();
            fair(&mut triangulation, &rim, Energy::Membrane, progress)?;
            let (_, kept) = triangulation.compact();
            places.extend(
                kept[hole.len()..].iter().map(|&vertex| triangulation.points[vertex as usize]),
            );
        }
        Ok(places)
    }

    /// Takes over the positions to which vertices have moved since they were added to `filling`.
    pub(crate) fn take_positions(&mut self, filling: &Filling) {
        let mut places = filling.points[filling.data..].iter();
        for (hole, fill) in self.holes.iter().zip(self.fills.iter_mut()) {
            let (_, kept) = fill.triangulation.compact();
            for (&vertex, place) in kept[hole.len()..].iter().zip(&mut places) {
                fill.triangulation.points[vertex as usize] = *place;
            }
        }
    }
}
