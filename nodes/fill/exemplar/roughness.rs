//! Measures the roughness of a part of a surface.

use maquette_base::topology::lists::Lists;
use nalgebra::{Point3, Vector3};

use super::relief::smooth;
use super::surface::{NONE, Surface};

/// A part of a surface, prepared for measuring its roughness.
pub(super) struct Roughness<'a> {
    surface: &'a Surface<'a>,
    /// The vertices of the part, followed by other vertices within [`STEPS`] edges of it.
    vertices: Vec<u32>,
    /// The weights of the vertices in the part.
    weights: Vec<f64>,
    /// For each vertex, the indices of its neighbors among `vertices`.
    rings: Lists,
    /// The edges that have an end in the part.
    edges: Vec<WeightedEdge>,
}

/// Number of smoothing steps. In each step, vertices move halfway to the mean of their neighbors.
const STEPS: usize = 4;

impl<'a> Roughness<'a> {
    /// Creates the measure for some vertices and their weights.
    pub(super) fn new(surface: &'a Surface<'a>, part: Vec<(u32, f64)>) -> Self {
        let edges = edges(surface, &part);
        let (mut vertices, weights): (Vec<u32>, Vec<f64>) = part.into_iter().unzip();
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
        Self { surface, vertices, weights, rings, edges }
    }

    /// Returns a measure of roughness for comparisons. It consists of the deviation from the smoothed surface, weighted more, and the
    /// bending of edges. The deviation alone cannot distinguish broad waves from fine ones; the bending alone depends more on the
    /// triangulation than on the surface.
    pub(super) fn measure(&self, points: &[Point3<f64>]) -> f64 {
        let deviation = self.deviation(points);
        libm::cbrt(deviation * deviation * self.bend(points))
    }

    /// Returns the weighted mean distance, along the normals, between the vertices and their positions after smoothing.
    fn deviation(&self, points: &[Point3<f64>]) -> f64 {
        let at: Vec<Vector3<f64>> =
            self.vertices.iter().map(|&vertex| points[vertex as usize].coords).collect();
        let smooth = smooth(&at, &self.rings, STEPS);
        let mut sum = 0.0;
        for (k, weight) in self.weights.iter().enumerate() {
            let vertex = self.vertices[k];
            let normal = self.surface.area(points, vertex).try_normalize(0.0).unwrap_or_default();
            sum += weight * (at[k] - smooth[k]).dot(&normal).abs();
        }
        sum / self.weights.iter().sum::<f64>().max(f64::MIN_POSITIVE)
    }

    /// Returns the mean absolute dihedral angle of the edges.
    fn bend(&self, points: &[Point3<f64>]) -> f64 {
        let (mut sum, mut weights) = (0.0, 0.0);
        for &WeightedEdge { faces, weight } in &self.edges {
            let [a, b] = faces.map(|face: u32| {
                let [a, b, c] = self.surface.corners(points, face);
                (b - a).cross(&(c - a))
            });
            sum += weight * libm::atan2(a.cross(&b).norm(), a.dot(&b));
            weights += weight;
        }
        sum / weights.max(f64::MIN_POSITIVE)
    }
}

/// An edge, given by its two faces, with the mean weight of its ends.
#[derive(Clone, Copy)]
struct WeightedEdge {
    faces: [u32; 2],
    weight: f64,
}

/// Returns the edges that have two faces and an end in `part`. Ends outside of it have weight 0.
fn edges(surface: &Surface<'_>, part: &[(u32, f64)]) -> Vec<WeightedEdge> {
    let mut weights = vec![0.0; surface.len()];
    part.iter().for_each(|&(vertex, weight)| weights[vertex as usize] = weight);
    let mut faces: Vec<u32> =
        part.iter().flat_map(|&(vertex, _)| surface.faces_around(vertex)).copied().collect();
    faces.sort_unstable();
    faces.dedup();
    let mut edges = Vec::new();
    for face in faces {
        let corners = surface.faces[face as usize];
        for k in 0..3 {
            let weight = [k, (k + 1) % 3].map(|k| weights[corners[k] as usize]).iter().sum::<f64>();
            let other = surface.adjacent_face(face, k).face;
            if weight > 0.0 && other != NONE && face < other {
                edges.push(WeightedEdge { faces: [face, other], weight: 0.5 * weight });
            }
        }
    }
    edges
}
