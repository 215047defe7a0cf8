//! Clusters of connected faces, and rounds in which many pairs of them are merged at a time, on all threads.

use std::ops::Range;

use maquette_base::topology::lists::Lists;
use maquette_value::Mesh;
use maquette_value::parallel::*;
use nalgebra::Vector3;

use super::sides::NONE;

/// A set of connected faces.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Cluster {
    pub(super) area: f64,
    /// The sum of the faces' area vectors. Its length equals the area for a flat cluster, and is smaller for a bent one.
    pub(super) vector: Vector3<f64>,
    /// The length of the cluster's border, in mm.
    pub(super) rim: f64,
}

impl Cluster {
    /// Returns the union of two clusters whose common border is `border` mm long.
    pub(super) fn merged(&self, other: &Self, border: f64) -> Self {
        Self {
            area: self.area + other.area,
            vector: self.vector + other.vector,
            rim: self.rim + (other.rim - 2.0 * border),
        }
    }
}

/// The criterion by which clusters are merged.
#[derive(Clone, Copy, Debug)]
pub(super) struct Criterion {
    /// The minimum ratio of a cluster's area projected along its mean normal to its area.
    pub(super) flatness: f64,
    /// The minimum area by which costs are divided, so that faces without area have a cost, too.
    least: f64,
}

/// Weight of the squared border length of a merged cluster, relative to the deviation of its normals. With this weight, the rounder result
/// is preferred if the clusters meet at an angle of up to about 16 degrees.
const ROUNDNESS: f64 = 0.01;

impl Criterion {
    pub(super) fn new(flatness: f64, clusters: &[Cluster]) -> Self {
        Self { flatness, least: clusters.iter().map(|it| it.area).sum::<f64>() * 1e-12 }
    }

    /// Returns the cost of merging two clusters whose common border is `border` mm long. `None` if the result would be too bent.
    pub(super) fn cost(&self, own: &Cluster, other: &Cluster, border: f64) -> Option<f64> {
        let (area, vector) = (own.area + other.area, own.vector + other.vector);
        let norm = vector.norm();
        (self.flatness * area <= norm).then(|| {
            let rim = own.rim + other.rim - 2.0 * border;
            let bent = own.vector.norm() + other.vector.norm() - norm;
            (bent.max(0.0) + ROUNDNESS * rim * rim) / area.max(self.least)
        })
    }
}

/// Clusters of all faces of a mesh.
pub(super) struct Clusters {
    pub(super) all: Vec<Cluster>,
    /// The neighbors of each cluster in ascending order, each with the length of the common border in mm.
    pub(super) around: Lists<(u32, f64)>,
    /// The cluster of each face. Clusters are numbered in the order of their first faces.
    pub(super) of_face: Vec<u32>,
}

/// Number of clusters at which the rounds end. So few are merged one pair after the other, the cheapest first.
pub(super) const FEW: usize = 10_000;

/// Number of clusters that a part of a loop handles.
const BATCH: usize = 1024;

impl Clusters {
    /// Makes a cluster of each face.
    pub(super) fn new(mesh: &Mesh, opposites: &[u32], of_corner: &[u32], lengths: &[f64]) -> Self {
        let faces = (0..mesh.faces().len()).into_par_iter();
        fn sides(face: usize, mesh: &Mesh) -> Range<usize> {
            let first = mesh.faces().first_corner(face);
            first..first + mesh.faces().face(face).len()
        }
        let all = faces.clone().with_min_len(BATCH).map(|face| {
            let vector = mesh.area_vector(mesh.faces().face(face));
            let rim = sides(face, mesh).fold(0.0, |rim, side| rim + lengths[side]);
            Cluster { area: vector.norm(), vector, rim }
        });
        let all = all.collect();
        let around = collect_lists(mesh.faces().len(), |face, list| {
            let neighbors = sides(face, mesh).filter_map(|side| {
                let opposite = opposites[side];
                let other = (opposite != NONE).then(|| of_corner[opposite as usize])?;
                (other != face as u32).then_some((other, lengths[side]))
            });
            list.extend(neighbors);
            list.sort_by_key(|entry| entry.0);
        });
        Self { all, around, of_face: (0..mesh.faces().len() as u32).collect() }
    }

    /// Merges pairs of clusters each of which is the other's cheapest partner: the cheaper half of all such pairs. Returns their number.
    ///
    /// These are also the pairs that are merged next if always the cheapest pair of all is merged, except where the merging of two clusters
    /// makes a third one cheaper for them: Murtagh, "A survey of recent advances in hierarchical clustering algorithms" (1983).
    pub(super) fn merge_cheapest(&mut self, criterion: &Criterion) -> usize {
        let still = &*self;
        let (partners, costs): (Vec<u32>, Vec<f64>) = (0..self.all.len() as u32)
            .into_par_iter()
            .with_min_len(BATCH)
            .map(|own| still.cheapest(own, criterion))
            .unzip();
        let is_mutual = |own: usize| {
            partners.get(partners[own] as usize).is_some_and(|&back| back as usize == own)
        };
        let mut mutual: Vec<f64> =
            (0..costs.len()).filter(|&own| is_mutual(own)).map(|own| costs[own]).collect();
        let middle = mutual.len() / 2;
        let most = match middle < mutual.len() {
            true => *mutual.select_nth_unstable_by(middle, f64::total_cmp).1,
            false => f64::INFINITY,
        };
        // The clusters that stay, and the new index of each cluster.
        let (mut firsts, mut names) = (Vec::new(), vec![0; self.all.len()]);
        for (own, &partner) in (0u32..).zip(&partners) {
            let is_merged = is_mutual(own as usize) && costs[own as usize] <= most;
            if is_merged && partner < own {
                names[own as usize] = names[partner as usize];
            } else {
                names[own as usize] = firsts.len() as u32;
                firsts.push([own, if is_merged { partner } else { NONE }]);
            }
        }
        let (names, firsts) = (&names, &firsts);
        let all = firsts.par_iter().with_min_len(BATCH).map(|&[own, partner]| {
            let cluster = &still.all[own as usize];
            match partner {
                NONE => *cluster,
                _ => cluster.merged(&still.all[partner as usize], still.border(own, partner)),
            }
        });
        let all = all.collect();
        let around = collect_lists(firsts.len(), |index, list| {
            for old in firsts[index].into_iter().filter(|&old| old != NONE) {
                let neighbors = still.around.list(old as usize).iter();
                let neighbors = neighbors.map(|&(other, border)| (names[other as usize], border));
                list.extend(neighbors.filter(|entry| entry.0 != index as u32));
            }
            // Borders are added in an order that is the same for both of their clusters.
            list.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        });
        let of_face = self.of_face.par_iter().with_min_len(4 * BATCH);
        let of_face = of_face.map(|&old| names[old as usize]).collect();
        let pairs = self.all.len() - firsts.len();
        *self = Self { all, around, of_face };
        pairs
    }

    /// Returns the length of the common border of two neighbors.
    fn border(&self, own: u32, other: u32) -> f64 {
        let list = self.around.list(own as usize);
        list.binary_search_by_key(&other, |entry| entry.0).map_or(0.0, |index| list[index].1)
    }

    /// Returns the neighbor with which it is cheapest to merge a cluster, and the cost; `NONE` if all results would be too bent.
    fn cheapest(&self, own: u32, criterion: &Criterion) -> (u32, f64) {
        let cluster = &self.all[own as usize];
        let mut best = (f64::INFINITY, 0, NONE);
        for &(other, border) in self.around.list(own as usize) {
            let Some(cost) = criterion.cost(cluster, &self.all[other as usize], border) else {
                continue;
            };
            let hash = hash([own.min(other), own.max(other)]);
            if cost.total_cmp(&best.0).then(hash.cmp(&best.1)).then(other.cmp(&best.2)).is_lt() {
                best = (cost, hash, other);
            }
        }
        (best.2, best.0)
    }
}

/// Makes `count` lists by calling `fill` with the index of each and an empty list. Entries of a list with the same key, which must be
/// adjacent, are added up.
fn collect_lists(
    count: usize,
    fill: impl Fn(usize, &mut Vec<(u32, f64)>) + Sync,
) -> Lists<(u32, f64)> {
    let fill = &fill;
    let batches: Vec<_> = (0..count.div_ceil(BATCH))
        .into_par_iter()
        .map(|batch| {
            let (mut lengths, mut items, mut list) = (Vec::new(), Vec::new(), Vec::new());
            for index in batch * BATCH..count.min((batch + 1) * BATCH) {
                list.clear();
                fill(index, &mut list);
                let before = items.len();
                let sums = list.chunk_by(|a, b| a.0 == b.0);
                items.extend(sums.map(|run| {
                    (run[0].0, run[1..].iter().fold(run[0].1, |sum, entry| sum + entry.1))
                }));
                lengths.push((items.len() - before) as u32);
            }
            (lengths, items)
        })
        .collect();
    Lists::concat(batches)
}

/// Mixes the bits of two numbers. Ties are broken by it: by index, neighbors in flat parts would have to wait for each other in long
/// chains.
fn hash([a, b]: [u32; 2]) -> u32 {
    let mixed = a.wrapping_mul(0x9e37_79b9) ^ b.wrapping_mul(0x85eb_ca6b);
    (mixed ^ mixed >> 15).wrapping_mul(0x2c1b_3c6d)
}
