use maquette_value::{Attribute, Faces};
use nalgebra::{Point3, Vector3};

use super::*;

/// Creates a square sheet of `n` by `n` cells over the unit square; `height` gives the height of each vertex.
fn sheet(n: u32, height: impl Fn(f64, f64) -> f64) -> Mesh {
    let cells = (0..n * n).map(|k| k / n * (n + 1) + k % n);
    let faces = cells.flat_map(|a| [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]);
    let positions: Vec<_> = (0..(n + 1) * (n + 1))
        .map(|k: u32| {
            let [x, y] = [k % (n + 1), k / (n + 1)].map(|k| f64::from(k) / f64::from(n));
            Point3::new(x, y, height(x, y))
        })
        .collect();
    Mesh::new(positions, Faces::triangles(faces.collect())).unwrap()
}

fn simple(mesh: &Mesh, target: usize) -> Mesh {
    simplify(mesh, target, &Progress::silent()).unwrap()
}

fn area(mesh: &Mesh) -> f64 {
    let twice = mesh
        .faces()
        .iter()
        .map(|face| [0, 1, 2].map(|k| mesh.positions()[face[k] as usize]))
        .map(|[a, b, c]| (b - a).cross(&(c - a)).norm());
    twice.sum::<f64>() / 2.0
}

#[test]
fn a_flat_sheet_becomes_two_triangles_and_keeps_its_corners() {
    let flat = simple(&sheet(16, |_, _| 0.0), 2);
    assert_eq!(flat.faces().len(), 2);
    assert!((area(&flat) - 1.0).abs() < 1e-12);
    let mut positions: Vec<_> =
        flat.positions().iter().map(|p| [p.x, p.y].map(|x| x as i32)).collect();
    positions.sort_unstable();
    assert_eq!(positions, [[0, 0], [0, 1], [1, 0], [1, 1]]);
}

/// A flat sheet of `n` by `n` cells in a plane that is not parallel to a coordinate axis.
fn tilted_sheet(n: u32) -> Mesh {
    let flat = sheet(n, |_, _| 0.0);
    flat.with_positions(
        flat.positions()
            .iter()
            .map(|p| {
                let (y, z) = (0.8 * p.y, 0.6 * p.y);
                Point3::new(0.6 * p.x - 0.8 * z + 3.0, y, 0.8 * p.x + 0.6 * z + 7.0)
            })
            .collect(),
    )
    .unwrap()
}

#[test]
fn work_per_vertex_does_not_grow_with_the_resolution_of_a_flat_mesh() {
    for n in [20, 80] {
        for flat in [sheet(n, |_, _| 0.0), tilted_sheet(n)] {
            let target = flat.faces().len() / 20;
            let net = Net::new(&flat);
            let heap = net.collapses().into();
            let mut collapsing = Simplifier { net, heap };
            let (mut judged, mut most) = (0, 0);
            while target < collapsing.net.n_faces {
                let next = collapsing.heap.pop().unwrap();
                let now = collapsing.collapse(&next);
                judged += now;
                most = most.max(now);
            }
            let taken =
                flat.positions().len() - collapsing.net.into_mesh(&flat).unwrap().positions().len();
            assert!(judged < 8 * taken && most < 16, "{n}: {judged} for {taken}, {most}");
        }
    }
}

#[test]
fn a_flat_mesh_is_reduced_to_even_triangles() {
    for flat in [sheet(40, |_, _| 0.0), tilted_sheet(40)] {
        let coarse = simple(&flat, 160);
        let mut evenness: Vec<_> = coarse
            .faces()
            .iter()
            .map(|face| {
                let [a, b, c] = [0, 1, 2].map(|k| coarse.positions()[face[k] as usize]);
                let sides =
                    (b - a).norm_squared() + (c - b).norm_squared() + (a - c).norm_squared();
                // The quality is 1 for a triangle with three equal sides.
                12_f64.sqrt() * (b - a).cross(&(c - a)).norm() / sides
            })
            .collect();
        evenness.sort_by(f64::total_cmp);
        assert!(0.1 < evenness[0] && 0.6 < evenness[evenness.len() / 10], "{evenness:?}");
    }
}

#[test]
fn a_wave_keeps_its_shape_with_a_tenth_of_the_faces() {
    fn height(x: f64, y: f64) -> f64 {
        0.1 * libm::sin(6.0 * x) * libm::cos(4.0 * y)
    }
    let fine = sheet(60, height);
    let coarse = simple(&fine, 720);
    assert!(coarse.faces().len() <= 720);
    let edges = coarse.edges();
    assert!(edges.misoriented == 0 && edges.faces.iter().all(|&faces| faces <= 2));
    for position in coarse.positions().iter() {
        assert!((position.z - height(position.x, position.y)).abs() < 2e-3, "{position}");
    }
    assert!((area(&coarse) / area(&fine) - 1.0).abs() < 5e-3);
    // No face is flipped.
    assert!(coarse.faces().iter().all(|face| coarse.area_vector(face).z > 0.0));
}

#[test]
fn a_closed_mesh_stays_closed_and_of_its_kind() {
    // A torus of 40 by 20 quads, cut into triangles.
    let (n, m) = (40u32, 20u32);
    fn name(i: u32, j: u32, n: u32, m: u32) -> u32 {
        i % n + j % m * n
    }
    let cells = (0..n * m).map(|k| (k % n, k / n));
    let faces = cells.flat_map(|(i, j)| {
        let [a, b, c, d] = [
            name(i, j, n, m),
            name(i + 1, j, n, m),
            name(i + 1, j + 1, n, m),
            name(i, j + 1, n, m),
        ];
        [[a, b, c], [a, c, d]]
    });
    let torus = Mesh::new(
        (0..n * m)
            .map(|k: u32| {
                let [u, v] = [f64::from(k % n) / f64::from(n), f64::from(k / n) / f64::from(m)]
                    .map(|t| t * std::f64::consts::TAU);
                let radius = 2.0 + 0.7 * libm::cos(v);
                Point3::new(radius * libm::cos(u), radius * libm::sin(u), 0.7 * libm::sin(v))
            })
            .collect::<Vec<_>>(),
        Faces::triangles(faces.collect()),
    );
    let coarse = simple(&torus.unwrap(), 200);
    let edges = coarse.edges();
    assert!(coarse.faces().len() <= 200 && edges.faces.iter().all(|&faces| faces == 2));
    let counts = [coarse.positions().len(), edges.vertices.len(), coarse.faces().len()];
    let [v, e, f] = counts.map(|count| count as i64);
    assert_eq!(v - e + f, 0);
    // A torus needs at least 14 triangles.
    assert!(simple(&coarse, 0).faces().len() >= 14);
}

#[test]
fn a_closed_part_keeps_four_faces() {
    let corners = [0, 1, 2].map(Vector3::<f64>::ith_axis).map(|axis| axis.into_inner());
    let octahedron = corners.iter().flat_map(|axis| [Point3::from(*axis), Point3::from(-axis)]);
    let faces = [0u32, 1].into_iter().flat_map(|x| [2, 3].map(|y| [4, 5].map(|z| (x, y, z))));
    let faces = faces.flatten().map(|(x, y, z)| match (x + y + z) % 2 {
        0 => [x, y, z],
        _ => [y, x, z],
    });
    let faces = Faces::triangles(faces.collect());
    let octahedron = Mesh::new(octahedron.collect::<Vec<_>>(), faces).unwrap();
    assert!(octahedron.edges().faces.iter().all(|&faces| faces == 2));
    let coarse = simple(&octahedron, 0);
    assert_eq!((coarse.positions().len(), coarse.faces().len()), (4, 4));
    assert!(coarse.edges().faces.iter().all(|&faces| faces == 2));
}

#[test]
fn creases_stay_where_they_are() {
    // A roof with its ridge along y.
    let roof = sheet(20, |x, _| 0.5 - (x - 0.5).abs());
    let ridge = (0..20u32).map(|row| ([row * 21 + 10, (row + 1) * 21 + 10], 10.0));
    let roof = roof.with_creases(ridge).unwrap();
    let coarse = simple(&roof, 4);
    assert_eq!(coarse.faces().len(), 4);
    let creases: Vec<_> = coarse.creases().collect();
    assert_eq!(creases.len(), 1);
    for end in creases[0].0 {
        let position = coarse.positions()[end as usize];
        assert!((position.x - 0.5).abs() < 1e-9 && (position.z - 0.5).abs() < 1e-9);
    }
}

#[test]
fn attributes_follow_their_vertices_and_faces() {
    let fine = sheet(10, |x, y| x * y);
    let uv = fine.positions().iter().map(|position| [position.x, position.y]);
    let side = (0..200u32).map(|face| u32::from(face >= 100));
    let fine = fine
        .clone()
        .with_vertex("uv", Attribute::Pair(uv.collect::<Vec<_>>().into()))
        .and_then(|mesh| mesh.with_face("side", Attribute::Index(side.collect::<Vec<_>>().into())))
        .unwrap();
    let coarse = simple(&fine, 40);
    let Some(Attribute::Pair(uv)) = coarse.vertex().get("uv") else { panic!("uv") };
    for (position, [u, v]) in coarse.positions().iter().zip(uv.iter()) {
        // A merged vertex is at the position that its texture coordinates had on the old surface, up to the curvature of the surface.
        assert!(
            (position.x - u).abs() < 0.08 && (position.y - v).abs() < 0.08,
            "{position} {u} {v}"
        );
    }
    let Some(Attribute::Index(side)) = coarse.face().get("side") else { panic!("side") };
    assert_eq!(side.len(), coarse.faces().len());
}

/// Creates a tube with `n` faces around it. The texture of the tube is cut along a line and has a scale of 1 mm per unit.
fn textured_tube(n: u32, along: u32) -> Mesh {
    fn name(i: u32, j: u32, n: u32) -> u32 {
        i % n + j * n
    }
    let (mut faces, mut uv) = (Vec::new(), Vec::new());
    for (i, j) in (0..n * along).map(|k| (k % n, k / n)) {
        let square = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
        for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
            let corners = [a, b, c].map(|k: usize| square[k]);
            faces.push(corners.map(|(i, j)| name(i, j, n)));
            let (width, height) = (f64::from(n), f64::from(along));
            uv.extend(corners.map(|(i, j)| [f64::from(i) / width, f64::from(j) / height]));
        }
    }
    let positions: Vec<_> = (0..n * (along + 1))
        .map(|k: u32| {
            let turn = std::f64::consts::TAU * f64::from(k % n) / f64::from(n);
            Point3::new(10.0 * libm::cos(turn), 10.0 * libm::sin(turn), f64::from(k / n))
        })
        .collect();
    let tube = Mesh::new(positions, Faces::triangles(faces)).unwrap();
    tube.with_corner("uv", Attribute::Pair(uv.into())).unwrap()
}

#[test]
fn a_texture_stays_on_both_sides_of_its_seam() {
    let tube = textured_tube(60, 40);
    let coarse = simple(&tube, 400);
    assert!(coarse.faces().len() <= 400);
    let uv = coarse.corner().pairs("uv").expect("a texture");
    let corners = coarse.faces().corners().iter();
    let mut seam = [0, 0];
    for (&vertex, &[u, v]) in corners.zip(uv.iter()) {
        let position = coarse.positions()[vertex as usize];
        assert!((v - position.z / 40.0).abs() < 2e-3, "{position} {v}");
        let turn = libm::atan2(position.y, position.x) / std::f64::consts::TAU;
        let off = u - turn - (u - turn).round();
        assert!(off.abs() < 4e-3, "{position} {u} {turn}");
        assert!((0.0..=1.0).contains(&u) && (0.0..=1.0).contains(&v));
        if turn.abs() < 1e-9 {
            seam[usize::from(u > 0.5)] += 1;
        }
    }
    assert!(seam.iter().all(|&count| count >= 2), "{seam:?}");
    // No triangle crosses the seam.
    for uv in uv.chunks(3) {
        let [least, most] =
            [f64::min, f64::max].map(|f| uv.iter().map(|uv| uv[0]).reduce(f).unwrap());
        assert!(most - least < 0.3, "{uv:?}");
    }
}

#[test]
fn a_flat_sheet_keeps_an_even_texture_exactly_and_patches_apart() {
    let fine = sheet(16, |_, _| 0.0);
    let positions =
        fine.faces().corners().iter().map(|&v| fine.positions()[v as usize]).collect::<Vec<_>>();
    // The right half of the sheet uses another part of the texture than the left half, and each half has a color of its own.
    fn half(corner: usize, positions: &[Point3<f64>]) -> bool {
        positions[corner / 3 * 3..][..3].iter().any(|position| position.x > 0.5)
    }
    let uv = (0..positions.len())
        .map(|k| [positions[k].x * 0.5 + f64::from(u8::from(half(k, &positions))), positions[k].y]);
    let color =
        (0..positions.len()).map(|k| if half(k, &positions) { [200, 0, 0] } else { [0, 100, 0] });
    let fine = fine
        .clone()
        .with_corner("uv", Attribute::Pair(uv.collect()))
        .and_then(|fine| fine.with_corner("color", Attribute::Color(color.collect())))
        .unwrap();
    let flat = simple(&fine, 4);
    assert_eq!(flat.faces().len(), 4);
    let (uv, color) = (flat.corner().pairs("uv").unwrap(), flat.corner().colors("color").unwrap());
    for (face, (uv, color)) in flat.faces().iter().zip(uv.chunks(3).zip(color.chunks(3))) {
        let positions = [0, 1, 2].map(|k| flat.positions()[face[k] as usize]);
        let is_right = positions.iter().any(|position| position.x > 0.5 + 1e-9);
        for k in 0..3 {
            let expected = positions[k].x * 0.5 + f64::from(u8::from(is_right));
            assert!(
                (uv[k][0] - expected).abs() < 1e-12 && (uv[k][1] - positions[k].y).abs() < 1e-12
            );
            assert_eq!(color[k], if is_right { [200, 0, 0] } else { [0, 100, 0] });
        }
    }
}

/// Creates a ball of 30 mm with a zigzag seam: alternating columns of faces use two different parts of the texture.
fn textured_ball() -> Mesh {
    let (n, rows) = (90u32, 60u32);
    let (mut faces, mut uv) = (Vec::new(), Vec::new());
    for (i, j) in (0..n * rows).map(|k| (k % n, k / n)) {
        let is_patch = (i + j % 2 * 2) / 10 % 2 == 0;
        let square = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
        for triangle in [[0, 1, 2], [0, 2, 3]].map(|it| it.map(|k: usize| square[k])) {
            faces.push(triangle.map(|(i, j)| i % n + j * n));
            let shift = f64::from(u8::from(is_patch));
            let position =
                |(i, j)| [f64::from(i) / f64::from(n) + shift, f64::from(j) / f64::from(rows)];
            uv.extend(triangle.map(position));
        }
    }
    let positions: Vec<_> = (0..n * (rows + 1))
        .map(|k: u32| {
            let turn = std::f64::consts::TAU * f64::from(k % n) / f64::from(n);
            let rise = 2.6 * (f64::from(k / n) / f64::from(rows) - 0.5);
            let (sin, cos) = libm::sincos(turn);
            30.0 * Point3::new(libm::cos(rise) * cos, libm::cos(rise) * sin, libm::sin(rise))
        })
        .collect();
    let ball = Mesh::new(positions, Faces::triangles(faces)).unwrap();
    ball.with_corner("uv", Attribute::Pair(uv.into())).unwrap()
}

#[test]
fn a_texture_of_jagged_patches_does_not_lift_vertices_off_the_surface() {
    let ball = textured_ball();
    let bare = Mesh::new(ball.positions().clone(), ball.faces().clone()).unwrap();
    fn farthest(mesh: &Mesh) -> f64 {
        let off = mesh.positions().iter().map(|position| (position.coords.norm() - 30.0).abs());
        off.fold(0.0, f64::max)
    }
    let [textured, bare] = [&ball, &bare].map(|mesh| farthest(&simple(mesh, 600)));
    assert!(textured < 2.5 * bare, "{textured} {bare}");
}

#[test]
fn the_distance_from_the_origin_has_no_effect() {
    // Coordinates that both positions represent exactly.
    let uneven = sheet(20, |x, y| 0.1 * libm::sin(9.0 * x) * libm::cos(7.0 * y));
    let near = uneven
        .with_positions(
            uneven.positions().iter().map(|p| p.map(|x| (x * 65536.0).round() / 65536.0)).collect(),
        )
        .unwrap();
    // 500 km away, if the sheet is 1 mm wide.
    let offset = Vector3::new(536870912.0, -268435456.0, 67108864.0);
    let far = near.with_positions(near.positions().iter().map(|p| p + offset).collect()).unwrap();
    let [near, far] = [near, far].map(|mesh| simple(&mesh, 200));
    assert_eq!(near.faces(), far.faces());
    for (p, q) in near.positions().iter().zip(far.positions().iter()) {
        assert!((q - offset - p).norm() < 1e-6, "{p} {q}");
    }
}

/// Returns the root mean square of the distance in z between a mesh and a height, at the middles of its faces and at its vertices.
fn height_error(mesh: &Mesh, height: impl Fn(f64, f64) -> f64) -> f64 {
    let points = mesh.positions();
    let middles = mesh.faces().iter().map(|face| {
        face.iter().map(|&corner| points[corner as usize].coords).sum::<Vector3<f64>>() / 3.0
    });
    let all = points.iter().map(|point| point.coords).chain(middles);
    let squares = Vec::from_iter(all.map(|p| p.z - height(p.x, p.y)).map(|off| off * off));
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn rounds_of_collapses_are_as_accurate_as_single_ones() {
    let (mut single, mut together) = (0.0, 0.0);
    for shape in 0..10_u32 {
        let (across, along) = (f64::from(3 + shape), f64::from(12 - shape));
        let height = |x: f64, y: f64| 0.05 * libm::sin(across * x) * libm::cos(along * y + x);
        let mut state: u32 = shape;
        let noise = 0.0004 * f64::from(shape % 3);
        let rough = sheet(70, height);
        let rough = rough.with_positions(
            rough
                .positions()
                .iter()
                .map(|p| {
                    state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
                    p + Vector3::z() * noise * (f64::from(state >> 8) / f64::from(1 << 23) - 1.0)
                })
                .collect(),
        );
        let rough = rough.unwrap();
        let [one, many] = [Order::OneByOne, Order::Rounds].map(|order| {
            let simple = simplify_by(order, &rough, 900, &Progress::silent()).unwrap();
            assert!((899..=900).contains(&simple.faces().len()));
            assert!(
                (area(&rough) - area(&simple)).abs() < 0.01 + 0.1 * area(&rough) * noise / 0.0004
            );
            height_error(&simple, height)
        });
        single += one;
        together += many;
    }
    assert!(together < 1.01 * single, "{together} {single}");
}

#[test]
fn rounds_keep_a_closed_textured_mesh_whole_for_any_number_of_threads() {
    let ball = textured_ball();
    fn run(threads: usize, ball: &Mesh) -> Mesh {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| simplify_by(Order::Rounds, ball, 2000, &Progress::silent()).unwrap())
    }
    let one = run(1, &ball);
    assert!((1999..=2000).contains(&one.faces().len()));
    assert!([2, 3, 8].iter().all(|&threads| run(threads, &ball) == one));
    let [before, after] = [&ball, &one].map(|mesh| {
        let edges = mesh.edges();
        let borders = edges.faces.iter().filter(|count| **count == 1).count();
        assert!(edges.faces.iter().all(|count| *count <= 2) && edges.misoriented == 0);
        (mesh.positions().len() + mesh.faces().len() - edges.vertices.len(), borders.min(1))
    });
    assert_eq!(before, after);
}
