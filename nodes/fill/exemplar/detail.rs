//! The fine detail of exemplars, which the mean of many of them has lost.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::exemplars::Exemplars;
use super::level::Outcome;
use super::lists::Lists;
use super::search::Turns;
use super::spread::Plate;
use super::surface::{NONE, Surface};

/// How strongly the shape holds against the detail. Waves of some 14 edges and longer stay as they are, shorter ones become those of
/// the exemplars: ten times as much takes bumps of 9 edges for shape and leaves them flat, a tenth lets the detail bend the whole.
const HOLD: f64 = 0.1;

/// The most by which detail is amplified.
const MOST: f64 = 3.0;

/// Halvings in which the amplification is found.
const HALVINGS: usize = 8;

/// Patches beside that of a vertex whose exemplars have a say about its detail. Without any, vertices differ from their neighbors more
/// than data do, since each has another exemplar: the sharpest tenth of the edges is a fourth too sharp. With two or more, what is
/// nearly flat gets flatter by about a fifth.
const BESIDE: usize = 1;

/// Moves the missing vertices along their normals until each lies over or under the mean of its neighbors as its exemplars do, as
/// far as that is a matter of few edges. Detail that comes out fainter than that `around` the hole is amplified: matches are chosen
/// by what is there, which has little.
///
/// This is the equation of a thin plate whose rest shape is bent: Botsch and Sorkine, "On linear variational surface deformation
/// methods" (2008), section 4.
pub(super) fn add_detail(
    surface: &Surface<'_>,
    points: &mut [Point3<f64>],
    exemplars: &Exemplars,
    outcome: &Outcome,
    turns: &Turns,
    around: Vec<u32>,
) {
    let (count, missing) = (points.len(), outcome.patches.movable);
    let data = exemplars.owners.len();
    if missing < count - data {
        return;
    }
    let (mut change, mut wanted) = (vec![0.0; count], vec![0.0; count]);
    let mut normals = vec![Vector3::zeros(); count];
    let each = outcome.patches.sites.iter().zip(&outcome.frames).zip(&outcome.matches);
    for (center, ((&vertex, frame), found)) in each.enumerate() {
        let at = vertex as usize;
        normals[at] = frame.z;
        if found.exemplar != NONE {
            let degree = surface.ring(vertex).len() as f64;
            let near = outcome.patches.near.of(center).iter().take(BESIDE);
            let near = near.map(|&near| near as usize).chain([center]);
            let copied = near.filter(|&near| outcome.matches[near].exemplar != NONE);
            let (mut sum, mut count) = (0.0, 0.0);
            for near in copied {
                let found = &outcome.matches[near];
                let from = exemplars.vertices[found.exemplar as usize];
                let to = exemplars.place(found, turns, &outcome.frames[near], points[at]);
                let source = surface.descend(points, from, &to, data as u32);
                sum += over(surface, points, source, &exemplars.frames[found.exemplar as usize].z);
                count += 1.0;
            }
            wanted[at] = degree * sum / count;
            change[at] = wanted[at] - degree * over(surface, points, vertex, &frame.z);
        }
    }
    let Some(plate) = Plate::new(surface, count, data, |_| HOLD) else { return };
    let [once, more] = [change, wanted].map(|wanted| plate.solve(plate.load(&wanted)));
    let goal = Roughness::new(surface, around).of(points);
    let filled = Roughness::new(surface, (data as u32..count as u32).collect());
    let start = points[data..].to_vec();
    let mut try_times = |times: f64| {
        for (k, start) in start.iter().enumerate() {
            let far = once[k][0] + (times - 1.0) * more[k][0];
            points[data + k] = start + normals[data + k] * far;
        }
        filled.of(points)
    };
    if try_times(1.0) < goal {
        let (mut low, mut high) = (1.0, MOST);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            *if try_times(middle) < goal { &mut low } else { &mut high } = middle;
        }
        try_times(low);
    }
}

/// Measures how rough a part of a surface is: the mean distance of its vertices, along their normals, from where they are after some
/// steps of smoothing.
struct Roughness<'a> {
    surface: &'a Surface<'a>,
    /// The part, and what is within so many edges of it as there are steps.
    vertices: Vec<u32>,
    /// How many vertices are in the part.
    count: usize,
    /// The places among the vertices of the neighbors of each.
    rings: Lists,
}

/// Steps of smoothing, each halfway to the mean of the neighbors.
const STEPS: usize = 4;

impl<'a> Roughness<'a> {
    fn new(surface: &'a Surface<'a>, part: Vec<u32>) -> Self {
        let count = part.len();
        let mut vertices = part;
        let mut place = vec![NONE; surface.len()];
        (0..).zip(&vertices).for_each(|(k, &vertex)| place[vertex as usize] = k);
        let mut start = 0;
        for _ in 0..STEPS {
            let end = vertices.len();
            for k in start..end {
                for &other in surface.ring(vertices[k]) {
                    if place[other as usize] == NONE {
                        place[other as usize] = vertices.len() as u32;
                        vertices.push(other);
                    }
                }
            }
            start = end;
        }
        let ring = |&vertex: &u32| -> Vec<u32> {
            let ring = surface.ring(vertex).iter().map(|&other| place[other as usize]);
            ring.filter(|&other| other != NONE).collect()
        };
        let rings = Lists::collect(vertices.iter().map(ring));
        Self { surface, vertices, count, rings }
    }

    fn of(&self, points: &[Point3<f64>]) -> f64 {
        let place = |&vertex: &u32| points[vertex as usize];
        let mut smooth: Vec<Point3<f64>> = self.vertices.iter().map(place).collect();
        for _ in 0..STEPS {
            let step = |k: usize| {
                let ring = self.rings.of(k);
                let sum: Vector3<f64> = ring.iter().map(|&j| smooth[j as usize] - smooth[k]).sum();
                smooth[k] + sum / (2.0 * ring.len().max(1) as f64)
            };
            smooth = (0..smooth.len()).into_par_iter().with_min_len(512).map(step).collect();
        }
        let off = |k: usize| {
            let vertex = self.vertices[k];
            let normal = self.surface.area(points, vertex).try_normalize(0.0).unwrap_or_default();
            (points[vertex as usize] - smooth[k]).dot(&normal).abs()
        };
        (0..self.count).map(off).sum::<f64>() / self.count.max(1) as f64
    }
}

/// How far a vertex is over the mean of its neighbors, along a normal.
fn over(surface: &Surface<'_>, points: &[Point3<f64>], vertex: u32, normal: &Vector3<f64>) -> f64 {
    let ring = surface.ring(vertex);
    let spokes = ring.iter().map(|&other| points[vertex as usize] - points[other as usize]);
    spokes.sum::<Vector3<f64>>().dot(normal) / ring.len().max(1) as f64
}
