//! Nuts (of a screw) with any number of sides, for tests and benchmarks.

use std::collections::BTreeMap;

use nalgebra::{Point3, center};

/// Returns the vertices and triangles, with edges of about 1 mm, of a nut whose bore is along `y`. Its outer corners are 20 mm from the
/// axis, it is 20 mm high, and the radius of its bore is 10 mm.
pub(crate) fn nut(sides: u32) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
    fn corner(k: u32, radius: f64, y: f64, sides: u32) -> Point3<f64> {
        let angle = std::f64::consts::TAU * f64::from(k % sides) / f64::from(sides);
        Point3::new(radius * libm::sin(angle), y, radius * libm::cos(angle))
    }
    let mut nut = Nut::default();
    for k in 0..sides {
        let edges = [(20.0, -10.0), (20.0, 10.0), (10.0, -10.0), (10.0, 10.0)];
        let [[a, b], [c, d], [e, f], [g, h]] =
            edges.map(|(radius, y)| [corner(k, radius, y, sides), corner(k + 1, radius, y, sides)]);
        for quad in [[a, b, d, c], [c, d, h, g], [g, h, f, e], [e, f, b, a]] {
            nut.add(quad);
        }
    }
    (nut.points, nut.faces)
}

#[derive(Default)]
struct Nut {
    points: Vec<Point3<f64>>,
    faces: Vec<[u32; 3]>,
    numbers: BTreeMap<[i64; 3], u32>,
}

impl Nut {
    /// Adds a flat quadrilateral as a grid of triangles. Quadrilaterals with a common side share the vertices on it.
    fn add(&mut self, [a, b, c, d]: [Point3<f64>; 4]) {
        let columns = 16;
        let rows = (b - c).norm().round() as u32;
        fn mix(p: Point3<f64>, q: Point3<f64>, t: f64) -> Point3<f64> {
            p + (q - p) * t
        }
        let mut number = |i: u32, j: u32| {
            let [s, t] = [f64::from(i) / f64::from(columns), f64::from(j) / f64::from(rows)];
            let point = mix(mix(a, b, s), mix(d, c, s), t);
            let key = point.coords.map(|x| (x * 1e6).round() as i64).into();
            *self.numbers.entry(key).or_insert_with(|| {
                self.points.push(point);
                self.points.len() as u32 - 1
            })
        };
        for j in 0..rows {
            for i in 0..columns {
                let [p, q] = [number(i, j), number(i + 1, j)];
                let [r, s] = [number(i + 1, j + 1), number(i, j + 1)];
                self.faces.extend(match (i + j) % 2 {
                    0 => [[p, q, r], [p, r, s]],
                    _ => [[p, q, s], [q, r, s]],
                });
            }
        }
    }
}

/// Returns true for the points to remove: those in a ball around an outer corner, and those in a ball around the center of a side, each
/// several edges wide.
pub(crate) fn is_lost(point: &Point3<f64>, sides: u32) -> bool {
    let half = std::f64::consts::PI / f64::from(sides);
    let [top, side] = [
        Point3::new(0.0, 10.0, 20.0),
        Point3::new(18.0 * libm::sin(half), 4.0, 18.0 * libm::cos(half)),
    ];
    (point - center(&top, &side)).norm() < 8.5
}
