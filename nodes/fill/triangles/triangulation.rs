//! The triangulation that fills a hole, stored as half-edges, so that edges can be flipped, split and collapsed.

use nalgebra::{Point3, Vector3};

/// Index of a half-edge or vertex that does not exist.
pub(crate) const NONE: u32 = u32::MAX;

/// The triangulation that fills a hole. Half-edge `h` runs from corner `h` of face `h / 3` to the next corner of that face.
///
/// The first `fixed` vertices are the rim of the hole: they are never moved or removed. A caller that adds an edge between two of them must
/// first check that the mesh has no such edge.
#[derive(Clone, Debug, Default)]
pub(crate) struct Triangulation {
    pub(crate) points: Vec<Point3<f64>>,
    pub(crate) fixed: usize,
    /// The vertex at each corner; [`NONE`] for a removed face.
    pub(crate) corners: Vec<u32>,
    /// The opposite half-edge of each half-edge; [`NONE`] at the rim.
    pub(crate) twins: Vec<u32>,
    /// A half-edge that leaves each vertex; [`NONE`] for a removed vertex.
    pub(crate) leaving: Vec<u32>,
}

/// Returns the half-edge after `half` in its face.
pub(crate) fn next(half: u32) -> u32 {
    if half % 3 == 2 { half - 2 } else { half + 1 }
}

/// Returns the half-edge before `half` in its face.
pub(crate) fn previous(half: u32) -> u32 {
    if half.is_multiple_of(3) { half + 2 } else { half - 1 }
}

impl Triangulation {
    /// Returns a triangulation with the given faces over `points`, the first `fixed` of which are the rim of the hole.
    pub(crate) fn new(points: Vec<Point3<f64>>, fixed: usize, faces: &[[u32; 3]]) -> Self {
        let corners = faces.as_flattened().to_vec();
        let mut leaving = vec![NONE; points.len()];
        (0..).zip(&corners).for_each(|(half, &from)| leaving[from as usize] = half);
        let mut triangulation =
            Self { points, fixed, twins: vec![NONE; corners.len()], corners, leaving };
        triangulation.link();
        triangulation
    }

    /// Finds the opposite half-edges (twins). Half-edges are sorted by their vertices, which puts the two half-edges of an edge next to
    /// each other.
    fn link(&mut self) {
        let halves = 0..self.corners.len() as u32;
        let mut ends: Vec<([u32; 2], u32)> = halves
            .map(|half| {
                let [a, b] = self.ends(half);
                ([a.min(b), a.max(b)], half)
            })
            .collect();
        ends.sort_unstable();
        for pair in ends.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
            self.join_twins(pair[0].1, pair[1].1);
        }
    }

    fn join_twins(&mut self, a: u32, b: u32) {
        if a != NONE {
            self.twins[a as usize] = b;
        }
        if b != NONE {
            self.twins[b as usize] = a;
        }
    }

    pub(crate) fn ends(&self, half: u32) -> [u32; 2] {
        [self.corners[half as usize], self.corners[next(half) as usize]]
    }

    pub(crate) fn is_alive(&self, half: u32) -> bool {
        self.corners[half as usize] != NONE
    }

    pub(crate) fn is_rim(&self, vertex: u32) -> bool {
        (vertex as usize) < self.fixed
    }

    /// Returns each edge that has two faces once, as the half-edge with the lower index.
    pub(crate) fn inner_edges(&self) -> impl Iterator<Item = u32> {
        let halves = 0..self.corners.len() as u32;
        halves.filter(|&half| {
            let twin = self.twins[half as usize];
            self.is_alive(half) && twin != NONE && half < twin
        })
    }

    pub(crate) fn length(&self, half: u32) -> f64 {
        let [a, b] = self.ends(half).map(|vertex| self.points[vertex as usize]);
        (b - a).norm()
    }

    /// Returns the half-edges that leave an inner vertex, in order around it.
    pub(crate) fn halves_around(&self, vertex: u32) -> impl Iterator<Item = u32> {
        let first = self.leaving[vertex as usize];
        let mut half = first;
        std::iter::from_fn(move || {
            if half == NONE {
                return None;
            }
            let this = half;
            half = self.twins[previous(half) as usize];
            if half == first {
                half = NONE;
            }
            Some(this)
        })
    }

    /// Returns the vertices connected to an inner vertex by an edge.
    fn neighbors(&self, vertex: u32) -> impl Iterator<Item = u32> {
        self.halves_around(vertex).map(|half| self.ends(half)[1])
    }

    /// Returns the ends of an edge and the opposite corners of its two faces. Also returns the twins of the other four half-edges of the
    /// two faces.
    fn diamond(&self, half: u32, twin: u32) -> ([u32; 4], [u32; 4]) {
        let [a, b] = self.ends(half);
        let [c, d] = [half, twin].map(|half| self.corners[previous(half) as usize]);
        let sides = [next(half), previous(half), next(twin), previous(twin)];
        ([a, b, c, d], sides.map(|half| self.twins[half as usize]))
    }

    /// Flips an edge: replaces it by the other diagonal of the quadrilateral formed by its two faces.
    pub(crate) fn flip(&mut self, half: u32) {
        let twin = self.twins[half as usize];
        let ([a, b, c, d], [bc, ca, ad, db]) = self.diamond(half, twin);
        let (f, g) = (half / 3 * 3, twin / 3 * 3);
        self.set_face(f, [a, d, c]);
        self.set_face(g, [d, b, c]);
        self.join_twins(f, ad);
        self.join_twins(f + 1, g + 2);
        self.join_twins(f + 2, ca);
        self.join_twins(g, db);
        self.join_twins(g + 1, bc);
    }

    fn set_face(&mut self, first: u32, vertices: [u32; 3]) {
        for (half, vertex) in (first..).zip(vertices) {
            self.corners[half as usize] = vertex;
            self.leaving[vertex as usize] = half;
        }
    }

    fn add_face(&mut self) -> u32 {
        let first = self.corners.len() as u32;
        self.corners.extend([NONE; 3]);
        self.twins.extend([NONE; 3]);
        first
    }

    fn add_vertex(&mut self, point: Point3<f64>) -> u32 {
        self.points.push(point);
        self.leaving.push(NONE);
        self.points.len() as u32 - 1
    }

    /// Inserts a vertex at `point` into an inner edge. Returns the new vertex.
    pub(crate) fn split(&mut self, half: u32, point: Point3<f64>) -> u32 {
        let twin = self.twins[half as usize];
        let ([a, b, c, d], [bc, ca, ad, db]) = self.diamond(half, twin);
        let m = self.add_vertex(point);
        let (f, g) = (half / 3 * 3, twin / 3 * 3);
        let (p, q) = (self.add_face(), self.add_face());
        self.set_face(f, [a, m, c]);
        self.set_face(p, [m, b, c]);
        self.set_face(g, [m, a, d]);
        self.set_face(q, [b, m, d]);
        self.join_twins(f, g);
        self.join_twins(f + 1, p + 2);
        self.join_twins(f + 2, ca);
        self.join_twins(p, q);
        self.join_twins(p + 1, bc);
        self.join_twins(g + 1, ad);
        self.join_twins(g + 2, q + 1);
        self.join_twins(q + 2, db);
        m
    }

    /// Inserts the rim vertex `vertex` into the border edge `half`.
    pub(crate) fn split_border(&mut self, half: u32, vertex: u32) {
        let [a, b] = self.ends(half);
        let c = self.corners[previous(half) as usize];
        let [bc, ca] = [next(half), previous(half)].map(|half| self.twins[half as usize]);
        let f = half / 3 * 3;
        let p = self.add_face();
        self.set_face(f, [a, vertex, c]);
        self.set_face(p, [vertex, b, c]);
        self.twins[f as usize] = NONE;
        self.join_twins(f + 1, p + 2);
        self.join_twins(f + 2, ca);
        self.join_twins(p + 1, bc);
    }

    /// Returns true if the start of `half` can be collapsed into its end so that the result is manifold.
    ///
    /// Uses the link condition of Dey, Edelsbrunner, Guha and Nekhayev, "Topology preserving edge contraction" (1999). In addition, the
    /// collapse must not create an edge between two rim vertices, since the input mesh could have the same edge.
    pub(crate) fn may_collapse(&self, half: u32) -> bool {
        let [v, u] = self.ends(half);
        let twin = self.twins[half as usize];
        if self.is_rim(v) || twin == NONE {
            return false;
        }
        let pairs = [[next(half), previous(half)], [next(twin), previous(twin)]];
        if pairs.iter().any(|pair| pair.iter().all(|&half| self.twins[half as usize] == NONE)) {
            return false;
        }
        let c = self.corners[previous(half) as usize];
        let d = self.corners[previous(twin) as usize];
        if c == d {
            return false;
        }
        let mut others = self.neighbors(v).filter(|&w| w != u && w != c && w != d);
        if self.is_rim(u) {
            // `halves_around` works for inner vertices only, so search the ring of `w` instead of that of `u`.
            return others.all(|w| !self.is_rim(w) && self.neighbors(w).all(|other| other != u));
        }
        let others: Vec<u32> = others.collect();
        self.neighbors(u).all(|w| !others.contains(&w))
    }

    /// Collapses the edge of `half` into its end, which keeps its position. The start vertex is removed.
    pub(crate) fn collapse(&mut self, half: u32) {
        let twin = self.twins[half as usize];
        let [v, u] = self.ends(half);
        let changed: Vec<u32> = self.halves_around(v).collect();
        changed.into_iter().for_each(|half| self.corners[half as usize] = u);
        for half in [half, twin] {
            let [a, b] = [next(half), previous(half)].map(|half| self.twins[half as usize]);
            let opposite = self.corners[previous(half) as usize];
            self.join_twins(a, b);
            // `a` and `b` are the twins of the other two sides of a collapsed triangle; `NONE` at the border. At most one of them is
            // `NONE`. A twin that is not `NONE` has an end at the triangle's third vertex, `opposite`.
            let kept = if a != NONE { a } else { b };
            for half in [kept, next(kept)] {
                let from = self.corners[half as usize];
                if from == opposite || from == u {
                    self.leaving[from as usize] = half;
                }
            }
        }
        for first in [half / 3 * 3, twin / 3 * 3] {
            (first..first + 3).for_each(|half| {
                self.corners[half as usize] = NONE;
                self.twins[half as usize] = NONE;
            });
        }
        self.leaving[v as usize] = NONE;
    }

    /// Returns the number of faces that are not removed.
    pub(crate) fn n_faces(&self) -> usize {
        self.corners.as_chunks::<3>().0.iter().filter(|face| face[0] != NONE).count()
    }

    /// Returns the remaining faces with vertices renumbered without gaps, and the old number of each new vertex. Rim vertices come first,
    /// then the other vertices in order.
    pub(crate) fn compact(&self) -> (Vec<[u32; 3]>, Vec<u32>) {
        let mut numbers = vec![NONE; self.points.len()];
        let mut kept: Vec<u32> = (0..self.fixed as u32).collect();
        kept.extend(
            (self.fixed as u32..self.points.len() as u32)
                .filter(|&v| self.leaving[v as usize] != NONE),
        );
        (0..).zip(&kept).for_each(|(number, &vertex)| numbers[vertex as usize] = number);
        let faces = self.corners.as_chunks::<3>().0.iter().filter(|face| face[0] != NONE);
        (faces.map(|face| face.map(|vertex| numbers[vertex as usize])).collect(), kept)
    }
}

/// Returns the cotangent of the angle at `apex` between the directions to two points.
pub(crate) fn cotangent(apex: Point3<f64>, a: Point3<f64>, b: Point3<f64>) -> f64 {
    let [u, v] = [a - apex, b - apex];
    u.dot(&v) / u.cross(&v).norm().max(f64::MIN_POSITIVE)
}

/// Returns twice the vector area of a triangle: a vector along the normal whose length is twice the area.
pub(crate) fn area_vector([a, b, c]: [Point3<f64>; 3]) -> Vector3<f64> {
    (b - a).cross(&(c - a))
}
