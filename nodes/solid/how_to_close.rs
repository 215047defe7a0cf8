//! Help for meshes that should be closed.

use maquette_value::Mesh;

/// Returns the help for a mesh that should be closed.
pub(crate) fn how_to_close(mesh: &Mesh) -> String {
    match mesh.count_unjoined() {
        0 => "use `Solid` to close it".to_owned(),
        unjoined => {
            format!("use `Weld` to join the {unjoined} vertices that share a position with another")
        }
    }
}
