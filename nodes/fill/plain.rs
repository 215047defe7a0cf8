//! Fills a hole without looking for examples: flat, as a membrane, or as a thin plate.

use maquette::Progress;
use nalgebra::{Point3, Vector3};

use super::creases;
use super::density::{Stop, TRIANGLES, estimate, refine};
use super::fairing::{Energy, fair};
use super::filling::Filling;
use super::patch::Patch;
use super::rim::Rim;
use super::triangulation::triangulate;

/// What a hole is filled with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Plain {
    Flat,
    Membrane,
    ThinPlate,
    CreaseAware,
    /// As `CreaseAware` where creases are certain, else as `ThinPlate`: nobody asked for them.
    PlateOrCreases,
    /// A fan around the middle of the rim, as in the published completion.
    Centroid,
}

/// What was not done as asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Doubt {
    /// A thin plate would have gone too far, and a membrane is there instead.
    Membrane,
    /// No creases end at the rim, or they do not meet.
    NoCreases,
    /// It would have run through something, and another surface is there instead.
    Calm,
}

/// A hole's filling.
#[derive(Clone)]
pub(super) struct Plug {
    pub(super) patch: Patch,
    pub(super) doubt: Option<Doubt>,
    /// Whether creases of the data go on in it.
    pub(super) is_sharp: bool,
}

/// How far a filling may go from the middle of the rim, in the largest distance of the rim from there. A ball's opening of less than a
/// tenth of its width is still filled; a plate that a rough rim throws off is not.
const FARTHEST: f64 = 2.5;

/// Edges of a rim over which creases go on unasked.
const LEAST_RIM: usize = 16;

/// Edges in the first, coarse shape, in those of the end: the coarse one is found fast, and then vertices are added where they belong.
const COARSE: f64 = 2.0;

/// How often the coarse plate is bent over the shape that it has. After one time it still has too much of the membrane before it, and
/// rugged holes are filled a tenth worse; a third time changes most fills by a hundredth or two.
const COARSE_ROUNDS: usize = 2;

/// Fills one hole, with edges as long as `edge`, or as the data's at the rim.
///
/// # Errors
/// If it would have too many triangles, or the evaluation is told to stop.
pub(super) fn fill(
    filling: &Filling,
    rim: &Rim,
    plain: Plain,
    edge: Option<f64>,
    progress: &Progress<'_>,
) -> Result<Plug, Stop> {
    progress.tick(0.0)?;
    let sizes = Sizes::new(rim, edge);
    let mut patch = match plain {
        Plain::Centroid => fan(rim, true),
        _ => covered(rim),
    };
    sizes.check(&patch)?;
    let mut doubt = None;
    match plain {
        Plain::Flat | Plain::Centroid => refine(&mut patch, |point| sizes.at(point), progress)?,
        Plain::Membrane => membrane(&mut patch, rim, &sizes, progress)?,
        Plain::ThinPlate | Plain::CreaseAware | Plain::PlateOrCreases => {
            let start = patch.clone();
            plate(&mut patch, rim, &sizes, progress)?;
            if goes_too_far(&patch, rim) {
                doubt = Some(Doubt::Membrane);
                patch = start;
                membrane(&mut patch, rim, &sizes, progress)?;
            }
        }
    }
    // A rim that is too rough for a plate, or has few edges, has creases by chance.
    let is_certain = || doubt.is_none() && LEAST_RIM <= rim.len();
    let is_asked = plain == Plain::CreaseAware;
    if is_asked || plain == Plain::PlateOrCreases && is_certain() {
        match creases::sharpen(filling, &patch, rim, &sizes, progress)? {
            Some(sharp) => return Ok(Plug { patch: sharp, doubt: None, is_sharp: true }),
            None if is_asked => doubt = doubt.or(Some(Doubt::NoCreases)),
            None => {}
        }
    }
    Ok(Plug { patch, doubt, is_sharp: false })
}

/// Finds a shape and a density that fit each other: a coarse one of both, of which the shape says how far vertices are apart, then the
/// fine one.
fn membrane(
    patch: &mut Patch,
    rim: &Rim,
    sizes: &Sizes,
    progress: &Progress<'_>,
) -> Result<(), Stop> {
    for (times, done) in [(COARSE, 0.0), (1.0, 0.3)] {
        progress.tick(done)?;
        refine(patch, |point| times * sizes.at(point), progress)?;
        fair(patch, rim, Energy::Membrane, progress)?;
    }
    Ok(())
}

/// As [`membrane`], as a plate. How far it bulges depends on the surface over which it is bent and on whose curvature goes on, and a rim
/// does not tell whether the data's curvature goes on behind it or fades. So it is bent over the surface half-way between the two
/// extremes, which are found on the coarse level: a membrane, which does not bulge at all, and a plate over its own shape, the fullest.
/// Over a flat surface plates are up to twice as far off where data go on round; over its own shape, a plate is so where they do not.
fn plate(patch: &mut Patch, rim: &Rim, sizes: &Sizes, progress: &Progress<'_>) -> Result<(), Stop> {
    let coarse = |point| COARSE * sizes.at(point);
    refine(patch, coarse, progress)?;
    // Without the folds that triangles from rim to rim have.
    fair(patch, rim, Energy::Membrane, progress)?;
    refine(patch, coarse, progress)?;
    progress.tick(0.1)?;
    for _ in 0..COARSE_ROUNDS {
        fair(patch, rim, Energy::ThinPlate, progress)?;
    }
    let fullest = patch.points.clone();
    fair(patch, rim, Energy::Membrane, progress)?;
    for (point, full) in patch.points.iter_mut().zip(&fullest) {
        *point = nalgebra::center(point, full);
    }
    progress.tick(0.2)?;
    refine(patch, |point| sizes.at(point), progress)?;
    progress.tick(0.5)?;
    fair(patch, rim, Energy::EvenPlate, progress)?;
    Ok(())
}

fn goes_too_far(patch: &Patch, rim: &Rim) -> bool {
    let middle = middle(rim);
    let farthest = |points: &[Point3<f64>]| {
        points.iter().map(|point| (point - middle).norm()).fold(0.0, f64::max)
    };
    farthest(&patch.points) > FARTHEST * farthest(&rim.points)
}

fn middle(rim: &Rim) -> Point3<f64> {
    let sum: Vector3<f64> = rim.points.iter().map(|point| point.coords).sum();
    Point3::from(sum / rim.len() as f64)
}

/// The triangles that bend least; if the mesh has all edges that they could have, a fan.
fn covered(rim: &Rim) -> Patch {
    let faces = triangulate(&rim.points, &rim.normals, &|a, b| rim.is_taken(a, b));
    faces.map_or_else(|| fan(rim, false), |faces| Patch::new(rim.points.clone(), rim.len(), &faces))
}

/// A fan around the middle of the rim; with a vertex half-way on each of its edges, if so wanted.
fn fan(rim: &Rim, halved: bool) -> Patch {
    let count = rim.len() as u32;
    let mut points = rim.points.clone();
    points.push(middle(rim));
    let around = (0..count).map(|k| (k, (k + 1) % count));
    let faces: Vec<[u32; 3]> = if halved {
        let hub = middle(rim);
        points.extend(rim.points.iter().map(|point| nalgebra::center(point, &hub)));
        let half = |k: u32| count + 1 + k;
        around
            .flat_map(|(a, b)| [[a, b, half(b)], [a, half(b), half(a)], [half(a), half(b), count]])
            .collect()
    } else {
        around.map(|(a, b)| [a, b, count]).collect()
    };
    Patch::new(points, rim.len(), &faces)
}

/// How long edges should be: as those of the data at the rim, the nearer the more.
pub(super) struct Sizes {
    /// Places on the rim, by coordinate; behind them infinite ones up to a multiple of [`LANES`], which weigh nothing.
    places: [Vec<f64>; 3],
    /// How long edges are there.
    lengths: Vec<f64>,
}

/// So many times triangles are looked at closer to estimate their number: some milliseconds.
const LOOKS: usize = 50_000;

/// So many parts of the rim are told apart at most: a multiple of [`LANES`].
const MOST_SAMPLES: usize = 128;

/// Sums that run side by side.
const LANES: usize = 4;

impl Sizes {
    pub(super) fn new(rim: &Rim, edge: Option<f64>) -> Self {
        if let Some(edge) = edge {
            return Self::of(&[Point3::origin()], vec![edge]);
        }
        let chunk = rim.len().div_ceil(MOST_SAMPLES).max(1);
        let middles = rim.points.chunks(chunk).map(|points| points[points.len() / 2]);
        let middles: Vec<Point3<f64>> = middles.collect();
        let mean = |lengths: &[f64]| lengths.iter().sum::<f64>() / lengths.len() as f64;
        Self::of(&middles, rim.lengths.chunks(chunk).map(mean).collect())
    }

    fn of(places: &[Point3<f64>], mut lengths: Vec<f64>) -> Self {
        let count = places.len().next_multiple_of(LANES);
        lengths.resize(count, 0.0);
        let places = [0, 1, 2].map(|axis| {
            let mut places: Vec<f64> = places.iter().map(|place| place[axis]).collect();
            places.resize(count, f64::INFINITY);
            places
        });
        Self { places, lengths }
    }

    /// # Errors
    /// If there would be too many triangles.
    fn check(&self, patch: &Patch) -> Result<(), Stop> {
        // Nowhere are edges shorter than where they are shortest at the rim: nearly always that says enough.
        let lengths = self.lengths.iter().copied().filter(|length| *length > 0.0);
        let shortest = lengths.fold(f64::INFINITY, f64::min);
        if estimate(patch, |_| shortest, 0) <= TRIANGLES.most as f64 {
            return Ok(());
        }
        let need = estimate(patch, |point| self.at(point), LOOKS);
        if need <= TRIANGLES.most as f64 { Ok(()) } else { Err(Stop::TooMany(need)) }
    }

    /// The length of edges at a point.
    pub(super) fn at(&self, point: Point3<f64>) -> f64 {
        let count = self.lengths.len();
        let [x, y, z] = [0, 1, 2].map(|axis| &self.places[axis][..count]);
        let mut buffer = [0.0; MOST_SAMPLES];
        let weights = &mut buffer[..count];
        for k in 0..count {
            let [dx, dy, dz] = [point.x - x[k], point.y - y[k], point.z - z[k]];
            let distance_sq = dx * dx + dy * dy + dz * dz;
            weights[k] = 1.0 / (distance_sq * distance_sq);
        }
        let (mut sums, mut totals) = ([0.0; LANES], [0.0; LANES]);
        let of_lanes =
            weights.as_chunks::<LANES>().0.iter().zip(self.lengths.as_chunks::<LANES>().0);
        for (weights, lengths) in of_lanes {
            for k in 0..LANES {
                sums[k] += weights[k] * lengths[k];
                totals[k] += weights[k];
            }
        }
        let total: f64 = totals.iter().sum();
        if total.is_finite() {
            return sums.iter().sum::<f64>() / total;
        }
        let here = weights.iter().position(|weight| weight.is_infinite());
        self.lengths[here.unwrap_or(0)]
    }
}
