//! Feature-based search for the motion between two scans, without a start pose.

use std::cmp::Reverse;
use std::collections::BTreeSet;

use histograms::{Histogram, histograms};
use maquette_node::{CancelledError, Progress};
use maquette_value::parallel::*;
use nalgebra::{Isometry3, Point3, Vector3};

use super::cloud::Cloud;
use super::fit::{Fit, fit};
use super::pairs::fit_motion;
use super::refine::{Level, refine};

mod histograms;

/// The number of points to which the larger scan is sampled for matching.
const SAMPLES: f64 = 1200.0;
/// The radii of the neighborhoods that histograms describe, in multiples of the sampling grid's edge.
const RADII: [f64; 2] = [4.0, 7.0];
/// For each point, the number of the most similar points of the other scan that are candidates for a match.
const SIMILAR: usize = 3;
/// The maximum number of matches that are compared with each other.
const MAX_MATCHES: usize = 1200;
/// The maximum number of mutually consistent matches from which a motion is computed.
const MAX_CONSISTENT: usize = 20;
/// The number of candidate motions that are refined on the surfaces.
const REFINED_MOTIONS: usize = 4;
/// The maximum number of refinement steps for each motion.
const STEPS: usize = 12;

/// A candidate motion and the quality of its fit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub(super) motion: Isometry3<f64>,
    pub(super) fit: Fit,
}

/// Returns the edge length of the sampling grid's cells for matching, in mm.
pub(super) fn sampling_edge(clouds: &[Cloud]) -> f64 {
    clouds
        .par_iter()
        .map(|cloud: &Cloud| {
            let (low, high) = cloud.bounds();
            let first = (high - low).norm() / 40.0;
            let count = cloud.sample(first).positions.len() as f64;
            (first * (count / SAMPLES).sqrt()).max(2.0 * cloud.spacing)
        })
        .reduce(|| 0.0, f64::max)
}

/// A sampled scan with the feature histograms of its points.
pub(super) struct DescribedCloud {
    cloud: Cloud,
    /// For each radius the histogram of each point; `None` near the border of the surface.
    histograms: [Vec<Option<Histogram>>; RADII.len()],
}

impl DescribedCloud {
    pub(super) fn new(
        cloud: &Cloud,
        edge: f64,
        progress: &Progress<'_>,
    ) -> Result<Self, CancelledError> {
        progress.check()?;
        let cloud = cloud.sample(edge);
        let histograms = RADII.map(|radius| histograms(&cloud, radius * edge));
        Ok(Self { cloud, histograms })
    }
}

/// Finds the best motion of the first scan onto the second among the motions that `allowed` accepts. Returns `None` if no motion is found
/// or accepted. `edge` is the edge length of the sampling grid's cells, in mm.
///
/// Points are matched by the similarity of their neighborhoods at two radii. Two matches are compatible if they preserve the distance
/// between their points. Each motion is computed from matches that share many compatible matches: Chen, Sun, Yang and Tao, "SC2-PCR: a
/// second order spatial compatibility for efficient and robust point cloud registration" (2022), equation 6. The best motions are refined
/// on the surfaces. The search is deterministic.
pub(super) fn best_place(
    [from, to]: [&DescribedCloud; 2],
    edge: f64,
    allowed: &dyn Fn(&Isometry3<f64>) -> bool,
    progress: &Progress<'_>,
) -> Result<Option<Candidate>, CancelledError> {
    let alike = from.histograms.iter().zip(&to.histograms).flat_map(|(a, b)| matches(a, b));
    let mut alike: Vec<_> = alike.collect();
    alike.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    alike.truncate(MAX_MATCHES);
    let pairs = alike.into_iter().map(|(_, pair)| pair).collect::<BTreeSet<_>>();
    progress.check()?;
    let [from, to] = [&from.cloud, &to.cloud];
    let mut motions = motions(&pairs.into_iter().collect::<Vec<_>>(), from, to, edge);
    motions.retain(|(_, motion)| allowed(motion));
    motions.sort_by_key(|(agreeing, _)| Reverse(*agreeing));
    let (low, high) = from.bounds();
    let middle = nalgebra::center(&low, &high);
    let radius = 0.5 * (high - low).norm();
    let level = Level::new(&[to, from]);
    let (mut tried, mut found) = (Vec::new(), Vec::new());
    for (_, motion) in motions {
        if tried.len() == 2 * REFINED_MOTIONS {
            break;
        }
        if tried.iter().any(|other| displacement(other, &motion, &middle, radius) < 8.0 * edge) {
            continue;
        }
        let poses = vec![Isometry3::identity(), motion];
        let refined = refine(&level, poses, &[[0, 1]], STEPS, progress)?.poses[1];
        tried.extend([motion, refined]);
        if allowed(&refined) {
            found.push(Candidate { motion: refined, fit: fit([from, to], &refined) });
        }
    }
    Ok(found.into_iter().max_by(|a, b| a.fit.score().total_cmp(&b.fit.score())))
}

/// Returns an upper bound for the distance between the images of a point under two motions. The bound is valid for all points within
/// `radius` of `center`.
fn displacement(a: &Isometry3<f64>, b: &Isometry3<f64>, center: &Point3<f64>, radius: f64) -> f64 {
    (a * center - b * center).norm() + radius * a.rotation.angle_to(&b.rotation)
}

/// The distance between two histograms, and the points to which the histograms belong: one point of the first scan and one of the second.
type Match = (f32, [u32; 2]);

/// Returns the matches: pairs of points, each of which is among the points most similar to the other point of the pair.
fn matches(a: &[Option<Histogram>], b: &[Option<Histogram>]) -> Vec<Match> {
    let [to_b, to_a] = [(a, b), (b, a)].map(|(from, to)| {
        from.par_iter()
            .with_min_len(64)
            .map(|one| one.as_ref().map_or(Vec::new(), |one| most_similar(one, to)))
            .collect::<Vec<_>>()
    });
    to_b.iter()
        .enumerate()
        .flat_map(|(k, alike)| {
            alike
                .iter()
                .filter(|(_, other)| to_a[*other as usize].iter().any(|it| it.1 as usize == k))
                .map(|&(off, other)| (off, [k as u32, other]))
                .collect::<Vec<_>>()
        })
        .collect()
}

/// Returns the histograms most similar to `one`, as pairs of distance and index.
fn most_similar(one: &Histogram, others: &[Option<Histogram>]) -> Vec<(f32, u32)> {
    let mut best = Vec::with_capacity(SIMILAR + 1);
    for (k, other) in (0..).zip(others) {
        let Some(other) = other else { continue };
        let max_distance = best.get(SIMILAR - 1).map_or(f32::INFINITY, |it: &(f32, u32)| it.0);
        let distance = one.distance_sq(other, max_distance);
        if distance >= max_distance {
            continue;
        }
        let at = best.partition_point(|it: &(f32, u32)| it.0 <= distance);
        best.insert(at, (distance, k));
        best.truncate(SIMILAR);
    }
    best
}

/// Matched points of two scans with their normals.
struct Correspondences {
    /// For each match the point of the first scan and the point of the second scan.
    ends: Vec<[Point3<f64>; 2]>,
    /// For each match the normals at the matched points of the first and the second scan.
    normals: Vec<[Vector3<f64>; 2]>,
    /// The edge length of the sampling grid's cells, in mm.
    edge: f64,
}

impl Correspondences {
    fn new(pairs: &[[u32; 2]], from: &Cloud, to: &Cloud, edge: f64) -> Self {
        let pairs = pairs.iter().map(|pair| pair.map(|point| point as usize));
        Self {
            ends: pairs.clone().map(|[a, b]| [from.positions[a], to.positions[b]]).collect(),
            normals: pairs.map(|[a, b]| [from.normals[a], to.normals[b]]).collect(),
            edge,
        }
    }

    /// Returns true if the two matches are compatible: the distance between their points, and the angle between their normals, are equal in
    /// both scans within a tolerance.
    fn is_compatible(&self, i: usize, j: usize) -> bool {
        let [a, b] = [0, 1].map(|side| (self.ends[i][side] - self.ends[j][side]).norm());
        let [u, v] = [0, 1].map(|side| self.normals[i][side].dot(&self.normals[j][side]));
        a.min(b) > 2.0 * self.edge && (a - b).abs() < 1.5 * self.edge && (u - v).abs() < 0.35
    }

    /// Returns for each match the set of the matches that are compatible with this match, as a list of bits.
    fn compatible_sets(&self) -> Vec<Vec<u64>> {
        let count = self.ends.len();
        (0..count)
            .into_par_iter()
            .with_min_len(64)
            .map(|i: usize| {
                let mut set = vec![0_u64; count.div_ceil(64)];
                (0..count)
                    .filter(|&j| self.is_compatible(i, j))
                    .for_each(|j| set[j / 64] |= 1 << (j % 64));
                set
            })
            .collect()
    }

    /// Computes a motion from match `i` and some of its compatible matches: those that have the most compatible matches in common with
    /// match `i`. Also returns the number of matches that agree with the motion. Returns `None` if fewer than three matches are compatible.
    fn motion(&self, i: usize, sets: &[Vec<u64>]) -> Option<(usize, Isometry3<f64>)> {
        let mut compatible: Vec<_> = (0..self.ends.len())
            .filter(|j| sets[i][j / 64] >> (j % 64) & 1 == 1)
            .map(|j| (Reverse(count_common(&sets[i], &sets[j])), j))
            .collect();
        compatible.sort_unstable();
        if compatible.len() < 3 {
            return None;
        }
        let best = compatible.iter().take(MAX_CONSISTENT).map(|&(_, j)| j).chain([i]);
        let motion = fit_motion(&best.map(|j| self.ends[j]).collect::<Vec<_>>());
        let agreeing = self
            .ends
            .iter()
            .filter(|[a, b]| (motion * a - b).norm_squared() < 4.0 * self.edge * self.edge)
            .count();
        Some((agreeing, motion))
    }
}

/// The number of elements that two sets of bits have in common.
fn count_common(a: &[u64], b: &[u64]) -> u32 {
    a.iter().zip(b).map(|(a, b)| (a & b).count_ones()).sum()
}

/// Computes a motion for each match, from the matches that are most compatible with this match. Returns each motion with the number of
/// matches that agree with the motion.
fn motions(
    pairs: &[[u32; 2]],
    from: &Cloud,
    to: &Cloud,
    edge: f64,
) -> Vec<(usize, Isometry3<f64>)> {
    let matches = Correspondences::new(pairs, from, to, edge);
    let sets = matches.compatible_sets();
    (0..pairs.len())
        .into_par_iter()
        .with_min_len(64)
        .filter_map(|i| matches.motion(i, &sets))
        .collect()
}
