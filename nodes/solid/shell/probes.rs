//! Measures a layer: the distance of its back from the surface, and the material behind each face.

use maquette_value::parallel::*;
use maquette_value::{Mesh, TriangleTree};
use nalgebra::{Point3, Vector3, center};

use super::backs::{Backs, Motion};

/// Number of points inside of a triangle at which its distance from the surface is measured.
const PROBES: usize = 4;

/// The distance of a point of a moved face from the surface.
#[derive(Clone, Copy)]
pub(super) struct Probe {
    pub(super) distance: f64,
    /// The cosine of the angle between the point's direction and the way from its nearest point of the surface.
    pub(super) cosine: f64,
}

impl Backs<'_> {
    /// Returns for each back vertex the maximum of `lack` there and, if `vertices_only` is false, at its moved faces.
    pub(super) fn lacks(
        &self,
        tree: &TriangleTree,
        motion: &Motion,
        lack: impl Fn(&Probe) -> f64,
        vertices_only: bool,
    ) -> Vec<f64> {
        if vertices_only {
            return self.probe_backs(tree, motion).iter().map(lack).collect();
        }
        let (of_backs, of_triangles) = self.probe(tree, motion);
        let mut lacks: Vec<f64> = of_backs.iter().map(&lack).collect();
        for (triangle, probes) in self.triangles.iter().zip(of_triangles.chunks(PROBES)) {
            let most = probes.iter().map(&lack).fold(0.0, f64::max);
            for &back in triangle {
                lacks[back as usize] = most.max(lacks[back as usize]);
            }
        }
        lacks
    }

    pub(super) fn probe_backs(&self, tree: &TriangleTree, motion: &Motion) -> Vec<Probe> {
        self.probe_points(tree, &self.moved(motion), |k| motion.directions[k])
    }

    /// Measures the distance of the moved faces from the surface: at each back vertex, and at [`PROBES`] points of each triangle.
    fn probe(&self, tree: &TriangleTree, motion: &Motion) -> (Vec<Probe>, Vec<Probe>) {
        let moved = self.moved(motion);
        let points = self.triangles.iter().flat_map(|triangle| {
            let [a, b, c] = triangle.map(|back| moved[back as usize]);
            let middle = Point3::from((a.coords + b.coords + c.coords) / 3.0);
            [center(&a, &b), center(&b, &c), center(&c, &a), middle]
        });
        let of_triangles = self.probe_points(tree, &points.collect::<Vec<_>>(), |k| {
            let triangle = self.triangles[k / PROBES];
            let sum: Vector3<f64> =
                triangle.iter().map(|&back| motion.directions[back as usize]).sum();
            sum.try_normalize(0.0).unwrap_or_default()
        });
        (self.probe_backs(tree, motion), of_triangles)
    }

    fn probe_points(
        &self,
        tree: &TriangleTree,
        points: &[Point3<f64>],
        direction: impl Fn(usize) -> Vector3<f64>,
    ) -> Vec<Probe> {
        let nearest = tree.nearest_to_all(points).into_iter().zip(points).enumerate();
        nearest
            .map(|(k, (nearest, at))| {
                let way = nearest.map_or(Vector3::zeros(), |it| at - it.position(self.mesh));
                let distance = way.norm();
                let cosine = way.try_normalize(0.0).unwrap_or_default().dot(&direction(k));
                Probe { distance, cosine }
            })
            .collect()
    }

    /// Returns the faces behind which a layer is thinner than `thickness` mm: the moved face is too near, or a ray straight inwards from
    /// the face leaves the layer too early. Rays that leave it by a wall at a border do not count.
    pub(super) fn thin_faces(
        &self,
        tree: &TriangleTree,
        motion: &Motion,
        layer: &Mesh,
        thickness: f64,
    ) -> Vec<u32> {
        let mut is_thin = vec![false; self.mesh.faces().len()];
        let (of_backs, of_triangles) = self.probe(tree, motion);
        let of_layer = TriangleTree::new(layer);
        let face_of_triangle = (0..self.mesh.faces().len())
            .flat_map(|face| std::iter::repeat_n(face, self.mesh.faces().face(face).len() - 2));
        let triangles =
            self.triangles.iter().zip(of_triangles.chunks(PROBES)).zip(face_of_triangle);
        let triangles: Vec<_> = triangles.collect();
        let thin: Vec<bool> = triangles
            .par_iter()
            .map(|((triangle, probes), face)| {
                let corners = triangle.iter().map(|&back| &of_backs[back as usize]);
                corners.chain(*probes).any(|probe| probe.distance < thickness)
                    || self.is_thin_behind(&of_layer, **triangle, *face, thickness)
            })
            .collect();
        for (&(_, face), thin) in triangles.iter().zip(thin) {
            is_thin[face] |= thin;
        }
        (0..is_thin.len() as u32).filter(|&face| is_thin[face as usize]).collect()
    }

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
