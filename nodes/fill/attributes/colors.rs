//! The colors that count when exemplars are compared.

use maquette_value::{Color, Mesh};

use super::carry::Carry;
use crate::exemplar::Shown;
use crate::triangles::filling::Filling;

/// A color of each vertex in CIE L*a*b*: of the data's vertices that of the picture, if an exemplar fill copies it, else their own; of the
/// filled ones that of the nearest one at the rim. None without colors.
pub(crate) fn colors(mesh: &Mesh, filling: &Filling, shown: Shown) -> Option<Vec<[f64; 3]>> {
    let has_picture = mesh.texture().is_some_and(|picture| !picture.pixels().is_empty());
    let data: Vec<[f64; 3]> = match (has_picture, mesh.corner().pairs("uv"), shown) {
        (true, Some(uv), Shown::Copied) => painted(mesh, uv),
        _ => mesh.vertex().colors("color")?.iter().map(|&color| lab(color)).collect(),
    };
    let likely = Carry::new(filling, None).examples();
    Some(likely.iter().map(|&vertex| data[vertex as usize]).collect())
}

/// What the pictures have at each vertex: the mean over its corners.
fn painted(mesh: &Mesh, uv: &[[f64; 2]]) -> Vec<[f64; 3]> {
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
