//! Measures the time to reconstruct a surface from points, and the distance of the result from the surface on which the points were
//! sampled. Uses two threads, and includes all preparation. `cargo bench -p maquette-tests --bench reconstruct -- WORD` runs the rows whose
//! names contain the word.
//!
//! The points are evenly distributed on a torus. The noise is normally distributed; its standard deviation is given as a fraction of the
//! diagonal of the bounding box. The measured distance is the root mean square over the vertices, divided by the mean distance between
//! points. The target for 100 000 points is a time of 2 s and a distance of 0.5.

#![allow(clippy::print_stdout, reason = "the table goes to whoever measures")]

use std::hint::black_box;
use std::time::Instant;

use maquette::Progress;
use maquette::rng::Random;
use maquette::value::{Attribute, Mesh, Points};
use maquette_nodes::mesh::{Options, Poses, reconstruct};
use maquette_nodes::subdivision::Scattered;
use nalgebra::{Point3, Vector3};

fn main() {
    // Keep freed memory, as an evaluator does.
    maquette::memory::keep_freed();
    let words: Vec<_> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    println!("{:44} {:>9} {:>9} {:>9} {:>9}", "milliseconds", "median", "least", "vertices", "off");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("two threads");
    pool.install(|| {
        for (count, runs) in [(10_000, 7), (100_000, 7), (1_000_000, 3)] {
            for noise in [0.0, 0.001, 0.01] {
                for normals in [false, true] {
                    let kind = if normals { "with normals" } else { "points alone" };
                    let name = format!("{count} {kind}, noise {noise}");
                    if words.is_empty() || words.iter().any(|word| name.contains(&**word)) {
                        row(&name, runs, &torus(count, noise, normals));
                    }
                }
            }
        }
    });
}

fn row(name: &str, runs: usize, points: &Points) {
    let sources = [Scattered::Points(points.clone())];
    fn run(sources: &[Scattered; 1]) -> Result<Mesh, maquette::Error> {
        reconstruct(sources, Poses::Auto, &Options::default(), &Progress::silent())
    }
    let mesh = run(&sources).expect("a skin");
    let mut times: Vec<_> = (0..runs)
        .map(|_| {
            let start = Instant::now();
            let result = black_box(run(&sources));
            let time = 1e3 * start.elapsed().as_secs_f64();
            drop(result);
            time
        })
        .collect();
    times.sort_by(f64::total_cmp);
    let area = 4.0 * std::f64::consts::PI * std::f64::consts::PI * ROUND * TUBE;
    let off = mean_error(&mesh) / (area / points.positions().len() as f64).sqrt();
    let (median, least, vertices) = (times[runs / 2], times[0], mesh.positions().len());
    println!("{name:44} {median:9.1} {least:9.1} {vertices:9} {off:9.3}");
}

/// The major radius (`ROUND`) and the minor radius (`TUBE`) of the torus, in mm.
const ROUND: f64 = 40.0;
const TUBE: f64 = 15.0;

fn mean_error(mesh: &Mesh) -> f64 {
    fn distance_to_torus(point: &Point3<f64>) -> f64 {
        let out = (point.x * point.x + point.z * point.z).sqrt() - ROUND;
        (out * out + point.y * point.y).sqrt() - TUBE
    }
    let squares: f64 = mesh
        .positions()
        .iter()
        .map(|point| distance_to_torus(point) * distance_to_torus(point))
        .sum();
    (squares / mesh.positions().len() as f64).sqrt()
}

fn torus(count: usize, noise: f64, normals: bool) -> Points {
    let mut random = Random(1);
    let wide = 2.0 * (ROUND + TUBE);
    let deviation = noise * (2.0 * wide * wide + 4.0 * TUBE * TUBE).sqrt();
    let (mut places, mut outwards) = (Vec::new(), Vec::new());
    while places.len() < count {
        let [u, v] = [0, 1].map(|_| std::f64::consts::TAU * random.even());
        let radius = ROUND + TUBE * libm::cos(v);
        // Reject more points on the inner side, where the area is smaller, so that the points are evenly distributed.
        if random.even() * (ROUND + TUBE) < radius {
            let (s, c) = libm::sincos(u);
            let out = Vector3::new(libm::cos(v) * c, libm::sin(v), libm::cos(v) * s);
            let at = Vector3::new(ROUND * c, 0.0, ROUND * s) + out * TUBE;
            let moved = Vector3::from_fn(|_, _| random.normal(deviation));
            places.push(Point3::from(at + moved));
            outwards.push(out.into());
        }
    }
    let points = Points::new(places).expect("finite places");
    if !normals {
        return points;
    }
    points.with_attribute("normal", Attribute::Vector(outwards.into())).expect("one for each")
}

/// Generates normally distributed random numbers.
trait Noise {
    fn normal(&mut self, deviation: f64) -> f64;
}

impl Noise for Random {
    /// Returns a random number with the mean 0 and this standard deviation (Box and Muller, 1958).
    fn normal(&mut self, deviation: f64) -> f64 {
        let angle = std::f64::consts::TAU * self.even();
        deviation * (-2.0 * libm::log(1.0 - self.even())).sqrt() * libm::cos(angle)
    }
}
