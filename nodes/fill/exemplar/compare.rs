//! Measures the similarity of a patch of the fill and an exemplar (a patch of the input surface).

use maquette_value::simd::{Kernel, widest};
use nalgebra::{Matrix5, Vector5};

use super::frame::Orientation;
use super::heights::{LANES, Sample, View};

/// A plane over a patch, in the patch's frame: the height at the center, and the change of height per patch radius along `x` and `y`.
pub(super) type Plane = [f64; 3];

/// The samples of a patch, prepared for aligning exemplars (patches of the input surface) with them.
#[derive(Default)]
pub(super) struct PatchSamples {
    pub(super) samples: Vec<Sample>,
    /// The positions of the samples in the plane of the patch's frame, in patch radii.
    positions: Vec<[f64; 2]>,
    radius: f64,
    /// True if exemplars are also shifted sideways when they are aligned.
    pub(super) shifts: bool,
    /// For each stage of a comparison, the number of samples compared up to the end of the stage, and the precomputed least-squares fit of
    /// a plane to these samples.
    stages: [(usize, Planes); STAGES],
}

/// Distance assigned to a sample at which the exemplar has no surface, in patch radii. The fitted plane ignores such samples.
const MISSING_DISTANCE: f64 = 0.25;

/// The number of stages of a comparison. A comparison may stop after each stage.
const STAGES: usize = 6;

/// An exemplar (a patch of the input surface) aligned with a patch of the fill.
pub(super) struct Alignment {
    /// The distances from the samples to the exemplar along the samples' normals; NaN where the exemplar has no surface.
    pub(super) distances: Vec<f64>,
    /// The plane that fits `distances` best. Callers must subtract the plane from `distances`.
    pub(super) plane: Plane,
    /// The shift of the samples on the exemplar, in columns and rows of its lattice.
    pub(super) shift: [f64; 2],
    /// The sum of the squared distances from the plane.
    sum: f64,
}

/// Maximum shift of an exemplar, in steps of its lattice: about the distance between neighboring exemplars.
const MAX_SHIFT: f64 = 1.0;

/// Weight of a shift by one step beside the squares of slopes, which are lengths per step: slopes smaller than a thousandth of the patch
/// radius per step determine no shift.
const SHIFT_DAMPING: f64 = 1e-6;

impl PatchSamples {
    /// Prepares the samples for comparisons. If `moves` is true, each exemplar is shifted and tilted slightly to fit best; otherwise it
    /// stays at the position given by its frame.
    pub(super) fn prepare(&mut self, radius: f64, moves: bool) {
        self.radius = radius;
        self.positions.clear();
        self.positions.extend(self.samples.iter().map(|sample| sample.at.map(|x| x / radius)));
        let count = self.samples.len();
        for stage in 0..STAGES {
            let end = count * (stage + 1) / STAGES;
            let planes = if moves {
                Planes::from_points(self.positions[..end].iter())
            } else {
                Planes::NONE
            };
            self.stages[stage] = (end, planes);
        }
    }

    /// Computes the samples in the coordinates of exemplars that have the given orientation.
    pub(super) fn view(&self, step: f64, orientation: &Orientation, view: &mut Vec<View<LANES>>) {
        view.clear();
        let some = self.samples.chunks(LANES);
        view.extend(some.map(|some| View::new(some, step, orientation, [0.0; 2])));
    }

    /// Returns the mean of the squared distances between the samples, given as `view`, and an exemplar's heights: Kawai, Sato and Yokoya
    /// (2008), equation 2. Distances are measured along the samples' normals, relative to the plane that fits them best. Samples where the
    /// exemplar has no surface count as [`MISSING_DISTANCE`]; otherwise exemplars with gaps where they fit worst would seem best. Returns
    /// infinity if the mean exceeds `max_mean`, or if the exemplar has no surface at more than 30 % of the samples.
    #[inline(always)]
    pub(super) fn compare(&self, view: &[View<LANES>], heights: &[f32], max_mean: f64) -> f64 {
        let count = self.samples.len();
        let limit = max_mean * count as f64;
        let absent = (MISSING_DISTANCE * self.radius) * (MISSING_DISTANCE * self.radius);
        let mut sums = Sums::default();
        let (mut distances, mut missing) = ([0.0; LANES], [0; LANES]);
        let (mut start, mut rest) = (0, 0.0);
        for (end, planes) in &self.stages {
            for sample in start..*end {
                if sample % LANES == 0 {
                    distances = self.distances(&view[sample / LANES], heights);
                    for k in 0..LANES {
                        missing[k] = u64::from(distances[k].is_nan());
                        distances[k] = if distances[k].is_nan() { 0.0 } else { distances[k] };
                    }
                }
                let lane = sample % LANES;
                sums.missing += missing[lane];
                sums.add(distances[lane], self.positions[sample]);
            }
            start = *end;
            rest = sums.squares + sums.missing as f64 * absent - planes.gain(sums.moments);
            if rest > limit {
                return f64::INFINITY;
            }
        }
        // The exemplar must have a surface at 70 % of the samples or more.
        let met = count - sums.missing as usize;
        if met == 0 || 10 * met < 7 * count {
            return f64::INFINITY;
        }
        let mean = rest.max(0.0) / count as f64;
        if mean <= max_mean { mean } else { f64::INFINITY }
    }

    /// Aligns an exemplar (a patch of the input surface) with the patch by the best small shift and tilt. The center of an exemplar is a
    /// vertex; shifts sideways, by less than the distance to the next one, make steep features meet.
    pub(super) fn align(&self, heights: &[f32], step: f64, orientation: &Orientation) -> Alignment {
        let still = self.align_shifted(heights, step, orientation, [0.0; 2]);
        if !self.shifts {
            return still;
        }
        let Some(shift) = self.best_shift(&still.distances, heights, step, orientation) else {
            return still;
        };
        let moved = self.align_shifted(heights, step, orientation, shift);
        if moved.sum < still.sum { moved } else { still }
    }

    /// Returns the shift of the samples, in columns and rows, that brings them nearest to an exemplar, as far as it is known from the
    /// distances and slopes at their positions. A plane is fitted at the same time. Returns `None` if the shift is not determined.
    fn best_shift(
        &self,
        distances: &[f64],
        heights: &[f32],
        step: f64,
        orientation: &Orientation,
    ) -> Option<[f64; 2]> {
        let (mut matrix, mut right) = (Matrix5::zeros(), Vector5::zeros());
        for (first, some) in self.samples.chunks(LANES).enumerate() {
            let view: View<LANES> = View::new(some, step, orientation, [0.0; 2]);
            let slopes = view.distance_slopes(heights);
            let slopes = slopes[0].iter().zip(&slopes[1]).take(some.len());
            for (sample, (of_u, of_v)) in (LANES * first..).zip(slopes) {
                let distance = distances[sample];
                let [u, v] = self.positions[sample];
                let row = Vector5::new(1.0, u, v, *of_u, *of_v);
                if distance.is_finite() && row.iter().all(|x| x.is_finite()) {
                    matrix += row * row.transpose();
                    right += row * distance;
                }
            }
        }
        // Damp shifts that slopes hardly determine, as on a plane.
        let damping = SHIFT_DAMPING * self.radius * self.radius * matrix[(0, 0)];
        matrix[(3, 3)] += damping;
        matrix[(4, 4)] += damping;
        let solution = matrix.cholesky()?.solve(&right);
        let shift = [-solution[3], -solution[4]];
        let length = libm::hypot(shift[0], shift[1]);
        (length > 0.0).then(|| shift.map(|x| x * (MAX_SHIFT / length).min(1.0)))
    }

    fn align_shifted(
        &self,
        heights: &[f32],
        step: f64,
        orientation: &Orientation,
        shift: [f64; 2],
    ) -> Alignment {
        let samples = self.samples.chunks(LANES);
        let view: Vec<View<LANES>> =
            samples.map(|some| View::new(some, step, orientation, shift)).collect();
        let mut distances = Vec::with_capacity(LANES * view.len());
        widest(Distances { patch: self, view: &view, heights, distances: &mut distances });
        distances.truncate(self.samples.len());
        let mut sums = Sums::default();
        let met = distances.iter().zip(&self.positions).filter(|(distance, _)| !distance.is_nan());
        let count = met.clone().count();
        met.for_each(|(&distance, &position)| sums.add(distance, position));
        let planes = &self.stages[STAGES - 1].1;
        let absent = (MISSING_DISTANCE * self.radius) * (MISSING_DISTANCE * self.radius);
        let missing = (self.samples.len() - count) as f64;
        let sum = sums.squares + missing * absent - planes.gain(sums.moments);
        Alignment { distances, plane: planes.solve(sums.moments), shift, sum }
    }

    /// Returns the distances of samples to an exemplar; NaN where the exemplar has no surface or is farther away than its radius.
    #[inline(always)]
    fn distances(&self, view: &View<LANES>, heights: &[f32]) -> [f64; LANES] {
        let mut distances = view.distances(heights);
        for distance in &mut distances {
            *distance = if distance.abs() <= self.radius { *distance } else { f64::NAN };
        }
        distances
    }

    /// Returns the height of a plane at the position of a sample.
    pub(super) fn plane_height(&self, plane: &Plane, sample: usize) -> f64 {
        let [u, v] = self.positions[sample];
        plane[0] + plane[1] * u + plane[2] * v
    }
}

/// A kernel that computes the distances of all samples of a patch, including padding.
struct Distances<'a> {
    patch: &'a PatchSamples,
    view: &'a [View<LANES>],
    heights: &'a [f32],
    distances: &'a mut Vec<f64>,
}

impl Kernel for Distances<'_> {
    #[inline(always)]
    fn run(self) {
        for view in self.view {
            self.distances.extend_from_slice(&self.patch.distances(view, self.heights));
        }
    }
}

#[derive(Default)]
struct Sums {
    squares: f64,
    moments: [f64; 3],
    missing: u64,
}

impl Sums {
    #[inline(always)]
    fn add(&mut self, distance: f64, [u, v]: [f64; 2]) {
        self.squares += distance * distance;
        self.moments[0] += distance;
        self.moments[1] += distance * u;
        self.moments[2] += distance * v;
    }
}

/// The inverse of the normal equations for fitting a plane to values at given positions. Only the upper triangle is stored, row by row.
#[derive(Clone, Copy, Default)]
pub(super) struct Planes {
    inverse: [f64; 6],
}

/// Minimum determinant of the normal equations, relative to the product of their diagonal. Below it the positions are nearly collinear.
const MIN_DETERMINANT: f64 = 1e-3;

impl Planes {
    const NONE: Self = Self { inverse: [0.0; 6] };

    pub(super) fn from_points<'a>(positions: impl Iterator<Item = &'a [f64; 2]>) -> Self {
        let (mut n, mut x, mut y) = (0.0, 0.0, 0.0);
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for &[u, v] in positions {
            n += 1.0;
            x += u;
            y += v;
            xx += u * u;
            xy += u * v;
            yy += v * v;
        }
        let [a, b, c] = [xx * yy - xy * xy, xy * y - x * yy, x * xy - xx * y];
        let determinant = n * a + x * b + y * c;
        let spans = determinant > MIN_DETERMINANT * n * xx * yy;
        let inverse = match spans {
            true => [a, b, c, n * yy - y * y, x * y - n * xy, n * xx - x * x]
                .map(|minor| minor / determinant),
            false => [0.0; 6],
        };
        Self { inverse }
    }

    /// Returns the least-squares plane of values with the given moments (sums of the values times 1, x and y).
    #[inline(always)]
    pub(super) fn solve(&self, [p, q, r]: [f64; 3]) -> Plane {
        let [a, b, c, d, e, f] = self.inverse;
        [a * p + b * q + c * r, b * p + d * q + e * r, c * p + e * q + f * r]
    }

    /// Returns the amount by which the sum of the squared values decreases when the least-squares plane is subtracted.
    #[inline(always)]
    pub(super) fn gain(&self, moments: [f64; 3]) -> f64 {
        let plane = self.solve(moments);
        plane[0] * moments[0] + plane[1] * moments[1] + plane[2] * moments[2]
    }
}

#[cfg(test)]
mod tests {
    use super::super::heights::{NODES, SIDE};
    use super::*;

    #[test]
    fn a_steep_exemplar_is_aligned_sideways() {
        fn wall(x: f64, y: f64) -> f64 {
            libm::tanh(x + 0.3 * y) + 0.3 * libm::sin(0.9 * y)
        }
        let half = (SIDE / 2) as f64;
        let heights: Vec<f32> = (0..NODES)
            .map(|node| wall((node % SIDE) as f64 - half, (node / SIDE) as f64 - half) as f32)
            .collect();
        let mut patch = PatchSamples::default();
        for node in 0..NODES {
            let at = [(node % SIDE) as f64 - half, (node / SIDE) as f64 - half].map(|x| 0.6 * x);
            if libm::hypot(at[0], at[1]) < 5.0 {
                let height = wall(at[0] + 0.4, at[1] - 0.3);
                patch.samples.push(Sample { at, height, normal: [0.0, 0.0, 1.0] });
            }
        }
        patch.prepare(5.0, true);
        patch.shifts = true;
        let straight = Orientation::list(1, false)[0];
        let [still, best] = [
            patch.align_shifted(&heights, 1.0, &straight, [0.0; 2]),
            patch.align(&heights, 1.0, &straight),
        ];
        assert!(best.sum < 0.1 * still.sum, "{} {}", best.sum, still.sum);
        assert!((best.shift[0] - 0.4).abs() < 0.1, "{:?}", best.shift);
        assert!((best.shift[1] + 0.3).abs() < 0.15, "{:?}", best.shift);
    }

    #[test]
    fn a_plane_determines_no_shift() {
        let mut patch = PatchSamples::default();
        for k in 0..40 {
            let at = [f64::from(k % 7) - 3.0, f64::from(k / 7) - 3.0];
            patch.samples.push(Sample { at, height: 0.5 * at[0], normal: [0.0, 0.0, 1.0] });
        }
        patch.prepare(5.0, true);
        patch.shifts = true;
        let aligned = patch.align(&[1.0; NODES], 1.0, &Orientation::list(1, false)[0]);
        assert_eq!(aligned.shift, [0.0; 2]);
    }
}
