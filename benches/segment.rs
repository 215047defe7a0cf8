//! Measures the time to segment a large picture. The work equals that of OpenCV's `inRange`, `connectedComponentsWithStats` and `Canny` on
//! a similar picture. Results are newly allocated. The time does not include hashing of values and evaluating a graph.
//!
//! There is no performance target: the results are compared with those of the peers.

use std::sync::LazyLock;

use divan::{Bencher, black_box};
use maquette::rng::Random;
use maquette::value::{Image, Labels, Mask, Rgb};
use maquette_nodes::image::{
    Connectivity, High, Operator, Picture, Select, Space, ThinMethod, edges, label, thin, threshold,
};

fn main() {
    rayon::ThreadPoolBuilder::new().num_threads(2).build_global().expect("the first thread pool");
    divan::main();
}

const SIZE: usize = 4096;

/// A picture with six thousand blobs in five colors on a textured, noisy background.
static PICTURE: LazyLock<Image> = LazyLock::new(|| {
    let mut random = Random(1);
    let mut levels = ground(&mut random);
    (0..6000).for_each(|_| paint_blob(&mut levels, &mut random));
    Image::new(
        SIZE,
        SIZE,
        levels
            .iter()
            .map(|level| -> Rgb { level.map(|x| x.round().clamp(0.0, 255.0) as u8) })
            .collect::<Vec<_>>(),
    )
    .expect("a full picture")
});

/// The same picture in shades of gray.
static GRAY: LazyLock<Picture> = LazyLock::new(|| {
    let gray =
        |[r, g, b]: Rgb| ((77 * u32::from(r) + 150 * u32::from(g) + 29 * u32::from(b)) >> 8) as u8;
    let pixels = PICTURE.pixels().iter().map(|&pixel| [gray(pixel); 3]);
    Picture::Image(Image::new(SIZE, SIZE, Vec::from_iter(pixels)).expect("a full picture"))
});

const COLORS: [[f64; 3]; 5] = [
    [205.0, 62.0, 48.0],
    [60.0, 150.0, 70.0],
    [50.0, 80.0, 190.0],
    [230.0, 200.0, 60.0],
    [150.0, 60.0, 160.0],
];

/// Generates random numbers with a uniform or a normal distribution.
trait Spread {
    fn uniform(&mut self, low: f64, high: f64) -> f64;

    fn normal(&mut self, deviation: f64) -> f64;
}

impl Spread for Random {
    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.even()
    }

    /// Returns a random number that is approximately normally distributed with this standard deviation: a sum of four uniform numbers.
    fn normal(&mut self, deviation: f64) -> f64 {
        let sum = self.even() + self.even() + self.even() + self.even();
        (sum - 2.0) * deviation * f64::sqrt(3.0)
    }
}

fn ground(random: &mut Random) -> Vec<[f64; 3]> {
    let mut levels = Vec::with_capacity(SIZE * SIZE);
    for index in 0..SIZE * SIZE {
        let (x, y) = ((index % SIZE) as f64, (index / SIZE) as f64);
        let wave = 24.0 * libm::sin(x * 0.031) * libm::cos(y * 0.027)
            + 12.0 * libm::sin(0.11 * x + 0.07 * y);
        levels.push(
            [(96.0, 0.7), (118.0, 0.9), (104.0, 1.1)]
                .map(|(base, share)| base + wave * share + random.normal(6.0)),
        );
    }
    levels
}

fn paint_blob(levels: &mut [[f64; 3]], random: &mut Random) {
    let center = [random.uniform(0.0, SIZE as f64), random.uniform(0.0, SIZE as f64)];
    let radius = random.uniform(6.0, 60.0);
    let (flatness, phase) = (random.uniform(0.6, 1.0), random.uniform(0.0, std::f64::consts::TAU));
    let (lobes, swing) = (random.uniform(2.0, 7.0).floor(), random.uniform(0.0, 0.25));
    let color = COLORS[random.uniform(0.0, 5.0) as usize];
    let [columns, rows] = center.map(|c| {
        let reach = 1.3 * radius;
        (c - reach).max(0.0) as usize..((c + reach + 1.0) as usize).min(SIZE)
    });
    for row in rows {
        for column in columns.clone() {
            let dx = (column as f64 - center[0]) / radius;
            let dy = (row as f64 - center[1]) / (radius * flatness);
            let distance = (dx * dx + dy * dy).sqrt();
            if distance < 1.0 + swing * libm::cos(lobes * libm::atan2(dy, dx) + phase) {
                let shade = 1.0 - 0.06 * distance;
                levels[row * SIZE + column] = color.map(|c| c * shade + random.normal(5.0));
            }
        }
    }
}

/// Selects the pixels whose channels differ from the first color by at most 30 levels.
fn red() -> Mask {
    let [low, high] = [-30.0, 30.0].map(|step| COLORS[0].map(|c| (c + step).clamp(0.0, 255.0)));
    let select = Select::Box { space: Space::Rgb, low, high };
    threshold(&PICTURE, None, &select, false).expect("a box fits every picture")
}

#[divan::bench(sample_count = 25, sample_size = 1)]
fn threshold_box(bencher: Bencher<'_, '_>) {
    LazyLock::force(&PICTURE);
    bencher.bench(red);
}

#[divan::bench(sample_count = 25, sample_size = 1)]
fn label_and_statistics(bencher: Bencher<'_, '_>) {
    let mask = red();
    bencher.bench(|| label(&mask, Connectivity::Eight));
}

/// Computes the label of every pixel, as OpenCV does.
#[divan::bench(sample_count = 25, sample_size = 1)]
fn threshold_label_and_statistics(bencher: Bencher<'_, '_>) {
    LazyLock::force(&PICTURE);
    bencher.bench(|| -> Labels {
        let labels = label(&red(), Connectivity::Eight);
        black_box(labels.pixels());
        labels
    });
}

#[divan::bench(sample_count = 25, sample_size = 1, args = [High::Level(25.0), High::Percentile(90.0)])]
fn edges_of_gray(bencher: Bencher<'_, '_>, high: High) {
    LazyLock::force(&GRAY);
    bencher
        .bench(|| edges(&GRAY, None, Operator::Central, 0.0, high, 0.4).expect("no mask to fit"));
}

#[divan::bench(sample_count = 25, sample_size = 1)]
fn edges_by_sobel(bencher: Bencher<'_, '_>) {
    LazyLock::force(&GRAY);
    bencher.bench(|| {
        edges(&GRAY, None, Operator::Sobel, 0.0, High::Level(25.0), 0.5).expect("no mask to fit")
    });
}

/// Thins the edges of a picture of 400 x 400 pixels, the size of the doll's picture.
#[divan::bench]
fn thin_edges_of_a_small_picture(bencher: Bencher<'_, '_>) {
    let row = |row: usize| PICTURE.pixels()[row * SIZE..][..400].iter().copied();
    let pixels: Vec<_> = (0..400).flat_map(row).collect();
    let picture = Picture::Image(Image::new(400, 400, pixels).expect("a full picture"));
    let (mask, magnitude) =
        edges(&picture, None, Operator::Sobel, 1.0, High::default(), 0.4).expect("no mask to fit");
    bencher.bench(|| thin(&mask, Some(&magnitude), ThinMethod::Ordered).expect("equal sizes"));
}
