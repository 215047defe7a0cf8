//! Membranes, thin plates and fans, from which fills are made.

use maquette_node::{CancelledError, Progress};
use nalgebra::{Point3, Vector3};

use super::fairing::{Energy, fair};
use super::sizes::Sizes;
use crate::border::rim::Rim;
use crate::triangles::density::{RefineError, refine};
use crate::triangles::triangulate::triangulate;
use crate::triangles::triangulation::Triangulation;

/// Maximum distance of a fill from the centroid of the rim, divided by the maximum distance of the rim from its centroid. This limit admits
/// the fill of a ball whose opening is smaller than a tenth of its width. It rejects a plate that diverges because of a rough rim.
const MAX_REACH: f64 = 2.5;

/// Ratio of the edge length of the coarse shape, which is computed first, to the final edge length. The coarse shape is found fast and
/// determines where vertices are added.
const COARSE_RATIO: f64 = 2.0;

/// Number of times the equations of the coarse plate are solved, each time with the previous shape as rest shape. After one solve, the
/// shape is still close to the membrane from which it starts, and fills of rugged holes are 10 % worse. A third solve changes most fills by
/// 1 to 2 %.
const COARSE_ROUNDS: usize = 2;

/// Moves the vertices of a fill to a membrane and adapts their density, first on a coarse level and then on the final one. The coarse shape
/// determines the distances between the vertices of the final one.
pub(crate) fn membrane(
    triangulation: &mut Triangulation,
    rim: &Rim,
    sizes: &Sizes,
    progress: &Progress<'_>,
) -> Result<(), RefineError> {
    for (times, done) in [(COARSE_RATIO, 0.0), (1.0, 0.3)] {
        progress.tick(done)?;
        refine(triangulation, |point| times * sizes.length_at(point), progress)?;
        fair(triangulation, rim, Energy::Membrane, progress)?;
    }
    Ok(())
}

/// Moves the vertices of a fill to a thin plate and adapts their density. The bulge of a plate depends on its rest shape, the surface for
/// which the equations are set up. A rim does not show whether the curvature of the surrounding surface continues beyond it or fades.
/// Therefore the rest shape is the mean of two extremes, both computed on the coarse level: a membrane, which does not bulge, and a plate
/// whose rest shape is the plate itself, which bulges most. On round surfaces, a plate with the membrane as rest shape is up to twice as
/// far from the true surface; on others, a plate with the second rest shape is. The fine plate is computed once, with the mean of both.
pub(crate) fn plate(
    triangulation: &mut Triangulation,
    rim: &Rim,
    sizes: &Sizes,
    progress: &Progress<'_>,
) -> Result<(), RefineError> {
    let coarse = |point| COARSE_RATIO * sizes.length_at(point);
    refine(triangulation, coarse, progress)?;
    // Fair as a membrane, which removes folds of triangles between rim vertices.
    fair(triangulation, rim, Energy::Membrane, progress)?;
    refine(triangulation, coarse, progress)?;
    progress.tick(0.1)?;
    set_rest_shape(triangulation, rim, progress)?;
    progress.tick(0.2)?;
    refine(triangulation, |point| sizes.length_at(point), progress)?;
    progress.tick(0.5)?;
    fair(triangulation, rim, Energy::EvenPlate, progress)?;
    Ok(())
}

/// Moves the vertices of a fill to the rest shape of a plate: the mean of a membrane and a full plate, see [`plate`].
fn set_rest_shape(
    triangulation: &mut Triangulation,
    rim: &Rim,
    progress: &Progress<'_>,
) -> Result<(), CancelledError> {
    for _ in 0..COARSE_ROUNDS {
        fair(triangulation, rim, Energy::ThinPlate, progress)?;
    }
    let fullest = triangulation.points.clone();
    fair(triangulation, rim, Energy::Membrane, progress)?;
    for (point, full) in triangulation.points.iter_mut().zip(&fullest) {
        *point = nalgebra::center(point, full);
    }
    Ok(())
}

/// Moves the vertices of a fill to a thin plate and keeps its triangles.
///
/// # Errors
/// Returns an error if the evaluation is cancelled.
pub(crate) fn fair_as_plate(
    triangulation: &mut Triangulation,
    rim: &Rim,
    progress: &Progress<'_>,
) -> Result<(), CancelledError> {
    set_rest_shape(triangulation, rim, progress)?;
    fair(triangulation, rim, Energy::EvenPlate, progress)?;
    Ok(())
}

pub(crate) fn goes_too_far(triangulation: &Triangulation, rim: &Rim) -> bool {
    let centroid = centroid(rim);
    fn farthest(points: &[Point3<f64>], centroid: Point3<f64>) -> f64 {
        points.iter().map(|point| (point - centroid).norm()).fold(0.0, f64::max)
    }
    farthest(&triangulation.points, centroid) > MAX_REACH * farthest(&rim.points, centroid)
}

fn centroid(rim: &Rim) -> Point3<f64> {
    let sum: Vector3<f64> = rim.points.iter().map(|point| point.coords).sum();
    Point3::from(sum / rim.len() as f64)
}

/// Returns the minimum-weight triangulation of the rim, or a fan if every triangulation has an edge that the mesh already has.
pub(crate) fn min_weight_or_fan(rim: &Rim) -> Triangulation {
    let faces = triangulate(&rim.points, &rim.normals, &|a, b| rim.is_taken(a, b));
    faces.map_or_else(
        || fan(rim, false),
        |faces| Triangulation::new(rim.points.clone(), rim.len(), &faces),
    )
}

/// Returns a triangle fan around the centroid of the rim. If `halved` is true, each edge to the centroid is divided at its midpoint.
pub(crate) fn fan(rim: &Rim, halved: bool) -> Triangulation {
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
