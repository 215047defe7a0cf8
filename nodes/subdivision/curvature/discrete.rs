//! The curvature of a mesh itself, from angles and from fitted quadratic surfaces.

use maquette_base::topology::flat_faces::FlatFaces;
use maquette_base::topology::lists::Lists;
use maquette_node::{CancelledError, Progress};
use maquette_value::parallel::*;
use maquette_value::{Edges, Faces, Mesh, MeshError};
use nalgebra::{Point3, Vector3};

use super::bending::Bending;

/// For each vertex of a mesh, the vertices connected to it by an edge.
pub(super) struct Neighbors(Lists);

impl Neighbors {
    pub(super) fn new(edges: &Edges, vertices: usize) -> Self {
        Self(Lists::group(vertices, || edges.vertices.iter().flat_map(|&[a, b]| [(a, b), (b, a)])))
    }

    /// As [`new`](Self::new), but with each dependent vertex replaced by the one on which it depends most.
    pub(super) fn of_independent(edges: &Edges, vertices: usize, flat: &FlatFaces) -> Self {
        if flat.is_empty() {
            return Self::new(edges, vertices);
        }
        Self(Lists::group(vertices, || {
            let edges = edges.vertices.iter().map(|ends| ends.map(|end| flat.main_support(end)));
            edges.filter(|[a, b]| a != b).flat_map(|[a, b]| [(a, b), (b, a)])
        }))
    }

    fn neighbors(&self, vertex: u32) -> &[u32] {
        self.0.list(vertex as usize)
    }

    /// Returns the vertices that are at most two edges away from `vertex`, without `vertex` itself. If there are fewer than `least`,
    /// includes more distant vertices, ring by ring.
    pub(super) fn neighborhood(&self, vertex: u32, least: usize) -> Vec<u32> {
        let (mut found, mut before, mut rings) = (vec![vertex], 0, 0);
        while before < found.len() && (rings < 2 || found.len() <= least) {
            before = found.len();
            (0..before).for_each(|k| found.extend_from_slice(self.neighbors(found[k])));
            found.sort_unstable();
            found.dedup();
            rings += 1;
        }
        found.retain(|&other| other != vertex);
        found
    }

    /// Returns the positions of the vertices in the [`neighborhood`](Self::neighborhood) of a vertex.
    pub(super) fn positions_around(
        &self,
        mesh: &Mesh,
        vertex: u32,
        least: usize,
    ) -> Vec<Point3<f64>> {
        let near = self.neighborhood(vertex, least);
        near.iter().map(|&other| mesh.positions()[other as usize]).collect()
    }
}

/// Cuts each polygon into triangles. If all sides of the polygon are visible from its center, the triangles meet at the center, which is
/// added after the vertices; otherwise the polygon is cut along diagonals.
pub(super) fn triangulate_polygons(mesh: &Mesh) -> Result<Mesh, MeshError> {
    if mesh.faces().sides() == Some(3) {
        return Ok(mesh.clone());
    }
    let mut positions = mesh.positions().to_vec();
    let mut triangles = Vec::new();
    for (number, face) in mesh.faces().iter().enumerate() {
        fn position(vertex: u32, mesh: &Mesh) -> Point3<f64> {
            mesh.positions()[vertex as usize]
        }
        let sum: Vector3<f64> = face.iter().map(|&vertex| position(vertex, mesh).coords).sum();
        let middle = Point3::from(sum / face.len() as f64);
        let normal = mesh.area_vector(face);
        let sides = face.iter().copied().zip(face.iter().copied().cycle().skip(1));
        let mut areas = sides
            .clone()
            .map(|(a, b)| (position(a, mesh) - middle).cross(&(position(b, mesh) - middle)));
        if face.len() > 3 && areas.all(|area| area.dot(&normal) >= 0.0) {
            triangles.extend(sides.map(|(a, b)| [a, b, positions.len() as u32]));
            positions.push(middle);
        } else {
            let corners = mesh.face_triangles(number);
            triangles.extend(corners.map(|it| it.map(|corner| face[corner as usize])));
        }
    }
    Mesh::new(positions, Faces::triangles(triangles))
}

/// The minimum number of points for fitting a quadratic surface.
pub(super) const MIN_POINTS: usize = 6;

/// Computes the curvature at the vertices of a mesh from quadratic surfaces fitted to the vertices' neighborhoods; `None` for a vertex
/// whose neighborhood does not determine a quadratic surface, and for dependent vertices.
///
/// # Errors
/// If the evaluation is cancelled.
pub(super) fn fit_quadrics(
    mesh: &Mesh,
    flat: &FlatFaces,
    progress: &Progress<'_>,
) -> Result<Vec<Option<Bending>>, CancelledError> {
    let neighbors = Neighbors::of_independent(&mesh.edges(), mesh.positions().len(), flat);
    let normals = normals(mesh, flat);
    let vertices: Vec<_> = (0..mesh.positions().len() as u32).collect();
    let parts = vertices
        .par_chunks(256)
        .map(|vertices| {
            progress.check()?;
            Ok(vertices
                .iter()
                .map(|&vertex| {
                    let around = neighbors.positions_around(mesh, vertex, MIN_POINTS);
                    let middle = mesh.positions()[vertex as usize];
                    Bending::of_points(middle, normals[vertex as usize], &around)
                })
                .collect::<Vec<_>>())
        })
        .collect::<Result<Vec<_>, _>>()?;
    Ok(parts.concat())
}

/// Returns vectors along the normals of the vertices. Dependent vertices have none; the vertices on which they depend have those of their
/// faces, too.
pub(super) fn normals(mesh: &Mesh, flat: &FlatFaces) -> Vec<Vector3<f64>> {
    if flat.is_empty() {
        return mesh.vertex_normals();
    }
    let mut sums = vec![Vector3::zeros(); mesh.positions().len()];
    for face in mesh.faces().iter() {
        let area = mesh.area_vector(face);
        face.iter().for_each(|&vertex| sums[vertex as usize] += area);
    }
    flat.gather(&mut sums);
    sums
}
