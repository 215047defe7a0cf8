//! Assembles the mesh that remains of one or more solids, with interpolated attributes.

use maquette_base::linear::attribute_transfer::AttributeTransfer;
use maquette_base::linear::stencils::Stencils;
use maquette_value::parallel::*;
use maquette_value::{Faces, Mesh, MeshError};
use nalgebra::{Point3, Vector3};

/// One triangle of a triangulated face.
pub(super) struct Triangle {
    pub(super) vertices: [u32; 3],
    /// Indices of the triangle's corners among all corners of the mesh.
    pub(super) corners: [u32; 3],
    pub(super) face: u32,
}

/// Returns the triangles of all faces of a mesh.
pub(super) fn triangles(mesh: &Mesh) -> Vec<Triangle> {
    let faces = mesh.faces();
    let mut triangles = Vec::with_capacity(faces.corners().len());
    for (number, face) in faces.iter().enumerate() {
        let first = faces.first_corner(number) as u32;
        triangles.extend(mesh.face_triangles(number).map(|it| Triangle {
            vertices: it.map(|corner| face[corner as usize]),
            corners: it.map(|corner| first + corner),
            face: number as u32,
        }));
    }
    triangles
}

/// The origin of the attributes of a corner.
#[derive(Clone, Copy)]
pub(super) enum CornerOrigin {
    /// A corner of the mesh, whose attributes are copied.
    Corner(u32),
    /// A triangle of the mesh, in which attributes are interpolated.
    Triangle(u32),
}

/// The faces of a new mesh.
#[derive(Default)]
pub(super) struct NewFaces {
    /// For each new face, the face of the mesh whose attributes it has.
    pub(super) faces: Vec<u32>,
    /// The number of corners of each new face.
    pub(super) sides: Vec<usize>,
    /// The vertices of all corners, and the origins of their attributes.
    pub(super) corners: Vec<(u32, CornerOrigin)>,
}

/// The vertices of a new mesh.
pub(super) trait NewVertices {
    /// Returns the number of vertices. Not all of them need be used.
    fn count(&self) -> usize;

    fn position(&self, vertex: u32) -> Point3<f64>;

    /// Appends the vertices of the mesh from which the attributes of a vertex are interpolated, with their weights, whose sum is 1.
    fn add_shares(&self, vertex: u32, shares: &mut Vec<(u32, f64)>);

    /// Returns the creases. `places` maps each vertex to its index in the result, or `u32::MAX`.
    fn creases(&self, places: &[u32]) -> Vec<([u32; 2], f64)>;
}

/// Builds a mesh of new vertices and faces, with the attributes of `of`, whose triangles are `triangles`.
pub(super) fn assemble(
    of: &Mesh,
    triangles: &[Triangle],
    vertices: &impl NewVertices,
    NewFaces { faces, sides, corners }: NewFaces,
) -> Result<Mesh, MeshError> {
    // Number the used vertices in their old order, without gaps.
    let count = vertices.count();
    let mut places = vec![u32::MAX; count];
    corners.iter().until_stopped().for_each(|corner| places[corner.0 as usize] = 0);
    let kept: Vec<_> = (0..count as u32).filter(|&it| places[it as usize] == 0).collect();
    (0..).zip(&kept).for_each(|(place, &vertex)| places[vertex as usize] = place);
    let numbers = corners.par_iter().map(|corner| places[corner.0 as usize]).collect();
    let positions = kept.iter().until_stopped().map(|&vertex| vertices.position(vertex));
    let positions: Vec<_> = positions.collect();
    let mut mesh = Mesh::new(positions, Faces::polygons(&sides, numbers)?)?
        .with_creases(vertices.creases(&places))?
        .with_materials(of.materials().clone())
        .with_frame(of.frame().copied());
    fn is_kept(name: &str) -> bool {
        name != "normal"
    }
    if of.vertex().iter().any(|(name, _)| is_kept(name)) {
        let mixed = rows(kept.iter(), |&vertex, row| vertices.add_shares(vertex, row));
        for (name, attribute) in of.vertex().iter().filter(|it| is_kept(it.0)) {
            mesh = mesh.with_vertex(name, mixed.attribute(attribute))?;
        }
    }
    if of.corner().iter().any(|(name, _)| is_kept(name)) {
        let mixed = rows(corners.iter(), |&(vertex, origin), row| match origin {
            CornerOrigin::Corner(corner) => row.push((corner, 1.0)),
            CornerOrigin::Triangle(triangle) => {
                let own = &triangles[triangle as usize];
                let places = own.vertices.map(|it| of.positions()[it as usize]);
                let weights = barycentric(places, vertices.position(vertex));
                row.extend(own.corners.into_iter().zip(weights));
            }
        });
        for (name, attribute) in of.corner().iter().filter(|it| is_kept(it.0)) {
            mesh = mesh.with_corner(name, mixed.attribute(attribute))?;
        }
    }
    for (name, attribute) in of.face().iter() {
        mesh = mesh.with_face(name, attribute.select(&faces))?;
    }
    Ok(mesh)
}

/// Returns interpolation weights with one row for each item; `of` fills a row with pairs of an index and its weight.
fn rows<T>(items: impl Iterator<Item = T>, of: impl Fn(T, &mut Vec<(u32, f64)>)) -> Stencils {
    let (mut starts, mut indices, mut weights) = (vec![0], Vec::new(), Vec::new());
    let mut row = Vec::new();
    for item in items.until_stopped() {
        of(item, &mut row);
        for (index, weight) in row.drain(..) {
            indices.push(index);
            weights.push(weight);
        }
        starts.push(indices.len() as u32);
    }
    Stencils::from_parts(starts, indices, weights)
}

/// Returns the barycentric coordinates of a point in a triangle.
pub(super) fn barycentric([a, b, c]: [Point3<f64>; 3], at: Point3<f64>) -> [f64; 3] {
    let normal: Vector3<f64> = (b - a).cross(&(c - a));
    fn area(p: Point3<f64>, q: Point3<f64>, at: Point3<f64>, normal: Vector3<f64>) -> f64 {
        (p - at).cross(&(q - at)).dot(&normal).max(0.0)
    }
    let areas = [area(b, c, at, normal), area(c, a, at, normal), area(a, b, at, normal)];
    let sum: f64 = areas.iter().sum();
    if sum > 0.0 { areas.map(|it| it / sum) } else { [1.0, 0.0, 0.0] }
}
