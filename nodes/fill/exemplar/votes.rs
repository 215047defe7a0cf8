//! The attributes of filled vertices, as means over the exemplars of the patches around them.

use maquette_value::parallel::*;
use nalgebra::Point3;

use super::exemplars::Exemplars;
use super::level::Outcome;
use super::surface::{NONE, Surface};
use super::turns::Turns;

/// For each filled vertex the data vertices that the patches around it have in its place, and how much each counts.
#[derive(Debug)]
pub(crate) struct Votes {
    starts: Vec<u32>,
    votes: Vec<(u32, f64)>,
}

impl Votes {
    /// No votes for so many vertices.
    pub(super) fn none(count: usize) -> Self {
        Self { starts: vec![0; count + 1], votes: Vec::new() }
    }

    /// Those of the patches of the last level.
    pub(super) fn new(
        outcome: &Outcome,
        exemplars: &Exemplars,
        turns: &Turns,
        surface: &Surface<'_>,
        points: &[Point3<f64>],
        data: usize,
    ) -> Self {
        let patches = &outcome.patches;
        let of_site = |site: usize| -> Vec<(u32, f64)> {
            let point = points[patches.sites[site] as usize];
            patches
                .entries
                .of(site)
                .iter()
                .filter_map(|&entry| {
                    let center = patches.centers[entry as usize] as usize;
                    let found = &outcome.matches[center];
                    if found.exemplar == NONE {
                        return None;
                    }
                    let to = exemplars.place(found, turns, &outcome.frames[center], point);
                    let from = exemplars.vertices[found.exemplar as usize];
                    let vertex = surface.descend(points, from, &to, data as u32);
                    Some((vertex, outcome.shares[center]))
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

    /// The votes for a filled vertex, counted from the first filled one.
    fn of(&self, filled: usize) -> &[(u32, f64)] {
        &self.votes[self.starts[filled] as usize..self.starts[filled + 1] as usize]
    }

    /// For each filled vertex the weighted mean of what `read` has for data vertices; none where there are no votes.
    pub(crate) fn mean<const N: usize>(
        &self,
        read: impl Fn(u32) -> [f64; N],
    ) -> Vec<Option<[f64; N]>> {
        (0..self.starts.len() - 1)
            .map(|filled: usize| {
                let (mut sum, mut weight) = ([0.0; N], 0.0);
                for &(vertex, share) in self.of(filled) {
                    let own = read(vertex);
                    (0..N).for_each(|k| sum[k] += share * own[k]);
                    weight += share;
                }
                (weight > 0.0).then(|| sum.map(|sum| sum / weight))
            })
            .collect()
    }
}
