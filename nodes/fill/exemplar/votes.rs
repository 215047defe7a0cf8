//! The attributes of the fill's vertices, as weighted means over input vertices that surrounding patches copy.

use maquette_value::parallel::*;
use nalgebra::Point3;

use super::exemplars::Exemplars;
use super::level::Outcome;
use super::orientations::Orientations;
use super::surface::{NONE, Surface};

/// For each vertex of the fill, the input vertices whose attributes it averages (votes), and their weights. Each patch around the vertex
/// contributes the input vertex at the position that the vertex has on the patch's exemplar.
#[derive(Debug)]
pub(crate) struct Votes {
    starts: Vec<u32>,
    votes: Vec<(u32, f64)>,
}

impl Votes {
    /// Creates an empty list of votes for each of `count` vertices.
    pub(super) fn empty(count: usize) -> Self {
        Self { starts: vec![0; count + 1], votes: Vec::new() }
    }

    /// Collects the votes of the patches of the last level.
    pub(super) fn new(
        outcome: &Outcome,
        exemplars: &Exemplars,
        orientations: &Orientations,
        surface: &Surface<'_>,
        points: &[Point3<f64>],
        data: usize,
    ) -> Self {
        let patches = &outcome.patches;
        let of_site = |site: usize| -> Vec<(u32, f64)> {
            let point = points[patches.sites[site] as usize];
            patches
                .entries
                .list(site)
                .iter()
                .filter_map(|&entry| {
                    let center = patches.centers[entry as usize] as usize;
                    let found = &outcome.matches[center];
                    if found.exemplar == NONE {
                        return None;
                    }
                    let to =
                        exemplars.map_point(found, orientations, &outcome.frames[center], point);
                    let from = exemplars.vertices[found.exemplar as usize];
                    let vertex = surface.walk_to_nearest(points, from, &to, data as u32);
                    Some((vertex, outcome.patch_weights[center]))
                })
                .collect()
        };
        let found: Vec<Vec<(u32, f64)>> =
            (0..patches.movable).into_par_iter().with_min_len(64).map(of_site).collect();
        let mut lists = vec![Vec::new(); points.len() - data];
        for (votes, &vertex) in found.into_iter().zip(&patches.sites) {
            lists[vertex as usize - data] = votes;
        }
        let mut all = Self { starts: vec![0], votes: Vec::new() };
        for list in lists {
            all.votes.extend(list);
            all.starts.push(all.votes.len() as u32);
        }
        all
    }

    /// Returns the votes for a vertex, given by its index among the fill's vertices.
    fn votes_for(&self, filled: usize) -> &[(u32, f64)] {
        &self.votes[self.starts[filled] as usize..self.starts[filled + 1] as usize]
    }

    /// For each vertex of the fill, returns the weighted mean of `read` over the input vertices that vote for it; `None` if no input vertex
    /// votes for it.
    pub(crate) fn mean<const N: usize>(
        &self,
        read: impl Fn(u32) -> [f64; N],
    ) -> Vec<Option<[f64; N]>> {
        (0..self.starts.len() - 1)
            .map(|filled: usize| {
                let (mut sum, mut weight) = ([0.0; N], 0.0);
                for &(vertex, own_weight) in self.votes_for(filled) {
                    let own = read(vertex);
                    (0..N).for_each(|k| sum[k] += own_weight * own[k]);
                    weight += own_weight;
                }
                (weight > 0.0).then(|| sum.map(|sum| sum / weight))
            })
            .collect()
    }
}
