//! How rough a part of a surface is.

use maquette_base::topology::lists::Lists;
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::surface::{NONE, Surface};

/// Measures how rough a part of a surface is.
pub(super) struct Roughness<'a> {
    surface: &'a Surface<'a>,
    /// The part, and what is within so many edges of it as there are steps.
    vertices: Vec<u32>,
    /// How many vertices are in the part.
    count: usize,
    /// The places among the vertices of the neighbors of each.
    rings: Lists,
    /// The faces on both sides of the edges of the part.
    sides: Vec<[u32; 2]>,
}

/// Steps of smoothing, each halfway to the mean of the neighbors.
const STEPS: usize = 4;

impl<'a> Roughness<'a> {
    pub(super) fn new(surface: &'a Surface<'a>, part: Vec<u32>) -> Self {
        let count = part.len();
        let sides = sides(surface, &part);
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
        let rings = Lists::collect(vertices.iter().map(|&vertex| -> Vec<u32> {
            let ring = surface.ring(vertex).iter().map(|&other| place[other as usize]);
            ring.filter(|&other| other != NONE).collect()
        }));
        Self { surface, vertices, count, rings, sides }
    }

    /// How rough the part is, for comparisons: mostly by what lies within a few edges, partly by single edges. The former alone takes
    /// broad waves for fine ones; bends alone tell less of a place, and more of how its triangles lie.
    pub(super) fn of(&self, points: &[Point3<f64>]) -> f64 {
        let deviation = self.deviation(points);
        libm::cbrt(deviation * deviation * self.bend(points))
    }

    /// The mean distance of the vertices, along their normals, from where they are after some steps of smoothing.
    fn deviation(&self, points: &[Point3<f64>]) -> f64 {
        let mut smooth: Vec<Point3<f64>> =
            self.vertices.iter().map(|&vertex| points[vertex as usize]).collect();
        for _ in 0..STEPS {
            smooth = (0..smooth.len())
                .into_par_iter()
                .with_min_len(512)
                .map(|k: usize| {
                    let ring = self.rings.of(k);
                    let sum: Vector3<f64> =
                        ring.iter().map(|&j| smooth[j as usize] - smooth[k]).sum();
                    smooth[k] + sum / (2.0 * ring.len().max(1) as f64)
                })
                .collect();
        }
        (0..self.count)
            .map(|k: usize| {
                let vertex = self.vertices[k];
                let normal =
                    self.surface.area(points, vertex).try_normalize(0.0).unwrap_or_default();
                (points[vertex as usize] - smooth[k]).dot(&normal).abs()
            })
            .sum::<f64>()
            / self.count.max(1) as f64
    }

    /// The mean angle by which the edges bend.
    fn bend(&self, points: &[Point3<f64>]) -> f64 {
        self.sides
            .iter()
            .map(|pair| {
                let [a, b] = pair.map(|face: u32| {
                    let [a, b, c] =
                        self.surface.faces[face as usize].map(|end| points[end as usize]);
                    (b - a).cross(&(c - a))
                });
                libm::atan2(a.cross(&b).norm(), a.dot(&b))
            })
            .sum::<f64>()
            / self.sides.len().max(1) as f64
    }
}

/// The faces on both sides of the edges that have an end in `part`.
fn sides(surface: &Surface<'_>, part: &[u32]) -> Vec<[u32; 2]> {
    let mut is_in = vec![false; surface.len()];
    part.iter().for_each(|&vertex| is_in[vertex as usize] = true);
    let mut faces: Vec<u32> = part.iter().flat_map(|&v| surface.around(v)).copied().collect();
    faces.sort_unstable();
    faces.dedup();
    let is_in = &is_in;
    let sides = faces.iter().flat_map(|&face| {
        let ends = surface.faces[face as usize];
        let touches =
            move |k: &usize| is_in[ends[*k] as usize] || is_in[ends[(k + 1) % 3] as usize];
        (0..3).filter(touches).map(move |k| [face, surface.beside(face, k).face])
    });
    sides.filter(|[face, other]| *other != NONE && face < other).collect()
}
