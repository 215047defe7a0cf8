//! Brings scans that lie almost right together, all of them at once.
//!
//! Each pair that overlaps adds its equations to one system, for two scans as for many. Scans are sampled by grids, from coarse to fine, so
//! that noise is averaged and both sides are sampled alike. Nothing is random.

use maquette_node::{Cancelled, Progress};
use maquette_value::parallel::*;
use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix6, Point3, SymmetricEigen, Translation3, UnitQuaternion,
    Vector3, Vector6,
};

use super::cloud::Cloud;

/// Scans that are sampled by grids.
pub(super) struct Level {
    pub(super) clouds: Vec<Cloud>,
    /// Half of the largest scan, in mm: what a turn moves at most.
    radius: f64,
}

impl Level {
    pub(super) fn of(clouds: &[&Cloud]) -> Self {
        let radius = clouds
            .iter()
            .map(|cloud| {
                let (low, high) = cloud.bounds();
                0.5 * (high - low).norm()
            })
            .fold(0.0, f64::max);
        Self { clouds: clouds.iter().map(|&cloud| cloud.clone()).collect(), radius }
    }

    /// The edge of the coarser grid of two scans, in mm.
    fn edge(&self, [a, b]: [usize; 2]) -> f64 {
        self.clouds[a].spacing.max(self.clouds[b].spacing)
    }
}

/// Scans that were brought together.
pub(super) struct Refined {
    pub(super) poses: Vec<Isometry3<f64>>,
    /// What two scans have in common, for each pair.
    pub(super) contacts: Vec<Contact>,
    /// In how many ways all scans may move without anything being felt.
    pub(super) free: usize,
}

/// What two scans have in common.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Contact {
    /// Points of either that belong to points of the other.
    pub(super) matches: usize,
    /// How far those are off the other's planes, in mm: root mean square.
    pub(super) plane: f64,
    /// How far they are from the other's points, in mm: root mean square.
    pub(super) point: f64,
}

/// Points of a scan belong to others up to so many edges of the grid away.
const REACH: f64 = 3.0;
/// The cosine of the angle that their normals may make.
const ALIGNED: f64 = 0.6;
/// Points that are so many standard deviations off are left out.
const TRIMMED: f64 = 3.0;
/// A motion that changes the distance of what it moves by less than this part, squared, is not felt.
const FELT: f64 = 1e-3;

/// Moves all scans but the first until points lie on the others' surfaces, for at most so many steps; `pairs` says which overlap.
///
/// The nearest point of each is found both ways, and what counts is its distance along the mean of both normals: Rusinkiewicz, "A
/// symmetric objective function for ICP" (2019), equation 9, which has Chen and Medioni, "Object modelling by registration of multiple
/// range images" (1992), as the case in which one normal counts. Left out are points whose nearest one is at a rim or looks elsewhere
/// (Turk and Levoy, "Zippered polygon meshes from range images", 1994), and those that are far off beside the others, by the median as in
/// Chetverikov, Svirko, Stepanov and Krsek, "The trimmed iterative closest point algorithm" (2002). All scans move in one system of equations,
/// so that no error is handed from scan to scan: Krishnan, Lee, Moore and Venkatasubramanian, "Global registration of multiple 3D point sets
/// via optimization-on-a-manifold" (2005). Motions that nothing holds are not made: Gelfand, Ikemoto, Rusinkiewicz and Levoy, "Geometrically
/// stable sampling for the ICP algorithm" (2003), section 3.
pub(super) fn refine(
    level: &Level,
    mut poses: Vec<Isometry3<f64>>,
    pairs: &[[usize; 2]],
    steps: usize,
    progress: &Progress<'_>,
) -> Result<Refined, Cancelled> {
    let center = level.center(&poses);
    let mut reaches: Vec<_> = pairs.iter().map(|&pair| REACH * level.edge(pair)).collect();
    let least = pairs.iter().map(|&pair| level.edge(pair)).fold(f64::INFINITY, f64::min);
    let mut left = steps;
    loop {
        progress.check()?;
        let systems = pairs.iter().zip(&reaches);
        let systems = systems.map(|(&pair, &reach)| System::new(level, &poses, pair, reach));
        let systems = Vec::from_iter(systems);
        let (moves, free) = solve(&systems, pairs, poses.len(), center, level.radius);
        if left == 0 {
            let contacts = systems.iter().map(|system| system.contact).collect();
            return Ok(Refined { poses, contacts, free });
        }
        let mut farthest: f64 = 0.0;
        for (pose, motion) in poses.iter_mut().zip(&moves) {
            let [turn, shift] = [0, 3].map(|k| motion.fixed_rows::<3>(k).into_owned());
            farthest = farthest.max(turn.norm() + shift.norm());
            let turn = UnitQuaternion::from_scaled_axis(turn / level.radius);
            let turn = Isometry3::rotation_wrt_point(turn, center);
            *pose = Translation3::from(shift) * turn * *pose;
        }
        // The nearer the scans come, the less may be far off.
        for ((reach, system), &pair) in reaches.iter_mut().zip(&systems).zip(pairs) {
            *reach = reach.min(2.0 * level.edge(pair) + 3.0 * system.contact.plane);
        }
        left = if farthest < 1e-3 * least { 0 } else { left - 1 };
    }
}

/// Two points that belong together.
#[derive(Clone, Copy)]
struct Match {
    /// Between them.
    middle: Point3<f64>,
    /// The mean of both normals.
    normal: Vector3<f64>,
    /// From the point of the second scan to that of the first.
    off: Vector3<f64>,
}

/// What two scans ask of the motion of the first one against the second: turned by `x` about `center`, in units of `radius`, and moved.
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
            // The median of normal numbers is 0.6745 standard deviations.
            let most = TRIMMED * heights[middle] / 0.6745 + 1e-6 * level.edge([a, b]);
            matches.retain(|it| height(it).abs() <= most);
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
        // What is not felt is not asked for.
        let eigen = SymmetricEigen::new(matrix);
        let (mut held, mut asked) = (Matrix6::zeros(), Vector6::zeros());
        for k in (0..6).filter(|k| eigen.eigenvalues[*k] > FELT * count) {
            let way = eigen.eigenvectors.column(k);
            held += way * way.transpose() * eigen.eigenvalues[k];
            asked += way * way.dot(&right);
        }
        Self { matrix: held, right: asked, center, radius, contact }
    }

    /// Its matrix and right side for a turn about another center, in units of another radius.
    fn about(&self, center: Point3<f64>, radius: f64) -> (Matrix6<f64>, Vector6<f64>) {
        let mut map = Matrix6::identity();
        map.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(self.radius / radius);
        let moved = -(self.center - center).cross_matrix() / radius;
        map.fixed_view_mut::<3, 3>(3, 0).copy_from(&moved);
        (map.transpose() * self.matrix * map, map.transpose() * self.right)
    }
}

impl Level {
    /// The middle of all scans.
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

    /// The nearest point of the second scan to each of the first, where they belong together.
    fn matches(&self, poses: &[Isometry3<f64>], [a, b]: [usize; 2], reach: f64) -> Vec<Match> {
        let (from, to) = (&self.clouds[a], &self.clouds[b]);
        let motion = poses[b].inv_mul(&poses[a]);
        (0..from.positions.len())
            .into_par_iter()
            .with_min_len(512)
            .filter_map(|k: usize| {
                let (at, normal) = (motion * from.positions[k], motion * from.normals[k]);
                let (near, _) = to.tree.nearest(&at, reach)?;
                let (place, other) = (to.positions[near], to.normals[near]);
                (!to.rim[near] && normal.dot(&other) > ALIGNED).then(|| Match {
                    middle: poses[b] * nalgebra::center(&at, &place),
                    normal: poses[b] * (0.5 * (normal + other)),
                    off: poses[b] * (at - place),
                })
            })
            .collect()
    }
}

/// How each scan moves, turned about `center` in units of `radius`, and in how many ways nothing holds them.
fn solve(
    systems: &[System],
    pairs: &[[usize; 2]],
    count: usize,
    center: Point3<f64>,
    radius: f64,
) -> (Vec<Vector6<f64>>, usize) {
    // The first scan has no numbers among those that are sought.
    fn place(scan: usize) -> Option<usize> {
        Some(6 * scan.checked_sub(1)?)
    }
    let size = 6 * (count - 1);
    let (mut matrix, mut right) = (DMatrix::zeros(size, size), DVector::zeros(size));
    for (system, pair) in systems.iter().zip(pairs) {
        let (part, asked) = system.about(center, radius);
        let signed = [(pair[0], 1.0), (pair[1], -1.0)];
        let signed = signed.map(|(scan, sign)| place(scan).map(|at| (at, sign)));
        for (row, sign) in signed.into_iter().flatten() {
            let mut rows = right.rows_mut(row, 6);
            rows += asked * sign;
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
            .map(|scan| place(scan).map_or(Vector6::zeros(), |at| all.fixed_rows::<6>(at).into()))
            .collect(),
        free,
    )
}
