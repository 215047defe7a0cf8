//! Help for meshes that should be closed.

use maquette_value::Mesh;
use nalgebra::center;

/// Returns the middle of the first edge of a mesh that does not have two faces, as a text.
pub(crate) fn first_open_edge(mesh: &Mesh) -> String {
    let edges = mesh.edges();
    let open = edges.faces.iter().position(|faces| *faces != 2).unwrap_or(0);
    let [a, b] = edges.vertices[open].map(|vertex| mesh.positions()[vertex as usize]);
    let at = center(&a, &b);
    format!("({:.3}, {:.3}, {:.3})", at.x, at.y, at.z)
}

/// Returns the help for a mesh that should be closed.
pub(crate) fn how_to_close(mesh: &Mesh) -> String {
    match mesh.count_unjoined() {
        0 => "use `Solid` to close it".to_owned(),
        unjoined => {
            format!("use `Weld` to join the {unjoined} vertices that share a position with another")
        }
    }
}
