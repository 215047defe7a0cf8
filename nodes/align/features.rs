//! Where scans may fit without any hint: by what their surfaces look like.

use std::cmp::Reverse;
use std::collections::BTreeSet;

use histograms::{Histogram, histograms};
use maquette_node::{Cancelled, Progress};
use maquette_value::parallel::*;
use nalgebra::{Isometry3, Point3};

use super::cloud::Cloud;
use super::fit::{Fit, fit};
use super::pairs::motion_of;
use super::refine::{Level, refine};

mod histograms;

/// So many points does the larger of two scans have while they are matched.
const SAMPLES: f64 = 1200.0;
/// Radii of what is described around a point, in edges of the grid.
const RADII: [f64; 2] = [4.0, 7.0];
/// So many of the other scan's points may look most like one.
const ALIKE: usize = 3;
/// At most so many matches are weighed against each other.
const MATCHES: usize = 1200;
/// So many matches that agree with one another make a motion.
const AGREEING: usize = 20;
/// So many motions are tried on the surfaces,
const TRIED: usize = 4;
/// with so many steps.
const STEPS: usize = 12;

/// A place where a scan may fit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    pub(super) motion: Isometry3<f64>,
    pub(super) fit: Fit,
}

/// The edge of the grid by which scans are matched, in mm.
pub(super) fn grid_of(clouds: &[Cloud]) -> f64 {
    clouds
        .iter()
        .map(|cloud| {
            let (low, high) = cloud.bounds();
            let first = (high - low).norm() / 40.0;
            let count = cloud.sampled(first).positions.len() as f64;
            (first * (count / SAMPLES).sqrt()).max(2.0 * cloud.spacing)
        })
        .fold(0.0, f64::max)
}

/// A scan with what its surface looks like.
pub(super) struct Described {
    cloud: Cloud,
    /// Of each point, at each radius.
    histograms: [Vec<Option<Histogram>>; RADII.len()],
}

impl Described {
    pub(super) fn new(
        cloud: &Cloud,
        edge: f64,
        progress: &Progress<'_>,
    ) -> Result<Self, Cancelled> {
        progress.check()?;
        let cloud = cloud.sampled(edge);
        let histograms = RADII.map(|radius| histograms(&cloud, radius * edge));
        Ok(Self { cloud, histograms })
    }
}

/// The best place of the first scan on the second, if there is one; `edge` is that of the grid, and only motions that `allowed` has count.
///
/// Points are matched by how alike their surroundings are, at two radii. Motions come from matches that keep the distances between each
/// other, as do most of those that agree with them: Chen, Sun, Yang and Tao, "SC2-PCR: a second order spatial compatibility for efficient
/// and robust point cloud registration" (2022), equation 6. The best of them are tried on the surfaces. Nothing is drawn by lot.
pub(super) fn best_place(
    [from, to]: [&Described; 2],
    edge: f64,
    allowed: &dyn Fn(&Isometry3<f64>) -> bool,
    progress: &Progress<'_>,
) -> Result<Option<Found>, Cancelled> {
    let alike = from.histograms.iter().zip(&to.histograms).flat_map(|(a, b)| matches(a, b));
    let mut alike = Vec::from_iter(alike);
    alike.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    alike.truncate(MATCHES);
    let pairs = BTreeSet::from_iter(alike.into_iter().map(|(_, pair)| pair));
    progress.check()?;
    let [from, to] = [&from.cloud, &to.cloud];
    let mut motions = motions(&Vec::from_iter(pairs), from, to, edge);
    motions.retain(|(_, motion)| allowed(motion));
    motions.sort_by_key(|(agreeing, _)| Reverse(*agreeing));
    let (low, high) = from.bounds();
    let middle = nalgebra::center(&low, &high);
    let same = |a: &Isometry3<f64>, b: &Isometry3<f64>| {
        let turned = 0.5 * (high - low).norm() * a.rotation.angle_to(&b.rotation);
        (a * middle - b * middle).norm() + turned < 8.0 * edge
    };
    let level = Level::of(&[to, from]);
    let (mut tried, mut found) = (Vec::new(), Vec::new());
    for (_, motion) in motions {
        if tried.len() == 2 * TRIED {
            break;
        }
        if tried.iter().any(|other| same(other, &motion)) {
            continue;
        }
        let poses = vec![Isometry3::identity(), motion];
        let refined = refine(&level, poses, &[[0, 1]], STEPS, progress)?.poses[1];
        tried.extend([motion, refined]);
        if allowed(&refined) {
            found.push(Found { motion: refined, fit: fit([from, to], &refined) });
        }
    }
    Ok(found.into_iter().max_by(|a, b| a.fit.score().total_cmp(&b.fit.score())))
}

/// A match of a point of the first scan with one of the second, and how far their histograms are apart.
type Match = (f32, [u32; 2]);

/// Pairs of which each is among those most like the other.
fn matches(a: &[Option<Histogram>], b: &[Option<Histogram>]) -> Vec<Match> {
    let [to_b, to_a] = [(a, b), (b, a)].map(|(from, to)| {
        from.par_iter()
            .with_min_len(64)
            .map(|one| one.as_ref().map_or(Vec::new(), |one| alike(one, to)))
            .collect::<Vec<_>>()
    });
    to_b.iter()
        .enumerate()
        .flat_map(|(k, alike)| {
            let back = |&&(_, other): &&(f32, u32)| {
                to_a[other as usize].iter().any(|it| it.1 as usize == k)
            };
            alike
                .iter()
                .filter(back)
                .map(|&(off, other)| (off, [k as u32, other]))
                .collect::<Vec<_>>()
        })
        .collect()
}

/// Those histograms that are most like one.
fn alike(one: &Histogram, others: &[Option<Histogram>]) -> Vec<(f32, u32)> {
    let mut best = Vec::with_capacity(ALIKE + 1);
    for (k, other) in (0..).zip(others) {
        let Some(other) = other else { continue };
        let most = best.get(ALIKE - 1).map_or(f32::INFINITY, |it: &(f32, u32)| it.0);
        let off = one.off(other, most);
        if off >= most {
            continue;
        }
        let at = best.partition_point(|it: &(f32, u32)| it.0 <= off);
        best.insert(at, (off, k));
        best.truncate(ALIKE);
    }
    best
}

/// A motion for each match, by those that agree with it most, and how many matches agree with the motion.
fn motions(
    pairs: &[[u32; 2]],
    from: &Cloud,
    to: &Cloud,
    edge: f64,
) -> Vec<(usize, Isometry3<f64>)> {
    fn ends(
        [a, b]: [u32; 2],
        from_positions: &[Point3<f64>],
        to_positions: &[Point3<f64>],
    ) -> [Point3<f64>; 2] {
        [from_positions[a as usize], to_positions[b as usize]]
    }
    let ends: Vec<_> =
        pairs.iter().map(|&pair| ends(pair, &from.positions, &to.positions)).collect();
    fn normals(
        [a, b]: [u32; 2],
        from_normals: &[nalgebra::Vector3<f64>],
        to_normals: &[nalgebra::Vector3<f64>],
    ) -> [nalgebra::Vector3<f64>; 2] {
        [from_normals[a as usize], to_normals[b as usize]]
    }
    let normals: Vec<_> =
        pairs.iter().map(|&pair| normals(pair, &from.normals, &to.normals)).collect();
    // Whether two matches keep the distance between each other, and the angle of their normals.
    fn keeps(
        i: usize,
        j: usize,
        ends: &[[Point3<f64>; 2]],
        normals: &[[nalgebra::Vector3<f64>; 2]],
        edge: f64,
    ) -> bool {
        let [a, b] = [0, 1].map(|side| (ends[i][side] - ends[j][side]).norm());
        let [u, v] = [0, 1].map(|side| normals[i][side].dot(&normals[j][side]));
        a.min(b) > 2.0 * edge && (a - b).abs() < 1.5 * edge && (u - v).abs() < 0.35
    }
    let words = pairs.len().div_ceil(64);
    let rows: Vec<Vec<u64>> = (0..pairs.len())
        .into_par_iter()
        .with_min_len(64)
        .map(|i: usize| {
            let mut row = vec![0_u64; words];
            (0..pairs.len())
                .filter(|&j| keeps(i, j, &ends, &normals, edge))
                .for_each(|j| row[j / 64] |= 1 << (j % 64));
            row
        })
        .collect();
    let motion = |i: usize| {
        let common =
            |j: usize| rows[i].iter().zip(&rows[j]).map(|(a, b)| (a & b).count_ones()).sum::<u32>();
        let agreeing = (0..pairs.len()).filter(|j| rows[i][j / 64] >> (j % 64) & 1 == 1);
        let mut agreeing: Vec<_> = agreeing.map(|j| (Reverse(common(j)), j)).collect();
        agreeing.sort_unstable();
        if agreeing.len() < 3 {
            return None;
        }
        let best = agreeing.iter().take(AGREEING).map(|&(_, j)| j).chain([i]);
        let motion = motion_of(&best.map(|j| ends[j]).collect::<Vec<_>>());
        Some((
            ends.iter()
                .filter(|[a, b]| (motion * a - b).norm_squared() < 4.0 * edge * edge)
                .count(),
            motion,
        ))
    };
    (0..pairs.len()).into_par_iter().with_min_len(64).filter_map(motion).collect()
}
