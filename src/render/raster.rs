//! Which triangle each sample sees.
//!
//! Vertices are rounded to sixteenths of samples, and edge functions are computed with whole numbers, so that a sample on an
//! edge that two triangles share belongs to exactly one of them: Pineda, "A parallel algorithm for polygon rasterization"
//! (1988), with the top-left rule.

use rayon::prelude::*;

use super::camera::PARTS;
use super::scene::{Scene, Triangle};
use super::{BAND, SAMPLES, light};
use crate::value::Rgb;

/// Triangles that one task sorts into bands.
const CHUNK: usize = 16_384;

/// No triangle.
const NONE: u32 = u32::MAX;

/// Rows of samples in a band.
const ROWS: usize = BAND * SAMPLES;

/// The triangles that touch each band.
pub(super) struct Bins {
    /// By chunk of triangles, then by band, in the order of the triangles.
    chunks: Vec<Vec<Vec<u32>>>,
}

impl Bins {
    pub(super) fn new(scene: &Scene<'_>, height: usize) -> Self {
        let bands = height.div_ceil(BAND);
        let chunk = |chunk: usize| {
            let mut bins = vec![vec![]; bands];
            for index in chunk * CHUNK..scene.len().min((chunk + 1) * CHUNK) {
                let outline = Outline::new(scene, scene.triangle(index));
                if let Some(outline) = outline {
                    let [first, last] = outline.samples(1, (height * SAMPLES) as i64);
                    if first <= last {
                        let touched = first as usize / ROWS..=last as usize / ROWS;
                        bins[touched].iter_mut().for_each(|bin| bin.push(index as u32));
                    }
                }
            }
            bins
        };
        Self { chunks: (0..scene.len().div_ceil(CHUNK)).into_par_iter().map(chunk).collect() }
    }

    fn band(&self, band: usize) -> impl Iterator<Item = u32> {
        self.chunks.iter().flat_map(move |bins| &bins[band]).copied()
    }
}

/// A triangle in the picture, turned so that its area is positive.
struct Outline {
    /// Columns and rows of its vertices, in parts of samples.
    at: [[i64; 2]; 3],
    /// The vertices' places in the triangle: the second and third are exchanged if its outside is seen.
    order: [usize; 3],
    /// Twice its area, in squared parts of samples.
    area: i64,
}

impl Outline {
    /// None for a triangle that is seen from its edge.
    fn new(scene: &Scene<'_>, triangle: Triangle) -> Option<Self> {
        let at = triangle.vertices.map(|vertex| scene.spots[vertex as usize].at.map(i64::from));
        let area = edge(at[0], at[1], at[2]);
        // Rows count downwards, so that what is counter-clockwise for the viewer has a negative area.
        match area {
            0 => None,
            1.. => Some(Self { at, order: [0, 1, 2], area }),
            _ => Some(Self { at: [at[0], at[2], at[1]], order: [0, 2, 1], area: -area }),
        }
    }

    /// Whether the inner side is seen.
    fn is_inner(&self) -> bool {
        self.order[1] == 1
    }

    /// First and last sample along an axis (0 columns, 1 rows) whose centers the triangle may cover, of `count`.
    fn samples(&self, axis: usize, count: i64) -> [i64; 2] {
        let parts = i64::from(PARTS);
        let [a, b, c] = self.at.map(|at| at[axis] - parts / 2);
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        [(low + parts - 1).div_euclid(parts).max(0), high.div_euclid(parts).min(count - 1)]
    }

    /// How much each vertex weighs at a place, times the area: what the edge across from it measures.
    fn weights(&self, at: [i64; 2]) -> [i64; 3] {
        [0, 1, 2].map(|k| edge(self.at[(k + 1) % 3], self.at[(k + 2) % 3], at))
    }
}

/// Positive where `at` is on the inner side of the edge from `a` to `b`.
fn edge(a: [i64; 2], b: [i64; 2], at: [i64; 2]) -> i64 {
    (b[0] - a[0]) * (at[1] - a[1]) - (b[1] - a[1]) * (at[0] - a[0])
}

/// The place of a sample's center, in parts of samples.
fn center(sample: i64) -> i64 {
    let parts = i64::from(PARTS);
    sample * parts + parts / 2
}

/// The samples of one band.
pub(super) struct Band {
    first_row: usize,
    /// Samples in a row.
    width: usize,
    near: Vec<f32>,
    triangles: Vec<u32>,
}

impl Band {
    /// Draws all triangles of a band of this size in pixels.
    pub(super) fn draw(
        scene: &Scene<'_>,
        bins: &Bins,
        band: usize,
        [width, height]: [usize; 2],
    ) -> Self {
        let samples = width * height * SAMPLES * SAMPLES;
        let mut drawn = Self {
            first_row: band * ROWS,
            width: width * SAMPLES,
            near: vec![f32::NEG_INFINITY; samples],
            triangles: vec![NONE; samples],
        };
        bins.band(band).for_each(|index| drawn.draw_triangle(scene, index));
        drawn
    }

    fn draw_triangle(&mut self, scene: &Scene<'_>, index: u32) {
        let triangle = scene.triangle(index as usize);
        let Some(outline) = Outline::new(scene, triangle) else { return };
        let first_row = self.first_row as i64;
        let rows = first_row + (self.near.len() / self.width) as i64;
        let [left, right] = outline.samples(0, self.width as i64);
        let [top, bottom] = outline.samples(1, rows);
        let parts = i64::from(PARTS);
        // A step to the next column changes the weight of a vertex by so much.
        let steps = [0, 1, 2].map(|k| {
            let (a, b) = (outline.at[(k + 1) % 3], outline.at[(k + 2) % 3]);
            (a[1] - b[1]) * parts
        });
        // A sample on an edge belongs to the triangle only if it is a left edge or a top one.
        let least = [0, 1, 2].map(|k| {
            let (a, b) = (outline.at[(k + 1) % 3], outline.at[(k + 2) % 3]);
            i64::from(!(b[1] < a[1] || (b[1] == a[1] && a[0] < b[0])))
        });
        let nears =
            outline.order.map(|k| f64::from(scene.spots[triangle.vertices[k] as usize].near));
        let near = |weights: [i64; 3]| {
            let sum: f64 = (0..3).map(|k| weights[k] as f64 * nears[k]).sum();
            sum / outline.area as f64
        };
        for row in top.max(first_row)..=bottom {
            let mut weights = outline.weights([center(left), center(row)]);
            let start = near(weights);
            let slope = near(steps);
            let offset = (row - first_row) as usize * self.width;
            for column in left..=right {
                if (0..3).all(|k| least[k] <= weights[k]) {
                    let sample = offset + column as usize;
                    let near = (start + slope * (column - left) as f64) as f32;
                    if self.near[sample] < near {
                        self.near[sample] = near;
                        self.triangles[sample] = index;
                    }
                }
                (0..3).for_each(|k| weights[k] += steps[k]);
            }
        }
    }

    /// A pixel (column, row of the band): the mean light of its samples.
    pub(super) fn resolve(
        &self,
        scene: &Scene<'_>,
        [column, row]: [usize; 2],
        background: [f32; 3],
    ) -> Rgb {
        let mut seen = [NONE; SAMPLES * SAMPLES];
        for (k, seen) in seen.iter_mut().enumerate() {
            let [x, y] = self.sample([column, row], k);
            *seen = self.triangles[y * self.width + x];
        }
        if seen == [NONE; SAMPLES * SAMPLES] {
            return light::srgb(background);
        }
        let mut light = [0.0; 3];
        for (k, &index) in seen.iter().enumerate() {
            if seen[..k].contains(&index) {
                continue;
            }
            let same = || (k..seen.len()).filter(|&other| seen[other] == index);
            let color = if index == NONE {
                background
            } else {
                self.shade(scene, index, same().map(|k| self.sample([column, row], k)))
            };
            let share = same().count() as f32 / seen.len() as f32;
            (0..3).for_each(|k| light[k] += share * color[k].clamp(0.0, 1.0));
        }
        light::srgb(light)
    }

    /// Column and row (in the band) of a pixel's `k`-th sample.
    fn sample(&self, [column, row]: [usize; 2], k: usize) -> [usize; 2] {
        [column * SAMPLES + k % SAMPLES, row * SAMPLES + k / SAMPLES]
    }

    /// The light of a triangle in the middle of some samples which it covers.
    fn shade(
        &self,
        scene: &Scene<'_>,
        index: u32,
        samples: impl Iterator<Item = [usize; 2]>,
    ) -> [f32; 3] {
        let triangle = scene.triangle(index as usize);
        let Some(outline) = Outline::new(scene, triangle) else { return [0.0; 3] };
        let mut sums = [0.0; 3];
        let mut count = 0.0;
        for [x, y] in samples {
            let weights = outline.weights([center(x as i64), center((self.first_row + y) as i64)]);
            (0..3).for_each(|k| sums[k] += weights[k] as f64);
            count += outline.area as f64;
        }
        let mut shares = [0.0; 3];
        (0..3).for_each(|k| shares[outline.order[k]] = sums[k] / count);
        scene.shade(triangle, shares, outline.is_inner())
    }
}
