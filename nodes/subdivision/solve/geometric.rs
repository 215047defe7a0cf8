//! The geometric algorithm: control points move by what their curve or surface misses the given points by.
//!
//! ```text
//! Q_i = the foot of S_i on the curve or surface of P        d_i = S_i - Q_i        P_i += d_i
//! ```
//!
//! from `P = S` on, until the distances are small enough. Maekawa, Matsumoto and Namiki, "Interpolation by geometric algorithm",
//! Computer-Aided Design 39 (2007); with the vertex's own limit point as foot it is the progressive interpolation of Cheng et al.,
//! "Loop subdivision surface based progressive interpolation", Journal of Computer Science and Technology 24 (2009).

use maquette_base::linear::missed::Missed;
use maquette_node::{Cancelled, Progress};
use nalgebra::{Point3, Vector3};

use super::extent::{diagonal, stray};
use super::interpolation::{Direction, Interpolation};
use super::record::{Record, STALL};
use super::solution::{Diverged, End, Found, Solution};

/// A point of a curve or surface, and which way is perpendicular there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FootPoint {
    pub(crate) point: Point3<f64>,
    pub(crate) perpendicular: Perpendicular,
}

/// Which directions are at right angles.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Perpendicular {
    /// Those to this unit tangent.
    To(Vector3<f64>),
    /// This unit normal.
    Along(Vector3<f64>),
    /// None: an end, a border, a crease.
    Nowhere,
}

impl FootPoint {
    /// The foot on a curve or surface whose numbers overflowed.
    pub(crate) fn nowhere() -> Self {
        let point = Point3::new(f64::INFINITY, f64::INFINITY, f64::INFINITY);
        Self { point, perpendicular: Perpendicular::Nowhere }
    }

    /// The step of the control point that belongs to `to`.
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

/// Every so many iterations feet are looked for everywhere, not only near the last ones.
const WHOLE: u32 = 5;

/// An iterate is near its points if it misses them by less than this share of what the first one does: a surface that is some use.
const NEAR: f64 = 0.1;

/// After so many iterations without a better one, none is to be expected.
const LATE: u32 = 10;

/// In so many iterations the largest distance is halved, where the iteration converges: the factors of Loop's scheme and of Doo and Sabin's
/// are 3/4 on regular meshes, that of Catmull and Clark's is 8/9, and at most 9/10 is known for Loop's on any closed mesh.
const PATIENCE: u32 = 8;

/// Points that are missed by more than this share of the largest distance are those that hold the iteration up.
const WORST: f64 = 0.25;

/// How feet are looked for.
pub(crate) struct Look<'a> {
    /// Everywhere, not only near the last ones.
    pub(crate) whole: bool,
    /// Marks the points whose foot is at their own control point's parameter, and which their control points go straight to.
    pub(crate) own: &'a [bool],
}

/// Which points are compared with their own control points' limits.
struct Own {
    is: Vec<bool>,
    /// The largest distance that was to be halved, and since when.
    mark: (f64, u32),
    /// The first iteration with the last points that joined.
    since: u32,
}

impl Own {
    /// Whether all are: the problem is linear.
    fn all(&self) -> bool {
        self.is.iter().all(|&own| own)
    }

    /// Whether the iteration with these distances of the points goes on as well as it should.
    fn is_content(&mut self, iteration: u32, worst: f64) -> bool {
        if worst <= 0.5 * self.mark.0 {
            self.mark = (worst, iteration);
        }
        let is_in_time = iteration < self.mark.1 + PATIENCE && worst <= 2.0 * self.mark.0;
        self.all() || worst.is_finite() && is_in_time
    }

    /// Adds those that are missed by most, by the squares of the distances; all, if these are among them.
    fn add(&mut self, iteration: u32, squares: &[f64]) {
        let worst = squares.iter().copied().fold(0.0, f64::max);
        fn holds_up(k: usize, worst: f64, squares: &[f64]) -> bool {
            squares[k] > WORST * WORST * worst || !squares[k].is_finite()
        }
        let any = self.is.iter().enumerate().any(|(k, own)| !own && holds_up(k, worst, squares));
        self.is
            .iter_mut()
            .enumerate()
            .for_each(|(k, own)| *own |= !any || holds_up(k, worst, squares));
        // The distances of this iteration are from other feet than those of the next.
        (self.mark, self.since) = ((f64::INFINITY, iteration), iteration + 1);
    }
}

/// The geometric iteration. `feet` gives the foot of each point on what some control points make, `sample` points all over it, as
/// [`stray`] wants them. Control points that `fixed` marks stay and have no say; it may be empty.
///
/// Only of a linear problem it is known that it converges: that of the control points' own limits. So where the largest distance is not
/// halved in time, or grows, the points that are missed by most take their own limits for feet from then on, and the iteration goes on
/// from the best iterate. Nearby points may have slid onto nearly the same place of the surface, so that nothing moves them apart; none
/// slides any more. Each time there are more such points, and with all of them the problem is linear.
/// An iteration that converges as the published one never gets there.
///
/// A nonlinear iteration has diverged if the distances grew, or were no longer reduced, and were never small; or if its curve or surface left
/// the neighborhood of the points, which it may do between feet that are near. Control points may be far from their points.
///
/// # Errors
/// If the evaluation is told to stop.
pub(crate) fn iterate(
    points: &[Point3<f64>],
    how: &Interpolation,
    fixed: &[bool],
    progress: &Progress<'_>,
    mut feet: impl FnMut(&[Point3<f64>], Look<'_>) -> Vec<FootPoint>,
    sample: impl Fn(&[Point3<f64>]) -> Option<Vec<Point3<f64>>>,
) -> Result<Solution, Cancelled> {
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
    fn missed(squares: &[f64], free: usize) -> [f64; 2] {
        let all = squares.iter().fold(Missed::none(), |all, &off| all.and_by(off));
        Missed { count: free, ..all }.distances()
    }
    let mut record = Record::new(how.norm, how.tolerance * diagonal(points));
    let mut control = points.to_vec();
    let mut best = (f64::INFINITY, 0, control.clone());
    let mut is_lost = false;
    let is = (0..points.len()).map(|k| how.is_linear() || is_fixed(k, fixed)).collect();
    let mut own = Own { is, mark: (f64::INFINITY, 0), since: 0 };
    for iteration in 0..=how.iterations {
        progress.tick(f64::from(iteration) / f64::from(how.iterations.max(1)))?;
        let whole = iteration % WHOLE == 0;
        let mut found = feet(&control, Look { whole, own: &own.is });
        let mut off = squares(&found, points, fixed);
        // Near the last foot there may be one, and a nearer one elsewhere: no iteration ends on that.
        if !whole && record.allows(missed(&off, free)) {
            found = feet(&control, Look { whole: true, own: &own.is });
            off = squares(&found, points, fixed);
        }
        let now = missed(&off, free);
        if record.note(now) && (how.is_linear() || stray(&control, points, &sample).is_none()) {
            let found = Found { control, trace: record.into_trace(), end: End::Settled };
            return Ok(Solution { found, unreachable: false });
        }
        let stalls = iteration >= own.since + STALL as u32 && record.stalls();
        if own.all() && stalls {
            let found = Found { control, trace: record.into_trace(), end: End::Short };
            return Ok(Solution { found, unreachable: true });
        }
        if record.distance(now) < best.0 {
            best = (record.distance(now), iteration, control.clone());
        }
        is_lost = 2.0 * record.first() < record.distance(now) || best.1 + LATE < iteration;
        if !own.is_content(iteration, now[0]) {
            own.add(iteration, &off);
            control.clone_from(&best.2);
        } else if iteration < how.iterations {
            for k in (0..points.len()).filter(|&k| !is_fixed(k, fixed)) {
                control[k] += found[k].step(points[k], how.direction);
            }
        }
    }
    if how.is_linear() {
        let found = Found { control, trace: record.into_trace(), end: End::Short };
        return Ok(Solution { found, unreachable: false });
    }
    let (missed, iteration, control) = best;
    let end = match stray(&control, points, sample) {
        _ if is_lost && missed > NEAR * record.first() => {
            End::Diverged(Diverged::Missed { iteration, missed })
        }
        Some(stray) => End::Diverged(Diverged::strayed(iteration, stray)),
        None => End::Short,
    };
    let found = Found { control, trace: record.until(iteration).into_trace(), end };
    Ok(Solution { found, unreachable: false })
}
