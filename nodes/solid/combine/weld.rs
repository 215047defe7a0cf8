//! Cleans up the pieces of cut triangles: removes pieces without an area, and duplicate edges.

use maquette_value::parallel::ParallelSliceMut;
use nalgebra::Vector3;

use super::cut::{Cut, Piece};

/// Stands for the twin of a half-edge if the face on the other side is an uncut face, which has no half-edges.
const NONE: u32 = u32::MAX;

/// Maximum number of rounds of flips and collapses. Each flip or collapse may make further flips or collapses possible; a few rounds
/// suffice.
const ROUNDS: usize = 16;

/// Removes the degenerate pieces that result from coplanar faces of two solids: pieces whose corners coincide or are collinear.
///
/// Pieces are triangles connected by half-edges, so that two edges between the same vertices are distinct. An edge whose ends coincide is
/// collapsed. Two triangles with the same corners are removed. If the corners of a triangle are collinear, its longest edge is flipped. If
/// edges are still duplicates afterwards, they get a vertex at their middle.
pub(super) fn weld(cut: &mut Cut<'_>) {
    if !needs_welding(cut) {
        return;
    }
    let mut net = Net::new(cut);
    for _ in 0..ROUNDS {
        let before = net.changes;
        net.collapse();
        net.fold();
        net.flip();
        if net.changes == before {
            break;
        }
    }
    net.separate_touching_solids();
    let Net { pieces, is_gone, twins, .. } = net;
    let mut apart = Welder { cut, pieces, is_gone, twins };
    apart.split_shared_vertices();
    apart.split_duplicate_edges();
}

/// Returns true if the pieces have short edges, thin triangles, or more than two half-edges between the same vertices.
fn needs_welding(cut: &Cut<'_>) -> bool {
    let mut edges: Vec<_> = cut
        .pieces
        .iter()
        .flat_map(|piece| {
            let [a, b, c] = piece.vertices;
            [[a.min(b), a.max(b)], [b.min(c), b.max(c)], [c.min(a), c.max(a)]]
        })
        .collect();
    edges.par_sort_unstable();
    edges.chunk_by(|a, b| a == b).any(|same| 2 < same.len())
        || cut.pieces.iter().any(|piece| height(cut, piece.vertices) <= cut.tolerance())
}

/// Returns the height of a triangle over its longest edge, in mm.
fn height(cut: &Cut<'_>, vertices: [u32; 3]) -> f64 {
    let [a, b, c] = vertices.map(|it| cut.position(it));
    let edges: [Vector3<f64>; 3] = [b - a, c - b, a - c];
    let longest = edges.iter().map(Vector3::norm).fold(0.0, f64::max);
    if longest > 0.0 { edges[0].cross(&edges[2]).norm() / longest } else { 0.0 }
}

struct Net<'a, 'b> {
    cut: &'a Cut<'b>,
    pieces: Vec<Piece>,
    is_gone: Vec<bool>,
    /// The opposite of each half-edge, or `NONE`. Half-edge `3 t + k` runs from corner `k` of piece `t` to the piece's next corner.
    twins: Vec<u32>,
    changes: usize,
}

impl<'a, 'b> Net<'a, 'b> {
    fn new(cut: &'a Cut<'b>) -> Self {
        let pieces = cut.pieces.clone();
        let (is_gone, twins) = (vec![false; pieces.len()], vec![NONE; 3 * pieces.len()]);
        let mut net = Self { cut, pieces, is_gone, twins, changes: 0 };
        for same in net.by_edge() {
            let (there, back): (Vec<u32>, Vec<u32>) =
                same.iter().partition(|&&half| net.is_forward(half));
            there.into_iter().zip(back).for_each(|(there, back)| net.link(there, back));
        }
        net
    }

    /// Returns the half-edges of the remaining pieces, grouped by their two vertices.
    fn by_edge(&self) -> Vec<Vec<u32>> {
        let mut all: Vec<_> = self.halves().filter(|&half| self.is_there(half)).collect();
        all.sort_by_key(|&half| self.sorted_ends(half));
        all.chunk_by(|&a, &b| self.sorted_ends(a) == self.sorted_ends(b))
            .map(<[u32]>::to_vec)
            .collect()
    }

    /// Returns the two vertices of a half-edge, in ascending order of their indices.
    fn sorted_ends(&self, half: u32) -> [u32; 2] {
        let [a, b] = [self.from(half), self.end(half)];
        [a.min(b), a.max(b)]
    }

    /// Returns true if the index of the half-edge's start is lower than that of its end.
    fn is_forward(&self, half: u32) -> bool {
        self.from(half) < self.end(half)
    }

    fn length(&self, half: u32) -> f64 {
        (self.cut.position(self.end(half)) - self.cut.position(self.from(half))).norm()
    }

    /// Separates solids that touch along an edge: where more than two half-edges connect the same vertices, pairs the half-edges that bound
    /// the same solid.
    fn separate_touching_solids(&mut self) {
        for same in self.by_edge() {
            if same.len() < 4 || same.iter().any(|&half| self.twin(half) == NONE) {
                continue;
            }

            let [start, end] = [self.from(same[0]), self.end(same[0])];
            let start = self.cut.position(start.min(end));
            let axis = self.cut.position(self.from(same[0]).max(self.end(same[0]))) - start;
            let across = |half: u32| axis.cross(&(self.cut.position(self.end(next(half))) - start));
            let (x, length) = (across(same[0]), axis.norm());
            let mut round: Vec<(f64, u32)> = Vec::new();
            for &half in &same {
                let own = across(half);
                round.push((libm::atan2(x.cross(&own).dot(&axis) / length, x.dot(&own)), half));
            }
            round.sort_by(|a, b| {
                a.0.total_cmp(&b.0)
                    .then(self.is_forward(b.1).cmp(&self.is_forward(a.1)))
                    .then(a.1.cmp(&b.1))
            });
            // In the order of angles around the edge, the inside of a solid extends from a face with a backward half-edge to the next face
            // with a forward half-edge.
            let mut open = Vec::new();
            let mut pairs: Vec<[u32; 2]> = Vec::new();
            for &(_, half) in round.iter().chain(&round) {
                if pairs.iter().flatten().any(|it| *it == half) || open.contains(&half) {
                    continue;
                }
                if !self.is_forward(half) {
                    open.push(half);
                } else if let Some(back) = open.pop() {
                    pairs.push([half, back]);
                }
            }
            pairs.into_iter().for_each(|[there, back]| self.link(there, back));
        }
    }

    fn from(&self, half: u32) -> u32 {
        self.pieces[half as usize / 3].vertices[half as usize % 3]
    }

    fn end(&self, half: u32) -> u32 {
        self.from(next(half))
    }

    fn twin(&self, half: u32) -> u32 {
        self.twins[half as usize]
    }

    fn link(&mut self, a: u32, b: u32) {
        if a != NONE {
            self.twins[a as usize] = b;
        }
        if b != NONE {
            self.twins[b as usize] = a;
        }
    }

    fn is_there(&self, half: u32) -> bool {
        !self.is_gone[half as usize / 3]
    }

    fn halves(&self) -> impl Iterator<Item = u32> + use<> {
        0..self.twins.len() as u32
    }

    /// Collapses edges whose ends coincide.
    fn collapse(&mut self) {
        for half in self.halves() {
            if self.is_there(half) {
                let [from, to] = [self.from(half), self.end(half)];
                // Choose the direction of the collapse such that the vertex that disappears does not belong to an uncut face.
                let half = if from < to { self.twin(half) } else { half };
                let off = self.cut.position(to) - self.cut.position(from);
                if half != NONE && off.amax() <= self.cut.tolerance() {
                    self.collapse_to_end(half);
                }
            }
        }
    }

    /// Collapses an edge: moves the start of the half-edge to its end, if the surface around the edge stays a manifold.
    fn collapse_to_end(&mut self, half: u32) {
        let (goes, stays, back) = (self.from(half), self.end(half), self.twin(half));
        if goes < self.cut.first_new_vertex() || back == NONE {
            return;
        }
        let outer = [half, back].map(|it| [next(it), previous(it)].map(|it| self.twin(it)));
        let own = [half / 3, back / 3];
        if own[0] == own[1] || outer.as_flattened().iter().any(|it| own.contains(&(it / 3))) {
            return;
        }
        let mut around = vec![half];
        loop {
            let turned = self.twin(previous(around[around.len() - 1]));
            if turned == half {
                break;
            }
            if turned == NONE || (turned / 3 != back / 3 && self.end(turned) == stays) {
                return;
            }
            // A remaining triangle must not get an edge that starts and ends at the same vertex.
            let is_inner = turned / 3 == back / 3;
            if !is_inner && self.end(next(turned)) == goes && self.end(turned) == stays {
                return;
            }
            around.push(turned);
        }
        for turned in around {
            self.pieces[turned as usize / 3].vertices[turned as usize % 3] = stays;
        }
        for (half, [a, b]) in [half, back].into_iter().zip(outer) {
            self.is_gone[half as usize / 3] = true;
            self.link(a, b);
        }
        self.changes += 1;
    }

    /// Removes pairs of triangles that share two edges and therefore all corners.
    fn fold(&mut self) {
        for half in self.halves() {
            let [a, b] = [half, next(half)].map(|it| self.twin(it));
            if !self.is_there(half) || a == NONE || b == NONE || a / 3 != b / 3 || a / 3 == half / 3
            {
                continue;
            }
            let third =
                [0, 1, 2].map(|k| a / 3 * 3 + k).into_iter().find(|it| *it != a && *it != b);
            let outer =
                [Some(previous(half)), third].map(|it| self.twin(it.expect("three halves")));
            self.is_gone[half as usize / 3] = true;
            self.is_gone[a as usize / 3] = true;
            self.link(outer[0], outer[1]);
            self.changes += 1;
        }
    }

    /// Flips the longest edge of each triangle with collinear corners, if both new triangles are higher than the tolerance.
    fn flip(&mut self) {
        for piece in 0..self.pieces.len() as u32 {
            let own = self.pieces[piece as usize].vertices;
            if self.is_gone[piece as usize] || height(self.cut, own) > self.cut.tolerance() {
                continue;
            }

            let halves = [0, 1, 2].map(|k| 3 * piece + k);
            let longest =
                halves.into_iter().max_by(|&a, &b| self.length(a).total_cmp(&self.length(b)));
            let longest = longest.expect("three halves");
            let back = self.twin(longest);
            if back == NONE || back / 3 == piece {
                continue;
            }
            let [start, end] = [self.from(longest), self.end(longest)];
            let [tip, other] = [self.end(next(longest)), self.end(next(back))];
            let flipped = [[tip, start, other], [other, end, tip]];
            if !flipped
                .iter()
                .all(|it| it[0] != it[2] && height(self.cut, *it) > self.cut.tolerance())
            {
                continue;
            }
            let [to_start, from_end] = [previous(longest), next(longest)].map(|it| self.twin(it));
            let [from_start, to_end] = [next(back), previous(back)].map(|it| self.twin(it));
            let triangle = self.pieces[back as usize / 3].triangle;
            let places = [piece, back / 3];
            for (place, vertices) in places.into_iter().zip(flipped) {
                self.pieces[place as usize] = Piece { triangle, vertices };
            }
            let [first, second] = places.map(|it| 3 * it);
            // Connect the outer edges of the two triangles. If two of these edges are twins of each other, use the new index of the twin.
            let outer = [to_start, from_start, to_end, from_end];
            let inner = [first, first + 1, second, second + 1];
            let old = [previous(longest), next(back), previous(back), next(longest)];
            for (mut twin, half) in outer.into_iter().zip(inner) {
                if let Some(at) = old.iter().position(|it| *it == twin) {
                    twin = inner[at];
                }
                self.link(twin, half);
            }
            self.link(first + 2, second + 2);
            self.changes += 1;
        }
    }
}

fn next(half: u32) -> u32 {
    half / 3 * 3 + (half + 1) % 3
}

fn previous(half: u32) -> u32 {
    half / 3 * 3 + (half + 2) % 3
}

/// The pieces that remain after flips and collapses, while vertices are added to them.
struct Welder<'a, 'b> {
    cut: &'a mut Cut<'b>,
    pieces: Vec<Piece>,
    is_gone: Vec<bool>,
    twins: Vec<u32>,
}

impl Welder<'_, '_> {
    fn from(&self, half: u32) -> u32 {
        self.pieces[half as usize / 3].vertices[half as usize % 3]
    }

    /// Adds a vertex at the middle of two vertices.
    fn middle_vertex(&mut self, ends: [u32; 2]) -> u32 {
        self.cut.halfway.push(ends);
        self.cut.first_new_vertex() + (self.cut.meetings() + self.cut.halfway.len()) as u32 - 1
    }

    /// Splits each vertex that two fans of pieces share: one fan gets a copy of the vertex.
    fn split_shared_vertices(&mut self) {
        let count =
            self.cut.first_new_vertex() as usize + self.cut.meetings() + self.cut.halfway.len();
        let mut is_taken = vec![false; count];
        // If a vertex belongs to a face that is not cut, it stays with that face.
        for half in 0..self.twins.len() as u32 {
            if !self.is_gone[half as usize / 3] && self.twins[half as usize] == NONE {
                is_taken[self.from(half) as usize] = true;
                is_taken[self.from(next(half)) as usize] = true;
            }
        }
        let mut is_seen = vec![false; self.twins.len()];
        for half in 0..self.twins.len() as u32 {
            if self.is_gone[half as usize / 3] || is_seen[half as usize] {
                continue;
            }
            let mut fan = vec![half];
            let is_closed = loop {
                match self.twins[previous(fan[fan.len() - 1]) as usize] {
                    NONE => break false,
                    back if back == half => break true,
                    turned => fan.push(turned),
                }
            };
            fan.iter().for_each(|&it| is_seen[it as usize] = true);
            let vertex = self.from(half);
            if is_closed && is_taken[vertex as usize] {
                let own = self.middle_vertex([vertex; 2]);
                for turned in fan {
                    self.pieces[turned as usize / 3].vertices[turned as usize % 3] = own;
                }
            } else if is_closed {
                is_taken[vertex as usize] = true;
            }
        }
    }

    /// If several edges connect the same two vertices, splits all but the first at their middle.
    fn split_duplicate_edges(mut self) {
        // Never split an edge of a face that is not cut.
        let mut seen = self.cut.edges_of_whole_faces();
        let mut middles = vec![NONE; self.twins.len()];
        for half in 0..self.twins.len() as u32 {
            let twin = self.twins[half as usize];
            if self.is_gone[half as usize / 3] || twin == NONE || twin < half {
                continue;
            }
            let [a, b] = [self.from(half), self.from(next(half))];
            if !seen.insert([a.min(b), a.max(b)]) {
                let middle = self.middle_vertex([a, b]);
                middles[half as usize] = middle;
                middles[twin as usize] = middle;
            }
        }
        self.cut.pieces.clear();
        for (number, piece) in self.pieces.iter().enumerate().filter(|it| !self.is_gone[it.0]) {
            let mut ring = Vec::with_capacity(6);
            let mut start = 0;
            for k in 0..3 {
                ring.push(piece.vertices[k]);
                let middle = middles[3 * number + k];
                if middle != NONE {
                    start = ring.len();
                    ring.push(middle);
                }
            }
            // Start the fan at a middle vertex, if the polygon has one, so that no triangle has collinear corners.
            ring.rotate_left(start);
            let fan = ring[1..].windows(2).map(|pair| [ring[0], pair[0], pair[1]]);
            self.cut.pieces.extend(fan.map(|vertices| Piece { vertices, ..*piece }));
        }
    }
}
