//! The patches of a level: which points are compared, and which of them move.

use maquette_base::topology::lists::Lists;
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::surface::{Marks, NONE, Surface};

/// The lengths that the patches of a level have.
#[derive(Clone, Copy)]
pub(super) struct Scale {
    /// The radius of a patch.
    pub(super) radius: f64,
    /// How far samples are apart; all vertices are samples, if 0.
    pub(super) spacing: f64,
    /// The same for those that move.
    pub(super) moving: f64,
    /// The radius within which normals are averaged for the normal at a sample.
    pub(super) normal_radius: f64,
}

/// The samples near what is missing, and the patches around some of them. It is all chosen at the beginning of a level.
pub(super) struct Patches {
    /// The samples' vertices: first those that move, then data with a patch, then other data.
    pub(super) sites: Vec<u32>,
    /// How many of them move.
    pub(super) movable: usize,
    /// The samples in each patch, the farthest first: they differ most, which ends most comparisons early.
    pub(super) members: Lists,
    /// The center of the patch of each entry of all members.
    pub(super) centers: Vec<u32>,
    /// The entries of all members that are each movable sample.
    pub(super) entries: Lists,
    /// The centers next to each center.
    pub(super) near: Lists,
    /// The vertices around each sample whose area vectors are summed for its normal.
    neighborhoods: Lists,
}

/// Centers next to a center.
const NEAR: usize = 6;

impl Patches {
    /// Of the vertices from `data` on, which are missing, and data as far as a patch sees them. `distances` are those of the data
    /// to the nearest missing vertex.
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
        let balls = |vertices: &[u32], radius: f64| -> Vec<Vec<u32>> {
            let ball =
                |marks: &mut Marks, &v: &u32| surface.ball(points, v, radius, |_| true, marks);
            let vertices = vertices.par_iter().with_min_len(16);
            vertices.map_init(|| Marks::new(count), ball).collect()
        };
        // A patch is for samples from which something missing is seen.
        let (inside, outside): (Vec<u32>, Vec<u32>) =
            fixed.into_iter().partition(|&v| distances[v as usize] <= scale.radius);
        let mut patches = balls(&movable, scale.radius);
        let mut sites = movable.clone();
        let mut blind = Vec::new();
        for (vertex, ball) in inside.iter().zip(balls(&inside, scale.radius)) {
            if ball.iter().any(|&other| data <= other as usize) {
                sites.push(*vertex);
                patches.push(ball);
            } else {
                blind.push(*vertex);
            }
        }
        sites.extend(blind);
        sites.extend(outside);
        let mut place = vec![NONE; count];
        (0..).zip(&sites).for_each(|(site, &vertex)| place[vertex as usize] = site);
        for patch in &mut patches {
            let center = points[patch[0] as usize];
            let mut keyed: Vec<(f64, u32)> = patch
                .iter()
                .filter(|&&vertex| place[vertex as usize] != NONE)
                .map(|&v| ((points[v as usize] - center).norm_squared(), place[v as usize]))
                .collect();
            keyed.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            *patch = keyed.into_iter().map(|(_, site)| site).collect();
        }
        let near = Lists::collect(patches.iter().map(|patch| -> Vec<u32> {
            let centers = patch.iter().rev().filter(|&&site| (site as usize) < patches.len());
            // The last is the center itself.
            centers.skip(1).take(NEAR).copied().collect()
        }));
        let members = Lists::collect(patches.iter());
        let centers: Vec<u32> = (0..members.len() as u32)
            .flat_map(|center| members.range(center as usize).map(move |_| center))
            .collect();
        let moves = movable.len();
        let entries = Lists::group(moves, || {
            let pairs = members.all().iter().copied().zip(0..);
            pairs.filter(|&(site, _)| (site as usize) < moves)
        });
        let neighborhoods = Lists::collect(balls(&sites, scale.normal_radius).into_iter());
        Self { sites, movable: moves, members, centers, entries, near, neighborhoods }
    }

    /// The number of patches: the first samples are their centers.
    pub(super) fn len(&self) -> usize {
        self.members.len()
    }

    /// The normal at each sample: the mean over the surface around it.
    pub(super) fn normals(&self, areas: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        (0..self.sites.len())
            .into_par_iter()
            .with_min_len(64)
            .map(|site: usize| {
                let sum: Vector3<f64> =
                    self.neighborhoods.of(site).iter().map(|&vertex| areas[vertex as usize]).sum();
                sum.try_normalize(0.0).unwrap_or(Vector3::z())
            })
            .collect()
    }
}

/// Those of the vertices that are `spacing` apart, each earlier one before the later ones; all, if it is 0.
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
