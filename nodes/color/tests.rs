//! Tests of several nodes in combination.

use maquette_node::Progress;
use maquette_value::{Attribute, Faces, Mesh};
use nalgebra::Point3;

use crate::{Layout, Sampling, colors_to_texture, lay_out, texture_to_colors};

#[test]
fn colors_go_into_a_picture_and_come_back() {
    // The mesh is a bowl with slowly changing colors and a sharp edge.
    let n = 24u32;
    let at = |k: u32| [k % (n + 1), k / (n + 1)].map(|x| f64::from(x) / f64::from(n) * 2.0 - 1.0);
    let places = (0..(n + 1) * (n + 1)).map(at).map(|[x, y]| Point3::new(x, y, x * x + y * y));
    let cells = (0..n * n).map(|k| k / n * (n + 1) + k % n);
    let faces = cells.flat_map(|a| [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]);
    let mesh = Mesh::new(places.collect::<Vec<_>>(), Faces::triangles(faces.collect())).unwrap();
    let colors: Vec<_> = (0..(n + 1) * (n + 1))
        .map(|k: u32| {
            let [x, y] = at(k).map(|x| (100.0 + 90.0 * x) as u8);
            [x, y, if x < y { 250 } else { 20 }]
        })
        .collect();
    let mesh = mesh.with_vertex("color", Attribute::Color(colors.clone().into())).unwrap();
    let layout = Layout { size: 512, ..Layout::default() };
    let flat = lay_out(&mesh, &layout, &Progress::silent()).unwrap().mesh;
    let drawn = colors_to_texture(&flat, 512, &Progress::silent()).unwrap();
    for (by, most, mean) in [(Sampling::Area, 6.0, 1.0), (Sampling::Point, 40.0, 5.0)] {
        let back = texture_to_colors(&drawn, by, &Progress::silent()).unwrap();
        let back = back.vertex().colors("color").unwrap().to_vec();
        let pairs = colors.as_flattened().iter().zip(back.as_flattened());
        let off: Vec<_> = pairs.map(|(a, b)| f64::from(a.abs_diff(*b))).collect();
        let (worst, sum) =
            off.iter().fold((0.0_f64, 0.0), |(worst, sum), x| (worst.max(*x), sum + x));
        assert!(
            worst <= most && sum / off.len() as f64 <= mean,
            "{by:?} {worst} {}",
            sum / off.len() as f64
        );
    }
}
