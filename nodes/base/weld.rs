//! Joins vertices of a mesh that are at the same place.

mod join;
mod places;
mod rebuild;

pub use join::NO_PLACE;
use maquette_value::{Attribute, Mesh, MeshError};
use places::places;
pub use rebuild::WeldedMesh;

/// Joins the vertices of `mesh` that are at most `within` mm apart, along the borders where they meet. With `within: 0` only equal
/// positions are joined. All vertices of a joined one take the position of the one with the lowest index.
///
/// Borders are joined edge by edge: Gueziec, Taubin, Lazarus and Horn, "Cutting and stitching: converting sets of polygons to manifold
/// surfaces" (2001). So two vertices become one only if a border edge at one coincides with a border edge at the other. Parts that touch
/// in a vertex remain separate, no edge gets more than two faces, and corners of one face are never joined. Where several parts meet at
/// an edge, the faces that enclose the same inside are joined. Vertices without faces are joined with any vertex at their place that is on
/// a border.
///
/// Vertices do not form chains: each place is the surroundings of one vertex, the lowest one that is free. The faces of equal corners are
/// left out except for the first. If an attribute of joined vertices differs, it becomes an attribute of corners. The function is
/// idempotent.
///
/// # Errors
/// Does not fail for a valid mesh.
pub fn weld(mesh: &Mesh, within: f64) -> Result<WeldedMesh, MeshError> {
    let count = mesh.positions().len() as u32;
    let mut welded =
        WeldedMesh { mesh: mesh.clone(), vertices: (0..count).collect(), equal_faces: 0 };
    // A joint may make others possible, so that the result is repeated until nothing changes.
    loop {
        let places = places(&welded.mesh, within);
        let joined = join::join(&welded.mesh, &places, true);
        if joined.is_unchanged() {
            return Ok(welded);
        }
        let next = rebuild::rebuild(&welded.mesh, &joined, is_different)?;
        welded.vertices.iter_mut().for_each(|vertex| *vertex = next.vertices[*vertex as usize]);
        welded.equal_faces += next.equal_faces;
        welded.mesh = next.mesh;
    }
}

/// Joins vertices of `mesh` with the same number in `places`, which is [`NO_PLACE`] for those that stay, where borders meet. As [`weld`],
/// but faces of opposite orientation are not joined, and attributes are moved to corners if `is_different` returns true for two vertices.
/// Returns `None` if nothing is joined.
///
/// # Errors
/// Does not fail for a valid mesh.
pub fn join_places(
    mesh: &Mesh,
    places: &[u32],
    is_different: impl Fn(&str, &Attribute, usize, usize) -> bool,
) -> Result<Option<WeldedMesh>, MeshError> {
    let joined = join::join(mesh, places, false);
    (!joined.is_unchanged()).then(|| rebuild::rebuild(mesh, &joined, is_different)).transpose()
}

fn is_different(_: &str, attribute: &Attribute, a: usize, b: usize) -> bool {
    !attribute.is_same(a, b)
}

#[cfg(test)]
mod tests;
