//! The patches of a level and their samples: vertices whose positions are compared with exemplars. Some of the samples move.

use maquette_base::topology::lists::Lists;
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::surface::{Marks, NONE, Surface};

/// The radii and distances that determine the patches of a level.
#[derive(Clone, Copy)]
pub(super) struct Scale {
    /// The radius of a patch.
    pub(super) radius: f64,
    /// The distance between samples; if 0, all vertices are samples.
    pub(super) spacing: f64,
    /// The distance between samples that move; if 0, all vertices of the fill are samples and move.
    pub(super) moving: f64,
    /// The radius within which normals are averaged for the normal at a sample.
    pub(super) normal_radius: f64,
}

/// The samples in and around the holes, and the patches around some of the samples; chosen at the beginning of a level.
pub(super) struct Patches {
    /// The vertex of each sample: first the samples that move, then input vertices that are the center of a patch, then other input
    /// vertices.
    pub(super) sites: Vec<u32>,
    /// The number of samples that move.
    pub(super) movable: usize,
    /// For each patch, its samples, the farthest first. Samples far from the center differ most, so most comparisons end early.
    pub(super) members: Lists,
    /// For each entry of `members`, the index of the patch that it belongs to.
    pub(super) centers: Vec<u32>,
    /// For each sample that moves, the entries of `members` that contain it.
    pub(super) entries: Lists,
    /// For each patch, the patches with the nearest centers.
    pub(super) near: Lists,
    /// For each sample, the vertices whose area vectors are summed to get its normal.
    neighborhoods: Lists,
}

/// Maximum number of nearest centers that are listed for a patch.
const MAX_NEIGHBORS: usize = 6;

impl Patches {
    /// Chooses samples among the fill's vertices, whose indices begin at `data`, and among the input vertices that a patch around one of
    /// them can contain. `distances` has, for each input vertex, the distance to the nearest vertex of the fill.
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
        // A sample is the center of a patch if the patch contains a vertex of the fill.
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
            // Skip the nearest center: it is that of the patch itself.
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

    /// Returns the number of patches. Patch `k` has its center at sample `k`.
    pub(super) fn len(&self) -> usize {
        self.members.len()
    }

    /// Returns the normal at each sample: the mean over the surrounding surface.
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

/// Returns, for each vertex in `centers`, the vertices within a radius of it; see [`Surface::ball`].
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

/// Returns a subset of the vertices that are at least `spacing` apart, chosen in the given order; all vertices if `spacing` is 0.
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
