//! Which triangle each sample sees.
//!
//! Vertices are rounded to sixteenths of samples, and edge functions are computed with whole numbers, so that a sample on an
//! edge that two triangles share belongs to exactly one of them: Pineda, "A parallel algorithm for polygon rasterization"
//! (1988), with the top-left rule.

use maquette_value::Rgb;
use maquette_value::parallel::*;
use maquette_value::simd::{Kernel, widest};

use super::camera::PARTS;
use super::light::{self, Light};
use super::scene::{Facet, Scene, Triangle};
use super::{BAND, SAMPLES, each, four};

/// Triangles that one task sorts into bands.
const CHUNK: usize = 16_384;

/// No triangle.
const NONE: u32 = u32::MAX;

/// Columns of pixels that are shaded together, in all rows of a band.
const TILE: usize = 32;

/// A bit for each sample of a pixel, row by row.
const ALL: u16 = 0b111_111_111;

/// Along columns and rows, the samples in the second and in the third place.
const AXES: [[u16; 2]; 2] = [[0b010_010_010, 0b100_100_100], [0b000_111_000, 0b111_000_000]];

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
        each(|k| edge(self.at[(k + 1) % 3], self.at[(k + 2) % 3], at))
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
        widest(Triangles { scene, indices: bins.band(band), into: &mut drawn });
        drawn
    }

    #[inline(always)]
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
        #[inline(always)]
        fn near(weights: [i64; 3], nears: [f64; 3], outline_area: i64) -> f64 {
            let [a, b, c] = each(|k| weights[k] as f64 * nears[k]);
            (a + b + c) / outline_area as f64
        }
        let slope = near(steps, nears, outline.area);
        for row in top.max(first_row)..=bottom {
            let weights = outline.weights([center(left), center(row)]);
            let Some([first, last]) = span(weights, steps, least, right - left) else { continue };
            let start = near(weights, nears, outline.area);
            let from = (row - first_row) as usize * self.width + left as usize;
            let samples = from + first as usize..=from + last as usize;
            let seen = self.near[samples.clone()].iter_mut().zip(&mut self.triangles[samples]);
            for (step, (nearest, triangle)) in (first as i32..).zip(seen) {
                let near = (start + slope * f64::from(step)) as f32;
                // Both are written always: wide vectors do not branch.
                (*nearest, *triangle) =
                    if *nearest < near { (near, index) } else { (*nearest, *triangle) };
            }
        }
    }

    /// The pixels of the band: each is the mean light of its samples. `background` is that of a row.
    pub(super) fn resolve(
        &self,
        scene: &Scene<'_>,
        background: impl Fn(usize) -> Light,
        pixels: &mut [Rgb],
    ) {
        widest(Pixels { samples: self, recent: Recent::new(scene), background, pixels });
    }
}

/// The triangles of a band, to be drawn.
struct Triangles<'a, I> {
    scene: &'a Scene<'a>,
    indices: I,
    into: &'a mut Band,
}

impl<I: Iterator<Item = u32>> Kernel for Triangles<'_, I> {
    #[inline(always)]
    fn run(self) {
        self.indices.for_each(|index| self.into.draw_triangle(self.scene, index));
    }
}

/// The pixels of a band, to be lit.
struct Pixels<'a, F> {
    samples: &'a Band,
    recent: Recent<'a>,
    background: F,
    pixels: &'a mut [Rgb],
}

impl<F: Fn(usize) -> Light> Kernel for Pixels<'_, F> {
    #[inline(always)]
    fn run(self) {
        let Self { samples: &Band { first_row, width, ref triangles, .. }, mut recent, .. } = self;
        let columns = width / SAMPLES;
        // Tile by tile, so that a triangle's rows of pixels follow each other.
        for left in (0..columns).step_by(TILE) {
            let right = columns.min(left + TILE);
            for (row, pixels) in self.pixels.chunks_exact_mut(columns).enumerate() {
                let pixels = &mut pixels[left..right];
                let background = (self.background)(row);
                let samples: [&[[u32; SAMPLES]]; SAMPLES] = each(|k| {
                    let first = (row * SAMPLES + k) * width;
                    triangles[first + SAMPLES * left..first + SAMPLES * right].as_chunks().0
                });
                if samples.iter().all(|row| row.as_flattened().iter().all(|&seen| seen == NONE)) {
                    pixels.fill(light::srgb(background));
                    continue;
                }
                for (pixel, rgb) in pixels.iter_mut().enumerate() {
                    let seen = each(|k| &samples[k][pixel]);
                    let place = [left + pixel, first_row / SAMPLES + row];
                    *rgb = light::srgb(recent.light(place, seen, background));
                }
            }
        }
    }
}

/// The triangles that were shown last, ready to be shaded: neighboring pixels show the same ones.
struct Recent<'a> {
    scene: &'a Scene<'a>,
    /// By the last bits of their numbers.
    shown: [Option<Shown<'a>>; 32],
}

impl<'a> Recent<'a> {
    fn new(scene: &'a Scene<'_>) -> Self {
        Self { scene, shown: [const { None }; 32] }
    }

    /// The mean light of the triangles that the samples of a pixel see, row by row.
    #[inline(always)]
    fn light(
        &mut self,
        pixel: [usize; 2],
        seen: [&[u32; SAMPLES]; SAMPLES],
        background: Light,
    ) -> Light {
        let mut light = [0.0; 4];
        let mut left = ALL;
        while left != 0 {
            let sample = left.trailing_zeros() as usize;
            let index = seen[sample / SAMPLES][sample % SAMPLES];
            let [a, b, c] = each(|row| {
                let [a, b, c] = each(|k| u16::from(seen[row][k] == index) << k);
                (a | b | c) << (SAMPLES * row)
            });
            let samples = a | b | c;
            left &= !samples;
            let color = match index {
                NONE => background,
                _ => self.get(index).light(pixel, samples),
            };
            let share = samples.count_ones() as f32 / (SAMPLES * SAMPLES) as f32;
            (0..4).for_each(|k| light[k] += share * color[k].clamp(0.0, 1.0));
        }
        light
    }

    #[inline(always)]
    fn get(&mut self, index: u32) -> &Shown<'a> {
        let place = &mut self.shown[index as usize % 32];
        if place.as_ref().is_some_and(|shown| shown.index != index) {
            *place = None;
        }
        place.get_or_insert_with(|| Shown::new(self.scene, index))
    }
}

/// A triangle that some pixels show.
struct Shown<'a> {
    index: u32,
    is_inner: bool,
    /// Twice its area, in squared parts of samples.
    area: f64,
    /// The edge across from each corner: where it starts, column and row of all corners, and how far it goes.
    from: [[f64; 4]; 2],
    along: [[f64; 4]; 2],
    facet: Facet<'a>,
}

impl<'a> Shown<'a> {
    fn new(scene: &'a Scene<'_>, index: u32) -> Self {
        let triangle = scene.triangle(index as usize);
        let outline = Outline::new(scene, triangle).expect("what was drawn has an area");
        let (mut from, mut along) = ([[0.0; 4]; 2], [[0.0; 4]; 2]);
        for k in 0..3 {
            let (a, b) = (outline.at[(k + 1) % 3], outline.at[(k + 2) % 3]);
            for axis in 0..2 {
                from[axis][outline.order[k]] = a[axis] as f64;
                along[axis][outline.order[k]] = (b[axis] - a[axis]) as f64;
            }
        }
        let (area, is_inner) = (outline.area as f64, outline.is_inner());
        Self { index, is_inner, area, from, along, facet: scene.facet(triangle) }
    }

    /// The light of the triangle in the middle of some of a pixel's samples, a bit each.
    #[inline(always)]
    fn light(&self, pixel: [usize; 2], samples: u16) -> Light {
        // The weights are linear, so that their sum over the samples is that of the sum of the places.
        let count = samples.count_ones();
        #[inline(always)]
        fn place(k: usize, samples: u16, count: u32, pixel: [usize; 2]) -> f64 {
            let [second, third] = AXES[k].map(|those| (samples & those).count_ones());
            let corner = i64::from(count) * center((pixel[k] * SAMPLES) as i64);
            (corner + i64::from(PARTS) * i64::from(second + 2 * third)) as f64
        }
        let (count, [column, row]) =
            (f64::from(count), [place(0, samples, count, pixel), place(1, samples, count, pixel)]);
        let area = count * self.area;
        let shares = four(|k| {
            let across = self.along[0][k] * (row - count * self.from[1][k]);
            (across - self.along[1][k] * (column - count * self.from[0][k])) / area
        });
        self.facet.shade(shares, self.is_inner)
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
