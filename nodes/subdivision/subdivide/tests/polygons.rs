//! Tests of the schemes for polygons.

use maquette_node::Progress;
use maquette_value::Faces;
use nalgebra::{Matrix3, Point3, Vector3};

use super::super::*;
use super::shapes::*;
use super::{farthest, scheme_options};
use crate::refine::plan::apply;
use crate::refine::topology::Topology;
use crate::{Boundary, Creases, Scheme};

const BOTH: [Scheme; 2] = [Scheme::CatmullClark, Scheme::DooSabin];
const BOUNDARIES: [Boundary; 2] = [Boundary::EdgeAndCorner, Boundary::EdgeOnly];

fn refine(mesh: &Mesh, scheme: Scheme, levels: u32) -> Mesh {
    subdivide(mesh, scheme_options(scheme, levels, false, Boundary::EdgeAndCorner)).unwrap()
}

fn limit(mesh: &Mesh, scheme: Scheme, levels: u32) -> Mesh {
    subdivide(mesh, scheme_options(scheme, levels, true, Boundary::EdgeAndCorner)).unwrap()
}

fn families() -> Vec<Vec<Vec<u32>>> {
    let closed = [tetrahedron(), cube_faces(), bipyramid(4), icosahedron(), sheet(3, 4, true)];
    let open = [sheet(2, 3, false), patchwork(), rosette(5, 4), fan(3, 5), fan(1, 4)];
    closed.into_iter().chain(open).chain([prism(5), trapezohedron(3)]).collect()
}

fn counts(mesh: &Mesh) -> [usize; 4] {
    let edges = mesh.edges();
    assert!(edges.misoriented == 0 && edges.faces.iter().all(|&faces| faces <= 2));
    let border = edges.faces.iter().filter(|&&faces| faces == 1).count();
    [mesh.positions().len(), edges.vertices.len(), mesh.faces().len(), border]
}

#[test]
fn each_step_has_its_counts_and_keeps_the_euler_characteristic() {
    for faces in families() {
        for scheme in BOTH {
            let mut mesh = scattered_polygons(faces.clone());
            for level in 0..5 {
                let corners = mesh.faces().corners().len();
                let [v, e, f, border] = counts(&mesh);
                mesh = refine(&mesh, scheme, 1);
                let [v1, e1, f1, border1] = counts(&mesh);
                assert_eq!((v + f) as i64 - e as i64, (v1 + f1) as i64 - e1 as i64);
                match scheme {
                    Scheme::CatmullClark => {
                        assert_eq!([v1, e1, f1], [v + e + f, 2 * e + corners, corners]);
                        assert_eq!(border1, 2 * border);
                    }
                    _ => {
                        assert_eq!([v1, f1], [corners + 2 * border, f + e + v], "{level}");
                        assert_eq!(e1, 4 * e + border, "{level}");
                    }
                }
            }
        }
    }
}

#[test]
fn a_quad_becomes_nine_by_doo_and_sabin_and_one_if_its_border_shrinks() {
    let quad = lattice(1, |_, _| 0.0);
    assert_eq!(counts(&refine(&quad, Scheme::DooSabin, 1)), [12, 20, 9, 8]);
    let shrunk =
        subdivide(&quad, scheme_options(Scheme::DooSabin, 1, false, Boundary::None)).unwrap();
    assert_eq!(counts(&shrunk), [4, 4, 1, 4]);
}

#[test]
fn several_steps_at_once_are_single_steps_one_after_the_other() {
    fn creased_mesh(faces: Vec<Vec<u32>>) -> Mesh {
        let mesh = scattered_polygons(faces);
        let creases: Vec<_> = mesh.edges().vertices.into_iter().step_by(3).zip(1..).collect();
        mesh.with_creases(creases.into_iter().map(|(ends, k)| (ends, f64::from(k % 8) / 2.0)))
            .unwrap()
    }
    for faces in families() {
        for scheme in [Scheme::Loop, Scheme::CatmullClark, Scheme::DooSabin] {
            let is_triangles = faces.iter().all(|face| face.len() == 3);
            if scheme == Scheme::Loop && !is_triangles {
                continue;
            }
            for creases in [Creases::OpenSubdiv, Creases::Chaikin, Creases::Hoppe94] {
                fn subdivision_options(
                    levels: u32,
                    scheme: Scheme,
                    creases: Creases,
                ) -> Subdivision {
                    Subdivision {
                        creases,
                        ..scheme_options(scheme, levels, false, Boundary::EdgeOnly)
                    }
                }
                let mesh = creased_mesh(faces.clone());
                let at_once = subdivide(&mesh, subdivision_options(3, scheme, creases)).unwrap();
                let steps = (0..3).fold(mesh, |mesh, _| {
                    subdivide(&mesh, subdivision_options(1, scheme, creases)).unwrap()
                });
                assert_eq!(at_once.faces(), steps.faces());
                let error = farthest(at_once.positions(), steps.positions());
                assert!(error < 1e-15, "{scheme:?} {creases:?} {error}");
                assert!(at_once.creases().eq(steps.creases()), "{scheme:?} {creases:?}");
            }
        }
    }
}

#[test]
fn the_limit_is_the_same_from_every_level() {
    let shapes = (3..=12)
        .flat_map(|n| [trapezohedron(n), prism(n), rosette(n, 4), rosette(n, 3), fan(n, 4)])
        .chain([patchwork(), cube_faces(), fan(1, 5)]);
    for faces in shapes {
        for boundary in BOUNDARIES {
            let mesh = scattered_polygons(faces.clone());
            fn subdivision_options(levels: u32, boundary: &Boundary) -> Subdivision {
                scheme_options(Scheme::CatmullClark, levels, true, *boundary)
            }
            let direct = subdivide(&mesh, subdivision_options(0, &boundary)).unwrap();
            for levels in 1..=3 {
                let later = subdivide(&mesh, subdivision_options(levels, &boundary)).unwrap();
                let error = farthest(direct.positions(), later.positions());
                assert!(error < 1e-14, "{faces:?} {boundary:?} {levels} {error}");
            }
        }
    }
}

#[test]
fn normals_are_the_same_from_every_level() {
    let around =
        |n| [trapezohedron(n), prism(n), rosette(n, 4), rosette(n, 3), fan(n, 4), fan(n, 3)];
    for faces in (3..=12).flat_map(around).chain([patchwork(), fan(1, 5), fan(2, 5)]) {
        let mesh = scattered_polygons(faces.clone());
        let edges = mesh.edges();
        let border = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1);
        let border: Vec<u32> = border.flat_map(|(ends, _)| *ends).collect();
        fn normals(levels: u32, mesh: &Mesh) -> Vec<[f64; 3]> {
            let limit = limit(mesh, Scheme::CatmullClark, levels);
            limit.vertex().vectors("normal").unwrap().to_vec()
        }
        let direct = normals(0, &mesh);
        for levels in 1..=3 {
            for (vertex, (a, b)) in (0u32..).zip(direct.iter().zip(normals(levels, &mesh))) {
                let error = (Vector3::from(*a) - Vector3::from(b)).norm();
                // The orientation of a corner's sides follows from the faces, which may be folded because positions are random. So only
                // inner vertices are compared.
                let is_inner = !border.contains(&vertex);
                assert!(!is_inner || error < 1e-11, "{faces:?} {levels} {vertex} {error}");
            }
        }
    }
}

#[test]
fn a_regular_vertex_is_a_b_splines() {
    fn spline(scheme: Scheme, weights: [f64; 3], total: f64) {
        for (i, j) in (0..9).map(|k| (k / 3, k % 3)) {
            let peak =
                |x: f64, y: f64| f64::from(x == 1.0 + f64::from(i) && y == 1.0 + f64::from(j));
            let height = limit(&lattice(4, peak), scheme, 0).positions()[12].z;
            let expected = weights[i as usize] * weights[j as usize] / total;
            assert!((height - expected).abs() < 1e-14, "{scheme:?} {height} {expected}");
        }
    }
    spline(Scheme::CatmullClark, [1.0, 4.0, 1.0], 36.0);
    spline(Scheme::DooSabin, [1.0, 6.0, 1.0], 64.0);
}

#[test]
fn the_faces_of_doo_and_sabin_keep_their_centroids_and_vertices_become_faces_around_their_limit() {
    for faces in families() {
        let mesh = scattered_polygons(faces);
        fn centroid(mesh: &Mesh, face: usize) -> Vector3<f64> {
            let corners = mesh.faces().face(face);
            let sum: Vector3<f64> =
                corners.iter().map(|&corner| mesh.positions()[corner as usize].coords).sum();
            sum / corners.len() as f64
        }
        let points = limit(&mesh, Scheme::DooSabin, 0);
        let edges = mesh.edges();
        let border = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1);
        let border: Vec<u32> = border.flat_map(|(ends, _)| *ends).collect();
        let mut refined = mesh.clone();
        for _ in 0..4 {
            refined = refine(&refined, Scheme::DooSabin, 1);
            for face in 0..mesh.faces().len() {
                assert!((centroid(&refined, face) - centroid(&mesh, face)).norm() < 1e-14);
            }
        }
        let once = refine(&mesh, Scheme::DooSabin, 1);
        let first = mesh.faces().len() + edges.vertices.len();
        for vertex in 0..mesh.positions().len() {
            if !border.contains(&(vertex as u32)) {
                let middle = centroid(&once, first + vertex);
                assert!((middle - points.positions()[vertex].coords).norm() < 1e-14);
            }
        }
    }
}

#[test]
fn the_border_of_doo_and_sabin_is_a_quadratic_spline_of_its_edges() {
    let mesh = scattered_polygons(patchwork());
    let limit = limit(&mesh, Scheme::DooSabin, 0);
    let [left, middle, right] = [1, 2, 3].map(|k| mesh.positions()[k].coords);
    let expected = (left + 6.0 * middle + right) / 8.0;
    assert!((limit.positions()[2].coords - expected).norm() < 1e-15);
    // Chaikin's curve passes through the midpoints of its control edges. So the limit point is the midpoint of an edge of the refined mesh.
    let once = refine(&mesh, Scheme::DooSabin, 1);
    let (edges, points) = (once.edges(), once.positions());
    let middles = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1);
    let mut middles = middles
        .map(|(ends, _)| nalgebra::center(&points[ends[0] as usize], &points[ends[1] as usize]));
    assert!(middles.any(|point| (point.coords - expected).norm() < 1e-15));
}

#[test]
fn subdivision_commutes_with_affine_maps() {
    let linear = Matrix3::new(1., 2., -1., 0.5, 1., 0., 3., -2., 1.);
    fn map(points: &[Point3<f64>], linear: &Matrix3<f64>) -> Vec<Point3<f64>> {
        points.iter().map(|point| *linear * point + Vector3::new(5., -1., 2.)).collect::<Vec<_>>()
    }
    for (faces, scheme) in families().into_iter().flat_map(|f| BOTH.map(|s| (f.clone(), s))) {
        let mesh = scattered_polygons(faces);
        let mapped = mesh.with_positions(map(mesh.positions(), &linear)).unwrap();
        let (first, then) =
            (limit(&mapped, scheme, 2), map(limit(&mesh, scheme, 2).positions(), &linear));
        assert!(farthest(first.positions(), &then) < 1e-13);
    }
}

#[test]
fn a_flat_mesh_stays_flat_with_perpendicular_normals() {
    fn flat(faces: Vec<Vec<u32>>, turn: f64, step: u32) -> Mesh {
        // Vertex 0 is at the center, the others are on the unit circle, except that neighbors of vertex 0 are slightly farther out.
        let count = faces.iter().flatten().max().map_or(0, |&vertex| vertex);
        let rim = (0..count).map(|k| {
            let (sine, cosine) = libm::sincos(turn * f64::from(k));
            let radius = if k % step == 0 { 1.0 } else { 1.1 };
            [radius * cosine, radius * sine, 0.0]
        });
        let positions: Vec<_> = std::iter::once([0.0; 3]).chain(rim).collect();
        polygons_at(faces, &positions)
    }
    let (pi, mut meshes) = (std::f64::consts::PI, vec![lattice(3, |_, _| 0.0)]);
    for (n, sides) in (1..9).flat_map(|n| [3, 4, 5].map(|sides| (n, sides))) {
        let corners = f64::from(n * (sides - 2));
        meshes.push(flat(fan(n, sides), pi / corners, sides - 2));
        if n > 2 {
            meshes.push(flat(rosette(n, sides), 2.0 * pi / corners, sides - 2));
        }
    }
    for (mesh, scheme) in meshes.iter().flat_map(|mesh| BOTH.map(|scheme| (mesh, scheme))) {
        for (boundary, levels) in BOUNDARIES.iter().flat_map(|b| [(b, 0), (b, 2)]) {
            let limit = subdivide(mesh, scheme_options(scheme, levels, true, *boundary)).unwrap();
            assert!(limit.positions().iter().all(|point| point.z == 0.0));
            let normals = limit.vertex().vectors("normal").unwrap();
            let faces = mesh.faces();
            assert!(
                normals.iter().all(|normal| (normal[2] - 1.0).abs() < 1e-12),
                "{scheme:?} {boundary:?} {levels} {faces:?} {normals:?}"
            );
        }
    }
}

#[test]
fn the_limit_stays_within_the_hull_of_its_neighbors() {
    let shapes = (3..40).flat_map(|n| [trapezohedron(n), prism(n), fan(n, 4)]);
    for (faces, scheme) in shapes.flat_map(|f| BOTH.map(|s| (f.clone(), s))) {
        let mesh = scattered_polygons(faces);
        let how = scheme_options(scheme, 0, true, Boundary::EdgeAndCorner);
        let limit = Limit::new(&Topology::from_mesh(&mesh, how)).unwrap();
        for vertex in 0..mesh.positions().len() {
            let (columns, weights) = limit.positions.row(vertex);
            assert!(weights.iter().all(|&weight| weight >= 0.0));
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-14);
            assert!(columns.windows(2).all(|pair| pair[0] != pair[1]));
        }
    }
}

/// A cube with 12 sharp edges.
fn sharp_cube(sharpness: f64) -> Mesh {
    let edges = (0..8u32).flat_map(|a| [1, 2, 4].map(|bit| [a, a | bit])).filter(|[a, b]| a != b);
    cube().with_creases(edges.map(|edge| (edge, sharpness)).collect::<Vec<_>>()).unwrap()
}

#[test]
fn a_cube_with_sharp_edges_stays_a_cube() {
    let mesh = limit(&sharp_cube(10.0), Scheme::CatmullClark, 3);
    for point in mesh.positions().iter() {
        assert!(point.coords.iter().any(|x| x.abs() < 1e-14 || (x - 1.0).abs() < 1e-14));
    }
    assert_eq!(mesh.positions()[..8], cube().positions()[..]);
    assert_eq!(mesh.creases().len(), 12 * 8);
}

#[test]
fn a_sharpness_of_one_lasts_one_step_and_half_a_sharpness_is_interpolated() {
    fn refine_cube(sharpness: f64) -> Mesh {
        refine(&sharp_cube(sharpness), Scheme::CatmullClark, 1)
    }
    let linear = refine_cube(10.0);
    assert_eq!(refine_cube(1.0).positions()[..], linear.positions()[..]);
    assert_eq!(refine_cube(1.0).creases().len(), 0);
    let (smooth, half) = (refine_cube(0.0), refine_cube(0.5));
    for i in 0..half.positions().len() {
        let middle = nalgebra::center(&smooth.positions()[i], &linear.positions()[i]);
        assert!((half.positions()[i] - middle).norm() < 1e-15);
    }
}

#[test]
fn a_crease_is_the_cubic_spline_of_its_edges() {
    let mesh = scattered_polygons(sheet(4, 4, false));
    let creases: Vec<_> = (10..14).map(|j| ([j, j + 1], 10.0)).collect();
    let mesh = mesh.with_creases(creases).unwrap();
    let [left, middle, right] = [11, 12, 13].map(|i| mesh.positions()[i].coords);
    let expected = (left + 4.0 * middle + right) / 6.0;
    for levels in [0, 1, 3] {
        let limit = limit(&mesh, Scheme::CatmullClark, levels);
        assert!((limit.positions()[12].coords - expected).norm() < 1e-14);
    }
}

#[test]
fn a_regular_normal_is_that_of_the_spline() {
    let mesh = lattice(4, |x, y| 0.3 * x * x - 0.2 * x * y + 0.1 * y * y * y);
    fn position(i: usize, j: usize, mesh: &Mesh) -> Vector3<f64> {
        mesh.positions()[5 * i + j].coords
    }
    for (scheme, side) in [(Scheme::CatmullClark, 1.0 / 6.0), (Scheme::DooSabin, 1.0 / 8.0)] {
        let weights = [side, 1.0 - 2.0 * side, side];
        let (u, v) = (
            (1..4)
                .map(|k: usize| (position(k, 3, &mesh) - position(k, 1, &mesh)) * weights[k - 1])
                .sum::<Vector3<f64>>(),
            (1..4)
                .map(|k: usize| (position(3, k, &mesh) - position(1, k, &mesh)) * weights[k - 1])
                .sum(),
        );
        let expected = u.cross(&v).normalize();
        let limit = limit(&mesh, scheme, 0);
        let normal = Vector3::from(limit.vertex().vectors("normal").unwrap()[12]);
        assert!((normal - expected).norm() < 1e-14, "{scheme:?}");
    }
}

#[test]
fn normals_of_a_closed_surface_point_outward() {
    for (scheme, levels) in BOTH.into_iter().flat_map(|scheme| [(scheme, 0), (scheme, 3)]) {
        let mesh = limit(&cube(), scheme, levels);
        let normals = mesh.vertex().vectors("normal").unwrap();
        for (normal, point) in normals.iter().zip(mesh.positions().iter()) {
            let outward = point.coords - Vector3::repeat(0.5);
            assert!(Vector3::from(*normal).dot(&outward.normalize()) > 0.8);
        }
    }
}

#[test]
fn a_plan_serves_every_mesh_of_its_topology() {
    for (faces, scheme) in families().into_iter().flat_map(|f| BOTH.map(|s| (f.clone(), s))) {
        let mesh = scattered_polygons(faces);
        let how = scheme_options(scheme, 2, false, Boundary::EdgeOnly);
        let first = Step::from_topology(&Topology::from_mesh(&mesh, how)).unwrap();
        let steps = [first.clone(), first.next().unwrap()];
        let turned = mesh.positions().iter().map(|point| Point3::new(point.y, point.z, point.x));
        let moved = mesh.with_positions(turned.collect()).unwrap();
        assert_eq!(
            apply(&moved, &steps, &Progress::silent()).unwrap(),
            subdivide(&moved, how).unwrap()
        );
    }
}

#[test]
fn other_numbers_for_the_vertices_give_the_same_surface() {
    for scheme in BOTH {
        let mesh = scattered_polygons(patchwork());
        let same = mesh.faces().corners().len();
        let count = mesh.positions().len() as u32;
        fn renumber(vertex: u32, count: u32) -> u32 {
            (vertex * 5 + 3) % count
        }
        let faces =
            mesh.faces().iter().map(|face| face.iter().map(|&v| renumber(v, count)).collect());
        let mut positions = vec![[0.0; 3]; count as usize];
        (0..)
            .zip(mesh.positions().iter())
            .for_each(|(i, &p)| positions[renumber(i, count) as usize] = p.into());
        let other = refine(&polygons_at(faces.collect(), &positions), scheme, 2);
        let mesh = refine(&mesh, scheme, 2);
        let corners = mesh.faces().corners().iter().zip(other.faces().corners().iter());
        let mut positions = corners
            .map(|(&a, &b)| (mesh.positions()[a as usize] - other.positions()[b as usize]).norm());
        // The faces around vertices are in the order of the vertices, which differs between the two meshes. So are their refinements.
        // Therefore only the refined faces inside old faces are compared.
        assert!(positions.by_ref().take(same).all(|distance| distance < 1e-15));
    }
}

#[test]
fn the_bytes_do_not_depend_on_the_number_of_threads() {
    let mesh = scattered_polygons(sheet(70, 70, true));
    for scheme in BOTH {
        fn refine_with_threads(threads: usize, mesh: &Mesh, scheme: &Scheme) -> Mesh {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| limit(mesh, *scheme, 1))
        }
        let one = refine_with_threads(1, &mesh, &scheme);
        assert_eq!(
            [refine_with_threads(2, &mesh, &scheme), refine_with_threads(8, &mesh, &scheme)],
            [one.clone(), one]
        );
    }
}

// From CGAL issue 3603: a vertex has two quads that share two edges.
#[test]
fn an_inner_vertex_of_two_faces_is_smooth() {
    let positions = [[0., 0., 1.], [0., 0., 0.], [1., 0., 0.], [0.25, 0., 0.3], [1., 0., 1.]];
    let mesh = polygons_at(vec![vec![0, 1, 2, 3], vec![3, 2, 4, 0]], &positions);
    let refined = refine(&mesh, Scheme::CatmullClark, 3);
    let once = refine(&mesh, Scheme::CatmullClark, 1);
    assert!((once.positions()[3] - Point3::new(0.46875, 0.0, 0.475)).norm() < 1e-15);
    assert!(refined.positions().iter().all(|point| point.coords.norm() < 2.0));
    let (direct, later) =
        (limit(&mesh, Scheme::CatmullClark, 0), limit(&mesh, Scheme::CatmullClark, 2));
    assert!(farthest(direct.positions(), later.positions()) < 1e-15);
}

// From OpenSubdiv pull request 1123: masks must not depend on the corner at which a face begins.
#[test]
fn faces_may_begin_at_any_corner() {
    for (turn, scheme) in (0..4).flat_map(|turn| BOTH.map(|scheme| (turn, scheme))) {
        let plain = limit(&scattered_polygons(patchwork()), scheme, 0);
        let turned = limit(
            &scattered_polygons(
                patchwork()
                    .into_iter()
                    .map(|mut face: Vec<u32>| {
                        let count = face.len();
                        face.rotate_left(turn % count);
                        face
                    })
                    .collect(),
            ),
            scheme,
            0,
        );
        assert!(farthest(plain.positions(), turned.positions()) < 1e-15);
    }
}

#[test]
fn one_large_face_has_its_limit_at_its_center() {
    // Tests the positions and tangents that the rules of the scheme give after several steps, which converge to those of the limit.
    fn position(k: u32) -> Point3<f64> {
        let (sine, cosine) = libm::sincos(f64::from(k) * 0.7 + 0.2 * f64::from(k % 3));
        Point3::new(3.0 * cosine, 2.0 * sine, 0.4 * libm::sin(f64::from(k * k)))
    }
    for count in [3, 4, 5, 9] {
        let positions: Vec<Point3<f64>> = (0..count).map(position).collect();
        let corners = Faces::uniform(count as usize, (0..count).collect::<Vec<_>>()).unwrap();
        let mesh = Mesh::new(positions, corners).unwrap();
        let limit =
            subdivide(&mesh, scheme_options(Scheme::DooSabin, 0, true, Boundary::None)).unwrap();
        let once = scheme_options(Scheme::DooSabin, 1, false, Boundary::None);
        let late = (0..25).fold(mesh.clone(), |mesh, _| subdivide(&mesh, once).unwrap());
        let normals = limit.vertex().vectors("normal").unwrap();
        for (vertex, at) in limit.positions().iter().enumerate() {
            assert!((at - late.positions()[vertex]).norm() <= 1e-6, "{count}: {at}");
            let normal = Vector3::from(normals[vertex]);
            let ends = late.positions().iter().map(|position| (position - at) * libm::exp2(25.0));
            assert!(ends.map(|way| way.dot(&normal).abs()).all(|off| off <= 1e-5), "{count}");
        }
    }
    let count = 1000;
    let corners = Faces::uniform(count as usize, (0..count).collect::<Vec<_>>()).unwrap();
    let large = Mesh::new((0..count).map(position).collect::<Vec<_>>(), corners).unwrap();
    let start = std::time::Instant::now();
    subdivide(&large, scheme_options(Scheme::DooSabin, 0, true, Boundary::None)).unwrap();
    // A quadratic algorithm would take more than a minute.
    assert!(start.elapsed().as_secs() < 20, "{:?}", start.elapsed());
}
