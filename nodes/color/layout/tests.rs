use std::collections::BTreeSet;
use std::f64::consts::TAU;

use maquette_value::Faces;
use nalgebra::{Point3, Vector2};
use robust::{Coord, orient2d};

use super::*;

fn lie(mesh: &Mesh, layout: &Layout) -> LaidOut {
    let laid = lay_out(mesh, layout, &Progress::silent()).unwrap();
    check_layout(mesh, &laid, layout);
    laid
}

/// Returns the corners of each triangle in the plane, in texels.
fn triangles(mesh: &Mesh, size: usize) -> Vec<[Vector2<f64>; 3]> {
    let uv = mesh.corner().pairs("uv").unwrap();
    let faces = (0..mesh.faces().len())
        .map(|face| (mesh.faces().first_corner(face), mesh.faces().face(face).len()));
    faces
        .flat_map(|(first, count)| {
            (1..count - 1).map(move |k| {
                [first, first + k, first + k + 1]
                    .map(|corner: usize| Vector2::from(uv[corner]) * size as f64)
            })
        })
        .collect()
}

/// Checks that no triangle is inverted, overlaps another, or is closer to the border of the square than half of the padding, and that the
/// layout keeps positions and faces.
fn check_layout(mesh: &Mesh, laid: &LaidOut, layout: &Layout) {
    let all = triangles(&laid.mesh, layout.size);
    fn coord(at: Vector2<f64>) -> Coord<f64> {
        Coord { x: at.x, y: at.y }
    }
    for [a, b, c] in &all {
        assert!(orient2d(coord(*a), coord(*b), coord(*c)) > 0.0, "{a} {b} {c}");
        let margin = layout.padding as f64 / 2.0 - 1e-9;
        let inside = margin..=layout.size as f64 - margin;
        assert!([a, b, c].iter().all(|at| at.iter().all(|x| inside.contains(x))));
    }
    assert_eq!(overlap(&all), None);
    assert_eq!(laid.mesh.positions(), mesh.positions());
    assert_eq!(laid.mesh.faces(), mesh.faces());
}

/// Returns the minimum and maximum ratio of lengths in the plane to lengths in space, over all sides, at the scale of the layout.
fn stretch(laid: &LaidOut, size: usize) -> [f64; 2] {
    let mesh = &laid.mesh;
    let uv = mesh.corner().pairs("uv").unwrap();
    let mut range = [f64::INFINITY, 0.0];
    for face in 0..mesh.faces().len() {
        let (first, corners) = (mesh.faces().first_corner(face), mesh.faces().face(face));
        for k in 0..corners.len() {
            let next = (k + 1) % corners.len();
            let [a, b] = [k, next].map(|k| mesh.positions()[corners[k] as usize]);
            let [s, t] = [k, next].map(|k| Vector2::from(uv[first + k]) * size as f64);
            let ratio = (t - s).norm() / ((b - a).norm() * laid.scale);
            range = [range[0].min(ratio), range[1].max(ratio)];
        }
    }
    range
}

fn cube() -> Mesh {
    let places = (0..8).map(|k| [k & 1, k >> 1 & 1, k >> 2].map(f64::from)).map(Point3::from);
    let quads = [0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5];
    Mesh::new(places.collect::<Vec<_>>(), Faces::uniform(4, quads.to_vec()).unwrap()).unwrap()
}

/// Returns a sheet of `n` by `m` cells of two triangles each, closed along the first direction if `is_closed`.
fn sheet([n, m]: [u32; 2], is_closed: bool, place: impl Fn(f64, f64) -> [f64; 3]) -> Mesh {
    let columns = if is_closed { n } else { n + 1 };
    let places = (0..columns * (m + 1)).map(|k| {
        let [u, v] = [f64::from(k % columns) / f64::from(n), f64::from(k / columns) / f64::from(m)];
        Point3::from(place(u, v))
    });
    let cells = (0..n * m).flat_map(|k| {
        let at = |i: u32, j: u32| (k / n + j) * columns + (k % n + i) % columns;
        [[at(0, 0), at(1, 0), at(1, 1)], [at(0, 0), at(1, 1), at(0, 1)]]
    });
    let faces = Faces::triangles(cells.collect());
    Mesh::new(places.collect::<Vec<_>>(), faces).unwrap()
}

fn torus(n: u32, m: u32) -> Mesh {
    // The surface is a torus that is closed in the first direction and cut open along a circle in the second direction.
    sheet([n, m], true, |u, v| {
        let ((s, c), (t, d)) = (libm::sincos(TAU * u), libm::sincos(TAU * v));
        [(40.0 + 15.0 * d) * c, (40.0 + 15.0 * d) * s, 15.0 * t]
    })
}

#[test]
fn a_cube_has_six_charts_without_stretch() {
    let layout = Layout { size: 256, ..Layout::default() };
    let laid = lie(&cube(), &layout);
    assert_eq!(laid.charts, 6);
    let [least, most] = stretch(&laid, 256);
    assert!((1.0 - least).abs() < 1e-12 && (most - 1.0).abs() < 1e-12, "{least} {most}");
    // The square is filled by nearly two by three charts and their padding.
    assert!(laid.scale > 256.0 / 3.0 - 4.0 - 3.0, "{}", laid.scale);
}

#[test]
fn what_unrolls_is_not_stretched() {
    // The surface is a quarter of a tube: its normals deviate from their mean by up to 45 degrees, 26 on average.
    let tube = sheet([20, 10], false, |u, v| {
        let (s, c) = libm::sincos(TAU / 4.0 * u);
        [10.0 * c, 10.0 * s, 20.0 * v]
    });
    let layout = Layout::default();
    let laid = lie(&tube, &layout);
    assert_eq!(laid.charts, 1);
    let [least, most] = stretch(&laid, layout.size);
    assert!(0.999 < least && most < 1.001, "{least} {most}");
    // A whole tube is cut.
    let tube = sheet([60, 10], true, |u, v| {
        let (s, c) = libm::sincos(TAU * u);
        [10.0 * c, 10.0 * s, 20.0 * v]
    });
    let laid = lie(&tube, &layout);
    let [least, most] = stretch(&laid, layout.size);
    assert!(
        (2..8).contains(&laid.charts) && 0.99 < least && most < 1.01,
        "{} {least} {most}",
        laid.charts
    );
}

#[test]
fn what_is_round_is_stretched_little() {
    for bend in [5.0, 40.0, 80.0] {
        let layout = Layout { bend, ..Layout::default() };
        let laid = lie(&torus(60, 30), &layout);
        let [least, most] = stretch(&laid, layout.size);
        let bound = 0.1 + bend * bend / 3000.0;
        assert!(
            1.0 - bound < least && most < 1.0 + bound,
            "{bend}: {} {least} {most}",
            laid.charts
        );
    }
}

#[test]
fn noise_and_folds_are_cut_out() {
    fn rough(u: f64, v: f64) -> f64 {
        libm::sin(u * 977.0) * libm::cos(v * 1313.0)
    }
    for height in [0.01, 0.1, 1.0] {
        let mesh = sheet([40, 40], false, |u, v| [u, v, height * rough(u, v)]);
        lie(&mesh, &Layout::default());
    }
    // The surface is a staircase that winds over itself.
    let stairs = sheet([200, 4], false, |u, v| {
        let (s, c) = libm::sincos(3.0 * TAU * u);
        [(1.0 + v) * c, (1.0 + v) * s, 0.1 * u]
    });
    assert!(lie(&stairs, &Layout::default()).charts > 2);
}

#[test]
fn a_triangle_and_what_is_not_manifold_have_charts() {
    let places = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.], [0., -1., 0.]];
    fn fin(faces: Vec<[u32; 3]>, places: &[[f64; 3]; 5]) -> Mesh {
        Mesh::new(places.map(Point3::from).to_vec(), Faces::triangles(faces)).unwrap()
    }
    let layout = Layout { size: 64, ..Layout::default() };
    let one = lie(&fin(vec![[0, 1, 2]], &places), &layout);
    assert_eq!(one.charts, 1);
    // The chart of the triangle has the largest possible scale: the legs of the triangle are along the sides of the square.
    assert!(one.scale > 64.0 - 4.0 - 4.0, "{}", one.scale);
    // Three faces meet at one edge, and a neighbor has the opposite orientation.
    assert_eq!(lie(&fin(vec![[0, 1, 2], [0, 1, 3], [1, 0, 4]], &places), &layout).charts, 3);
    assert_eq!(lie(&fin(vec![[0, 1, 2], [0, 1, 4]], &places), &layout).charts, 2);
    assert_eq!(lie(&fin(vec![[0, 1, 2], [1, 0, 4]], &places), &layout).charts, 1);
}

#[test]
fn charts_keep_their_distance() {
    for padding in [0, 1, 7, 32] {
        let layout = Layout { size: 256, padding, bend: 20.0 };
        let laid = lie(&torus(30, 16), &layout);
        let all = triangles(&laid.mesh, 256);
        let uv = laid.mesh.corner().pairs("uv").unwrap();
        // Assigns triangles to charts: triangles with coincident corners belong to one chart.
        let mut sets = UnionFind::new(all.len());
        let mut places = std::collections::BTreeMap::new();
        for (corner, uv) in uv.iter().enumerate() {
            let first = *places.entry(uv.map(f64::to_bits)).or_insert(corner / 3);
            sets.union(first as u32, (corner / 3) as u32);
        }
        let (charts, _) = sets.into_labels();
        assert_eq!(charts.iter().collect::<BTreeSet<_>>().len(), laid.charts);
        let corners: Vec<_> =
            all.iter().zip(&charts).flat_map(|(it, chart)| it.map(|at| (at, chart))).collect();
        for (k, (a, chart)) in corners.iter().enumerate() {
            for (b, other) in corners[k + 1..].iter().filter(|it| it.1 != *chart) {
                let distance = (a - b).norm();
                assert!(padding as f64 - 1e-9 <= distance, "{padding}: {distance} {chart} {other}");
            }
        }
    }
}

#[test]
fn the_layout_is_the_same_on_any_number_of_threads() {
    let mesh = torus(60, 30);
    fn lay_out_with(threads: usize, mesh: &Mesh) -> Mesh {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| lay_out(mesh, &Layout::default(), &Progress::silent()).unwrap().mesh)
    }
    assert_eq!(lay_out_with(1, &mesh), lay_out_with(3, &mesh));
}

#[test]
fn a_large_mesh_has_charts_as_small_ones_have() {
    // The torus has so many faces that clusters of them are merged in rounds.
    let mesh = torus(160, 70);
    assert!(mesh.faces().len() >= 20_000);
    let laid = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| lay_out(&mesh, &Layout::default(), &Progress::silent()).unwrap())
    });
    assert_eq!(laid[0].mesh, laid[1].mesh);
    check_layout(&mesh, &laid[0], &Layout::default());
    let small = lie(&torus(60, 30), &Layout::default());
    let [large, few] = [laid[0].charts, small.charts];
    assert!(large <= 2 * few, "{large} charts, {few} of the small mesh");
    let [least, most] = stretch(&laid[0], Layout::default().size);
    assert!(0.4 < least && most < 1.6, "{least} {most}");
}

#[test]
fn unsuitable_meshes_are_errors() {
    fn error(mesh: &Mesh, layout: Layout) -> String {
        lay_out(mesh, &layout, &Progress::silent()).unwrap_err().to_string()
    }
    let layout = Layout::default();
    let empty = Mesh::new(vec![], Faces::triangles(vec![])).unwrap();
    assert!(error(&empty, layout).starts_with("the mesh has no faces, so that there is nothing"));
    let line = Mesh::new(
        [0., 1., 2.].map(|x| Point3::new(x, 0., 0.)).to_vec(),
        Faces::triangles(vec![[0, 1, 2]]),
    );
    assert_eq!(
        error(&line.unwrap(), layout),
        "all 1 faces of the mesh have no area, so that nothing can be laid out; check the positions of its vertices, which extend over 2e0 mm"
    );
    assert_eq!(
        error(&cube(), Layout { size: 16, padding: 20, ..layout }),
        "6 charts with a padding of 20 px do not fit into 16 x 16 px: choose a larger `size` or `bend`, or a smaller `padding`"
    );
    assert_eq!(
        error(&cube(), Layout { size: 10_000, ..layout }),
        "the atlas would need about 10 000 pixels along a side, at most 8 200 are made: choose a smaller `size`"
    );
    assert_eq!(
        error(&cube(), Layout { size: 8, ..layout }),
        "`size` is 8, but must be at least 16 px"
    );
    assert_eq!(
        error(&cube(), Layout { bend: 90.0, ..layout }),
        "`bend` is 90, but must be from 1 to 80 degrees"
    );
    let far =
        cube().with_positions(cube().positions().iter().map(|at| at * 1e200).collect()).unwrap();
    assert!(error(&far, layout).starts_with("the mesh is 1e200 mm large"));
}
