//! Makes a manifold of the parts of a surface: solids that touch in a vertex or along an edge are separated there.

use std::collections::BTreeMap;

use maquette_base::topology::union_find::UnionFind;
use maquette_value::parallel::ParallelSliceMut;
use nalgebra::{Point3, Vector3};

use super::points::Points;
use super::select::KeptPart;

/// The origin of a vertex.
#[derive(Clone, Copy, Debug)]
pub(super) enum Origin {
    /// A point, and a part of which it is a corner.
    Corner { part: usize, point: u32 },
    /// The middle between two vertices, on an edge of a part.
    Middle { part: usize, ends: [u32; 2] },
}

/// The vertices of parts after touching solids are separated. Half-edge `3 n + k` runs from corner `k` of part `n` to the next corner.
pub(super) struct Separated {
    /// The vertex of each corner of the parts.
    vertices: Vec<u32>,
    /// The point of each corner of the parts.
    points: Vec<u32>,
    origins: Vec<Origin>,
    /// The vertices in the middle of half-edges.
    middles: BTreeMap<usize, u32>,
}

impl Separated {
    /// Returns `None` if the parts are not closed.
    pub(super) fn new(kept: &[KeptPart], points: &Points) -> Option<Self> {
        let corners: Vec<u32> = kept.iter().flat_map(|it| it.corners).collect();
        let twins = twins(&corners, points)?;
        let mut fans = UnionFind::new(corners.len());
        for (half, &twin) in twins.iter().enumerate() {
            fans.union(half as u32, next(twin) as u32);
        }
        // Number the fans by their points, so that vertices stay in order.
        let mut roots: Vec<u32> =
            (0..corners.len() as u32).filter(|&corner| fans.find(corner) == corner).collect();
        roots.sort_by_key(|&root| (corners[root as usize], root));
        let mut numbers = vec![0; corners.len()];
        (0..).zip(&roots).for_each(|(number, &root)| numbers[root as usize] = number);
        let vertices: Vec<u32> =
            (0..corners.len() as u32).map(|it| numbers[fans.find(it) as usize]).collect();
        let origins = roots
            .iter()
            .map(|&root| Origin::Corner { part: root as usize / 3, point: corners[root as usize] })
            .collect();
        let mut separated = Self { vertices, points: corners, origins, middles: BTreeMap::new() };
        separated.divide_duplicate_edges(&twins);
        Some(separated)
    }

    /// If several edges connect the same two vertices, adds a vertex in the middle of all but the first.
    fn divide_duplicate_edges(&mut self, twins: &[usize]) {
        let mut edges: Vec<([u32; 2], usize)> = (0..twins.len())
            .filter(|&half| half < twins[half])
            .map(|half| (sorted(self.ends(half)), half))
            .collect();
        edges.sort_unstable();
        for same in edges.chunk_by(|a, b| a.0 == b.0) {
            for &(ends, half) in &same[1..] {
                let middle = self.origins.len() as u32;
                self.origins.push(Origin::Middle { part: half / 3, ends });
                self.middles.extend([(half, middle), (twins[half], middle)]);
            }
        }
    }

    fn ends(&self, half: usize) -> [u32; 2] {
        [self.vertices[half], self.vertices[next(half)]]
    }

    pub(super) fn count(&self) -> usize {
        self.origins.len()
    }

    pub(super) fn origin(&self, vertex: u32) -> Origin {
        self.origins[vertex as usize]
    }

    /// Returns the vertex of a part's corner.
    pub(super) fn vertex(&self, part: usize, corner: usize) -> u32 {
        self.vertices[3 * part + corner]
    }

    /// Returns true if an edge of a part has a vertex in its middle.
    pub(super) fn is_divided(&self, part: usize) -> bool {
        self.middles.range(3 * part..3 * part + 3).next().is_some()
    }

    /// Returns the triangles of a part: for each corner its vertex and its point, which a middle of an edge does not have.
    pub(super) fn triangles(&self, part: usize) -> Vec<[(u32, Option<u32>); 3]> {
        let mut ring = Vec::with_capacity(6);
        let mut start = 0;
        for half in 3 * part..3 * part + 3 {
            ring.push((self.vertices[half], Some(self.points[half])));
            if let Some(&middle) = self.middles.get(&half) {
                start = ring.len();
                ring.push((middle, None));
            }
        }
        // Start the fan at a middle, if there is one, so that no triangle has collinear corners.
        ring.rotate_left(start);
        ring[1..].windows(2).map(|pair| [ring[0], pair[0], pair[1]]).collect()
    }

    /// Returns the edges between points: for each pair of points the pairs of vertices.
    pub(super) fn edges(&self, kept: &[KeptPart]) -> BTreeMap<[u32; 2], Vec<[u32; 2]>> {
        let mut edges: BTreeMap<[u32; 2], Vec<[u32; 2]>> = BTreeMap::new();
        for half in (0..3 * kept.len()).filter(|half| !self.middles.contains_key(half)) {
            let key = sorted([self.points[half], self.points[next(half)]]);
            let own = edges.entry(key).or_default();
            let ends = sorted(self.ends(half));
            if !own.contains(&ends) {
                own.push(ends);
            }
        }
        edges
    }
}

fn next(half: usize) -> usize {
    half / 3 * 3 + (half + 1) % 3
}

fn sorted([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Returns the opposite of each half-edge. Where more than two parts meet at an edge, those that bound the same solid are paired. `None` if
/// the parts are not closed.
fn twins(corners: &[u32], points: &Points) -> Option<Vec<usize>> {
    fn ends(half: usize, corners: &[u32]) -> [u32; 2] {
        [corners[half], corners[next(half)]]
    }
    let mut order: Vec<usize> = (0..corners.len()).collect();
    order.par_sort_unstable_by_key(|&half| (sorted(ends(half, corners)), half));
    let mut twins = vec![usize::MAX; corners.len()];
    fn link(a: usize, b: usize, twins: &mut [usize]) {
        twins[a] = b;
        twins[b] = a;
    }
    for same in order.chunk_by(|&a, &b| sorted(ends(a, corners)) == sorted(ends(b, corners))) {
        let is_forward = |half: usize| ends(half, corners)[0] < ends(half, corners)[1];
        let forward = same.iter().filter(|&&half| is_forward(half)).count();
        if 2 * forward != same.len() {
            return None;
        }
        if let [a, b] = *same {
            link(a, b, &mut twins);
            continue;
        }
        // In the order of angles around the edge, the inside of a solid extends from a part with a backward half-edge to the next part with
        // a forward half-edge.
        let mut open = Vec::new();
        let mut is_linked = vec![false; same.len()];
        let round = by_angle(same, corners, points);
        for &(k, half) in round.iter().chain(&round) {
            if is_linked[k] || open.iter().any(|&(other, _)| other == k) {
                continue;
            }
            if !is_forward(half) {
                open.push((k, half));
            } else if let Some((other, back)) = open.pop() {
                is_linked[k] = true;
                is_linked[other] = true;
                link(half, back, &mut twins);
            }
        }
    }
    (!twins.contains(&usize::MAX)).then_some(twins)
}

/// Returns half-edges between the same points, with their indices in the list, in the order of angles around the edge.
fn by_angle(same: &[usize], corners: &[u32], points: &Points) -> Vec<(usize, usize)> {
    let place = |corner: usize| Point3::from(points.rounded(corners[corner]));
    fn is_forward(half: usize, corners: &[u32]) -> bool {
        corners[half] < corners[next(half)]
    }
    let [start, end] = match is_forward(same[0], corners) {
        true => [same[0], next(same[0])],
        false => [next(same[0]), same[0]],
    }
    .map(place);
    let axis: Vector3<f64> = (end - start).normalize();
    let across = |half: usize| axis.cross(&(place(next(next(half))) - start));
    let x = across(same[0]);
    let mut round: Vec<(f64, usize, usize)> = same
        .iter()
        .enumerate()
        .map(|(k, &half)| {
            let own = across(half);
            (libm::atan2(x.cross(&own).dot(&axis), x.dot(&own)), k, half)
        })
        .collect();
    round.sort_by(|a, b| {
        a.0.total_cmp(&b.0)
            .then(is_forward(b.2, corners).cmp(&is_forward(a.2, corners)))
            .then(a.2.cmp(&b.2))
    });
    round.into_iter().map(|(_, k, half)| (k, half)).collect()
}
