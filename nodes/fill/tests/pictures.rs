//! Tests of the part of a texture that the faces of a fill show.

use maquette_value::Image;

use super::super::exemplar::TextureSource;
use super::*;

/// Returns a flat sheet with a hole. Its left and right halves are separate parts of the texture. A face is one hundredth of the texture
/// wide.
fn sheet() -> Mesh {
    let whole = grid(41, 41, |_, _| 0.0);
    let mesh = remove_vertices(&whole, |p| (p - Point3::new(20.0, 20.0, 0.0)).norm() < 4.5);
    let points = mesh.positions();
    let shown = mesh.faces().iter().flat_map(|face| {
        let is_right = face.iter().map(|vertex| points[*vertex as usize].x).sum::<f64>() > 60.0;
        let aside = if is_right { 0.5 } else { 0.0 };
        face.iter().map(move |vertex| {
            let p = points[*vertex as usize];
            [p.x / 100.0 + aside, p.y / 100.0]
        })
    });
    let shown: Vec<[f64; 2]> = shown.collect();
    mesh.with_corner("uv", Attribute::Pair(shown.into())).unwrap()
}

#[test]
fn filled_faces_show_the_picture_of_their_exemplars() {
    let mesh = sheet();
    let filled = fill(&mesh, HoleChoice::Largest, FillMethod::default()).unwrap().mesh;
    let kept = mesh.faces().len();
    assert!(kept + 60 < filled.faces().len());
    let uv = filled.corner().pairs("uv").unwrap();
    assert_eq!(uv[..3 * kept], mesh.corner().pairs("uv").unwrap()[..]);
    let mut shifts = Vec::new();
    for (face, uv) in filled.faces().iter().zip(uv.as_chunks::<3>().0).skip(kept) {
        let middle: [f64; 2] = [0, 1].map(|k| uv.iter().map(|uv| uv[k]).sum::<f64>() * 100.0 / 3.0);
        let there = [if middle[0] > 45.0 { middle[0] - 50.0 } else { middle[0] }, middle[1]];
        // The shown part of the texture is on the sheet, outside the hole, in one half.
        assert!(there.iter().all(|x| (0.0..40.0).contains(x)), "{there:?}");
        let far = libm::hypot(there[0] - 20.0, there[1] - 20.0);
        assert!(far > 3.0, "{there:?}");
        // The shown part has the size and rotation that the face has.
        for k in 0..3 {
            let [a, b] = [face[k], face[(k + 1) % 3]].map(|v| filled.positions()[v as usize]);
            let side = [0, 1].map(|axis| 100.0 * (uv[(k + 1) % 3][axis] - uv[k][axis]));
            assert!((side[0] - (b.x - a.x)).abs() < 1e-6 && (side[1] - (b.y - a.y)).abs() < 1e-6);
        }
        let at = filled.positions()[face[0] as usize];
        shifts.push([0, 1].map(|k| (100.0 * uv[0][k] - at[k]).round() as i32));
    }
    // Many adjacent faces show one contiguous part of the texture.
    shifts.sort_unstable();
    shifts.dedup();
    assert!(shifts.len() * 6 < filled.faces().len() - kept, "{} pieces", shifts.len());
}

#[test]
fn a_picture_is_continued_across_plain_fills_and_on_request() {
    let mesh = sheet();
    let options =
        ExemplarOptions { texture: TextureSource::Continued, ..ExemplarOptions::default() };
    for method in [FillMethod::ThinPlate, FillMethod::Exemplar(options)] {
        let filled = fill(&mesh, HoleChoice::Largest, method).unwrap().mesh;
        let uv = filled.corner().pairs("uv").unwrap();
        let mut count = 0;
        for (&vertex, uv) in filled.faces().corners().iter().zip(uv.iter()) {
            let p = filled.positions()[vertex as usize];
            // Check only vertices away from the seam of texture coordinates, which ends at the rim.
            if mesh.positions().len() <= vertex as usize && p.x < 18.0 {
                assert!((uv[1] - p.y / 100.0).abs() < 0.02, "{p} {uv:?}");
                count += 1;
            }
        }
        assert!(count > 30);
    }
}

const RED: [u8; 3] = [200, 40, 30];
const BLUE: [u8; 3] = [30, 60, 190];

/// Returns a wavy sheet with two colors. It is red around its hole and on the left, where the waves are lower. It is blue on the right,
/// where the waves are as high as around the hole.
fn two_colors() -> Mesh {
    fn height(x: f64) -> f64 {
        0.25 + 0.05 * libm::tanh(x - 6.0)
    }
    let whole = grid(41, 41, |x, y| height(x) * libm::sin(0.9 * y));
    let mesh = remove_vertices(&whole, |p| (p - Point3::new(14.0, 20.0, 0.0)).norm() < 4.5);
    let colors: Vec<[u8; 3]> =
        mesh.positions().iter().map(|p| if p.x < 24.0 { RED } else { BLUE }).collect();
    mesh.with_vertex("color", Attribute::Color(colors.into())).unwrap()
}

/// Returns the mesh of `two_colors` with its colors in a texture.
fn two_colored_picture() -> Mesh {
    let mesh = two_colors().without_attribute("color");
    let texels = (0..40 * 40).map(|k| if k % 40 < 24 { RED } else { BLUE });
    let picture = Image::new(40, 40, texels.collect::<Vec<_>>()).unwrap();
    let uv: Vec<[f64; 2]> = mesh
        .faces()
        .corners()
        .iter()
        .map(|vertex| mesh.positions()[*vertex as usize])
        .map(|p| [p.x / 40.0, p.y / 40.0])
        .collect();
    mesh.with_corner("uv", Attribute::Pair(uv.into())).unwrap().with_texture(Some(picture))
}

fn with_color(color: f64) -> FillMethod {
    FillMethod::Exemplar(ExemplarOptions { color, ..ExemplarOptions::default() })
}

#[test]
fn copied_parts_have_the_picture_colors_around_the_hole() {
    let mesh = two_colored_picture();
    fn blue_corners(color: f64, mesh: &Mesh) -> usize {
        let filled = fill(mesh, HoleChoice::Largest, with_color(color)).unwrap().mesh;
        let uv = filled.corner().pairs("uv").unwrap();
        let shown = &uv[mesh.faces().corners().len()..];
        shown.iter().filter(|&&uv| mesh.texture().unwrap().sample(uv)[2] > 100.0).count()
    }
    assert_eq!(blue_corners(3.0, &mesh), 0);
    // If colors are not compared, blue parts may be copied, too.
    assert!(blue_corners(0.0, &mesh) > 0);
}

#[test]
fn copied_parts_have_the_vertex_colors_around_the_hole() {
    let mesh = two_colors();
    // The mean blueness of the fill's vertices, from 0 for red to 1 for blue.
    let [with, without] = [3.0, 0.0].map(|color: f64| {
        let filled = fill(&mesh, HoleChoice::Largest, with_color(color)).unwrap().mesh;
        let colors = &filled.vertex().colors("color").unwrap()[mesh.positions().len()..];
        colors
            .iter()
            .map(|color| f64::from(color[2] - RED[2]) / f64::from(BLUE[2] - RED[2]))
            .sum::<f64>()
            / colors.len() as f64
    });
    assert!(with < 0.15 && 0.3 < without, "{with} {without}");
}
