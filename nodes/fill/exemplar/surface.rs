//! The neighborhoods of a triangle mesh, and searches over them.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use maquette_base::topology::lists::Lists;
use nalgebra::{Point3, Vector3};

/// In place of a face or vertex that does not exist.
pub(super) const NONE: u32 = u32::MAX;

/// The neighborhoods of a mesh of triangles.
pub(super) struct Surface<'a> {
    pub(super) faces: &'a [[u32; 3]],
    /// The faces around each vertex.
    around: Lists,
    /// The vertices joined to each vertex by an edge, in ascending order.
    rings: Lists,
    /// What is across the edge from each corner of a face to its next.
    beside: Vec<[Beside; 3]>,
}

/// What is across an edge of a face.
#[derive(Clone, Copy)]
pub(super) struct Beside {
    /// [`NONE`] at a border.
    pub(super) face: u32,
    /// The corner of that face with which the edge ends.
    pub(super) end: u32,
    /// The vertex of its other corner.
    pub(super) across: u32,
}

impl<'a> Surface<'a> {
    /// Of `vertices` vertices.
    pub(super) fn new(vertices: usize, faces: &'a [[u32; 3]]) -> Self {
        let around = Lists::group(vertices, || {
            (0u32..).zip(faces).flat_map(|(face, ends)| ends.map(|end| (end, face)))
        });
        fn across(face: u32, [a, b]: [u32; 2], around: &Lists, faces: &[[u32; 3]]) -> Beside {
            let others = around.of(a as usize).iter().filter(|&&other| other != face);
            let found = others.copied().find_map(|other: u32| {
                let ends = faces[other as usize];
                let end = (0..3).find(|&k| [ends[k], ends[(k + 1) % 3]] == [b, a])?;
                Some(Beside { face: other, end: end as u32, across: ends[(end + 2) % 3] })
            });
            found.unwrap_or(Beside { face: NONE, end: 0, across: 0 })
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
            let ends = around.of(vertex).iter().flat_map(|&face| faces[face as usize]);
            ring.extend(ends.filter(|&end| end != vertex as u32));
            ring.sort_unstable();
            ring.dedup();
            ring.clone()
        }));
        Self { faces, around, rings, beside }
    }

    /// The number of vertices.
    pub(super) fn len(&self) -> usize {
        self.rings.len()
    }

    /// The vertices joined to one by an edge.
    pub(super) fn ring(&self, vertex: u32) -> &[u32] {
        self.rings.of(vertex as usize)
    }

    /// The faces around a vertex.
    pub(super) fn around(&self, vertex: u32) -> &[u32] {
        self.around.of(vertex as usize)
    }

    /// What is across the edge from a corner of a face to its next.
    #[inline(always)]
    pub(super) fn beside(&self, face: u32, corner: usize) -> Beside {
        self.beside.as_flattened()[3 * face as usize + corner]
    }

    /// Twice the sum of the area vectors of the faces around a vertex.
    pub(super) fn area(&self, points: &[Point3<f64>], vertex: u32) -> Vector3<f64> {
        self.area_before(points, vertex, NONE)
    }

    /// The same of the faces before `limit` alone.
    pub(super) fn area_before(
        &self,
        points: &[Point3<f64>],
        vertex: u32,
        limit: u32,
    ) -> Vector3<f64> {
        self.around(vertex)
            .iter()
            .filter(|face| **face < limit)
            .map(|&face| {
                let [a, b, c] = self.faces[face as usize].map(|end| points[end as usize]);
                (b - a).cross(&(c - a))
            })
            .sum()
    }

    /// The vertices within `radius` of a vertex that are reached over edges between such, the vertex first. Those for which `open`
    /// is false are left out.
    pub(super) fn ball(
        &self,
        points: &[Point3<f64>],
        from: u32,
        radius: f64,
        open: impl Fn(u32) -> bool,
        marks: &mut Marks,
    ) -> Vec<u32> {
        let center = points[from as usize];
        let inside = |vertex: u32| {
            (points[vertex as usize] - center).norm_squared() <= radius * radius && open(vertex)
        };
        marks.next();
        marks.mark(from);
        let mut reached = vec![from];
        let mut next = 0;
        while let Some(&vertex) = reached.get(next) {
            next += 1;
            for &other in self.ring(vertex) {
                if marks.mark(other) && inside(other) {
                    reached.push(other);
                }
            }
        }
        reached
    }

    /// The vertex below `limit` that is reached from `from` by going on to the neighbor nearest to `to` as long as one is nearer.
    pub(super) fn descend(
        &self,
        points: &[Point3<f64>],
        from: u32,
        to: &Point3<f64>,
        limit: u32,
    ) -> u32 {
        fn distance(vertex: u32, to: &Point3<f64>, points: &[Point3<f64>]) -> f64 {
            (points[vertex as usize] - to).norm_squared()
        }
        let (mut here, mut least) = (from, distance(from, to, points));
        loop {
            let before = here;
            for &other in self.ring(before) {
                if other < limit && distance(other, to, points) < least {
                    (here, least) = (other, distance(other, to, points));
                }
            }
            if here == before {
                return here;
            }
        }
    }

    /// For each vertex the source that is nearest to it among those of its neighbors, found from the sources outward; [`NONE`]
    /// beyond `most` and where no edge leads.
    pub(super) fn nearest(
        &self,
        points: &[Point3<f64>],
        sources: impl Iterator<Item = u32>,
        most: f64,
    ) -> Vec<u32> {
        let mut nearest = vec![NONE; points.len()];
        // Distances are not negative, so that their bits are in their order.
        let mut queue: BinaryHeap<_> = sources.map(|source| Reverse((0, source, source))).collect();
        while let Some(Reverse((_, source, vertex))) = queue.pop() {
            if nearest[vertex as usize] != NONE {
                continue;
            }
            nearest[vertex as usize] = source;
            for &other in self.ring(vertex) {
                let distance = (points[other as usize] - points[source as usize]).norm();
                if nearest[other as usize] == NONE && distance <= most {
                    queue.push(Reverse((distance.to_bits(), source, other)));
                }
            }
        }
        nearest
    }
}

/// Vertices seen by a search, forgotten at once by the next.
pub(super) struct Marks {
    seen: Vec<u32>,
    now: u32,
}

impl Marks {
    /// Of so many vertices.
    pub(super) fn new(vertices: usize) -> Self {
        Self { seen: vec![0; vertices], now: 0 }
    }

    fn next(&mut self) {
        self.now += 1;
    }

    /// Whether the vertex was not seen yet.
    fn mark(&mut self, vertex: u32) -> bool {
        std::mem::replace(&mut self.seen[vertex as usize], self.now) != self.now
    }
}
