//! From where scans may lie to where they do: coarse, then fine.

use maquette_mesh::Poses;
use maquette_node::Progress;
use maquette_scan::Scan;
use maquette_value::CaptureFrame;
use maquette_value::parallel::*;
use nalgebra::{Isometry3, Matrix4, Rotation3, UnitQuaternion};

use super::align_error::{AlignError, LEAST_AGREEMENT, LEAST_SHARE};
use super::alignment::{Alignment, PairFit};
use super::cloud::{Cloud, bounds};
use super::features::{Described, Found, best_place, grid_of};
use super::fit::{Fit, fit};
use super::moved::frame_of;
use super::refine::{Level, refine};

/// The finest grid has edges so many times as long as the points' distance.
const FINEST: f64 = 2.0;
/// With so many points a scan has enough.
const ENOUGH: f64 = 5000.0;
/// Steps on each grid.
const STEPS: usize = 40;
/// More grids than this are not needed.
const GRIDS: u32 = 12;

/// From where on scans are brought together.
pub(super) struct Start {
    /// Where each is; the first one stays there.
    pub(super) poses: Vec<Isometry3<f64>>,
    /// How far what belongs together may be apart, in mm.
    pub(super) reach: f64,
    /// Whether nobody has said that they lie near to there, so that what does not fit is wrong.
    pub(super) is_guess: bool,
}

/// Which turns and moves of one scan against another may be, by their numbers.
pub(super) type Allowed<'a> = &'a dyn Fn([usize; 2], &Isometry3<f64>) -> bool;

impl Start {
    /// By what surfaces look like: `tried` are the pairs of scans that may overlap. The pairs that fit best hold all scans together.
    ///
    /// # Errors
    /// If a scan fits none that hangs together with the first.
    pub(super) fn by_features(
        clouds: &[Cloud],
        tried: &[[usize; 2]],
        allowed: Allowed<'_>,
        progress: &Progress<'_>,
    ) -> Result<Self, AlignError> {
        let edge = grid_of(clouds);
        let described = clouds.iter().map(|cloud| Described::new(cloud, edge, progress));
        let described = described.collect::<Result<Vec<_>, _>>()?;
        let mut found: Vec<([usize; 2], Found)> = Vec::new();
        for (done, &[a, b]) in tried.iter().enumerate() {
            progress.tick(done as f64 / tried.len() as f64)?;
            // The later one is moved onto the earlier one.
            let both = [&described[b], &described[a]];
            let best = best_place(both, edge, &|motion| allowed([b, a], motion), progress)?;
            found.extend(best.map(|best| ([b, a], best)));
        }
        found.sort_by(|a, b| b.1.fit.score().total_cmp(&a.1.fit.score()));
        let mut poses = vec![None; clouds.len()];
        poses[0] = Some(Isometry3::identity());
        // Prim's tree: again and again the best pair of which one scan has its place.
        fn next(
            poses: &[Option<Isometry3<f64>>],
            found: &[([usize; 2], Found)],
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

    /// From where scans lie or, with known poses, where these bring them; a `reach` of 0 is chosen.
    ///
    /// # Errors
    /// If a pose is needed and not there, or the reach is no length.
    pub(super) fn known(
        scans: &[&Scan],
        clouds: &[Cloud],
        poses: Poses,
        reach: f64,
    ) -> Result<Self, AlignError> {
        if !(0.0..f64::INFINITY).contains(&reach) {
            let must = "a length of at least 0 mm";
            return Err(AlignError::Parameter { what: "reach", value: reach, must });
        }
        let known = scans.iter().map(|scan| frame_of(scan)?.world_from_camera);
        let known = Vec::from_iter(known);
        let unknown = known.iter().position(Option::is_none);
        let poses = match (poses, unknown) {
            (Poses::Apply, Some(scan)) => return Err(AlignError::NoPose { scan: scan + 1 }),
            (Poses::Ignore, _) | (Poses::Auto, Some(_)) => {
                vec![Isometry3::identity(); scans.len()]
            }
            (_, None) => {
                let poses: Vec<_> = known.into_iter().flatten().map(|pose| rigid(&pose)).collect();
                poses.iter().map(|pose| poses[0].inv_mul(pose)).collect()
            }
        };
        let size = clouds.iter().map(|cloud| {
            let (low, high) = cloud.bounds();
            (high - low).norm()
        });
        let chosen = || size.fold(0.0, f64::max) / 20.0;
        Ok(Self { poses, reach: if reach > 0.0 { reach } else { chosen() }, is_guess: false })
    }
}

/// The rigid motion that a pose is, up to rounding.
fn rigid(pose: &Matrix4<f64>) -> Isometry3<f64> {
    let turn = Rotation3::from_matrix(&pose.fixed_view::<3, 3>(0, 0).into());
    let shift = pose.fixed_view::<3, 1>(0, 3).into_owned();
    Isometry3::from_parts(shift.into(), UnitQuaternion::from_rotation_matrix(&turn))
}

/// The edge of the finest grid by which a scan is sampled, in mm: more points make no difference.
pub(super) fn finest(cloud: &Cloud) -> f64 {
    let count = cloud.positions.len() as f64 / (FINEST * FINEST);
    FINEST * cloud.spacing * (count / ENOUGH).max(1.0).sqrt()
}

/// Whether two scans fit.
fn is_good(fit: &Fit) -> bool {
    fit.share(0).max(fit.share(1)) >= LEAST_SHARE && fit.agreement() >= LEAST_AGREEMENT
}

fn no_fit([scan, to]: [usize; 2], side: usize, fit: &Fit) -> AlignError {
    let [scan, to] = [scan + 1, to + 1];
    AlignError::NoFit { scan, to, share: fit.share(side), agreement: fit.agreement() }
}

/// Brings scans together that are right up to some reach, on finer and finer grids. Doubts are told to `doubt`.
///
/// # Errors
/// If a scan does not hang together with the first one.
pub(super) fn together(
    clouds: &[Cloud],
    start: Start,
    frame: Option<&CaptureFrame>,
    doubt: &dyn Fn(String),
    progress: &Progress<'_>,
) -> Result<Alignment, AlignError> {
    let least = clouds.iter().map(finest).fold(f64::INFINITY, f64::min);
    fn edge(k: u32, least: f64) -> f64 {
        least * f64::from(1_u32 << k)
    }
    let grids = (1..GRIDS).find(|&k| 3.0 * edge(k, least) > start.reach).unwrap_or(GRIDS);
    let mut poses = start.poses;
    let mut pairs = near(clouds, &poses, start.reach);
    let mut last = None;
    for k in (0..grids).rev() {
        progress.tick(1.0 - f64::from(k + 1) / f64::from(grids))?;
        let sampled: Vec<Cloud> = clouds
            .par_iter()
            .map(|cloud| cloud.sampled(edge(k, least).max(finest(cloud))))
            .collect();
        let level = Level::of(&Vec::from_iter(&sampled));
        let refined = refine(&level, poses, &pairs, STEPS, progress)?;
        // What has nothing in common on a coarse grid has nothing on a finer one.
        let felt = pairs.iter().zip(&refined.contacts).filter(|(_, contact)| contact.matches > 0);
        pairs = felt.map(|(pair, _)| *pair).collect();
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
    // What hangs together with the first scan, by whatever lies between.
    let mut held = vec![true];
    held.resize(clouds.len(), false);
    while let Some((pair, ..)) = fits.iter().find(|([a, b], ..)| held[*a] != held[*b]) {
        pair.iter().for_each(|&scan| held[scan] = true);
    }
    if let Some(scan) = held.iter().position(|held| !held) {
        return Err(AlignError::Apart { scan: scan + 1, reach: start.reach });
    }
    for scan in 1..clouds.len() {
        let of_it = fits.iter().filter(|([a, b], ..)| *a == scan || *b == scan);
        let best = of_it.max_by(|a, b| a.2.score().total_cmp(&b.2.score()));
        let ([a, b], _, fit) = best.expect("what is held touches another scan");
        if is_good(fit) {
            continue;
        }
        let (to, side) = if *a == scan { (*b, 0) } else { (*a, 1) };
        let error = no_fit([scan, to], side, fit);
        if start.is_guess {
            return Err(error);
        }
        doubt(error.to_string());
    }
    if refined.free > 0 {
        doubt(format!(
            "in {} of {} ways nothing holds the scans, since their surfaces slide along each other: there they stay as they are",
            refined.free,
            6 * (clouds.len() - 1)
        ));
    }
    let told = fits.iter().map(|([a, b], contact, fit)| PairFit {
        scans: [*a as u32 + 1, *b as u32 + 1],
        overlap: [0, 1].map(|side| fit.share(side)),
        matches: contact.matches as u32,
        plane: contact.plane,
        point: contact.point,
    });
    let motions: Vec<_> = poses.iter().map(Isometry3::to_homogeneous).collect();
    Ok(Alignment::new(&motions, told.collect(), frame)?)
}

/// The pairs of scans of which the boxes are nearer to each other than `reach`.
fn near(clouds: &[Cloud], poses: &[Isometry3<f64>], reach: f64) -> Vec<[usize; 2]> {
    let boxes = clouds.iter().zip(poses).map(|(cloud, pose)| {
        let placed: Vec<_> = cloud.positions.iter().map(|point| pose * point).collect();
        bounds(placed.iter())
    });
    let boxes = Vec::from_iter(boxes);
    all_pairs(clouds.len())
        .into_iter()
        .filter(|&[a, b]| {
            let ((low, high), (other_low, other_high)) = (boxes[a], boxes[b]);
            (0..3).all(|k| low[k] - reach < other_high[k] && other_low[k] - reach < high[k])
        })
        .collect()
}

/// All pairs of so many scans, the earlier one first.
pub(super) fn all_pairs(count: usize) -> Vec<[usize; 2]> {
    (0..count).flat_map(|b| (0..b).map(move |a| [a, b])).collect()
}
