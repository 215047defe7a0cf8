//! Which triangle each sample sees.
//!
//! Vertices are rounded to sixteenths of samples, and edge functions are computed with whole numbers, so that a sample on an
//! edge that two triangles share belongs to exactly one of them: Pineda, "A parallel algorithm for polygon rasterization"
//! (1988), with the top-left rule.

use rayon::prelude::*;

use super::camera::PARTS;
use super::scene::{Facet, Scene, Triangle};
use super::{BAND, SAMPLES, each, light};
use crate::value::Rgb;

/// Triangles that one task sorts into bands.
const CHUNK: usize = 16_384;

/// No triangle: all bits are set.
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
        let at = each(|k| {
            let [column, row] = scene.spots[triangle.vertices[k] as usize].at;
            [i64::from(column), i64::from(row)]
        });
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
        let [a, b, c] = each(|k| self.at[k][axis] - parts / 2);
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        [(low + parts - 1).div_euclid(parts).max(0), high.div_euclid(parts).min(count - 1)]
    }

    /// How much each vertex weighs at a place, times the area: what the edge across from it measures.
    fn weights(&self, at: [i64; 2]) -> [i64; 3] {
        self.summed_weights(at, 1)
    }

    /// The sum of the weights at so many places, of which `at` is the sum.
    fn summed_weights(&self, at: [i64; 2], count: i64) -> [i64; 3] {
        each(|k| {
            let (a, b) = (self.at[(k + 1) % 3], self.at[(k + 2) % 3]);
            (b[0] - a[0]) * (at[1] - count * a[1]) - (b[1] - a[1]) * (at[0] - count * a[0])
        })
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
        let steps = each(|k| {
            let (a, b) = (outline.at[(k + 1) % 3], outline.at[(k + 2) % 3]);
            (a[1] - b[1]) * parts
        });
        // A sample on an edge belongs to the triangle only if it is a left edge or a top one.
        let least = each(|k| {
            let (a, b) = (outline.at[(k + 1) % 3], outline.at[(k + 2) % 3]);
            i64::from(!(b[1] < a[1] || (b[1] == a[1] && a[0] < b[0])))
        });
        let nears =
            each(|k| f64::from(scene.spots[triangle.vertices[outline.order[k]] as usize].near));
        let near = |weights: [i64; 3]| {
            let [a, b, c] = each(|k| weights[k] as f64 * nears[k]);
            (a + b + c) / outline.area as f64
        };
        let slope = near(steps);
        for row in top.max(first_row)..=bottom {
            let weights = outline.weights([center(left), center(row)]);
            let Some([first, last]) = span(weights, steps, least, right - left) else { continue };
            let start = near(weights);
            let from = (row - first_row) as usize * self.width + left as usize;
            let samples = from + first as usize..=from + last as usize;
            let seen = self.near[samples.clone()].iter_mut().zip(&mut self.triangles[samples]);
            for (step, (nearest, triangle)) in (first..).zip(seen) {
                let near = (start + slope * step as f64) as f32;
                if *nearest < near {
                    *nearest = near;
                    *triangle = index;
                }
            }
        }
    }

    /// The pixels of a row of the band: each is the mean light of its samples.
    pub(super) fn resolve(
        &self,
        scene: &Scene<'_>,
        row: usize,
        background: [f32; 3],
        pixels: &mut [Rgb],
    ) {
        let empty = light::srgb(background);
        let rows: [&[[u32; SAMPLES]]; SAMPLES] = std::array::from_fn(|k| {
            let first = (row * SAMPLES + k) * self.width;
            self.triangles[first..first + self.width].as_chunks().0
        });
        let mut last: Option<Shown<'_>> = None;
        for (column, pixel) in pixels.iter_mut().enumerate() {
            let seen = each(|k| rows[k][column]);
            if seen.as_flattened().iter().fold(NONE, |all, triangle| all & triangle) == NONE {
                *pixel = empty;
                continue;
            }
            let mut light = [0.0; 3];
            for (k, &index) in seen.as_flattened().iter().enumerate() {
                if seen.as_flattened()[..k].contains(&index) {
                    continue;
                }
                let (count, shift) = place(&seen, index);
                let color = if index == NONE {
                    background
                } else {
                    if last.as_ref().is_some_and(|shown| shown.index != index) {
                        last = None;
                    }
                    let shown = last.get_or_insert_with(|| Shown::new(scene, index));
                    shown.light([column, self.first_row / SAMPLES + row], count, shift)
                };
                let share = count as f32 / (SAMPLES * SAMPLES) as f32;
                (0..3).for_each(|k| light[k] += share * color[k].clamp(0.0, 1.0));
            }
            *pixel = light::srgb(light);
        }
    }
}

/// How many of a pixel's samples see a triangle, and the sums of their columns and rows in the pixel.
fn place(seen: &[[u32; SAMPLES]; SAMPLES], index: u32) -> (i64, [i64; 2]) {
    let (mut count, mut sums) = (0, [0; 2]);
    for (y, row) in seen.iter().enumerate() {
        for (x, &triangle) in row.iter().enumerate() {
            let sees = i64::from(triangle == index);
            count += sees;
            sums[0] += sees * x as i64;
            sums[1] += sees * y as i64;
        }
    }
    (count, sums)
}

/// A triangle that some pixels in a row show.
struct Shown<'a> {
    index: u32,
    outline: Outline,
    facet: Facet<'a>,
}

impl<'a> Shown<'a> {
    fn new(scene: &'a Scene<'_>, index: u32) -> Self {
        let triangle = scene.triangle(index as usize);
        let outline = Outline::new(scene, triangle).expect("what was drawn has an area");
        Self { index, outline, facet: scene.facet(triangle) }
    }

    /// The light of the triangle in the middle of so many samples of a pixel, whose columns and rows in it sum up to this.
    fn light(&self, pixel: [usize; 2], count: i64, sums: [i64; 2]) -> [f32; 3] {
        // The weights are linear, so that their sum over the samples is that of the sum of the places.
        let parts = i64::from(PARTS);
        let at = |k| count * center((pixel[k] * SAMPLES) as i64) + parts * sums[k];
        let sums = self.outline.summed_weights([at(0), at(1)], count);
        let area = (count * self.outline.area) as f64;
        let mut shares = [0.0; 3];
        (0..3).for_each(|k| shares[self.outline.order[k]] = sums[k] as f64 / area);
        self.facet.shade(shares, self.outline.is_inner())
    }
}

/// The first and the last step from 0 to `most` at which no weight is below its least; none if there is no such step.
fn span(weights: [i64; 3], steps: [i64; 3], least: [i64; 3], most: i64) -> Option<[i64; 2]> {
    let (mut first, mut last) = (0, most);
    for k in 0..3 {
        let missing = least[k] - weights[k];
        match steps[k] {
            0 if missing > 0 => return None,
            0 => {}
            step @ 1.. => first = first.max((missing + step - 1).div_euclid(step)),
            step => last = last.min((-missing).div_euclid(-step)),
        }
    }
    (first <= last).then_some([first, last])
}
