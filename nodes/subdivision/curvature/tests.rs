use maquette_node::Progress;
use nalgebra::{Point3, Vector3};

use super::super::crease;
use super::super::flat_faces::{HEIGHTS, insert_flat_faces};
use super::super::shapes::{add_noise, cube, sphere, torus};
use super::super::{InterpolateOptions, interpolate};
use super::*;

#[test]
fn the_angle_defects_of_a_closed_mesh_add_up_to_its_euler_characteristic() {
    for (mesh, characteristic) in
        [(add_noise(&sphere(3), 0.02), 2.0), (add_noise(&torus(30, 15, true), 0.02), 0.0)]
    {
        let sum: f64 = angle_bending(&mesh).iter().map(|bend| bend.gaussian * bend.area).sum();
        assert!((sum - std::f64::consts::TAU * characteristic).abs() <= 1e-10, "{sum}");
    }
}

/// The exact Gaussian and mean curvature of a torus with the radii 2 and 0.7 at a point.
fn exact_curvatures(point: &Point3<f64>) -> [f64; 2] {
    let radius = (point.x * point.x + point.y * point.y).sqrt();
    let cosine = (radius - 2.0) / 0.7;
    let around = cosine / (2.0 + 0.7 * cosine);
    [around / 0.7, (around + 1.0 / 0.7) / 2.0]
}

/// The largest error of the Gaussian curvature and of the mean curvature at any vertex, compared with the exact torus.
fn errors(data: &Mesh, bent: &BentMesh) -> [f64; 2] {
    let pairs = data.positions().iter().zip(&bent.bending);
    pairs.fold([0.0, 0.0], |[k, h], (point, bending)| {
        let (bending, [gaussian, mean]) = (bending.unwrap(), exact_curvatures(point));
        [f64::max(k, (bending.gaussian - gaussian).abs()), f64::max(h, (bending.mean - mean).abs())]
    })
}

fn interpolate_bent_mesh(data: &Mesh, scheme: Scheme) -> BentMesh {
    let mut options = InterpolateOptions::default();
    options.how.tolerance = 1e-12;
    let control = interpolate(data, scheme, &options, &[], &Progress::silent()).unwrap().shape;
    curvature(&control, CurvatureMethod::Limit, scheme, Boundary::default(), &Progress::silent())
        .unwrap()
}

#[test]
fn errors_on_a_torus_are_at_most_the_reference_errors() {
    const UNKNOWN: [f64; 2] = [f64::NAN; 2];
    let reference = [
        (24, [0.02897, 0.03337], [0.02790, 0.00567], [0.03280, 0.01816], [0.04931, 0.02725]),
        (48, [0.00695, 0.00804], [0.00718, 0.00155], [0.00793, 0.00439], [0.01190, 0.00659]),
        (96, [0.00172, 0.00199], [0.00181, 0.00039], [0.00197, 0.00109], [0.00295, 0.00163]),
        (192, [0.00043, 0.00050], [0.00045, 0.00010], UNKNOWN, UNKNOWN),
    ];
    let mut before: Option<[[f64; 2]; 4]> = None;
    for (n, by_loop, by_angles, by_catmull_clark, by_doo_sabin) in reference {
        let (triangles, quads) = (torus(n, n / 2, true), torus(n, n / 2, false));
        let angles = curvature(
            &triangles,
            CurvatureMethod::Mesh,
            Scheme::Loop,
            Boundary::default(),
            &Progress::silent(),
        );
        let found = [
            errors(&triangles, &interpolate_bent_mesh(&triangles, Scheme::Loop)),
            errors(&triangles, &angles.unwrap()),
            errors(&quads, &interpolate_bent_mesh(&quads, Scheme::CatmullClark)),
            errors(&quads, &interpolate_bent_mesh(&quads, Scheme::DooSabin)),
        ];
        let expected = [by_loop, by_angles, by_catmull_clark, by_doo_sabin];
        let pairs = found.iter().flatten().zip(expected.iter().flatten());
        for (found, expected) in pairs.filter(|(_, expected)| !expected.is_nan()) {
            assert!((found - expected).abs() <= 6e-6, "{n}: {found} {expected}");
        }
        if let Some(before) = before {
            let rates = before.iter().flatten().zip(found.iter().flatten());
            assert!(rates.map(|(a, b)| libm::log2(a / b)).all(|order| order >= 1.85));
        }
        before = Some(found);
    }
}

#[test]
fn a_plane_is_flat_and_a_cylinder_bends_around_its_axis() {
    // A tube of triangles with edges parallel to its axis, a direction in which the tube is straight.
    let (n, m) = (24u32, 9u32);
    fn name(i: u32, j: u32, n: u32) -> u32 {
        i % n + j * n
    }
    let cells = (0..n * (m - 1)).map(|k| (k % n, k / n));
    let faces = cells.flat_map(|(i, j)| {
        let [a, b, c, d] =
            [name(i, j, n), name(i + 1, j, n), name(i + 1, j + 1, n), name(i, j + 1, n)];
        [[a, b, c], [a, c, d]]
    });
    let faces = maquette_value::Faces::triangles(faces.collect());
    let tube = Mesh::new(
        (0..n * m)
            .map(|k: u32| {
                let angle = f64::from(k % n) / f64::from(n) * std::f64::consts::TAU;
                Point3::new(2.0 * libm::cos(angle), 2.0 * libm::sin(angle), 0.5 * f64::from(k / n))
            })
            .collect::<Vec<_>>(),
        faces,
    )
    .unwrap();
    let bent = curvature(
        &tube,
        CurvatureMethod::Limit,
        Scheme::Loop,
        Boundary::default(),
        &Progress::silent(),
    )
    .unwrap();
    let middle = (n * 4) as usize;
    let bending = bent.bending[middle].unwrap();
    let position = bent.mesh.positions()[middle];
    // The control points are on a circle, the limit points on a slightly smaller one.
    let radius = (position.x * position.x + position.y * position.y).sqrt();
    assert!((bending.principal[0] * radius - 1.0).abs() < 0.01, "{bending:?} {radius}");
    assert!(bending.principal[1].abs() < 1e-10);
    assert!((bending.directions[1].z.abs() - 1.0).abs() < 1e-10, "along the axis");
    assert!(!bent.extraordinary[middle] && bent.extraordinary[0], "the border is extraordinary");

    let flat =
        tube.with_positions(tube.positions().iter().map(|p| Point3::new(p.x, p.y, 0.0)).collect());
    let flat = curvature(
        &flat.unwrap(),
        CurvatureMethod::Fit,
        Scheme::Loop,
        Boundary::default(),
        &Progress::silent(),
    );
    let known = flat.unwrap().bending.into_iter().flatten();
    assert!(known.map(|bend| bend.mean.abs()).fold(0.0, f64::max) < 1e-9);

    for method in [CurvatureMethod::Limit, CurvatureMethod::Mesh, CurvatureMethod::Fit] {
        let round =
            curvature(&sphere(3), method, Scheme::Loop, Boundary::default(), &Progress::silent())
                .unwrap();
        for bending in round.bending {
            let [k1, k2] = bending.unwrap().principal;
            assert!(k1 >= k2 && k2 > 0.4 && k1 < 1.8, "{method:?} {k1} {k2}");
        }
    }
}

#[test]
fn curvature_scales_and_keeps_its_sign_when_mirrored() {
    let mesh = add_noise(&torus(24, 12, true), 0.03);
    for method in [CurvatureMethod::Limit, CurvatureMethod::Mesh, CurvatureMethod::Fit] {
        fn bend(mesh: &Mesh, method: &CurvatureMethod) -> Vec<Option<Bending>> {
            curvature(mesh, *method, Scheme::Loop, Boundary::default(), &Progress::silent())
                .unwrap()
                .bending
        }
        let positions = |map: fn(&Point3<f64>) -> Point3<f64>| mesh.positions().iter().map(map);
        let large = mesh.with_positions(positions(|p| p * 3.0).collect()).unwrap();
        let turned = mesh.faces().as_triangles().unwrap().iter().map(|&[a, b, c]| [a, c, b]);
        let turned = maquette_value::Faces::triangles(turned.collect());
        let mirrored =
            Mesh::new(positions(|p| Point3::new(-p.x, p.y, p.z)).collect::<Vec<_>>(), turned);
        let own = bend(&mesh, &method);
        for (own, large) in own.iter().zip(bend(&large, &method)) {
            let (own, large) = (own.unwrap(), large.unwrap());
            assert!(
                (own.gaussian - 9.0 * large.gaussian).abs() < 1e-9 * (1.0 + own.gaussian.abs())
            );
            assert!((own.mean - 3.0 * large.mean).abs() < 1e-9 * (1.0 + own.mean.abs()));
        }
        for (own, mirrored) in own.iter().zip(bend(&mirrored.unwrap(), &method)) {
            let (own, mirrored) = (own.unwrap(), mirrored.unwrap());
            assert!((own.gaussian - mirrored.gaussian).abs() < 1e-8 * (1.0 + own.gaussian.abs()));
            assert!((own.mean - mirrored.mean).abs() < 1e-8 * (1.0 + own.mean.abs()));
        }
    }
}

#[test]
fn polygons_have_the_curvature_of_their_triangles_and_colors_show_the_sign() {
    let bent = curvature(
        &cube(),
        CurvatureMethod::Mesh,
        Scheme::Loop,
        Boundary::default(),
        &Progress::silent(),
    )
    .unwrap();
    assert!(bent.bending.iter().all(|bending| bending.unwrap().gaussian > 0.0));
    let saddle = torus(24, 12, true);
    let bent = curvature(
        &saddle,
        CurvatureMethod::Fit,
        Scheme::Loop,
        Boundary::default(),
        &Progress::silent(),
    )
    .unwrap();
    let mesh = bent.into_mesh(CurvatureRamp::Gaussian, 0.0).unwrap();
    let colors = mesh.vertex().colors("color").unwrap();
    for (point, &[red, _, blue]) in mesh.positions().iter().zip(colors.iter()) {
        let outside = Vector3::new(point.x, point.y, 0.0).norm() > 2.2;
        let inside = Vector3::new(point.x, point.y, 0.0).norm() < 1.8;
        assert!(!outside || red > blue, "{point}");
        assert!(!inside || blue > red, "{point}");
    }
}

/// Flips the edge between faces `2 k` and `2 k + 1` for each `k` in `pairs`, which makes four vertices extraordinary.
fn flip_edges(mesh: &Mesh, pairs: &[usize]) -> Mesh {
    let mut faces = mesh.faces().as_triangles().unwrap().to_vec();
    for &pair in pairs {
        let [mut face, other] = [faces[2 * pair], faces[2 * pair + 1]];
        while other.contains(&face[0]) {
            face.rotate_left(1);
        }
        let [a, b, c] = face;
        let d = *other.iter().find(|vertex| !face.contains(vertex)).unwrap();
        [faces[2 * pair], faces[2 * pair + 1]] = [[a, b, d], [a, d, c]];
    }
    Mesh::new(mesh.positions().to_vec(), maquette_value::Faces::triangles(faces)).unwrap()
}

#[test]
fn extraordinary_vertices_do_not_affect_each_other() {
    let round = torus(48, 24, true);
    fn bend(pairs: &[usize], round: &Mesh) -> BentMesh {
        let mesh = flip_edges(round, pairs);
        curvature(
            &mesh,
            CurvatureMethod::Limit,
            Scheme::Loop,
            Boundary::default(),
            &Progress::silent(),
        )
        .unwrap()
    }
    let alone = bend(&[0], &round);
    let own: Vec<usize> =
        (0..alone.extraordinary.len()).filter(|&v| alone.extraordinary[v]).collect();
    assert_eq!(own.len(), 4);
    for row in 0..10 {
        for column in 0..10 {
            let other = row * 48 + column;
            if row.max(column) < 4 {
                continue;
            }
            let both = bend(&[0, other], &round);
            assert_eq!(both.extraordinary.iter().filter(|&&is| is).count(), 8);
            for &vertex in &own {
                let [one, two] = [&alone, &both].map(|bent| bent.bending[vertex].unwrap().mean);
                assert!((one - two).abs() < 1e-12 * one.abs(), "{row} {column}: {one} {two}");
            }
        }
    }
}

fn bend(mesh: &Mesh, method: CurvatureMethod) -> Vec<Option<Bending>> {
    let boundary = Boundary::default();
    curvature(mesh, method, Scheme::Loop, boundary, &Progress::silent()).unwrap().bending
}

#[test]
fn faces_without_area_change_no_curvature() {
    for mesh in [sphere(3), torus(24, 12, true)] {
        for height in HEIGHTS {
            let given = insert_flat_faces(&mesh, 20, height, 1);
            assert!(given.positions().len() > mesh.positions().len() + 5);
            for method in [CurvatureMethod::Mesh, CurvatureMethod::Fit] {
                let (without, with) = (bend(&mesh, method), bend(&given, method));
                for (vertex, bending) in with.iter().enumerate() {
                    let Some(bending) = bending else { panic!("{vertex} is unknown") };
                    // New vertices have values between those of the old ones.
                    assert!(bending.mean.abs() < 3.0, "{vertex}: {bending:?}");
                    if let Some(other) = without.get(vertex).map(|other| other.unwrap()) {
                        let off = [bending.mean - other.mean, bending.gaussian - other.gaussian];
                        let bound = 1e-6 + 1e4 * height;
                        assert!(
                            off.iter().all(|x| x.abs() <= bound),
                            "{method:?} {height} {vertex}: {off:?}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn faces_without_area_keep_the_angle_defects() {
    let given = insert_flat_faces(&add_noise(&sphere(3), 0.02), 20, 0.0, 4);
    let sum: f64 = angle_bending(&given).iter().map(|bend| bend.gaussian * bend.area).sum();
    assert!((sum - 2.0 * std::f64::consts::TAU).abs() <= 1e-9, "{sum}");
}

#[test]
fn faces_without_area_interrupt_no_crease() {
    fn length(mesh: &Mesh) -> f64 {
        fn place(vertex: u32, mesh: &Mesh) -> Point3<f64> {
            mesh.positions()[vertex as usize]
        }
        crease(mesh, 40.0, 10.0)
            .creases()
            .map(|([a, b], _)| (place(b, mesh) - place(a, mesh)).norm())
            .sum()
    }
    let corners = cube();
    let mut fine = Mesh::new(
        corners.positions().to_vec(),
        maquette_value::Faces::triangles(corners.triangles().into_owned()),
    )
    .unwrap();
    for _ in 0..2 {
        fine = split_triangles(&fine);
    }
    for height in HEIGHTS {
        for seed in 0..5 {
            let given = insert_flat_faces(&fine, 20, height, seed);
            let off = length(&given) - length(&fine);
            assert!(off.abs() < 1e-9 + 10.0 * height, "{height}: {off}");
        }
    }
}

/// Splits each triangle into four equal ones.
fn split_triangles(mesh: &Mesh) -> Mesh {
    let (mut positions, edges) = (mesh.positions().to_vec(), mesh.edges());
    let count = positions.len() as u32;
    positions.extend(edges.vertices.iter().map(|ends| {
        let [a, b] = ends.map(|end| mesh.positions()[end as usize]);
        nalgebra::center(&a, &b)
    }));
    let faces = mesh.faces().iter().enumerate().flat_map(|(face, corners)| {
        let [ab, bc, ca] = [0, 1, 2].map(|k| count + edges.of_corner[3 * face + k]);
        let [a, b, c] = [corners[0], corners[1], corners[2]];
        [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
    });
    Mesh::new(positions, maquette_value::Faces::triangles(faces.collect())).unwrap()
}

/// Returns the part of a sphere of radius 1 above a height.
fn cap(steps: u32, height: f64) -> Mesh {
    let whole = sphere(steps);
    let positions: Vec<_> =
        whole.positions().iter().map(|p| Point3::from(p.coords.normalize())).collect();
    let faces = whole.faces().as_triangles().unwrap().iter();
    let faces =
        faces.filter(|face| face.iter().all(|&vertex| positions[vertex as usize].z > height));
    let faces = Vec::from_iter(faces.copied());
    Mesh::new(positions, maquette_value::Faces::triangles(faces)).unwrap()
}

/// Returns part of a cylinder of radius 1 with rows of `n` triangles in turned or plain pairs.
fn half_cylinder(n: u32, rows: u32, length: f64) -> Mesh {
    let positions = (0..(n + 1) * rows).map(|k| {
        let [angle, z] = [
            f64::from(k % (n + 1)) / f64::from(n) * 3.0,
            f64::from(k / (n + 1)) / f64::from(rows - 1),
        ];
        Point3::new(libm::cos(angle), libm::sin(angle), length * z)
    });
    let cells = (0..n * (rows - 1)).map(|k| k / n * (n + 1) + k % n);
    let faces = cells.flat_map(|a| {
        let [b, c, d] = [a + 1, a + n + 2, a + n + 1];
        if a % 2 == 0 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] }
    });
    Mesh::new(positions.collect::<Vec<_>>(), maquette_value::Faces::triangles(faces.collect()))
        .unwrap()
}

#[test]
fn the_curvature_at_borders_is_right_or_unknown() {
    fn check(mesh: &Mesh, [k1, k2]: [f64; 2], what: &str) {
        let used = std::collections::BTreeSet::from_iter(mesh.faces().corners().iter().copied());
        let bending = bend(mesh, CurvatureMethod::Mesh);
        let mut known = 0;
        for vertex in used {
            let Some(found) = bending[vertex as usize] else { continue };
            known += 1;
            let off =
                [found.principal[0] - k1, found.principal[1] - k2, found.mean - (k1 + k2) / 2.0];
            assert!(off.iter().all(|x| x.abs() <= 0.15), "{what} {vertex}: {found:?}");
        }
        assert!(known > 0, "{what}");
    }
    for steps in 3..5 {
        for height in [-0.8, -0.3, 0.0, 0.4, 0.8] {
            check(&cap(steps, height), [1.0, 1.0], &format!("cap {steps} {height}"));
        }
    }
    for (n, rows, length) in
        [(12, 5, 1.0), (24, 12, 1.0), (24, 3, 0.2), (60, 40, 2.0), (60, 4, 3.0)]
    {
        check(
            &half_cylinder(n, rows, length),
            [1.0, 0.0],
            &format!("cylinder {n} {rows} {length}"),
        );
    }
}

type Patch = fn(f64, f64) -> Vector3<f64>;

/// Returns a patch of a surface over the unit square, as a mesh of `n` by `n` uneven cells, and the parameters of its vertices.
fn uneven_patch(patch: Patch, n: u32, seed: u64) -> (Mesh, Vec<[f64; 2]>) {
    let mut random = maquette_value::rng::Random(seed);
    let parameters: Vec<[f64; 2]> = (0..(n + 1) * (n + 1))
        .map(|k| {
            [k % (n + 1), k / (n + 1)].map(|step| {
                let is_inside = 0 < step && step < n;
                let shift = if is_inside { 0.5 * random.even() - 0.25 } else { 0.0 };
                (f64::from(step) + shift) / f64::from(n)
            })
        })
        .collect();
    let positions = parameters.iter().map(|&[a, b]| Point3::from(patch(a, b)));
    let faces = (0..n * n).map(|k| k / n * (n + 1) + k % n).flat_map(|a| {
        let [b, c, d] = [a + 1, a + n + 2, a + n + 1];
        if random.even() < 0.5 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] }
    });
    let faces = maquette_value::Faces::triangles(faces.collect());
    (Mesh::new(positions.collect::<Vec<_>>(), faces).unwrap(), parameters)
}

/// Returns the curvature of a patch, whose derivatives are computed by finite differences.
fn patch_curvature(patch: Patch, [a, b]: [f64; 2]) -> Bending {
    let step = 1e-4;
    // The points of a grid of 3 by 3 around the point.
    let [below, middle, above] =
        [-step, 0.0, step].map(|right| [-step, 0.0, step].map(|up| patch(a + right, b + up)));
    let [u, v] = [above[1] - below[1], middle[2] - middle[0]];
    let uu = above[1] - middle[1] * 2.0 + below[1];
    let vv = middle[2] - middle[1] * 2.0 + middle[0];
    let uv = (above[2] - above[0] - below[2] + below[0]) / 4.0;
    let seconds = [uu, uv, vv].map(|second| second / (step * step));
    Bending::of_derivatives([u, v].map(|first| first / (2.0 * step)), seconds).unwrap()
}

#[test]
fn the_curvature_at_borders_of_uneven_patches_is_right_or_unknown() {
    fn height(a: f64, b: f64, z: impl Fn(f64, f64) -> f64) -> Vector3<f64> {
        let [x, y] = [20.0 * a - 10.0, 20.0 * b - 10.0];
        Vector3::new(x, y, z(x, y))
    }
    let patches: [(&str, Patch); 6] = [
        ("saddle", |a, b| height(a, b, |x, y| (x * x - y * y) / 30.0)),
        ("bowl", |a, b| height(a, b, |x, y| (x * x + y * y) / 25.0)),
        ("trough", |a, b| height(a, b, |x, _| x * x / 20.0)),
        ("wave", |a, b| height(a, b, |x, _| libm::sin(x / 3.0))),
        ("ball", |a, b| {
            let [turn, tilt] = [4.0 * a, 1.3 * b - 0.4];
            let radius = 12.0 * libm::cos(tilt);
            Vector3::new(radius * libm::cos(turn), radius * libm::sin(turn), 12.0 * libm::sin(tilt))
        }),
        ("torus", |a, b| {
            let [turn, tilt] = [1.2 * a, 2.0 + 2.4 * b];
            let radius = 20.0 + 6.0 * libm::cos(tilt);
            Vector3::new(radius * libm::cos(turn), radius * libm::sin(turn), 6.0 * libm::sin(tilt))
        }),
    ];
    for (name, patch) in patches {
        let (mesh, parameters) = uneven_patch(patch, 30, 7);
        let found = bend(&mesh, CurvatureMethod::Mesh);
        let (mut known, mut all) = (0, 0);
        for (at, found) in parameters.iter().zip(found) {
            if at.iter().all(|&x| 0.0 < x && x < 1.0) {
                continue;
            }
            all += 1;
            let Some(found) = found else { continue };
            known += 1;
            let truth = patch_curvature(patch, *at).principal;
            let largest = truth[0].abs().max(truth[1].abs()).max(0.05);
            let off = [0, 1].map(|k| (found.principal[k] - truth[k]).abs() / largest);
            assert!(off.iter().all(|&x| x < 0.15), "{name} {at:?}: {found:?}, not {truth:?}");
        }
        assert!(3 * known >= 2 * all, "{name}: {known} of {all}");
    }
}
