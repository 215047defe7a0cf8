//! Measures the most expensive operations of a test: comparing two meshes of a million faces, and rendering one of them.
//!
//! There is no performance target.

use divan::{Bencher, black_box};
use maquette::render::{View, render};
use maquette::value::{Faces, Mesh};
use maquette::{AnyValue, Tolerance, compare};
use nalgebra::Point3;

/// Number of faces of the largest meshes.
const MILLION: u32 = 1_000_000;

fn main() {
    divan::main();
}

/// Creates a wavy sheet with this number of triangles, raised by `lift` mm. If `shuffled` is true, its vertices are permuted, its faces are
/// in reverse order, and each face begins at another corner.
fn sheet(triangles: u32, lift: f64, shuffled: bool) -> Mesh {
    let n = f64::from(triangles / 2).sqrt().ceil() as u32 + 1;
    let step = 708.0 / f64::from(n);
    let at = |k: u32| {
        let (x, y) = (step * f64::from(k % n), step * f64::from(k / n));
        Point3::new(x, y, 20.0 * libm::sin(x * 0.03) + 10.0 * libm::cos(y * 0.05) + lift)
    };
    let quads = (0..n - 1).flat_map(|row| (0..n - 1).map(move |column| row * n + column));
    let mut faces: Vec<[u32; 3]> =
        quads.flat_map(|a| [[a, a + 1, a + n], [a + 1, a + n + 1, a + n]]).collect();
    faces.truncate(triangles as usize);
    let mut points: Vec<_> = (0..n * n).map(at).collect();
    if shuffled {
        // This is a permutation, because 1 000 003 is a prime that does not divide the number of vertices.
        fn permuted(vertex: u32, n: u32) -> u32 {
            (u64::from(vertex) * 1_000_003 % u64::from(n * n)) as u32
        }
        (0..n * n).for_each(|vertex| points[permuted(vertex, n) as usize] = at(vertex));
        for face in &mut faces {
            *face = [face[1], face[2], face[0]].map(|vertex| permuted(vertex, n));
        }
        faces.reverse();
    }
    Mesh::new(points, Faces::triangles(faces)).unwrap()
}

#[divan::bench(args = ["same order", "other order", "other order and moved", "far away"], sample_count = 5, sample_size = 1)]
fn million_faces(bencher: Bencher<'_, '_>, case: &str) {
    let (lift, shuffled) = match case {
        "same order" => (0.01, false),
        "other order" => (0.0, true),
        "other order and moved" => (0.01, true),
        _ => (30.0, true),
    };
    let tolerance = Tolerance { max: Some(0.1), ..Tolerance::default() };
    // Create new meshes for each run, because a mesh caches data derived from it.
    bencher
        .with_inputs(|| {
            (
                AnyValue::new(sheet(MILLION, 0.0, false)),
                AnyValue::new(sheet(MILLION, lift, shuffled)),
            )
        })
        .bench_refs(|(old, new)| compare(black_box(old), black_box(new), &tolerance));
}

#[divan::bench(args = [MILLION, 20_000, 200], sample_count = 15, sample_size = 1)]
fn picture(bencher: Bencher<'_, '_>, triangles: u32) {
    let mesh = sheet(triangles, 0.0, false);
    bencher.bench(|| render(black_box(&mesh), &View::front()));
}
