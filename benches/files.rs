//! Measures the time to read, write and process one million triangles and one capture. The files are bytes in memory, so the disk plays no
//! role.
//!
//! There is no performance target.

use maquette::format::{pcd, ply};
use maquette::value::{Faces, Mesh, RangeImage};
use maquette_nodes::range::triangulate;
use maquette_nodes::subdivision::{Boundary, Corners, Creases, Scheme, Subdivision, subdivide};
use nalgebra::Point3;

fn main() {
    // Use two threads, for which the project's time limits are stated.
    rayon::ThreadPoolBuilder::new().num_threads(2).build_global().expect("threads");
    divan::main();
}

/// Returns the points of a wavy sheet, in `height` rows of `width` points.
fn points(width: usize, height: usize) -> Vec<Point3<f64>> {
    (0..width * height)
        .map(|k: usize| {
            let [x, y] = [k % width, k / width].map(|k| k as f64);
            Point3::new(x, y, 700.0 + 5.0 * libm::sin(0.1 * x) * libm::cos(0.07 * y))
        })
        .collect()
}

/// Returns a mesh of one million triangles.
fn mesh() -> Mesh {
    let (width, height) = (1001u32, 501u32);
    let quads = (0..height - 1).flat_map(|row| (0..width - 1).map(move |k| row * width + k));
    let faces = Faces::triangles(
        quads
            .flat_map(|a: u32| [[a, a + width, a + width + 1], [a, a + width + 1, a + 1]])
            .collect(),
    );
    Mesh::new(points(width as usize, height as usize), faces).expect("a mesh")
}

#[divan::bench(sample_count = 21, sample_size = 1)]
fn write_ply_million_triangles(bencher: divan::Bencher<'_, '_>) {
    let mesh = mesh();
    bencher.bench(|| ply::encode(&mesh));
}

#[divan::bench(sample_count = 21, sample_size = 1)]
fn read_ply_million_triangles(bencher: divan::Bencher<'_, '_>) {
    let bytes = ply::encode(&mesh()).expect("a file");
    bencher.bench(|| ply::read(&bytes).expect("a mesh"));
}

#[divan::bench(sample_count = 21, sample_size = 1)]
fn vertex_normals_million_triangles(bencher: divan::Bencher<'_, '_>) {
    let mesh = mesh();
    bencher.bench(|| mesh.vertex_normals());
}

#[divan::bench(sample_count = 21, sample_size = 1)]
fn read_pcd_640_480(bencher: divan::Bencher<'_, '_>) {
    let range = RangeImage::new(640, 480, points(640, 480)).expect("a grid");
    let range = range.with_colors(vec![[90, 60, 30]; 640 * 480]).expect("colors");
    let bytes = pcd::encode(&range).expect("a file");
    bencher.bench(|| pcd::read(&bytes).expect("a grid"));
}

#[divan::bench(sample_count = 21, sample_size = 1)]
fn write_pcd_640_480(bencher: divan::Bencher<'_, '_>) {
    let range = RangeImage::new(640, 480, points(640, 480)).expect("a grid");
    bencher.bench(|| pcd::encode(&range));
}

/// Triangulates a range image of one million cells.
#[divan::bench(sample_count = 11, sample_size = 1)]
fn triangulate_million_cells(bencher: divan::Bencher<'_, '_>) {
    let range = RangeImage::new(1000, 1000, points(1000, 1000)).expect("a grid");
    bencher.bench(|| triangulate(&range, 6.0, 85.0, 20).expect("a mesh"));
}

/// Subdivides a quarter of a million triangles into one million.
#[divan::bench(sample_count = 11, sample_size = 1)]
fn subdivide_to_million_triangles(bencher: divan::Bencher<'_, '_>) {
    let range = RangeImage::new(354, 354, points(354, 354)).expect("a grid");
    let mesh = triangulate(&range, 6.0, 85.0, 20).expect("a mesh");
    let how = Subdivision {
        scheme: Scheme::Loop,
        levels: 1,
        limit: false,
        boundary: Boundary::EdgeAndCorner,
        creases: Creases::OpenSubdiv,
        corners: Corners::Linear,
    };
    bencher.bench(|| subdivide(&mesh, how).expect("a mesh"));
}
