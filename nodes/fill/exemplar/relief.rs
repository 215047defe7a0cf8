//! Measures the relief of a surface: the amplitude of short waves.

use maquette_base::topology::lists::Lists;
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::hole::Hole;
use super::surface::{NONE, Surface};
use super::surroundings::Surroundings;

/// The numbers of smoothing steps that separate waves from the surface beneath them: waves up to about 6 and 10 edges long.
const SCALES: [usize; 2] = [4, 10];

/// Fraction of the surroundings of a hole whose relief is at most the relief of the hole. With 1/2, grooves between bricks would not count;
/// with a larger value, a rough patch at one side of the hole would.
const QUANTILE: f64 = 0.75;

/// Number of sectors around a hole.
const SECTORS: usize = 8;

/// The relief around holes and in their fills, for each scale.
pub(super) struct Relief {
    /// For each vertex of the mesh, its index in `heights`; [`NONE`] far from holes.
    index_of: Vec<u32>,
    /// For each scale, the absolute heights of the waves.
    heights: [Vec<f64>; SCALES.len()],
}

impl Relief {
    pub(super) fn new(
        surface: &Surface<'_>,
        points: &[Point3<f64>],
        hole: &Hole,
        around: &Surroundings,
    ) -> Self {
        let data = points.len() - hole.numbers.len();
        let margin = (2 * SCALES[SCALES.len() - 1]) as f64 * hole.edge;
        let mut part = around.weighted_or_within(margin);
        part.extend(data as u32..points.len() as u32);
        let mut index_of = vec![NONE; points.len()];
        (0..).zip(&part).for_each(|(k, &vertex)| index_of[vertex as usize] = k);
        let rings = Lists::collect(part.iter().map(|&vertex| -> Vec<u32> {
            let ring = surface.ring(vertex).iter().map(|&other| index_of[other as usize]);
            ring.filter(|&other| other != NONE).collect()
        }));
        let positions: Vec<Vector3<f64>> =
            part.iter().map(|&vertex| points[vertex as usize].coords).collect();
        let normals: Vec<Vector3<f64>> = (part.par_iter().with_min_len(512))
            .map(|&vertex| mean_normal(surface, points, vertex))
            .collect();
        let heights = SCALES.map(|steps| {
            let smooth = smooth(&positions, &rings, steps);
            let over: Vec<Vector3<f64>> = (0..part.len())
                .map(|k: usize| Vector3::x() * (positions[k] - smooth[k]).dot(&normals[k]))
                .collect();
            // Smoothing also flattens the curved surface beneath the waves, evenly: subtract the mean.
            let beneath = self::smooth(&over, &rings, steps);
            over.iter().zip(beneath).map(|(over, beneath)| (over.x - beneath.x).abs()).collect()
        });
        Self { index_of, heights }
    }

    /// Returns the relief that the surroundings of a hole have and its `fill` lacks, as an amplitude: the maximum over all scales. It is
    /// also measured in sectors around the hole, and at most their median counts: an ear or an edge at one side of a hole is not a relief.
    pub(super) fn lost(
        &self,
        surface: &Surface<'_>,
        points: &[Point3<f64>],
        around: &Surroundings,
        hole: usize,
        fill: &[u32],
    ) -> f64 {
        let directions = Directions::new(surface, points, fill);
        let lost = self.heights.iter().map(|heights| {
            let height = |vertex: u32| heights[self.index_of[vertex as usize] as usize];
            let mut sectors = vec![Vec::new(); SECTORS];
            for near in around.weighted(hole) {
                let sector = directions.sector(&points[near.vertex as usize]);
                sectors[sector].push((height(near.vertex), near.weight));
            }
            sectors.retain(|sector| !sector.is_empty());
            let mut goals: Vec<f64> = sectors.into_iter().map(quantile).collect();
            goals.sort_by(f64::total_cmp);
            let median = goals.get(goals.len() / 2).copied().unwrap_or(0.0);
            let all = around.weighted(hole).map(|near| (height(near.vertex), near.weight));
            let goal = median.min(quantile(all.collect()));
            let own = fill.iter().map(|&vertex| (height(vertex), 1.0));
            goal - quantile(own.collect())
        });
        lost.fold(0.0, f64::max)
    }
}

/// The directions around a hole, as angles in the plane that its fill is nearly parallel to.
struct Directions {
    center: Point3<f64>,
    axes: [Vector3<f64>; 2],
}

impl Directions {
    fn new(surface: &Surface<'_>, points: &[Point3<f64>], fill: &[u32]) -> Self {
        let sum: Vector3<f64> = fill.iter().map(|&vertex| points[vertex as usize].coords).sum();
        let area: Vector3<f64> = fill.iter().map(|&vertex| surface.area(points, vertex)).sum();
        let normal = area.try_normalize(0.0).unwrap_or(Vector3::z());
        let across = normal.cross(&Vector3::ith(normal.iamin(), 1.0)).normalize();
        let center = Point3::from(sum / fill.len().max(1) as f64);
        Self { center, axes: [across, normal.cross(&across)] }
    }

    /// Returns the number of the sector that contains a point.
    fn sector(&self, point: &Point3<f64>) -> usize {
        let [x, y] = self.axes.map(|axis| axis.dot(&(point - self.center)));
        let turn = libm::atan2(y, x) / std::f64::consts::TAU + 0.5;
        ((turn * SECTORS as f64) as usize).min(SECTORS - 1)
    }
}

/// Returns the mean normal of a vertex and its neighbors; the normal of one vertex follows its own roughness.
fn mean_normal(surface: &Surface<'_>, points: &[Point3<f64>], vertex: u32) -> Vector3<f64> {
    let ring = surface.ring(vertex).iter().chain([&vertex]);
    let sum: Vector3<f64> = ring.map(|&other| surface.area(points, other)).sum();
    sum.try_normalize(0.0).unwrap_or_default()
}

/// Returns the [`QUANTILE`] of weighted numbers; 0 if there are none.
fn quantile(mut weighted: Vec<(f64, f64)>) -> f64 {
    weighted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let limit = QUANTILE * weighted.iter().map(|(_, weight)| weight).sum::<f64>();
    let mut sum = 0.0;
    let found = weighted.iter().find(|(_, weight)| {
        sum += weight;
        sum >= limit
    });
    found.map_or(0.0, |(number, _)| *number)
}

/// Moves points halfway to the mean of their neighbors, `steps` times.
pub(super) fn smooth(points: &[Vector3<f64>], rings: &Lists, steps: usize) -> Vec<Vector3<f64>> {
    let mut smooth = points.to_vec();
    for _ in 0..steps {
        smooth = (0..smooth.len())
            .into_par_iter()
            .with_min_len(512)
            .map(|k: usize| {
                let ring = rings.list(k);
                let sum: Vector3<f64> = ring.iter().map(|&j| smooth[j as usize] - smooth[k]).sum();
                smooth[k] + sum / (2.0 * ring.len().max(1) as f64)
            })
            .collect();
    }
    smooth
}
