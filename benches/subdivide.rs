//! Measures the time of four steps of subdivision, to about 1.5 million faces, with two threads. The meshes are those of the benchmarks of
//! other programs (peers) if they exist, otherwise similar tori.
//!
//! There is no performance target: the results are compared with those of the peers.

#![allow(clippy::print_stdout, reason = "whoever measures must know what was measured")]

use divan::Bencher;
use maquette::value::Mesh;
use maquette_nodes::subdivision::{
    Boundary, Corners, Creases, Plan, Scheme, Subdivision, subdivide,
};

#[path = "shared/peers.rs"]
mod peers;

fn main() {
    if peers::load("sub_quad", 4).is_none() {
        let folder = peers::folder();
        println!("the peers' inputs are not in {}: a torus stands in for each", folder.display());
    }
    divan::main();
}

const SCHEMES: [Scheme; 3] = [Scheme::CatmullClark, Scheme::Loop, Scheme::DooSabin];

fn options(scheme: Scheme, limit: bool) -> Subdivision {
    Subdivision {
        scheme,
        levels: 4,
        limit,
        boundary: Boundary::EdgeAndCorner,
        creases: Creases::OpenSubdiv,
        corners: Corners::Linear,
    }
}

/// Returns a mesh of 5 780 triangles for Loop's scheme, or of 6 000 quads for the other schemes.
fn mesh(scheme: Scheme) -> Mesh {
    let (name, sides) = if scheme == Scheme::Loop { ("sub_tri", 3) } else { ("sub_quad", 4) };
    let size = if sides == 3 { [34, 85] } else { [60, 100] };
    peers::load(name, sides).unwrap_or_else(|| peers::torus(sides, size, 0.0))
}

fn two_threads() -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("two threads")
}

#[divan::bench(args = SCHEMES, sample_count = 31, sample_size = 1)]
fn everything(bencher: Bencher<'_, '_>, scheme: Scheme) {
    let (mesh, pool) = (mesh(scheme), two_threads());
    bencher.bench_local(|| pool.install(|| subdivide(&mesh, options(scheme, false))));
}

#[divan::bench(args = SCHEMES, sample_count = 31, sample_size = 1)]
fn positions_only(bencher: Bencher<'_, '_>, scheme: Scheme) {
    let (mesh, pool) = (mesh(scheme), two_threads());
    let plan = Plan::new(&mesh, options(scheme, false)).expect("a surface");
    bencher.bench_local(|| pool.install(|| plan.apply(&mesh)));
}

#[divan::bench(args = SCHEMES, sample_count = 11, sample_size = 1)]
fn with_limit_and_normals(bencher: Bencher<'_, '_>, scheme: Scheme) {
    let (mesh, pool) = (mesh(scheme), two_threads());
    bencher.bench_local(|| pool.install(|| subdivide(&mesh, options(scheme, true))));
}
