//! Repairs or replaces fills whose triangles intersect each other or the data.

use maquette_node::{Cancelled, Progress};
use maquette_value::parallel::*;

use super::boxes::Triangle;
use super::detect::Intersections;
use super::repair::{Obstacles, repair};
use crate::border::holes::Components;
use crate::border::rim::{OneRings, Rim};
use crate::fill_error::FillError;
use crate::plain::hole_fill::{Fallback, HoleFill};
use crate::plain::options::{PlainMethod, PlainOptions};
use crate::plain::plain_fill::fill_hole;
use crate::triangles::density::Stop;
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

/// At most so many holes are filled again one by one at the end.
const MOST_ALONE: usize = 20;

/// A fill with creases is repaired only if at most so many of its triangles intersect others.
const MOST_REPAIRED: usize = 16;

impl HoleFills<'_> {
    /// Repairs the fills whose triangles intersect others. Holes for which that does not help are filled again with other surfaces, the
    /// most similar to the wanted one first; the fill with the fewest intersecting triangles is kept.
    ///
    /// # Errors
    /// If there would be too many pairs of triangles to test, or the evaluation is told to stop.
    pub(crate) fn resolve(
        &mut self,
        options: PlainOptions,
        progress: &Progress<'_>,
    ) -> Result<(), FillError> {
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
        // Fills of adjacent holes that change in the same round may have come to intersect each other.
        let intersecting = self.intersecting();
        if intersecting.len() < 2 {
            return Ok(());
        }
        for hole in intersecting.into_iter().take(MOST_ALONE) {
            for &method in others {
                self.improve(&[hole], method, options, progress)?;
            }
        }
        Ok(())
    }

    /// The holes with filled triangles that intersect others.
    fn intersecting(&self) -> Vec<usize> {
        let counts = self.counts();
        (0..counts.len()).filter(|&hole| counts[hole] > 0).collect()
    }

    /// Fills some of the intersecting holes with another surface, or repairs their fills if no `method` is given, and keeps what has fewer
    /// intersecting triangles.
    fn improve(
        &mut self,
        holes: &[usize],
        method: Option<PlainMethod>,
        options: PlainOptions,
        progress: &Progress<'_>,
    ) -> Result<(), FillError> {
        let (before, begins) = (self.counts(), self.begins());
        // Wrong creases make many intersections, and are not repaired.
        fn is_misfit(hole: usize, before: &[usize], fills: &[HoleFill]) -> bool {
            fills[hole].is_sharp && before[hole] > MOST_REPAIRED
        }
        fn is_unasked(hole: usize, options_method: &PlainMethod, fills: &[HoleFill]) -> bool {
            *options_method == PlainMethod::PlateOrCreases && fills[hole].is_sharp
        }
        let intersecting = holes.par_iter().filter(|&&hole| {
            before[hole] > 0 && !(method.is_none() && is_misfit(hole, &before, self.fills))
        });
        let other = |&hole: &usize| {
            let rim = Rim::new(self.filling, self.one_rings, &self.holes[hole]);
            let mut fill = match method {
                None => self.fills[hole].clone(),
                Some(method) => {
                    match fill_hole(
                        self.filling,
                        &rim,
                        PlainOptions { method, ..options },
                        progress,
                    ) {
                        // Creases that the user did not ask for are given up without a warning.
                        Ok(fill)
                            if method == PlainMethod::ThinPlate
                                && is_unasked(hole, &options.method, self.fills) =>
                        {
                            fill
                        }
                        Ok(fill) => HoleFill { fallback: Some(Fallback::Intersection), ..fill },
                        Err(Stop::Cancelled) => return Err(Cancelled.into()),
                        // A fill that would be too large is not tried.
                        Err(Stop::TooMany(_)) => self.fills[hole].clone(),
                    }
                }
            };
            let own = begins[hole]..begins[hole + 1];
            repair(
                &mut fill.triangulation,
                &Obstacles { intersections: self.intersections, own, rim: &rim },
            );
            Ok((hole, fill))
        };
        let mut others = intersecting.map(other).collect::<Result<Vec<_>, FillError>>()?;
        self.exchange(&mut others, progress)?;
        let after = self.counts();
        others.retain(|(hole, _)| before[*hole] <= after[*hole]);
        self.exchange(&mut others, progress)
    }

    /// Swaps the fills of some holes with those given.
    fn exchange(
        &mut self,
        others: &mut [(usize, HoleFill)],
        progress: &Progress<'_>,
    ) -> Result<(), FillError> {
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

    /// The first face of each fill, and last the number of all faces.
    fn begins(&self) -> Vec<u32> {
        let mut begins = vec![self.filling.kept as u32];
        for fill in self.fills.iter() {
            begins.push(begins[begins.len() - 1] + fill.triangulation.n_faces() as u32);
        }
        begins
    }

    /// Two possible reasons for intersections, each with its holes: a component of the mesh to which the rim does not belong is in the way,
    /// and the data at the rim intersect other data.
    pub(crate) fn reasons(&self, components: &Components) -> [Vec<usize>; 2] {
        let begins = self.begins();
        let mut in_the_way = Vec::new();
        for &[face, filled] in self.intersections.pairs() {
            let hole = begins.partition_point(|&begin| begin <= filled) - 1;
            fn component(vertex: u32, components: &Components) -> u32 {
                components.of(vertex)
            }
            let is_data = (face as usize) < self.filling.kept;
            let other = self.filling.faces[face as usize][0];
            if is_data && component(other, components) != component(self.holes[hole][0], components)
            {
                in_the_way.push(hole);
            }
        }
        in_the_way.sort_unstable();
        in_the_way.dedup();
        let holes = self.intersecting().into_iter();
        [in_the_way, holes.filter(|&hole| self.has_intersecting_data(hole)).collect()]
    }

    /// Whether the data at a rim intersect other data.
    fn has_intersecting_data(&self, hole: usize) -> bool {
        let at_rim = self.holes[hole].iter().flat_map(|&vertex| self.one_rings.of(vertex));
        at_rim.copied().any(|vertices| {
            let triangle = Triangle {
                vertices,
                corners: vertices.map(|vertex: u32| self.filling.points[vertex as usize]),
                face: NONE,
            };
            let mut intersects = false;
            self.intersections.with(&triangle, |face| {
                let is_data = (face as usize) < self.filling.kept;
                intersects |= is_data && self.filling.faces[face as usize] != vertices;
            });
            intersects
        })
    }

    /// How many filled triangles of each hole intersect others.
    fn counts(&self) -> Vec<usize> {
        let faces = self.intersections.faces(self.filling);
        fn place(end: u32, faces: &[u32]) -> usize {
            faces.partition_point(|&face| face < end)
        }
        let begins = self.begins();
        begins.windows(2).map(|ends| place(ends[1], &faces) - place(ends[0], &faces)).collect()
    }
}
