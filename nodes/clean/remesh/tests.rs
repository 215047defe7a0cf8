use maquette_node::LimitError;
use maquette_value::{Attribute, Faces};
use nalgebra::Point3;

use super::*;
use crate::flat_faces::{HEIGHTS, insert_flat_faces};
use crate::shapes::{area, ball, cube, cut, fine_cube, sheet, volume};

fn even(mesh: &Mesh, length: f64) -> Mesh {
    let even = remesh(mesh, length, 40.0, &Progress::silent()).unwrap();
    check(mesh, &even);
    even
}

/// Returns the Euler characteristic of a mesh, and 1 if the mesh has a border, otherwise 0.
fn kind(mesh: &Mesh) -> (i64, usize) {
    let edges = mesh.edges();
    let used = std::collections::BTreeSet::from_iter(mesh.faces().corners().iter());
    let euler = used.len() as i64 - edges.vertices.len() as i64 + mesh.faces().len() as i64;
    let holes = mesh.edges().faces.iter().filter(|&&faces| faces == 1).count();
    (euler, usize::from(holes > 0))
}

/// Checks that `after` has the topology of `before`, and that no triangle is folded over.
fn check(before: &Mesh, after: &Mesh) {
    let edges = after.edges();
    assert!(edges.misoriented == 0 && edges.faces.iter().all(|&faces| faces <= 2));
    assert_eq!(kind(before), kind(after));
    let mut normals = vec![Vec::new(); edges.vertices.len()];
    for (face, corners) in after.faces().iter().enumerate() {
        let normal = after.area_vector(corners).try_normalize(0.0).expect("an area");
        (0..3).for_each(|k| normals[edges.of_corner[3 * face + k] as usize].push(normal));
    }
    for pair in normals.iter().filter(|normals| normals.len() == 2) {
        assert!(pair[0].dot(&pair[1]) > -0.1, "{pair:?}");
    }
}

fn lengths(mesh: &Mesh) -> Vec<f64> {
    let ends = mesh.edges().vertices;
    fn place(vertex: u32, mesh: &Mesh) -> Point3<f64> {
        mesh.positions()[vertex as usize]
    }
    ends.iter().map(|&[a, b]| (place(b, mesh) - place(a, mesh)).norm()).collect()
}

/// Returns the mean and the minimum of the smallest angles of all triangles, in degrees.
fn angles(mesh: &Mesh) -> (f64, f64) {
    let least = mesh.faces().iter().map(|face| {
        let p = [0, 1, 2].map(|k| mesh.positions()[face[k] as usize]);
        fn angle(k: usize, p: &[Point3<f64>; 3]) -> f64 {
            let (a, b) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
            libm::atan2(a.cross(&b).norm(), a.dot(&b)).to_degrees()
        }
        angle(0, &p).min(angle(1, &p)).min(angle(2, &p))
    });
    let least = Vec::from_iter(least);
    let mean = least.iter().sum::<f64>() / least.len() as f64;
    (mean, least.into_iter().fold(f64::INFINITY, f64::min))
}

#[test]
fn a_cube_keeps_its_corners_its_edges_and_its_sides() {
    for length in [0.7, 2.0, 4.0, 30.0] {
        let even = even(&cube(), length);
        assert!((area(&even) - 600.0).abs() < 1e-9, "{length}: {}", area(&even));
        fn count_sides(p: &Point3<f64>) -> usize {
            p.iter().filter(|x| (x.abs() - 5.0).abs() < 1e-12).count()
        }
        let corners = even.positions().iter().filter(|p| count_sides(p) == 3).count();
        assert_eq!(corners, 8);
        assert!(even.positions().iter().all(|p| count_sides(p) >= 1));
        if length < 3.0 {
            let (mean, least) = angles(&even);
            assert!(mean > 45.0 && least > 20.0, "{length}: {mean} {least}");
        }
    }
    assert_eq!(even(&cube(), 30.0).faces().len(), 12);
}

#[test]
fn a_sheet_stays_flat_and_square() {
    for length in [0.3, 1.0, 3.0] {
        let even = even(&sheet(10, |_, _| 0.0), length);
        assert!((area(&even) - 100.0).abs() < 1e-9);
        assert!(lengths(&even).iter().all(|x| *x <= 1.5 * length));
        let mean = lengths(&even).iter().sum::<f64>() / lengths(&even).len() as f64;
        assert!((mean / length - 1.0).abs() < 0.15, "{length}: {mean}");
    }
}

#[test]
fn a_ball_keeps_its_radius_and_has_even_triangles() {
    let ball = ball(40);
    let even = even(&ball, 1.0);
    for place in even.positions().iter() {
        // The vertices must not deviate from the sphere more than the triangles of the original mesh.
        assert!((place.coords.norm() - 10.0).abs() < 0.04, "{place}");
    }
    let (mean, least) = angles(&even);
    assert!(mean > 50.0 && least > 25.0, "{mean} {least}");
    let spread = lengths(&even);
    assert!(spread.iter().all(|x| 0.5 < *x && *x < 1.5));
}

#[test]
fn the_ridge_of_a_roof_stays_where_it_is() {
    let roof = sheet(20, |x, _| 5.0 - (x - 5.0).abs());
    let even = even(&roof, 0.8);
    assert!((area(&even) / area(&roof) - 1.0).abs() < 1e-9);
    // With an `angle` of 180 degrees, the sharp edge of the roof is not kept: the edge is rounded in places, but only slightly.
    let cut = remesh(&roof, 0.8, 180.0, &Progress::silent()).unwrap();
    check(&roof, &cut);
    assert!(area(&cut) < area(&roof) - 1e-3);
}

#[test]
fn creases_keep_their_sharpness_and_attributes_their_places() {
    let flat = sheet(10, |_, _| 0.0);
    let line = (0..10).map(|k| ([5 + 11 * k, 16 + 11 * k], 2.5));
    let x = flat.positions().iter().map(|p| p.x).collect();
    let side = (0..100u32).map(|face| u32::from(face % 10 >= 5)).collect();
    let corners = vec![1.0; 400].into();
    let given = flat.clone().with_creases(line).unwrap();
    let given = given.with_vertex("x", Attribute::Number(x)).unwrap();
    let given = given.with_face("side", Attribute::Index(side)).unwrap();
    let given = given.with_corner("gone", Attribute::Number(corners)).unwrap();
    let even = even(&given, 0.7);
    fn position(vertex: u32, even: &Mesh) -> Point3<f64> {
        even.positions()[vertex as usize]
    }
    assert!(even.creases().all(|([a, b], s)| s == 2.5
        && [a, b].iter().all(|&v| (position(v, &even).x - 5.0).abs() < 1e-12)));
    let length: f64 =
        even.creases().map(|([a, b], _)| (position(b, &even) - position(a, &even)).norm()).sum();
    assert!((length - 10.0).abs() < 1e-9);
    let Some(Attribute::Number(x)) = even.vertex().get("x") else { panic!("x") };
    assert!(even.positions().iter().zip(x.iter()).all(|(p, x)| (p.x - x).abs() < 1e-9));
    let Some(Attribute::Index(side)) = even.face().get("side") else { panic!("side") };
    for (face, &side) in even.faces().iter().zip(side.iter()) {
        let middle = face.iter().map(|&v| position(v, &even).x).sum::<f64>() / 3.0;
        assert_eq!(side, u32::from(middle > 5.0));
    }
    assert!(even.corner().get("gone").is_none());
}

#[test]
fn non_manifold_meshes_are_refused_and_empty_ones_stay() {
    fn run(mesh: &Mesh, length: f64, angle: f64) -> Result<Mesh, Error> {
        remesh(mesh, length, angle, &Progress::silent())
    }
    let places = Vec::from(
        [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.], [1., 1., 1.]].map(Point3::from),
    );
    let of =
        |faces: &[[u32; 3]]| Mesh::new(places.clone(), Faces::triangles(faces.to_vec())).unwrap();
    let fan = of(&[[0, 1, 2], [1, 0, 3], [0, 1, 4]]);
    let error = run(&fan, 0.5, 40.0).unwrap_err().to_string();
    assert!(
        error.starts_with(
            "1 edges have more than two faces, the first one at (0.500, 0.000, 0.000)"
        ),
        "{error}"
    );
    assert_eq!(
        run(&of(&[[0, 1, 2], [0, 1, 3]]), 0.5, 40.0).unwrap_err().to_string(),
        "1 edges have faces with different orientations; use `Orient` to make them consistent"
    );
    let empty = of(&[]);
    assert!(run(&empty, 0.0, 40.0).unwrap().faces().is_empty());
    // The mesh is a single triangle, whose edges are much shorter or much longer than the target length.
    let one = of(&[[0, 1, 2]]);
    assert_eq!(run(&one, 9.0, 40.0).unwrap().faces().len(), 1);
    let many = run(&one, 0.1, 40.0).unwrap();
    check(&one, &many);
    assert!((area(&many) - 0.5).abs() < 1e-9 && many.faces().len() > 80);
    // All faces have zero area.
    let line = Mesh::new(vec![Point3::origin(); 3], Faces::triangles(vec![[0, 1, 2]])).unwrap();
    assert_eq!(run(&line, 1.0, 40.0).unwrap(), line);
    for length in [-1.0, f64::NAN, f64::INFINITY] {
        let error = run(&one, length, 40.0).unwrap_err().to_string();
        assert_eq!(error, format!("`length` is {length} mm, but must be a number from 0 on"));
    }
    let error = run(&one, 1.0, 181.0).unwrap_err().to_string();
    assert_eq!(error, "`angle` is 181, but must be from 0 to 180 degrees");
    // A needle-shaped triangle with hardly any area would be split into very many triangles, because it is long.
    let needle = [[0.0, 0.0, 0.0], [1e9, 0.0, 0.0], [0.0, 1e-9, 0.0]].map(Point3::from);
    let needle = Mesh::new(Vec::from(needle), Faces::triangles(vec![[0, 1, 2]])).unwrap();
    assert!(run(&needle, 1.0, 40.0).unwrap_err().downcast::<LimitError>().is_some());
    let error = run(&cube(), 1e-4, 40.0).unwrap_err().to_string();
    assert!(error.contains("140 000 000 000 triangles") && error.contains("`length`"), "{error}");
}

#[test]
fn a_vertex_that_joins_two_fans_becomes_two() {
    fn point(x: f64, y: f64) -> Point3<f64> {
        Point3::new(x, y, 0.0)
    }
    let places =
        vec![point(0., 0.), point(5., -3.), point(5., 3.), point(-5., 3.), point(-5., -3.)];
    let bow = Mesh::new(places, Faces::triangles(vec![[0, 1, 2], [0, 3, 4]])).unwrap();
    let even = remesh(&bow, 1.0, 40.0, &Progress::silent()).unwrap();
    assert!((area(&even) - 30.0).abs() < 1e-9);
    assert_eq!(even.positions().iter().filter(|p| p.coords.norm() < 1e-12).count(), 2);
    assert!(even.edges().faces.iter().all(|&faces| faces <= 2));
}

#[test]
fn the_bytes_are_the_same_for_any_number_of_threads() {
    let wave = sheet(30, |x, y| libm::sin(x) * libm::cos(0.7 * y));
    fn run(threads: usize, wave: &Mesh) -> Mesh {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| even(wave, 0.25))
    }
    let one = run(1, &wave);
    assert!([2, 3, 8].iter().all(|&threads| run(threads, &wave) == one));
}

#[test]
fn noise_makes_no_fold_and_no_crease_of_short_bits() {
    let mut random = maquette_value::rng::Random(5);
    let ball = even(&ball(40), 0.7);
    let noisy = ball.positions().iter().map(|p| p * (1.0 + 0.01 * (random.even() - 0.5)));
    let noisy = ball.with_positions(noisy.collect()).unwrap();
    for length in [0.5, 1.5, 6.0] {
        even(&noisy, length);
    }
}

#[test]
fn faces_without_area_do_not_cut_sharp_edges() {
    let cube = cut(&fine_cube(4));
    for height in HEIGHTS {
        for seed in 0..4 {
            let given = insert_flat_faces(&cube, 25, height, seed);
            assert!(given.faces().len() > cube.faces().len());
            let even = remesh(&given, 1.5, 40.0, &Progress::silent()).unwrap();
            assert!(
                (area(&even) - 600.0).abs() < 1e-6 + 100.0 * height,
                "{height}: {}",
                area(&even)
            );
            assert!((volume(&even) - 1000.0).abs() < 1e-6 + 100.0 * height, "{height}");
        }
    }
}

/// Returns an open cup around the z axis, with walls between two radii, as a closed surface.
fn cup(outer: f64, wall: f64, height: f64, n: u32) -> Mesh {
    // The profile from the middle of the bottom, outside and up, over the rim, down to the middle of the floor.
    let inner = outer - wall;
    let rows = n / 3;
    let mut profile = Vec::new();
    profile.extend((1..=8).map(|k| (outer * f64::from(k) / 8.0, 0.0)));
    profile.extend((1..=rows).map(|k| (outer, height * f64::from(k) / f64::from(rows))));
    profile.extend(
        (0..rows).map(|k| (inner, height + (wall - height) * f64::from(k) / f64::from(rows))),
    );
    profile.extend((0..8).map(|k| (inner * f64::from(8 - k) / 8.0, wall)));
    let mut places = vec![Point3::origin(), Point3::new(0.0, 0.0, wall)];
    for &(radius, z) in &profile {
        places.extend((0..n).map(|k| {
            let angle = f64::from(k) / f64::from(n) * std::f64::consts::TAU;
            Point3::new(radius * libm::cos(angle), radius * libm::sin(angle), z)
        }));
    }
    fn name(row: u32, k: u32, n: u32) -> u32 {
        2 + row * n + k % n
    }
    let last = profile.len() as u32 - 1;
    let mut faces = Vec::new();
    for k in 0..n {
        faces.push([0, name(0, k + 1, n), name(0, k, n)]);
        faces.push([1, name(last, k, n), name(last, k + 1, n)]);
        for row in 0..last {
            let [a, b, c, d] = [
                name(row, k, n),
                name(row, k + 1, n),
                name(row + 1, k + 1, n),
                name(row + 1, k, n),
            ];
            faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    Mesh::new(places, Faces::triangles(faces)).unwrap()
}

/// Returns two bent sheets with a gap between them.
fn sheets(gap: f64, bend: f64, turned: bool) -> Mesh {
    let one = cut(&sheet(30, |x, y| bend * libm::sin(0.5 * x) * libm::cos(0.4 * y)));
    let count = one.positions().len() as u32;
    let mut places = one.positions().to_vec();
    places.extend(one.positions().iter().map(|p| p + nalgebra::Vector3::new(0.0, 0.0, gap)));
    let mut faces = one.faces().as_triangles().unwrap().to_vec();
    for k in 0..faces.len() {
        let [a, b, c] = faces[k].map(|vertex| vertex + count);
        faces.push(if turned { [a, c, b] } else { [a, b, c] });
    }
    Mesh::new(places, Faces::triangles(faces)).unwrap()
}

/// Checks that no faces of a remeshed thin shape cross, and that its feature curves are where they were.
fn check_walls(mesh: &Mesh, length: f64, angle: f64, what: &str) {
    let even = remesh(mesh, length, angle, &Progress::silent()).unwrap();
    assert_eq!(kind(mesh), kind(&even), "{what}");
    let crossing = even.crossings(|| Ok::<(), Error>(())).unwrap().len();
    assert_eq!(crossing, 0, "{what}");
    fn borders(mesh: &Mesh) -> f64 {
        let edges = mesh.edges();
        let borders = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1);
        fn place(vertex: u32, mesh: &Mesh) -> Point3<f64> {
            mesh.positions()[vertex as usize]
        }
        borders.map(|(&[a, b], _)| (place(b, mesh) - place(a, mesh)).norm()).sum()
    }
    let [before, after] = [borders(mesh), borders(&even)];
    assert!((after - before).abs() <= 0.05 * before, "{what}: {before} {after}");
    let [before, after] = [volume(mesh), volume(&even)];
    assert!((after - before).abs() <= 0.1 * area(mesh), "{what}: {before} {after}");
}

#[test]
fn thin_walls_stay_apart() {
    let mut random = maquette_value::rng::Random(7);
    for index in 0..8 {
        fn between(low: f64, high: f64, random: &mut maquette_value::rng::Random) -> f64 {
            low + (high - low) * random.even()
        }
        let (gap, length) = (between(0.2, 2.0, &mut random), between(1.0, 4.0, &mut random));
        let what = format!("{index}: gap {gap}, length {length}");
        if index % 2 == 0 {
            check_walls(
                &cup(between(6.0, 12.0, &mut random), gap, between(8.0, 20.0, &mut random), 48),
                length,
                40.0,
                &what,
            );
        } else {
            check_walls(
                &sheets(gap, between(0.0, 1.5, &mut random), index % 4 == 1),
                length,
                40.0,
                &what,
            );
        }
    }
}

#[test]
fn edges_much_longer_than_walls_are_thick_are_shortened() {
    let cup = cup(12.0, 0.5, 30.0, 64);
    check_walls(&cup, 10.0, 40.0, "a cup with walls of 0.5 mm");
    let (even, length) = remesh_apart(&cup, 10.0, 40.0, &Progress::silent()).unwrap();
    assert_eq!(length, 5.0);
    assert!(even.faces().len() < 1000, "{}", even.faces().len());
    let (_, length) = remesh_apart(&cup, 2.0, 40.0, &Progress::silent()).unwrap();
    assert_eq!(length, 2.0);
}
