//! Tests of shells.

use maquette_value::{Attribute, Faces};
use nalgebra::Point3;

use super::*;

mod family;

/// Returns a grid of 21 x 21 points over 20 x 20 mm with the given heights.
fn net(height: impl Fn(f64, f64) -> f64) -> Mesh {
    let places = (0..441).map(|k| [f64::from(k % 21) - 10.0, f64::from(k / 21) - 10.0]);
    let positions = places.map(|[x, y]| Point3::new(x, y, height(x, y))).collect::<Vec<_>>();
    let cells = (0..420).filter(|k| k % 21 < 20);
    let faces = cells.flat_map(|k| [[k, k + 1, k + 22], [k, k + 22, k + 21]]).collect();
    Mesh::new(positions, Faces::triangles(faces)).unwrap()
}

fn check(mesh: &Mesh, thickness: f64, side: Side, most_thin: f64) -> Mesh {
    let (shell, thin) = shell(mesh, thickness, side, &Progress::silent()).unwrap();
    let edges = shell.edges();
    assert!(edges.misoriented == 0 && edges.faces.iter().all(|faces| *faces == 2));
    assert_eq!(shell.crossings(|| Progress::silent().check()).unwrap(), Vec::<[u32; 2]>::new());
    let thin = thin.map_or(0, |it| it.count);
    assert!(
        thin as f64 <= most_thin * shell.faces().len() as f64,
        "{thin} of {}",
        shell.faces().len()
    );
    shell
}

fn volume(mesh: &Mesh) -> f64 {
    crate::volume::volume(mesh, Point3::origin())
}

#[test]
fn a_plane_becomes_a_plate_on_the_side_that_is_asked_for() {
    let plane = net(|_, _| 0.0);
    for (side, low) in [(Side::Inside, -2.02), (Side::Outside, 0.0)] {
        let plate = check(&plane, 2.0, side, 0.0);
        let bounds = plate.bounds().unwrap();
        assert!((bounds.0.z - low).abs() < 1e-6 && (bounds.1.z - low - 2.02).abs() < 1e-6);
        // The walls of the plate are upright, so its volume is its area times its thickness.
        assert!((volume(&plate) - 400.0 * 2.02).abs() < 0.5, "{}", volume(&plate));
    }
    let plate = check(&plane, 2.0, Side::Middle, 0.0);
    let bounds = plate.bounds().unwrap();
    assert!((bounds.0.z + 1.01).abs() < 1e-6 && (bounds.1.z - 1.01).abs() < 1e-6);
}

#[test]
fn a_thin_plate_has_few_faces() {
    let plane = net(|_, _| 0.0);
    for side in [Side::Inside, Side::Outside, Side::Middle] {
        let plate = check(&plane, 0.01, side, 0.0);
        assert_eq!(plate.faces().len(), 2 * plane.faces().len() + 2 * 80);
    }
}

#[test]
fn the_surface_stays_where_the_other_side_has_no_room() {
    // The surface has noise, and a ridge that is narrower than twice the thickness.
    fn noise(x: f64, y: f64) -> f64 {
        0.1 * libm::sin(37.0 * x + 91.0 * y * y)
    }
    let ridge = net(|x, y| 4.0 * libm::exp(-x * x / 3.0) + noise(x, y));
    for side in [Side::Inside, Side::Outside] {
        let shell = check(&ridge, 1.5, side, 0.01);
        let places = shell.positions();
        assert!(ridge.positions().iter().all(|at| places.contains(at)), "{side:?}");
    }
    check(&ridge, 1.5, Side::Middle, 0.01);
}

#[test]
fn a_cap_gets_an_even_rim_and_a_hole_stays_open() {
    let dome = net(|x, y| (225.0 - x * x - y * y).sqrt());
    let kept = (0..dome.faces().len()).filter(|&face| {
        let mut places = dome.faces().face(face).iter().map(|&it| dome.positions()[it as usize]);
        !places.all(|at| at.x.abs() < 3.1 && (-2.1..1.1).contains(&at.y))
    });
    let dome = dome.select(&kept.map(|face| face as u32).collect::<Vec<_>>());
    let shell = check(&dome, 1.0, Side::Inside, 0.03);
    let (vertices, faces, edges) =
        (shell.positions().len(), shell.faces().len(), shell.edges().faces.len());
    // The shell is a plate with a hole: its Euler characteristic is that of a torus.
    assert_eq!(vertices + faces, edges);
    // The walls are upright, so the back of the rim is below the front by the thickness times the slope of the normal, a third at the
    // corners of the dome.
    fn lowest(mesh: &Mesh) -> f64 {
        mesh.bounds().unwrap().0.z
    }
    assert!((0.2..0.5).contains(&(lowest(&dome) - lowest(&shell))));
}

#[test]
fn a_closed_mesh_becomes_hollow() {
    let block = crate::thicken::tests::cuboid([10.0, 12.0, 14.0], 2);
    let hollow = check(&block, 1.0, Side::Inside, 0.0);
    let inner = 1680.0 - volume(&hollow);
    assert!((inner - 7.98 * 9.98 * 11.98).abs() < 0.03 * inner, "{inner}");
}

#[test]
fn a_closed_mesh_gets_a_shell_around_it() {
    let block = crate::thicken::tests::cuboid([10.0, 12.0, 14.0], 2);
    let outside = check(&block, 1.0, Side::Outside, 0.0);
    let (low, high) = outside.bounds().unwrap();
    let size = high - low;
    for (size, own) in size.iter().zip([10.0, 12.0, 14.0]) {
        assert!((size - own - 2.02).abs() < 0.02, "{size} around {own}");
    }
    // The block itself is the cavity. The outer edges are sharp.
    let hollow = volume(&outside);
    let most = 12.02 * 14.02 * 16.02 - 1680.0;
    assert!((0.99 * most..1.01 * most).contains(&hollow), "{hollow} of {most}");
    // Without one of its faces, the block gets about the same shell.
    let faces = (0..block.faces().len() as u32).filter(|face| *face != 0);
    let open = check(&block.select(&Vec::from_iter(faces)), 1.0, Side::Outside, 0.05);
    assert!((volume(&open) - hollow).abs() < 0.03 * hollow, "{}", volume(&open));
    // No part of the shell is inside of the block.
    assert!(!open.positions().iter().any(|at| {
        let mut sides = at.coords.iter().zip([10.0, 12.0, 14.0]);
        sides.all(|(x, own)| 0.01 < *x && *x < own - 0.01)
    }));
}

#[test]
fn holes_may_touch() {
    let ball = crate::thicken::tests::cuboid([10.0; 3], 3);
    // Two faces share a vertex but no edge.
    let faces = ball.faces();
    fn common_vertices(a: &[u32], b: &[u32]) -> usize {
        a.iter().filter(|vertex| b.contains(vertex)).count()
    }
    let other =
        (1..faces.len()).find(|&face| common_vertices(faces.face(0), faces.face(face)) == 1);
    let kept = (1..faces.len()).filter(|face| Some(*face) != other);
    let pinched = ball.select(&kept.map(|face| face as u32).collect::<Vec<_>>());
    check(&pinched, 0.5, Side::Inside, 0.1);
}

#[test]
fn both_sides_have_the_attributes_of_the_surface() {
    let colors = Attribute::Color((0..441).map(|k| [k as u8, 0, 0]).collect());
    let parts = Attribute::Index((0..800).collect());
    let plane = net(|_, _| 0.0).with_vertex("color", colors).unwrap();
    let shell = check(&plane.with_face("part", parts).unwrap(), 2.0, Side::Inside, 0.0);
    let colors = shell.vertex().colors("color").unwrap();
    let from = |low: f64| {
        let colors = shell.positions().iter().zip(colors.iter());
        colors.filter(move |(at, _)| (at.z - low).abs() < 0.1).map(|(_, color)| color[0])
    };
    assert!(from(0.0).max() == Some(255) && from(-2.02).max() == Some(255));
    assert!(shell.face().get("part").is_some());
}

#[test]
fn unsuitable_surfaces_are_errors() {
    fn error(mesh: &Mesh, thickness: f64) -> String {
        shell(mesh, thickness, Side::Inside, &Progress::silent()).unwrap_err().to_string()
    }
    let plane = net(|_, _| 0.0);
    let empty = Mesh::new(Vec::new(), Faces::triangles(Vec::new())).unwrap();
    assert!(error(&empty, 1.0).starts_with("the shell is empty: "));
    let fan = (0..5u32).map(|k| Point3::new(f64::from(k), f64::from(k * k), f64::from(k % 2)));
    let fan =
        Mesh::new(fan.collect::<Vec<_>>(), Faces::triangles(vec![[0, 1, 2], [0, 1, 3], [1, 0, 4]]));
    assert!(error(&fan.unwrap(), 1.0).starts_with("the faces are not a surface: "));
    assert_eq!(error(&plane, 0.0), "`thickness` is 0, but must be a number above 0");
    assert_eq!(error(&plane, f64::NAN), "`thickness` is NaN, but must be a number above 0");
    let steep = plane.with_positions(
        plane.positions().iter().map(|p| Point3::new(p.x, p.x * p.y / 9.0, p.y)).collect(),
    );
    let both =
        maquette_mesh::merge(&[&plane, &steep.unwrap()], maquette_mesh::Poses::Ignore).unwrap();
    let text = error(&both, 1.0);
    assert!(text.starts_with("the surface intersects itself or folds over itself near "), "{text}");
    let ball = crate::thicken::tests::cuboid([10.0; 3], 2);
    let turned = orient(&ball, Outside::Flip).unwrap().mesh;
    assert!(error(&turned, 1.0).starts_with("the surface has no inside behind it: "));
    for thickness in [1e-9, 1e300] {
        let text = error(&plane, thickness);
        assert!(text.starts_with("the shell is empty: `thickness`, "), "{text}");
    }
}
