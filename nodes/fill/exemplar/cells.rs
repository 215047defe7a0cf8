//! Divides the vertices of a fill into cells; all vertices of a cell copy from one exemplar (a patch of the input surface).

use nalgebra::Point3;

use super::level::Outcome;
use super::patches::thin;
use super::surface::{NONE, Surface};

/// Minimum distance between the centers of cells, in edge lengths of the input mesh. In smaller cells, the detail copied to neighboring
/// vertices does not fit together. In larger cells, vertices copy far from the center of a patch, where the exemplar fits least.
const MIN_DISTANCE: f64 = 2.5;

/// Returns, for each vertex of the fill, the index of the patch whose exemplar the vertex copies: the patch at the center of the vertex's
/// cell. Cell centers are the patches with the best matches, so that neighboring vertices copy from one exemplar. [`NONE`] for a vertex
/// without a match.
pub(super) fn cells(
    surface: &Surface<'_>,
    points: &[Point3<f64>],
    data: usize,
    outcome: &Outcome,
    edge: f64,
) -> Vec<u32> {
    let Outcome { patches, matches, .. } = outcome;
    let mut centers: Vec<u32> = (0..patches.movable as u32)
        .filter(|&center| matches[center as usize].exemplar != NONE)
        .collect();
    centers.sort_by(|&a, &b| {
        matches[a as usize].ssd.total_cmp(&matches[b as usize].ssd).then(a.cmp(&b))
    });
    let vertices = centers.iter().map(|&center| patches.sites[center as usize]);
    let middles = thin(surface, points, vertices, MIN_DISTANCE * edge);
    let mut index_of = vec![NONE; points.len()];
    (0..).zip(&patches.sites).for_each(|(site, &vertex)| index_of[vertex as usize] = site);
    let nearest = surface.nearest(points, middles.into_iter(), f64::INFINITY);
    nearest[data..]
        .iter()
        .map(|&middle| if middle == NONE { NONE } else { index_of[middle as usize] })
        .collect()
}
