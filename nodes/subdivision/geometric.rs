//! The geometric algorithm: control points move by what their curve or surface misses the given points by.
//!
//! ```text
//! Q_i = the foot of S_i on the curve or surface of P        d_i = S_i - Q_i        P_i += d_i
//! ```
//!
//! from `P = S` on, until the distances are small enough. Maekawa, Matsumoto and Namiki, "Interpolation by geometric algorithm",
//! Computer-Aided Design 39 (2007); with the vertex's own limit point as foot it is the progressive interpolation of Cheng et al.,
//! "Loop subdivision surface based progressive interpolation", Journal of Computer Science and Technology 24 (2009).

use maquette::value::{Trace, TraceStep};
use maquette::{Cancelled, Progress};
use nalgebra::{Point3, Vector3};

use super::interpolation::{Direction, End, Found, Interpolation, Norm, RanAway, Solution};

/// A point of a curve or surface, and which way is perpendicular there.
#[derive(Clone, Copy, Debug)]
pub(super) struct FootPoint {
    pub(super) point: Point3<f64>,
    pub(super) perpendicular: Perpendicular,
}

/// Which directions are at right angles.
#[derive(Clone, Copy, Debug)]
pub(super) enum Perpendicular {
    /// Those to this unit tangent.
    To(Vector3<f64>),
    /// This unit normal.
    Along(Vector3<f64>),
    /// None: an end, a border, a crease.
    Nowhere,
}

impl FootPoint {
    /// What something that ran away has in place of a foot.
    pub(super) fn nowhere() -> Self {
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

/// What some points are missed by.
#[derive(Clone, Copy, Debug)]
pub(super) struct Missed {
    max_sq: f64,
    sum_sq: f64,
    count: usize,
}

impl Missed {
    /// No points.
    pub(super) fn none() -> Self {
        Self { max_sq: 0.0, sum_sq: 0.0, count: 0 }
    }

    /// These points and one more, by the square of its distance.
    pub(super) fn and_by(self, distance_sq: f64) -> Self {
        self.and(Self { max_sq: distance_sq, sum_sq: distance_sq, count: 1 })
    }

    /// These points and others.
    pub(super) fn and(self, other: Self) -> Self {
        Self {
            max_sq: self.max_sq.max(other.max_sq),
            sum_sq: self.sum_sq + other.sum_sq,
            count: self.count + other.count,
        }
    }

    /// The largest distance and the root of the mean of the squares.
    pub(super) fn distances(self) -> [f64; 2] {
        [self.max_sq.sqrt(), (self.sum_sq / self.count.max(1) as f64).sqrt()]
    }
}

/// The distances of an iteration, and whether they are small enough.
pub(super) struct Record {
    norm: Norm,
    tolerance: f64,
    steps: Vec<TraceStep>,
}

impl Record {
    /// Nothing yet; `tolerance` in mm.
    pub(super) fn new(norm: Norm, tolerance: f64) -> Self {
        Self { norm, tolerance, steps: Vec::new() }
    }

    /// The distance that is small enough, in mm.
    pub(super) fn tolerance(&self) -> f64 {
        self.tolerance
    }

    /// The one of these distances that counts.
    fn distance(&self, [max, rms]: [f64; 2]) -> f64 {
        match self.norm {
            Norm::Max => max,
            Norm::Mean => rms,
        }
    }

    /// The distance at the beginning.
    fn first(&self) -> f64 {
        self.steps.first().map_or(0.0, |step| self.distance([step.max, step.rms]))
    }

    /// Without what was noted after an iteration.
    fn until(mut self, iteration: u32) -> Self {
        self.steps.truncate(iteration as usize + 1);
        self
    }

    /// Whether these distances are small enough.
    pub(super) fn allows(&self, distances: [f64; 2]) -> bool {
        self.distance(distances) <= self.tolerance
    }

    /// Notes the distances after the next iteration, the first time before all; whether they are small enough.
    pub(super) fn note(&mut self, [max, rms]: [f64; 2]) -> bool {
        self.steps.push(TraceStep { iteration: self.steps.len() as u64, max, rms });
        self.allows([max, rms])
    }

    /// Puts these distances in place of the last ones; whether they are small enough.
    pub(super) fn correct(&mut self, distances: [f64; 2]) -> bool {
        self.steps.pop();
        self.note(distances)
    }

    /// Whether the last ten iterations took next to nothing away: the rest is what no control points reach.
    pub(super) fn stalls(&self) -> bool {
        const WINDOW: usize = 10;
        let Some(last) = self.steps.len().checked_sub(1).filter(|&last| last >= WINDOW) else {
            return false;
        };
        let [before, now] = [last - WINDOW, last].map(|step| self.steps[step]);
        now.rms > 0.999 * before.rms
    }

    pub(super) fn into_trace(self) -> Trace {
        // Distances that overflowed are no numbers; the trace ends before them.
        let sound = self.steps.into_iter().take_while(|step| step.max >= 0.0 && step.rms >= 0.0);
        Trace::new(sound.collect()).expect("iterations are counted up and distances not negative")
    }
}

/// Every so many iterations feet are looked for everywhere, not only near the last ones.
const WHOLE: u32 = 5;

/// An iterate is near its points if it misses them by less than this share of what the first one does: a surface that is some use.
const NEAR: f64 = 0.1;

/// After so many iterations without a better one, none is to be expected.
const LATE: u32 = 10;

/// The geometric iteration. `feet` gives the foot of each point on what some control points make, looking everywhere if it is
/// told so, else near the last ones. Control points that `fixed` marks stay and have no say; it may be empty.
///
/// Only of a linear problem it is known that it converges. Of any other the best iterate is what is found, and an iteration ends that
/// misses the points by twice as much as at the beginning.
///
/// # Errors
/// If the evaluation is told to stop.
pub(super) fn iterate(
    points: &[Point3<f64>],
    how: &Interpolation,
    fixed: &[bool],
    progress: &Progress<'_>,
    mut feet: impl FnMut(&[Point3<f64>], bool) -> Vec<FootPoint>,
) -> Result<Solution, Cancelled> {
    let is_free = |index: &usize| !fixed.get(*index).is_some_and(|&fixed| fixed);
    let free = Vec::from_iter((0..points.len()).filter(is_free));
    let distances = |feet: &[FootPoint]| {
        let missed = free.iter().map(|&k| (points[k] - feet[k].point).norm_squared());
        missed.fold(Missed::none(), Missed::and_by).distances()
    };
    let size = diagonal(points);
    let mut record = Record::new(how.norm, how.tolerance * size);
    let mut control = points.to_vec();
    let mut best = (f64::INFINITY, 0, control.clone());
    let mut is_lost = false;
    for iteration in 0..=how.iterations {
        progress.tick(f64::from(iteration) / f64::from(how.iterations.max(1)))?;
        let whole = iteration % WHOLE == 0;
        let mut found = feet(&control, whole);
        // Near the last foot there may be one, and a nearer one elsewhere: no iteration ends on that.
        if !whole && record.allows(distances(&found)) {
            found = feet(&control, true);
        }
        let missed = distances(&found);
        if record.note(missed) {
            let found = Found { control, trace: record.into_trace(), end: End::Settled };
            return Ok(Solution { found, unreachable: false });
        }
        if how.is_linear() && record.stalls() {
            let found = Found { control, trace: record.into_trace(), end: End::Short };
            return Ok(Solution { found, unreachable: true });
        }
        if record.distance(missed) < best.0 {
            best = (record.distance(missed), iteration, control.clone());
        }
        let grows = 2.0 * record.first() < record.distance(missed);
        is_lost = grows || best.1 + LATE < iteration;
        if grows && !how.is_linear() {
            break;
        }
        if iteration < how.iterations {
            free.iter().for_each(|&k| control[k] += found[k].step(points[k], how.direction));
        }
    }
    if how.is_linear() {
        let found = Found { control, trace: record.into_trace(), end: End::Short };
        return Ok(Solution { found, unreachable: false });
    }
    let (missed, iteration, control) = best;
    let start = record.first();
    let moves = control.iter().zip(points).map(|(control, point)| (control - point).norm());
    let is_far = moves.fold(0.0, f64::max) > size;
    let end = match is_far || is_lost && missed > NEAR * start {
        true => End::RanAway(RanAway { iteration, missed }),
        false => End::Short,
    };
    let found = Found { control, trace: record.until(iteration).into_trace(), end };
    Ok(Solution { found, unreachable: false })
}

/// The diagonal of the box around some points.
pub(super) fn diagonal(points: &[Point3<f64>]) -> f64 {
    let Some(first) = points.first() else { return 0.0 };
    let (low, high) =
        points.iter().fold((*first, *first), |(low, high), p| (low.inf(p), high.sup(p)));
    (high - low).norm()
}
