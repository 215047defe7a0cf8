//! Measures the roughness of a part of a surface.

use maquette_base::topology::lists::Lists;
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::surface::{NONE, Surface};

/// A part of a surface, prepared for measuring its roughness.
pub(super) struct Roughness<'a> {
    surface: &'a Surface<'a>,
    /// The vertices of the part, followed by other vertices within [`STEPS`] edges of it.
    vertices: Vec<u32>,
    /// The number of vertices in the part.
    count: usize,
    /// For each vertex, the indices of its neighbors among `vertices`.
    rings: Lists,
    /// The two faces of each edge that has an end in the part.
    sides: Vec<[u32; 2]>,
}

/// Number of smoothing steps. In each step, vertices move halfway to the mean of their neighbors.
const STEPS: usize = 4;

impl<'a> Roughness<'a> {
    pub(super) fn new(surface: &'a Surface<'a>, part: Vec<u32>) -> Self {
        let count = part.len();
        let sides = sides(surface, &part);
        let mut vertices = part;
        let mut index_of = vec![NONE; surface.len()];
        (0..).zip(&vertices).for_each(|(k, &vertex)| index_of[vertex as usize] = k);
        let mut start = 0;
        for _ in 0..STEPS {
            let end = vertices.len();
            for k in start..end {
                for &other in surface.ring(vertices[k]) {
                    if index_of[other as usize] == NONE {
                        index_of[other as usize] = vertices.len() as u32;
                        vertices.push(other);
                    }
                }
            }
            start = end;
        }
        let rings = Lists::collect(vertices.iter().map(|&vertex| -> Vec<u32> {
            let ring = surface.ring(vertex).iter().map(|&other| index_of[other as usize]);
            ring.filter(|&other| other != NONE).collect()
        }));
        Self { surface, vertices, count, rings, sides }
    }

    /// Returns a measure of roughness for comparisons. It consists of the deviation from the smoothed surface, weighted more, and the
    /// bending of edges. The deviation alone cannot distinguish broad waves from fine ones; the bending alone depends more on the
    /// triangulation than on the surface.
    pub(super) fn measure(&self, points: &[Point3<f64>]) -> f64 {
        let deviation = self.deviation(points);
        libm::cbrt(deviation * deviation * self.bend(points))
    }

    /// Returns the mean distance, along the normals, between the vertices and their positions after smoothing.
    fn deviation(&self, points: &[Point3<f64>]) -> f64 {
        let mut smooth: Vec<Point3<f64>> =
            self.vertices.iter().map(|&vertex| points[vertex as usize]).collect();
        for _ in 0..STEPS {
            smooth = (0..smooth.len())
                .into_par_iter()
                .with_min_len(512)
                .map(|k: usize| {
                    let ring = self.rings.list(k);
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

    /// Returns the mean absolute dihedral angle of the edges.
    fn bend(&self, points: &[Point3<f64>]) -> f64 {
        self.sides
            .iter()
            .map(|pair| {
                let [a, b] = pair.map(|face: u32| {
                    let [a, b, c] = self.surface.corners(points, face);
                    (b - a).cross(&(c - a))
                });
                libm::atan2(a.cross(&b).norm(), a.dot(&b))
            })
            .sum::<f64>()
            / self.sides.len().max(1) as f64
    }
}

/// Returns the two faces of each edge with an end in `part`.
fn sides(surface: &Surface<'_>, part: &[u32]) -> Vec<[u32; 2]> {
    let mut is_in = vec![false; surface.len()];
    part.iter().for_each(|&vertex| is_in[vertex as usize] = true);
    let mut faces: Vec<u32> = part.iter().flat_map(|&v| surface.faces_around(v)).copied().collect();
    faces.sort_unstable();
    faces.dedup();
    let is_in = &is_in;
    let sides = faces.iter().flat_map(|&face| {
        let ends = surface.faces[face as usize];
        (0..3)
            .filter(move |k| is_in[ends[*k] as usize] || is_in[ends[(k + 1) % 3] as usize])
            .map(move |k| [face, surface.adjacent_face(face, k).face])
    });
    sides.filter(|[face, other]| *other != NONE && face < other).collect()
}
