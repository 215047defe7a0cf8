//! The law of hollow solids on ten shapes: walls are as thick as requested, also between cavities.

use maquette_value::rng::Random;

use super::*;
use crate::random_rays::{percentile, walls};

/// Returns the surface around the places where `depth` is positive, made on a grid.
fn solid_of(depth: impl Fn(Point3<f64>) -> f64, half: [f64; 3], spacing: f64) -> Mesh {
    let counts = half.map(|half| (2.0 * half / spacing).ceil() as usize);
    let place = |at: [usize; 3]| {
        Point3::from([0, 1, 2].map(|axis| at[axis] as f64 * spacing - half[axis] + 0.01))
    };
    let mut contour = Contour::new(0.05);
    for z in 0..counts[2] {
        for (y, x) in (0..counts[1]).flat_map(|y| (0..counts[0]).map(move |x| (y, x))) {
            let depths = std::array::from_fn(|k| {
                depth(place([x + (k & 1), y + (k >> 1 & 1), z + (k >> 2)]))
            });
            contour.add([x, y, z], depths, place);
        }
    }
    contour.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    contour.mesh().unwrap()
}

/// The depth inside of a ball, and of a rod along x.
fn ball(at: Point3<f64>, [x, y, z]: [f64; 3], radius: f64) -> f64 {
    radius - (at - Point3::new(x, y, z)).norm()
}

fn rod(at: Point3<f64>, half: f64, radius: f64) -> f64 {
    radius - Vector3::new((at.x.abs() - half).max(0.0), at.y, at.z).norm()
}

/// A maximum that rounds the edge between two surfaces.
fn smooth_max(a: f64, b: f64) -> f64 {
    let near = (1.0 - (a - b).abs() / 2.0).max(0.0);
    a.max(b) + near * near / 2.0
}

/// Solids with necks that are about as thick as two walls of 2 mm.
fn shapes(rng: &mut Random) -> Vec<(&'static str, Mesh)> {
    fn number(low: f64, high: f64, rng: &mut Random) -> f64 {
        low + (high - low) * rng.even()
    }
    let (sin, cos) = (libm::sin, libm::cos);
    let phase = number(0.0, 6.0, rng);
    let chain: [f64; 3] = std::array::from_fn(|_| number(1.8, 2.2, rng));
    let blobs: [[f64; 4]; 9] = std::array::from_fn(|_| {
        let [x, y, z] = [0, 1, 2].map(|_| number(-8.0, 8.0, rng));
        [x, y, z, number(2.5, 5.0, rng)]
    });
    let dumbbell = |neck: f64| {
        solid_of(
            |at| {
                let balls = ball(at, [-8.0, 0.0, 0.0], 5.0).max(ball(at, [8.0, 0.3, 0.1], 6.0));
                smooth_max(balls, rod(at, 8.0, neck))
            },
            [16.0, 8.0, 8.0],
            0.6,
        )
    };
    vec![
        ("dumbbell with a thin neck", dumbbell(1.9)),
        ("dumbbell with a thick neck", dumbbell(2.05)),
        (
            "chain",
            solid_of(
                |at| {
                    let balls =
                        (0..4).map(|k| ball(at, [8.0 * f64::from(k) - 12.0, 0.0, 0.0], 4.5));
                    let rods = (0..3).map(|k: usize| {
                        let middle = Vector3::new(8.0 * k as f64 - 8.0, 0.0, 0.0);
                        rod(at - middle, 4.0, chain[k])
                    });
                    balls.chain(rods).fold(f64::NEG_INFINITY, f64::max)
                },
                [18.0, 6.0, 6.0],
                0.5,
            ),
        ),
        (
            "ring",
            solid_of(
                |at| {
                    let turn = libm::atan2(at.y, at.x);
                    let tube = 2.2 + 0.5 * sin(5.0 * turn + phase);
                    let middle = Vector3::new(at.x, at.y, 0.0).normalize() * 10.0;
                    tube - (at.coords - middle).norm()
                },
                [14.0, 14.0, 4.0],
                0.5,
            ),
        ),
        (
            "blobs",
            solid_of(
                |at| {
                    let balls = blobs.iter().map(|[x, y, z, r]| ball(at, [*x, *y, *z], *r));
                    balls.fold(-100.0, smooth_max)
                },
                [15.0; 3],
                0.6,
            ),
        ),
        (
            "plate of waves",
            solid_of(
                |at| {
                    let side = (12.0 - at.x.abs()).min(12.0 - at.y.abs());
                    (2.1 + 0.6 * sin(at.x * 0.8 + phase) * cos(at.y * 0.7) - at.z.abs()).min(side)
                },
                [13.0, 13.0, 4.0],
                0.5,
            ),
        ),
        (
            "wedge",
            solid_of(
                |at| {
                    let height = 2.0 + 0.12 * at.x + 0.1 * sin(2.0 * at.y);
                    (height - at.z.abs()).min(10.0 - at.x.abs()).min(8.0 - at.y.abs())
                },
                [11.0, 9.0, 5.0],
                0.5,
            ),
        ),
        (
            "box with grooves",
            solid_of(
                |at| {
                    let height = 5.0 - 3.0 * (1.0 - (at.x - 0.3).abs()).max(0.0);
                    let sides = (10.0 - at.x.abs()).min(7.0 - at.y.abs());
                    sides.min(height - at.z.abs())
                },
                [11.0, 8.0, 6.0],
                0.5,
            ),
        ),
        (
            "ball with bumps",
            solid_of(
                |at| {
                    let bumps = sin(1.3 * at.x + phase) * sin(1.1 * at.y) * sin(1.2 * at.z + 1.0);
                    ball(at, [0.0; 3], 7.5) + 1.5 * bumps
                },
                [10.0; 3],
                0.6,
            ),
        ),
        (
            "crossed rods",
            solid_of(
                |at| {
                    let turned = [at, Point3::new(at.y, at.z, at.x), Point3::new(at.z, at.x, at.y)];
                    turned.map(|at| rod(at, 8.0, 2.4)).into_iter().fold(-100.0, f64::max)
                },
                [11.0; 3],
                0.5,
            ),
        ),
    ]
}

#[test]
fn walls_of_ten_shapes_are_as_thick_as_asked_also_between_cavities() {
    let mut rng = Random(70);
    let mut cavities = 0;
    for (name, solid) in shapes(&mut rng) {
        let (hollow, thin) = hollow(&solid, (2.0, 0.0), &[], &Progress::silent()).unwrap();
        assert!(thin.is_none_or(|it| 0.9 * 2.0 < it.thickness), "{name}: {thin:?}");
        assert!(is_solid(&hollow), "{name}");
        assert!(hollow.crossings(|| Progress::silent().check()).unwrap().is_empty(), "{name}");
        let skin: Vec<u32> = (0..solid.faces().len() as u32).collect();
        let inner: Vec<u32> = (skin.len() as u32..hollow.faces().len() as u32).collect();
        assert_eq!(hollow.select(&skin).positions(), solid.positions(), "{name}");
        assert!(!inner.is_empty(), "{name}");
        let walls = walls(&hollow, &hollow.select(&inner), &mut rng, 10_000);
        let least = percentile(&walls, 0.01);
        assert!(0.97 * 2.0 <= least, "{name}: {least}");
        cavities += parts(&hollow) - 1;
    }
    // Many of the shapes have necks with a cavity on each side.
    assert!(12 < cavities, "{cavities}");
}
