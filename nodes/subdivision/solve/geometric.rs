//! The geometric algorithm: each control point moves by the offset between its point and the curve or surface.
//!
//! ```text
//! Q_i = the foot point of S_i on the curve or surface with control points P        d_i = S_i - Q_i        P_i += d_i
//! ```
//!
//! The iteration starts with `P = S` (the given points) and ends when the distances are small enough: Maekawa, Matsumoto and Namiki,
//! "Interpolation by geometric algorithm", Computer-Aided Design 39 (2007). If the foot point is the limit of the vertex's own control
//! point, this is the progressive interpolation of Cheng et al., "Loop subdivision surface based progressive interpolation", Journal of
//! Computer Science and Technology 24 (2009).

use maquette_base::linear::residuals::Residuals;
use maquette_node::{CancelledError, Progress};
use nalgebra::{Point3, Vector3};

use super::extent::{absolute_tolerance, stray};
use super::interpolation::{Direction, Interpolation};
use super::record::{Record, STALL_ITERATIONS};
use super::solution::{End, Outcome, Solution};

/// A foot point: the point of a curve or surface with which a given point is compared, and the perpendicular directions at the foot point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FootPoint {
    pub(crate) point: Point3<f64>,
    pub(crate) perpendicular: Perpendicular,
}

/// The directions that are perpendicular to a curve or surface at a point.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Perpendicular {
    /// All directions perpendicular to the given unit tangent of a curve.
    To(Vector3<f64>),
    /// The direction of the given unit normal of a surface.
    Along(Vector3<f64>),
    /// No direction is perpendicular: at an end, a border or a crease.
    Nowhere,
}

impl FootPoint {
    /// Returns the foot point for a curve or surface with overflowed coordinates: at infinity.
    pub(crate) fn nowhere() -> Self {
        let point = Point3::new(f64::INFINITY, f64::INFINITY, f64::INFINITY);
        Self { point, perpendicular: Perpendicular::Nowhere }
    }

    /// Computes the step of a control point, given the point `to` that the curve or surface should pass through.
    fn step(&self, to: Point3<f64>, direction: Direction) -> Vector3<f64> {
        let missed = to - self.point;
        let normal = match (direction, self.perpendicular) {
            (Direction::Residual, _) | (_, Perpendicular::Nowhere) => None,
            (_, Perpendicular::To(tangent)) => {
                let across = missed - tangent * missed.dot(&tangent);
                across.try_normalize(1e-9 * missed.norm())
            }
            (_, Perpendicular::Along(normal)) if missed.dot(&normal) < 0.0 => Some(-normal),
            (_, Perpendicular::Along(normal)) => Some(normal),
        };
        normal.map_or(missed, |normal| normal * missed.norm())
    }
}

/// Every fifth iteration searches for foot points globally; in the others the search starts at the previous foot points.
const GLOBAL_SEARCH_INTERVAL: u32 = 5;

/// A curve or surface has come near its points if its smallest distance in any iteration is less than this fraction of the initial
/// distance.
const NEAR_FRACTION: f64 = 0.1;

/// If the best distance does not improve within this number of iterations, the iteration has diverged.
const MAX_ITERATIONS_WITHOUT_GAIN: u32 = 10;

/// The largest distance must be halved within this number of iterations. A converging iteration does that: per iteration the distance is
/// multiplied by 3/4 for Loop's and the Doo-Sabin scheme on regular meshes, and by 8/9 for the Catmull-Clark scheme; for Loop's scheme on
/// any closed mesh the known bound is 9/10.
const HALVING_ITERATIONS: u32 = 8;

/// Points whose distance is more than this fraction of the largest distance switch to the limits of their own control points.
const WORST_FRACTION: f64 = 0.25;

/// Options of a search for foot points.
pub(crate) struct FootSearch<'a> {
    /// True for a global search, false for one that starts at the previous feet.
    pub(crate) whole: bool,
    /// Marks the points whose foot point is at the parameter of their own control point.
    pub(crate) own: &'a [bool],
}

/// The set of points whose foot point is the limit of their own control point.
struct OwnLimits {
    is: Vec<bool>,
    /// The last checkpoint: the largest distance at that time, which must be halved, and the number of the iteration.
    mark: (f64, u32),
    /// The first iteration after the last addition of points to the set.
    since: u32,
}

impl OwnLimits {
    /// Returns true if all points are in the set, which makes the problem linear.
    fn is_linear(&self) -> bool {
        self.is.iter().all(|&own| own)
    }

    /// Returns true if the largest distance decreases fast enough.
    fn converges(&mut self, iteration: u32, worst: f64) -> bool {
        if worst <= 0.5 * self.mark.0 {
            self.mark = (worst, iteration);
        }
        let is_in_time = iteration < self.mark.1 + HALVING_ITERATIONS && worst <= 2.0 * self.mark.0;
        self.is_linear() || worst.is_finite() && is_in_time
    }

    /// Adds the points with the largest squared distances to the set. If all of these are already in the set, adds all points.
    fn add(&mut self, iteration: u32, squares: &[f64]) {
        let worst = squares.iter().copied().fold(0.0, f64::max);
        fn holds_up(k: usize, worst: f64, squares: &[f64]) -> bool {
            squares[k] > WORST_FRACTION * WORST_FRACTION * worst || !squares[k].is_finite()
        }
        let any = self.is.iter().enumerate().any(|(k, own)| !own && holds_up(k, worst, squares));
        self.is
            .iter_mut()
            .enumerate()
            .for_each(|(k, own)| *own |= !any || holds_up(k, worst, squares));
        self.restart(iteration);
    }

    /// Adds all points to the set.
    fn add_all(&mut self, iteration: u32) {
        self.is.fill(true);
        self.restart(iteration);
    }

    fn restart(&mut self, iteration: u32) {
        // The next iteration measures distances to other foot points, so its distances are not comparable with those of this iteration.
        (self.mark, self.since) = ((f64::INFINITY, iteration), iteration + 1);
    }
}

/// Runs the geometric iteration. `feet` returns the foot point of each given point on the curve or surface with given control points;
/// `sample` returns points of the curve or surface for [`stray`]. Control points marked in `fixed`, which may be empty, do not move, and
/// their distances are ignored.
///
/// Convergence is proven only for the linear problem, in which each foot point is the limit of the point's own control point. So if the
/// largest distance grows or is not halved in time, the points with the largest distances switch to such foot points, and the iteration
/// continues from the best iterate. (A typical cause is that the foot points of neighboring points have converged to nearly the same
/// position, so the corresponding control points always move alike.) More points switch each time, until the problem is linear. An
/// iteration that converges as published never switches. If the curve or surface passes through the points but is far from them elsewhere,
/// all points switch.
///
/// A nonlinear iteration has diverged if the distances grew or stopped decreasing and were never small, or if the curve or surface left the
/// neighborhood of the points, which can happen between foot points. Control points that satisfy the tolerance of the linear problem are
/// the only ones that do, so they are accepted however far they are from the points.
///
/// # Errors
/// If the evaluation is cancelled.
pub(crate) fn iterate(
    points: &[Point3<f64>],
    options: &Interpolation,
    fixed: &[bool],
    progress: &Progress<'_>,
    mut feet: impl FnMut(&[Point3<f64>], FootSearch<'_>) -> Vec<FootPoint>,
    sample: impl Fn(&[Point3<f64>]) -> Option<Vec<Point3<f64>>>,
) -> Result<Solution, CancelledError> {
    fn is_fixed(k: usize, fixed: &[bool]) -> bool {
        fixed.get(k).is_some_and(|&fixed| fixed)
    }
    fn squares(feet: &[FootPoint], points: &[Point3<f64>], fixed: &[bool]) -> Vec<f64> {
        (0..points.len())
            .map(|k: usize| match is_fixed(k, fixed) {
                true => 0.0,
                false => (points[k] - feet[k].point).norm_squared(),
            })
            .collect::<Vec<_>>()
    }
    let free = points.len() - fixed.iter().filter(|&&fixed| fixed).count();
    fn max_and_rms(squares: &[f64], free: usize) -> [f64; 2] {
        let all = squares.iter().fold(Residuals::empty(), |all, &off| all.with_distance_sq(off));
        Residuals { count: free, ..all }.distances()
    }
    let mut record = Record::new(options.norm, absolute_tolerance(options.tolerance, points));
    let mut control = points.to_vec();
    let mut best = (f64::INFINITY, 0, control.clone());
    let mut is_lost = false;
    let is = (0..points.len()).map(|k| options.is_linear() || is_fixed(k, fixed)).collect();
    let mut own = OwnLimits { is, mark: (f64::INFINITY, 0), since: 0 };
    for iteration in 0..=options.iterations {
        progress.tick(f64::from(iteration) / f64::from(options.iterations.max(1)))?;
        let is_global = iteration % GLOBAL_SEARCH_INTERVAL == 0;
        let mut found = feet(&control, FootSearch { whole: is_global, own: &own.is });
        let mut off = squares(&found, points, fixed);
        // A local search may miss a nearer foot point elsewhere, so the iteration ends only after a global search.
        if !is_global && record.is_within_tolerance(max_and_rms(&off, free)) {
            found = feet(&control, FootSearch { whole: true, own: &own.is });
            off = squares(&found, points, fixed);
        }
        let now = max_and_rms(&off, free);
        let settled = record.record(now);
        if settled && (own.is_linear() || stray(&control, points, &sample).is_none()) {
            let outcome = Outcome { control, trace: record.into_trace(), end: End::Settled };
            return Ok(Solution { outcome, unreachable: false });
        }
        let stalls = iteration >= own.since + STALL_ITERATIONS as u32 && record.has_stalled();
        if own.is_linear() && stalls {
            let outcome = Outcome { control, trace: record.into_trace(), end: End::Short };
            return Ok(Solution { outcome, unreachable: true });
        }
        if record.distance(now) < best.0 {
            best = (record.distance(now), iteration, control.clone());
        }
        is_lost = 2.0 * record.initial_distance() < record.distance(now)
            || best.1 + MAX_ITERATIONS_WITHOUT_GAIN < iteration;
        if settled {
            // Passes through the points, but swings far away between them. The solution of the linear problem swings least.
            own.add_all(iteration);
        } else if !own.converges(iteration, now[0]) {
            own.add(iteration, &off);
            control.clone_from(&best.2);
        } else if iteration < options.iterations {
            for k in (0..points.len()).filter(|&k| !is_fixed(k, fixed)) {
                control[k] += found[k].step(points[k], options.direction);
            }
        }
    }
    if options.is_linear() {
        let outcome = Outcome { control, trace: record.into_trace(), end: End::Short };
        return Ok(Solution { outcome, unreachable: false });
    }
    let (missed, iteration, control) = best;
    let end = match stray(&control, points, sample) {
        _ if is_lost && missed > NEAR_FRACTION * record.initial_distance() => {
            End::missed(iteration, missed)
        }
        Some(stray) => End::strayed(iteration, stray),
        None => End::Short,
    };
    let outcome = Outcome { control, trace: record.truncate(iteration).into_trace(), end };
    Ok(Solution { outcome, unreachable: false })
}
