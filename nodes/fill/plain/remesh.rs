//! Gives what fills holes another density.

use maquette::{Cancelled, Progress};
use nalgebra::Point3;

use super::fairing::{Energy, fair};
use super::plug::Plug;
use super::sizes::Sizes;
use crate::fill::border::rim::{Rim, Surroundings};
use crate::fill::triangles::density::{Stop, refine};
use crate::fill::triangles::filling::Filling;

/// What fills some holes, as triangles that can be split and collapsed.
pub(crate) struct Remesh<'a> {
    pub(crate) surroundings: &'a Surroundings,
    pub(crate) holes: &'a [Vec<u32>],
    pub(crate) plugs: &'a mut [Plug],
    /// How long edges are in the end, if not as the data's.
    pub(crate) edge: Option<f64>,
}

impl Remesh<'_> {
    /// Brings the edges of what fills `filling` to `least`, or to the length that they are to have in the end where that is more. Vertices
    /// stay on the surface that they are on, and get other numbers.
    ///
    /// # Errors
    /// If there would be too many triangles, or the evaluation is told to stop.
    pub(crate) fn refine(
        &mut self,
        filling: &mut Filling,
        least: f64,
        progress: &Progress<'_>,
    ) -> Result<(), Stop> {
        self.take(filling);
        for (hole, plug) in self.holes.iter().zip(self.plugs.iter_mut()) {
            let rim = Rim::new(filling, self.surroundings, hole);
            let sizes = Sizes::new(&rim, self.edge);
            refine(&mut plug.patch, |point| sizes.at(point).max(least), progress)?;
        }
        filling.add_all(self.holes, self.plugs);
        Ok(())
    }

    /// Where membranes would have the filled vertices, and takes over where these are.
    ///
    /// # Errors
    /// If the evaluation is told to stop.
    pub(crate) fn membranes(
        &mut self,
        filling: &mut Filling,
        progress: &Progress<'_>,
    ) -> Result<Vec<Point3<f64>>, Cancelled> {
        self.take(filling);
        let mut places = Vec::new();
        for (hole, plug) in self.holes.iter().zip(self.plugs.iter()) {
            let rim = Rim::new(filling, self.surroundings, hole);
            let mut patch = plug.patch.clone();
            fair(&mut patch, &rim, Energy::Membrane, progress)?;
            let (_, kept) = patch.compact();
            places.extend(kept[hole.len()..].iter().map(|&vertex| patch.points[vertex as usize]));
        }
        Ok(places)
    }

    /// Takes over where vertices have gone since they were added to `filling`.
    pub(crate) fn take(&mut self, filling: &Filling) {
        let mut places = filling.points[filling.data..].iter();
        for (hole, plug) in self.holes.iter().zip(self.plugs.iter_mut()) {
            let (_, kept) = plug.patch.compact();
            for (&vertex, place) in kept[hole.len()..].iter().zip(&mut places) {
                plug.patch.points[vertex as usize] = *place;
            }
        }
    }
}
