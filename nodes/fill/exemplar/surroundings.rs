//! The vertices around holes, which count less the farther from a hole they are.

use nalgebra::Point3;

use super::hole::Hole;
use super::surface::{NONE, Surface};

/// The distance from a hole at which a vertex counts e times less, in edge lengths of the input mesh and in widths of the hole; the larger
/// one is used.
const FALLOFF_EDGES: f64 = 3.0;
const FALLOFF_WIDTHS: f64 = 0.25;

/// Distance from a hole beyond which vertices do not count, as a multiple of the falloff.
const REACH: f64 = 2.0;

/// Maximum distance from a hole for which [`Surroundings`] know the nearest hole, in widths of the widest hole and in edge lengths of the
/// input mesh; the sum is used.
const KNOWN_WIDTHS: f64 = 1.5;
const KNOWN_EDGES: f64 = 24.0;

/// The input vertices around holes. Distances are measured through space, but only parts that are connected with a hole inside the ball
/// around it count, so that the other side of a thin wall does not.
pub(super) struct Surroundings {
    /// For each hole, the vertices for which it is the nearest hole, ascending.
    holes: Vec<Vec<NearVertex>>,
}

/// An input vertex near a hole.
#[derive(Clone, Copy)]
pub(super) struct NearVertex {
    pub(super) vertex: u32,
    pub(super) distance: f64,
    /// The weight of the vertex: from 1 at the hole down to 0.
    pub(super) weight: f64,
}

impl Surroundings {
    pub(super) fn new(surface: &Surface<'_>, points: &[Point3<f64>], hole: &Hole) -> Self {
        let data = points.len() - hole.numbers.len();
        let reach = KNOWN_WIDTHS * hole.width + KNOWN_EDGES * hole.edge;
        let nearest = surface.nearest(points, data as u32..points.len() as u32, reach);
        let mut holes = vec![Vec::new(); hole.count()];
        for (vertex, &nearest) in nearest[..data].iter().enumerate() {
            if nearest == NONE {
                continue;
            }
            let missing = nearest as usize - data;
            let distance = (points[vertex] - points[nearest as usize]).norm();
            let falloff = (FALLOFF_EDGES * hole.edge).max(FALLOFF_WIDTHS * hole.widths[missing]);
            let relative = distance / falloff;
            let weight = if relative <= REACH { libm::exp(-relative * relative) } else { 0.0 };
            let near = NearVertex { vertex: vertex as u32, distance, weight };
            holes[hole.numbers[missing] as usize].push(near);
        }
        Self { holes }
    }

    /// Returns the vertices around a hole that count.
    pub(super) fn weighted(&self, hole: usize) -> impl Iterator<Item = NearVertex> {
        self.holes[hole].iter().copied().filter(|near| near.weight > 0.0)
    }

    /// Returns the vertices around a hole within a distance, ascending.
    pub(super) fn vertices_within(&self, hole: usize, distance: f64) -> Vec<u32> {
        let near = self.holes[hole].iter().filter(|near| near.distance <= distance);
        near.map(|near| near.vertex).collect()
    }

    /// Returns the vertices around all holes that count or are within a distance, in the order of the holes.
    pub(super) fn weighted_or_within(&self, distance: f64) -> Vec<u32> {
        let near = self.holes.iter().flatten();
        let near = near.filter(|near| near.weight > 0.0 || near.distance <= distance);
        near.map(|near| near.vertex).collect()
    }
}
