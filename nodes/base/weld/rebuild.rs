//! Builds the mesh of joined vertices.

use std::collections::BTreeMap;

use maquette_value::{Attribute, Faces, Mesh, MeshError};

use super::join::Joined;

/// A mesh whose vertices were joined.
#[derive(Clone, Debug)]
pub struct WeldedMesh {
    /// The joined mesh. Vertices and faces keep their order.
    pub mesh: Mesh,
    /// For each vertex before, its index in the joined mesh.
    pub vertices: Vec<u32>,
    /// The number of faces that are left out because they equal another one.
    pub equal_faces: usize,
}

/// Builds the mesh after joining. Attributes of vertices for which `is_different` is true are moved to corners.
pub(super) fn rebuild(
    mesh: &Mesh,
    joined: &Joined,
    is_different: impl Fn(&str, &Attribute, usize, usize) -> bool,
) -> Result<WeldedMesh, MeshError> {
    let mut vertices = vec![0; joined.roots.len()];
    let mut kept = Vec::with_capacity(joined.roots.len());
    for (vertex, &root) in (0..).zip(&joined.roots) {
        if root == vertex {
            vertices[vertex as usize] = kept.len() as u32;
            kept.push(vertex);
        } else {
            // A root is lower than the other vertices of its set, so that its number is known.
            vertices[vertex as usize] = vertices[root as usize];
        }
    }
    let kept_faces: Vec<u32> =
        (0..).zip(&joined.is_equal).filter(|(_, it)| !**it).map(|(face, _)| face).collect();
    let faces = mesh.faces();
    let kept_corners: Vec<u32> = kept_faces
        .iter()
        .flat_map(|&face| {
            faces.first_corner(face as usize) as u32..faces.first_corner(face as usize + 1) as u32
        })
        .collect();
    let old_corners = faces.corners();
    let corners: Vec<u32> =
        kept_corners.iter().map(|&k| vertices[old_corners[k as usize] as usize]).collect();
    let new_faces = match faces.sides() {
        Some(sides) => Faces::uniform(sides, corners),
        None => {
            let sides = kept_faces.iter().map(|&face| faces.face(face as usize).len());
            Faces::polygons(&sides.collect::<Vec<_>>(), corners)
        }
    };
    let points: Vec<_> = kept.iter().map(|&vertex| mesh.positions()[vertex as usize]).collect();
    let mut creases: BTreeMap<[u32; 2], f64> = BTreeMap::new();
    for (ends, sharpness) in mesh.creases() {
        let [a, b] = ends.map(|end| vertices[end as usize]);
        let crease = creases.entry([a.min(b), a.max(b)]).or_insert(sharpness);
        *crease = crease.max(sharpness);
    }
    let mut rebuilt = Mesh::new(points, new_faces?)?
        .with_creases(creases.into_iter().filter(|([a, b], _)| a != b))?
        .with_materials(mesh.materials().clone())
        .with_frame(mesh.frame().copied());
    for (name, attribute) in mesh.corner().iter() {
        rebuilt = rebuilt.with_corner(name, attribute.select(&kept_corners))?;
    }
    for (name, attribute) in mesh.face().iter() {
        rebuilt = rebuilt.with_face(name, attribute.select(&kept_faces))?;
    }
    for (name, attribute) in mesh.vertex().iter() {
        let differs = kept_corners.iter().any(|&corner| {
            let vertex = old_corners[corner as usize];
            let root = joined.roots[vertex as usize];
            vertex != root && is_different(name, attribute, vertex as usize, root as usize)
        });
        rebuilt = if differs && mesh.corner().get(name).is_none() {
            let of_corners: Vec<u32> =
                kept_corners.iter().map(|&corner| old_corners[corner as usize]).collect();
            rebuilt.with_corner(name, attribute.select(&of_corners))?
        } else {
            rebuilt.with_vertex(name, attribute.select(&kept))?
        };
    }
    let equal_faces = faces.len() - kept_faces.len();
    Ok(WeldedMesh { mesh: rebuilt, vertices, equal_faces })
}
