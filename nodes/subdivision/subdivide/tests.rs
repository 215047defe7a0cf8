use maquette_value::{Attribute, Column, Faces};
use nalgebra::{Matrix3, Point3, Vector3};

use super::*;
use crate::refine::plan::apply;
use crate::refine::topology::Topology;
use crate::{Boundary, Corners, Creases, Scheme};

mod butterfly;
mod creases;
mod limit_surface;
mod live;
mod local;
mod polygons;
mod shapes;

fn options(levels: u32, limit: bool, boundary: Boundary) -> Subdivision {
    scheme_options(Scheme::Loop, levels, limit, boundary)
}

fn scheme_options(scheme: Scheme, levels: u32, limit: bool, boundary: Boundary) -> Subdivision {
    Subdivision {
        scheme,
        levels,
        limit,
        boundary,
        creases: Creases::OpenSubdiv,
        corners: Corners::Linear,
    }
}

fn refine(mesh: &Mesh, levels: u32) -> Mesh {
    subdivide(mesh, options(levels, false, Boundary::EdgeAndCorner)).unwrap()
}

fn limit(mesh: &Mesh, levels: u32) -> Mesh {
    subdivide(mesh, options(levels, true, Boundary::EdgeAndCorner)).unwrap()
}

/// A mesh with random positions, for tests of the topology or of properties that hold for any positions.
fn scattered_mesh(faces: Vec<[u32; 3]>) -> Mesh {
    let vertices = faces.iter().flatten().max().map_or(0, |&vertex| vertex + 1);
    let mut state = 7u32;
    fn random(state: &mut u32) -> f64 {
        *state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(*state >> 8) / f64::from(1 << 24) - 0.5
    }
    let positions: Vec<_> = (0..vertices)
        .map(|_| Point3::new(random(&mut state), random(&mut state), random(&mut state)))
        .collect();
    Mesh::new(positions, Faces::triangles(faces)).unwrap()
}

fn mesh_at(faces: Vec<[u32; 3]>, positions: &[[f64; 3]]) -> Mesh {
    let positions: Vec<Point3<f64>> = positions.iter().map(|&point| point.into()).collect();
    Mesh::new(positions, Faces::triangles(faces)).unwrap()
}

fn tetrahedron() -> Vec<[u32; 3]> {
    vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
}

/// A bipyramid over a ring of `n` vertices; the last two vertices are the poles.
fn bipyramid(n: u32) -> Vec<[u32; 3]> {
    (0..n).flat_map(|i| [[i, (i + 1) % n, n], [(i + 1) % n, i, n + 1]]).collect()
}

/// An octahedron with corners on the axes and outward normals.
fn octahedron() -> Mesh {
    let ring = [[1., 0., 0.], [0., 1., 0.], [-1., 0., 0.], [0., -1., 0.]];
    mesh_at(bipyramid(4), &[&ring[..], &[[0., 0., 1.], [0., 0., -1.]]].concat())
}

fn icosahedron() -> Vec<[u32; 3]> {
    (0..5)
        .map(|i: u32| [1 + i % 5, 1 + (i + 1) % 5, 6 + i % 5, 6 + (i + 1) % 5])
        .flat_map(|[a, b, c, d]| [[0, a, b], [a, c, b], [b, c, d], [11, d, c]])
        .collect()
}

/// Creates a sheet of `m` x `n` squares, each of two triangles. If `around` is true, the sheet is closed to a torus.
fn sheet(m: u32, n: u32, around: bool) -> Vec<[u32; 3]> {
    let (rows, columns) = if around { (m, n) } else { (m + 1, n + 1) };
    fn vertex_index(i: u32, j: u32, rows: u32, columns: u32) -> u32 {
        i % rows * columns + j % columns
    }
    (0..m * n)
        .map(|k| (k / n, k % n))
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [
                vertex_index(i, j, rows, columns),
                vertex_index(i, j + 1, rows, columns),
                vertex_index(i + 1, j + 1, rows, columns),
                vertex_index(i + 1, j, rows, columns),
            ];
            [[a, b, c], [a, c, d]]
        })
        .collect()
}

/// A sheet of `n` x `n` squares in the plane z = 0 on the unit lattice.
fn flat_sheet(n: u32) -> Mesh {
    mesh_at(
        sheet(n, n, false),
        &(0..(n + 1) * (n + 1))
            .map(|k: u32| [f64::from(k % (n + 1)), f64::from(k / (n + 1)), 0.0])
            .collect::<Vec<_>>(),
    )
}

/// A fan of `n` triangles around vertex 0.
fn wheel(n: u32) -> Vec<[u32; 3]> {
    (0..n).map(|i| [0, 1 + i, 1 + (i + 1) % n]).collect()
}

/// Creates a hexagonal wheel on the unit circle; `height` is a function of x and y.
fn hexagon(height: fn(f64, f64) -> f64) -> Mesh {
    let mut positions = vec![[0.0, 0.0, height(0.0, 0.0)]];
    positions.extend((0..6).map(|i| {
        let (y, x) = libm::sincos(f64::from(i) * std::f64::consts::FRAC_PI_3);
        [x, y, height(x, y)]
    }));
    mesh_at(wheel(6), &positions)
}

fn farthest(a: &[Point3<f64>], b: &[Point3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

#[test]
fn each_step_has_its_counts_and_keeps_the_euler_characteristic() {
    let cases = [
        (tetrahedron(), 2),
        (bipyramid(4), 2),
        (icosahedron(), 2),
        (sheet(3, 4, true), 0),
        (sheet(2, 3, false), 1),
    ];
    for (faces, euler) in cases {
        let mut mesh = scattered_mesh(faces);
        for _ in 0..5 {
            let (v, e, f) =
                (mesh.positions().len(), mesh.edges().vertices.len(), mesh.faces().len());
            assert_eq!(v as i64 - e as i64 + f as i64, euler);
            mesh = refine(&mesh, 1);
            let edges = mesh.edges();
            assert_eq!((mesh.positions().len(), mesh.faces().len()), (v + e, 4 * f));
            assert_eq!((edges.vertices.len(), edges.misoriented), (2 * e + 3 * f, 0));
        }
    }
}

#[test]
fn new_vertices_are_the_edges_midpoints_in_order_and_new_faces_begin_at_their_corner() {
    let mesh = mesh_at(vec![[0, 1, 2]], &[[0., 0., 0.], [4., 0., 0.], [0., 4., 0.]]);
    let mesh = refine(&mesh, 1);
    assert_eq!(mesh.positions()[3..], [[2., 0., 0.], [2., 2., 0.], [0., 2., 0.]].map(Point3::from));
    let faces: Vec<_> = mesh.faces().iter().collect();
    assert_eq!(faces, [[0, 3, 5], [1, 4, 3], [2, 5, 4], [3, 4, 5]]);
}

#[test]
fn the_limit_is_the_same_from_every_level() {
    for n in 3..=12 {
        for faces in [bipyramid(n), wheel(n), sheet(1, n, false)] {
            for boundary in [Boundary::EdgeAndCorner, Boundary::EdgeOnly] {
                let mesh = scattered_mesh(faces.clone());
                let direct = subdivide(&mesh, options(0, true, boundary)).unwrap();
                for levels in 1..=3 {
                    let later = subdivide(&mesh, options(levels, true, boundary)).unwrap();
                    let error = farthest(direct.positions(), later.positions());
                    assert!(error < 1e-14, "{n} {boundary:?} {levels} {error}");
                }
            }
        }
    }
}

#[test]
fn the_limit_weighs_the_center_as_loop_does() {
    let weights = [
        (3, 0.4),
        (4, 0.4363636364),
        (5, 0.4714217269),
        (6, 0.5),
        (7, 0.5221572621),
        (8, 0.5391475166),
        (9, 0.5522297731),
        (10, 0.5624064725),
        (12, 0.5768163776),
    ];
    for (n, weight) in weights {
        let mut heights = vec![[0.0; 3]; n as usize + 1];
        heights[0] = [0.0, 0.0, 1.0];
        let center = limit(&mesh_at(wheel(n), &heights), 0).positions()[0].z;
        assert!((center - weight).abs() < 1e-10, "{n} {center}");
    }
}

#[test]
fn a_regular_vertex_is_a_box_splines() {
    fn height(mesh: Mesh) -> f64 {
        limit(&mesh, 0).positions()[0].z
    }
    assert!((height(hexagon(|x, y| f64::from(x == 0.0 && y == 0.0))) - 0.5).abs() < 1e-14);
    assert!((height(hexagon(|x, _| f64::from(x == 1.0))) - 1.0 / 12.0).abs() < 1e-14);
    assert!((height(hexagon(|x, _| x * x)) - 0.25).abs() < 1e-14);
    assert!((height(hexagon(|_, y| y * y)) - 0.25).abs() < 1e-14);
    assert!(height(hexagon(|x, y| x * y)).abs() < 1e-14);
}

#[test]
fn subdivision_commutes_with_affine_maps() {
    let linear = Matrix3::new(1., 2., -1., 0.5, 1., 0., 3., -2., 1.);
    fn map(points: &[Point3<f64>], linear: &Matrix3<f64>) -> Vec<Point3<f64>> {
        points.iter().map(|point| *linear * point + Vector3::new(5., -1., 2.)).collect::<Vec<_>>()
    }
    for faces in [icosahedron(), sheet(3, 3, false)] {
        let mesh = scattered_mesh(faces);
        let mapped = mesh.with_positions(map(mesh.positions(), &linear)).unwrap();
        let (first, then) = (limit(&mapped, 2), map(limit(&mesh, 2).positions(), &linear));
        assert!(farthest(first.positions(), &then) < 1e-13);
    }
}

#[test]
fn a_flat_mesh_stays_flat_with_perpendicular_normals() {
    let meshes = (2..8)
        .map(|faces: u32| {
            fn angle(i: u32, faces: u32) -> f64 {
                std::f64::consts::PI * f64::from(i) / f64::from(faces)
            }
            let rim =
                (0..=faces).map(|i| [libm::cos(angle(i, faces)), libm::sin(angle(i, faces)), 0.0]);
            let positions = std::iter::once([0.0; 3]).chain(rim).collect::<Vec<_>>();
            mesh_at((1..=faces).map(|i| [0, i, i + 1]).collect(), &positions)
        })
        .chain([flat_sheet(3), hexagon(|_, _| 0.0)]);
    for mesh in meshes {
        for boundary in [Boundary::EdgeAndCorner, Boundary::EdgeOnly] {
            for levels in [0, 2] {
                let limit = subdivide(&mesh, options(levels, true, boundary)).unwrap();
                assert!(limit.positions().iter().all(|point| point.z == 0.0));
                let normals = limit.vertex().vectors("normal").unwrap();
                assert!(
                    normals.iter().all(|normal| (normal[2] - 1.0).abs() < 1e-12),
                    "{normals:?}"
                );
            }
        }
    }
}

#[test]
fn the_limit_stays_within_the_hull_of_its_neighbors() {
    for faces in [bipyramid(3), bipyramid(40), icosahedron(), sheet(3, 3, false)] {
        let mesh = scattered_mesh(faces);
        let topology = Topology::from_mesh(&mesh, options(0, true, Boundary::EdgeAndCorner));
        let limit = Limit::new(&topology).unwrap();
        for vertex in 0..topology.vertices {
            let (_, weights) = limit.positions.row(vertex);
            assert!(weights.iter().all(|&weight| weight >= 0.0));
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-14);
        }
    }
}

#[test]
fn normals_of_a_closed_surface_point_outward() {
    let mesh = limit(&octahedron(), 3);
    let normals = mesh.vertex().vectors("normal").unwrap();
    for (normal, point) in normals.iter().zip(mesh.positions().iter()) {
        assert!(Vector3::from(*normal).dot(&point.coords.normalize()) > 0.8);
    }
}

#[test]
fn an_ear_follows_its_boundary_edges() {
    let mesh = scattered_mesh(vec![[0, 1, 2], [1, 3, 2]]);
    let [v0, v1, _, v3] = std::array::from_fn(|i| mesh.positions()[i].coords);
    let refined = refine(&mesh, 1);
    let expected = 0.75 * v1 + 0.125 * (v0 + v3);
    assert!((refined.positions()[1].coords - expected).norm() < 1e-15);
    assert_eq!(refined.positions()[0], mesh.positions()[0]);
}

#[test]
fn a_plan_serves_every_mesh_of_its_topology() {
    let mesh = scattered_mesh(sheet(3, 4, false));
    let topology = Topology::from_mesh(&mesh, options(1, false, Boundary::EdgeOnly));
    let step = Step::from_topology(&topology).unwrap();
    let turned = mesh.positions().iter().map(|point| Point3::new(point.y, point.z, point.x));
    let moved = mesh.with_positions(turned.collect()).unwrap();
    let anew = subdivide(&moved, options(1, false, Boundary::EdgeOnly)).unwrap();
    assert_eq!(apply(&moved, &[step], &maquette_node::Progress::silent()).unwrap(), anew);
}

#[test]
fn other_numbers_for_the_vertices_give_the_same_surface() {
    let mesh = scattered_mesh(icosahedron());
    fn renumber(vertex: u32) -> u32 {
        (vertex * 5 + 3) % 12
    }
    let faces =
        mesh.faces().as_triangles().unwrap().iter().map(|face| face.map(renumber)).collect();
    let mut positions = vec![Point3::origin(); 12];
    (0..).zip(mesh.positions().iter()).for_each(|(i, &p)| positions[renumber(i) as usize] = p);
    let other = refine(&Mesh::new(positions, Faces::triangles(faces)).unwrap(), 2);
    let mesh = refine(&mesh, 2);
    for (corner, twin) in mesh.faces().corners().iter().zip(other.faces().corners().iter()) {
        let points = (mesh.positions()[*corner as usize], other.positions()[*twin as usize]);
        assert!((points.0 - points.1).norm() < 1e-15);
    }
}

#[test]
fn the_bytes_do_not_depend_on_the_number_of_threads() {
    let mesh = scattered_mesh(sheet(60, 60, true));
    fn refine_with_threads(threads: usize, mesh: &Mesh) -> Mesh {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| limit(mesh, 1))
    }
    let one = refine_with_threads(1, &mesh);
    assert_eq!([refine_with_threads(2, &mesh), refine_with_threads(8, &mesh)], [one.clone(), one]);
}

/// A cube with two triangles per side and 12 sharp edges.
fn cube(sharpness: f64) -> Mesh {
    let sides =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let faces = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    let mesh = mesh_at(
        faces,
        &(0..8).map(|i: u32| [i & 1, i >> 1 & 1, i >> 2].map(f64::from)).collect::<Vec<_>>(),
    );
    let edges = (0..8u32).flat_map(|a| [1, 2, 4].map(|bit| [a, a | bit])).filter(|[a, b]| a != b);
    mesh.with_creases(edges.map(|edge| (edge, sharpness)).collect::<Vec<_>>()).unwrap()
}

#[test]
fn a_cube_with_sharp_edges_stays_a_cube() {
    let mesh = limit(&cube(10.0), 3);
    for point in mesh.positions().iter() {
        assert!(point.coords.iter().any(|x| x.abs() < 1e-14 || (x - 1.0).abs() < 1e-14));
    }
    assert_eq!(mesh.positions()[..8], cube(0.0).positions()[..]);
    assert_eq!(mesh.creases().len(), 12 * 8);
}

#[test]
fn a_sharpness_of_one_lasts_one_step_and_half_a_sharpness_is_interpolated() {
    let first = refine(&cube(1.0), 1);
    assert_eq!(first.positions()[..], refine(&cube(10.0), 1).positions()[..]);
    assert_eq!(first.creases().len(), 0);
    assert_eq!(refine(&cube(1.0), 2).positions()[..], refine(&first, 1).positions()[..]);
    let [smooth, half, sharp] = [0.0, 0.5, 10.0].map(|sharpness| refine(&cube(sharpness), 1));
    for i in 0..half.positions().len() {
        let middle = nalgebra::center(&smooth.positions()[i], &sharp.positions()[i]);
        assert!((half.positions()[i] - middle).norm() < 1e-15);
    }
}

#[test]
fn a_crease_is_the_cubic_spline_of_its_edges() {
    let mesh = scattered_mesh(sheet(4, 4, false));
    let line: Vec<u32> = (0..5).map(|j| 10 + j).collect();
    let creases: Vec<_> = line.windows(2).map(|ends| ([ends[0], ends[1]], 10.0)).collect();
    let limit = limit(&mesh.clone().with_creases(creases).unwrap(), 2);
    let [left, middle, right] = [11, 12, 13].map(|i| mesh.positions()[i].coords);
    let expected = (left + 4.0 * middle + right) / 6.0;
    assert!((limit.positions()[12].coords - expected).norm() < 1e-14);
}

#[test]
fn without_boundary_the_outer_faces_are_removed() {
    let mesh = subdivide(&flat_sheet(4), options(1, true, Boundary::None)).unwrap();
    assert_eq!((mesh.faces().len(), mesh.positions().len()), (4 * 8, 25));
    for point in mesh.positions().iter() {
        let [x, y] = [point.x, point.y].map(|x| (2.0 * x - (2.0 * x).round()).abs());
        assert!(x < 1e-13 && y < 1e-13, "{point}");
    }
    let (low, high) = mesh.bounds().unwrap();
    assert!((low.x - 1.0).abs() < 1e-13 && (high.y - 3.0).abs() < 1e-13);
}

#[test]
fn attributes_are_linear_along_edges_and_within_faces() {
    let mesh = scattered_mesh(vec![[0, 1, 2]])
        .with_vertex("uv", Attribute::Pair(vec![[0., 0.], [1., 0.], [0., 1.]].into()))
        .and_then(|m| m.with_vertex("filled", Attribute::Flag(vec![1, 0, 0].into())))
        .and_then(|m| m.with_vertex("label", Attribute::Index(vec![7, 8, 9].into())))
        .and_then(|m| {
            m.with_vertex("color", Attribute::Color(vec![[0; 3], [255; 3], [9; 3]].into()))
        })
        .and_then(|m| m.with_vertex("normal", Attribute::Vector(vec![[0., 0., 1.]; 3].into())))
        .and_then(|m| m.with_corner("heat", Attribute::Number(vec![0., 4., 8.].into())))
        .and_then(|m| m.with_face("part", Attribute::Index(vec![5].into())))
        .unwrap();
    let refined = refine(&mesh, 1);
    fn vertex(name: &str, refined: &Mesh) -> Option<Attribute> {
        refined.vertex().get(name).cloned()
    }
    let uv = vec![[0., 0.], [1., 0.], [0., 1.], [0.5, 0.], [0.5, 0.5], [0., 0.5]];
    assert_eq!(vertex("uv", &refined), Some(Attribute::Pair(uv.into())));
    assert_eq!(vertex("filled", &refined), Some(Attribute::Flag(vec![1, 0, 0, 1, 0, 1].into())));
    assert_eq!(vertex("label", &refined), Some(Attribute::Index(vec![7, 8, 9, 7, 8, 7].into())));
    let grays = [0, 255, 9, 128, 132, 5].map(|gray| [gray; 3]);
    assert_eq!(vertex("color", &refined), Some(Attribute::Color(grays.to_vec().into())));
    assert_eq!(vertex("normal", &refined), None);
    let heat = [0., 2., 4., 4., 6., 2., 8., 4., 6., 2., 6., 4.];
    assert_eq!(refined.corner().get("heat"), Some(&Attribute::Number(heat.to_vec().into())));
    assert_eq!(refined.face().get("part"), Some(&Attribute::Index(Column::from(vec![5; 4]))));
}

#[test]
fn a_seam_keeps_both_of_its_texture_coordinates() {
    let uv = vec![[0., 0.], [0.4, 0.], [0.4, 1.], [0.6, 0.], [1., 0.], [0.6, 1.]];
    let mesh = scattered_mesh(vec![[0, 1, 2], [1, 3, 2]]);
    let mesh = mesh.with_corner("uv", Attribute::Pair(uv.into())).unwrap();
    let refined = refine(&mesh, 3);
    let (uv, corners) = (refined.corner().pairs("uv").unwrap(), refined.faces().corners());
    fn position(
        vertex: u32,
        first_half: bool,
        corners: &Column<u32>,
        uv: &Column<[f64; 2]>,
    ) -> Vec<[f64; 2]> {
        let half = corners.len() / 2;
        (0..corners.len())
            .filter(move |&c| corners[c] == vertex && (c < half) == first_half)
            .map(|c| uv[c])
            .collect::<Vec<_>>()
    }
    assert!(
        position(2, true, corners, uv).iter().all(|&uv| uv == [0.4, 1.])
            && !position(2, true, corners, uv).is_empty()
    );
    assert!(
        position(2, false, corners, uv).iter().all(|&uv| uv == [0.6, 1.])
            && !position(2, false, corners, uv).is_empty()
    );
}

#[test]
fn polygons_and_non_manifold_meshes_are_errors() {
    fn error(mesh: &Mesh) -> String {
        subdivide(mesh, options(1, false, Boundary::EdgeOnly)).unwrap_err().to_string()
    }
    let points = vec![Point3::origin(); 7];
    let mixed = Faces::polygons(&[3, 4], vec![0, 1, 2, 0, 2, 3, 4]).unwrap();
    assert_eq!(
        error(&Mesh::new(points, mixed).unwrap()),
        "face 1 has 4 corners, but Loop's scheme needs triangles; use `CatmullClark`, or `Remesh` to make triangles"
    );
    let three = error(&scattered_mesh(vec![[0, 1, 2], [1, 0, 3], [0, 1, 4]]));
    let expected = "the mesh is not a surface: 1 edges have more than two faces or faces that disagree about their side: (0, 1); use `Orient` to turn faces, or `Reconstruct` to make one surface";
    assert_eq!(three, expected);
    let turned = error(&scattered_mesh(vec![[0, 1, 2], [0, 1, 3]]));
    assert_eq!(turned, expected);
    let bow_tie = error(&scattered_mesh(vec![[0, 1, 2], [0, 3, 4]]));
    assert_eq!(
        bow_tie,
        "the mesh is not a surface: 1 vertices join fans of faces: 0; use `Remesh`, which separates them"
    );
}

#[test]
fn a_result_that_is_too_large_is_an_error_before_it_is_made() {
    let mesh = scattered_mesh(sheet(100, 100, true));
    let error = subdivide(&mesh, options(8, false, Boundary::EdgeOnly)).unwrap_err();
    assert_eq!(
        error.to_string(),
        "a mesh of 8 levels more would need about 3 900 000 000 corners, at most 270 000 000 are made: choose fewer `levels`"
    );
    assert!(subdivide(&mesh, options(u32::MAX, false, Boundary::EdgeOnly)).is_err());
}

#[test]
fn a_mesh_without_faces_or_with_loose_vertices_is_refined_as_it_is() {
    let loose = mesh_at(vec![[1, 2, 3]], &[[9.; 3], [0.; 3], [1., 0., 0.], [0., 1., 0.]]);
    for boundary in [Boundary::EdgeAndCorner, Boundary::EdgeOnly] {
        let refined = subdivide(&loose, options(2, true, boundary)).unwrap();
        assert_eq!(refined.positions()[0], Point3::new(9., 9., 9.));
    }
    let gone = subdivide(&loose, options(2, true, Boundary::None)).unwrap();
    assert_eq!((gone.positions().len(), gone.faces().len()), (0, 0));
    assert_eq!(limit(&mesh_at(vec![], &[]), 3).faces().len(), 0);
}
