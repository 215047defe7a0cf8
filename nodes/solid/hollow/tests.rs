//! Tests of hollow solids.

use maquette_value::Attribute;
use nalgebra::Point3;

use super::*;

mod family;

/// Returns a box of quads with the given size.
fn cuboid(size: [f64; 3]) -> Mesh {
    let faces =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let faces = Faces::uniform(4, faces.as_flattened().to_vec()).unwrap();
    Mesh::new(
        (0..8)
            .map(|k: usize| Point3::from([0, 1, 2].map(|axis| size[axis] * (k >> axis & 1) as f64)))
            .collect::<Vec<_>>(),
        faces,
    )
    .unwrap()
}

/// Hollows a solid without outlets. Its walls must be thick enough.
fn hollow_closed(solid: &Mesh, how: (f64, f64)) -> Mesh {
    let (hollow, thin) = hollow(solid, how, &[], &Progress::silent()).unwrap();
    assert_eq!(thin, None);
    hollow
}

fn volume(mesh: &Mesh) -> f64 {
    crate::volume::volume(mesh, Point3::origin())
}

fn is_solid(mesh: &Mesh) -> bool {
    let edges = mesh.edges();
    edges.misoriented == 0 && edges.faces.iter().all(|faces| *faces == 2)
}

#[test]
fn a_box_gets_a_cavity_behind_walls_that_are_as_thick_as_asked() {
    let solid = cuboid([20.0, 16.0, 12.0]);
    for (thickness, spacing) in [(2.0, 0.0), (2.0, 0.5), (3.0, 1.5)] {
        let hollow = hollow_closed(&solid, (thickness, spacing));
        assert!(is_solid(&hollow));
        assert_eq!(
            hollow.crossings(|| Progress::silent().check()).unwrap(),
            Vec::<[u32; 2]>::new()
        );
        let inner = [20.0, 16.0, 12.0].iter().map(|size| size - 2.0 * thickness).product::<f64>();
        let found = 20.0 * 16.0 * 12.0 - volume(&hollow);
        assert!((found - inner).abs() < 0.05 * inner, "{found} {inner}");
        let cavity = &hollow.positions()[8..];
        let nearest = TriangleTree::new(&solid).nearest_to_all(cavity);
        let least =
            nearest.iter().map(|it| it.unwrap().distance_sq.sqrt()).fold(f64::INFINITY, f64::min);
        assert!(least > thickness - 1e-9 && least < thickness + 1e-6, "{least}");
    }
}

#[test]
fn walls_around_inner_edges_are_nowhere_thinner_than_asked() {
    let [block, notch] = [[20.0, 16.0, 12.0], [10.0, 8.0, 30.0]].map(cuboid);
    let solid = boolean(&block, &[&notch], Operation::Difference, &Progress::silent()).unwrap();
    let tree = TriangleTree::new(&solid);
    for (thickness, spacing) in [(2.0, 0.0), (1.5, 0.5)] {
        let hollow = hollow_closed(&solid, (thickness, spacing));
        assert!(is_solid(&hollow));
        assert_eq!(
            hollow.crossings(|| Progress::silent().check()).unwrap(),
            Vec::<[u32; 2]>::new()
        );
        let cavity = hollow.faces().iter().skip(solid.faces().len());
        // The wall is measured at ten points on each triangle of the cavity.
        let places = cavity.flat_map(|face| {
            let [a, b, c] = [0, 1, 2].map(|k| hollow.positions()[face[k] as usize]);
            let steps = (0..4).flat_map(|i| (0..4 - i).map(move |j| [i, j]));
            steps.map(move |[i, j]| a + f64::from(i) / 3.0 * (b - a) + f64::from(j) / 3.0 * (c - a))
        });
        let walls = tree.nearest_to_all(&Vec::from_iter(places)).into_iter().flatten();
        let least = walls.map(|it| it.distance_sq.sqrt()).fold(f64::INFINITY, f64::min);
        assert!(0.98 * thickness < least, "{least}");
        assert!(volume(&hollow) < 0.8 * volume(&solid));
    }
}

#[test]
fn no_cavity_is_much_smaller_than_the_wall_is_thick() {
    // Walls of 2 mm would leave a cavity with edges of 0.9 mm in the first box, which is too small, and of 1.2 mm in the second.
    let whole = cuboid([4.9; 3]);
    assert_eq!(hollow_closed(&whole, (2.0, 0.25)), whole);
    let cube = hollow_closed(&cuboid([5.2; 3]), (2.0, 0.25));
    assert!(is_solid(&cube) && cube.faces().len() > 6);
}

#[test]
fn what_is_too_thin_stays_whole_and_what_is_hollow_gets_thinner_walls_from_both_sides() {
    let plate = cuboid([20.0, 16.0, 3.9]);
    assert_eq!(hollow_closed(&plate, (2.0, 0.0)), plate);
    let once = hollow_closed(&cuboid([24.0; 3]), (8.0, 2.0));
    let twice = hollow_closed(&once, (1.0, 0.5));
    assert!(is_solid(&twice) && volume(&twice) < volume(&once));
    let middle = Point3::new(12.0, 12.0, 12.0);
    let nearest = TriangleTree::new(&twice).nearest_to_all(&[middle])[0].unwrap();
    assert!((nearest.distance_sq.sqrt() - 4.0).abs() < 0.5);
}

#[test]
fn the_cavity_has_the_attributes_of_the_surface() {
    let solid = cuboid([20.0, 16.0, 12.0]);
    let colors = Attribute::Color((0..8).map(|k| [k, 0, 0]).collect());
    let parts = Attribute::Index((0..6).collect());
    let solid = solid.with_vertex("color", colors).unwrap().with_face("part", parts).unwrap();
    let hollow = hollow_closed(&solid, (2.0, 0.0));
    let colors = hollow.vertex().colors("color").unwrap();
    assert!((0..8).all(|k| colors[8..].contains(&[k, 0, 0])));
    let Some(Attribute::Index(parts)) = hollow.face().get("part") else { panic!("no parts") };
    assert!((0..6).all(|k| parts[6..].contains(&k)));
}

#[test]
fn it_is_the_same_for_any_number_of_threads() {
    let solid = cuboid([20.0, 16.0, 12.0]);
    fn hollow_with(threads: usize, solid: &Mesh) -> Mesh {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| hollow_closed(solid, (2.0, 0.0)))
    }
    assert_eq!(hollow_with(1, &solid), hollow_with(3, &solid));
}

#[test]
fn unsuitable_meshes_are_errors() {
    let solid = cuboid([20.0, 16.0, 12.0]);
    fn error(mesh: &Mesh, thickness: f64, spacing: f64) -> String {
        hollow(mesh, (thickness, spacing), &[], &Progress::silent()).unwrap_err().to_string()
    }
    assert_eq!(error(&solid, f64::NAN, 0.0), "`thickness` is NaN, but must be a number above 0");
    assert_eq!(
        error(&solid, 2.0, 1.5),
        "`spacing` is 1.5, but must be at least 0, and at most 1, half of `thickness`"
    );
    assert!(error(&solid, 0.01, 0.0).starts_with("the inside of the solid would need about "));
    let open = Faces::uniform(4, solid.faces().corners()[..20].to_vec()).unwrap();
    let open = Mesh::new(solid.positions().clone(), open).unwrap();
    assert_eq!(
        error(&open, 2.0, 0.0),
        "the mesh is not closed: 4 of its edges do not have two faces, the first one at (20.000, 8.000, 0.000); use `Solid` to close it"
    );
    let mirrored = solid.positions().iter().map(|p| Point3::new(-p.x, p.y, p.z)).collect();
    let mirrored = solid.with_positions(mirrored).unwrap();
    assert_eq!(
        error(&mirrored, 2.0, 0.0),
        "the mesh is inside out; use `Orient` to turn it outward"
    );
    fn moved(by: f64, scale: f64, solid: &Mesh) -> Mesh {
        let places = solid.positions().iter().map(|at| at * scale + Vector3::repeat(by));
        solid.with_positions(places.collect()).unwrap()
    }
    fn merged(other: &Mesh, solid: &Mesh) -> Mesh {
        merge(&[solid, other], Poses::Ignore).unwrap()
    }
    let text = error(&merged(&moved(3.0, 0.5, &solid), &solid), 2.0, 0.0);
    assert!(text.starts_with("part 2 of 2 at (3.000, "), "{text}");
    assert!(
        text.contains("is inside of another part, and both face outward; use `Orient`"),
        "{text}"
    );
    let text = error(&merged(&moved(5.0, 1.0, &solid), &solid), 2.0, 0.0);
    assert!(text.starts_with("part 2 of 2 at "), "{text}");
    assert!(text.contains("overlaps another part; use `Boolean` with an empty `with`"), "{text}");
    let text = error(&merged(&moved(0.0, 1.0, &solid), &solid), 2.0, 0.0);
    assert!(text.starts_with("part 1 of 2 at "), "{text}");
    // Solids that touch are none of these.
    let beside = solid.positions().iter().map(|at| at + Vector3::new(20.0, 0.0, 0.0)).collect();
    let beside = solid.with_positions(beside).unwrap();
    assert!(hollow(&merged(&beside, &solid), (2.0, 0.0), &[], &Progress::silent()).is_ok());
    let empty = Mesh::new(Vec::new(), Faces::triangles(Vec::new())).unwrap();
    assert_eq!(hollow_closed(&empty, (2.0, 0.0)), empty);
}

#[test]
fn outlets_lead_through_the_wall() {
    let solid = cuboid([20.0, 16.0, 12.0]);
    let with = |outlets: &[Outlet]| {
        hollow(&solid, (2.0, 0.0), outlets, &Progress::silent()).map(|(mesh, _)| mesh)
    };
    let closed = with(&[]).unwrap();
    let below = Outlet { at: [10.0, 8.0, -30.0], diameter: 3.0 };
    let above = Outlet { at: [6.0, 8.0, 13.0], diameter: 2.0 };
    for (outlets, euler) in [(&[][..], 4), (&[below], 2), (&[below, above], 0)] {
        let open = with(outlets).unwrap();
        assert!(is_solid(&open));
        let edges = open.edges().faces.len();
        assert_eq!(open.positions().len() + open.faces().len(), edges + euler);
        // The outlet is a prism with 32 sides, as high as the wall is thick.
        let sine = libm::sin(std::f64::consts::TAU / 32.0);
        let drilled: f64 =
            outlets.iter().map(|it| 2.0 * (it.diameter * it.diameter * 4.0 * sine)).sum();
        let found = volume(&closed) - volume(&open);
        assert!((found - drilled).abs() < 1e-3 * drilled.max(1e-6), "{found} {drilled}");
    }
    assert_eq!(with(&[below, above, below]).unwrap(), with(&[below, above]).unwrap());
    let error = |outlet: Outlet| with(&[below, outlet]).unwrap_err().to_string();
    let wide = error(Outlet { diameter: 100.0, ..above });
    assert!(wide.starts_with("nothing is left of the solid: the outlets are too wide"), "{wide}");
    assert_eq!(
        error(Outlet { diameter: 0.0, ..above }),
        "outlet 2 has the diameter 0 at (6, 8, 13), but must have finite numbers, and a diameter above 0"
    );
    assert!(error(Outlet { at: [f64::NAN, 0.0, 0.0], ..above }).starts_with("outlet 2 has"));
}
