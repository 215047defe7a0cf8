//! Coarse-to-fine registration: refines start poses on finer and finer sampling grids.

use maquette_mesh::Poses;
use maquette_node::{Error, Progress, bail};
use maquette_scan::Scan;
use maquette_value::CaptureFrame;
use maquette_value::parallel::*;
use nalgebra::{Isometry3, Matrix4, Rotation3, UnitQuaternion};

use super::alignment::{Alignment, PairFit};
use super::cloud::{Cloud, bounds};
use super::features::{Candidate, DescribedCloud, best_place, sampling_edge};
use super::fit::{Fit, fit};
use super::local_origin::LocalOrigin;
use super::motion::frame_of;
use super::refine::{Level, refine};

/// The edge length of the finest sampling grid's cells, as a multiple of the distance between neighboring points.
const MIN_EDGE_RATIO: f64 = 2.0;
/// The maximum number of sample points for a scan; more points would not improve the result.
const MAX_SAMPLES: f64 = 5000.0;
/// The maximum number of refinement steps on each sampling grid.
const MAX_STEPS: usize = 40;
/// The maximum number of sampling grids.
const MAX_GRIDS: u32 = 12;
/// Minimum overlap in percent: at least this fraction of one of two scans must lie on the other scan.
const MIN_OVERLAP: f64 = 5.0;
/// The minimum fraction of the common surface on which the scans must agree, in percent.
const MIN_AGREEMENT: f64 = 60.0;

/// The start poses from which the refinement begins.
pub(super) struct Start {
    /// The start pose of each scan. The first scan does not move.
    pub(super) poses: Vec<Isometry3<f64>>,
    /// The maximum distance, at the start, between points that count as corresponding, in mm.
    pub(super) reach: f64,
    /// True if the poses were found by a search, false if the user gave them. After a search, a bad fit is an error.
    pub(super) is_guess: bool,
}

/// A predicate that accepts or rejects the motion between two scans, given by their indices.
pub(super) type MotionFilter<'a> = &'a dyn Fn([usize; 2], &Isometry3<f64>) -> bool;

impl Start {
    /// Finds start poses by comparing features of the surfaces. `candidates` are the pairs of scans that may overlap. The pairs that fit
    /// best form a spanning tree of all scans.
    ///
    /// # Errors
    /// If a scan fits none of the scans that are connected to the first one.
    pub(super) fn by_features(
        clouds: &[Cloud],
        candidates: &[[usize; 2]],
        allowed: MotionFilter<'_>,
        progress: &Progress<'_>,
    ) -> Result<Self, Error> {
        let edge = sampling_edge(clouds);
        let descriptions =
            clouds.par_iter().map(|cloud| DescribedCloud::new(cloud, edge, progress));
        let descriptions = descriptions.collect::<Result<Vec<_>, _>>()?;
        let mut found: Vec<([usize; 2], Candidate)> = Vec::new();
        for (done, &[a, b]) in candidates.iter().enumerate() {
            progress.tick(done as f64 / candidates.len() as f64)?;
            // The later scan of each pair is moved onto the earlier one.
            let both = [&descriptions[b], &descriptions[a]];
            let best = best_place(both, edge, &|motion| allowed([b, a], motion), progress)?;
            found.extend(best.map(|best| ([b, a], best)));
        }
        found.sort_by(|a, b| b.1.fit.score().total_cmp(&a.1.fit.score()));
        let mut poses = vec![None; clouds.len()];
        poses[0] = Some(Isometry3::identity());
        // Prim's algorithm: repeatedly take the best of those pairs in which exactly one scan has a pose.
        fn next(
            poses: &[Option<Isometry3<f64>>],
            found: &[([usize; 2], Candidate)],
        ) -> Option<(usize, Isometry3<f64>)> {
            let fits = found.iter().filter(|(_, found)| is_good(&found.fit));
            fits.into_iter().find_map(|&([a, b], found)| match (poses[a], poses[b]) {
                (None, Some(pose)) => Some((a, pose * found.motion)),
                (Some(pose), None) => Some((b, pose * found.motion.inverse())),
                _ => None,
            })
        }
        while let Some((scan, pose)) = next(&poses, &found) {
            poses[scan] = Some(pose);
        }
        if let Some(scan) = poses.iter().position(Option::is_none) {
            let of_it = found.iter().find(|(pair, _)| pair.contains(&scan));
            let (pair, fit) = of_it.map_or(([scan, 0], Fit::default()), |it| (it.0, it.1.fit));
            let side = usize::from(pair[1] == scan);
            return Err(no_fit([scan, pair[1 - side]], side, &fit));
        }
        Ok(Self { poses: poses.into_iter().flatten().collect(), reach: 3.0 * edge, is_guess: true })
    }

    /// Starts at the current positions or at the poses of the captures, depending on `poses`. `reach` is the maximum distance of
    /// corresponding points in mm; 0 means the default, a twentieth of the largest scan.
    ///
    /// # Errors
    /// If a required pose is missing, or `reach` is not a valid length.
    pub(super) fn from_positions(
        scans: &[&Scan],
        (clouds, origin): (&[Cloud], LocalOrigin),
        poses: Poses,
        reach: f64,
    ) -> Result<Self, Error> {
        if !(0.0..f64::INFINITY).contains(&reach) {
            bail!("`reach` is {reach}, expected a length of at least 0 mm");
        }
        let known: Vec<_> = scans.iter().map(|scan| frame_of(scan)?.world_from_camera).collect();
        let unknown = known.iter().position(Option::is_none);
        let poses = match (poses, unknown) {
            (Poses::Apply, Some(scan)) => bail!(
                "scan {} has no pose: only captures whose camera file has `world_from_camera_mm` have one, and only until they are moved",
                scan + 1
            ),
            (Poses::Ignore, _) | (Poses::Auto, Some(_)) => {
                vec![Isometry3::identity(); scans.len()]
            }
            (_, None) => {
                let poses: Vec<_> = known.into_iter().flatten().map(|pose| rigid(&pose)).collect();
                poses.iter().map(|pose| origin.localize_motion(&poses[0].inv_mul(pose))).collect()
            }
        };
        let sizes = clouds.iter().map(|cloud| {
            let (low, high) = cloud.bounds();
            (high - low).norm()
        });
        let reach = if reach > 0.0 { reach } else { sizes.fold(0.0, f64::max) / 20.0 };
        Ok(Self { poses, reach, is_guess: false })
    }
}

/// Converts a pose matrix to the nearest rigid motion.
fn rigid(pose: &Matrix4<f64>) -> Isometry3<f64> {
    let rotation = Rotation3::from_matrix(&pose.fixed_view::<3, 3>(0, 0).into());
    let shift = pose.fixed_view::<3, 1>(0, 3).into_owned();
    Isometry3::from_parts(shift.into(), UnitQuaternion::from_rotation_matrix(&rotation))
}

/// Returns the edge length of the finest useful sampling grid's cells for a scan, in mm. A finer grid would not change the result.
pub(super) fn min_sampling_edge(cloud: &Cloud) -> f64 {
    let count = cloud.positions.len() as f64 / (MIN_EDGE_RATIO * MIN_EDGE_RATIO);
    MIN_EDGE_RATIO * cloud.spacing * (count / MAX_SAMPLES).max(1.0).sqrt()
}

/// Returns true if two scans fit: they overlap and agree sufficiently.
fn is_good(fit: &Fit) -> bool {
    fit.overlap(0).max(fit.overlap(1)) >= MIN_OVERLAP && fit.agreement() >= MIN_AGREEMENT
}

fn no_fit([scan, to]: [usize; 2], side: usize, fit: &Fit) -> Error {
    let [scan, to] = [scan + 1, to + 1];
    let (share, agreement) = (fit.overlap(side), fit.agreement());
    Error::new(format!(
        "scans {scan} and {to} do not fit: at the best position found, {share:.1} % of scan {scan} is on scan {to} (at least {MIN_OVERLAP} % required), and {agreement:.0} % of the surface that both should see agrees (at least {MIN_AGREEMENT} % required); take scans with more overlap, or use `Pairs`"
    ))
}

/// Refines the start poses on finer and finer sampling grids. Calls `warn` if the result is doubtful.
///
/// # Errors
/// If a scan is not connected to the first one by overlapping scans.
pub(super) fn align_from(
    (clouds, origin): (&[Cloud], LocalOrigin),
    start: Start,
    frame: Option<&CaptureFrame>,
    warn: &dyn Fn(String),
    progress: &Progress<'_>,
) -> Result<Alignment, Error> {
    let min_edge = clouds.iter().map(min_sampling_edge).fold(f64::INFINITY, f64::min);
    fn edge(k: u32, min_edge: f64) -> f64 {
        min_edge * f64::from(1_u32 << k)
    }
    let grids =
        (1..MAX_GRIDS).find(|&k| 3.0 * edge(k, min_edge) > start.reach).unwrap_or(MAX_GRIDS);
    let mut poses = start.poses;
    let mut pairs = close_pairs(clouds, &poses, start.reach);
    let mut last = None;
    for k in (0..grids).rev() {
        progress.tick(1.0 - f64::from(k + 1) / f64::from(grids))?;
        let sampled: Vec<Cloud> = clouds
            .par_iter()
            .map(|cloud| cloud.sample(edge(k, min_edge).max(min_sampling_edge(cloud))))
            .collect();
        let level = Level::new(&sampled.iter().collect::<Vec<_>>());
        let refined = refine(&level, poses, &pairs, MAX_STEPS, progress)?;
        // Pairs that have no matching points on a coarse grid have none on a finer one, either.
        let touching =
            pairs.iter().zip(&refined.contacts).filter(|(_, contact)| contact.matches > 0);
        pairs = touching.map(|(pair, _)| *pair).collect();
        poses = refined.poses.clone();
        last = Some((level, refined));
    }
    let (level, refined) = last.expect("there is a finest grid");
    let fits = pairs
        .iter()
        .zip(&refined.contacts)
        .filter_map(|(&[a, b], contact)| {
            let both = [&level.clouds[a], &level.clouds[b]];
            let fit = fit(both, &poses[b].inv_mul(&poses[a]));
            (contact.matches > 0).then_some(([a, b], *contact, fit))
        })
        .collect::<Vec<_>>();
    // Find the scans that are connected to the first one, directly or through other scans.
    let mut connected = vec![true];
    connected.resize(clouds.len(), false);
    while let Some((pair, ..)) = fits.iter().find(|([a, b], ..)| connected[*a] != connected[*b]) {
        pair.iter().for_each(|&scan| connected[scan] = true);
    }
    if let Some(scan) = connected.iter().position(|connected| !connected) {
        bail!(
            "no part of scan {} is within {:.3} mm of a scan that is connected to the first one, with similar normals; increase `reach`, or use `Features` or `Pairs`",
            scan + 1,
            start.reach
        );
    }
    for scan in 1..clouds.len() {
        let of_it = fits.iter().filter(|([a, b], ..)| *a == scan || *b == scan);
        let best = of_it.max_by(|a, b| a.2.score().total_cmp(&b.2.score()));
        let ([a, b], _, fit) = best.expect("a connected scan touches another scan");
        if is_good(fit) {
            continue;
        }
        let (to, side) = if *a == scan { (*b, 0) } else { (*a, 1) };
        let error = no_fit([scan, to], side, fit);
        if start.is_guess {
            return Err(error);
        }
        warn(error.to_string());
    }
    if refined.free > 0 {
        warn(format!(
            "{} of {} degrees of freedom are undetermined, because the surfaces can slide along each other; they do not change",
            refined.free,
            6 * (clouds.len() - 1)
        ));
    }
    let pair_fits = fits.iter().map(|([a, b], contact, fit)| PairFit {
        scans: [*a as u32 + 1, *b as u32 + 1],
        overlap: [0, 1].map(|side| fit.overlap(side)),
        matches: contact.matches as u32,
        plane: contact.plane,
        point: contact.point,
    });
    let motions: Vec<_> =
        poses.iter().map(|pose| origin.globalize_motion(pose).to_homogeneous()).collect();
    Alignment::new(&motions, pair_fits.collect(), frame)
}

/// Returns the pairs of scans whose bounding boxes are less than `reach` apart.
fn close_pairs(clouds: &[Cloud], poses: &[Isometry3<f64>], reach: f64) -> Vec<[usize; 2]> {
    let boxes = clouds.iter().zip(poses).map(|(cloud, pose)| {
        let moved: Vec<_> = cloud.positions.iter().map(|point| pose * point).collect();
        bounds(moved.iter())
    });
    let boxes: Vec<_> = boxes.collect();
    all_pairs(clouds.len())
        .into_iter()
        .filter(|&[a, b]| {
            let ((low, high), (other_low, other_high)) = (boxes[a], boxes[b]);
            (0..3).all(|k| low[k] - reach < other_high[k] && other_low[k] - reach < high[k])
        })
        .collect()
}

/// Returns all pairs of `count` scans, in each pair the earlier scan first.
pub(super) fn all_pairs(count: usize) -> Vec<[usize; 2]> {
    (0..count).flat_map(|b| (0..b).map(move |a| [a, b])).collect()
}
