//! Rasterization: determines which triangle is visible at each sample.
//!
//! Vertices are rounded to sixteenths of a sample. So edge functions are integers, and their signs are exact. These signs and the top-left
//! rule decide for each sample on a shared edge to which of the two triangles it belongs: Pineda, "A parallel algorithm for polygon
//! rasterization" (1988).

use maquette_value::Rgb;
use maquette_value::parallel::*;
use maquette_value::simd::{Kernel, widest};

use super::camera::PARTS;
use super::light::{self, Light};
use super::scene::{Facet, Scene, Triangle};
use super::{BAND, SAMPLES, array3, array4};

/// The number of triangles that one task sorts into bands.
const CHUNK: usize = 16_384;

/// The index that means "no triangle".
const NONE: u32 = u32::MAX;

/// The width of a tile, in pixels. The pixels of a tile are shaded together. A tile is as high as a band.
const TILE: usize = 32;

/// The bit mask that contains all nine samples of a pixel. The bits of such masks are in the order of the samples, row by row.
const ALL_SAMPLES: u16 = 0b111_111_111;

/// The bit masks of the samples in the second and third column, and of those in the second and third row.
const SAMPLE_COLUMNS_AND_ROWS: [[u16; 2]; 2] =
    [[0b010_010_010, 0b100_100_100], [0b000_111_000, 0b111_000_000]];

/// The number of rows of samples in a band.
const SAMPLE_ROWS: usize = BAND * SAMPLES;

/// The triangles that overlap each band.
pub(super) struct Bins {
    /// The indices of the triangles, grouped first by chunk and then by band. In each group they are in ascending order.
    chunks: Vec<Vec<Vec<u32>>>,
}

impl Bins {
    pub(super) fn new(scene: &Scene<'_>, height: usize) -> Self {
        let chunks = (0..scene.len().div_ceil(CHUNK)).into_par_iter();
        Self { chunks: chunks.map(|chunk| Self::sort_chunk(scene, height, chunk)).collect() }
    }

    /// Finds, for each band, those triangles of one chunk that overlap the band.
    fn sort_chunk(scene: &Scene<'_>, height: usize, chunk: usize) -> Vec<Vec<u32>> {
        let mut bins = vec![vec![]; height.div_ceil(BAND)];
        for index in chunk * CHUNK..scene.len().min((chunk + 1) * CHUNK) {
            let outline = Outline::new(scene, scene.triangle(index));
            if let Some(outline) = outline {
                let [first, last] = outline.samples(1, (height * SAMPLES) as i64);
                if first <= last {
                    let touched = first as usize / SAMPLE_ROWS..=last as usize / SAMPLE_ROWS;
                    bins[touched].iter_mut().for_each(|bin| bin.push(index as u32));
                }
            }
        }
        bins
    }

    fn band(&self, band: usize) -> impl Iterator<Item = u32> {
        self.chunks.iter().flat_map(move |bins| &bins[band]).copied()
    }
}

/// A projected triangle. Its vertices are in an order that makes the area positive.
struct Outline {
    /// The column and row of each vertex, in parts of samples.
    at: [[i64; 2]; 3],
    /// The index of each vertex in the original triangle. If the viewer sees the outer side, the second and third are exchanged.
    order: [usize; 3],
    /// Twice the area of the projected triangle, in squares of parts of samples.
    area: i64,
}

impl Outline {
    /// Projects a triangle. Returns `None` if its projected area is 0, because the viewer sees it edge-on.
    fn new(scene: &Scene<'_>, triangle: Triangle) -> Option<Self> {
        let at = array3(|k| {
            let [column, row] = scene.projected[triangle.vertices[k] as usize].position;
            [i64::from(column), i64::from(row)]
        });
        let area = edge(at[0], at[1], at[2]);
        // Rows count downwards, so a triangle that is counter-clockwise for the viewer has a negative area.
        match area {
            0 => None,
            1.. => Some(Self { at, order: [0, 1, 2], area }),
            _ => Some(Self { at: [at[0], at[2], at[1]], order: [0, 2, 1], area: -area }),
        }
    }

    /// Returns true if the viewer sees the inner side of the triangle.
    fn is_inner(&self) -> bool {
        self.order[1] == 1
    }

    /// Returns the first and the last sample along an axis (0 for columns, 1 for rows) whose centers may be inside of the triangle. The
    /// axis has `count` samples.
    fn samples(&self, axis: usize, count: i64) -> [i64; 2] {
        let parts = i64::from(PARTS);
        let [a, b, c] = array3(|k| self.at[k][axis] - parts / 2);
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        [(low + parts - 1).div_euclid(parts).max(0), high.div_euclid(parts).min(count - 1)]
    }

    /// Returns the barycentric coordinates of a position, multiplied by twice the area of the triangle. Each coordinate is the edge
    /// function of the edge opposite to a vertex.
    fn weights(&self, at: [i64; 2]) -> [i64; 3] {
        array3(|k| edge(self.at[(k + 1) % 3], self.at[(k + 2) % 3], at))
    }
}

/// Returns the edge function of the edge from `a` to `b`. It is positive if `at` is on the inner side of the edge.
fn edge(a: [i64; 2], b: [i64; 2], at: [i64; 2]) -> i64 {
    (b[0] - a[0]) * (at[1] - a[1]) - (b[1] - a[1]) * (at[0] - a[0])
}

/// Returns the position of a sample's center along an axis, in parts of samples.
fn center(sample: i64) -> i64 {
    let parts = i64::from(PARTS);
    sample * parts + parts / 2
}

/// The samples of one band of pixel rows. Each sample stores the nearest triangle.
pub(super) struct Band {
    first_row: usize,
    /// The number of samples per row.
    width: usize,
    near: Vec<f32>,
    triangles: Vec<u32>,
}

impl Band {
    /// Draws all triangles of a band. `width` and `height` of the band are in pixels.
    pub(super) fn draw(
        scene: &Scene<'_>,
        bins: &Bins,
        band: usize,
        [width, height]: [usize; 2],
    ) -> Self {
        let samples = width * height * SAMPLES * SAMPLES;
        let mut drawn = Self {
            first_row: band * SAMPLE_ROWS,
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
        // The change of each barycentric coordinate (weight) from one column of samples to the next.
        let steps = array3(|k| {
            let (a, b) = (outline.at[(k + 1) % 3], outline.at[(k + 2) % 3]);
            (a[1] - b[1]) * parts
        });
        // The top-left rule: a sample on an edge belongs to the triangle only if the edge is a left or a top one.
        let min_weights = array3(|k| {
            let (a, b) = (outline.at[(k + 1) % 3], outline.at[(k + 2) % 3]);
            i64::from(!(b[1] < a[1] || (b[1] == a[1] && a[0] < b[0])))
        });
        let nears = array3(|k| {
            f64::from(scene.projected[triangle.vertices[outline.order[k]] as usize].near)
        });
        #[inline(always)]
        fn interpolate(weights: [i64; 3], nears: [f64; 3], outline_area: i64) -> f64 {
            let [a, b, c] = array3(|k| weights[k] as f64 * nears[k]);
            (a + b + c) / outline_area as f64
        }
        let slope = interpolate(steps, nears, outline.area);
        for row in top.max(first_row)..=bottom {
            let weights = outline.weights([center(left), center(row)]);
            let Some([first, last]) = span(weights, steps, min_weights, right - left) else {
                continue;
            };
            let start = interpolate(weights, nears, outline.area);
            let from = (row - first_row) as usize * self.width + left as usize;
            let samples = from + first as usize..=from + last as usize;
            let seen = self.near[samples.clone()].iter_mut().zip(&mut self.triangles[samples]);
            for (step, (nearest, triangle)) in (first as i32..).zip(seen) {
                let near = (start + slope * f64::from(step)) as f32;
                // Always write both values, without a branch, so that the compiler can use vector instructions.
                (*nearest, *triangle) =
                    if *nearest < near { (near, index) } else { (*nearest, *triangle) };
            }
        }
    }

    /// Computes the pixels of the band. Each pixel is the mean of the light of its samples. `background` returns the background color of a
    /// row.
    pub(super) fn resolve(
        &self,
        scene: &Scene<'_>,
        background: impl Fn(usize) -> Light,
        pixels: &mut [Rgb],
    ) {
        widest(Pixels { samples: self, cache: TriangleCache::new(scene), background, pixels });
    }
}

/// The loop that draws the triangles of a band, compiled for several instruction sets.
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

/// The loop that shades the pixels of a band, compiled for several instruction sets.
struct Pixels<'a, F> {
    samples: &'a Band,
    cache: TriangleCache<'a>,
    background: F,
    pixels: &'a mut [Rgb],
}

impl<F: Fn(usize) -> Light> Kernel for Pixels<'_, F> {
    #[inline(always)]
    fn run(self) {
        let Self { samples: &Band { first_row, width, ref triangles, .. }, mut cache, .. } = self;
        let columns = width / SAMPLES;
        // Shade tile by tile, so that pixels of the same triangle are shaded one after the other.
        for left in (0..columns).step_by(TILE) {
            let right = columns.min(left + TILE);
            for (row, pixels) in self.pixels.chunks_exact_mut(columns).enumerate() {
                let pixels = &mut pixels[left..right];
                let background = (self.background)(row);
                let samples: [&[[u32; SAMPLES]]; SAMPLES] = array3(|k| {
                    let first = (row * SAMPLES + k) * width;
                    triangles[first + SAMPLES * left..first + SAMPLES * right].as_chunks().0
                });
                if samples.iter().all(|row| row.as_flattened().iter().all(|&seen| seen == NONE)) {
                    pixels.fill(light::srgb(background));
                    continue;
                }
                for (pixel, rgb) in pixels.iter_mut().enumerate() {
                    let seen = array3(|k| &samples[k][pixel]);
                    let position = [left + pixel, first_row / SAMPLES + row];
                    *rgb = light::srgb(cache.light(position, seen, background));
                }
            }
        }
    }
}

/// A cache of recently shaded triangles. It is useful because neighboring pixels often show the same triangle.
struct TriangleCache<'a> {
    scene: &'a Scene<'a>,
    /// The cached triangles. The position of a triangle in this array is given by the last five bits of its index in the scene.
    entries: [Option<ShadedTriangle<'a>>; 32],
}

impl<'a> TriangleCache<'a> {
    fn new(scene: &'a Scene<'_>) -> Self {
        Self { scene, entries: [const { None }; 32] }
    }

    /// Returns the mean light of a pixel. `seen` contains the visible triangle of each sample of the pixel, row by row.
    #[inline(always)]
    fn light(
        &mut self,
        pixel: [usize; 2],
        seen: [&[u32; SAMPLES]; SAMPLES],
        background: Light,
    ) -> Light {
        let mut light = [0.0; 4];
        let mut left = ALL_SAMPLES;
        while left != 0 {
            let sample = left.trailing_zeros() as usize;
            let index = seen[sample / SAMPLES][sample % SAMPLES];
            let [a, b, c] = array3(|row| {
                let [a, b, c] = array3(|k| u16::from(seen[row][k] == index) << k);
                (a | b | c) << (SAMPLES * row)
            });
            let samples = a | b | c;
            left &= !samples;
            let color = match index {
                NONE => background,
                _ => self.get(index).light(pixel, samples),
            };
            let fraction = samples.count_ones() as f32 / (SAMPLES * SAMPLES) as f32;
            (0..4).for_each(|k| light[k] += fraction * color[k].clamp(0.0, 1.0));
        }
        light
    }

    #[inline(always)]
    fn get(&mut self, index: u32) -> &ShadedTriangle<'a> {
        let entry = &mut self.entries[index as usize % 32];
        if entry.as_ref().is_some_and(|shown| shown.index != index) {
            *entry = None;
        }
        entry.get_or_insert_with(|| ShadedTriangle::new(self.scene, index))
    }
}

/// A visible triangle, with the data for shading it.
struct ShadedTriangle<'a> {
    index: u32,
    is_inner: bool,
    /// Twice the area of the projected triangle, in squares of parts of samples.
    area: f64,
    /// The edges in the picture, each opposite to a corner of the triangle: `from` is where they start, and `along` is the vector from
    /// start to end. Both contain first the columns of all edges, then the rows.
    from: [[f64; 4]; 2],
    along: [[f64; 4]; 2],
    facet: Facet<'a>,
}

impl<'a> ShadedTriangle<'a> {
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

    /// Returns the light of the triangle at the mean position of some samples of a pixel. `samples` is a mask with one bit per sample.
    #[inline(always)]
    fn light(&self, pixel: [usize; 2], samples: u16) -> Light {
        // Barycentric coordinates are linear in the position. So compute their sum over all samples from the sum of the samples' positions.
        let count = samples.count_ones();
        #[inline(always)]
        fn sum_of_positions(k: usize, samples: u16, count: u32, pixel: [usize; 2]) -> f64 {
            let [second, third] =
                SAMPLE_COLUMNS_AND_ROWS[k].map(|those| (samples & those).count_ones());
            let corner = i64::from(count) * center((pixel[k] * SAMPLES) as i64);
            (corner + i64::from(PARTS) * i64::from(second + 2 * third)) as f64
        }
        let (count, [column, row]) = (
            f64::from(count),
            [
                sum_of_positions(0, samples, count, pixel),
                sum_of_positions(1, samples, count, pixel),
            ],
        );
        let area = count * self.area;
        let barycentric = array4(|k| {
            let across = self.along[0][k] * (row - count * self.from[1][k]);
            (across - self.along[1][k] * (column - count * self.from[0][k])) / area
        });
        self.facet.shade(barycentric, self.is_inner)
    }
}

/// Returns the first and the last step, from 0 to `max_step`, at which each weight is at least as large as its minimum. Returns `None` if
/// there is no such step.
fn span(
    weights: [i64; 3],
    steps: [i64; 3],
    min_weights: [i64; 3],
    max_step: i64,
) -> Option<[i64; 2]> {
    let (mut first, mut last) = (0, max_step);
    for k in 0..3 {
        let missing = min_weights[k] - weights[k];
        match steps[k] {
            0 if missing > 0 => return None,
            0 => {}
            step @ 1.. => first = first.max((missing + step - 1).div_euclid(step)),
            step => last = last.min((-missing).div_euclid(-step)),
        }
    }
    (first <= last).then_some([first, last])
}
