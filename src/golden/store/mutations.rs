//! Tests the limits of comparisons. One entry is moved by slightly less than a limit, which must pass, and by slightly more, which must
//! fail.

use maquette_value::rng::{STEP, even, mix};
use maquette_value::{
    AnyValue, Attribute, ControlNet, Curve, Faces, Field, Image, KnotVector, Labels, Mask, Mesh,
    Points, RangeImage, Surface,
};
use nalgebra::{Point3, Vector3};

use super::{Golden, files, read};
use crate::compare::{Tolerance, Verdict};

/// Returns a pseudorandom number from 0 to 1.
fn chance(seed: usize) -> f64 {
    even(mix((seed as u64).wrapping_mul(STEP)))
}

fn golden_of(value: &AnyValue, tolerance: &Tolerance) -> Golden {
    let folder = tempfile::tempdir().unwrap();
    for file in files(value, &[], &[], tolerance) {
        std::fs::write(folder.path().join(format!("x{}", file.name)), file.bytes).unwrap();
    }
    read(folder.path(), "x").unwrap()
}

/// The distances by which an entry is moved, as fractions of the limit. Each has the expected verdict.
const MOVES: [(f64, Verdict); 5] = [
    (0.9, Verdict::Within),
    (0.96, Verdict::Within),
    (1.1, Verdict::Different),
    (3.0, Verdict::Different),
    (1e7, Verdict::Different),
];

/// Returns the number of elements that are tested, including the first and the last. This is the value of the environment variable
/// `PLACES`, or 9 by default.
fn tested_positions(count: usize) -> usize {
    let said = std::env::var("PLACES").ok().and_then(|text| text.parse().ok());
    said.unwrap_or(9).clamp(2, count.max(2))
}

/// Moves elements of the value `old` by just less and just more than a limit, and checks the verdicts.
fn check(
    what: &str,
    old: AnyValue,
    tolerance: &Tolerance,
    (count, bound): (usize, f64),
    moved: impl Fn(usize, f64) -> AnyValue,
) {
    let golden = golden_of(&old, tolerance);
    assert_eq!(golden.compare(&old, &[], tolerance).verdict, Verdict::Identical, "{what}");
    let tried = tested_positions(count);
    for k in 0..tried {
        let place = k * (count - 1) / (tried - 1);
        for (fraction, verdict) in MOVES {
            // With the default tolerance, the verdict is certain only if the difference is at least a tenth of the limit away from the
            // limit.
            if fraction == 0.96 && *tolerance == Tolerance::default() {
                continue;
            }
            let comparison = golden.compare(&moved(place, fraction * bound), &[], tolerance);
            assert_eq!(
                comparison.verdict, verdict,
                "{what}: {fraction} of {bound} at {place}: {comparison:?}"
            );
            let far = comparison.measures.iter().filter(|m| !m.is_by_fraction);
            let least = far.map(|m| m.max - m.error).fold(0.0, f64::max);
            let is_true = least <= 1.000_001 * fraction * bound;
            assert!(is_true || tolerance.rms.is_some(), "{what}: {fraction} of {bound} is {least}");
        }
    }
}

/// Returns the default limit for numbers whose range has this diagonal.
fn default_bound(diagonal: f64) -> f64 {
    1e-9 * diagonal
}

fn diagonal(points: &[Point3<f64>]) -> f64 {
    fn corner(pick: fn(f64, f64) -> f64, start: f64, points: &[Point3<f64>]) -> Vector3<f64> {
        points
            .iter()
            .filter(|p| p.x.is_finite())
            .fold(Vector3::repeat(start), |corner, p| corner.zip_map(&p.coords, pick))
    }
    (corner(f64::max, f64::NEG_INFINITY, points) - corner(f64::min, f64::INFINITY, points)).norm()
}

/// Returns points of a rough sheet far from the origin.
fn sheet_points(rows: usize, columns: usize) -> Vec<Point3<f64>> {
    (0..rows * columns)
        .map(|k: usize| {
            let (x, y) = ((k % columns) as f64, (k / columns) as f64);
            Point3::new(
                500.0 + x + 0.6 * chance(3 * k),
                y + 0.6 * chance(3 * k + 1),
                3.0 * chance(3 * k + 2),
            )
        })
        .collect()
}

fn shift_point(points: &[Point3<f64>], place: usize, by: f64) -> Vec<Point3<f64>> {
    let mut points = points.to_vec();
    let direction =
        Vector3::new(chance(place) - 0.5, chance(place + 1) - 0.5, chance(place + 2) - 0.5);
    points[place] += direction.normalize() * by;
    points
}

const SIDE: u32 = 50;

fn mesh() -> Mesh {
    let quads = (0..SIDE - 1).flat_map(|row| (0..SIDE - 1).map(move |column| row * SIDE + column));
    let faces = quads.flat_map(|a| [[a, a + 1, a + SIDE], [a + 1, a + SIDE + 1, a + SIDE]]);
    Mesh::new(sheet_points(SIDE as usize, SIDE as usize), Faces::triangles(faces.collect()))
        .unwrap()
}

fn tolerance_of(max: f64) -> Tolerance {
    Tolerance { max: Some(max), ..Tolerance::default() }
}

#[test]
fn positions_of_a_mesh_are_compared_at_each_limit() {
    let mesh = mesh();
    let n = mesh.positions().len();
    let all = [0.5, 1e-3, 1e-7, default_bound(diagonal(mesh.positions()))];
    for (k, bound) in all.into_iter().enumerate() {
        let tolerance = if k == 3 { Tolerance::default() } else { tolerance_of(bound) };
        check("max", AnyValue::new(mesh.clone()), &tolerance, (n, bound), |place, by| {
            AnyValue::new(mesh.with_positions(shift_point(mesh.positions(), place, by)).unwrap())
        });
    }
    // Move one vertex so far that the root mean square over all vertices reaches the limit.
    let rms = Tolerance { rms: Some(0.004), ..Tolerance::default() };
    check("rms", AnyValue::new(mesh.clone()), &rms, (n, 0.004), |place, by| {
        let by = by * (n as f64).sqrt();
        AnyValue::new(mesh.with_positions(shift_point(mesh.positions(), place, by)).unwrap())
    });
    for tolerance in [
        Tolerance { p99: Some(0.02), ..Tolerance::default() },
        Tolerance { rms: Some(0.02), ..Tolerance::default() },
        tolerance_of(0.02),
    ] {
        check("all", AnyValue::new(mesh.clone()), &tolerance, (n, 0.02), |place, by| {
            let mut positions = mesh.positions().to_vec();
            for (k, position) in positions.iter_mut().enumerate() {
                let [x, y, z] = [0, 1, 2].map(|c| chance(3 * k + c + place) - 0.5);
                *position += Vector3::new(x, y, z).normalize() * by;
            }
            AnyValue::new(mesh.with_positions(positions).unwrap())
        });
    }
}

#[test]
fn a_move_far_below_the_limit_is_no_difference() {
    let mesh = mesh();
    let tolerance = Tolerance { rms: Some(0.004), ..tolerance_of(0.5) };
    let golden = golden_of(&AnyValue::new(mesh.clone()), &tolerance);
    let moved =
        mesh.with_positions(mesh.positions().iter().map(|p| p + Vector3::repeat(1e-9)).collect());
    let comparison = golden.compare(&AnyValue::new(moved.unwrap()), &[], &tolerance);
    assert_eq!(comparison.verdict, Verdict::Within);
    assert!(comparison.measures.iter().all(|m| m.max <= m.error), "{comparison:?}");
}

#[test]
fn attributes_and_normals_are_compared_at_their_limits() {
    let plain = mesh();
    let counts = [plain.positions().len(), plain.faces().corners().len(), plain.faces().len()];
    fn numbers(count: usize) -> Vec<f64> {
        (0..count).map(|k| 7.0 * chance(k)).collect()
    }
    for (of, count) in counts.into_iter().enumerate() {
        fn mesh_with_heat(numbers: Vec<f64>, plain: &Mesh, of: usize) -> AnyValue {
            let heat = Attribute::Number(numbers.into());
            AnyValue::new(match of {
                0 => plain.clone().with_vertex("heat", heat).unwrap(),
                1 => plain.clone().with_corner("heat", heat).unwrap(),
                _ => plain.clone().with_face("heat", heat).unwrap(),
            })
        }
        let low = numbers(count).into_iter().fold(f64::INFINITY, f64::min);
        let range = numbers(count).into_iter().fold(0.0, f64::max) - low;
        for bound in [1e-4, default_bound(range)] {
            let tolerance = match bound {
                1e-4 => Tolerance {
                    attributes: [("heat".to_owned(), bound)].into(),
                    ..Tolerance::default()
                },
                _ => Tolerance::default(),
            };
            check(
                "heat",
                mesh_with_heat(numbers(count), &plain, of),
                &tolerance,
                (count, bound),
                |place, by| {
                    let mut numbers = numbers(count);
                    numbers[place] -= by;
                    mesh_with_heat(numbers, &plain, of)
                },
            );
        }
    }
    let normals: Vec<[f64; 3]> = (0..counts[0])
        .map(|k| Vector3::new(chance(k) - 0.5, chance(k + 1) - 0.5, 1.0).normalize().into())
        .collect();
    fn mesh_with_normals(normals: Vec<[f64; 3]>, plain: &Mesh) -> AnyValue {
        AnyValue::new(
            plain.clone().with_vertex("normal", Attribute::Vector(normals.into())).unwrap(),
        )
    }
    for bound in [2.0, 1e-3, 1e-9f64.to_degrees()] {
        let tolerance = if bound < 1e-6 {
            Tolerance::default()
        } else {
            Tolerance { normals: Some(bound), ..Tolerance::default() }
        };
        check(
            "normal",
            mesh_with_normals(normals.clone(), &plain),
            &tolerance,
            (counts[0], bound),
            |place, by| {
                let mut normals = normals.clone();
                let normal = Vector3::from(normals[place]);
                let beside = normal.cross(&Vector3::new(0.3, -0.8, 0.1)).normalize();
                // An angle between two normals is at most 180 degrees, so limit the move.
                let angle = by.min(170.0).to_radians();
                normals[place] = (normal * libm::cos(angle) + beside * libm::sin(angle)).into();
                mesh_with_normals(normals, &plain)
            },
        );
    }
}

#[test]
fn grids_and_lists_of_positions_are_compared_at_their_limits() {
    let points = sheet_points(90, 60);
    // Remove the points of some cells: a cell without a measured point contains NaN.
    let holed: Vec<_> = (0..points.len())
        .map(|k| if k % 7 == 3 { Point3::new(f64::NAN, f64::NAN, f64::NAN) } else { points[k] })
        .collect();
    let near = &points[..1800];
    fn knots(n: usize) -> KnotVector {
        KnotVector::uniform(n, 3).unwrap()
    }
    fn net(points: Vec<Point3<f64>>) -> ControlNet {
        ControlNet::new(30, 60, points).unwrap()
    }
    fn polyline(points: Vec<Point3<f64>>) -> Curve {
        Curve::polyline(points, false).unwrap()
    }
    type Make<'a> = &'a dyn Fn(Vec<Point3<f64>>) -> AnyValue;
    let range: Make<'_> = &|points| AnyValue::new(RangeImage::new(60, 90, points).unwrap());
    let cloud: Make<'_> = &|points| AnyValue::new(Points::new(points).unwrap());
    let curve: Make<'_> = &|points| AnyValue::new(polyline(points));
    let moved_net: Make<'_> =
        &|points| AnyValue::new(net(near.to_vec()).with_points(points).unwrap());
    let surface: Make<'_> = &|points| {
        let net = net(near.to_vec()).with_points(points).unwrap();
        AnyValue::new(Surface::new(net, knots(30), knots(60)).unwrap())
    };
    let cases: [(&str, &[Point3<f64>], Make<'_>); 5] = [
        ("range", &holed, range),
        ("points", &points, cloud),
        ("curve", &points, curve),
        ("net", near, moved_net),
        ("surface", near, surface),
    ];
    for (what, places, make) in cases {
        for bound in [0.05, default_bound(diagonal(places))] {
            let tolerance = if bound == 0.05 { tolerance_of(bound) } else { Tolerance::default() };
            let old = make(places.to_vec());
            check(what, old, &tolerance, (places.len(), bound), |place, by| {
                // Move the neighbor if the cell has no point.
                let place = if places[place].x.is_nan() { place - 1 } else { place };
                make(shift_point(places, place, by))
            });
        }
    }
}

#[test]
fn fields_are_compared_at_their_limits() {
    let pixels: Vec<f32> = (0..6400).map(|k| chance(k) as f32 * 8.0).collect();
    fn field(pixels: Vec<f32>) -> AnyValue {
        AnyValue::new(Field::new(80, 80, pixels).unwrap())
    }
    check("field", field(pixels.clone()), &tolerance_of(0.25), (6400, 0.25), |place, by| {
        let mut pixels = pixels.clone();
        pixels[place] += by as f32;
        field(pixels)
    });
}

#[test]
fn pixels_are_compared_by_level_and_fraction() {
    let (width, height) = (120, 90);
    let n = width * height;
    let colors: Vec<[u8; 3]> =
        (0..n).map(|k| [0, 1, 2].map(|c| (100.0 * chance(3 * k + c)) as u8)).collect();
    fn picture(colors: Vec<[u8; 3]>, width: usize, height: usize) -> AnyValue {
        AnyValue::new(Image::new(width, height, colors).unwrap())
    }
    let level = Tolerance { level: 10.0, ..Tolerance::default() };
    check("level", picture(colors.clone(), width, height), &level, (n, 10.0), |place, by| {
        let mut colors = colors.clone();
        colors[place][1] = colors[place][1].saturating_add(by.min(255.0) as u8);
        picture(colors, width, height)
    });
    let some = Tolerance { differing: 0.05, ..Tolerance::default() };
    // Changes a fraction of the pixels, starting at the pixel `from`. After the last pixel it continues with the first.
    let changed = |from: usize, fraction: f64| {
        let many = (fraction.min(1.0) * n as f64).round() as usize;
        (0..many).map(move |k| (from + k) % n)
    };
    check(
        "differing",
        picture(colors.clone(), width, height),
        &some,
        (n, 0.05),
        |from, fraction| {
            let mut colors = colors.clone();
            changed(from, fraction).for_each(|pixel| colors[pixel][2] += 1);
            picture(colors, width, height)
        },
    );
    let inside: Vec<u8> = (0..n).map(|k| u8::from(chance(k) > 0.5)).collect();
    fn mask(inside: Vec<u8>, width: usize, height: usize) -> AnyValue {
        AnyValue::new(Mask::new(width, height, inside).unwrap())
    }
    check("mask", mask(inside.clone(), width, height), &some, (n, 0.05), |from, fraction| {
        let mut inside = inside.clone();
        changed(from, fraction).for_each(|pixel| inside[pixel] = 1 - inside[pixel]);
        mask(inside, width, height)
    });
    let label: Vec<u32> = (0..n).map(|k| (k / 1000) as u32).collect();
    fn labels(label: Vec<u32>, width: usize, height: usize) -> AnyValue {
        AnyValue::new(Labels::new(width, height, label).unwrap())
    }
    check(
        "labels",
        labels(label.clone(), width, height),
        &some,
        (n - 1000, 0.05),
        |from, fraction| {
            let mut label = label.clone();
            // Do not change the first pixel of a label, because labels are numbered in the order of their first pixels.
            let (from, many) = (1000 + from, (fraction.min(1.0) * n as f64).round() as usize);
            let free =
                (0..n).map(|k| (from + k) % n).filter(|pixel| pixel % 1000 >= 1 && *pixel >= 1000);
            for pixel in free.take(many) {
                label[pixel] = if label[pixel] == 1 { 2 } else { 1 };
            }
            labels(label, width, height)
        },
    );
}

#[test]
fn a_single_pixel_or_corner_fails_without_tolerance() {
    let (width, height) = (200, 150);
    let colors: Vec<[u8; 3]> =
        (0..width * height).map(|k| [0, 1, 2].map(|c| (255.0 * chance(3 * k + c)) as u8)).collect();
    fn picture(colors: Vec<[u8; 3]>, width: usize, height: usize) -> AnyValue {
        AnyValue::new(Image::new(width, height, colors).unwrap())
    }
    let golden = golden_of(&picture(colors.clone(), width, height), &Tolerance::default());
    for place in [0, 1, 200, 7777, width * height - 1] {
        let mut colors = colors.clone();
        colors[place][0] ^= 1;
        let comparison =
            golden.compare(&picture(colors, width, height), &[], &Tolerance::default());
        assert_eq!(comparison.verdict, Verdict::Different);
        let at = format!("worst at column {}, row {}:", place % width, place / width);
        assert!(comparison.reasons[0].contains(&at), "{comparison:?}");
    }
    let mesh = mesh();
    let golden = golden_of(&AnyValue::new(mesh.clone()), &tolerance_of(0.5));
    let mut faces = mesh.faces().as_triangles().unwrap().to_vec();
    faces[2000].swap(0, 1);
    let other = Mesh::new(mesh.positions().to_vec(), Faces::triangles(faces)).unwrap();
    assert_eq!(
        golden.compare(&AnyValue::new(other), &[], &tolerance_of(0.5)).verdict,
        Verdict::Different
    );
}
