//! The patches of a level: the compared points (samples), some of which move.

use maquette_base::topology::lists::Lists;
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::surface::{Marks, NONE, Surface};

/// The lengths that determine the patches of a level.
#[derive(Clone, Copy)]
pub(super) struct Scale {
    /// The radius of a patch.
    pub(super) radius: f64,
    /// The distance between samples; if 0, all vertices are samples.
    pub(super) spacing: f64,
    /// The distance between samples that move; if 0, all missing vertices move.
    pub(super) moving: f64,
    /// The radius within which normals are averaged for the normal at a sample.
    pub(super) normal_radius: f64,
}

/// The samples near the missing part, and the patches around some of them; chosen at the beginning of a level.
pub(super) struct Patches {
    /// The vertices of the samples: first the samples that move, then data with a patch, then other data.
    pub(super) sites: Vec<u32>,
    /// The number of samples that move.
    pub(super) movable: usize,
    /// The samples in each patch, the farthest first: far samples differ most, so most comparisons end early.
    pub(super) members: Lists,
    /// For each entry of `members`, the center of its patch.
    pub(super) centers: Vec<u32>,
    /// For each movable sample, its entries in `members`.
    pub(super) entries: Lists,
    /// For each center, the adjacent centers.
    pub(super) near: Lists,
    /// For each sample, the vertices whose area vectors are summed for its normal.
    neighborhoods: Lists,
}

/// Maximum number of adjacent centers that are listed for a center.
const MAX_NEIGHBORS: usize = 6;

impl Patches {
    /// Chooses samples among the missing vertices, which are those from `data` on, and among the data vertices that a patch around a
    /// missing vertex can contain. `distances` has, for each data vertex, the distance to the nearest missing vertex.
    pub(super) fn new(
        surface: &Surface<'_>,
        points: &[Point3<f64>],
        data: usize,
        distances: &[f64],
        scale: &Scale,
    ) -> Self {
        let count = points.len();
        let movable = thin(surface, points, data as u32..count as u32, scale.moving);
        let close = (0..data as u32).filter(|&v| distances[v as usize] <= 2.0 * scale.radius);
        let fixed = thin(surface, points, close, scale.spacing);
        // A sample is the center of a patch if the patch contains a missing vertex.
        let (inside, outside): (Vec<u32>, Vec<u32>) =
            fixed.into_iter().partition(|&v| distances[v as usize] <= scale.radius);
        let mut patches = balls(surface, points, &movable, scale.radius);
        let mut sites = movable.clone();
        let mut blind = Vec::new();
        for (vertex, ball) in inside.iter().zip(balls(surface, points, &inside, scale.radius)) {
            if ball.iter().any(|&other| data <= other as usize) {
                sites.push(*vertex);
                patches.push(ball);
            } else {
                blind.push(*vertex);
            }
        }
        sites.extend(blind);
        sites.extend(outside);
        let mut index_of = vec![NONE; count];
        (0..).zip(&sites).for_each(|(site, &vertex)| index_of[vertex as usize] = site);
        for patch in &mut patches {
            let center = points[patch[0] as usize];
            let mut keyed: Vec<(f64, u32)> = patch
                .iter()
                .filter(|&&vertex| index_of[vertex as usize] != NONE)
                .map(|&v| ((points[v as usize] - center).norm_squared(), index_of[v as usize]))
                .collect();
            keyed.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            *patch = keyed.into_iter().map(|(_, site)| site).collect();
        }
        let near = Lists::collect(patches.iter().map(|patch| -> Vec<u32> {
            let centers = patch.iter().rev().filter(|&&site| (site as usize) < patches.len());
            // The nearest center is the sample itself and is skipped.
            centers.skip(1).take(MAX_NEIGHBORS).copied().collect()
        }));
        let members = Lists::collect(patches.iter());
        let centers: Vec<u32> = (0..members.len() as u32)
            .flat_map(|center| members.range(center as usize).map(move |_| center))
            .collect();
        let moves = movable.len();
        let entries = Lists::group(moves, || {
            let pairs = members.items().iter().copied().zip(0..);
            pairs.filter(|&(site, _)| (site as usize) < moves)
        });
        let neighborhoods =
            Lists::collect(balls(surface, points, &sites, scale.normal_radius).into_iter());
        Self { sites, movable: moves, members, centers, entries, near, neighborhoods }
    }

    /// The number of patches; the first samples are their centers.
    pub(super) fn len(&self) -> usize {
        self.members.len()
    }

    /// Returns the normal at each sample: the mean over the surface around it.
    pub(super) fn normals(&self, areas: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        (0..self.sites.len())
            .into_par_iter()
            .with_min_len(64)
            .map(|site: usize| {
                let sum: Vector3<f64> = self
                    .neighborhoods
                    .list(site)
                    .iter()
                    .map(|&vertex| areas[vertex as usize])
                    .sum();
                sum.try_normalize(0.0).unwrap_or(Vector3::z())
            })
            .collect()
    }
}

/// Returns the vertices within a radius of each of some vertices; see [`Surface::ball`].
fn balls(
    surface: &Surface<'_>,
    points: &[Point3<f64>],
    centers: &[u32],
    radius: f64,
) -> Vec<Vec<u32>> {
    centers
        .par_iter()
        .with_min_len(16)
        .map_init(
            || Marks::new(points.len()),
            |marks, &center| surface.ball(points, center, radius, |_| true, marks),
        )
        .collect()
}

/// Returns a subset of the vertices that are at least `spacing` apart, chosen in their order; all vertices if `spacing` is 0.
pub(super) fn thin(
    surface: &Surface<'_>,
    points: &[Point3<f64>],
    vertices: impl Iterator<Item = u32>,
    spacing: f64,
) -> Vec<u32> {
    if spacing == 0.0 {
        return vertices.collect();
    }
    let all: Vec<u32> = vertices.collect();
    let mut left = vec![false; points.len()];
    all.iter().for_each(|&vertex| left[vertex as usize] = true);
    let mut marks = Marks::new(points.len());
    let mut chosen = Vec::new();
    for vertex in all {
        if left[vertex as usize] {
            chosen.push(vertex);
            for other in surface.ball(points, vertex, spacing, |_| true, &mut marks) {
                left[other as usize] = false;
            }
        }
    }
    chosen
}
