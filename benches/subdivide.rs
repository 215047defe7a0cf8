//! How long does a subdivision take, 4 steps to some 1.5 million faces, with two threads? On the meshes of the peers' benchmarks,
//! if they are there: the folder is `PEERS_WORK`/data, see `benches/peers/peers.py`, which makes them; else on meshes like these.

#![allow(clippy::print_stdout, reason = "whoever measures must know what was measured")]

use std::path::{Path, PathBuf};

use divan::Bencher;
use maquette::value::{Faces, Mesh};
use maquette_nodes::subdivision::{
    Boundary, Corners, Creases, Plan, Scheme, Subdivision, subdivide,
};
use nalgebra::Point3;

fn main() {
    if load("sub_quad", 4).is_none() {
        println!("the peers' inputs are not in {}: a torus stands in for each", folder().display());
    }
    divan::main();
}

const SCHEMES: [Scheme; 3] = [Scheme::CatmullClark, Scheme::Loop, Scheme::DooSabin];

fn how(scheme: Scheme, limit: bool) -> Subdivision {
    Subdivision {
        scheme,
        levels: 4,
        limit,
        boundary: Boundary::EdgeAndCorner,
        creases: Creases::OpenSubdiv,
        corners: Corners::Linear,
    }
}

fn folder() -> PathBuf {
    let work = std::env::var_os("PEERS_WORK").map(PathBuf::from);
    work.unwrap_or_else(|| std::env::temp_dir().join("peers")).join("data")
}

/// Triangles for Loop, quads for the others: 5 780 and 6 000.
fn mesh(scheme: Scheme) -> Mesh {
    let (name, sides) = if scheme == Scheme::Loop { ("sub_tri", 3) } else { ("sub_quad", 4) };
    load(name, sides).unwrap_or_else(|| torus(sides))
}

fn load(name: &str, sides: usize) -> Option<Mesh> {
    let positions: Vec<[f64; 3]> = open(&folder().join(format!("{name}_v.npy")))?;
    let corners: Vec<u32> = open(&folder().join(format!("{name}_f.npy")))?;
    let positions: Vec<Point3<f64>> = positions.into_iter().map(Point3::from).collect();
    Mesh::new(positions, Faces::uniform(sides, corners).ok()?).ok()
}

/// The items of a file of NumPy, version 1, in C order.
fn open<T: bytemuck::Pod>(path: &Path) -> Option<Vec<T>> {
    let bytes = std::fs::read(path).ok()?;
    let length = usize::from(u16::from_le_bytes([*bytes.get(8)?, *bytes.get(9)?]));
    Some(bytemuck::pod_collect_to_vec(bytes.get(10 + length..)?))
}

fn torus(sides: usize) -> Mesh {
    let (rows, columns) = if sides == 3 { (34, 85) } else { (60, 100) };
    let angle = |k: u32, n: u32| libm::sincos(std::f64::consts::TAU * f64::from(k) / f64::from(n));
    let point = |k: u32| {
        let ((s, c), (t, d)) = (angle(k / columns, rows), angle(k % columns, columns));
        Point3::new((2.0 + c) * d, (2.0 + c) * t, s)
    };
    let quad = |k: u32| {
        let at = |i: u32, j: u32| i % rows * columns + j % columns;
        let (i, j) = (k / columns, k % columns);
        [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)]
    };
    let quads = (0..rows * columns).map(quad);
    let corners = match sides {
        3 => quads.flat_map(|[a, b, c, d]| [a, b, c, a, c, d]).collect(),
        _ => quads.flatten().collect::<Vec<u32>>(),
    };
    let positions: Vec<_> = (0..rows * columns).map(point).collect();
    Mesh::new(positions, Faces::uniform(sides, corners).expect("whole faces")).expect("a torus")
}

fn two_threads() -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("two threads")
}

#[divan::bench(args = SCHEMES, sample_count = 31, sample_size = 1)]
fn everything(bencher: Bencher<'_, '_>, scheme: Scheme) {
    let (mesh, pool) = (mesh(scheme), two_threads());
    bencher.bench_local(|| pool.install(|| subdivide(&mesh, how(scheme, false))));
}

#[divan::bench(args = SCHEMES, sample_count = 31, sample_size = 1)]
fn positions_only(bencher: Bencher<'_, '_>, scheme: Scheme) {
    let (mesh, pool) = (mesh(scheme), two_threads());
    let plan = Plan::new(&mesh, how(scheme, false)).expect("a surface");
    bencher.bench_local(|| pool.install(|| plan.apply(&mesh)));
}

#[divan::bench(args = SCHEMES, sample_count = 11, sample_size = 1)]
fn with_limit_and_normals(bencher: Bencher<'_, '_>, scheme: Scheme) {
    let (mesh, pool) = (mesh(scheme), two_threads());
    bencher.bench_local(|| pool.install(|| subdivide(&mesh, how(scheme, true))));
}
