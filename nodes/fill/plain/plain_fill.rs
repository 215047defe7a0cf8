//! Fills one hole without exemplars: flat, as a membrane, as a thin plate, or with the creases of the data.

use maquette_node::Progress;
use nalgebra::{Point3, Vector3};

use super::fairing::{Energy, fair};
use super::hole_fill::{Fallback, HoleFill};
use super::options::{PlainMethod, PlainOptions};
use super::sizes::Sizes;
use crate::border::rim::Rim;
use crate::creases::sharpen;
use crate::triangles::density::{Stop, refine};
use crate::triangles::filling::Filling;
use crate::triangles::triangulate::triangulate;
use crate::triangles::triangulation::Triangulation;

/// How far a fill may go from the centroid of the rim, in the largest distance of the rim from there. A ball's opening of less than a
/// tenth of its width is still filled; a plate that a rough rim throws off is not.
const FARTHEST: f64 = 2.5;

/// Creases that were not asked for are extended only from rims with at least so many edges.
const LEAST_RIM: usize = 16;

/// Length of the edges of the first, coarse shape in that of the final edges: the coarse shape is found fast, and tells where vertices are
/// added.
const COARSE: f64 = 2.0;

/// How often the equations of the coarse plate are set up anew on the shape that it has. After one time it still has too much of the
/// membrane before it, and rugged holes are filled a tenth worse; a third time changes most fills by a hundredth or two.
const COARSE_ROUNDS: usize = 2;

/// Fills one hole, with edges as long as `edge`, or as the data's at the rim.
///
/// # Errors
/// If it would have too many triangles, or the evaluation is told to stop.
pub(crate) fn fill_hole(
    filling: &Filling,
    rim: &Rim,
    PlainOptions { method, edge }: PlainOptions,
    progress: &Progress<'_>,
) -> Result<HoleFill, Stop> {
    progress.tick(0.0)?;
    let sizes = Sizes::new(rim, edge);
    let mut triangulation = match method {
        PlainMethod::Centroid => fan(rim, true),
        _ => min_weight_or_fan(rim),
    };
    sizes.check(&triangulation)?;
    let mut fallback = None;
    match method {
        PlainMethod::Flat | PlainMethod::Centroid => {
            refine(&mut triangulation, |point| sizes.at(point), progress)?;
        }
        PlainMethod::Membrane => membrane(&mut triangulation, rim, &sizes, progress)?,
        PlainMethod::ThinPlate | PlainMethod::CreaseAware | PlainMethod::PlateOrCreases => {
            let start = triangulation.clone();
            plate(&mut triangulation, rim, &sizes, progress)?;
            if goes_too_far(&triangulation, rim) {
                fallback = Some(Fallback::RoughRim);
                triangulation = start;
                membrane(&mut triangulation, rim, &sizes, progress)?;
            }
        }
    }
    // A rim that is too rough for a plate, or has few edges, may seem to have creases by chance.
    fn are_creases_certain(fallback: &Option<Fallback>, rim: &Rim) -> bool {
        fallback.is_none() && LEAST_RIM <= rim.len()
    }
    let is_asked = method == PlainMethod::CreaseAware;
    if is_asked || method == PlainMethod::PlateOrCreases && are_creases_certain(&fallback, rim) {
        match sharpen::sharpen(filling, &triangulation, rim, &sizes, progress)? {
            Some(sharp) => {
                return Ok(HoleFill { triangulation: sharp, fallback: None, is_sharp: true });
            }
            None if is_asked => fallback = fallback.or(Some(Fallback::NoCreases)),
            None => {}
        }
    }
    Ok(HoleFill { triangulation, fallback, is_sharp: false })
}

/// Finds a shape and a density that fit each other: first both coarse, then both fine. The coarse shape tells how far apart the fine
/// vertices are to be.
fn membrane(
    triangulation: &mut Triangulation,
    rim: &Rim,
    sizes: &Sizes,
    progress: &Progress<'_>,
) -> Result<(), Stop> {
    for (times, done) in [(COARSE, 0.0), (1.0, 0.3)] {
        progress.tick(done)?;
        refine(triangulation, |point| times * sizes.at(point), progress)?;
        fair(triangulation, rim, Energy::Membrane, progress)?;
    }
    Ok(())
}

/// As [`membrane`], as a plate. How far it bulges depends on the rest shape: the surface on which the equations are set up. A rim does not
/// tell whether the data's curvature continues behind it or fades, so the rest shape is the mean of two extremes that are found on the
/// coarse level: a membrane, which does not bulge at all, and a plate whose rest shape is the plate itself, which bulges most. With a flat
/// rest shape, plates are up to twice as far from the truth where the data are round; with the other extreme, where they are not.
/// The fine plate is computed once, over that mean.
fn plate(
    triangulation: &mut Triangulation,
    rim: &Rim,
    sizes: &Sizes,
    progress: &Progress<'_>,
) -> Result<(), Stop> {
    let coarse = |point| COARSE * sizes.at(point);
    refine(triangulation, coarse, progress)?;
    // Removes the folds that triangles from rim to rim have.
    fair(triangulation, rim, Energy::Membrane, progress)?;
    refine(triangulation, coarse, progress)?;
    progress.tick(0.1)?;
    for _ in 0..COARSE_ROUNDS {
        fair(triangulation, rim, Energy::ThinPlate, progress)?;
    }
    let fullest = triangulation.points.clone();
    fair(triangulation, rim, Energy::Membrane, progress)?;
    for (point, full) in triangulation.points.iter_mut().zip(&fullest) {
        *point = nalgebra::center(point, full);
    }
    progress.tick(0.2)?;
    refine(triangulation, |point| sizes.at(point), progress)?;
    progress.tick(0.5)?;
    fair(triangulation, rim, Energy::EvenPlate, progress)?;
    Ok(())
}

fn goes_too_far(triangulation: &Triangulation, rim: &Rim) -> bool {
    let centroid = centroid(rim);
    fn farthest(points: &[Point3<f64>], centroid: Point3<f64>) -> f64 {
        points.iter().map(|point| (point - centroid).norm()).fold(0.0, f64::max)
    }
    farthest(&triangulation.points, centroid) > FARTHEST * farthest(&rim.points, centroid)
}

fn centroid(rim: &Rim) -> Point3<f64> {
    let sum: Vector3<f64> = rim.points.iter().map(|point| point.coords).sum();
    Point3::from(sum / rim.len() as f64)
}

/// The minimum-weight triangulation; a fan if there is none without an edge that the mesh already has.
fn min_weight_or_fan(rim: &Rim) -> Triangulation {
    let faces = triangulate(&rim.points, &rim.normals, &|a, b| rim.is_taken(a, b));
    faces.map_or_else(
        || fan(rim, false),
        |faces| Triangulation::new(rim.points.clone(), rim.len(), &faces),
    )
}

/// A triangle fan around the centroid of the rim; if `halved`, with a vertex in the middle of each edge to the centroid.
fn fan(rim: &Rim, halved: bool) -> Triangulation {
    let count = rim.len() as u32;
    let mut points = rim.points.clone();
    points.push(centroid(rim));
    let edges = (0..count).map(|k| (k, (k + 1) % count));
    let faces: Vec<[u32; 3]> = if halved {
        let hub = centroid(rim);
        points.extend(rim.points.iter().map(|point| nalgebra::center(point, &hub)));
        fn half(k: u32, count: u32) -> u32 {
            count + 1 + k
        }
        edges
            .flat_map(|(a, b)| {
                [
                    [a, b, half(b, count)],
                    [a, half(b, count), half(a, count)],
                    [half(a, count), half(b, count), count],
                ]
            })
            .collect()
    } else {
        edges.map(|(a, b)| [a, b, count]).collect()
    };
    Triangulation::new(points, rim.len(), &faces)
}
