//! The colors that count when exemplars are compared.

use maquette_value::{Color, Image, Mesh};

use super::carry::Carry;
use crate::exemplar::Shown;
use crate::triangles::filling::Filling;

/// A color of each vertex in CIE L*a*b*: of the data's vertices that of the picture, if an exemplar fill copies it, else their own; of the
/// filled ones that of the nearest one at the rim. None without colors.
pub(crate) fn colors(mesh: &Mesh, filling: &Filling, shown: Shown) -> Option<Vec<[f64; 3]>> {
    let picture = mesh.texture().filter(|picture| !picture.pixels().is_empty());
    let data: Vec<[f64; 3]> = match (picture, mesh.corner().pairs("uv"), shown) {
        (Some(picture), Some(uv), Shown::Copied) => painted(mesh, picture, uv),
        _ => mesh.vertex().colors("color")?.iter().map(|&color| lab(color)).collect(),
    };
    let likely = Carry::new(filling, None).examples();
    Some(likely.iter().map(|&vertex| data[vertex as usize]).collect())
}

/// What a picture has at each vertex: the mean over its corners.
fn painted(mesh: &Mesh, picture: &Image, uv: &[[f64; 2]]) -> Vec<[f64; 3]> {
    let count = mesh.positions().len();
    let (mut sums, mut corners) = (vec![[0.0; 3]; count], vec![0.0_f64; count]);
    for (&vertex, &uv) in mesh.faces().corners().iter().zip(uv) {
        let color = lab(picture.sample(uv).map(|channel| channel.round() as u8));
        (0..3).for_each(|k| sums[vertex as usize][k] += color[k]);
        corners[vertex as usize] += 1.0;
    }
    sums.iter().zip(corners).map(|(sum, count)| sum.map(|sum| sum / count.max(1.0))).collect()
}

fn lab(color: [u8; 3]) -> [f64; 3] {
    let lab = Color(color).lab();
    [lab.l, lab.a, lab.b].map(f64::from)
}
