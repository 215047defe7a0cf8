//! Takes out pieces without an area, and edges that would be two in one.

use nalgebra::Vector3;

use super::cut::{Cut, Piece};

/// No half-edge: the one next to a face that is not cut.
const NONE: u32 = u32::MAX;

/// Rounds of flips and collapses. Each needs the one before; a few are enough.
const ROUNDS: usize = 16;

/// Takes out what walls in one plane leave: pieces whose corners are in one place or on one line.
///
/// Pieces are triangles that hang together by half-edges, so that two edges between the same vertices are two. An edge whose ends are in one
/// place collapses, two triangles with the same corners fold away, and of a triangle with its corners on one line the longest edge is flipped.
/// What is still two edges between the same vertices gets a vertex halfway.
pub(super) fn weld(cut: &mut Cut<'_>) {
    if !needs(cut) {
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
    net.part();
    let Net { pieces, is_gone, twins, .. } = net;
    let mut apart = Apart { cut, pieces, is_gone, twins };
    apart.give_each_its_own_vertices();
    apart.give_each_edge_its_own_ends();
}

/// Whether there is anything to take out: edges that are short, triangles that are thin, and more than two half-edges between the same vertices.
fn needs(cut: &Cut<'_>) -> bool {
    let mut edges: Vec<_> = cut
        .pieces
        .iter()
        .flat_map(|piece| {
            let [a, b, c] = piece.vertices;
            [[a.min(b), a.max(b)], [b.min(c), b.max(c)], [c.min(a), c.max(a)]]
        })
        .collect();
    edges.sort_unstable();
    edges.chunk_by(|a, b| a == b).any(|same| 2 < same.len())
        || cut.pieces.iter().any(|piece| height(cut, piece.vertices) <= cut.tolerance())
}

/// How far a triangle reaches across its longest edge; nothing if its corners are in one place.
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
    /// The half-edge on the other side of each. Half-edge `3 t + k` runs from corner `k` of piece `t` to the next one.
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
                same.iter().partition(|&&half| net.from(half) < net.to(half));
            there.into_iter().zip(back).for_each(|(there, back)| net.link(there, back));
        }
        net
    }

    /// The half-edges that are there, those between the same vertices together.
    fn by_edge(&self) -> Vec<Vec<u32>> {
        let key = |half: u32| {
            let [a, b] = [self.from(half), self.to(half)];
            [a.min(b), a.max(b)]
        };
        let mut all: Vec<_> = self.halves().filter(|&half| self.is_there(half)).collect();
        all.sort_by_key(|&half| key(half));
        all.chunk_by(|&a, &b| key(a) == key(b)).map(<[u32]>::to_vec).collect()
    }

    /// Where several edges are one, solids touch: what bounds the same one hangs together, and nothing else.
    fn part(&mut self) {
        for same in self.by_edge() {
            if same.len() < 4 || same.iter().any(|&half| self.twin(half) == NONE) {
                continue;
            }
            let is_there = |half: u32| self.from(half) < self.to(half);
            let [start, end] = [self.from(same[0]), self.to(same[0])];
            let start = self.cut.position(start.min(end));
            let axis = self.cut.position(self.from(same[0]).max(self.to(same[0]))) - start;
            let across = |half: u32| axis.cross(&(self.cut.position(self.to(next(half))) - start));
            let (x, length) = (across(same[0]), axis.norm());
            let angle = |half: u32| {
                let own = across(half);
                libm::atan2(x.cross(&own).dot(&axis) / length, x.dot(&own))
            };
            let mut round: Vec<_> = same.iter().map(|&half| (angle(half), half)).collect();
            round.sort_by(|a, b| {
                a.0.total_cmp(&b.0).then(is_there(b.1).cmp(&is_there(a.1))).then(a.1.cmp(&b.1))
            });
            // Seen along the edge, a solid is from a face that runs back to the next one that does not.
            let mut open = Vec::new();
            let mut pairs: Vec<[u32; 2]> = Vec::new();
            for &(_, half) in round.iter().chain(&round) {
                if pairs.iter().flatten().any(|it| *it == half) || open.contains(&half) {
                    continue;
                }
                if !is_there(half) {
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

    fn to(&self, half: u32) -> u32 {
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

    /// Collapses edges whose ends are in one place.
    fn collapse(&mut self) {
        for half in self.halves() {
            if self.is_there(half) {
                let [from, to] = [self.from(half), self.to(half)];
                // What goes is no vertex of a face that is not cut.
                let half = if from < to { self.twin(half) } else { half };
                let off = self.cut.position(to) - self.cut.position(from);
                if half != NONE && off.amax() <= self.cut.tolerance() {
                    self.collapse_to_end(half);
                }
            }
        }
    }

    /// Moves the start of a half-edge to its end, if what is around stays a skin.
    fn collapse_to_end(&mut self, half: u32) {
        let (goes, stays, back) = (self.from(half), self.to(half), self.twin(half));
        if goes < self.cut.behind() || back == NONE {
            return;
        }
        let outer = [half, back].map(|it| [next(it), before(it)].map(|it| self.twin(it)));
        let own = [half / 3, back / 3];
        if own[0] == own[1] || outer.as_flattened().iter().any(|it| own.contains(&(it / 3))) {
            return;
        }
        let mut around = vec![half];
        loop {
            let turned = self.twin(before(around[around.len() - 1]));
            if turned == half {
                break;
            }
            if turned == NONE || (turned / 3 != back / 3 && self.to(turned) == stays) {
                return;
            }
            // The third edge of a triangle that stays must not come back to where it starts.
            let is_inner = turned / 3 == back / 3;
            if !is_inner && self.to(next(turned)) == goes && self.to(turned) == stays {
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

    /// Takes out pairs of triangles that have two edges in common, and so all corners.
    fn fold(&mut self) {
        for half in self.halves() {
            let [a, b] = [half, next(half)].map(|it| self.twin(it));
            if !self.is_there(half) || a == NONE || b == NONE || a / 3 != b / 3 || a / 3 == half / 3
            {
                continue;
            }
            let third =
                [0, 1, 2].map(|k| a / 3 * 3 + k).into_iter().find(|it| *it != a && *it != b);
            let outer = [Some(before(half)), third].map(|it| self.twin(it.expect("three halves")));
            self.is_gone[half as usize / 3] = true;
            self.is_gone[a as usize / 3] = true;
            self.link(outer[0], outer[1]);
            self.changes += 1;
        }
    }

    /// Flips the longest edge of triangles whose corners are on one line, where neither half is as thin.
    fn flip(&mut self) {
        for piece in 0..self.pieces.len() as u32 {
            let own = self.pieces[piece as usize].vertices;
            if self.is_gone[piece as usize] || height(self.cut, own) > self.cut.tolerance() {
                continue;
            }
            let length = |half: &u32| {
                (self.cut.position(self.to(*half)) - self.cut.position(self.from(*half))).norm()
            };
            let halves = [0, 1, 2].map(|k| 3 * piece + k);
            let longest = halves.into_iter().max_by(|a, b| length(a).total_cmp(&length(b)));
            let longest = longest.expect("three halves");
            let back = self.twin(longest);
            if back == NONE || back / 3 == piece {
                continue;
            }
            let [start, end] = [self.from(longest), self.to(longest)];
            let [tip, other] = [self.to(next(longest)), self.to(next(back))];
            let flipped = [[tip, start, other], [other, end, tip]];
            let is_good =
                |it: &[u32; 3]| it[0] != it[2] && height(self.cut, *it) > self.cut.tolerance();
            if !flipped.iter().all(is_good) {
                continue;
            }
            let [to_start, from_end] = [before(longest), next(longest)].map(|it| self.twin(it));
            let [from_start, to_end] = [next(back), before(back)].map(|it| self.twin(it));
            let triangle = self.pieces[back as usize / 3].triangle;
            let places = [piece, back / 3];
            for (place, vertices) in places.into_iter().zip(flipped) {
                self.pieces[place as usize] = Piece { triangle, vertices };
            }
            let [first, second] = places.map(|it| 3 * it);
            // An edge of both, which is its own other side where two of them were glued.
            let outer = [to_start, from_start, to_end, from_end];
            let inner = [first, first + 1, second, second + 1];
            let old = [before(longest), next(back), before(back), next(longest)];
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

fn before(half: u32) -> u32 {
    half / 3 * 3 + (half + 2) % 3
}

/// Pieces that are left, while they get vertices.
struct Apart<'a, 'b> {
    cut: &'a mut Cut<'b>,
    pieces: Vec<Piece>,
    is_gone: Vec<bool>,
    twins: Vec<u32>,
}

impl Apart<'_, '_> {
    fn from(&self, half: u32) -> u32 {
        self.pieces[half as usize / 3].vertices[half as usize % 3]
    }

    /// A new vertex halfway between two.
    fn halfway(&mut self, ends: [u32; 2]) -> u32 {
        self.cut.halfway.push(ends);
        self.cut.behind() + (self.cut.meetings() + self.cut.halfway.len()) as u32 - 1
    }

    /// Where two fans of pieces have one vertex, one of them gets another in the same place.
    fn give_each_its_own_vertices(&mut self) {
        let count = self.cut.behind() as usize + self.cut.meetings() + self.cut.halfway.len();
        let mut is_taken = vec![false; count];
        // A vertex next to a face that is not cut is that of the face.
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
                match self.twins[before(fan[fan.len() - 1]) as usize] {
                    NONE => break false,
                    back if back == half => break true,
                    turned => fan.push(turned),
                }
            };
            fan.iter().for_each(|&it| is_seen[it as usize] = true);
            let vertex = self.from(half);
            if is_closed && is_taken[vertex as usize] {
                let own = self.halfway([vertex; 2]);
                for turned in fan {
                    self.pieces[turned as usize / 3].vertices[turned as usize % 3] = own;
                }
            } else if is_closed {
                is_taken[vertex as usize] = true;
            }
        }
    }

    /// Of edges between the same vertices all but the first get a vertex halfway.
    fn give_each_edge_its_own_ends(mut self) {
        // Edges of faces that are not cut stay.
        let mut seen = self.cut.edges_of_whole_faces();
        let mut middles = vec![NONE; self.twins.len()];
        for half in 0..self.twins.len() as u32 {
            let twin = self.twins[half as usize];
            if self.is_gone[half as usize / 3] || twin == NONE || twin < half {
                continue;
            }
            let [a, b] = [self.from(half), self.from(next(half))];
            if !seen.insert([a.min(b), a.max(b)]) {
                let middle = self.halfway([a, b]);
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
            // From a vertex halfway, if there is one, so that no triangle has its corners on one line.
            ring.rotate_left(start);
            let fan = ring[1..].windows(2).map(|pair| [ring[0], pair[0], pair[1]]);
            self.cut.pieces.extend(fan.map(|vertices| Piece { vertices, ..*piece }));
        }
    }
}
