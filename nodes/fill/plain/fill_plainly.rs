//! Fills a hole without looking for examples: flat, as a membrane, or as a thin plate.

use maquette::Progress;
use nalgebra::{Point3, Vector3};

use super::fairing::{Energy, fair};
use super::plug::{Doubt, Plug};
use super::sizes::Sizes;
use crate::fill::border::rim::Rim;
use crate::fill::creases::sharpen;
use crate::fill::triangles::density::{Stop, refine};
use crate::fill::triangles::filling::Filling;
use crate::fill::triangles::patch::Patch;
use crate::fill::triangles::triangulation::triangulate;

/// What a hole is filled with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Plain {
    Flat,
    Membrane,
    ThinPlate,
    CreaseAware,
    /// As `CreaseAware` where creases are certain, else as `ThinPlate`: nobody asked for them.
    PlateOrCreases,
    /// A fan around the middle of the rim, as in the published completion.
    Centroid,
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
pub(crate) fn fill(
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
        match sharpen::sharpen(filling, &patch, rim, &sizes, progress)? {
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
