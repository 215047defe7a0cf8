//! Gives what fills holes another density.

use maquette::{Cancelled, Progress};
use nalgebra::Point3;

use super::density::{Stop, refine};
use super::fairing::{Energy, fair};
use super::filling::Filling;
use super::plug::Plug;
use super::rim::{Rim, Surroundings};
use super::sizes::Sizes;

/// What fills some holes, as triangles that can be split and collapsed.
pub(super) struct Remesh<'a> {
    pub(super) surroundings: &'a Surroundings,
    pub(super) holes: &'a [Vec<u32>],
    pub(super) plugs: &'a mut [Plug],
    /// How long edges are in the end, if not as the data's.
    pub(super) edge: Option<f64>,
}

impl Remesh<'_> {
    /// Brings the edges of what fills `filling` to `least`, or to the length that they are to have in the end where that is more. Vertices
    /// stay on the surface that they are on, and get other numbers.
    ///
    /// # Errors
    /// If there would be too many triangles, or the evaluation is told to stop.
    pub(super) fn refine(
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
    pub(super) fn membranes(
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
    pub(super) fn take(&mut self, filling: &Filling) {
        let mut places = filling.points[filling.data..].iter();
        for (hole, plug) in self.holes.iter().zip(self.plugs.iter_mut()) {
            let (_, kept) = plug.patch.compact();
            for (&vertex, place) in kept[hole.len()..].iter().zip(&mut places) {
                plug.patch.points[vertex as usize] = *place;
            }
        }
    }
}
