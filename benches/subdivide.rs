//! How long does a subdivision take, 4 steps to some 1.5 million faces, with two threads? On the meshes of the peers' benchmarks,
//! if they are there, else on tori like these.
//!
//! There is no bar: it stands beside its peers.

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

/// Triangles for Loop, quads for the others: 5 780 and 6 000.
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
