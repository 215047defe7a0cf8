//! Tests of rims: they are near the outlines of random shapes, and have no steps.

use maquette_image::{Connectivity, Shape, label, mask_shape};
use maquette_value::{Labels, RangeImage, Registration};
use nalgebra::Point3;

use super::super::contour::contours;
use super::super::footprint::{covered_cells, covered_fractions};
use super::*;

/// Number of columns and rows of the grid.
const SIZE: usize = 60;

/// Returns the rims of the largest part of a picture, drawn with `scale` pixels per cell, on a grid of `SIZE` cells.
fn rims_of(scale: usize, draw: impl Fn(f64, f64) -> bool) -> Vec<Vec<[f64; 2]>> {
    let pixels = SIZE * scale;
    let cell = |pixel: usize| (pixel as f64 + 0.5) / scale as f64 - 0.5;
    let picture = (0..pixels * pixels).map(|k| u32::from(draw(cell(k % pixels), cell(k / pixels))));
    let labels = Labels::new(pixels, pixels, picture.collect()).unwrap();
    let range = RangeImage::new(SIZE, SIZE, vec![Point3::new(0.0, 0.0, 1.0); SIZE * SIZE]).unwrap();
    let range = range.with_registration(Registration::corners([SIZE; 2], [pixels; 2]));
    let fractions = covered_fractions(&labels, 1, &range);
    let covered = covered_cells(SIZE, SIZE, &fractions);
    rims(SIZE, SIZE, covered.pixels(), &fractions, 1.0 / scale as f64)
}

/// Returns the largest distance of the points of a closed line from another one.
fn distance(from: &[[f64; 2]], to: &[[f64; 2]]) -> f64 {
    let nearest = from.iter().map(|&[x, y]| {
        let ends = to.iter().zip(to.iter().cycle().skip(1));
        let distances = ends.map(|(a, b)| {
            let (along, from_a) = ([b[0] - a[0], b[1] - a[1]], [x - a[0], y - a[1]]);
            let length_sq = along[0] * along[0] + along[1] * along[1];
            let share = (along[0] * from_a[0] + along[1] * from_a[1]) / length_sq;
            let share = if length_sq > 0.0 { share.clamp(0.0, 1.0) } else { 0.0 };
            libm::hypot(from_a[0] - share * along[0], from_a[1] - share * along[1])
        });
        distances.fold(f64::INFINITY, f64::min)
    });
    nearest.fold(0.0, f64::max)
}

/// Returns the largest angle between successive sides of a closed line after it is divided into sides of about one cell, in degrees.
fn largest_turn(line: &[[f64; 2]]) -> f64 {
    let ends = || line.iter().zip(line.iter().cycle().skip(1));
    let lengths = ends().map(|(a, b)| libm::hypot(b[0] - a[0], b[1] - a[1]));
    let length: f64 = lengths.clone().sum();
    let count = length.round().max(3.0);
    let mut even = Vec::new();
    let mut along = 0.0;
    for ((a, b), side) in ends().zip(lengths) {
        while (even.len() as f64) * length / count < along + side && (even.len() as f64) < count {
            let share = (even.len() as f64 * length / count - along) / side;
            even.push([0, 1].map(|k| a[k] + (b[k] - a[k]) * share));
        }
        along += side;
    }
    let n = even.len();
    let turns = (0..n).map(|k| {
        let [a, b, c] = [k, (k + 1) % n, (k + 2) % n].map(|k| even[k]);
        let [first, second] = [[b[0] - a[0], b[1] - a[1]], [c[0] - b[0], c[1] - b[1]]];
        let cross = first[0] * second[1] - first[1] * second[0];
        libm::atan2(cross, first[0] * second[0] + first[1] * second[1]).abs().to_degrees()
    });
    turns.fold(0.0, f64::max)
}

/// A generator of numbers from 0 to 1 (SplitMix64).
struct Random(u64);

impl Random {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ bits >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ bits >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        low + (high - low) * ((bits ^ bits >> 31) >> 11) as f64 / (1u64 << 53) as f64
    }
}

#[test]
fn rims_of_ellipses_have_no_steps() {
    let mut random = Random(1);
    for scale in [1, 2, 3] {
        for _ in 0..12 {
            let radii = [random.between(6.0, 25.0), random.between(6.0, 25.0)];
            let middle = [random.between(28.0, 31.0), random.between(28.0, 31.0)];
            let (sin, cos) = libm::sincos(random.between(0.0, 3.0));
            let on_axes = |x: f64, y: f64| {
                let (x, y) = (x - middle[0], y - middle[1]);
                [(cos * x + sin * y) / radii[0], (cos * y - sin * x) / radii[1]]
            };
            let rims = rims_of(scale, |x, y| {
                let [a, b] = on_axes(x, y);
                a * a + b * b <= 1.0
            });
            assert_eq!(rims.len(), 1);
            let truth: Vec<[f64; 2]> = (0..400)
                .map(|k| {
                    let (s, c) = libm::sincos(-f64::from(k) * std::f64::consts::TAU / 400.0);
                    let (a, b) = (c * radii[0], s * radii[1]);
                    [middle[0] + cos * a - sin * b, middle[1] + sin * a + cos * b]
                })
                .collect();
            let off = distance(&rims[0], &truth).max(distance(&truth, &rims[0]));
            let [low, high] = [radii[0].min(radii[1]), radii[0].max(radii[1])];
            let tightest = low * low / high;
            let turn = largest_turn(&rims[0]);
            let allowed = (1.0 / tightest).to_degrees() + if scale == 1 { 25.0 } else { 15.0 };
            assert!(off <= if scale == 1 { 0.6 } else { 0.4 }, "{scale} {radii:?}: {off}");
            assert!(turn <= allowed, "{scale} {radii:?}: {turn} {allowed}");
        }
    }
}

#[test]
fn rims_of_polygons_keep_their_corners() {
    let mut random = Random(2);
    for scale in [1, 2] {
        for _ in 0..8 {
            let at = [random.between(8.0, 12.0), random.between(8.0, 12.0)];
            let (sin, cos) = libm::sincos(random.between(0.0, 0.6));
            let l =
                [[0.0, 0.0], [12.0, 0.0], [12.0, 22.0], [30.0, 22.0], [30.0, 34.0], [0.0, 34.0]];
            check_corners(
                scale,
                &l.map(|[x, y]| [at[0] + 10.0 + cos * x - sin * y, at[1] + sin * x + cos * y]),
            );
            let star = (0..10).map(|k| {
                let (s, c) = libm::sincos(f64::from(k) * std::f64::consts::PI / 5.0 + at[0]);
                let radius = if k % 2 == 0 { 26.0 } else { 13.0 };
                [29.5 + radius * c, 29.5 + radius * s]
            });
            check_corners(scale, &star.collect::<Vec<_>>());
        }
    }
}

fn check_corners(scale: usize, corners: &[[f64; 2]]) {
    let shape =
        Shape::Polygon(corners.iter().map(|at| at.map(|x| (x + 0.5) * scale as f64)).collect());
    let mask = mask_shape(SIZE * scale, SIZE * scale, &shape, false);
    let rims =
        rims_of(scale, |x, y| mask.contains([x, y].map(|x| ((x + 0.5) * scale as f64) as usize)));
    let off = distance(&rims[0], corners);
    let corner = distance(corners, &rims[0]);
    // Where a pixel is as wide as a cell, the outline is known within a pixel only. Sharp tips lose what is narrower than a cell.
    assert!(off <= if scale == 1 { 0.8 } else { 0.5 }, "{scale} {corners:?}: {off}");
    assert!(corner <= 1.75, "{scale} {corners:?}: {corner}");
}

#[test]
fn rims_of_crescents_are_near_their_outlines() {
    let mut random = Random(4);
    for _ in 0..8 {
        let (inner, aside) = (random.between(12.0, 16.0), random.between(10.0, 14.0));
        let (sin, cos) = libm::sincos(random.between(0.0, 6.0));
        let circles = [([29.5, 29.5], 20.0), ([29.5 + aside * cos, 29.5 + aside * sin], inner)];
        let radius = |[x, y]: [f64; 2], k: usize| {
            let ([middle_x, middle_y], radius) = circles[k];
            libm::hypot(x - middle_x, y - middle_y) - radius
        };
        let rims = rims_of(2, |x, y| radius([x, y], 0) <= 0.0 && radius([x, y], 1) >= 0.0);
        let off = rims[0].iter().map(|&at| f64::min(radius(at, 0).abs(), radius(at, 1).abs()));
        let off = off.fold(0.0, f64::max);
        assert!(off <= 0.5, "{circles:?}: {off}");
    }
}

#[test]
fn each_contour_has_a_rim_around_the_same_area() {
    let mut random = Random(3);
    for _ in 0..20 {
        let cells: Vec<u8> = (0..400).map(|_| u8::from(random.between(0.0, 1.0) < 0.7)).collect();
        let mask = maquette_value::Mask::new(20, 20, cells).unwrap();
        let parts = label(&mask, Connectivity::Four);
        let largest = parts.by_area()[0];
        let inside: Vec<u8> =
            parts.pixels().iter().map(|&part| u8::from(part == largest)).collect();
        let covered: Vec<f64> = inside.iter().map(|&inside| f64::from(inside)).collect();
        let (contours, rims) = (contours(20, 20, &inside), rims(20, 20, &inside, &covered, 1.0));
        assert_eq!(contours.len(), rims.len());
        for (contour, rim) in contours.iter().zip(&rims) {
            let sides = rim.iter().zip(rim.iter().cycle().skip(1));
            let area: f64 = sides.map(|(a, b)| a[1] * b[0] - a[0] * b[1]).sum();
            assert_eq!(area < 0.0, contour.hole, "{area}");
            let near = contour.cells.iter().all(|&cell| {
                let at = [f64::from(cell % 20), f64::from(cell / 20)];
                distance(&[at], rim) <= 1.5
            });
            assert!(near, "a rim belongs to another contour");
        }
    }
}
