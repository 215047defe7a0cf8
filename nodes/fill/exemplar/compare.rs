//! How similar a patch is to an exemplar.

use maquette_value::simd::{Kernel, widest};

use super::frame::Turn;
use super::heights::{LANES, Sample, View};

/// A plane under a patch, in the patch's frame: a height at the middle, and what is added per radius along `x` and `y`.
pub(super) type Plane = [f64; 3];

/// The samples of a patch, prepared so that exemplars can be aligned with them.
#[derive(Default)]
pub(super) struct PatchSamples {
    pub(super) samples: Vec<Sample>,
    /// The samples' places in radii.
    places: Vec<[f64; 2]>,
    radius: f64,
    /// After how many samples a comparison checks whether it can stop early, and the planes through these samples.
    stages: [(usize, Planes); STAGES],
}

/// The distance of a sample where the exemplar has no surface, in radii of the patch; the plane between both does not regard such samples.
const ABSENT: f64 = 0.25;

/// Stages of a comparison; after each it may stop early.
const STAGES: usize = 6;

/// An exemplar aligned with a patch.
pub(super) struct Alignment {
    /// The distances of the samples along their normals; NaN where the exemplar has no surface.
    pub(super) distances: Vec<f64>,
    /// The best plane between both, which is to be subtracted from them.
    pub(super) plane: Plane,
}

impl PatchSamples {
    /// Prepares the samples that were put in for comparisons. If `moves`, an exemplar is moved and tilted a little to where it
    /// fits best; else it stays where its frame puts it.
    pub(super) fn prepare(&mut self, radius: f64, moves: bool) {
        self.radius = radius;
        self.places.clear();
        self.places.extend(self.samples.iter().map(|sample| sample.at.map(|x| x / radius)));
        let count = self.samples.len();
        for stage in 0..STAGES {
            let end = count * (stage + 1) / STAGES;
            let planes = if moves { Planes::of(self.places[..end].iter()) } else { Planes::NONE };
            self.stages[stage] = (end, planes);
        }
    }

    /// The samples as exemplars see them that are turned like this.
    pub(super) fn view(&self, step: f64, turn: &Turn, view: &mut Vec<View<LANES>>) {
        view.clear();
        view.extend(self.samples.chunks(LANES).map(|some| View::new(some, step, turn)));
    }

    /// The mean of the squared distances from the samples, of which this is the view, along their normals to an exemplar's heights: Kawai,
    /// Sato and Yokoya (2008), equation 2, for the best plane between both. Samples where the exemplar has no surface count as [`ABSENT`];
    /// if they were left out, exemplars with holes where they fit least would seem best. Infinite if it is over `most`, or if the exemplar
    /// has no surface at many samples.
    #[inline(always)]
    pub(super) fn compare(&self, view: &[View<LANES>], heights: &[f32], most: f64) -> f64 {
        let count = self.samples.len();
        let limit = most * count as f64;
        let absent = (ABSENT * self.radius) * (ABSENT * self.radius);
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
                sums.add(distances[lane], self.places[sample]);
            }
            start = *end;
            rest = sums.squares + sums.missing as f64 * absent - planes.gain(sums.moments);
            if rest > limit {
                return f64::INFINITY;
            }
        }
        // At least seven of ten samples.
        let met = count - sums.missing as usize;
        if met == 0 || 10 * met < 7 * count {
            return f64::INFINITY;
        }
        let mean = rest.max(0.0) / count as f64;
        if mean <= most { mean } else { f64::INFINITY }
    }

    /// Aligns an exemplar with the patch by the best small shift and tilt.
    pub(super) fn align(&self, heights: &[f32], step: f64, turn: &Turn) -> Alignment {
        let mut view = Vec::new();
        self.view(step, turn, &mut view);
        let mut distances = Vec::with_capacity(LANES * view.len());
        widest(Distances { patch: self, view: &view, heights, distances: &mut distances });
        distances.truncate(self.samples.len());
        let mut sums = Sums::default();
        let met = distances.iter().zip(&self.places).filter(|(distance, _)| !distance.is_nan());
        met.for_each(|(&distance, &place)| sums.add(distance, place));
        Alignment { distances, plane: self.stages[STAGES - 1].1.solve(sums.moments) }
    }

    /// How far an exemplar is from samples; NaN if there is none within the patch's radius.
    #[inline(always)]
    fn distances(&self, view: &View<LANES>, heights: &[f32]) -> [f64; LANES] {
        let mut distances = view.distances(heights);
        for distance in &mut distances {
            *distance = if distance.abs() <= self.radius { *distance } else { f64::NAN };
        }
        distances
    }

    /// The plane's value at a sample.
    pub(super) fn at(&self, plane: &Plane, sample: usize) -> f64 {
        let [u, v] = self.places[sample];
        plane[0] + plane[1] * u + plane[2] * v
    }
}

/// The distances of all samples of a patch, and of what is left over.
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

/// The inverse of the normal equations of the planes through some places: the upper half, row by row.
#[derive(Clone, Copy, Default)]
struct Planes {
    inverse: [f64; 6],
}

/// Below this determinant, relative to the product of the diagonal, places are nearly on a line.
const LEAST_DETERMINANT: f64 = 1e-3;

impl Planes {
    const NONE: Self = Self { inverse: [0.0; 6] };

    fn of<'a>(places: impl Iterator<Item = &'a [f64; 2]>) -> Self {
        let (mut n, mut x, mut y) = (0.0, 0.0, 0.0);
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for &[u, v] in places {
            n += 1.0;
            x += u;
            y += v;
            xx += u * u;
            xy += u * v;
            yy += v * v;
        }
        let [a, b, c] = [xx * yy - xy * xy, xy * y - x * yy, x * xy - xx * y];
        let determinant = n * a + x * b + y * c;
        let spans = determinant > LEAST_DETERMINANT * n * xx * yy;
        let inverse = match spans {
            true => [a, b, c, n * yy - y * y, x * y - n * xy, n * xx - x * x]
                .map(|minor| minor / determinant),
            false => [0.0; 6],
        };
        Self { inverse }
    }

    /// The least-squares plane of values with these moments.
    #[inline(always)]
    fn solve(&self, [p, q, r]: [f64; 3]) -> Plane {
        let [a, b, c, d, e, f] = self.inverse;
        [a * p + b * q + c * r, b * p + d * q + e * r, c * p + e * q + f * r]
    }

    /// How much less the sum of squares is without that plane.
    #[inline(always)]
    fn gain(&self, moments: [f64; 3]) -> f64 {
        let plane = self.solve(moments);
        plane[0] * moments[0] + plane[1] * moments[1] + plane[2] * moments[2]
    }
}
