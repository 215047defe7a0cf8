//! The curvature of a mesh itself: of its angles, and of fitted quadratic surfaces.

use maquette_base::topology::lists::Lists;
use maquette_node::{Cancelled, Progress};
use maquette_value::parallel::*;
use maquette_value::{Edges, Faces, Mesh, MeshError};
use nalgebra::{Point3, Vector3};

use super::bending::Bending;

/// Who is whose neighbor in a mesh.
pub(super) struct Neighbors(Lists);

impl Neighbors {
    pub(super) fn new(edges: &Edges, vertices: usize) -> Self {
        Self(Lists::group(vertices, || edges.vertices.iter().flat_map(|&[a, b]| [(a, b), (b, a)])))
    }

    pub(super) fn of(&self, vertex: u32) -> &[u32] {
        self.0.of(vertex as usize)
    }

    /// The vertices that are two edges away or less, or as many more rings as make `least`; without the vertex.
    pub(super) fn near(&self, vertex: u32, least: usize) -> Vec<u32> {
        let (mut found, mut before, mut rings) = (vec![vertex], 0, 0);
        while before < found.len() && (rings < 2 || found.len() <= least) {
            before = found.len();
            (0..before).for_each(|k| found.extend_from_slice(self.of(found[k])));
            found.sort_unstable();
            found.dedup();
            rings += 1;
        }
        found.retain(|&other| other != vertex);
        found
    }
}

/// The same mesh with each polygon cut into triangles: around its middle, which comes after the vertices, if all of it can be seen from there,
/// else along diagonals.
pub(super) fn triangulated(mesh: &Mesh) -> Result<Mesh, MeshError> {
    if mesh.faces().sides() == Some(3) {
        return Ok(mesh.clone());
    }
    let mut places = mesh.positions().to_vec();
    let mut triangles = Vec::new();
    for (number, face) in mesh.faces().iter().enumerate() {
        fn place(vertex: u32, mesh: &Mesh) -> Point3<f64> {
            mesh.positions()[vertex as usize]
        }
        let sum: Vector3<f64> = face.iter().map(|&vertex| place(vertex, mesh).coords).sum();
        let middle = Point3::from(sum / face.len() as f64);
        let normal = mesh.area_vector(face);
        let sides = || face.iter().copied().zip(face.iter().copied().cycle().skip(1));
        let mut areas =
            sides().map(|(a, b)| (place(a, mesh) - middle).cross(&(place(b, mesh) - middle)));
        if face.len() > 3 && areas.all(|area| area.dot(&normal) >= 0.0) {
            triangles.extend(sides().map(|(a, b)| [a, b, places.len() as u32]));
            places.push(middle);
        } else {
            let corners = mesh.face_triangles(number);
            triangles.extend(corners.map(|it| it.map(|corner| face[corner as usize])));
        }
    }
    Mesh::new(places, Faces::triangles(triangles))
}

/// Fewest points that a quadratic surface is fitted to.
const LEAST: usize = 6;

/// The curvature at some vertices of a mesh by a quadratic surface through the vertices around; none where they do not
/// determine one.
///
/// # Errors
/// If the evaluation is told to stop.
pub(super) fn fitted(
    mesh: &Mesh,
    vertices: &[u32],
    progress: &Progress<'_>,
) -> Result<Vec<Option<Bending>>, Cancelled> {
    let neighbors = Neighbors::new(&mesh.edges(), mesh.positions().len());
    let normals = mesh.vertex_normals();
    let parts = vertices
        .par_chunks(256)
        .map(|vertices| {
            progress.check()?;
            Ok(vertices
                .iter()
                .map(|&vertex| {
                    let near = neighbors.near(vertex, LEAST);
                    let around: Vec<_> =
                        near.iter().map(|&other| mesh.positions()[other as usize]).collect();
                    let middle = mesh.positions()[vertex as usize];
                    Bending::of_points(middle, normals[vertex as usize], &around)
                })
                .collect::<Vec<_>>())
        })
        .collect::<Result<Vec<_>, _>>()?;
    Ok(parts.concat())
}
