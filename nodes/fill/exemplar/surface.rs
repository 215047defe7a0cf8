//! The faces and vertices around each vertex of a triangle mesh, and searches over them.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use maquette_base::topology::lists::Lists;
use nalgebra::{Point3, Vector3};

/// Index of a face or vertex that does not exist.
pub(super) const NONE: u32 = u32::MAX;

/// The adjacency of a triangle mesh.
pub(super) struct Surface<'a> {
    pub(super) faces: &'a [[u32; 3]],
    /// The faces around each vertex.
    around: Lists,
    /// The vertices connected to each vertex by an edge, ascending.
    rings: Lists,
    /// For each face, the adjacent faces: entry `k` is the face across the edge from corner `k` to the next corner.
    adjacent: Vec<[AdjacentFace; 3]>,
}

/// The face on the other side of an edge of a face.
#[derive(Clone, Copy)]
pub(super) struct AdjacentFace {
    /// The index of the adjacent face; [`NONE`] at a border.
    pub(super) face: u32,
    /// The index of the adjacent face's corner at which the edge ends.
    pub(super) end: u32,
    /// The vertex of the adjacent face that is opposite to the edge.
    pub(super) across: u32,
}

impl<'a> Surface<'a> {
    /// Builds the adjacency of a mesh with the given number of vertices.
    pub(super) fn new(vertices: usize, faces: &'a [[u32; 3]]) -> Self {
        let around = Lists::group(vertices, || {
            (0u32..).zip(faces).flat_map(|(face, ends)| ends.map(|end| (end, face)))
        });
        fn across(face: u32, [a, b]: [u32; 2], around: &Lists, faces: &[[u32; 3]]) -> AdjacentFace {
            let others = around.list(a as usize).iter().filter(|&&other| other != face);
            let found = others.copied().find_map(|other: u32| {
                let ends = faces[other as usize];
                let end = (0..3).find(|&k| [ends[k], ends[(k + 1) % 3]] == [b, a])?;
                Some(AdjacentFace { face: other, end: end as u32, across: ends[(end + 2) % 3] })
            });
            found.unwrap_or(AdjacentFace { face: NONE, end: 0, across: 0 })
        }
        fn sides([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
            [[a, b], [b, c], [c, a]]
        }
        let beside = (0u32..)
            .zip(faces)
            .map(|(face, &ends)| sides(ends).map(|s| across(face, s, &around, faces)));
        let beside = beside.collect();
        let mut ring = Vec::new();
        let rings = Lists::collect((0..vertices).map(|vertex| {
            ring.clear();
            let ends = around.list(vertex).iter().flat_map(|&face| faces[face as usize]);
            ring.extend(ends.filter(|&end| end != vertex as u32));
            ring.sort_unstable();
            ring.dedup();
            ring.clone()
        }));
        Self { faces, around, rings, adjacent: beside }
    }

    /// The number of vertices.
    pub(super) fn len(&self) -> usize {
        self.rings.len()
    }

    /// Returns the vertices connected to a vertex by an edge.
    pub(super) fn ring(&self, vertex: u32) -> &[u32] {
        self.rings.list(vertex as usize)
    }

    /// Returns the faces around a vertex.
    pub(super) fn faces_around(&self, vertex: u32) -> &[u32] {
        self.around.list(vertex as usize)
    }

    /// Returns the face across the edge from corner `corner` of a face to the next corner.
    #[inline(always)]
    pub(super) fn adjacent_face(&self, face: u32, corner: usize) -> AdjacentFace {
        self.adjacent.as_flattened()[3 * face as usize + corner]
    }

    /// Returns the positions of a face's corners.
    pub(super) fn corners(&self, points: &[Point3<f64>], face: u32) -> [Point3<f64>; 3] {
        self.faces[face as usize].map(|vertex| points[vertex as usize])
    }

    /// Returns twice the sum of the area vectors of the faces around a vertex.
    pub(super) fn area(&self, points: &[Point3<f64>], vertex: u32) -> Vector3<f64> {
        self.area_before(points, vertex, NONE)
    }

    /// Like [`area`](Self::area), but sums only over faces with an index below `limit`.
    pub(super) fn area_before(
        &self,
        points: &[Point3<f64>],
        vertex: u32,
        limit: u32,
    ) -> Vector3<f64> {
        self.faces_around(vertex)
            .iter()
            .filter(|face| **face < limit)
            .map(|&face| {
                let [a, b, c] = self.corners(points, face);
                (b - a).cross(&(c - a))
            })
            .sum()
    }

    /// Returns the vertices within the distance `radius` of a vertex that are connected to it by edges inside this ball, the vertex itself
    /// first. Vertices for which `open` is false are left out.
    pub(super) fn ball(
        &self,
        points: &[Point3<f64>],
        from: u32,
        radius: f64,
        open: impl Fn(u32) -> bool,
        marks: &mut Marks,
    ) -> Vec<u32> {
        let center = points[from as usize];
        marks.next();
        marks.mark(from);
        let mut reached = vec![from];
        let mut next = 0;
        while let Some(&vertex) = reached.get(next) {
            next += 1;
            for &other in self.ring(vertex) {
                let distance_sq = (points[other as usize] - center).norm_squared();
                if marks.mark(other) && distance_sq <= radius * radius && open(other) {
                    reached.push(other);
                }
            }
        }
        reached
    }

    /// Walks along edges from vertex to vertex as long as the distance to `to` decreases, using vertices with an index below `limit`.
    /// Returns the last vertex.
    pub(super) fn walk_to_nearest(
        &self,
        points: &[Point3<f64>],
        from: u32,
        to: &Point3<f64>,
        limit: u32,
    ) -> u32 {
        let (mut here, mut min_distance_sq) = (from, (points[from as usize] - to).norm_squared());
        loop {
            let before = here;
            for &other in self.ring(before).iter().filter(|&&other| other < limit) {
                let distance_sq = (points[other as usize] - to).norm_squared();
                if distance_sq < min_distance_sq {
                    (here, min_distance_sq) = (other, distance_sq);
                }
            }
            if here == before {
                return here;
            }
        }
    }

    /// Returns, for each vertex, the nearest of the vertices in `sources`, found approximately by passing sources from neighbor to
    /// neighbor. [`NONE`] if the distance exceeds `max_distance` or if no edges connect the vertex to a source.
    pub(super) fn nearest(
        &self,
        points: &[Point3<f64>],
        sources: impl Iterator<Item = u32>,
        max_distance: f64,
    ) -> Vec<u32> {
        let mut nearest = vec![NONE; points.len()];
        // Distances are nonnegative, so their bits sort in the order of the numbers.
        let mut queue: BinaryHeap<_> = sources.map(|source| Reverse((0, source, source))).collect();
        while let Some(Reverse((_, source, vertex))) = queue.pop() {
            if nearest[vertex as usize] != NONE {
                continue;
            }
            nearest[vertex as usize] = source;
            for &other in self.ring(vertex) {
                let distance = (points[other as usize] - points[source as usize]).norm();
                if nearest[other as usize] == NONE && distance <= max_distance {
                    queue.push(Reverse((distance.to_bits(), source, other)));
                }
            }
        }
        nearest
    }
}

/// The set of vertices that a search has visited. It is cleared in constant time.
pub(super) struct Marks {
    seen: Vec<u32>,
    now: u32,
}

impl Marks {
    /// Creates an empty set for the given number of vertices.
    pub(super) fn new(vertices: usize) -> Self {
        Self { seen: vec![0; vertices], now: 0 }
    }

    fn next(&mut self) {
        self.now += 1;
    }

    /// Adds a vertex to the set; returns true if it was not in the set.
    fn mark(&mut self, vertex: u32) -> bool {
        std::mem::replace(&mut self.seen[vertex as usize], self.now) != self.now
    }
}
