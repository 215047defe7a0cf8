//! Tests of the exact arrangement.

use maquette_mesh::{Poses, merge};
use maquette_value::Faces;
use maquette_value::rng::Random;
use nalgebra::{Rotation3, Vector3};

use super::*;
use crate::combine::tests::{ball, cuboid, size};
use crate::combine::{boolean, unite};
use crate::operation::Operation;

#[track_caller]
fn check_solid(mesh: &Mesh) {
    let edges = mesh.edges();
    assert_eq!(edges.misoriented, 0);
    assert!(edges.faces.iter().all(|faces| *faces == 2));
    assert_eq!(mesh.crossings(|| Progress::silent().check()).unwrap(), Vec::<[u32; 2]>::new());
}

/// Unites the parts of a mesh and checks that the result is a solid of the given volume.
#[track_caller]
fn check(parts: &[Mesh], wanted: f64) -> Mesh {
    let mesh = merge(&Vec::from_iter(parts), Poses::Ignore).unwrap();
    let made = unite(&mesh, &Progress::silent()).unwrap();
    check_solid(&made);
    let found = size(&made);
    assert!((found - wanted).abs() < 1e-7 * wanted, "{found}, not {wanted}");
    made
}

#[test]
fn boxes_that_overlap_lie_in_each_other_or_coincide_are_united() {
    fn cube(low: [f64; 3]) -> Mesh {
        cuboid(low, [10.0; 3])
    }
    check(&[cube([0.; 3]), cube([5., 6., 7.])], 2000.0 - 60.0);
    check(&[cube([0.; 3]), cube([5., 0., 0.])], 1500.0);
    check(&[cube([0.; 3]), cube([10., 0., 0.])], 2000.0);
    check(&[cube([0.; 3]), cube([0.; 3]), cube([0.; 3])], 1000.0);
    check(&[cube([0.; 3]), cuboid([2., 3., 4.], [1., 2., 3.])], 1000.0);
    // Boxes that touch along an edge or in a corner stay apart.
    check(&[cube([0.; 3]), cube([10., 10., 0.])], 2000.0);
    let made = check(&[cube([0.; 3]), cube([10., 10., 10.])], 2000.0);
    assert_eq!((made.positions().len(), made.faces().len()), (16, 12));
    let three = [cube([0.; 3]), cube([5., 0., 0.]), cube([0., 5., 5.])];
    check(&three, 1500.0 + 1000.0 - 250.0);
}

#[test]
fn faces_away_from_the_crossings_stay_bit_for_bit() {
    let solids = [ball([0.; 3], 10.0, 9), ball([9., 2., 1.], 7.0, 8)];
    let union = boolean(&solids[0], &[&solids[1]], Operation::Union, &Progress::silent()).unwrap();
    let made = check(&solids, size(&union));
    let old: std::collections::BTreeSet<_> = solids
        .iter()
        .flat_map(|solid| solid.positions().iter())
        .map(|at| [at.x.to_bits(), at.y.to_bits(), at.z.to_bits()])
        .collect();
    let is_old =
        |at: &&Point3<f64>| old.contains(&[at.x.to_bits(), at.y.to_bits(), at.z.to_bits()]);
    let kept = made.positions().iter().filter(is_old).count();
    assert!(2 * old.len() < 3 * kept, "{kept} of {}", old.len());
}

/// A random solid of a kind that meets others in all ways: boxes and octahedra of a lattice, turned boxes, balls.
fn random_solid(random: &mut Random) -> Mesh {
    fn below(limit: f64, random: &mut Random) -> f64 {
        (random.even() * limit).floor()
    }
    let low = [below(5.0, random), below(5.0, random), below(5.0, random)];
    let sizes = [1.0 + below(4.0, random), 1.0 + below(4.0, random), 1.0 + below(4.0, random)];
    match below(4.0, random) as u32 {
        0 => cuboid(low, sizes),
        1 => ball(low, sizes[0], 1),
        2 => ball(low, 1.7 + 0.3 * sizes[1], 4),
        _ => {
            let turn = Rotation3::from_scaled_axis(Vector3::new(sizes[0], 0.3, low[1]));
            let solid = cuboid(low, sizes);
            let places = solid.positions().iter().map(|at| turn * at).collect();
            solid.with_positions(places).unwrap()
        }
    }
}

#[test]
fn random_unions_are_solids_that_do_not_cross_themselves() {
    let mut random = Random(3);
    for case in 0..100 {
        let count = 2 + case % 3;
        let solids: Vec<Mesh> = (0..count).map(|_| random_solid(&mut random)).collect();
        let others = Vec::from_iter(&solids[1..]);
        let union = boolean(&solids[0], &others, Operation::Union, &Progress::silent()).unwrap();
        check(&solids, size(&union));
    }
}

/// A bar along x that is bent around z by the given angle, such that its ends overlap if that is more than a full turn.
fn bent_bar(angle: f64, radius: f64, thickness: f64, steps: u32) -> Mesh {
    let ring = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let places = (0..=steps).flat_map(|k| {
        let turn = angle * f64::from(k) / f64::from(steps);
        ring.map(|[x, y]| {
            let away = radius + x * thickness / 2.0;
            Point3::new(away * libm::cos(turn), away * libm::sin(turn), y * thickness / 2.0)
        })
    });
    let sides = (0..steps).flat_map(|k| {
        (0..4).map(move |side| {
            let [a, b] = [4 * k + side, 4 * k + (side + 1) % 4];
            [a, b, b + 4, a + 4]
        })
    });
    let last = 4 * steps;
    let mut faces: Vec<u32> = sides.flatten().collect();
    faces.extend([0, 3, 2, 1, last, last + 1, last + 2, last + 3]);
    let mesh = Mesh::new(Vec::from_iter(places), Faces::uniform(4, faces).unwrap()).unwrap();
    match size(&mesh) < 0.0 {
        true => maquette_mesh::orient(&mesh, maquette_mesh::Outside::Flip).unwrap().mesh,
        false => mesh,
    }
}

#[test]
fn a_bar_whose_ends_overlap_becomes_a_ring() {
    let ring = bent_bar(7.0, 10.0, 3.0, 40);
    assert!(!ring.crossings(|| Progress::silent().check()).unwrap().is_empty());
    let made = unite(&ring, &Progress::silent()).unwrap();
    check_solid(&made);
    // A ring has the Euler characteristic 0.
    assert_eq!(made.positions().len() + made.faces().len(), made.edges().faces.len());
    let full = 10.0 * std::f64::consts::TAU * 9.0;
    assert!((size(&made) / full - 1.0).abs() < 0.02, "{} {full}", size(&made));
}
