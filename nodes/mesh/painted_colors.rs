//! The colors of vertices in a picture.

use maquette_value::{Column, Image, Mesh};

/// The color of each vertex in the mesh's picture, if it has one.
pub(super) fn painted_colors(mesh: &Mesh) -> Option<Column<[u8; 3]>> {
    mesh.texture().and_then(|picture| vertex_colors(mesh, picture))
}

/// The picture's color at each vertex; a vertex on a seam takes that of one side. None without texture coordinates.
fn vertex_colors(mesh: &Mesh, picture: &Image) -> Option<Column<[u8; 3]>> {
    if picture.pixels().is_empty() {
        return None;
    }
    let color = |&uv: &[f64; 2]| picture.sample(uv).map(|channel| channel.round() as u8);
    if let Some(uv) = mesh.vertex().pairs("uv") {
        return Some(uv.iter().map(color).collect());
    }
    let uv = mesh.corner().pairs("uv")?;
    let mut colors = vec![[0; 3]; mesh.positions().len()];
    for (&vertex, uv) in mesh.faces().corners().iter().zip(&**uv) {
        colors[vertex as usize] = color(uv);
    }
    Some(colors.into())
}
