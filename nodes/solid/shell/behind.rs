//! The space behind a surface.

use maquette_value::parallel::*;
use maquette_value::{Edges, Faces, Mesh, MeshError, NearestPoint, TriangleTree};
use nalgebra::{Point3, Vector3};

/// The space behind a surface and between the upright walls at its borders: the points whose nearest point of the surface is seen from
/// behind, and is not on a border that the point is beyond.
///
/// The sign follows from the normal at the nearest point; at an edge or a vertex, from the sum of the normals around it: Baerentzen and
/// Aanaes, "Signed distance computation using the angle weighted pseudonormal" (2005).
pub(super) struct Behind<'a> {
    mesh: &'a Mesh,
    tree: &'a TriangleTree,
    edges: Edges,
    /// Unit normals of faces, and sums of them at edges and, weighted by angles, at vertices.
    of_faces: Vec<Vector3<f64>>,
    of_edges: Vec<Vector3<f64>>,
    of_vertices: Vec<Vector3<f64>>,
    /// The direction out of the surface at each edge and vertex of a border; zero elsewhere.
    out_of_edges: Vec<Vector3<f64>>,
    out_of_vertices: Vec<Vector3<f64>>,
    /// The edges of the borders, as triangles without area; `None` if there are none.
    border: Option<TriangleTree>,
}

/// The position of a point relative to a surface.
#[derive(Clone, Copy)]
pub(super) struct Location {
    /// Distance from the surface in mm, positive behind it and negative in front of it.
    pub(super) depth: f64,
    /// Distance from the upright walls at the borders in mm, negative beyond them.
    pub(super) inset: f64,
}

impl<'a> Behind<'a> {
    pub(super) fn new(mesh: &'a Mesh, tree: &'a TriangleTree) -> Result<Self, MeshError> {
        let (faces, positions, edges) = (mesh.faces(), mesh.positions(), mesh.edges());
        fn unit(vector: Vector3<f64>) -> Vector3<f64> {
            vector.try_normalize(0.0).unwrap_or_default()
        }
        let of_faces: Vec<_> =
            (0..faces.len()).map(|face: usize| unit(mesh.area_vector(faces.face(face)))).collect();
        let mut of_edges = vec![Vector3::zeros(); edges.vertices.len()];
        let mut out_of_edges = of_edges.clone();
        let mut of_vertices = vec![Vector3::zeros(); positions.len()];
        let mut out_of_vertices = of_vertices.clone();
        let mut border = Vec::new();
        for (face, normal) in of_faces.iter().enumerate() {
            let (corners, first) = (faces.face(face), faces.first_corner(face));
            for (k, &vertex) in corners.iter().enumerate() {
                let at = positions[vertex as usize];
                let end = corners[(k + 1) % corners.len()];
                let next = positions[end as usize] - at;
                let last =
                    positions[corners[(k + corners.len() - 1) % corners.len()] as usize] - at;
                let angle = libm::atan2(next.cross(&last).norm(), next.dot(&last));
                of_vertices[vertex as usize] += normal * angle;
                let edge = edges.of_corner[first + k] as usize;
                of_edges[edge] += normal;
                if edges.faces[edge] == 1 {
                    let out = unit(next.cross(normal));
                    out_of_edges[edge] = out;
                    [vertex, end].iter().for_each(|&it| out_of_vertices[it as usize] += out);
                    border.extend([at, at + next, at + next]);
                }
            }
        }
        let out_of_vertices = out_of_vertices.into_iter().map(unit).collect();
        let border = match border.is_empty() {
            true => None,
            false => {
                let corners: Vec<_> = (0..border.len() as u32).collect();
                Some(TriangleTree::new(&Mesh::new(border, Faces::uniform(3, corners)?)?))
            }
        };
        Ok(Self {
            mesh,
            tree,
            edges,
            of_faces,
            of_edges,
            of_vertices,
            out_of_edges,
            out_of_vertices,
            border,
        })
    }

    /// Returns the location of each point.
    pub(super) fn locate(&self, points: &[Point3<f64>]) -> Vec<Location> {
        let nearest = self.tree.nearest_to_all(points);
        let feet = nearest.iter().zip(points);
        let feet: Vec<_> = feet
            .map(|(nearest, at)| nearest.map_or(*at, |nearest| nearest.position(self.mesh)))
            .collect();
        let from_border: Vec<f64> = match &self.border {
            None => vec![f64::INFINITY; feet.len()],
            Some(tree) => {
                let nearest = tree.nearest_to_all(&feet).into_par_iter();
                nearest
                    .map(|it: Option<NearestPoint>| {
                        it.map_or(f64::INFINITY, |it| it.distance_sq.sqrt())
                    })
                    .collect()
            }
        };
        let all = points.iter().zip(&feet).zip(nearest.iter().zip(from_border));
        all.map(|((at, foot), (nearest, from_border))| {
            let Some(nearest) = nearest else {
                return Location { depth: f64::NEG_INFINITY, inset: f64::NEG_INFINITY };
            };
            let way = at - foot;
            let (normal, out) = self.around(nearest);
            let depth = if way.dot(&normal) < 0.0 { way.norm() } else { -way.norm() };
            let inset = if out == Vector3::zeros() { from_border } else { -way.dot(&out) };
            Location { depth, inset }
        })
        .collect()
    }

    /// Returns the normal at a point of the surface, and the direction out of the surface there, which is zero inside of borders.
    fn around(&self, at: &NearestPoint) -> (Vector3<f64>, Vector3<f64>) {
        let on: Vec<u32> =
            (0..3).filter(|&k| 0.0 < at.barycentric[k]).map(|k| at.corners[k]).collect();
        let corners = self.mesh.faces().corners();
        match on[..] {
            [corner] => {
                let vertex = corners[corner as usize] as usize;
                (self.of_vertices[vertex], self.out_of_vertices[vertex])
            }
            [a, b] => match self.edge(at.face as usize, [a, b]) {
                Some(edge) => (self.of_edges[edge], self.out_of_edges[edge]),
                None => (self.of_faces[at.face as usize], Vector3::zeros()),
            },
            _ => (self.of_faces[at.face as usize], Vector3::zeros()),
        }
    }

    /// Returns the edge between two corners of a face; `None` if it is a diagonal.
    fn edge(&self, face: usize, [a, b]: [u32; 2]) -> Option<usize> {
        let (first, count) =
            (self.mesh.faces().first_corner(face), self.mesh.faces().face(face).len());
        fn next(corner: u32, first: usize, count: usize) -> usize {
            first + (corner as usize - first + 1) % count
        }
        if next(a, first, count) == b as usize {
            return Some(self.edges.of_corner[a as usize] as usize);
        }
        (next(b, first, count) == a as usize).then(|| self.edges.of_corner[b as usize] as usize)
    }
}
