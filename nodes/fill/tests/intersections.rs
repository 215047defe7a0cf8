//! Tests of intersections of fills with the input mesh and with themselves.

use super::*;

const INTERSECTS: &str = "intersect others";

/// Returns a mesh with the vertices and faces of both meshes.
fn merge(one: &Mesh, other: &Mesh) -> Mesh {
    let data = one.positions().len() as u32;
    let points = one.positions().iter().chain(other.positions().iter()).copied();
    let [of_one, of_other] = [one, other].map(|mesh| mesh.faces().as_triangles().unwrap());
    let moved = of_other.iter().map(|face| face.map(|vertex| vertex + data));
    triangle_mesh(points.collect(), of_one.iter().copied().chain(moved).collect())
}

/// Returns the edges of the rim of the hole in a grid, as pairs of vertices.
fn rim_edges(mesh: &Mesh) -> Vec<[u32; 2]> {
    let edges = mesh.edges();
    let border = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1);
    let rim = border.map(|(ends, _)| *ends).filter(|ends| {
        let p = mesh.positions()[ends[0] as usize];
        libm::hypot(p.x - 9.5, p.y - 9.5) < 7.0
    });
    rim.collect()
}

fn round_hole(height: impl Fn(f64, f64) -> f64) -> Mesh {
    remove_vertices(&grid(20, 20, height), |p| libm::hypot(p.x - 9.5, p.y - 9.5) < 4.0)
}

/// Returns a rough mesh with a hole, some of whose rim points coincide.
fn with_coincident_points(seed: u64) -> Mesh {
    fn hills(x: f64, y: f64) -> f64 {
        0.3 * libm::sin(x) + 0.2 * y
    }
    let mesh = round_hole(|x, y| hills(x, y) + 0.5 * random(seed << 32 | (x + 20.0 * y) as u64));
    let mut points = mesh.positions().to_vec();
    for [a, b] in rim_edges(&mesh) {
        if random(seed << 32 | u64::from(a)) < 0.3 {
            points[a as usize] = points[b as usize];
        }
    }
    mesh.with_positions(points).unwrap()
}

#[test]
fn coincident_rim_points_make_no_folds() {
    for seed in 0..20 {
        let mesh = with_coincident_points(seed);
        for method in PLAIN {
            let filled = fill(&mesh, HoleChoice::All, method.clone()).unwrap();
            check_kept(&mesh, &filled.mesh);
            assert!(!has_warning(&filled, INTERSECTS), "{seed} {method:?}: {:?}", filled.warnings);
            // If extended creases lead to intersections, the fill is replaced by one without creases. All other fills are repaired.
            let is_sharp = matches!(method, FillMethod::CreaseAware);
            let is_replaced = has_warning(&filled, "another surface") && !is_sharp;
            assert!(!is_replaced, "{seed} {method:?}: {:?}", filled.warnings);
        }
    }
}

#[test]
fn several_threads_repair_to_the_same_bytes() {
    fn shifted_mesh(seed: u64) -> Mesh {
        let mesh = with_coincident_points(seed);
        let off = nalgebra::Vector3::x() * (30.0 * seed as f64);
        mesh.with_positions(mesh.positions().iter().map(|p| p + off).collect()).unwrap()
    }
    let all = (1..6).map(shifted_mesh).fold(shifted_mesh(0), |all, other| merge(&all, &other));
    check_threads(&all);
}

#[test]
fn unavoidable_intersections_are_reported() {
    fn check_warnings(mesh: &Mesh, why: &str) {
        for method in PLAIN {
            let filled = fill(mesh, HoleChoice::All, method.clone()).unwrap();
            check_kept(mesh, &filled.mesh);
            let warning = filled.warnings.iter().find(|warning| warning.contains(INTERSECTS));
            assert!(warning.is_some_and(|warning| warning.ends_with(why)), "{:?}", filled.warnings);
        }
    }
    let holed = round_hole(|_, _| 0.0);
    fn upright(at: f64, size: f64) -> Mesh {
        let sheet = grid(20, 20, |_, _| 0.0);
        sheet
            .with_positions(
                sheet
                    .positions()
                    .iter()
                    .map(|p| Point3::new(at, 9.5 + size * (p.x - 9.5), size * (p.y - 9.5)))
                    .collect(),
            )
            .unwrap()
    }
    let loose = merge(&holed, &upright(9.3, 0.3));
    check_warnings(&loose, "; a disconnected part of the mesh blocks rim 1");
    let through = merge(&holed, &upright(9.3, 1.0));
    let why =
        "; a disconnected part of the mesh blocks rim 1; the data intersect themselves at rim 1";
    check_warnings(&through, why);
}

#[test]
fn a_membrane_replaces_a_plate_that_goes_too_far() {
    // The slab is as thick as an edge is long, and rounded at its end. The hole extends over both of its sides.
    let sheet = grid(41, 30, |_, _| 0.0);
    let slab = sheet
        .with_positions(
            sheet
                .positions()
                .iter()
                .map(|p| {
                    let (t, quarter) = (p.x - 20.0, std::f64::consts::FRAC_PI_2);
                    let (off, height) = match t {
                        ..-1.0 => (t + 1.0, 0.1),
                        1.0.. => (1.0 - t, -0.1),
                        _ => (0.1 * libm::cos(t * quarter), -0.1 * libm::sin(t * quarter)),
                    };
                    Point3::new(off, p.y, height)
                })
                .collect(),
        )
        .unwrap();
    let mesh = remove_vertices(&slab, |p| libm::hypot(p.x, p.y - 15.0) < 5.5);
    let filled = fill(&mesh, HoleChoice::All, FillMethod::ThinPlate).unwrap();
    assert!(has_warning(&filled, "is too rough for a thin plate"), "{:?}", filled.warnings);
    assert!(!has_warning(&filled, INTERSECTS), "{:?}", filled.warnings);
    for p in &filled.mesh.positions()[mesh.positions().len()..] {
        assert!(p.x < 0.5 && p.z.abs() < 2.0, "{p}");
    }
}
