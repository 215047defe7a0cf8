//! Looks for other fillings of holes where triangles run through each other or through the data.

use maquette::{Cancelled, Progress};
use rayon::prelude::*;

use super::boxes::Triangle;
use super::intersections::Crossings;
use super::mend::{Around, mend};
use crate::fill::border::holes::Parts;
use crate::fill::border::rim::{Rim, Surroundings};
use crate::fill::fill_error::FillError;
use crate::fill::plain::fill_plainly::{self, Plain};
use crate::fill::plain::plug::{Doubt, Plug};
use crate::fill::plain::wanted::Wanted;
use crate::fill::triangles::density::Stop;
use crate::fill::triangles::filling::Filling;
use crate::fill::triangles::patch::NONE;

/// What fills some holes, and where it runs through something.
pub(crate) struct Fillings<'a> {
    pub(crate) filling: &'a mut Filling,
    pub(crate) surroundings: &'a Surroundings,
    pub(crate) holes: &'a [Vec<u32>],
    pub(crate) plugs: &'a mut [Plug],
    pub(crate) crossings: &'a mut Crossings,
}

/// So many holes are looked at one by one at the end.
const MOST_ALONE: usize = 20;

/// So many crossing triangles of a filling with creases are mended at most.
const MOST_MENDED: usize = 16;

impl Fillings<'_> {
    /// Mends what fills the holes whose triangles run through others. Where that does not help they are filled again, with other surfaces,
    /// those most like what is wanted first; of all these what runs through least is taken.
    ///
    /// # Errors
    /// If there would be too much to look at, or the evaluation is told to stop.
    pub(crate) fn calm(
        &mut self,
        wanted: Wanted,
        progress: &Progress<'_>,
    ) -> Result<(), FillError> {
        let others: &[Option<Plain>] = match wanted.plain {
            Plain::CreaseAware | Plain::PlateOrCreases => {
                &[None, Some(Plain::ThinPlate), Some(Plain::Membrane), Some(Plain::Flat)]
            }
            Plain::ThinPlate => &[None, Some(Plain::Membrane), Some(Plain::Flat)],
            Plain::Membrane => &[None, Some(Plain::Flat), Some(Plain::ThinPlate)],
            Plain::Flat | Plain::Centroid => {
                &[None, Some(Plain::Flat), Some(Plain::Membrane), Some(Plain::ThinPlate)]
            }
        };
        for &plain in others {
            self.improve(&self.restless(), plain, wanted, progress)?;
        }
        // Holes side by side whose fillings change together may get in each other's way.
        let restless = self.restless();
        if restless.len() < 2 {
            return Ok(());
        }
        for hole in restless.into_iter().take(MOST_ALONE) {
            for &plain in others {
                self.improve(&[hole], plain, wanted, progress)?;
            }
        }
        Ok(())
    }

    /// The holes with triangles that run through others.
    fn restless(&self) -> Vec<usize> {
        let counts = self.counts();
        (0..counts.len()).filter(|&hole| counts[hole] > 0).collect()
    }

    /// Fills some of the restless holes with another surface, or mends what fills them, and keeps that where it runs through less.
    fn improve(
        &mut self,
        holes: &[usize],
        plain: Option<Plain>,
        wanted: Wanted,
        progress: &Progress<'_>,
    ) -> Result<(), FillError> {
        let (before, begins) = (self.counts(), self.begins());
        // Creases that do not fit run through much, and are not mended.
        let is_misfit = |hole: usize| self.plugs[hole].is_sharp && before[hole] > MOST_MENDED;
        let is_unasked =
            |hole: usize| wanted.plain == Plain::PlateOrCreases && self.plugs[hole].is_sharp;
        let restless = holes
            .par_iter()
            .filter(|&&hole| before[hole] > 0 && !(plain.is_none() && is_misfit(hole)));
        let other = |&hole: &usize| {
            let rim = Rim::new(self.filling, self.surroundings, &self.holes[hole]);
            let mut plug = match plain {
                None => self.plugs[hole].clone(),
                Some(plain) => {
                    match fill_plainly::fill(self.filling, &rim, plain, wanted.edge, progress) {
                        // Nobody asked for the creases that go.
                        Ok(plug) if plain == Plain::ThinPlate && is_unasked(hole) => plug,
                        Ok(plug) => Plug { doubt: Some(Doubt::Calm), ..plug },
                        Err(Stop::Cancelled) => return Err(Cancelled.into()),
                        // One that is too large is none.
                        Err(Stop::TooMany(_)) => self.plugs[hole].clone(),
                    }
                }
            };
            let own = begins[hole]..begins[hole + 1];
            mend(&mut plug.patch, &Around { crossings: self.crossings, own, rim: &rim });
            Ok((hole, plug))
        };
        let mut others = restless.map(other).collect::<Result<Vec<_>, FillError>>()?;
        self.exchange(&mut others, progress)?;
        let after = self.counts();
        others.retain(|(hole, _)| before[*hole] <= after[*hole]);
        self.exchange(&mut others, progress)
    }

    /// Exchanges what fills some holes.
    fn exchange(
        &mut self,
        others: &mut [(usize, Plug)],
        progress: &Progress<'_>,
    ) -> Result<(), FillError> {
        if others.is_empty() {
            return Ok(());
        }
        let old = self.begins();
        let mut is_other = vec![false; self.holes.len()];
        for (hole, plug) in others {
            std::mem::swap(&mut self.plugs[*hole], plug);
            is_other[*hole] = true;
        }
        self.filling.add_all(self.holes, self.plugs);
        let new = self.begins();
        let hole_of = |begins: &[u32], face: u32| begins.partition_point(|&begin| begin <= face);
        self.crossings.renumber(|face| match hole_of(&old, face) {
            0 => Some(face),
            hole if is_other[hole - 1] => None,
            hole => Some(face - old[hole - 1] + new[hole - 1]),
        });
        let changed = |face: u32| is_other[hole_of(&new, face) - 1];
        self.crossings.look_again(self.filling, changed, progress)
    }

    /// The first face of what fills each hole, and behind them the number of all faces.
    fn begins(&self) -> Vec<u32> {
        let mut begins = vec![self.filling.kept as u32];
        for plug in self.plugs.iter() {
            begins.push(begins[begins.len() - 1] + plug.patch.n_faces() as u32);
        }
        begins
    }

    /// The holes whose triangles run through a part of the mesh that does not hang together with their rims, and those that do so where the
    /// data at their rims run through themselves.
    pub(crate) fn reasons(&self, parts: &Parts) -> [Vec<usize>; 2] {
        let begins = self.begins();
        let mut in_the_way = Vec::new();
        for &[face, filled] in self.crossings.pairs() {
            let hole = begins.partition_point(|&begin| begin <= filled) - 1;
            let part = |vertex: u32| parts.of(vertex);
            let is_data = (face as usize) < self.filling.kept;
            let other = self.filling.faces[face as usize][0];
            if is_data && part(other) != part(self.holes[hole][0]) {
                in_the_way.push(hole);
            }
        }
        in_the_way.sort_unstable();
        in_the_way.dedup();
        let crossing = self.restless().into_iter();
        [in_the_way, crossing.filter(|&hole| self.has_crossing_data(hole)).collect()]
    }

    /// Whether the data at a rim run through other data.
    fn has_crossing_data(&self, hole: usize) -> bool {
        let around = self.holes[hole].iter().flat_map(|&vertex| self.surroundings.around(vertex));
        let place = |vertex: u32| self.filling.points[vertex as usize];
        around.copied().any(|vertices| {
            let triangle = Triangle { vertices, corners: vertices.map(place), face: NONE };
            let mut crosses = false;
            self.crossings.with(&triangle, |face| {
                let is_data = (face as usize) < self.filling.kept;
                crosses |= is_data && self.filling.faces[face as usize] != vertices;
            });
            crosses
        })
    }

    /// How many triangles of each hole run through others.
    fn counts(&self) -> Vec<usize> {
        let faces = self.crossings.faces(self.filling);
        let place = |end: u32| faces.partition_point(|&face| face < end);
        let begins = self.begins();
        begins.windows(2).map(|ends| place(ends[1]) - place(ends[0])).collect()
    }
}
