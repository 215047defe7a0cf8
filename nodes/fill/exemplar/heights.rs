//! A local surface as heights over the plane of a frame.

use std::cmp::Ordering;

use nalgebra::{Point3, Vector3};

use super::frame::Frame;
use super::surface::{NONE, Surface};

/// Nodes of a lattice to each side of its middle. Fewer blur what a patch of some 7 edges across shows; more cost memory.
const HALF: usize = 8;

/// Nodes in a row.
pub(super) const SIDE: usize = 2 * HALF + 1;

/// Nodes of a lattice.
pub(super) const NODES: usize = SIDE * SIDE;

/// A node of a lattice that lies in its disk.
struct Node {
    /// Its index, and that of the node one step nearer to the middle.
    index: usize,
    inner: usize,
    /// Columns and rows from the middle.
    at: [f64; 2],
}

/// Where heights are measured: at the nodes of a square lattice as far as they lie in a disk.
pub(super) struct Lattice {
    pub(super) step: f64,
    /// From the middle outward.
    nodes: Vec<Node>,
}

impl Lattice {
    /// For a disk of this radius.
    pub(super) fn new(radius: f64) -> Self {
        let half = HALF as i32;
        let index = |x: i32, y: i32| ((y + half) * (2 * half + 1) + x + half) as usize;
        let mut nodes: Vec<(i32, i32)> =
            (-half..=half).flat_map(|y| (-half..=half).map(move |x| (x, y))).collect();
        nodes.retain(|(x, y)| x * x + y * y <= half * half + half);
        nodes.sort_by_key(|(x, y)| (x.abs().max(y.abs()), *y, *x));
        let node = |&(x, y): &(i32, i32)| {
            let inner = match x.abs().cmp(&y.abs()) {
                Ordering::Less => index(x, y - y.signum()),
                Ordering::Equal => index(x - x.signum(), y - y.signum()),
                Ordering::Greater => index(x - x.signum(), y),
            };
            Node { index: index(x, y), inner, at: [f64::from(x), f64::from(y)] }
        };
        Self { step: radius / HALF as f64, nodes: nodes.iter().map(node).collect() }
    }

    /// The nodes of the disk whose distance from the middle is at most `share` of its radius: their indices.
    pub(super) fn inside(&self, share: f64) -> Vec<usize> {
        let most = share * HALF as f64;
        let near = self.nodes.iter().filter(|node| {
            let [x, y] = node.at;
            x * x + y * y <= most * most
        });
        near.map(|node| node.index).collect()
    }

    /// Measures the surface around a vertex over the plane of a frame at it: from node to node over the triangles before `limit`.
    /// NaN where they end or turn away. Returns the share of the disk's nodes that have a height.
    pub(super) fn measure(
        &self,
        surface: &Surface<'_>,
        points: &[Point3<f64>],
        limit: u32,
        vertex: u32,
        frame: &Frame,
        heights: &mut [f32],
    ) -> f64 {
        heights.fill(f32::NAN);
        let mut found = [NONE; NODES];
        let first = surface.around(vertex).iter().copied().filter(|&face| face < limit);
        let walk = Walk { surface, points, limit, frame };
        let mut count = 0;
        for node in &self.nodes {
            let to = node.at.map(|x| x * self.step);
            let reached = match found[node.inner] {
                NONE if node.index == node.inner => {
                    first.clone().find_map(|face| walk.to(face, to))
                }
                NONE => None,
                face => walk.to(face, to),
            };
            if let Some((face, height)) = reached {
                found[node.index] = face;
                heights[node.index] = height as f32;
                count += 1;
            }
        }
        f64::from(count) / self.nodes.len() as f64
    }
}

/// Share of the sum of a node's four second differences by which it is moved where an exemplar cannot move to where it fits: what
/// lies between nodes, and inside of facets, is on the hollow side of a curved surface, by 1/12 of that sum on the mean for nodes,
/// and by 1/16 for regular facets with edges of one step. With 1/12 alone a cap of a sphere still sinks with each iteration. Where
/// all vertices are samples, it takes the mean distance of 12 filled holes from a unit sphere from 0.026 to 0.001, and that of 8
/// from a ridge, filled from a plate on, from 0.010 to 0.008.
const SAG: f32 = 1.0 / 6.0;

/// Moves heights to where a smooth surface through the vertices of the measured one is, on the mean. Nodes at the border stay.
pub(super) fn round_out(heights: &mut [f32]) {
    let measured = heights.to_vec();
    for row in 1..SIDE - 1 {
        for column in 1..SIDE - 1 {
            let node = row * SIDE + column;
            let beside = [node - 1, node + 1, node - SIDE, node + SIDE];
            let sum: f32 = beside.iter().map(|&other| measured[other] - measured[node]).sum();
            if sum.is_finite() {
                heights[node] -= SAG * sum;
            }
        }
    }
}

/// Steps after which a walk gives up: it goes in circles.
const MOST_STEPS: usize = 128;

/// A walk over a mesh, seen along the normal of a frame.
struct Walk<'a> {
    surface: &'a Surface<'a>,
    points: &'a [Point3<f64>],
    limit: u32,
    frame: &'a Frame,
}

impl Walk<'_> {
    #[inline(always)]
    fn local(&self, vertex: u32) -> [f64; 3] {
        self.frame.local(self.points[vertex as usize] - self.frame.at)
    }

    /// The triangle over a place of the plane, from a triangle on, and its height there.
    fn to(&self, mut face: u32, to: [f64; 2]) -> Option<(u32, f64)> {
        let mut ends = self.surface.faces[face as usize];
        let mut at = ends.map(|end| self.local(end));
        for _ in 0..MOST_STEPS {
            let side = |k: usize| {
                let (a, b) = (at[k], at[(k + 1) % 3]);
                (b[0] - a[0]) * (to[1] - a[1]) - (b[1] - a[1]) * (to[0] - a[0])
            };
            let sides = [side(0), side(1), side(2)];
            let area = sides[0] + sides[1] + sides[2];
            let faces_up = area > 0.0;
            if !faces_up {
                return None;
            }
            let mut out = 0;
            for k in 1..3 {
                if sides[k] < sides[out] {
                    out = k;
                }
            }
            if sides[out] >= -1e-9 * area {
                let height = sides[1] * at[0][2] + sides[2] * at[1][2] + sides[0] * at[2][2];
                return Some((face, height / area));
            }
            let next = self.surface.beside(face, out);
            if next >= self.limit {
                return None;
            }
            let [p, q] = [(out + 1) % 3, out];
            let beyond = self.surface.faces[next as usize];
            // The next face meets the edge the other way round: its apex, this edge's end, this edge's start.
            let own = |apex: usize| [self.local(beyond[apex]), at[p], at[q]];
            let sides = [beyond[0] == ends[p], beyond[1] == ends[p], beyond[2] == ends[p]];
            at = match sides {
                [_, true, _] => own(0),
                [_, _, true] => {
                    let [apex, p, q] = own(1);
                    [q, apex, p]
                }
                [true, ..] => {
                    let [apex, p, q] = own(2);
                    [p, q, apex]
                }
                _ => return None,
            };
            ends = beyond;
            face = next;
        }
        None
    }
}

/// A sample of a patch as an exemplar's lattice sees it: columns and rows from its corner, height, and its normal in the same
/// units.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    pub(super) at: [f64; 2],
    pub(super) height: f64,
    pub(super) normal: [f64; 3],
}

impl Sample {
    /// Of a point and its normal in the coordinates of the patch's frame.
    pub(super) fn new(point: [f64; 3], normal: [f64; 3]) -> Self {
        Self { at: [point[0], point[1]], height: point[2], normal }
    }

    /// This sample, turned as `level` says, in steps of a lattice.
    #[inline(always)]
    pub(super) fn turned(&self, step: f64, level: impl Fn([f64; 2]) -> [f64; 2]) -> Self {
        let [u, v] = level(self.at);
        let [x, y] = level([self.normal[0], self.normal[1]]);
        let middle = HALF as f64;
        Self {
            at: [u / step + middle, v / step + middle],
            height: self.height,
            normal: [x / step, y / step, self.normal[2]],
        }
    }

    /// The signed distance along the normal to a surface of heights; NaN where it has none.
    #[inline(always)]
    pub(super) fn distance(&self, heights: &[f32]) -> f64 {
        let [u, v] = self.at;
        let [x, y, z] = self.normal;
        let (height, slope) = bilinear(heights, u, v);
        let first = (height - self.height) / descent(slope, [x, y, z]);
        // Where the line leaves the place by more than this, the surface is looked at again there.
        const STRAIGHT: f64 = 0.05;
        let (du, dv) = (first * x, first * y);
        let is_straight = first.is_nan() || du * du + dv * dv <= STRAIGHT * STRAIGHT;
        if is_straight {
            return first;
        }
        let (height, slope) = bilinear(heights, u + du, v + dv);
        first + (height - self.height - first * z) / descent(slope, [x, y, z])
    }
}

/// How fast a line in a direction comes up to a surface of this slope; not less than a quarter, so that lines along it end.
#[inline(always)]
fn descent(slope: [f64; 2], [x, y, z]: [f64; 3]) -> f64 {
    (z - slope[0] * x - slope[1] * y).max(0.25)
}

/// Height and slope between four nodes; NaN if one of them has none.
#[inline(always)]
fn bilinear(heights: &[f32], u: f64, v: f64) -> (f64, [f64; 2]) {
    let last = (SIDE - 1) as f64;
    let inside = 0.0 <= u && u < last && 0.0 <= v && v < last;
    if !inside {
        return (f64::NAN, [0.0; 2]);
    }
    let (column, row) = (u as usize, v as usize);
    let (s, t) = (u - column as f64, v - row as f64);
    let corner = row * SIDE + column;
    let cell = &heights[corner..corner + SIDE + 2];
    let [a, b] = [cell[0], cell[1]].map(f64::from);
    let [c, d] = [cell[SIDE], cell[SIDE + 1]].map(f64::from);
    let (below, above) = (a + s * (b - a), c + s * (d - c));
    (below + t * (above - below), [(b - a) + t * ((d - c) - (b - a)), above - below])
}

/// The height at a place given in lattice steps from the middle; NaN where there is none.
pub(super) fn height_at(heights: &[f32], [u, v]: [f64; 2]) -> f64 {
    let middle = HALF as f64;
    bilinear(heights, u + middle, v + middle).0
}

/// A patch's sample as point and normal in its frame.
pub(super) fn sample(frame: &Frame, point: &Point3<f64>, normal: &Vector3<f64>) -> Sample {
    Sample::new(frame.local(point - frame.at), frame.local(*normal))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rounded_bowl_is_lifted_alike_everywhere_and_a_plane_stays() {
        let lattice = |height: fn(f32, f32) -> f32| -> Vec<f32> {
            let at = |k: usize| k as f32 - HALF as f32;
            (0..NODES).map(|node| height(at(node % SIDE), at(node / SIDE))).collect()
        };
        let inner = |node: &usize| {
            (1..SIDE - 1).contains(&(node % SIDE)) && (1..SIDE - 1).contains(&(node / SIDE))
        };
        let moves = |height: fn(f32, f32) -> f32| -> Vec<f32> {
            let before = lattice(height);
            let mut after = before.clone();
            round_out(&mut after);
            (0..NODES).filter(inner).map(|node| after[node] - before[node]).collect()
        };
        assert!(moves(|x, y| 0.5 * x - 0.25 * y).iter().all(|&by| by == 0.0));
        // Four second differences of 1/2 each way.
        let bowl = moves(|x, y| -0.25 * (x * x + y * y));
        assert!(bowl.iter().all(|&by| (by - SAG).abs() < 1e-5), "{bowl:?}");
    }

    #[test]
    fn nodes_beside_nothing_stay() {
        let mut heights = vec![1.0; NODES];
        let middle = NODES / 2;
        heights[middle] = f32::NAN;
        heights[middle + 2] = 3.0;
        round_out(&mut heights);
        assert!(heights[middle].is_nan());
        assert_eq!(heights[middle + 1], 1.0);
        assert!(heights[middle + 2] > 3.0);
    }
}
