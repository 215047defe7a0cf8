//! The rows of the vertices and edges of the primal schemes, Loop's and Catmull's and Clark's, wherever they are: amid any number
//! of neighbors, on borders, on creases that last or soften.
//!
//! The crease rules are common to both: a vertex on a crease is weighed with its two neighbors there as on a cubic B-spline, a
//! corner stays, and a vertex whose class changes in a step is between both. After Hoppe et al., "Piecewise smooth surface
//! reconstruction" (1994), whose own rules for irregular crease vertices are an option, and DeRose, Kass and Truong,
//! "Subdivision surfaces in character animation" (1998).
//!
//! Notation: `v` the vertex, `e_j` its `n` neighbors counter-clockwise, `F_j` the centroid of the face between `e_j` and
//! `e_{j + 1}`, `d_j` the corner of that face across from `v`, if it has four.

use maquette_base::linear::stencils::{Rows, push_merged};

use super::sharpness::{Class, Edges, Sharpness};
use crate::Creases;
use crate::refine::half_edges::{HalfEdges, Ring};
use crate::rules::Rules;

/// What is particular to a scheme.
pub(crate) trait Masks: Sync {
    /// The weights of `v`, each `e_j` and each `F_j` for a new vertex at a smooth one.
    fn vertex(&self, n: usize) -> [f64; 3];

    /// The same for its limit.
    fn limit(&self, n: usize) -> [f64; 3];

    /// The weights of each end of a smooth edge, and of what is across it on each side.
    const EDGE: [f64; 2];

    /// The column of what is across the edge of a half-edge in its face: a corner, or the face's centroid.
    fn opposite(&self, mesh: &impl HalfEdges, half: u32) -> u32;

    /// Adds `share` times the rule of a smooth edge: weights of its ends to `ends`, the others to the current row.
    fn edge(
        &self,
        mesh: &impl HalfEdges,
        edge: u32,
        share: f64,
        ends: &mut [f64; 2],
        rows: &mut Rows,
    ) {
        let [end, across] = Self::EDGE.map(|weight| weight * share);
        ends.iter_mut().for_each(|weight| *weight += end);
        for half in mesh.halves_of(edge) {
            rows.push(self.opposite(mesh, half), across);
        }
    }

    /// Two tangents of a smooth vertex, the first turning counter-clockwise to the second: weights of `e_j` and `d_j`.
    fn tangents(&self, to: [&mut Weights; 2]);

    /// A tangent of one side of a crease with the neighbors `e_0..=e_q`, pointing into the surface.
    fn across(&self, to: &mut Weights);
}

/// Weights of a vertex, its neighbors, and its faces: of their centroids, or of the corners across.
#[derive(Clone, Debug, Default)]
pub(crate) struct Weights {
    pub(crate) own: f64,
    pub(crate) neighbors: Vec<f64>,
    pub(crate) faces: Vec<f64>,
}

impl Weights {
    fn clear(&mut self, neighbors: usize, faces: usize) {
        self.own = 0.0;
        for (weights, count) in [(&mut self.neighbors, neighbors), (&mut self.faces, faces)] {
            weights.clear();
            weights.resize(count, 0.0);
        }
    }

    /// Adds a mask; `smooth` has the weights of the vertex, a neighbor and a face, `crease` those of the vertex and a neighbor.
    fn add(&mut self, class: Class, share: f64, smooth: [f64; 3], crease: [f64; 2]) {
        match class {
            Class::Smooth => {
                self.own += share * smooth[0];
                self.neighbors.iter_mut().for_each(|weight| *weight += share * smooth[1]);
                self.faces.iter_mut().for_each(|weight| *weight += share * smooth[2]);
            }
            Class::Crease(left, right) => {
                self.own += share * crease[0];
                self.neighbors[left] += share * crease[1];
                self.neighbors[right] += share * crease[1];
            }
            Class::Corner => self.own += share,
        }
    }
}

/// The rows of one mesh.
pub(crate) struct Stars<'a, H, M> {
    pub(crate) mesh: &'a H,
    pub(crate) sharpness: &'a Sharpness<'a, H>,
    pub(crate) rules: Rules<()>,
    pub(crate) masks: M,
}

/// Space for one vertex.
#[derive(Default)]
pub(crate) struct Scratch {
    ring: Ring,
    edges: Edges,
    weights: Weights,
    pair: [Weights; 2],
    row: Vec<(u32, f64)>,
    composed: Rows,
}

impl<H: HalfEdges, M: Masks> Stars<'_, H, M> {
    /// The new vertex at the old one from which `start` runs, or which has no face. Columns are the old vertices, then the
    /// centroids of the faces.
    pub(crate) fn vertex(&self, scratch: &mut Scratch, vertex: u32, start: u32, rows: &mut Rows) {
        self.mesh.ring(start, &mut scratch.ring);
        let Scratch { ring, edges, weights, .. } = scratch;
        self.sharpness.around(vertex, ring, edges);
        let classes =
            [&edges.before, &edges.after].map(|sharpness| self.sharpness.class(ring, sharpness));
        weights.clear(ring.neighbors.len(), ring.n_faces());
        let smooth = self.masks.vertex(ring.neighbors.len().max(1));
        fn add(class: Class, share: f64, smooth: [f64; 3], weights: &mut Weights) {
            weights.add(class, share, smooth, [0.75, 0.125])
        }
        if classes[0] == classes[1] {
            add(classes[0], 1.0, smooth, weights);
        } else {
            let share = edges.share();
            add(classes[0], share, smooth, weights);
            add(classes[1], 1.0 - share, smooth, weights);
        }
        rows.push(vertex, weights.own);
        push_neighbors(rows, ring, weights);
        for (&half, &weight) in ring.halves.iter().zip(&weights.faces) {
            if weight != 0.0 {
                rows.push(self.mesh.vertices() as u32 + self.mesh.face_of(half), weight);
            }
        }
    }

    /// The new vertex on an edge; columns as for [`Self::vertex`].
    pub(crate) fn edge(&self, edge: u32, rows: &mut Rows) {
        let ends = self.mesh.ends(edge);
        let (mut weights, sharp) = self.sharp_edge(edge, ends);
        if sharp != 1.0 {
            self.masks.edge(self.mesh, edge, 1.0 - sharp, &mut weights, rows);
        }
        ends.into_iter().zip(weights).for_each(|(end, weight)| rows.push(end, weight));
    }

    /// The weights of the ends of an edge as far as it is sharp, and how far it is.
    fn sharp_edge(&self, edge: u32, ends: [u32; 2]) -> ([f64; 2], f64) {
        let sharp = self.sharpness.share(edge);
        if self.rules.creases != Creases::Hoppe94 || sharp == 0.0 {
            return ([0.5 * sharp; 2], sharp);
        }
        let owner = self.mesh.halves(edge)[0];
        let halves = [owner, self.mesh.next(owner)];
        let kinds = [0, 1].map(|k| self.kind(ends[k], halves[k]));
        match kinds {
            [Kind::Dart, _] | [_, Kind::Dart] => ([0.0; 2], 0.0),
            [Kind::Regular, Kind::Irregular] => ([0.625 * sharp, 0.375 * sharp], sharp),
            [Kind::Irregular, Kind::Regular] => ([0.375 * sharp, 0.625 * sharp], sharp),
            _ => ([0.5 * sharp; 2], sharp),
        }
    }

    /// How Hoppe et al. class the vertex from which a half-edge runs.
    fn kind(&self, vertex: u32, half: u32) -> Kind {
        let (mut ring, mut edges) = (Ring::default(), Edges::default());
        self.mesh.ring(self.mesh.first(half), &mut ring);
        self.sharpness.around(vertex, &ring, &mut edges);
        match self.sharpness.class(&ring, &edges.before) {
            Class::Smooth => Kind::Dart,
            Class::Crease(left, right) if is_regular(&ring, left, right) => Kind::Regular,
            _ => Kind::Irregular,
        }
    }

    /// The limit of a vertex, in terms of the vertices.
    pub(crate) fn limit(&self, scratch: &mut Scratch, vertex: u32, start: u32, rows: &mut Rows) {
        let Scratch { ring, edges, weights, row, composed, .. } = scratch;
        self.mesh.ring(start, ring);
        self.sharpness.around(vertex, ring, edges);
        weights.clear(ring.neighbors.len(), ring.n_faces());
        let class = self.sharpness.class(ring, &edges.before);
        if let (Class::Crease(left, right), Creases::Hoppe94) = (class, self.rules.creases) {
            self.hoppe_limit(vertex, ring, [left, right], composed);
            return push_merged(rows, &mut composed.take_entries());
        }
        let smooth = self.masks.limit(ring.neighbors.len().max(1));
        weights.add(class, 1.0, smooth, [2.0 / 3.0, 1.0 / 6.0]);
        self.push_centroids(vertex, ring, weights, row, rows);
    }

    /// The limit of a crease vertex by the rules of Hoppe et al.: after one step its neighbors on the crease are regular, and
    /// then `(3 v + e_l + e_r) / 5` does not change, or `(4 v + e_l + e_r) / 6` if `v` is regular, too.
    fn hoppe_limit(&self, vertex: u32, ring: &Ring, ends: [usize; 2], rows: &mut Rows) {
        let own = if is_regular(ring, ends[0], ends[1]) { 4.0 } else { 3.0 };
        rows.push(vertex, 0.75 * own / (own + 2.0));
        for place in ends {
            rows.push(ring.neighbors[place], 0.125 * own / (own + 2.0));
            let first = rows.len();
            self.edge(ring.edges[place], rows);
            rows.scale_from(first, 1.0 / (own + 2.0));
        }
    }

    /// Pairs of tangents: one for a smooth vertex, one for each side of sharp edges.
    pub(crate) fn tangents(&self, scratch: &mut Scratch, vertex: u32, start: u32, rows: &mut Rows) {
        let Scratch { ring, edges, pair, row, .. } = scratch;
        self.mesh.ring(start, ring);
        self.sharpness.around(vertex, ring, edges);
        let (n, n_faces) = (ring.neighbors.len(), ring.n_faces());
        let sharp: Vec<usize> = (0..n).filter(|&place| edges.before[place] > 0.0).collect();
        if sharp.len() < 2 {
            if n > 0 {
                pair.iter_mut().for_each(|weights| weights.clear(n, n_faces));
                let [first, second] = pair;
                self.masks.tangents([first, second]);
                let (side, class) = (Side { first: 0, q: n, sharp: false }, Class::Smooth);
                pair.iter_mut()
                    .for_each(|w| self.push_tangent(vertex, ring, &side, class, w, row, rows));
            }
            return;
        }
        let class = self.sharpness.class(ring, &edges.before);
        let around = ring.closed.then_some(sharp[0] + n);
        let lasts = sharp[1..].iter().copied().chain(around);
        for (&first, last) in sharp.iter().zip(lasts) {
            let side = Side { first, q: last - first, sharp: true };
            let ends = [first, last].map(|place| ring.neighbors[place % n]);
            if class == Class::Corner {
                for end in ends {
                    rows.push(end, 1.0);
                    rows.push(vertex, -1.0);
                    rows.end();
                }
            } else {
                rows.push(ends[0], 1.0);
                rows.push(ends[1], -1.0);
                rows.end();
                let across = &mut pair[0];
                across.clear(side.q + 1, side.q);
                self.masks.across(across);
                self.push_tangent(vertex, ring, &side, class, across, row, rows);
            }
        }
    }

    /// Ends a row with a tangent whose weights are those of the neighbors and faces of a side.
    ///
    /// Where a face has not four corners there is none across; but all faces around `v` have four after one step, in which `v`,
    /// the new vertices on its edges and the centroids take the places of `v`, `e_j` and `d_j`.
    #[expect(clippy::too_many_arguments, reason = "scratch space and where to write")]
    fn push_tangent(
        &self,
        vertex: u32,
        ring: &Ring,
        side: &Side,
        class: Class,
        weights: &mut Weights,
        row: &mut Vec<(u32, f64)>,
        rows: &mut Rows,
    ) {
        let (n, mesh) = (ring.neighbors.len(), self.mesh);
        let halves = (0..weights.faces.len()).map(|j| ring.halves[(side.first + j) % n]);
        let sides = |half: u32| mesh.faces().face(mesh.face_of(half) as usize).len();
        let direct = weights.faces.iter().all(|&weight| weight == 0.0)
            || halves.clone().all(|h| sides(h) == 4);
        if !direct {
            refine_weights(weights, side, class);
        }
        row.clear();
        row.push((vertex, weights.own));
        let neighbors = weights.neighbors.iter().enumerate();
        row.extend(neighbors.map(|(j, &weight)| (ring.neighbors[(side.first + j) % n], weight)));
        for (half, &weight) in halves.zip(&weights.faces) {
            if direct {
                row.push((mesh.corners()[mesh.next(mesh.next(half)) as usize], weight));
            } else {
                self.push_centroid(half, weight, row);
            }
        }
        push_merged(rows, row);
        rows.end();
    }

    /// Adds the vertex, its neighbors and the centroids of its faces to the current row.
    fn push_centroids(
        &self,
        vertex: u32,
        ring: &Ring,
        weights: &Weights,
        row: &mut Vec<(u32, f64)>,
        rows: &mut Rows,
    ) {
        if weights.faces.iter().all(|&weight| weight == 0.0) {
            rows.push(vertex, weights.own);
            return push_neighbors(rows, ring, weights);
        }
        row.clear();
        row.push((vertex, weights.own));
        row.extend(ring.neighbors.iter().copied().zip(weights.neighbors.iter().copied()));
        for (&half, &weight) in ring.halves.iter().zip(&weights.faces) {
            self.push_centroid(half, weight, row);
        }
        push_merged(rows, row);
    }

    fn push_centroid(&self, half: u32, weight: f64, row: &mut Vec<(u32, f64)>) {
        let face = self.mesh.faces().face(self.mesh.face_of(half) as usize);
        row.extend(face.iter().map(|&corner| (corner, weight / face.len() as f64)));
    }
}

/// What a vertex at a sharp edge is to Hoppe et al.
enum Kind {
    /// The crease ends there.
    Dart,
    Regular,
    Irregular,
}

/// Whether a crease vertex has two smooth edges on each side, or is at a border with four edges in all.
fn is_regular(ring: &Ring, left: usize, right: usize) -> bool {
    match ring.closed {
        true => ring.edges.len() == 6 && right - left == 3,
        false => ring.edges.len() == 4,
    }
}

/// The part of a ring between two sharp edges, or the whole ring.
struct Side {
    /// The place of its first neighbor.
    first: usize,
    /// Number of its faces.
    q: usize,
    /// Whether its first and last edges are sharp.
    sharp: bool,
}

/// Weights of a refined vertex, its neighbors and the corners across become weights of the old vertex, its neighbors and the
/// centroids.
fn refine_weights(weights: &mut Weights, side: &Side, class: Class) {
    let Weights { own, neighbors, faces } = weights;
    let refined_own = *own;
    let (count, q) = (neighbors.len(), side.q);
    if class != Class::Smooth {
        *own *= 0.75;
    }
    for (j, weight) in neighbors.iter_mut().enumerate() {
        let is_sharp = side.sharp && (j == 0 || j + 1 == count);
        if is_sharp {
            *own += *weight / 2.0;
            *weight = *weight / 2.0 + refined_own / 8.0;
        } else {
            *weight /= 4.0;
            *own += *weight;
            faces[(j + q - 1) % q] += *weight;
            faces[j % q] += *weight;
        }
    }
}

fn push_neighbors(rows: &mut Rows, ring: &Ring, weights: &Weights) {
    for (&neighbor, &weight) in ring.neighbors.iter().zip(&weights.neighbors) {
        if weight != 0.0 {
            rows.push(neighbor, weight);
        }
    }
}
