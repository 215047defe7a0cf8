//! The masks of the primal schemes (Loop and Catmull-Clark) for all vertices and edges: with any number of neighbors, on borders, and on
//! permanent or semi-sharp creases.
//!
//! Both schemes have the same crease rules: a vertex on a crease is weighted with its two neighbors on the crease as on a cubic B-spline, a
//! corner does not move, and for a vertex whose class changes in a step the results of both classes are blended. The rules are those of
//! Hoppe et al., "Piecewise smooth surface reconstruction" (1994), whose special rules for irregular crease vertices are an option, and of
//! DeRose, Kass and Truong, "Subdivision surfaces in character animation" (1998).
//!
//! Notation: `v` is the vertex, `e_j` are its `n` neighbors counter-clockwise, `F_j` is the centroid of the face between `e_j` and
//! `e_{j + 1}`, and `d_j` is the corner of that face opposite `v` if the face has four corners.

use maquette_base::linear::stencils::{Rows, push_merged};

use super::sharpness::{Class, Edges, Sharpness};
use crate::Creases;
use crate::refine::half_edges::{HalfEdges, Ring};
use crate::rules::Rules;

/// The masks of a primal subdivision scheme: the weights of old vertices in new vertices, limit points and tangents.
pub(crate) trait Masks: Sync {
    /// Returns three weights in the new vertex that replaces a smooth vertex with `n` neighbors: of the old vertex `v`, of each neighbor
    /// `e_j` and of each face centroid `F_j`.
    fn vertex(&self, n: usize) -> [f64; 3];

    /// Returns three weights in the limit point of a smooth vertex with `n` neighbors: of the vertex `v`, of each neighbor `e_j` and of
    /// each face centroid `F_j`.
    fn limit(&self, n: usize) -> [f64; 3];

    /// Two weights in the new vertex on a smooth edge: that of each end, and that of the opposite point (see `opposite`) on each side.
    const EDGE: [f64; 2];

    /// Returns the matrix column of the point opposite a half-edge in its face: a corner, or the face's centroid.
    fn opposite(&self, mesh: &impl HalfEdges, half: u32) -> u32;

    /// Adds `share` times the mask of the new vertex on a smooth edge: adds the weights of the edge's ends to `ends`, and pushes the other
    /// weights to the current row.
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

    /// Writes the weights of the neighbors `e_j` and opposite corners `d_j` in two tangents of a smooth vertex. The second tangent is
    /// counter-clockwise from the first.
    fn tangents(&self, to: [&mut Weights; 2]);

    /// Writes the weights of a tangent on one side of a crease, where the vertex has the neighbors `e_0..=e_q`. The tangent points into the
    /// surface.
    fn across(&self, to: &mut Weights);
}

/// A mask: the weights of a vertex, of its neighbors, and of its faces (of their centroids or of their corners opposite the vertex).
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

    /// Adds `share` times the mask of a class. `smooth` has the weights of the vertex, a neighbor and a face in the smooth mask; `crease`
    /// has the weights of the vertex and a neighbor in the crease mask.
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

/// Computes the masks of one mesh.
pub(crate) struct RingMasks<'a, H, M> {
    pub(crate) mesh: &'a H,
    pub(crate) sharpness: &'a Sharpness<'a, H>,
    pub(crate) rules: Rules<()>,
    pub(crate) masks: M,
}

/// Scratch space for one vertex.
#[derive(Default)]
pub(crate) struct Scratch {
    ring: Ring,
    edges: Edges,
    weights: Weights,
    pair: [Weights; 2],
    row: Vec<(u32, f64)>,
    composed: Rows,
}

impl<H: HalfEdges, M: Masks> RingMasks<'_, H, M> {
    /// Writes the matrix row of the new vertex that replaces an old vertex. `start` is a half-edge from the old vertex, or `NONE` if the
    /// vertex has no face. The columns are the old vertices, followed by the centroids of the faces.
    pub(crate) fn vertex(&self, scratch: &mut Scratch, vertex: u32, start: u32, rows: &mut Rows) {
        self.mesh.ring(start, &mut scratch.ring);
        let Scratch { ring, edges, weights, .. } = scratch;
        self.sharpness.collect_around(vertex, ring, edges);
        let classes =
            [&edges.before, &edges.after].map(|sharpness| self.sharpness.class(ring, sharpness));
        weights.clear(ring.neighbors.len(), ring.n_faces());
        let smooth = self.masks.vertex(ring.neighbors.len().max(1));
        fn add(class: Class, share: f64, smooth: [f64; 3], weights: &mut Weights) {
            weights.add(class, share, smooth, [0.75, 0.125]);
        }
        if classes[0] == classes[1] {
            add(classes[0], 1.0, smooth, weights);
        } else {
            let share = edges.old_class_weight();
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

    /// Writes the matrix row of the new vertex on an edge. The columns are the ones of [`Self::vertex`].
    pub(crate) fn edge(&self, edge: u32, rows: &mut Rows) {
        let ends = self.mesh.ends(edge);
        let (mut weights, sharp) = self.sharp_edge(edge, ends);
        if sharp != 1.0 {
            self.masks.edge(self.mesh, edge, 1.0 - sharp, &mut weights, rows);
        }
        ends.into_iter().zip(weights).for_each(|(end, weight)| rows.push(end, weight));
    }

    /// Returns the weights of an edge's ends by the crease rule, and the weight of the crease rule itself.
    fn sharp_edge(&self, edge: u32, ends: [u32; 2]) -> ([f64; 2], f64) {
        let sharp = self.sharpness.crease_weight(edge);
        if self.rules.creases != Creases::Hoppe94 || sharp == 0.0 {
            return ([0.5 * sharp; 2], sharp);
        }
        let owner = self.mesh.halves(edge)[0];
        let halves = [owner, self.mesh.next(owner)];
        let kinds = [0, 1].map(|k| self.hoppe_class(ends[k], halves[k]));
        match kinds {
            [HoppeClass::Dart, _] | [_, HoppeClass::Dart] => ([0.0; 2], 0.0),
            [HoppeClass::Regular, HoppeClass::Irregular] => ([0.625 * sharp, 0.375 * sharp], sharp),
            [HoppeClass::Irregular, HoppeClass::Regular] => ([0.375 * sharp, 0.625 * sharp], sharp),
            _ => ([0.5 * sharp; 2], sharp),
        }
    }

    /// Returns the class that the rules of Hoppe et al. (1994) give to a vertex at a sharp edge.
    fn hoppe_class(&self, vertex: u32, half: u32) -> HoppeClass {
        let (mut ring, mut edges) = (Ring::default(), Edges::default());
        self.mesh.ring(self.mesh.clockwise_most(half), &mut ring);
        self.sharpness.collect_around(vertex, &ring, &mut edges);
        match self.sharpness.class(&ring, &edges.before) {
            Class::Smooth => HoppeClass::Dart,
            Class::Crease(left, right) if is_regular(&ring, left, right) => HoppeClass::Regular,
            _ => HoppeClass::Irregular,
        }
    }

    /// Writes the matrix row of a vertex's limit point. The columns are the vertices.
    pub(crate) fn limit(&self, scratch: &mut Scratch, vertex: u32, start: u32, rows: &mut Rows) {
        let Scratch { ring, edges, weights, row, composed, .. } = scratch;
        self.mesh.ring(start, ring);
        self.sharpness.collect_around(vertex, ring, edges);
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

    /// Writes the limit point of a crease vertex by the rules of Hoppe et al. After one step its neighbors `e_l` and `e_r` on the crease
    /// are regular. From then on each step preserves the point `(3 v + e_l + e_r) / 5`, or `(4 v + e_l + e_r) / 6` if `v` is regular, too.
    fn hoppe_limit(&self, vertex: u32, ring: &Ring, ends: [usize; 2], rows: &mut Rows) {
        let own = if is_regular(ring, ends[0], ends[1]) { 4.0 } else { 3.0 };
        rows.push(vertex, 0.75 * own / (own + 2.0));
        for index in ends {
            rows.push(ring.neighbors[index], 0.125 * own / (own + 2.0));
            let first = rows.len();
            self.edge(ring.edges[index], rows);
            rows.scale_from(first, 1.0 / (own + 2.0));
        }
    }

    /// Writes the matrix rows of pairs of tangents: one pair for a smooth vertex, or one pair for each side of the sharp edges.
    pub(crate) fn tangents(&self, scratch: &mut Scratch, vertex: u32, start: u32, rows: &mut Rows) {
        let Scratch { ring, edges, pair, row, .. } = scratch;
        self.mesh.ring(start, ring);
        self.sharpness.collect_around(vertex, ring, edges);
        let (n, n_faces) = (ring.neighbors.len(), ring.n_faces());
        let is_sharp: Vec<usize> = (0..n).filter(|&index| edges.before[index] > 0.0).collect();
        if is_sharp.len() < 2 {
            if n > 0 {
                pair.iter_mut().for_each(|weights| weights.clear(n, n_faces));
                let [first, second] = pair;
                self.masks.tangents([first, second]);
                let (side, class) = (RingSide { first: 0, q: n, is_sharp: false }, Class::Smooth);
                pair.iter_mut()
                    .for_each(|w| self.push_tangent(vertex, ring, &side, class, w, row, rows));
            }
            return;
        }
        let class = self.sharpness.class(ring, &edges.before);
        let around = ring.closed.then_some(is_sharp[0] + n);
        let lasts = is_sharp[1..].iter().copied().chain(around);
        for (&first, last) in is_sharp.iter().zip(lasts) {
            let side = RingSide { first, q: last - first, is_sharp: true };
            let ends = [first, last].map(|index| ring.neighbors[index % n]);
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

    /// Writes the matrix row of a tangent, given the weights of the neighbors and faces on one side of the vertex.
    ///
    /// A face without four corners has no opposite corner. But after one step all faces around `v` have four corners, and the new vertices
    /// of `v`, of its edges and of its faces take the roles of `v`, `e_j` and `d_j`.
    #[expect(clippy::too_many_arguments, reason = "scratch space and where to write")]
    fn push_tangent(
        &self,
        vertex: u32,
        ring: &Ring,
        side: &RingSide,
        class: Class,
        weights: &mut Weights,
        row: &mut Vec<(u32, f64)>,
        rows: &mut Rows,
    ) {
        let (n, mesh) = (ring.neighbors.len(), self.mesh);
        let halves = (0..weights.faces.len()).map(|j| ring.halves[(side.first + j) % n]);
        let direct = weights.faces.iter().all(|&weight| weight == 0.0)
            || halves.clone().all(|half| mesh.halves_around(mesh.face_of(half)).len() == 4);
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

    /// Pushes the weights of the vertex, its neighbors and the centroids of its faces to the current row.
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

/// The class of a vertex at a sharp edge, in the rules of Hoppe et al.
enum HoppeClass {
    /// The vertex is the end of a single crease.
    Dart,
    Regular,
    Irregular,
}

/// Returns true if a crease vertex is regular: it has two smooth edges on each side of the crease, or is on a border and has four edges in
/// total.
fn is_regular(ring: &Ring, left: usize, right: usize) -> bool {
    match ring.closed {
        true => ring.edges.len() == 6 && right - left == 3,
        false => ring.edges.len() == 4,
    }
}

/// The part of a ring between two sharp edges, or the entire ring.
struct RingSide {
    /// The index, in the whole ring, of the first neighbor in this part of the ring.
    first: usize,
    /// The number of faces in this part of the ring.
    q: usize,
    /// True if the first and the last edge of this part of the ring are sharp.
    is_sharp: bool,
}

/// Converts the weights of a refined vertex, its neighbors and opposite corners to the weights of the old vertex, its neighbors and the
/// centroids.
fn refine_weights(weights: &mut Weights, side: &RingSide, class: Class) {
    let Weights { own, neighbors, faces } = weights;
    let refined_own = *own;
    let (count, q) = (neighbors.len(), side.q);
    if class != Class::Smooth {
        *own *= 0.75;
    }
    for (j, weight) in neighbors.iter_mut().enumerate() {
        let is_sharp = side.is_sharp && (j == 0 || j + 1 == count);
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
