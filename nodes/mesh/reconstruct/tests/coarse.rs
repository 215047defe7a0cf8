use super::*;

/// Returns random points on the faces of the doll, evenly distributed.
fn doll(count: usize) -> Vec<Point3<f64>> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../graphs/doll/coarse.obj");
    let text = std::fs::read_to_string(path).unwrap();
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let at: Vec<f64> = words.map(|x| x.parse().unwrap()).collect();
                vertices.push(Point3::new(at[0], at[1], at[2]));
            }
            Some("f") => {
                let face: Vec<usize> = words
                    .map(|x| x.split('/').next().unwrap().parse::<usize>().unwrap() - 1)
                    .collect();
                triangles.extend((1..face.len() - 1).map(|k| [face[0], face[k], face[k + 1]]));
            }
            _ => {}
        }
    }
    let triangles: Vec<_> = triangles.iter().map(|t| t.map(|v| vertices[v])).collect();
    let areas: Vec<f64> =
        triangles.iter().map(|[a, b, c]| (b - a).cross(&(c - a)).norm()).collect();
    let mut random = Random(3);
    let all: f64 = areas.iter().sum();
    let mut points = Vec::new();
    let (mut done, mut k) = (0.0, 0);
    for place in 0..count {
        let goal = (place as f64 + random.even()) / count as f64 * all;
        while k + 1 < areas.len() && done + areas[k] < goal {
            done += areas[k];
            k += 1;
        }
        let [a, b, c] = triangles[k];
        let (mut u, mut v) = (random.even(), random.even());
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        points.push(a + (b - a) * u + (c - a) * v);
    }
    points
}

/// The mean and the root mean square of the signed distances of points from a surface.
struct Offsets {
    mean: f64,
    rms: f64,
}

fn offsets(mesh: &Mesh, points: &[Point3<f64>]) -> Offsets {
    let nearest = maquette_value::TriangleTree::new(mesh).nearest_to_all(points);
    let offsets: Vec<f64> = points
        .iter()
        .zip(nearest.iter().flatten())
        .map(|(point, near)| {
            let normal = mesh.area_vector(mesh.faces().face(near.face as usize));
            near.distance_sq.sqrt() * (point - near.position(mesh)).dot(&normal).signum()
        })
        .collect();
    let count = offsets.len() as f64;
    let squares: f64 = offsets.iter().map(|x| x * x).sum();
    Offsets { mean: offsets.iter().sum::<f64>() / count, rms: (squares / count).sqrt() }
}

/// Checks that a surface with edges of several times the points' spacing is in the middle of the points, and that no faces cross.
fn check_coarse(points: &[Point3<f64>], all_times: &[f64]) {
    let distance = check(points, SkinKind::Closed).unwrap();
    for times in all_times {
        let spacing = times * distance;
        let mesh = skin(points.to_vec(), &Options { spacing, ..Options::default() });
        let Offsets { mean, rms } = offsets(&mesh, points);
        assert!(rms < 0.1 * spacing, "{times}: {}", rms / spacing);
        assert!(mean.abs() < 0.01 * spacing, "{times}: {}", mean / spacing);
        assert_eq!(mesh.crossings(|| Ok::<(), ()>(())), Ok(Vec::new()));
    }
}

#[test]
fn a_coarse_surface_is_in_the_middle_of_the_points() {
    check_coarse(&sphere(5000, 0.0), &[2.0, 4.0, 10.0]);
    check_coarse(&torus(5000, 0.0), &[2.0, 4.0, 8.0]);
}

#[test]
fn a_coarse_doll_keeps_its_ears() {
    check_coarse(&doll(20_000), &[4.0, 10.0]);
}

#[test]
fn a_coarse_surface_of_a_ball_has_no_terraces() {
    let points = sphere(5000, 0.0);
    let mesh = skin(points, &Options { spacing: 10.0, ..Options::default() });
    let radii: Vec<f64> = mesh.positions().iter().map(|at| at.coords.norm()).collect();
    let mean = radii.iter().sum::<f64>() / radii.len() as f64;
    let squares: f64 = radii.iter().map(|radius| (radius - mean) * (radius - mean)).sum();
    let deviation = (squares / radii.len() as f64).sqrt();
    assert!(deviation < 0.015 * 10.0, "{deviation}");
}

#[test]
fn turned_points_make_a_turned_surface() {
    let points = torus(5000, 0.0);
    let rotation = nalgebra::Rotation3::from_euler_angles(0.3, 0.5, 0.7);
    let options = Options { spacing: 7.0, ..Options::default() };
    let turned = skin(points.iter().map(|at| rotation * at).collect(), &options);
    let vertices: Vec<_> =
        skin(points, &options).positions().iter().map(|at| rotation * at).collect();
    let Offsets { mean, rms } = offsets(&turned, &vertices);
    assert!(rms < 0.1 * 7.0 && mean.abs() < 0.05 * 7.0, "{mean} {rms}");
}
