//! Tests of creases that are extended across holes.

use maquette_value::TriangleTree;
use nalgebra::Vector3;

use super::super::shapes::nut::{is_lost, nut};
use super::*;

/// Returns the surface of a cube with a corner at the origin and sides of 16 x 16 unit squares.
fn cube() -> Mesh {
    let count = 16;
    fn side(to: fn(f64, f64) -> Point3<f64>, count: u32) -> Vec<Point3<f64>> {
        grid(count + 1, count + 1, |_, _| 0.0).positions().iter().map(|p| to(p.x, p.y)).collect()
    }
    let sides: [fn(f64, f64) -> Point3<f64>; 6] = [
        |x, y| Point3::new(x, y, 16.0),
        |x, y| Point3::new(y, x, 0.0),
        |x, y| Point3::new(y, 16.0, x),
        |x, y| Point3::new(x, 0.0, y),
        |x, y| Point3::new(16.0, x, y),
        |x, y| Point3::new(0.0, y, x),
    ];
    let mut numbers = std::collections::BTreeMap::new();
    let (mut points, mut faces) = (Vec::new(), Vec::new());
    for to in sides {
        let own = side(to, count);
        let ids: Vec<u32> = own
            .iter()
            .map(|p| {
                *numbers.entry([p.x as i64, p.y as i64, p.z as i64]).or_insert_with(|| {
                    points.push(*p);
                    points.len() as u32 - 1
                })
            })
            .collect();
        let grid = grid(count + 1, count + 1, |_, _| 0.0);
        faces.extend(
            grid.faces().as_triangles().unwrap().iter().map(|face| face.map(|k| ids[k as usize])),
        );
    }
    triangle_mesh(points, faces)
}

#[test]
fn the_corner_of_a_cube_is_sharp_again() {
    fn ball(p: &Point3<f64>) -> bool {
        (p - Point3::new(16.0, 16.0, 16.0)).norm() < 6.0
    }
    // If a strip beside an edge of the cube is also missing, the hole's rim runs along the crease.
    fn strip(p: &Point3<f64>) -> bool {
        p.x == 16.0 && p.y > 14.5 && p.y < 16.0 && p.z > 5.5
    }
    for has_strip in [false, true] {
        let mesh = remove_vertices(&cube(), |p| ball(p) || (has_strip && strip(p)));
        let filled = fill(&mesh, HoleChoice::All, FillMethod::CreaseAware).unwrap();
        assert_eq!(check_kept(&mesh, &filled.mesh), 0);
        assert_eq!(filled.warnings, [""; 0]);
        let added = &filled.mesh.positions()[mesh.positions().len()..];
        assert!(added.iter().any(|p| (p - Point3::new(16.0, 16.0, 16.0)).norm() < 1e-6));
        // Each new triangle is in one side of the cube and faces outwards, so that creases are edges.
        for face in filled.mesh.faces().iter().skip(mesh.faces().len()) {
            let area = filled.mesh.area_vector(face);
            let corners = face.iter().map(|&vertex| filled.mesh.positions()[vertex as usize]);
            let is_on_side = (0..3).any(|k| {
                corners.clone().all(|p| (p[k] - 16.0).abs() < 1e-6)
                    && area[k] > 0.999999 * area.norm()
            });
            assert!(is_on_side, "{area:?}");
        }
    }
}

/// Returns the mesh with its vertices moved along their normals by Gaussian noise with the standard deviation `deviation`.
pub(super) fn noisy(mesh: &Mesh, deviation: f64, seed: u64) -> Mesh {
    fn gauss(k: u64, seed: u64) -> f64 {
        (0..12).map(|i| random(seed << 32 ^ (12 * k + i))).sum::<f64>() - 6.0
    }
    let points = mesh.positions().iter().zip(mesh.vertex_normals()).zip(0u64..);
    let moved = points.map(|((point, normal), k)| point + normal * (deviation * gauss(k, seed)));
    mesh.clone().with_positions(moved.collect()).unwrap()
}

#[test]
fn creases_of_noisy_data_are_extended() {
    // Two surfaces: a bevel of 31 degrees between two planes, partly hidden by noise, and the corner of a cube.
    let roof = |x: f64, _| -0.6 * (x - 14.0).clamp(0.0, 7.0) - 2.0 * (x - 21.0).max(0.0);
    let bevel = remove_vertices(&grid(36, 30, roof), |p| libm::hypot(p.x - 17.0, p.y - 15.0) < 7.5);
    let corner = remove_vertices(&cube(), |p| (p - Point3::new(16.0, 16.0, 16.0)).norm() < 6.0);
    let mut sharp = 0;
    for seed in 0..8 {
        let mesh = noisy(&bevel, 0.05, seed);
        let filled = fill(&mesh, HoleChoice::All, FillMethod::CreaseAware).unwrap();
        check_kept(&mesh, &filled.mesh);
        assert!(!has_warning(&filled, "crease"), "{:?}", filled.warnings);
        let rms = |filled: &FilledMesh| {
            let added = &filled.mesh.positions()[mesh.positions().len()..];
            let sum: f64 =
                added.iter().map(|p| (p.z - roof(p.x, p.y)) * (p.z - roof(p.x, p.y))).sum();
            (sum / added.len() as f64).sqrt()
        };
        let plate = fill(&mesh, HoleChoice::All, FillMethod::ThinPlate).unwrap();
        if rms(&filled) < 0.25 * rms(&plate) {
            sharp += 1;
        } else {
            assert!(has_warning(&filled, "another surface"), "{seed}: {:?}", filled.warnings);
        }
        let mesh = noisy(&corner, 0.05, seed);
        let filled = fill(&mesh, HoleChoice::All, FillMethod::CreaseAware).unwrap();
        assert_eq!(check_kept(&mesh, &filled.mesh), 0);
        assert_eq!(filled.warnings, [""; 0]);
        for p in &filled.mesh.positions()[mesh.positions().len()..] {
            let off = (16.0 - p.x).min(16.0 - p.y).min(16.0 - p.z);
            assert!(off.abs() < 0.25, "{p} is off by {off}");
        }
    }
    assert!(sharp > 6, "the bevel is sharp with {sharp} of 8 noises");
}

#[test]
fn noise_makes_no_creases() {
    let round = remove_vertices(&sphere(4), |p| p.z > 0.85);
    let smooth = [
        (
            remove_vertices(
                &grid(30, 30, |x: f64, y: f64| {
                    1.5 * libm::sin(0.3 * x) * libm::cos(0.25 * y + 0.4)
                }),
                |p| libm::hypot(p.x - 15.0, p.y - 14.0) < 6.0,
            ),
            1.0,
        ),
        (
            remove_vertices(&grid(30, 30, |_, _| 0.0), |p| {
                libm::hypot(p.x - 15.0, p.y - 14.0) < 6.0
            }),
            1.0,
        ),
        (round, 0.08),
    ];
    for (mesh, edge) in &smooth {
        for (deviation, seed) in [(0.0, 0), (0.05, 1), (0.05, 2), (0.1, 3), (0.2, 4), (0.2, 5)] {
            let mesh = noisy(mesh, deviation * edge, seed);
            let [sharp, smooth] = [FillMethod::CreaseAware, FillMethod::ThinPlate]
                .map(|method| fill(&mesh, HoleChoice::All, method).unwrap());
            assert!(sharp.mesh == smooth.mesh, "{deviation} {seed}: {:?}", sharp.warnings);
        }
    }
}

// The results document lists these values as defect 8. For 5 and 8 sides, CGAL 5.5.1 (`triangulate_refine_and_fair_hole`) deviates by 0.69
// and 0.80 mean edges.
#[test]
fn edges_of_a_nut_are_extended_and_meet_in_exemplar_fills() {
    for (sides, max_error) in [(5, 0.34), (8, 0.40)] {
        let (points, faces) = nut(sides);
        let whole = triangle_mesh(points, faces);
        let mesh = remove_vertices(&whole, |point| is_lost(point, sides));
        let tree = TriangleTree::new(&whole);
        let [plate, sharp] =
            [FillMethod::ThinPlate, FillMethod::default()].map(|method: FillMethod| {
                let filled = fill(&mesh, HoleChoice::All, method).unwrap();
                assert_eq!(check_kept(&mesh, &filled.mesh), 0);
                // Measure the deviation at vertices and at face centers, since the center of a face that crosses a crease deviates.
                let faces = filled.mesh.faces().iter().skip(mesh.faces().len());
                let middles = faces.map(|face| {
                    (face
                        .iter()
                        .map(|vertex| filled.mesh.positions()[*vertex as usize].coords)
                        .sum::<Vector3<f64>>()
                        / 3.0)
                        .into()
                });
                let added = filled.mesh.positions()[mesh.positions().len()..].iter().copied();
                let points: Vec<Point3<f64>> = added.chain(middles).collect();
                let near = tree.nearest_to_all(&points).into_iter().flatten();
                (near.map(|place| place.distance_sq).sum::<f64>() / points.len() as f64).sqrt()
            });
        // Edges are about 1.2 mm long.
        assert!(sharp < max_error && sharp < 0.1 * plate, "{sides}: {plate} {sharp}");
    }
}
