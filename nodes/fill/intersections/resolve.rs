//! Repairs or replaces the fills of holes if their triangles intersect each other or the input mesh.

use std::ops::Range;

use maquette_node::{CancelledError, Error, Progress};
use maquette_value::parallel::*;

use super::boxes::Triangle;
use super::detect::Intersections;
use super::repair::{Obstacles, repair};
use crate::border::holes::Components;
use crate::border::rim::{OneRings, Rim};
use crate::plain::hole_fill::{Fallback, HoleFill};
use crate::plain::options::{PlainMethod, PlainOptions};
use crate::plain::plain_fill::fill_hole;
use crate::triangles::density::RefineError;
use crate::triangles::filling::Filling;
use crate::triangles::triangulation::NONE;

/// The fills of some holes, and their intersections.
pub(crate) struct HoleFills<'a> {
    pub(crate) filling: &'a mut Filling,
    pub(crate) one_rings: &'a OneRings,
    pub(crate) holes: &'a [Vec<u32>],
    pub(crate) fills: &'a mut [HoleFill],
    pub(crate) intersections: &'a mut Intersections,
}

/// Maximum number of holes with intersections that are filled again one by one at the end.
const MAX_SEPARATE_HOLES: usize = 20;

/// A fill with creases is repaired if at most this number of its triangles intersect others. If more do, its creases are taken to be wrong.
const MAX_REPAIRED_TRIANGLES: usize = 16;

impl HoleFills<'_> {
    /// Repairs the fills whose triangles intersect others. A hole whose fill cannot be repaired is filled again with other surfaces, the
    /// most similar to the requested one first. The fill with the fewest intersecting triangles is kept.
    ///
    /// # Errors
    /// Returns an error if there would be too many pairs of triangles to test, or if the evaluation is cancelled.
    pub(crate) fn resolve(
        &mut self,
        options: PlainOptions,
        progress: &Progress<'_>,
    ) -> Result<(), Error> {
        let others: &[Option<PlainMethod>] = match options.method {
            PlainMethod::CreaseAware | PlainMethod::PlateOrCreases => &[
                None,
                Some(PlainMethod::ThinPlate),
                Some(PlainMethod::Membrane),
                Some(PlainMethod::Flat),
            ],
            PlainMethod::ThinPlate => &[None, Some(PlainMethod::Membrane), Some(PlainMethod::Flat)],
            PlainMethod::Membrane => &[None, Some(PlainMethod::Flat), Some(PlainMethod::ThinPlate)],
            PlainMethod::Flat | PlainMethod::Centroid => &[
                None,
                Some(PlainMethod::Flat),
                Some(PlainMethod::Membrane),
                Some(PlainMethod::ThinPlate),
            ],
        };
        for &method in others {
            self.improve(&self.intersecting(), method, options, progress)?;
        }
        // The fills of several adjacent holes may have changed at once, and the new fills may intersect each other. Improve the remaining
        // holes one by one.
        let intersecting = self.intersecting();
        if intersecting.len() < 2 {
            return Ok(());
        }
        for hole in intersecting.into_iter().take(MAX_SEPARATE_HOLES) {
            for &method in others {
                self.improve(&[hole], method, options, progress)?;
            }
        }
        Ok(())
    }

    /// Returns the holes whose fills have triangles that intersect other triangles.
    fn intersecting(&self) -> Vec<usize> {
        let counts = self.counts();
        (0..counts.len()).filter(|&hole| counts[hole] > 0).collect()
    }

    /// Replaces the fills of those `holes` that have intersections by fills with the surface `method`; repairs them if `method` is `None`.
    /// Each hole keeps the fill with fewer intersecting triangles.
    fn improve(
        &mut self,
        holes: &[usize],
        method: Option<PlainMethod>,
        options: PlainOptions,
        progress: &Progress<'_>,
    ) -> Result<(), Error> {
        let (before, begins) = (self.counts(), self.begins());
        let mut others = holes
            .par_iter()
            .filter(|&&hole| {
                // A fill with wrong creases has many intersections. Do not repair it.
                let is_misfit = self.fills[hole].is_sharp && before[hole] > MAX_REPAIRED_TRIANGLES;
                before[hole] > 0 && !(method.is_none() && is_misfit)
            })
            .map(|&hole| {
                let own = begins[hole]..begins[hole + 1];
                Ok((hole, self.other_fill(hole, own, method, options, progress)?))
            })
            .collect::<Result<Vec<_>, Error>>()?;
        self.exchange(&mut others, progress)?;
        let after = self.counts();
        others.retain(|(hole, _)| before[*hole] <= after[*hole]);
        self.exchange(&mut others, progress)
    }

    /// Returns a repaired fill of a hole: a new fill with the surface `method`, or the current fill if `method` is `None`. `own` are the
    /// faces of the current fill.
    fn other_fill(
        &self,
        hole: usize,
        own: Range<u32>,
        method: Option<PlainMethod>,
        options: PlainOptions,
        progress: &Progress<'_>,
    ) -> Result<HoleFill, Error> {
        let rim = Rim::new(self.filling, self.one_rings, &self.holes[hole]);
        let mut fill = self.fills[hole].clone();
        if let Some(method) = method {
            let unwanted_creases = options.method == PlainMethod::PlateOrCreases && fill.is_sharp;
            match fill_hole(self.filling, &rim, PlainOptions { method, ..options }, progress) {
                // Drop, without a warning, creases that the user did not ask for.
                Ok(other) if method == PlainMethod::ThinPlate && unwanted_creases => fill = other,
                Ok(other) => fill = HoleFill { fallback: Some(Fallback::Intersection), ..other },
                Err(RefineError::Cancelled) => return Err(CancelledError.into()),
                // Do not try a fill that would have too many triangles.
                Err(RefineError::TooMany(_)) => {}
            }
        }
        let obstacles = Obstacles { intersections: self.intersections, own, rim: &rim };
        repair(&mut fill.triangulation, &obstacles);
        Ok(fill)
    }

    /// Replaces the fills of some holes by those in `others`, and stores the previous fills in `others`.
    fn exchange(
        &mut self,
        others: &mut [(usize, HoleFill)],
        progress: &Progress<'_>,
    ) -> Result<(), Error> {
        if others.is_empty() {
            return Ok(());
        }
        let old = self.begins();
        let mut is_other = vec![false; self.holes.len()];
        for (hole, fill) in others {
            std::mem::swap(&mut self.fills[*hole], fill);
            is_other[*hole] = true;
        }
        self.filling.add_all(self.holes, self.fills);
        let new = self.begins();
        fn hole_of(begins: &[u32], face: u32) -> usize {
            begins.partition_point(|&begin| begin <= face)
        }
        self.intersections.renumber(|face| match hole_of(&old, face) {
            0 => Some(face),
            hole if is_other[hole - 1] => None,
            hole => Some(face - old[hole - 1] + new[hole - 1]),
        });
        self.intersections.update(
            self.filling,
            |face: u32| is_other[hole_of(&new, face) - 1],
            progress,
        )
    }

    /// Returns the index of the first face of each fill, followed by the number of all faces.
    fn begins(&self) -> Vec<u32> {
        let mut begins = vec![self.filling.n_data_faces as u32];
        for fill in self.fills.iter() {
            begins.push(begins[begins.len() - 1] + fill.triangulation.n_faces() as u32);
        }
        begins
    }

    /// Returns the holes for two possible reasons of intersections. The first list has the holes whose fill intersects a component of the
    /// mesh that does not contain the hole's rim. The second has the holes at whose rims the input mesh intersects itself.
    pub(crate) fn reasons(&self, components: &Components) -> [Vec<usize>; 2] {
        let begins = self.begins();
        let mut in_the_way = Vec::new();
        for &[face, filled] in self.intersections.pairs() {
            let hole = begins.partition_point(|&begin| begin <= filled) - 1;
            let is_data = (face as usize) < self.filling.n_data_faces;
            let other = self.filling.faces[face as usize][0];
            let rim = self.holes[hole][0];
            if is_data && components.component_of(other) != components.component_of(rim) {
                in_the_way.push(hole);
            }
        }
        in_the_way.sort_unstable();
        in_the_way.dedup();
        let holes = self.intersecting().into_iter();
        [in_the_way, holes.filter(|&hole| self.has_intersecting_data(hole)).collect()]
    }

    /// Returns true if input triangles at the rim of a hole intersect other input triangles.
    fn has_intersecting_data(&self, hole: usize) -> bool {
        let at_rim =
            self.holes[hole].iter().flat_map(|&vertex| self.one_rings.triangles_around(vertex));
        at_rim.copied().any(|vertices| {
            let triangle = Triangle {
                vertices,
                corners: vertices.map(|vertex: u32| self.filling.points[vertex as usize]),
                face: NONE,
            };
            let mut intersects = false;
            self.intersections.for_each_intersecting(&triangle, |face| {
                let is_data = (face as usize) < self.filling.n_data_faces;
                intersects |= is_data && self.filling.faces[face as usize] != vertices;
            });
            intersects
        })
    }

    /// Returns the number of intersecting triangles in the fill of each hole.
    fn counts(&self) -> Vec<usize> {
        let faces = self.intersections.faces(self.filling);
        let indices: Vec<usize> = self
            .begins()
            .into_iter()
            .map(|begin| faces.partition_point(|&face| face < begin))
            .collect();
        indices.windows(2).map(|ends| ends[1] - ends[0]).collect()
    }
}
