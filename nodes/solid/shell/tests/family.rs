//! The law of shells on ten shapes: walls are as thick as requested, everywhere.

use maquette_value::rng::Random;

use super::*;
use crate::random_rays::{percentile, walls};

/// Returns a grid of `rows` x `columns` cells. `place` is called with two numbers from 0 to 1; the faces look to the side from which these
/// run counterclockwise. `is_hole` leaves out cells by the middle of the cell.
fn patch(
    [columns, rows]: [u32; 2],
    place: impl Fn(f64, f64) -> Point3<f64>,
    is_hole: impl Fn(f64, f64) -> bool,
) -> Mesh {
    let width = columns + 1;
    fn share(k: f64, count: u32) -> f64 {
        k / f64::from(count)
    }
    let positions: Vec<_> = (0..width * (rows + 1))
        .map(|k| place(share((k % width).into(), columns), share((k / width).into(), rows)))
        .collect();
    let mut faces = Vec::new();
    for (x, y) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))) {
        if is_hole(share(f64::from(x) + 0.5, columns), share(f64::from(y) + 0.5, rows)) {
            continue;
        }
        let k = x + width * y;
        faces.extend([[k, k + 1, k + width + 1], [k, k + width + 1, k + width]]);
    }
    let all: Vec<_> = (0..faces.len() as u32).collect();
    Mesh::new(positions, Faces::triangles(faces)).unwrap().select(&all)
}

/// Returns a part of a ball of 10 mm around its pole, up to an angle from the axis.
fn cap(angle: f64) -> Mesh {
    let [rings, around] = [12u32, 40];
    let mut positions = vec![Point3::new(0.0, 0.0, 10.0)];
    let mut faces = Vec::new();
    for ring in 1..=rings {
        let theta = angle * f64::from(ring) / f64::from(rings);
        for k in 0..around {
            let phi = std::f64::consts::TAU * f64::from(k) / f64::from(around);
            let (sine, cosine) = (libm::sin(theta), libm::cos(theta));
            let out = [sine * libm::cos(phi), sine * libm::sin(phi), cosine];
            positions.push(Point3::from(out.map(|x| 10.0 * x)));
            let [a, b] = [k, (k + 1) % around].map(|k| 1 + around * (ring - 1) + k);
            match ring {
                1 => faces.push([0, 1 + k, 1 + (k + 1) % around]),
                _ => faces.extend([[a - around, a, b], [a - around, b, b - around]]),
            }
        }
    }
    Mesh::new(positions, Faces::triangles(faces)).unwrap()
}

/// Returns ten surfaces. One has waves with a length in the given range, in mm.
fn shapes(rng: &mut Random, waves: [f64; 2]) -> Vec<(&'static str, Mesh)> {
    fn number(low: f64, high: f64, rng: &mut Random) -> f64 {
        low + (high - low) * rng.even()
    }
    let (sin, cos) = (libm::sin, libm::cos);
    fn whole(_: f64, _: f64) -> bool {
        false
    }
    let (phase, long) = (number(0.0, 6.0, rng), number(waves[0], waves[1], rng));
    let bumps: [f64; 8] = std::array::from_fn(|_| number(0.0, 6.0, rng));
    fn bumpy(u: f64, v: f64, sin: fn(f64) -> f64, cos: fn(f64) -> f64, bumps: [f64; 8]) -> f64 {
        let waves = (0..4).map(|k: usize| {
            let way = f64::from(k as u32);
            sin(4.0 * cos(way) * u * 5.0 + bumps[k]) * sin(4.0 * sin(way) * v * 5.0 + bumps[k + 4])
        });
        0.5 * waves.sum::<f64>()
    }
    vec![
        ("plane", patch([12, 9], |u, v| Point3::new(24.0 * u, 18.0 * v, 0.0), whole)),
        (
            "wave",
            patch(
                [60, 60],
                move |u, v| {
                    let [x, y] = [50.0 * u, 50.0 * v];
                    let turn = std::f64::consts::TAU / long;
                    Point3::new(x, y, 2.0 * sin(turn * x + phase) * cos(turn * y))
                },
                whole,
            ),
        ),
        ("cap", cap(number(0.5, 1.2, rng))),
        ("half ball", cap(std::f64::consts::FRAC_PI_2)),
        (
            "cylinder",
            patch(
                [40, 20],
                |u, v| Point3::new(8.0 * cos(3.0 * u), 8.0 * sin(3.0 * u), 20.0 * v),
                whole,
            ),
        ),
        (
            "saddle",
            patch(
                [30, 30],
                |u, v| {
                    let [x, y] = [20.0 * u - 10.0, 20.0 * v - 10.0];
                    Point3::new(x, y, 0.06 * (x * x - y * y))
                },
                whole,
            ),
        ),
        (
            "dome with a hole",
            patch(
                [40, 40],
                |u, v| {
                    let [x, y] = [20.0 * u - 10.0, 20.0 * v - 10.0];
                    Point3::new(x, y, (225.0 - x * x - y * y).sqrt())
                },
                |u, v| (u - 0.45).abs() < 0.1 && (v - 0.5).abs() < 0.15,
            ),
        ),
        (
            "strip",
            patch(
                [80, 6],
                |u, v| {
                    let [turn, radius] = [4.0 * u, 8.0 + 6.0 * u];
                    Point3::new(radius * cos(turn), radius * sin(turn), 5.0 * v)
                },
                whole,
            ),
        ),
        (
            "torus",
            patch(
                [50, 30],
                |u, v| {
                    let [turn, tube] = [4.5 * u, 4.0 * v - 1.0];
                    let radius = 14.0 + 5.0 * cos(tube);
                    Point3::new(radius * cos(turn), radius * sin(turn), 5.0 * sin(tube))
                },
                whole,
            ),
        ),
        (
            "bumps",
            patch(
                [50, 50],
                |u, v| Point3::new(40.0 * u, 40.0 * v, bumpy(u, v, sin, cos, bumps)),
                whole,
            ),
        ),
    ]
}

/// Checks the shells of all shapes on one side: closed, without self-intersections, thick enough, with few faces, and with the vertices of
/// the surface.
fn check_side(side: Side) {
    let mut rng = Random(70);
    // On both sides of the middle, waves that are shorter have the material of a grid, without the faces of the layer.
    let waves = if side == Side::Middle { [13.0, 18.0] } else { [8.0, 12.0] };
    for (name, surface) in shapes(&mut rng, waves) {
        let (shell, _) = shell(&surface, 2.0, side, &Progress::silent()).unwrap();
        let edges = shell.edges();
        assert!(edges.misoriented == 0 && edges.faces.iter().all(|faces| *faces == 2), "{name}");
        assert!(shell.crossings(|| Progress::silent().check()).unwrap().is_empty(), "{name}");
        assert!(shell.faces().len() <= 4 * surface.faces().len(), "{name}");
        let front = match side {
            Side::Inside => surface.clone(),
            Side::Outside => orient(&surface, Outside::Flip).unwrap().mesh,
            // The first faces of the layer are those of the surface, moved to the front.
            Side::Middle => shell.select(&Vec::from_iter(0..surface.faces().len() as u32)),
        };
        let least = percentile(&walls(&shell, &front, &mut rng, 10_000), 0.01);
        assert!(0.97 * 2.0 <= least, "{name}: {least}");
        if side != Side::Middle {
            assert_eq!(shell.positions()[..surface.positions().len()], surface.positions()[..]);
        }
    }
}

#[test]
fn walls_of_ten_shapes_are_as_thick_as_asked_inside() {
    check_side(Side::Inside);
}

#[test]
fn walls_of_ten_shapes_are_as_thick_as_asked_outside() {
    check_side(Side::Outside);
}

#[test]
fn walls_of_ten_shapes_are_as_thick_as_asked_in_the_middle() {
    check_side(Side::Middle);
}
