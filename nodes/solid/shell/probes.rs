//! Measures a layer: the distance of its back from the surface, and the material behind each face.

use maquette_value::parallel::*;
use maquette_value::{Mesh, TriangleTree};
use nalgebra::{Point3, Vector3, center};

use super::backs::{Backs, Motion};

/// Number of points inside of a triangle at which its distance from the surface is measured.
const PROBES: usize = 4;

/// Distance up to which nearest points are searched, as a multiple of the thickness: what is farther away is far enough. A search within
/// about the distance of the nearest point takes less time.
const REACH: f64 = 1.001;

/// The distance of a point of a moved face from the surface.
#[derive(Clone, Copy)]
pub(super) struct Probe {
    /// In mm; infinite if it is greater than the thickness.
    pub(super) distance: f64,
    /// The cosine of the angle between the point's direction and the way from its nearest point of the surface.
    pub(super) cosine: f64,
}

/// Measurements at points, which are repeated only where a point has moved since the last one.
#[derive(Default)]
struct Measurements {
    points: Vec<Point3<f64>>,
    probes: Vec<Probe>,
}

impl Measurements {
    /// Measures the distances of those points that have moved. Distances above `reach` mm are infinite. `direction` gives the direction of
    /// a point, which must not change between measurements.
    fn update(
        &mut self,
        (mesh, tree): (&Mesh, &TriangleTree),
        reach: f64,
        points: Vec<Point3<f64>>,
        direction: impl Fn(usize) -> Vector3<f64> + Sync,
    ) {
        let (before, now, direction) = (&self.points, &points, &direction);
        let moved: Vec<usize> = (0..points.len())
            .into_par_iter()
            .filter(|&k: &usize| before.get(k) != Some(&now[k]))
            .collect();
        let places: Vec<Point3<f64>> = moved.par_iter().map(|&k| now[k]).collect();
        let nearest = tree.nearest_below(&places, &vec![reach * reach; places.len()]);
        let probes: Vec<Probe> = moved
            .par_iter()
            .zip(&nearest)
            .map(|(&k, nearest)| match nearest {
                Some(nearest) => {
                    let way = now[k] - nearest.position(mesh);
                    let distance = way.norm();
                    let cosine = way.try_normalize(0.0).unwrap_or_default().dot(&direction(k));
                    Probe { distance, cosine }
                }
                None => Probe { distance: f64::INFINITY, cosine: 0.0 },
            })
            .collect();
        self.probes.resize(points.len(), Probe { distance: f64::INFINITY, cosine: 0.0 });
        for (k, probe) in moved.into_iter().zip(probes) {
            self.probes[k] = probe;
        }
        self.points = points;
    }
}

/// The distances of the moved faces from the surface, for motions in the same directions.
pub(super) struct Probes<'a> {
    backs: &'a Backs<'a>,
    tree: &'a TriangleTree,
    reach: f64,
    of_backs: Measurements,
    of_triangles: Measurements,
}

impl<'a> Probes<'a> {
    /// Measures distances up to `thickness` mm. `tree` is the tree of the surface.
    pub(super) fn new(backs: &'a Backs<'a>, tree: &'a TriangleTree, thickness: f64) -> Self {
        let (of_backs, of_triangles) = (Measurements::default(), Measurements::default());
        Self { backs, tree, reach: REACH * thickness, of_backs, of_triangles }
    }

    /// Returns for each back vertex the maximum of `lack` there and, if `vertices_only` is false, at its moved faces.
    pub(super) fn lacks(
        &mut self,
        motion: &Motion,
        lack: impl Fn(&Probe) -> f64,
        vertices_only: bool,
    ) -> Vec<f64> {
        let mut lacks: Vec<f64> = self.at_backs(motion).iter().map(&lack).collect();
        if vertices_only {
            return lacks;
        }
        let backs = self.backs;
        let of_triangles = self.in_triangles(motion).chunks(PROBES);
        for (triangle, probes) in backs.triangles.iter().zip(of_triangles) {
            let most = probes.iter().map(&lack).fold(0.0, f64::max);
            for &back in triangle {
                lacks[back as usize] = most.max(lacks[back as usize]);
            }
        }
        lacks
    }

    /// Measures the distance of each moved back vertex from the surface.
    pub(super) fn at_backs(&mut self, motion: &Motion) -> &[Probe] {
        let (surface, moved) = ((self.backs.mesh, self.tree), self.backs.moved(motion));
        self.of_backs.update(surface, self.reach, moved, |k| motion.directions[k]);
        &self.of_backs.probes
    }

    /// Measures the distance of the moved faces from the surface, at [`PROBES`] points of each triangle.
    fn in_triangles(&mut self, motion: &Motion) -> &[Probe] {
        let triangles = &self.backs.triangles;
        let moved = &self.backs.moved(motion);
        let points = triangles.par_iter().flat_map_iter(|triangle| {
            let [a, b, c] = triangle.map(|back| moved[back as usize]);
            let middle = Point3::from((a.coords + b.coords + c.coords) / 3.0);
            [center(&a, &b), center(&b, &c), center(&c, &a), middle]
        });
        let points = points.collect();
        self.of_triangles.update((self.backs.mesh, self.tree), self.reach, points, |k| {
            let triangle = triangles[k / PROBES];
            let sum: Vector3<f64> =
                triangle.iter().map(|&back| motion.directions[back as usize]).sum();
            sum.try_normalize(0.0).unwrap_or_default()
        });
        &self.of_triangles.probes
    }

    /// Returns the faces behind which a layer is thinner than `thickness` mm: the moved face is too near, or a ray straight inwards from
    /// the face leaves the layer too early. Rays that leave it by a wall at a border do not count.
    pub(super) fn thin_faces(&mut self, motion: &Motion, layer: &Mesh, thickness: f64) -> Vec<u32> {
        self.at_backs(motion);
        self.in_triangles(motion);
        let (backs, of_backs) = (self.backs, &self.of_backs.probes);
        let of_triangles = self.of_triangles.probes.chunks(PROBES);
        let faces = backs.mesh.faces();
        let mut is_thin = vec![false; faces.len()];
        let of_layer = &TriangleTree::new(layer);
        let face_of_triangle =
            (0..faces.len()).flat_map(|face| std::iter::repeat_n(face, faces.face(face).len() - 2));
        let triangles = backs.triangles.iter().zip(of_triangles).zip(face_of_triangle);
        let triangles: Vec<_> = triangles.collect();
        let thin: Vec<bool> = triangles
            .par_iter()
            .map(|((triangle, probes), face)| {
                let corners = triangle.iter().map(|&back| &of_backs[back as usize]);
                corners.chain(*probes).any(|probe| probe.distance < thickness)
                    || backs.is_thin_behind(of_layer, **triangle, *face, thickness)
            })
            .collect();
        for (&(_, face), thin) in triangles.iter().zip(thin) {
            is_thin[face] |= thin;
        }
        (0..is_thin.len() as u32).filter(|&face| is_thin[face as usize]).collect()
    }
}

impl Backs<'_> {
    /// Returns true if a ray from the triangle straight inwards leaves the layer before `thickness`.
    fn is_thin_behind(
        &self,
        layer: &TriangleTree,
        triangle: [u32; 3],
        face: usize,
        thickness: f64,
    ) -> bool {
        let corners = triangle.map(|back| self.position(back as usize));
        let middle = Point3::from(corners.iter().map(|at| at.coords).sum::<Vector3<f64>>() / 3.0);
        let inward = -self.normals[face];
        let starts = [middle].into_iter().chain(corners.map(|at| center(&at, &middle)));
        let first_wall = 2 * self.mesh.faces().len() as u32;
        starts.into_iter().any(|start| {
            let hit = layer.first_hit(start + inward * (1e-6 * thickness), inward);
            hit.is_some_and(|hit| hit.face < first_wall && hit.along < thickness * (1.0 - 1e-5))
        })
    }
}

#[cfg(test)]
mod tests {
    use maquette_node::Progress;

    use super::*;
    use crate::thicken::tests::cuboid;

    #[test]
    fn measuring_only_what_has_moved_gives_the_distances_of_all() {
        let mesh = cuboid([4.0, 3.0, 2.0], 6);
        let tree = TriangleTree::new(&mesh);
        let backs = Backs::new(&mesh, 1.0);
        let fit = backs.fit(&tree, 0.5, &Progress::silent());
        let (mut motion, mut again) = fit.expect("not cancelled");
        motion.heights.iter_mut().step_by(3).for_each(|height| *height *= 0.5);
        let mut new = Probes::new(&backs, &tree, 0.5);
        for vertices_only in [true, false] {
            let [again, new] = [&mut again, &mut new]
                .map(|probes| probes.lacks(&motion, |probe| probe.distance, vertices_only));
            for (a, b) in again.iter().zip(&new) {
                assert!(a == b || (a - b).abs() < 1e-12, "{a} {b}");
            }
        }
        let near = new.at_backs(&motion).iter().filter(|probe| probe.distance < 0.3).count();
        assert!(2 * near < backs.first.len() && 0 < near, "{near}");
    }
}
