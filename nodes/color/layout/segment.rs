//! Segments a mesh into charts.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BinaryHeap};

use maquette_base::topology::lists::Lists;
use maquette_base::topology::union_find::UnionFind;
use maquette_node::{CancelledError, Progress};
use maquette_value::Mesh;
use maquette_value::parallel::*;
use nalgebra::Vector3;

use super::clusters::{Cluster, Clusters, Criterion, FEW};
use super::sides::{NONE, side_lengths};

/// A cluster in the queue.
#[derive(Default)]
struct Queued {
    cluster: Cluster,
    /// The length of the common border with each neighboring cluster, in mm.
    around: BTreeMap<u32, f64>,
    /// The number of changes of the cluster. By this number, outdated pairs in the queue are recognized.
    version: u32,
}

/// A candidate for merging: two neighboring clusters and the cost of merging them.
struct Merging {
    cost: f64,
    pair: [u32; 2],
    versions: [u32; 2],
}

impl Ord for Merging {
    /// The order is reversed: the cheapest pair is the greatest, which the queue returns first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.cost.total_cmp(&self.cost).then_with(|| other.pair.cmp(&self.pair))
    }
}

impl PartialOrd for Merging {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Merging {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Merging {}

/// Returns the faces of each chart, in ascending order. `flatness` is the minimum ratio of a chart's area projected along its mean normal
/// to its area.
///
/// Pairs of neighboring clusters are merged, beginning with those that stay flat and round: Garland, Willmott and Heckbert, "Hierarchical
/// face clustering on polygonal surfaces" (2001). The cost is the deviation of normals of Cohen-Steiner, Alliez and Desbrun, "Variational
/// shape approximation" (2004): `|V1| + |V2| - |V1 + V2|` for the sums `V1` and `V2` of area vectors of the two clusters. Many clusters are
/// merged in rounds on all threads, the last few pair by pair. Then borders are straightened. The time is O(n log n).
pub(super) fn segment(
    mesh: &Mesh,
    opposites: &[u32],
    of_corner: &[u32],
    flatness: f64,
    progress: &Progress<'_>,
) -> Result<Vec<Vec<u32>>, CancelledError> {
    let lengths = side_lengths(mesh);
    let mut clusters = Clusters::new(mesh, opposites, of_corner, &lengths);
    let criterion = Criterion::new(flatness, &clusters.all);
    let count = clusters.all.len();
    while ROUNDS_FROM <= count && FEW < clusters.all.len() {
        progress.tick(1.0 - clusters.all.len() as f64 / count as f64)?;
        let before = clusters.all.len();
        if clusters.merge_cheapest(&criterion) * MAX_ROUNDS < before {
            break;
        }
    }
    let merged = merge_in_order(&clusters, &criterion, count, progress)?;
    let of_face = clusters.of_face.par_iter().with_min_len(4096);
    let mut charts: Vec<u32> = of_face.map(|&cluster| merged[cluster as usize]).collect();
    straighten(mesh, opposites, of_corner, &lengths, flatness, &mut charts);
    let count = charts.iter().max().map_or(0, |&last| last as usize + 1);
    let lists = Lists::group(count, || charts.iter().copied().zip(0..));
    Ok((0..count).map(|chart| lists.list(chart).to_vec()).filter(|it| !it.is_empty()).collect())
}

/// Number of faces from which on clusters are merged in rounds.
const ROUNDS_FROM: usize = 2 * FEW;

/// The rounds end when one would merge fewer than one of so many clusters.
const MAX_ROUNDS: usize = 100;

/// Merges pairs of clusters, always the one with the lowest cost, until all results would be too bent. Returns the chart of each cluster.
/// `count` is the number of faces.
fn merge_in_order(
    all: &Clusters,
    criterion: &Criterion,
    count: usize,
    progress: &Progress<'_>,
) -> Result<Vec<u32>, CancelledError> {
    let mut clusters: Vec<_> = (0..)
        .zip(&all.all)
        .map(|(index, &cluster)| {
            let around = all.around.list(index).iter().copied().collect();
            Queued { cluster, around, version: 0 }
        })
        .collect();
    fn merging(clusters: &[Queued], a: u32, b: u32, criterion: &Criterion) -> Option<Merging> {
        let [own, other] = [a, b].map(|it| &clusters[it as usize]);
        let cost = criterion.cost(&own.cluster, &other.cluster, own.around[&b])?;
        Some(Merging { cost, pair: [a, b], versions: [own.version, other.version] })
    }
    let mut heap = BinaryHeap::new();
    for own in 0..clusters.len() as u32 {
        let later = clusters[own as usize].around.range(own + 1..);
        heap.extend(later.filter_map(|(&other, _)| merging(&clusters, own, other, criterion)));
    }
    let mut sets = UnionFind::new(clusters.len());
    let mut done = count - clusters.len();
    while let Some(Merging { pair: [a, b], versions, .. }) = heap.pop() {
        // Skip an outdated pair: one of its clusters has changed since the pair was queued.
        if [a, b].map(|it| clusters[it as usize].version) != versions {
            continue;
        }
        done += 1;
        if done.is_multiple_of(1024) {
            progress.tick(done as f64 / count as f64)?;
        }
        sets.union(a, b);
        join(&mut clusters, a, b);
        let around = clusters[a as usize].around.keys();
        heap.extend(
            around.filter_map(|&other| merging(&clusters, a.min(other), a.max(other), criterion)),
        );
    }
    Ok(sets.into_labels().0)
}

/// Merges the cluster `b` into `a`.
fn join(clusters: &mut [Queued], a: u32, b: u32) {
    let mut other = std::mem::take(&mut clusters[b as usize]);
    clusters[b as usize].version = u32::MAX;
    let own = &mut clusters[a as usize];
    own.cluster = own.cluster.merged(&other.cluster, own.around[&b]);
    own.version += 1;
    own.around.remove(&b);
    other.around.remove(&a);
    for &neighbor in other.around.keys() {
        let around = &mut clusters[neighbor as usize].around;
        let length = around.remove(&b).expect("neighbors know each other");
        *around.entry(a).or_default() += length;
    }
    // The shorter list of neighbors is appended to the longer one.
    let own = &mut clusters[a as usize].around;
    if own.len() < other.around.len() {
        std::mem::swap(own, &mut other.around);
    }
    other.around.into_iter().for_each(|(it, length)| *own.entry(it).or_default() += length);
}

/// Number of rounds in which the borders of charts are straightened.
const ROUNDS: usize = 4;

/// Straightens borders: a face connected to its chart by only one side moves to the chart with which it shares more border, if both charts
/// stay flat.
fn straighten(
    mesh: &Mesh,
    opposites: &[u32],
    of_corner: &[u32],
    lengths: &[f64],
    flatness: f64,
    charts: &mut [u32],
) {
    let vectors: Vec<_> = mesh.faces().iter().map(|face| mesh.area_vector(face)).collect();
    let mut sums = vec![(0.0, Vector3::zeros()); charts.len()];
    for (&chart, vector) in charts.iter().zip(&vectors) {
        sums[chart as usize].0 += vector.norm();
        sums[chart as usize].1 += vector;
    }
    fn is_flat((area, vector): (f64, Vector3<f64>), flatness: f64) -> bool {
        flatness * area <= vector.norm()
    }
    for _ in 0..ROUNDS {
        for face in (0..charts.len()).until_stopped() {
            let own = charts[face];
            let first = mesh.faces().first_corner(face);
            let sides = first..first + mesh.faces().face(face).len();
            let is_inside = sides.clone().all(|side| {
                opposites[side] == NONE
                    || charts[of_corner[opposites[side] as usize] as usize] == own
            });
            if is_inside {
                continue;
            }
            let mut around: BTreeMap<u32, (usize, f64)> = BTreeMap::new();
            for side in sides.filter(|&side| opposites[side] != NONE) {
                let chart = charts[of_corner[opposites[side] as usize] as usize];
                let border = around.entry(chart).or_default();
                *border = (border.0 + 1, border.1 + lengths[side]);
            }
            let (count, length) = around.remove(&own).unwrap_or_default();
            let best = around.iter().rev().max_by(|a, b| a.1.1.total_cmp(&b.1.1));
            let Some((&other, _)) = best.filter(|it| count == 1 && length < it.1.1) else {
                continue;
            };
            let (area, vector) = (vectors[face].norm(), vectors[face]);
            let [without, with] = [(own, -1.0), (other, 1.0)].map(|(chart, sign)| {
                let sum = sums[chart as usize];
                (sum.0 + sign * area, sum.1 + sign * vector)
            });
            if is_flat(with, flatness) && is_flat(without, flatness) {
                (sums[own as usize], sums[other as usize]) = (without, with);
                charts[face] = other;
            }
        }
    }
}
