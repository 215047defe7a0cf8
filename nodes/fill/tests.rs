//! Tests of the properties of filled meshes.

use maquette_node::{Error, Progress};
use maquette_value::{Attribute, Faces, Mesh};
use nalgebra::Point3;
use proptest::prelude::*;

use super::border::holes::HoleChoice;
use super::border::regions::HoleRegion;
use super::exemplar::{ExemplarOptions, Start};
use super::fill_holes::{FilledMesh, fill_holes};
use super::method::FillMethod;
use super::shapes::{grid, random, remove_vertices, sphere, triangle_mesh};

mod corners;
mod cracks;
mod creases;
mod curved_creases;
mod intersections;
mod odd_holes;
mod pictures;
mod published;
mod relief;
mod ridges;
mod smooth_cuts;

const PLAIN: [FillMethod; 4] =
    [FillMethod::Flat, FillMethod::Membrane, FillMethod::ThinPlate, FillMethod::CreaseAware];

fn fill(mesh: &Mesh, holes: HoleChoice, method: FillMethod) -> Result<FilledMesh, Error> {
    fill_holes(mesh, &holes, &method, &Progress::silent())
}

fn has_warning(filled: &FilledMesh, text: &str) -> bool {
    filled.warnings.iter().any(|warning| warning.contains(text))
}

/// Checks that the result is manifold and contains the original mesh. Returns the number of remaining border edges.
fn check_kept(mesh: &Mesh, filled: &Mesh) -> usize {
    let (data, kept) = (mesh.positions().len(), mesh.faces().len());
    fn bits(p: &Point3<f64>) -> [u64; 3] {
        [p.x.to_bits(), p.y.to_bits(), p.z.to_bits()]
    }
    assert!(mesh.positions().iter().map(bits).eq(filled.positions()[..data].iter().map(bits)));
    assert!(mesh.faces().iter().eq(filled.faces().iter().take(kept)));
    let edges = filled.edges();
    assert_eq!(edges.misoriented, 0);
    assert!(edges.faces.iter().all(|&faces| faces <= 2));
    let Some(Attribute::Flag(flags)) = filled.vertex().get("filled") else { panic!("no flags") };
    assert!(flags.iter().enumerate().all(|(vertex, &flag)| (flag == 1) == (data <= vertex)));
    let used: std::collections::BTreeSet<u32> = filled.faces().corners().iter().copied().collect();
    assert!((data as u32..filled.positions().len() as u32).all(|vertex| used.contains(&vertex)));
    edges.faces.iter().filter(|&&faces| faces == 1).count()
}

fn euler(mesh: &Mesh) -> i64 {
    mesh.positions().len() as i64 - mesh.edges().vertices.len() as i64 + mesh.faces().len() as i64
}

// Tested for each surface without exemplars: flat triangles, membrane and thin plate.
#[test]
fn a_hole_in_a_plane_stays_in_the_plane() {
    let tilted = grid(24, 20, |x, y| 0.3 * x - 0.2 * y);
    let holes: [fn(&Point3<f64>) -> bool; 3] = [
        |p| (p.x - 12.0).abs() + (p.y - 9.0).abs() < 6.0,
        |p| (p - Point3::new(12.0, 9.0, p.z)).norm_squared() < 30.0,
        // An L-shaped hole.
        |p| {
            (4.0..8.0).contains(&p.x) && (4.0..16.0).contains(&p.y)
                || (4.0..18.0).contains(&p.x) && (4.0..8.0).contains(&p.y)
        },
    ];
    for hole in holes {
        let mesh = remove_vertices(&tilted, hole);
        for method in PLAIN {
            let filled = fill(&mesh, HoleChoice::All, method.clone()).unwrap();
            let rim = check_kept(&mesh, &filled.mesh);
            assert_eq!(rim, 2 * (23 + 19), "the outer border stays");
            for p in &filled.mesh.positions()[mesh.positions().len()..] {
                let off = p.z - (0.3 * p.x - 0.2 * p.y);
                assert!(off.abs() < 1e-9, "{method:?}: {off}");
            }
            assert!(!has_warning(&filled, "intersect"), "{:?}", filled.warnings);
        }
    }
}

// Tested for each surface without exemplars: flat triangles, membrane and thin plate.
#[test]
fn a_filled_sphere_is_closed_and_keeps_its_vertices() {
    let mesh = remove_vertices(&sphere(4), |p| p.z > 0.88 || p.x > 0.9);
    let before = euler(&mesh);
    for (method, far) in PLAIN.into_iter().zip([0.2, 0.2, 0.01, 0.01]) {
        let filled = fill(&mesh, HoleChoice::All, method).unwrap().mesh;
        assert_eq!(check_kept(&mesh, &filled), 0);
        assert_eq!(euler(&filled), before + 2);
        let added = &filled.positions()[mesh.positions().len()..];
        let sum: f64 = added.iter().map(|p| p.coords.norm() - 1.0).map(|off| off * off).sum();
        let rms = (sum / added.len() as f64).sqrt();
        assert!(rms < far, "{rms}");
    }
}

// Tests fills with the edge length of the rim, and with a given edge length.
#[test]
fn filled_edges_are_about_as_long_as_wanted() {
    let mesh = remove_vertices(&sphere(5), |p| p.z > 0.8);
    let data = mesh.positions().len() as u32;
    fn spacing(mesh: &Mesh, is_filled: bool, data: u32) -> Vec<f64> {
        let (edges, points) = (mesh.edges().vertices, mesh.positions());
        let wanted = edges.iter().filter(|ends| (ends[1] >= data) == is_filled);
        wanted.map(|&[a, b]| (points[a as usize] - points[b as usize]).norm()).collect()
    }
    fn check_edge_lengths(mesh: &Mesh, wanted: f64, data: u32) {
        for length in spacing(mesh, true, data) {
            assert!((0.6..=1.6).contains(&(length / wanted)), "{} of {wanted}", length);
        }
    }
    let lengths = spacing(&mesh, false, data);
    let mean = lengths.iter().sum::<f64>() / lengths.len() as f64;
    for method in [FillMethod::Flat, FillMethod::ThinPlate, FillMethod::Membrane] {
        check_edge_lengths(&fill(&mesh, HoleChoice::All, method).unwrap().mesh, mean, data);
    }
    let coarse = ExemplarOptions {
        iterations: Some(0),
        start: Start::Flat,
        edges: vec![mean],
        ..Default::default()
    };
    check_edge_lengths(
        &fill(&mesh, HoleChoice::All, FillMethod::Exemplar(coarse)).unwrap().mesh,
        mean,
        data,
    );
}

#[test]
fn a_hole_that_touches_itself_is_two_holes() {
    // The hole consists of two diamonds (rotated squares) that share a corner.
    let mesh = remove_vertices(&grid(20, 12, |x, y| 0.05 * x * y), |p| {
        (p.x - 6.0).abs() + (p.y - 5.0).abs() < 3.5 && p.x < 8.5
    });
    let holed = remove_vertices(&mesh, |p| (p.x - 13.0).abs() + (p.y - 5.0).abs() < 3.5);
    for method in PLAIN {
        let filled = fill(&holed, HoleChoice::All, method).unwrap().mesh;
        assert_eq!(check_kept(&holed, &filled), 2 * (19 + 11));
    }
    // Remove two triangles with one common vertex.
    let mut faces: Vec<[u32; 3]> = grid(6, 6, |_, _| 0.0).faces().as_triangles().unwrap().to_vec();
    let shared = 14;
    let touching: Vec<usize> =
        (0..faces.len()).filter(|&face| faces[face].contains(&shared)).collect();
    let apart = *touching
        .iter()
        .find(|&&face| {
            faces[face].iter().filter(|vertex| faces[touching[0]].contains(vertex)).count() == 1
        })
        .unwrap();
    faces.remove(apart.max(touching[0]));
    faces.remove(apart.min(touching[0]));
    let holed = triangle_mesh(grid(6, 6, |_, _| 0.0).positions().to_vec(), faces);
    for method in PLAIN {
        let filled = fill(&holed, HoleChoice::All, method).unwrap().mesh;
        assert_eq!(check_kept(&holed, &filled), 20);
        assert_eq!(filled.faces().len(), 50);
    }
}

// Tests two kinds of holes: one with three edges, and a gap in a strip of triangles.
#[test]
fn the_smallest_holes_get_their_original_triangles() {
    let whole = sphere(1);
    let mut faces = whole.faces().as_triangles().unwrap().to_vec();
    let last = faces.pop().unwrap();
    let holed = triangle_mesh(whole.positions().to_vec(), faces);
    for method in PLAIN {
        let filled = fill(&holed, HoleChoice::All, method).unwrap().mesh;
        assert_eq!(check_kept(&holed, &filled), 0);
        let added = filled.faces().face(filled.faces().len() - 1);
        assert!(last.iter().all(|vertex| added.contains(vertex)));
    }
    // Remove one triangle of a ring of triangles: then both rims contain the vertex opposite to the gap.
    let ring = (0..8u32).flat_map(|k| {
        let next = (k + 1) % 8;
        [[k, next, 8 + k], [next, 8 + next, 8 + k]]
    });
    let strip = triangle_mesh(
        (0..16)
            .map(|k: u32| {
                let angle = f64::from(k % 8) * std::f64::consts::TAU / 8.0;
                Point3::new(libm::cos(angle), libm::sin(angle), f64::from(k / 8))
            })
            .collect(),
        ring.skip(1).collect(),
    );
    for method in PLAIN {
        let filled = fill(&strip, HoleChoice::Loops(vec![0, 1]), method).unwrap().mesh;
        assert_eq!(check_kept(&strip, &filled), 0);
    }
}

#[test]
fn a_mesh_without_holes_is_unchanged_with_a_warning() {
    let mesh = sphere(2);
    let filled = fill(&mesh, HoleChoice::All, FillMethod::default()).unwrap();
    assert_eq!(check_kept(&mesh, &filled.mesh), 0);
    assert_eq!(filled.mesh.positions(), mesh.positions());
    assert_eq!(filled.warnings, ["the mesh has no hole to fill: it is closed"]);
}

#[test]
fn a_mesh_that_is_not_manifold_is_rejected_with_the_elements() {
    fn points(count: u32) -> Vec<Point3<f64>> {
        (0..count).map(|k| Point3::new(f64::from(k), f64::from(k * k), 0.0)).collect()
    }
    let book = triangle_mesh(points(5), vec![[0, 1, 2], [1, 0, 3], [0, 1, 4]]);
    let error = fill(&book, HoleChoice::All, FillMethod::Flat).unwrap_err();
    assert!(error.to_string().starts_with("the mesh is not manifold at edge 0-1: "), "{error}");
    // A mesh of two tetrahedra that touch at a vertex.
    fn tetrahedron([a, b, c, d]: [u32; 4]) -> [[u32; 3]; 4] {
        [[a, c, b], [a, b, d], [a, d, c], [b, c, d]]
    }
    let both =
        triangle_mesh(points(7), [tetrahedron([0, 1, 2, 3]), tetrahedron([0, 4, 5, 6])].concat());
    let error = fill(&both, HoleChoice::All, FillMethod::Flat).unwrap_err();
    assert!(error.to_string().starts_with("the mesh is not manifold at vertex 0: "), "{error}");
}

#[test]
fn holes_are_chosen_by_size_number_and_place() {
    let mesh = remove_vertices(&sphere(4), |p| p.z > 0.9 || p.x > 0.95);
    fn open(choice: HoleChoice, mesh: &Mesh) -> usize {
        let filled = fill(mesh, choice, FillMethod::Flat).unwrap().mesh;
        check_kept(mesh, &filled)
    }
    let (large, small) =
        (open(HoleChoice::Edges { max: 22 }, &mesh), open(HoleChoice::Largest, &mesh));
    assert!(0 < small && small < large);
    assert_eq!(open(HoleChoice::Edges { max: 3 }, &mesh), small + large);
    assert_eq!(open(HoleChoice::Loops(vec![0, 1]), &mesh), 0);
    let error = fill(&mesh, HoleChoice::Loops(vec![2]), FillMethod::Flat).unwrap_err();
    assert_eq!(error.to_string(), "the mesh has no rim 2: it has 2 rims, numbered from 0");
}

#[test]
fn a_region_is_cut_out_and_filled_and_nothing_else() {
    let mesh = remove_vertices(&sphere(4), |p| p.z > 0.9);
    let marked: Vec<u8> = mesh.positions().iter().map(|p| u8::from(p.z < -0.9)).collect();
    let count = marked.iter().filter(|&&mark| mark == 0).count();
    let mesh = mesh.with_vertex("bad", Attribute::Flag(marked.into())).unwrap();
    let ball = HoleRegion::Ball { at: [0.0, 0.0, -1.0], radius: 0.4472 };
    let cube = HoleRegion::Box { low: [-1.0, -1.0, -1.0], high: [1.0, 1.0, -0.9] };
    let attribute = HoleRegion::Marked { attribute: "bad".into() };
    for region in [ball, cube, attribute] {
        let filled = fill(&mesh, HoleChoice::Region(region), FillMethod::ThinPlate).unwrap().mesh;
        let Some(Attribute::Flag(flags)) = filled.vertex().get("filled") else {
            panic!("no flags")
        };
        assert_eq!(flags.iter().filter(|&&flag| flag == 0).count(), count);
        assert!(filled.edges().faces.contains(&1), "the other hole stays");
        assert!(filled.positions().iter().any(|p| p.z < -0.97), "the plate is round");
    }
    let nothing = HoleRegion::Marked { attribute: "worse".into() };
    let error = fill(&mesh, HoleChoice::Region(nothing), FillMethod::ThinPlate).unwrap_err();
    let expected = "the mesh has no vertex attribute `worse` of flags or numbers; it has ";
    assert!(error.to_string().starts_with(expected), "{error}");
}

#[test]
fn an_isolated_component_in_a_cut_region_is_removed() {
    let whole = sphere(4);
    // Mark everything around one triangle as damaged, but not the triangle itself.
    let faces = whole.faces().as_triangles().unwrap();
    let island = faces[0];
    let middle = nalgebra::center(
        &whole.positions()[island[0] as usize],
        &whole.positions()[island[1] as usize],
    );
    let marked: Vec<u8> = (0..)
        .zip(whole.positions().iter())
        .map(|(vertex, p): (u32, &Point3<f64>)| {
            u8::from(!island.contains(&vertex) && (p - middle).norm() < 0.4)
        })
        .collect();
    let mesh = whole.with_vertex("bad", Attribute::Flag(marked.into())).unwrap();
    for method in PLAIN {
        let region = HoleRegion::Marked { attribute: "bad".into() };
        let filled = fill(&mesh, HoleChoice::Region(region), method).unwrap();
        assert_eq!(euler(&filled.mesh), 2);
        assert!(filled.mesh.edges().faces.iter().all(|&faces| faces == 2));
        assert!(!has_warning(&filled, "border"), "{:?}", filled.warnings);
    }
    // If the mesh is cut without removing the triangle, the triangle is a component of its own, which stays open; a warning reports it.
    let lost = mesh.vertex().get("bad").cloned();
    let Some(Attribute::Flag(lost)) = lost else { panic!("no flags") };
    let loose =
        super::border::regions::cut(&mesh, &lost.iter().map(|&bad| bad == 1).collect::<Vec<_>>());
    let loose = loose.unwrap().0;
    let filled = fill(&loose, HoleChoice::All, FillMethod::Flat).unwrap();
    assert_eq!(check_kept(&loose, &filled.mesh), 3);
    assert!(
        filled.warnings[0].contains("3 edges around a disconnected part"),
        "{:?}",
        filled.warnings
    );
}

#[test]
fn polygons_are_kept_and_attributes_are_continued() {
    // The faces are quads, and the texture coordinates equal the x and y coordinates.
    let columns = 12;
    let quads: Vec<u32> = (0..columns - 1)
        .flat_map(|row| (0..columns - 1).map(move |column| row * columns + column))
        .filter(|a| !((4..7).contains(&(a % columns)) && (4..7).contains(&(a / columns))))
        .flat_map(|a| [a, a + 1, a + columns + 1, a + columns])
        .collect();
    let points: Vec<_> = (0..columns * columns)
        .map(|k: u32| Point3::new(f64::from(k % columns), f64::from(k / columns), 0.0))
        .collect();
    let uv: Vec<[f64; 2]> = points.iter().map(|p| [p.x, p.y]).collect();
    let corners: Vec<[f64; 2]> = quads.iter().map(|&vertex| uv[vertex as usize]).collect();
    let faces = Faces::uniform(4, quads).unwrap();
    let numbers: Vec<u32> = (0..faces.len() as u32).collect();
    let mesh = Mesh::new(points, faces).unwrap();
    // The vertices inside the hole have no faces.
    let mesh = mesh
        .with_vertex("uv", Attribute::Pair(uv.into()))
        .and_then(|mesh| {
            mesh.with_vertex("color", Attribute::Color(vec![[9, 90, 200]; 144].into()))
        })
        .and_then(|mesh| mesh.with_corner("st", Attribute::Pair(corners.into())))
        .and_then(|mesh| mesh.with_face("number", Attribute::Index(numbers.into())))
        .unwrap();
    let filled = fill(&mesh, HoleChoice::All, FillMethod::Membrane).unwrap().mesh;
    check_kept(&mesh, &filled);
    let uv = filled.vertex().pairs("uv").unwrap();
    let added = 144..filled.positions().len();
    assert!(!added.is_empty());
    for vertex in added {
        let (at, uv) = (filled.positions()[vertex], uv[vertex]);
        assert!((at.x - uv[0]).abs() < 0.5 && (at.y - uv[1]).abs() < 0.5, "{at} {uv:?}");
        assert_eq!(filled.vertex().colors("color").unwrap()[vertex], [9, 90, 200]);
    }
    let corners = filled.corner().pairs("st").unwrap();
    for (&vertex, st) in filled.faces().corners().iter().zip(corners.iter()) {
        assert_eq!(uv[vertex as usize], *st);
    }
    let Some(Attribute::Index(numbers)) = filled.face().get("number") else { panic!("no numbers") };
    assert!(numbers.iter().all(|&number| number < mesh.faces().len() as u32));
}

#[test]
fn a_plate_over_a_very_rough_rim_stays_near() {
    let rough = grid(20, 20, |x, y| 8.0 * random((x + 20.0 * y) as u64));
    let mesh = remove_vertices(&rough, |p| (p - Point3::new(9.5, 9.5, p.z)).norm_squared() < 20.0);
    let filled = fill(&mesh, HoleChoice::All, FillMethod::ThinPlate).unwrap();
    let all = filled.mesh.positions().iter();
    assert!(all.clone().all(|p| (-20.0..30.0).contains(&p.z) && (-10.0..30.0).contains(&p.x)));
}

#[test]
fn fills_of_rough_rims_do_not_intersect_themselves() {
    for seed in 0..40u64 {
        let rough = grid(20, 20, |x, y| 5.0 * random(1000 * seed + (x + 20.0 * y) as u64));
        let mesh =
            remove_vertices(&rough, |p| (p - Point3::new(9.5, 9.5, p.z)).norm_squared() < 20.0);
        for method in PLAIN {
            let filled = fill(&mesh, HoleChoice::Edges { max: 40 }, method).unwrap();
            check_kept(&mesh, &filled.mesh);
            assert!(!has_warning(&filled, "intersect others"), "{seed}: {:?}", filled.warnings);
        }
    }
}

#[test]
fn another_surface_avoids_an_obstacle() {
    // A small ball is in the plane of the rim. A thin plate passes above the ball.
    let open = remove_vertices(&sphere(4), |p| p.z > 0.85);
    let ball = sphere(2);
    let data = open.positions().len() as u32;
    let points = open.positions().iter().copied().chain(
        ball.positions()
            .iter()
            .map(|p| Point3::from(p.coords * 0.04) + nalgebra::Vector3::z() * 0.85),
    );
    let faces = ball.faces().as_triangles().unwrap().iter().map(|face| face.map(|k| k + data));
    let faces = open.faces().as_triangles().unwrap().iter().copied().chain(faces);
    let both = triangle_mesh(points.collect(), faces.collect());
    for method in PLAIN {
        let filled = fill(&both, HoleChoice::All, method.clone()).unwrap();
        assert_eq!(check_kept(&both, &filled.mesh), 0);
        assert!(!has_warning(&filled, "intersect others"), "{:?}", filled.warnings);
        let is_flat = matches!(method, FillMethod::Flat | FillMethod::Membrane);
        assert_eq!(
            has_warning(&filled, "another surface"),
            is_flat,
            "{method:?}: {:?}",
            filled.warnings
        );
    }
}

#[test]
fn the_border_of_an_open_component_is_filled_only_on_request() {
    let mesh = grid(8, 8, |_, _| 0.0);
    let filled = fill(&mesh, HoleChoice::All, FillMethod::Flat).unwrap();
    assert_eq!(check_kept(&mesh, &filled.mesh), 28);
    assert!(filled.warnings[0].contains("Loops([0])"), "{:?}", filled.warnings);
    let closed = fill(&mesh, HoleChoice::Loops(vec![0]), FillMethod::Flat).unwrap();
    assert_eq!(check_kept(&mesh, &closed.mesh), 0);
}

#[test]
fn several_threads_give_the_same_bytes() {
    let mesh = remove_vertices(&sphere(4), |p| p.z > 0.8 || p.x > 0.9 || p.y < -0.95);
    check_threads(&mesh);
}

/// Checks that a thin plate has the same bytes for any number of threads.
fn check_threads(mesh: &Mesh) {
    fn fill_on_threads(threads: usize, mesh: &Mesh) -> Mesh {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fill(mesh, HoleChoice::All, FillMethod::ThinPlate).unwrap().mesh)
    }
    let one = fill_on_threads(1, mesh);
    assert!([2, 8].into_iter().all(|threads| fill_on_threads(threads, mesh) == one));
}

#[test]
fn a_rim_of_thousands_of_edges_is_filled() {
    let count = 3000u32;
    fn rim_point(k: u32, out: f64, count: u32) -> Point3<f64> {
        let angle = std::f64::consts::TAU * f64::from(k) / f64::from(count);
        let radius = (1.0 + 0.3 * libm::sin(5.0 * angle)) * out;
        Point3::new(
            radius * libm::cos(angle),
            radius * libm::sin(angle),
            0.2 * libm::sin(2.0 * angle),
        )
    }
    let points = (0..count)
        .map(|k| rim_point(k, 1.2, count))
        .chain((0..count).map(|k| rim_point(k, 1.0, count)));
    let faces = (0..count).flat_map(|k| {
        let next = (k + 1) % count;
        [[k, next, count + k], [next, count + next, count + k]]
    });
    let band = triangle_mesh(points.collect(), faces.collect());
    let filled = fill(&band, HoleChoice::Loops(vec![1]), FillMethod::Flat).unwrap();
    assert_eq!(check_kept(&band, &filled.mesh), count as usize);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    /// Removes random faces from a rough sphere or height field. Then either the filled mesh is manifold and contains the input mesh, or an
    /// error gives the reason.
    #[test]
    fn random_holes_give_surfaces_or_errors(seed in 0u64..1 << 40, fraction in 0.02f64..0.5, method in 0usize..4, closed: bool) {
        let whole = if closed { sphere(3) } else { grid(14, 14, |x, y| 2.0 * random(seed ^ (x + 14.0 * y) as u64)) };
        let faces = whole.faces().as_triangles().unwrap();
        let kept: Vec<[u32; 3]> = (0u64..).zip(faces).filter(|(k, _)| random(seed ^ (k << 20)) > fraction).map(|(_, face)| *face).collect();
        let holed = triangle_mesh(whole.positions().to_vec(), kept);
        match fill(&holed, HoleChoice::All, PLAIN[method].clone()) {
            Ok(filled) => {
                check_kept(&holed, &filled.mesh);
            }
            Err(error) => {
                prop_assert!(error.to_string().contains("manifold at "), "{error}");
            }
        }
    }
}
