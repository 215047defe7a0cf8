//! The masks of the Catmull-Clark scheme for polygons.
//!
//! Catmull and Clark, "Recursively generated B-spline surfaces on arbitrary topological meshes" (1978). Limit points and tangents are
//! derived from the eigenvectors of these masks: Halstead, Kass and DeRose, "Efficient, fair interpolation using Catmull-Clark surfaces"
//! (1993); tangents on creases are those of Biermann, Levin and Zorin, "Piecewise smooth subdivision surfaces with normal control" (2000).
//! For the notation see `vertex_rings.rs`.

use std::f64::consts::PI;

use super::roots_of_unity::root_of_unity;
use super::vertex_rings::{Masks, Weights};
use crate::refine::half_edges::HalfEdges;

/// The masks of the Catmull-Clark scheme.
#[derive(Clone, Copy, Default)]
pub(crate) struct CatmullClarkMasks;

impl Masks for CatmullClarkMasks {
    /// A step moves a vertex `v` with `n` neighbors `e_j` and face centroids `F_j` to `(n - 2)/n v + 1/n^2 sum e_j + 1/n^2 sum F_j`.
    fn vertex(&self, n: usize) -> [f64; 3] {
        let n = n as f64;
        [(n - 2.0) / n, 1.0 / (n * n), 1.0 / (n * n)]
    }

    /// The limit point of a vertex `v` with `n` neighbors `e_j` and face centroids `F_j` is `(n (n - 1) v + 2 sum e_j + 4 sum F_j) / (n (n
    /// + 5))`.
    fn limit(&self, n: usize) -> [f64; 3] {
        let n = n as f64;
        [(n - 1.0) / (n + 5.0), 2.0 / (n * (n + 5.0)), 4.0 / (n * (n + 5.0))]
    }

    /// The new vertex on an edge is the mean of both ends and both centroids: each has the weight 1/4.
    const EDGE: [f64; 2] = [0.25; 2];

    fn opposite(&self, mesh: &impl HalfEdges, half: u32) -> u32 {
        mesh.vertices() as u32 + mesh.face_of(half)
    }

    /// At a vertex with only two neighbors, the eigenvectors do not give a tangent plane; the tangents are then the directions of the two
    /// edges.
    fn tangents(&self, [first, second]: [&mut Weights; 2]) {
        let n = first.neighbors.len();
        if n < 3 {
            for (j, weights) in [first, second].into_iter().enumerate() {
                weights.neighbors[j % n] = 1.0;
                weights.own = -1.0;
            }
            return;
        }
        let [cosine, _] = root_of_unity(1, n);
        let half = libm::cos(PI / n as f64);
        let eigenvalue = 0.3125 + (cosine + half * (2.0 * (9.0 + cosine)).sqrt()) / 16.0;
        for (j, part) in (0..n).flat_map(|j| [(j, 0), (j, 1)]) {
            let weights = if part == 0 { &mut *first } else { &mut *second };
            let (here, next) = (root_of_unity(j, n)[part], root_of_unity((j + 1) % n, n)[part]);
            weights.neighbors[j] = 4.0 * here;
            weights.faces[j] = (here + next) / (4.0 * eigenvalue - 1.0);
        }
    }

    fn across(&self, to: &mut Weights) {
        let q = to.neighbors.len() - 1;
        if q == 1 {
            to.neighbors.fill(1.0);
            to.own = -2.0;
            return;
        }
        let angle = PI / q as f64;
        fn sine(j: usize, angle: f64) -> f64 {
            libm::sin(j as f64 * angle)
        }
        let cosine = libm::cos(angle);
        let ratio = (cosine + 1.0) / sine(1, angle);
        to.own = 4.0 * ratio * (cosine - 1.0);
        for (j, weight) in to.neighbors.iter_mut().enumerate() {
            let is_end = j == 0 || j == q;
            *weight = if is_end { -ratio * (1.0 + 2.0 * cosine) } else { 4.0 * sine(j, angle) };
        }
        for (j, weight) in to.faces.iter_mut().enumerate() {
            *weight = sine(j, angle) + sine(j + 1, angle);
        }
    }
}
