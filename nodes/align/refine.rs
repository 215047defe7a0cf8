//! Refines the poses of roughly aligned scans, all of them simultaneously.
//!
//! The equations of all overlapping pairs are solved as one system. Scans are sampled by grids, from coarse to fine; this averages noise
//! and gives both scans of a pair equal density. The algorithm is deterministic.

use maquette_node::{CancelledError, Progress};
use maquette_value::parallel::*;
use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix6, Point3, SymmetricEigen, Translation3, UnitQuaternion,
    Vector3, Vector6,
};

use super::cloud::Cloud;

/// All scans, each sampled by a grid, and their common length scale.
pub(super) struct Level {
    pub(super) clouds: Vec<Cloud>,
    /// Half of the diagonal of the largest scan's bounding box, in mm. Multiplied by this length, rotations are comparable to translations.
    radius: f64,
}

impl Level {
    pub(super) fn new(clouds: &[&Cloud]) -> Self {
        let radius = clouds
            .iter()
            .map(|cloud| {
                let (low, high) = cloud.bounds();
                0.5 * (high - low).norm()
            })
            .fold(0.0, f64::max);
        Self { clouds: clouds.iter().map(|&cloud| cloud.clone()).collect(), radius }
    }

    /// Returns the edge length of the cells of the coarser of two scans' sampling grids, in mm.
    fn edge(&self, [a, b]: [usize; 2]) -> f64 {
        self.clouds[a].spacing.max(self.clouds[b].spacing)
    }
}

/// The refined poses of all scans, and the quality of their fit.
pub(super) struct Refinement {
    pub(super) poses: Vec<Isometry3<f64>>,
    /// The contact of each pair of scans.
    pub(super) contacts: Vec<Contact>,
    /// The number of degrees of freedom, of all scans together, that the matches do not determine.
    pub(super) free: usize,
}

/// The contact of two scans: the number of their matches, and the distances of the matched points.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Contact {
    /// The number of points of either scan that have a corresponding point on the other scan.
    pub(super) matches: usize,
    /// The root mean square distance of the corresponding points from the other scan's tangent planes, in mm.
    pub(super) plane: f64,
    /// The root mean square distance between corresponding points, in mm.
    pub(super) point: f64,
}

/// The maximum distance between corresponding points, in multiples of the sampling grid's edge.
const REACH: f64 = 3.0;
/// The minimum cosine of the angle between the normals of corresponding points.
const MIN_NORMAL_COSINE: f64 = 0.6;
/// A match is an outlier if the distance between its points is more than this many standard deviations.
const OUTLIER_DEVIATIONS: f64 = 3.0;
/// A degree of freedom is undetermined if its eigenvalue per match is at most this. The eigenvalue per match is the mean squared change of
/// the distances relative to the squared motion.
const MIN_EIGENVALUE: f64 = 1e-3;

/// Moves all scans except the first until their points lie on the surfaces of the other scans, in at most `steps` steps. `pairs` are the
/// pairs of overlapping scans.
///
/// For each point of a pair of scans, the nearest point of the other scan is found. The residual is their distance along the mean of both
/// normals: Rusinkiewicz, "A symmetric objective function for ICP" (2019), equation 9; with only one of the normals this is Chen and
/// Medioni, "Object modelling by registration of multiple range images" (1992). A point is skipped if its nearest point is at the border of
/// a scan or has a different normal (Turk and Levoy, "Zippered polygon meshes from range images", 1994), or if its distance is an outlier
/// relative to the median, as in Chetverikov, Svirko, Stepanov and Krsek, "The trimmed iterative closest point algorithm" (2002). The
/// motions of all scans are unknowns of one system of equations, so errors do not accumulate from scan to scan: Krishnan, Lee, Moore and
/// Venkatasubramanian, "Global registration of multiple 3D point sets via optimization-on-a-manifold" (2005). Degrees of freedom that the
/// matches do not determine are left out: Gelfand, Ikemoto, Rusinkiewicz and Levoy, "Geometrically stable sampling for the ICP algorithm"
/// (2003), section 3.
pub(super) fn refine(
    level: &Level,
    mut poses: Vec<Isometry3<f64>>,
    pairs: &[[usize; 2]],
    steps: usize,
    progress: &Progress<'_>,
) -> Result<Refinement, CancelledError> {
    let center = level.center(&poses);
    let mut reaches: Vec<_> = pairs.iter().map(|&pair| REACH * level.edge(pair)).collect();
    let least = pairs.iter().map(|&pair| level.edge(pair)).fold(f64::INFINITY, f64::min);
    let mut left = steps;
    loop {
        progress.check()?;
        let systems: Vec<_> = pairs
            .iter()
            .zip(&reaches)
            .map(|(&pair, &reach)| System::new(level, &poses, pair, reach))
            .collect();
        let (moves, free) = solve(&systems, pairs, poses.len(), center, level.radius);
        if left == 0 {
            let contacts = systems.iter().map(|system| system.contact).collect();
            return Ok(Refinement { poses, contacts, free });
        }
        let mut farthest: f64 = 0.0;
        for (pose, motion) in poses.iter_mut().zip(&moves) {
            let [turn, shift] = [0, 3].map(|k| motion.fixed_rows::<3>(k).into_owned());
            farthest = farthest.max(turn.norm() + shift.norm());
            let turn = UnitQuaternion::from_scaled_axis(turn / level.radius);
            let turn = Isometry3::rotation_wrt_point(turn, center);
            *pose = Translation3::from(shift) * turn * *pose;
        }
        // The search distance decreases as the scans approach each other.
        for ((reach, system), &pair) in reaches.iter_mut().zip(&systems).zip(pairs) {
            *reach = reach.min(2.0 * level.edge(pair) + 3.0 * system.contact.plane);
        }
        left = if farthest < 1e-3 * least { 0 } else { left - 1 };
    }
}

/// A point of one scan and the corresponding point of another scan.
#[derive(Clone, Copy)]
struct Match {
    /// The midpoint between the two matched points.
    middle: Point3<f64>,
    /// The mean of the normals at the two matched points.
    normal: Vector3<f64>,
    /// The vector from the matched point of the second scan to the matched point of the first scan.
    off: Vector3<f64>,
}

/// The normal equations of one pair of scans. The unknowns are the motion of the first scan relative to the second: a rotation about
/// `center`, in units of `radius`, and a translation.
struct System {
    matrix: Matrix6<f64>,
    right: Vector6<f64>,
    center: Point3<f64>,
    radius: f64,
    contact: Contact,
}

impl System {
    fn new(level: &Level, poses: &[Isometry3<f64>], [a, b]: [usize; 2], reach: f64) -> Self {
        let mut matches = level.matches(poses, [a, b], reach);
        for found in level.matches(poses, [b, a], reach) {
            matches.push(Match { off: -found.off, ..found });
        }
        fn height(it: &Match) -> f64 {
            it.off.dot(&it.normal)
        }
        let mut heights: Vec<_> = matches.iter().map(|it| height(it).abs()).collect();
        let middle = heights.len() / 2;
        if !heights.is_empty() {
            heights.select_nth_unstable_by(middle, f64::total_cmp);
            // The median absolute value of normally distributed numbers is 0.6745 standard deviations.
            let max_height =
                OUTLIER_DEVIATIONS * heights[middle] / 0.6745 + 1e-6 * level.edge([a, b]);
            matches.retain(|it| height(it).abs() <= max_height);
        }
        let count = matches.len().max(1) as f64;
        fn mean(f: &dyn Fn(&Match) -> f64, matches: &[Match], count: f64) -> f64 {
            matches.iter().map(f).sum::<f64>() / count
        }
        let center = matches.iter().map(|it| it.middle.coords / count).sum::<Vector3<f64>>();
        let center = Point3::from(center);
        let radius = mean(&|it| (it.middle - center).norm_squared(), &matches, count)
            .sqrt()
            .max(level.edge([a, b]));
        let contact = Contact {
            matches: matches.len(),
            plane: mean(&|it| height(it) * height(it), &matches, count).sqrt(),
            point: mean(&|it| it.off.norm_squared(), &matches, count).sqrt(),
        };
        let (mut matrix, mut right) = (Matrix6::zeros(), Vector6::zeros());
        for it in &matches {
            let turn = (it.middle - center).cross(&it.normal) / radius;
            let row = Vector6::new(turn.x, turn.y, turn.z, it.normal.x, it.normal.y, it.normal.z);
            matrix += row * row.transpose();
            right -= row * height(it);
        }
        // Remove the directions that the matches do not determine.
        let eigen = SymmetricEigen::new(matrix);
        let (mut determined, mut right_side) = (Matrix6::zeros(), Vector6::zeros());
        for k in (0..6).filter(|k| eigen.eigenvalues[*k] > MIN_EIGENVALUE * count) {
            let way = eigen.eigenvectors.column(k);
            determined += way * way.transpose() * eigen.eigenvalues[k];
            right_side += way * way.dot(&right);
        }
        Self { matrix: determined, right: right_side, center, radius, contact }
    }

    /// Converts the matrix and the right side of the system to unknown rotations about another center, in units of another radius.
    fn change_center(&self, center: Point3<f64>, radius: f64) -> (Matrix6<f64>, Vector6<f64>) {
        let mut map = Matrix6::identity();
        map.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(self.radius / radius);
        let moved = -(self.center - center).cross_matrix() / radius;
        map.fixed_view_mut::<3, 3>(3, 0).copy_from(&moved);
        (map.transpose() * self.matrix * map, map.transpose() * self.right)
    }
}

impl Level {
    /// The mean of the centers of all scans after the scans are moved by `poses`.
    fn center(&self, poses: &[Isometry3<f64>]) -> Point3<f64> {
        self.clouds
            .iter()
            .zip(poses)
            .map(|(cloud, pose): (&Cloud, &Isometry3<f64>)| {
                let (low, high) = cloud.bounds();
                (pose * nalgebra::center(&low, &high)).coords / poses.len() as f64
            })
            .sum::<Vector3<f64>>()
            .into()
    }

    /// Finds for each point of the first scan the nearest point of the second scan. Returns those pairs of points that count as
    /// corresponding.
    fn matches(&self, poses: &[Isometry3<f64>], [a, b]: [usize; 2], reach: f64) -> Vec<Match> {
        let (from, to) = (&self.clouds[a], &self.clouds[b]);
        let motion = poses[b].inv_mul(&poses[a]);
        (0..from.positions.len())
            .into_par_iter()
            .with_min_len(512)
            .filter_map(|k: usize| {
                let (at, normal) = (motion * from.positions[k], motion * from.normals[k]);
                let (near, _) = to.tree.nearest(&at, reach)?;
                let (point, other) = (to.positions[near], to.normals[near]);
                (!to.rim[near] && normal.dot(&other) > MIN_NORMAL_COSINE).then(|| Match {
                    middle: poses[b] * nalgebra::center(&at, &point),
                    normal: poses[b] * (0.5 * (normal + other)),
                    off: poses[b] * (at - point),
                })
            })
            .collect()
    }
}

/// Solves for the motion of each scan: a rotation about `center`, in units of `radius`, and a translation. Also returns the number of
/// degrees of freedom that the matches do not determine.
fn solve(
    systems: &[System],
    pairs: &[[usize; 2]],
    count: usize,
    center: Point3<f64>,
    radius: f64,
) -> (Vec<Vector6<f64>>, usize) {
    // The system has no unknowns for the first scan, because it does not move.
    fn offset(scan: usize) -> Option<usize> {
        Some(6 * scan.checked_sub(1)?)
    }
    let size = 6 * (count - 1);
    let (mut matrix, mut right) = (DMatrix::zeros(size, size), DVector::zeros(size));
    for (system, pair) in systems.iter().zip(pairs) {
        let (part, right_side) = system.change_center(center, radius);
        let signed = [(pair[0], 1.0), (pair[1], -1.0)];
        let signed = signed.map(|(scan, sign)| offset(scan).map(|at| (at, sign)));
        for (row, sign) in signed.into_iter().flatten() {
            let mut rows = right.rows_mut(row, 6);
            rows += right_side * sign;
            for (column, other) in signed.into_iter().flatten() {
                let mut block = matrix.view_mut((row, column), (6, 6));
                block += part * (sign * other);
            }
        }
    }
    let eigen = SymmetricEigen::new(matrix);
    let least = 1e-9 * eigen.eigenvalues.amax();
    let mut all = DVector::zeros(size);
    let mut free = 0;
    for (value, way) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if *value > least {
            all += way * (way.dot(&right) / value);
        } else {
            free += 1;
        }
    }
    (
        (0..count)
            .map(|scan| offset(scan).map_or(Vector6::zeros(), |at| all.fixed_rows::<6>(at).into()))
            .collect(),
        free,
    )
}
