//! Triangles whose edges can be split, collapsed and flipped.
//!
//! Half-edge `h` runs counter-clockwise from a corner of triangle `h / 3` to the next corner. Its twin runs back, in the adjacent triangle.

use nalgebra::{Point3, Vector3};

use super::feature::Feature;

/// Index of a half-edge that does not exist, because no triangle is adjacent or the triangle is deleted.
pub(super) const NONE: u32 = u32::MAX;

/// Cosine of 60 degrees, the maximum angle by which an edge operation or a vertex motion may rotate a triangle's normal.
const MIN_COSINE: f64 = 0.5;

/// A triangle whose doubled area, divided by its squared longest edge, is less than this value is a needle. No triangle may become a
/// needle.
const NEEDLE: f64 = 0.02;

/// The freedom of a vertex to move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// The vertex moves on the surface.
    Smooth,
    /// The vertex moves along its feature curve (border, crease or sharp edge).
    Curve,
    /// The vertex does not move.
    Corner,
}

/// Returns the next half-edge of the same triangle, counter-clockwise.
#[inline]
pub(super) fn next(h: u32) -> u32 {
    if h % 3 == 2 { h - 2 } else { h + 1 }
}

#[inline]
pub(super) fn previous(h: u32) -> u32 {
    if h.is_multiple_of(3) { h + 2 } else { h - 1 }
}

/// A triangle mesh as half-edges. The triangles around each vertex form one fan: closed, or open at a border.
#[derive(Clone, Debug)]
pub(super) struct Net {
    pub(super) places: Vec<Point3<f64>>,
    pub(super) kinds: Vec<Kind>,
    /// The start vertex of each half-edge; `NONE` if the half-edge's triangle is deleted.
    pub(super) from: Vec<u32>,
    pub(super) twins: Vec<u32>,
    /// For each half-edge, the feature that contains it; `None` for an edge that is not a feature. Those of twins are each other's reverse.
    pub(super) features: Vec<Option<Feature>>,
    /// For each vertex, a triangle of the original surface near it. Nearest points are searched from there.
    pub(super) near: Vec<u32>,
    /// A half-edge that leaves each vertex; `NONE` if the vertex is deleted.
    pub(super) leaving: Vec<u32>,
    /// The deleted triangles and vertices, whose indices are reused.
    free_triangles: Vec<u32>,
    free_vertices: Vec<u32>,
}

impl Net {
    pub(super) fn new(places: Vec<Point3<f64>>, triangles: &[[u32; 3]], twins: Vec<u32>) -> Self {
        let from = triangles.as_flattened().to_vec();
        let mut leaving = vec![NONE; places.len()];
        (0..).zip(&from).for_each(|(h, &vertex)| leaving[vertex as usize] = h);
        let near = leaving.iter().map(|&h| if h == NONE { 0 } else { h / 3 }).collect();
        Self {
            kinds: vec![Kind::Smooth; places.len()],
            features: vec![None; from.len()],
            near,
            places,
            from,
            twins,
            leaving,
            free_triangles: Vec::new(),
            free_vertices: Vec::new(),
        }
    }

    #[inline]
    pub(super) fn from(&self, h: u32) -> u32 {
        self.from[h as usize]
    }

    #[inline]
    pub(super) fn end(&self, h: u32) -> u32 {
        self.from[next(h) as usize]
    }

    #[inline]
    pub(super) fn twin(&self, h: u32) -> u32 {
        self.twins[h as usize]
    }

    #[inline]
    pub(super) fn place(&self, vertex: u32) -> Point3<f64> {
        self.places[vertex as usize]
    }

    #[inline]
    pub(super) fn kind(&self, vertex: u32) -> Kind {
        self.kinds[vertex as usize]
    }

    pub(super) fn is_feature(&self, h: u32) -> bool {
        self.features[h as usize].is_some()
    }

    /// Marks an edge as a feature with the given crease sharpness.
    pub(super) fn set_feature(&mut self, h: u32, sharpness: f64) {
        self.mark_both(h, Some(Feature::new(sharpness)));
    }

    /// Returns the squared length of a half-edge.
    #[inline]
    pub(super) fn square(&self, h: u32) -> f64 {
        (self.place(self.end(h)) - self.place(self.from(h))).norm_squared()
    }

    /// Returns the corners of a triangle; `None` if the triangle is deleted.
    pub(super) fn triangle(&self, triangle: u32) -> Option<[u32; 3]> {
        let first = 3 * triangle as usize;
        (self.from[first] != NONE).then(|| [0, 1, 2].map(|k| self.from[first + k]))
    }

    /// Returns one half-edge of each edge.
    pub(super) fn edges(&self) -> impl Iterator<Item = u32> {
        (0..self.from.len() as u32)
            .filter(|&h| self.from(h) != NONE && (self.twin(h) == NONE || h < self.twin(h)))
    }

    /// Visits the half-edges that leave a vertex.
    #[inline]
    pub(super) fn visit(&self, vertex: u32, mut see: impl FnMut(u32)) {
        let start = self.leaving[vertex as usize];
        let mut h = start;
        loop {
            see(h);
            h = self.twin(previous(h));
            if h == start {
                return;
            }
            if h == NONE {
                break;
            }
        }
        // The walk has reached a border. Visit the remaining half-edges in the other direction from the start.
        let mut h = self.twin(start);
        while h != NONE {
            see(next(h));
            h = self.twin(next(h));
        }
    }

    /// Visits the neighbors of a vertex, each with a half-edge that connects both: one that leaves the vertex, or, along a border, one that
    /// arrives.
    #[inline]
    pub(super) fn visit_neighbors(&self, vertex: u32, mut see: impl FnMut(u32, u32)) {
        self.visit(vertex, |h| {
            see(self.end(h), h);
            let last = previous(h);
            if self.twin(last) == NONE {
                see(self.from(last), last);
            }
        });
    }

    fn neighbors(&self, vertex: u32) -> Vec<u32> {
        let mut neighbors = Vec::with_capacity(8);
        self.visit_neighbors(vertex, |neighbor, _| neighbors.push(neighbor));
        neighbors
    }

    fn valence(&self, vertex: u32) -> usize {
        let mut count = 0;
        self.visit_neighbors(vertex, |_, _| count += 1);
        count
    }

    fn join(&mut self, a: u32, b: u32) {
        if a != NONE {
            self.twins[a as usize] = b;
        }
        if b != NONE {
            self.twins[b as usize] = a;
        }
    }

    fn mark(&mut self, h: u32, feature: Option<Feature>) {
        if h != NONE {
            self.features[h as usize] = feature;
        }
    }

    /// Sets the feature of a half-edge and of its twin.
    pub(super) fn mark_both(&mut self, h: u32, feature: Option<Feature>) {
        self.mark(h, feature);
        self.mark(self.twin(h), feature.map(Feature::reversed));
    }

    fn new_triangle(&mut self, corners: [u32; 3]) -> u32 {
        let triangle = self.free_triangles.pop().unwrap_or_else(|| {
            self.from.extend([NONE; 3]);
            self.twins.extend([NONE; 3]);
            self.features.extend([None; 3]);
            self.from.len() as u32 / 3 - 1
        });
        let first = 3 * triangle;
        self.from[first as usize..][..3].copy_from_slice(&corners);
        first
    }

    fn new_vertex(&mut self, place: Point3<f64>, kind: Kind, near: u32) -> u32 {
        let vertex = self.free_vertices.pop().unwrap_or_else(|| {
            self.places.push(place);
            self.kinds.push(kind);
            self.near.push(near);
            self.leaving.push(NONE);
            self.places.len() as u32 - 1
        });
        self.places[vertex as usize] = place;
        self.kinds[vertex as usize] = kind;
        self.near[vertex as usize] = near;
        vertex
    }

    /// Inserts a vertex at the middle of an edge, and returns it.
    pub(super) fn split(&mut self, h: u32) -> u32 {
        let (a, b, twin) = (self.from(h), self.end(h), self.twin(h));
        let kind = if self.is_feature(h) { Kind::Curve } else { Kind::Smooth };
        let middle = nalgebra::center(&self.place(a), &self.place(b));
        let vertex = self.new_vertex(middle, kind, self.near[a as usize]);
        let front = self.halve(h, vertex);
        self.leaving[vertex as usize] = front;
        if twin == NONE {
            self.join(front, NONE);
        } else {
            let back = self.halve(twin, vertex);
            self.join(h, back);
            self.join(twin, front);
        }
        vertex
    }

    /// Splits the triangle of a half-edge in two at the vertex `middle`. Afterwards the half-edge ends at `middle`. Returns the new
    /// half-edge from `middle` to the old end; it has no twin.
    fn halve(&mut self, h: u32, middle: u32) -> u32 {
        let (h1, b) = (next(h), self.end(h));
        let (outer, of_outer) = (self.twin(h1), self.features[h1 as usize]);
        let other = self.new_triangle([middle, b, self.end(h1)]);
        self.from[h1 as usize] = middle;
        self.twins[other as usize] = NONE;
        let halves = self.features[h as usize].map(Feature::halves);
        self.mark(h, halves.map(|it| it[0]));
        self.mark(other, halves.map(|it| it[1]));
        self.join(other + 1, outer);
        self.mark(other + 1, of_outer);
        self.join(other + 2, h1);
        self.mark(other + 2, None);
        self.mark(h1, None);
        self.leaving[b as usize] = other + 1;
        other
    }

    /// Collapses an edge to its start, if the surface stays a manifold, no triangle flips, and the squared length of no edge becomes
    /// greater than `longest`. Returns true if the ends were merged.
    pub(super) fn collapse(&mut self, h: u32, longest: f64) -> bool {
        let (a, b, twin) = (self.from(h), self.end(h), self.twin(h));
        let may_move = match self.kind(b) {
            Kind::Smooth => true,
            Kind::Curve => self.is_feature(h),
            Kind::Corner => false,
        };
        if !may_move {
            return false;
        }
        // The collapse must satisfy the link condition of Dey, Edelsbrunner, Guha and Nekhayev, "Topology preserving edge contraction"
        // (1999).
        let (of_a, of_b) = (self.neighbors(a), self.neighbors(b));
        let common = of_b.iter().filter(|&vertex| of_a.contains(vertex)).count();
        let sides = if twin == NONE { 1 } else { 2 };
        if common != sides
            || !self.can_remove_triangle(h)
            || (twin != NONE && !self.can_remove_triangle(twin))
        {
            return false;
        }
        let place = match self.kind(a) == self.kind(b) {
            true => nalgebra::center(&self.place(a), &self.place(b)),
            false => self.place(a),
        };
        let fits = |vertex: u32, other: u32| {
            let mut fits = true;
            self.visit(vertex, |spoke| {
                let others = [self.end(spoke), self.from(previous(spoke))];
                if fits && !others.contains(&other) {
                    let [p, q] = others.map(|vertex| self.place(vertex));
                    fits = (p - place).norm_squared() <= longest
                        && (q - place).norm_squared() <= longest
                        && keeps_orientation([self.place(vertex), p, q], [place, p, q]);
                }
            });
            fits
        };
        if !fits(b, a) || (place != self.place(a) && !fits(a, b)) {
            return false;
        }
        if self.kind(b) == Kind::Curve
            && let Some(Feature { span: [start, end], .. }) = self.features[h as usize]
        {
            let moved = if self.kind(a) == Kind::Curve { (end - start) / 2.0 } else { 0.0 };
            self.slide(b, start + moved - end);
            self.slide(a, moved);
        }
        let mut fan = Vec::with_capacity(8);
        self.visit(b, |spoke| fan.push(spoke));
        fan.iter().for_each(|&spoke| self.from[spoke as usize] = a);
        self.remove_triangle(h, a);
        if twin != NONE {
            self.remove_triangle(twin, a);
        }
        self.places[a as usize] = place;
        self.leaving[b as usize] = NONE;
        self.free_vertices.push(b);
        true
    }

    /// Returns true if the triangle of a half-edge may be removed by merging the half-edge's ends, which joins the other two edges.
    fn can_remove_triangle(&self, h: u32) -> bool {
        let (h1, h2) = (next(h), previous(h));
        let apex = self.from(h2);
        let (x, y) = (self.twin(h1), self.twin(h2));
        // Two feature edges must not become one, and no vertex may keep two triangles or fewer.
        let closes = self.is_feature(h1) && self.is_feature(h2);
        let is_left_over = match (x, y) {
            (NONE, NONE) => true,
            (NONE, _) | (_, NONE) => false,
            _ => self.valence(apex) <= 3,
        };
        !closes && !is_left_over
    }

    /// Removes the triangle of a half-edge both of whose ends have become `vertex`.
    fn remove_triangle(&mut self, h: u32, vertex: u32) {
        let (h1, h2) = (next(h), previous(h));
        let apex = self.from(h2);
        let (x, y) = (self.twin(h1), self.twin(h2));
        let reversed = self.features[h2 as usize].map(Feature::reversed);
        let feature = self.features[h1 as usize].or(reversed);
        self.join(x, y);
        self.mark(x, feature.map(Feature::reversed));
        self.mark(y, feature);
        let (of_vertex, of_apex) = if x == NONE { (y, next(y)) } else { (next(x), x) };
        self.leaving[vertex as usize] = of_vertex;
        self.leaving[apex as usize] = of_apex;
        let first = h - h % 3;
        self.from[first as usize..][..3].fill(NONE);
        self.free_triangles.push(first / 3);
    }

    /// Returns true if an edge can be flipped: the edge has two triangles, the flip preserves their orientation, and the edge is not a
    /// feature.
    pub(super) fn is_flippable(&self, h: u32) -> bool {
        let twin = self.twin(h);
        if twin == NONE || self.is_feature(h) {
            return false;
        }
        let (a, b) = (self.from(h), self.end(h));
        let (c, d) = (self.from(previous(h)), self.from(previous(twin)));
        let mut are_joined = false;
        self.visit_neighbors(c, |neighbor, _| are_joined |= neighbor == d);
        if c == d || are_joined {
            return false;
        }
        let [p, q, r, s] = [a, b, c, d].map(|vertex| self.place(vertex));
        let (before, after) = ([[p, q, r], [q, p, s]], [[p, s, r], [s, q, r]]);
        let sum = area(before[0]) + area(before[1]);
        let worst = before.map(shape).into_iter().fold(f64::INFINITY, f64::min);
        after.into_iter().all(|triangle| {
            let area = area(triangle);
            let is_turned = area.dot(&sum) <= MIN_COSINE * area.norm() * sum.norm();
            !is_turned && (NEEDLE < shape(triangle) || worst < shape(triangle))
        })
    }

    /// Flips an edge for which [`is_flippable`](Self::is_flippable) is true.
    pub(super) fn flip(&mut self, h: u32) {
        let t = self.twin(h);
        let (h1, h2, t1, t2) = (next(h), previous(h), next(t), previous(t));
        let [a, b, c, d] = [h, t, h2, t2].map(|h| self.from(h));
        let outer = [h1, h2, t1, t2].map(|h| (self.twin(h), self.features[h as usize]));
        for (h, vertex) in [(h, d), (h1, c), (h2, a), (t, c), (t1, d), (t2, b)] {
            self.from[h as usize] = vertex;
        }
        let [of_h1, of_h2, of_t1, of_t2] = outer;
        for (h, (twin, feature)) in [(h1, of_h2), (h2, of_t1), (t1, of_t2), (t2, of_h1)] {
            self.join(h, twin);
            self.twins[h as usize] = twin;
            self.mark(h, feature);
        }
        for (vertex, h) in [(a, h2), (b, t2), (c, h1), (d, h)] {
            self.leaving[vertex as usize] = h;
        }
    }

    /// Moves a vertex to `place`, unless a triangle around the vertex would flip or become a needle. Returns true if the vertex was moved.
    pub(super) fn shift(&mut self, vertex: u32, place: Point3<f64>) -> bool {
        let old = self.place(vertex);
        let mut fits = true;
        self.visit(vertex, |h| {
            let others = [self.end(h), self.from(previous(h))].map(|vertex| self.place(vertex));
            fits &= keeps_orientation([old, others[0], others[1]], [place, others[0], others[1]]);
        });
        if fits {
            self.places[vertex as usize] = place;
        }
        fits
    }
}

#[inline]
fn area([a, b, c]: [Point3<f64>; 3]) -> Vector3<f64> {
    (b - a).cross(&(c - a))
}

/// Returns twice the area of a triangle divided by its squared longest edge: about 0.87 if equilateral, 0 if degenerate.
pub(super) fn shape(triangle: [Point3<f64>; 3]) -> f64 {
    let [a, b, c] = triangle;
    let longest =
        [b - a, c - b, a - c].map(|edge| edge.norm_squared()).into_iter().fold(0.0, f64::max);
    if longest > 0.0 { area(triangle).norm() / longest } else { 0.0 }
}

/// Returns true if a moved triangle keeps its orientation, and either is not a needle or is less thin than before.
#[inline]
fn keeps_orientation(before: [Point3<f64>; 3], after: [Point3<f64>; 3]) -> bool {
    let [old, new] = [before, after].map(area);
    let is_turned = old.dot(&new) < MIN_COSINE * old.norm() * new.norm();
    !is_turned && (NEEDLE < shape(after) || shape(before) < shape(after))
}
