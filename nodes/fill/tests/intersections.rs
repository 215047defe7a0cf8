//! Intersections of fills with the data and with themselves.

use super::*;

const INTERSECTS: &str = "run through others";

/// Two meshes in one.
fn both(one: &Mesh, other: &Mesh) -> Mesh {
    let data = one.positions().len() as u32;
    let points = one.positions().iter().chain(other.positions().iter()).copied();
    let [of_one, of_other] = [one, other].map(|mesh| mesh.faces().as_triangles().unwrap());
    let moved = of_other.iter().map(|face| face.map(|vertex| vertex + data));
    of(points.collect(), of_one.iter().copied().chain(moved).collect())
}

/// The vertices of the rim of a hole in a grid, in pairs.
fn rim_edges(mesh: &Mesh) -> Vec<[u32; 2]> {
    let edges = mesh.edges();
    fn place(vertex: u32, mesh: &Mesh) -> Point3<f64> {
        mesh.positions()[vertex as usize]
    }
    let is_rim = |ends: &[u32; 2]| {
        libm::hypot(place(ends[0], mesh).x - 9.5, place(ends[0], mesh).y - 9.5) < 7.0
    };
    let border = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1);
    border.map(|(ends, _)| *ends).filter(is_rim).collect()
}

fn round_hole(height: impl Fn(f64, f64) -> f64) -> Mesh {
    without(&grid(20, 20, height), |p| libm::hypot(p.x - 9.5, p.y - 9.5) < 4.0)
}

/// A hole in rough data, at the rim of which some points are in one place.
fn with_points_in_one_place(seed: u64) -> Mesh {
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
fn points_in_one_place_at_the_rim_make_no_folds() {
    for seed in 0..20 {
        let mesh = with_points_in_one_place(seed);
        for method in PLAIN {
            let filled = fill(&mesh, HoleChoice::All, method.clone()).unwrap();
            check_kept(&mesh, &filled.mesh);
            fn tells(what: &str, filled_warnings: &[String]) -> bool {
                filled_warnings.iter().any(|warning| warning.contains(what))
            }
            assert!(
                !tells(INTERSECTS, &filled.warnings),
                "{seed} {method:?}: {:?}",
                filled.warnings
            );
            // Creases that intersect something are taken for wrong ones; all other fills are repaired.
            let is_sharp = matches!(method, FillMethod::CreaseAware);
            let tells = tells("another surface", &filled.warnings) && !is_sharp;
            assert!(!tells, "{seed} {method:?}: {:?}", filled.warnings);
        }
    }
}

#[test]
fn several_threads_repair_to_the_same_bytes() {
    fn apart(seed: u64) -> Mesh {
        let mesh = with_points_in_one_place(seed);
        let off = nalgebra::Vector3::x() * (30.0 * seed as f64);
        mesh.with_positions(mesh.positions().iter().map(|p| p + off).collect()).unwrap()
    }
    let all = (1..6).map(apart).fold(apart(0), |all, other| both(&all, &other));
    fn filled(threads: usize, all: &Mesh) -> Mesh {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fill(all, HoleChoice::All, FillMethod::ThinPlate).unwrap().mesh)
    }
    let one = filled(1, &all);
    assert!([2, 8].into_iter().all(|threads| filled(threads, &all) == one));
}

#[test]
fn what_no_filling_can_pass_is_told() {
    fn told(mesh: &Mesh, why: &str) {
        for method in PLAIN {
            let filled = fill(mesh, HoleChoice::All, method.clone()).unwrap();
            check_kept(mesh, &filled.mesh);
            let told = filled.warnings.iter().find(|warning| warning.contains(INTERSECTS));
            assert!(told.is_some_and(|warning| warning.ends_with(why)), "{:?}", filled.warnings);
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
    let loose = both(&holed, &upright(9.3, 0.3));
    told(&loose, "; a loose part of the mesh is in the way of rim 1");
    let through = both(&holed, &upright(9.3, 1.0));
    let why = "; a loose part of the mesh is in the way of rim 1; the data run through themselves at rim 1";
    told(&through, why);
}

#[test]
fn over_a_narrow_edge_a_membrane_is_taken_if_a_plate_would_go_too_far() {
    // A slab as thin as an edge is long, rounded at its end, where a hole reaches over both sides.
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
    let mesh = without(&slab, |p| libm::hypot(p.x, p.y - 15.0) < 5.5);
    let filled = fill(&mesh, HoleChoice::All, FillMethod::ThinPlate).unwrap();
    fn tells(what: &str, filled_warnings: &[String]) -> bool {
        filled_warnings.iter().any(|warning| warning.contains(what))
    }
    assert!(tells("a membrane fills rim 1", &filled.warnings), "{:?}", filled.warnings);
    assert!(!tells(INTERSECTS, &filled.warnings), "{:?}", filled.warnings);
    for p in &filled.mesh.positions()[mesh.positions().len()..] {
        assert!(p.x < 0.5 && p.z.abs() < 2.0, "{p}");
    }
}
