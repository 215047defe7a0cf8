//! Vertex colors. They are compared to find the parts of the surface that are copied into a hole.

use maquette_value::{Color, Mesh};

use super::carry::AttributeCarrier;
use crate::exemplar::TextureSource;
use crate::triangles::filling::Filling;

/// Returns the CIE L*a*b* color of each vertex. The color of an input vertex comes from the texture if the fill copies the texture,
/// otherwise from the color attribute. A vertex of the fill has the color of the nearest vertex on the hole's rim. Returns `None` if the
/// mesh has no colors.
pub(crate) fn colors(
    mesh: &Mesh,
    filling: &Filling,
    shown: TextureSource,
) -> Option<Vec<[f64; 3]>> {
    let has_picture = mesh.texture().is_some_and(|picture| !picture.pixels().is_empty());
    let data: Vec<[f64; 3]> = match (has_picture, mesh.corner().pairs("uv"), shown) {
        (true, Some(uv), TextureSource::Copied) => sample_pictures(mesh, uv),
        _ => mesh.vertex().colors("color")?.iter().map(|&color| lab(color)).collect(),
    };
    let likely = AttributeCarrier::new(filling, None).example_vertices();
    Some(likely.iter().map(|&vertex| data[vertex as usize]).collect())
}

/// Returns the texture's color at each vertex: the mean over the vertex's corners.
fn sample_pictures(mesh: &Mesh, uv: &[[f64; 2]]) -> Vec<[f64; 3]> {
    let count = mesh.positions().len();
    let (mut sums, mut corners) = (vec![[0.0; 3]; count], vec![0.0_f64; count]);
    let materials = (0..).map(|face| mesh.material_of(face));
    let faces = mesh.faces().iter().zip(materials);
    let all = faces.flat_map(|(face, material)| face.iter().map(move |&vertex| (vertex, material)));
    for ((vertex, material), &uv) in all.zip(uv) {
        let color = material.map_or([255.0; 3], |material| material.sample(uv));
        let color = lab(color.map(|channel| channel.round() as u8));
        (0..3).for_each(|k| sums[vertex as usize][k] += color[k]);
        corners[vertex as usize] += 1.0;
    }
    sums.iter().zip(corners).map(|(sum, count)| sum.map(|sum| sum / count.max(1.0))).collect()
}

fn lab(color: [u8; 3]) -> [f64; 3] {
    let lab = Color(color).lab();
    [lab.l, lab.a, lab.b].map(f64::from)
}
