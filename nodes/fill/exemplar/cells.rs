//! Which exemplar each missing vertex copies.

use nalgebra::Point3;

use super::level::Outcome;
use super::patches::thin;
use super::surface::{NONE, Surface};

/// How far the middles of cells are apart, in edges of the data. In smaller ones each vertex has its own neighbors' detail against it, in
/// larger ones vertices copy what lies far from the middle of a patch, where it fits least.
const APART: f64 = 2.5;

/// For each missing vertex, from the first after the `data` on, the patch whose exemplar it copies: that in the middle of its cell. Cells
/// are around the patches that are most like their exemplars, so that neighboring vertices copy from one place. [`NONE`] where there is no
/// match.
pub(super) fn cells(
    surface: &Surface<'_>,
    points: &[Point3<f64>],
    data: usize,
    outcome: &Outcome,
    edge: f64,
) -> Vec<u32> {
    let Outcome { patches, matches, .. } = outcome;
    fn ssd(center: u32, matches: &[crate::exemplar::best_match::Match]) -> f64 {
        matches[center as usize].ssd
    }
    let mut centers: Vec<u32> = (0..patches.movable as u32)
        .filter(|&center| matches[center as usize].exemplar != NONE)
        .collect();
    centers.sort_by(|&a, &b| ssd(a, matches).total_cmp(&ssd(b, matches)).then(a.cmp(&b)));
    let vertices = centers.iter().map(|&center| patches.sites[center as usize]);
    let middles = thin(surface, points, vertices, APART * edge);
    let mut place = vec![NONE; points.len()];
    (0..).zip(&patches.sites).for_each(|(site, &vertex)| place[vertex as usize] = site);
    let nearest = surface.nearest(points, middles.into_iter(), f64::INFINITY);
    nearest[data..]
        .iter()
        .map(|&middle| if middle == NONE { NONE } else { place[middle as usize] })
        .collect()
}
