use maquette_value::Faces;
use maquette_value::rng::Random;
use nalgebra::Vector3;

use super::*;
use crate::flat_faces::{HEIGHTS, insert_flat_faces};
use crate::shapes::{area, cut, even_ball, fine_cube, sheet, volume};

fn smooth_with(mesh: &Mesh, length: f64, keep_borders: bool) -> Mesh {
    smooth(mesh, length, keep_borders, &Progress::silent()).unwrap()
}

fn noise(random: &mut Random) -> f64 {
    // The sum of twelve uniform numbers is nearly normally distributed, with a standard deviation of 1.
    (0..12).map(|_| random.even()).sum::<f64>() - 6.0
}

/// Returns the root mean square deviation of a sphere's vertices from the radius 10.
fn deviation(ball: &Mesh) -> f64 {
    let squares =
        ball.positions().iter().map(|p| (p.coords.norm() - 10.0) * (p.coords.norm() - 10.0));
    (squares.sum::<f64>() / ball.positions().len() as f64).sqrt()
}

#[test]
fn a_ball_loses_its_noise_and_keeps_its_volume() {
    let ball = even_ball(5);
    let mut random = Random(1);
    let shaken =
        ball.positions().iter().map(|p| p + p.coords.normalize() * (0.05 * noise(&mut random)));
    let noisy = ball.with_positions(shaken.collect()).unwrap();
    assert!(deviation(&noisy) > 0.049);
    for length in [0.0, 6.0] {
        let smooth = smooth_with(&noisy, length, false);
        assert!(
            deviation(&smooth) < deviation(&noisy) / 3.0,
            "{length}: {} {}",
            deviation(&noisy),
            deviation(&smooth)
        );
        let ratio = volume(&smooth) / volume(&ball);
        assert!((ratio - 1.0).abs() < 5e-3, "{length}: {ratio}");
    }
    // As the documentation states, smoothing by a `length` equal to its radius takes less than one percent of a sphere's volume.
    let ratio = volume(&smooth_with(&ball, 10.0, false)) / volume(&ball);
    assert!((0.99..1.0).contains(&ratio), "{ratio}");
}

#[test]
fn a_coarse_mesh_keeps_its_shape_by_default() {
    for mesh in [fine_cube(1), fine_cube(2), even_ball(1), even_ball(2)] {
        let ratio = volume(&smooth_with(&mesh, 0.0, false)) / volume(&mesh);
        assert!((0.7..1.01).contains(&ratio), "{} faces: {ratio}", mesh.faces().len());
    }
}

#[test]
fn a_plane_stays_a_plane_vertex_by_vertex() {
    let flat = sheet(20, |x, y| 0.3 * x - y);
    for keep_borders in [true, false] {
        let smooth = smooth_with(&flat, 3.0, keep_borders);
        for (before, after) in flat.positions().iter().zip(smooth.positions().iter()) {
            let along = Vector3::new(-0.3, 1.0, 1.0).normalize();
            assert!((after - before).dot(&along).abs() < 1e-8);
            if keep_borders {
                assert!((after - before).norm() < 1e-6, "{before} {after}");
            }
        }
    }
}

#[test]
fn waves_keep_the_part_that_is_said() {
    for (wave, kept) in [(10.0, 0.941), (5.0, 0.5), (2.5, 1.0 / 17.0)] {
        // The sheet has several waves between distant flat borders.
        let turn = std::f64::consts::TAU / wave;
        let sheet = sheet(80, |x, _| 0.01 * libm::cos(turn * 4.0 * x));
        let wide = sheet.positions().iter().map(|p| Point3::new(4.0 * p.x, 4.0 * p.y, p.z));
        let wide = sheet.with_positions(wide.collect()).unwrap();
        let smooth = smooth_with(&wide, 5.0, true);
        let at = wide
            .positions()
            .iter()
            .position(|p| (p.x - 20.0).abs() < 1e-9 && (p.y - 20.0).abs() < 1e-9)
            .unwrap();
        let found = smooth.positions()[at].z / wide.positions()[at].z;
        assert!((found - kept).abs() < 0.03, "{wave}: {found} {kept}");
    }
}

#[test]
fn borders_and_creases_stay_or_are_smoothed_along_themselves() {
    let cube = fine_cube(20);
    let edges = cube.edges().vertices;
    fn is_side(p: &Point3<f64>, axis: usize) -> bool {
        (p[axis].abs() - 5.0).abs() < 1e-9
    }
    fn position(vertex: u32, cube: &Mesh) -> Point3<f64> {
        cube.positions()[vertex as usize]
    }
    let sharp = edges
        .iter()
        .filter(|ends| {
            (0..3)
                .filter(|&axis| ends.iter().all(|&end| is_side(&position(end, &cube), axis)))
                .count()
                == 2
        })
        .map(|&ends| (ends, 10.0));
    let sharp = cube.clone().with_creases(Vec::from_iter(sharp)).unwrap();
    for keep_borders in [true, false] {
        let smooth = smooth_with(&sharp, 2.0, keep_borders);
        assert!((volume(&smooth) - 1000.0).abs() < 1e-5 && (area(&smooth) - 600.0).abs() < 1e-5);
    }
    // Without creases the cube becomes round.
    assert!(area(&smooth_with(&cube, 2.0, false)) < 599.0);

    let mut random = Random(2);
    let flat = sheet(40, |_, _| 0.0);
    let shaken = flat.positions().iter().map(|p| p + Vector3::x() * (0.05 * noise(&mut random)));
    let shaken = flat.with_positions(shaken.collect()).unwrap();
    // Returns the roughness of the border. The corners, which become round, are left out.
    fn rough(mesh: &Mesh) -> f64 {
        let left = mesh.positions().iter().step_by(41).skip(10).take(21).map(|p| p.x * p.x);
        (left.sum::<f64>() / 21.0).sqrt()
    }
    assert_eq!(rough(&smooth_with(&shaken, 3.0, true)), rough(&shaken));
    assert!(rough(&smooth_with(&shaken, 3.0, false)) < rough(&shaken) / 2.0);
}

#[test]
fn odd_meshes_stay_sound() {
    fn run(mesh: &Mesh, length: f64) -> Result<Mesh, Error> {
        smooth(mesh, length, false, &Progress::silent())
    }
    let places = Vec::from(
        [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.], [1., 1., 1.]].map(Point3::from),
    );
    let of =
        |faces: &[[u32; 3]]| Mesh::new(places.clone(), Faces::triangles(faces.to_vec())).unwrap();
    assert_eq!(run(&of(&[]), 0.0).unwrap(), of(&[]));
    // Test three faces at an edge, inconsistently oriented faces, and a face without area.
    for faces in [&[[0, 1, 2], [1, 0, 3], [0, 1, 4]][..], &[[0, 1, 2], [0, 1, 3]], &[[0, 1, 2]]] {
        run(&of(faces), 1.0).unwrap();
    }
    let line = Mesh::new(vec![Point3::origin(); 3], Faces::triangles(vec![[0, 1, 2]])).unwrap();
    assert_eq!(run(&line, 1.0).unwrap(), line);
    for length in [-1.0, f64::NAN] {
        let error = run(&line, length).unwrap_err().to_string();
        assert_eq!(error, format!("`length` is {length} mm, but must be a number from 0 on"));
    }
}

#[test]
fn the_bytes_are_the_same_for_any_number_of_threads() {
    let wave = sheet(120, |x, y| libm::sin(9.0 * x) * libm::cos(7.0 * y));
    fn run(threads: usize, wave: &Mesh) -> Mesh {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| smooth_with(wave, 0.5, false))
    }
    let one = run(1, &wave);
    assert!([2, 3, 8].iter().all(|&threads| run(threads, &wave) == one));
}

/// Returns the largest distance between the vertices of one mesh and those of another with the same index.
fn largest_move(a: &Mesh, b: &Mesh) -> f64 {
    let moves = a.positions().iter().zip(b.positions().iter()).map(|(a, b)| (b - a).norm());
    moves.fold(0.0, f64::max)
}

#[test]
fn faces_without_area_change_nothing() {
    let mut random = Random(3);
    fn shake(mesh: Mesh, random: &mut Random) -> Mesh {
        let moved =
            mesh.positions().iter().map(|p| p + Vector3::from_fn(|_, _| 0.05 * noise(random)));
        let moved = Vec::from_iter(moved);
        cut(&mesh.with_positions(moved).unwrap())
    }
    let shapes = [
        shake(even_ball(3), &mut random),
        shake(sheet(12, |x, y| libm::sin(x) * libm::cos(y)), &mut random),
        shake(fine_cube(5), &mut random),
    ];
    for (seed, mesh) in (1..).zip(shapes) {
        for height in HEIGHTS {
            let given = insert_flat_faces(&mesh, 30, height, seed);
            assert!(given.positions().len() > mesh.positions().len() + 5);
            for (length, keep_borders) in [(5.0, false), (2.0, true)] {
                let [with, without] =
                    [&given, &mesh].map(|mesh| smooth_with(mesh, length, keep_borders));
                let off = largest_move(&without, &with);
                assert!(off <= 1e-6 + 30.0 * height, "{seed} {height}: {off}");
                // The new vertices stay on their edges.
                let added = &with.positions()[mesh.positions().len()..];
                let before = &given.positions()[mesh.positions().len()..];
                assert!(added.iter().zip(before).all(|(a, b)| (b - a).norm() < 1.0));
            }
        }
    }
}

#[test]
fn neighbors_that_came_to_one_place_keep_their_distance() {
    let mesh = cut(&sheet(4, |_, _| 0.0));
    let points = mesh.positions();
    let up = Vector3::new(0.0, 0.0, 1.0);
    let mut places: Vec<_> = points.iter().map(|point| point + up).collect();
    places[7] = places[6];
    keep_apart(&mut places, &mesh, &mesh.edges());
    let mean = up - Vector3::new(1.25, 0.0, 0.0);
    for (vertex, (place, point)) in places.iter().zip(points.iter()).enumerate() {
        let expected = if [6, 7].contains(&vertex) { mean } else { up };
        assert!((place - point - expected).norm() < 1e-12, "{vertex}: {place}");
    }
}
