//! The nearest point of a mesh: a tree of boxes over its triangles, sorted along a space-filling curve.
//!
//! Karras, "Maximizing parallelism in the construction of BVHs, octrees, and k-d trees" (2012), of which only the order by
//! Morton codes is taken: the tree is a complete binary one over equally long runs of it, so that it needs no pointers.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::value::Mesh;

/// Triangles of a leaf: with fewer there are more boxes to visit, with more there are more triangles to measure.
const LEAF: usize = 4;

/// Where a mesh is nearest to a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    pub(super) distance_sq: f64,
    /// The face, and the place of its triangle in its fan.
    pub(super) face: u32,
    pub(super) fan: u32,
    /// How far each corner of the triangle weighs in the nearest point.
    pub(super) shares: [f64; 3],
}

/// Lowest and highest coordinates.
type Bounds = [[f64; 3]; 2];

const EMPTY: Bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];

/// The triangles of a mesh (polygons as fans), so sorted that the nearest one is found fast.
pub(super) struct Tree {
    triangles: Vec<Triangle>,
    /// A complete binary tree: the root is at 1, the children of `n` at `2n` and `2n + 1`.
    boxes: Vec<Bounds>,
    leaves: usize,
}

#[derive(Clone, Copy)]
struct Triangle {
    corners: [Point3<f64>; 3],
    face: u32,
    fan: u32,
}

impl Tree {
    pub(super) fn new(mesh: &Mesh) -> Self {
        let place = |vertex: u32| mesh.positions()[vertex as usize];
        let faces = mesh.faces();
        let triangles = (0..faces.len()).into_par_iter().flat_map_iter(|index| {
            let face = faces.face(index);
            (1..face.len() - 1).map(move |k| Triangle {
                corners: [face[0], face[k], face[k + 1]].map(place),
                face: index as u32,
                fan: k as u32 - 1,
            })
        });
        let triangles: Vec<Triangle> = triangles.collect();
        let (low, high) = mesh.bounds().unwrap_or_default();
        let scale = 2_097_151.0 / (high - low).amax().max(f64::MIN_POSITIVE);
        let code = |triangle: &Triangle| {
            let middle =
                triangle.corners.iter().map(|corner| (corner - low) / 3.0).sum::<Vector3<f64>>();
            let spread = |axis: usize| spread((middle[axis] * scale) as u64);
            spread(0) | spread(1) << 1 | spread(2) << 2
        };
        let codes =
            triangles.par_iter().enumerate().map(|(index, triangle)| (code(triangle), index));
        let mut order: Vec<(u64, usize)> = codes.collect();
        order.par_sort_unstable();
        let triangles: Vec<Triangle> =
            order.par_iter().map(|&(_, index)| triangles[index]).collect();
        let leaves = triangles.len().div_ceil(LEAF).max(1).next_power_of_two();
        let mut boxes = vec![EMPTY; 2 * leaves];
        boxes[leaves..].par_iter_mut().zip(triangles.par_chunks(LEAF)).for_each(
            |(bounds, leaf)| {
                *bounds =
                    leaf.iter().flat_map(|triangle| triangle.corners).fold(EMPTY, |b, corner| {
                        let corner = <[f64; 3]>::from(corner.coords);
                        join(b, [corner, corner])
                    });
            },
        );
        for node in (1..leaves).rev() {
            boxes[node] = join(boxes[2 * node], boxes[2 * node + 1]);
        }
        Self { triangles, boxes, leaves }
    }

    /// The nearest place to each point; none without triangles. Neighbors in the list should be near each other.
    pub(super) fn nearest_to_all(&self, points: &[Point3<f64>]) -> Vec<Option<Hit>> {
        const CHUNK: usize = 2048;
        let mut hits = vec![None; points.len()];
        hits.par_chunks_mut(CHUNK).zip(points.par_chunks(CHUNK)).for_each(|(hits, points)| {
            let mut start = None;
            for (hit, &point) in hits.iter_mut().zip(points) {
                let found = self.nearest(point, start);
                start = found.map(|(place, _)| place);
                *hit = found.map(|(_, hit)| hit);
            }
        });
        hits
    }

    /// The nearest triangle's place and what it gives; the search begins with the triangle `start`.
    fn nearest(&self, point: Point3<f64>, start: Option<usize>) -> Option<(usize, Hit)> {
        let measure = |place: usize| {
            let triangle = &self.triangles[place];
            let (distance_sq, shares) = to_triangle(point, triangle.corners);
            (place, Hit { distance_sq, face: triangle.face, fan: triangle.fan, shares })
        };
        let mut best = start.map(measure);
        let bound =
            |best: &Option<(usize, Hit)>| best.map_or(f64::INFINITY, |(_, hit)| hit.distance_sq);
        let mut stack = [(0usize, 0f64); 64];
        let mut depth = 1;
        stack[0] = (1, to_box(point, &self.boxes[1]));
        while depth > 0 {
            depth -= 1;
            let (node, distance) = stack[depth];
            if bound(&best) <= distance {
                continue;
            }
            if self.leaves <= node {
                let first = (node - self.leaves) * LEAF;
                for place in first..self.triangles.len().min(first + LEAF) {
                    let found = measure(place);
                    if found.1.distance_sq < bound(&best) {
                        best = Some(found);
                    }
                }
                continue;
            }
            let near = (2 * node, to_box(point, &self.boxes[2 * node]));
            let far = (2 * node + 1, to_box(point, &self.boxes[2 * node + 1]));
            let (near, far) = if near.1 <= far.1 { (near, far) } else { (far, near) };
            for child in [far, near] {
                if child.1 < bound(&best) {
                    stack[depth] = child;
                    depth += 1;
                }
            }
        }
        best
    }
}

fn join(a: Bounds, b: Bounds) -> Bounds {
    [
        [0, 1, 2].map(|axis| f64::min(a[0][axis], b[0][axis])),
        [0, 1, 2].map(|axis| f64::max(a[1][axis], b[1][axis])),
    ]
}

/// Puts two zero bits behind each of the lowest 21 bits.
fn spread(x: u64) -> u64 {
    let x = x & 0x1f_ffff;
    let x = (x | x << 32) & 0x1f_0000_0000_ffff;
    let x = (x | x << 16) & 0x1f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

fn to_box(point: Point3<f64>, [low, high]: &Bounds) -> f64 {
    let outside =
        |axis: usize| f64::max(low[axis] - point[axis], point[axis] - high[axis]).max(0.0);
    let [x, y, z] = [outside(0), outside(1), outside(2)];
    x * x + y * y + z * z
}

/// The squared distance of a point to a triangle, and the nearest point as shares of the corners.
///
/// Ericson, *Real-Time Collision Detection* (2005), section 5.1.5, whose letters are kept.
fn to_triangle(p: Point3<f64>, [a, b, c]: [Point3<f64>; 3]) -> (f64, [f64; 3]) {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let done = |shares: [f64; 3]| {
        let nearest = ab * shares[1] + ac * shares[2];
        ((ap - nearest).norm_squared(), shares)
    };
    let ratio = |part: f64, rest: f64| if part + rest > 0.0 { part / (part + rest) } else { 0.0 };
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return done([1.0, 0.0, 0.0]);
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return done([0.0, 1.0, 0.0]);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let v = ratio(d1, -d3);
        return done([1.0 - v, v, 0.0]);
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return done([0.0, 0.0, 1.0]);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let w = ratio(d2, -d6);
        return done([1.0 - w, 0.0, w]);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let w = ratio(d4 - d3, d5 - d6);
        return done([0.0, 1.0 - w, w]);
    }
    let sum = va + vb + vc;
    let (v, w) = if sum > 0.0 { (vb / sum, vc / sum) } else { (0.0, 0.0) };
    done([1.0 - v - w, v, w])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::value::Faces;

    #[test]
    fn the_tree_finds_what_a_look_at_all_triangles_finds() {
        let at = |k: u32| {
            let bump = f64::from(k * k % 17) / 5.0;
            Point3::new(f64::from(k % 20), f64::from(k / 20), bump)
        };
        let quads = (0..19).flat_map(|row| (0..19).map(move |column| row * 20 + column));
        let faces = quads.flat_map(|a: u32| [[a, a + 1, a + 20], [a + 1, a + 21, a + 20]]);
        let mesh =
            Mesh::new((0..400).map(at).collect::<Vec<_>>(), Faces::triangles(faces.collect()));
        let mesh = mesh.unwrap();
        let tree = Tree::new(&mesh);
        let points: Vec<_> = (0..200u32)
            .map(|k| {
                Point3::new(
                    f64::from(k * 37 % 230) / 10.0,
                    f64::from(k * 53 % 190) / 10.0,
                    f64::from(k % 9) - 2.0,
                )
            })
            .collect();
        for (point, hit) in points.iter().zip(tree.nearest_to_all(&points)) {
            let all = tree.triangles.iter().map(|triangle| to_triangle(*point, triangle.corners).0);
            let nearest = all.fold(f64::INFINITY, f64::min);
            assert!((hit.unwrap().distance_sq - nearest).abs() < 1e-12);
        }
    }
}
