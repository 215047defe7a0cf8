//! Measures the time to evaluate a NURBS surface at 2000 x 2000 parameters. Its control net has 200 x 200 points with random weights.
//!
//! There is no performance target: the results are compared with those of the peers.

use maquette::value::{ControlNet, KnotVector, Surface};
use nalgebra::Point3;

fn main() {
    divan::main();
}

const NET: usize = 200;
const GRID: usize = 2000;

/// Returns a pseudorandom number from 0 to 1: a multiple of the golden ratio whose bits are mixed.
fn noise(k: usize) -> f64 {
    let mut bits = (k as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    bits ^= bits >> 29;
    bits = bits.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (bits >> 11) as f64 / (1u64 << 53) as f64
}

fn surface(degree: usize) -> Surface {
    let count = NET * NET;
    let weights = (0..count).map(|k| 0.5 + 1.5 * noise(k + count)).collect();
    let net = ControlNet::new(
        NET,
        NET,
        (0..count)
            .map(|k: usize| Point3::new((k % NET) as f64, (k / NET) as f64, 5.0 * noise(k)))
            .collect::<Vec<_>>(),
    )
    .and_then(|net| net.with_weights(weights))
    .expect("finite points and positive weights");
    let knots = KnotVector::uniform(NET, degree + 1).expect("enough control points");
    Surface::new(net, knots.clone(), knots).expect("knots for the net")
}

fn parameters(surface: &Surface) -> Vec<f64> {
    let (start, end) = surface.u().domain();
    (0..GRID).map(|k| start + (end - start) * (k as f64 / (GRID - 1) as f64)).collect()
}

fn two_threads() -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("two threads")
}

#[divan::bench(args = [2, 3], sample_count = 31, sample_size = 1)]
fn points(bencher: divan::Bencher<'_, '_>, degree: usize) {
    let surface = surface(degree);
    let at = parameters(&surface);
    let pool = two_threads();
    bencher.bench_local(|| pool.install(|| surface.grid(&at, &at)));
}

#[divan::bench(args = [2, 3], sample_count = 31, sample_size = 1)]
fn points_and_normals(bencher: divan::Bencher<'_, '_>, degree: usize) {
    let surface = surface(degree);
    let at = parameters(&surface);
    let pool = two_threads();
    bencher.bench_local(|| pool.install(|| surface.normal_grid(&at, &at)));
}
