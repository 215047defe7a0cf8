//! Segments a mesh into charts.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BinaryHeap};

use maquette_base::topology::lists::Lists;
use maquette_base::topology::union_find::UnionFind;
use maquette_node::{CancelledError, Progress};
use maquette_value::Mesh;
use maquette_value::parallel::UntilStopped;
use nalgebra::Vector3;

/// Index of a corner that does not exist.
pub(super) const NONE: u32 = u32::MAX;

/// Returns, for each side of a face (identified by its first corner), the side of the adjacent face along the same edge. It is [`NONE`] at
/// borders, at edges with more than two faces, and if the adjacent face has the opposite orientation.
pub(super) fn opposites(mesh: &Mesh) -> Vec<u32> {
    let edges = mesh.edges();
    let corners = mesh.faces().corners();
    let mut first = vec![NONE; edges.vertices.len()];
    let mut opposites = vec![NONE; corners.len()];
    for (corner, &edge) in (0u32..).zip(&edges.of_corner) {
        match first[edge as usize] {
            NONE => first[edge as usize] = corner,
            other => {
                let is_same_way = corners[other as usize] == corners[corner as usize];
                if edges.faces[edge as usize] == 2 && !is_same_way {
                    opposites[other as usize] = corner;
                    opposites[corner as usize] = other;
                }
            }
        }
    }
    opposites
}

/// Returns the face of each corner.
pub(super) fn faces_of_corners(mesh: &Mesh) -> Vec<u32> {
    let faces = (0u32..).zip(mesh.faces().iter());
    faces.flat_map(|(number, face)| std::iter::repeat_n(number, face.len())).collect()
}

/// A set of connected faces.
#[derive(Default)]
struct Cluster {
    area: f64,
    /// The sum of the faces' area vectors. Its length equals the area for a flat cluster, and is smaller for a bent one.
    vector: Vector3<f64>,
    /// The length of the cluster's border, in mm.
    rim: f64,
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

/// Weight of the squared border length of a merged cluster, relative to the deviation of its normals. With this weight, the rounder result
/// is preferred if the clusters meet at an angle of up to about 16 degrees.
const ROUNDNESS: f64 = 0.01;

/// Returns the faces of each chart, in ascending order. `flatness` is the minimum ratio of a chart's area projected along its mean normal
/// to its area.
///
/// Pairs of neighboring clusters are merged, beginning with those that stay flat and round: Garland, Willmott and Heckbert, "Hierarchical
/// face clustering on polygonal surfaces" (2001). The cost is the deviation of normals of Cohen-Steiner, Alliez and Desbrun, "Variational
/// shape approximation" (2004): `|V1| + |V2| - |V1 + V2|` for the sums `V1` and `V2` of area vectors of the two clusters. Then borders are
/// straightened. The time is O(n log n).
pub(super) fn segment(
    mesh: &Mesh,
    opposites: &[u32],
    flatness: f64,
    progress: &Progress<'_>,
) -> Result<Vec<Vec<u32>>, CancelledError> {
    let of_corner = faces_of_corners(mesh);
    let lengths = side_lengths(mesh);
    let mut clusters: Vec<_> = mesh
        .faces()
        .iter()
        .map(|face| {
            let vector = mesh.area_vector(face);
            Cluster { area: vector.norm(), vector, ..Cluster::default() }
        })
        .collect();
    for (corner, &opposite) in opposites.iter().enumerate().until_stopped() {
        let own = of_corner[corner];
        clusters[own as usize].rim += lengths[corner];
        if opposite != NONE && of_corner[opposite as usize] != own {
            let around = &mut clusters[own as usize].around;
            *around.entry(of_corner[opposite as usize]).or_default() += lengths[corner];
        }
    }
    // A pair of faces without area gets the cost of a very small face.
    let least = clusters.iter().map(|it| it.area).sum::<f64>() * 1e-12;
    fn merging(clusters: &[Cluster], a: u32, b: u32, flatness: f64, least: f64) -> Option<Merging> {
        let [own, other] = [a, b].map(|it| &clusters[it as usize]);
        let (area, vector) = (own.area + other.area, own.vector + other.vector);
        let rim = own.rim + other.rim - 2.0 * own.around[&b];
        let bent = own.vector.norm() + other.vector.norm() - vector.norm();
        (flatness * area <= vector.norm()).then(|| Merging {
            cost: (bent.max(0.0) + ROUNDNESS * rim * rim) / area.max(least),
            pair: [a, b],
            versions: [own.version, other.version],
        })
    }
    let mut heap = BinaryHeap::new();
    for own in (0..clusters.len() as u32).until_stopped() {
        let later = clusters[own as usize].around.range(own + 1..);
        heap.extend(
            later.filter_map(|(&other, _)| merging(&clusters, own, other, flatness, least)),
        );
    }
    let mut sets = UnionFind::new(clusters.len());
    let mut done = 0usize;
    while let Some(Merging { pair: [a, b], versions, .. }) = heap.pop() {
        // Skip an outdated pair: one of its clusters has changed since the pair was queued.
        if [a, b].map(|it| clusters[it as usize].version) != versions {
            continue;
        }
        done += 1;
        if done.is_multiple_of(1024) {
            progress.tick(done as f64 / clusters.len() as f64)?;
        }
        sets.union(a, b);
        join(&mut clusters, a, b);
        let around = clusters[a as usize].around.keys();
        heap.extend(
            around.filter_map(|&other| {
                merging(&clusters, a.min(other), a.max(other), flatness, least)
            }),
        );
    }
    let (mut charts, _) = sets.into_labels();
    straighten(mesh, opposites, &of_corner, &lengths, flatness, &mut charts);
    let count = charts.iter().max().map_or(0, |&last| last as usize + 1);
    let lists = Lists::group(count, || charts.iter().copied().zip(0..));
    Ok((0..count).map(|chart| lists.list(chart).to_vec()).filter(|it| !it.is_empty()).collect())
}

/// Returns the length of each side of each face, in mm.
fn side_lengths(mesh: &Mesh) -> Vec<f64> {
    fn place(vertex: &u32, mesh: &Mesh) -> nalgebra::Point3<f64> {
        mesh.positions()[*vertex as usize]
    }
    mesh.faces()
        .iter()
        .flat_map(|face| {
            let next = face[1..].iter().chain(&face[..1]);
            face.iter()
                .zip(next)
                .map(|(a, b)| (place(b, mesh) - place(a, mesh)).norm())
                .collect::<Vec<_>>()
        })
        .collect()
}

/// Merges the cluster `b` into `a`.
fn join(clusters: &mut [Cluster], a: u32, b: u32) {
    let mut other = std::mem::take(&mut clusters[b as usize]);
    clusters[b as usize].version = u32::MAX;
    let own = &mut clusters[a as usize];
    own.area += other.area;
    own.vector += other.vector;
    own.rim += other.rim - 2.0 * own.around[&b];
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
