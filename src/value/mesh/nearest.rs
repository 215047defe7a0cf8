//! The nearest point of a mesh: a tree of boxes over its triangles, sorted along a space-filling curve.
//!
//! Karras, "Maximizing parallelism in the construction of BVHs, octrees, and k-d trees" (2012), of which only the order by
//! Morton codes is taken: the tree is a complete binary one over equally long runs of it, so that it needs no pointers.

use nalgebra::Point3;
use rayon::prelude::*;

use super::Mesh;

/// Triangles of a leaf: with fewer there are more boxes to visit, with more there are more triangles to measure.
const LEAF: usize = 4;

/// Where a mesh is nearest to a point.
#[derive(Clone, Copy, Debug)]
pub struct NearestPlace {
    /// The square of the distance, in mm^2.
    pub distance_sq: f64,
    /// The face.
    pub face: u32,
    /// The place of its triangle in its fan: triangle `k` has the corners 0, `k + 1` and `k + 2`.
    pub fan: u32,
    /// How far each corner of the triangle weighs in the nearest point.
    pub shares: [f64; 3],
}

impl NearestPlace {
    /// The corners of its triangle, as places among those of all faces.
    pub fn corners(&self, mesh: &Mesh) -> [usize; 3] {
        let (first, fan) = (mesh.faces().first_corner(self.face as usize), self.fan as usize);
        [first, first + fan + 1, first + fan + 2]
    }
}

/// Lowest and highest coordinates, rounded outwards: half the memory.
type Bounds = [[f32; 3]; 2];

const EMPTY: Bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];

/// The triangles of a mesh (polygons as fans), so sorted that the nearest one is found fast.
pub struct TriangleTree {
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

impl TriangleTree {
    /// The tree of a mesh, whose polygons count as fans around their first corners. Cost grows with n log n.
    pub fn new(mesh: &Mesh) -> Self {
        let unsorted = triangles(mesh);
        let middle = |triangle: &Triangle| {
            let [a, b, c] = triangle.corners;
            Point3::from((a.coords + b.coords + c.coords) / 3.0)
        };
        let order = along_curve(unsorted.len(), |index| middle(&unsorted[index]), mesh.bounds());
        let triangles: Vec<Triangle> =
            order.par_iter().map(|&index| unsorted[index as usize]).collect();
        let leaves = triangles.len().div_ceil(LEAF).max(1).next_power_of_two();
        let mut boxes = vec![EMPTY; 2 * leaves];
        let of_leaves = boxes[leaves..].par_iter_mut().zip(triangles.par_chunks(LEAF));
        of_leaves.for_each(|(bounds, leaf)| {
            let corners = leaf.iter().flat_map(|triangle| triangle.corners);
            *bounds = corners.fold(EMPTY, |bounds, corner| join(bounds, around(corner)));
        });
        for node in (1..leaves).rev() {
            boxes[node] = join(boxes[2 * node], boxes[2 * node + 1]);
        }
        Self { triangles, boxes, leaves }
    }

    /// The nearest place to each point; none without triangles.
    pub fn nearest_to_all(&self, points: &[Point3<f64>]) -> Vec<Option<NearestPlace>> {
        self.search(points).0
    }

    /// The nearest place to each point, and how many boxes were looked into for it.
    pub(crate) fn search(&self, points: &[Point3<f64>]) -> (Vec<Option<NearestPlace>>, usize) {
        const CHUNK: usize = 2048;
        let finite = points.iter().filter(|point| point.coords.iter().all(|x| x.is_finite()));
        let bounds = finite.fold(None, |bounds: Option<(Point3<f64>, Point3<f64>)>, point| {
            let (low, high) = bounds.unwrap_or((*point, *point));
            Some((low.inf(point), high.sup(point)))
        });
        // Each search begins where the last one ended: then it has little to look for.
        let order = along_curve(points.len(), |index| points[index], bounds);
        let of_chunk = |places: &[u32]| {
            let (mut start, mut visited, mut stack) = (None, 0, Vec::new());
            let found = places.iter().map(|&place| {
                let point = points[place as usize];
                let found = self.nearest(point, start, &mut stack, &mut visited);
                start = found.map(|(leaf, _)| leaf);
                found.map(|(_, hit)| hit)
            });
            (found.collect::<Vec<_>>(), visited)
        };
        let chunks: Vec<_> = order.par_chunks(CHUNK).map(of_chunk).collect();
        let mut hits = vec![None; points.len()];
        for (places, (found, _)) in order.chunks(CHUNK).zip(&chunks) {
            for (&place, hit) in places.iter().zip(found) {
                hits[place as usize] = *hit;
            }
        }
        (hits, chunks.iter().map(|(_, visited)| visited).sum())
    }

    /// The leaf of the nearest triangle and what this one gives. The search begins in the leaf `start` and goes up from there:
    /// what is near in the list is near in space, so that hardly anything else is looked into.
    fn nearest(
        &self,
        point: Point3<f64>,
        start: Option<usize>,
        stack: &mut Vec<(usize, f64)>,
        visited: &mut usize,
    ) -> Option<(usize, NearestPlace)> {
        let mut node = start.unwrap_or(1);
        let mut best = None;
        stack.push((node, 0.0));
        self.look_into(stack, point, &mut best, visited);
        while node > 1 {
            stack.push((node ^ 1, to_box(point, &self.boxes[node ^ 1])));
            self.look_into(stack, point, &mut best, visited);
            node /= 2;
        }
        best
    }

    /// Looks for a nearer triangle below the nodes on the stack, each with the squared distance of its box, and empties it.
    fn look_into(
        &self,
        stack: &mut Vec<(usize, f64)>,
        point: Point3<f64>,
        best: &mut Option<(usize, NearestPlace)>,
        visited: &mut usize,
    ) {
        let mut bound = best.map_or(f64::INFINITY, |(_, hit)| hit.distance_sq);
        while let Some((node, distance)) = stack.pop() {
            if bound <= distance {
                continue;
            }
            *visited += 1;
            if self.leaves <= node {
                let first = ((node - self.leaves) * LEAF).min(self.triangles.len());
                let last = (first + LEAF).min(self.triangles.len());
                for &Triangle { corners, face, fan } in &self.triangles[first..last] {
                    let (distance_sq, shares) = to_triangle(point, corners);
                    if distance_sq < bound {
                        bound = distance_sq;
                        *best = Some((node, NearestPlace { distance_sq, face, fan, shares }));
                    }
                }
                continue;
            }
            let near = (2 * node, to_box(point, &self.boxes[2 * node]));
            let far = (2 * node + 1, to_box(point, &self.boxes[2 * node + 1]));
            let (near, far) = if near.1 <= far.1 { (near, far) } else { (far, near) };
            stack.extend([far, near].into_iter().filter(|(_, distance)| *distance < bound));
        }
    }
}

fn triangles(mesh: &Mesh) -> Vec<Triangle> {
    let place = |vertex: u32| mesh.positions()[vertex as usize];
    let triangle = |face: usize, fan: usize, corners: [u32; 3]| Triangle {
        corners: corners.map(place),
        face: face as u32,
        fan: fan as u32,
    };
    let faces = mesh.faces();
    if let Some(triangles) = faces.as_triangles() {
        let all = triangles.par_iter().enumerate();
        return all.map(|(face, &corners)| triangle(face, 0, corners)).collect();
    }
    let fans = (0..faces.len()).into_par_iter().flat_map_iter(|index| {
        let face = faces.face(index);
        (1..face.len() - 1).map(move |k| triangle(index, k - 1, [face[0], face[k], face[k + 1]]))
    });
    fans.collect()
}

/// The indices of points in such an order that neighbors in it are near each other.
fn along_curve(
    count: usize,
    point: impl Fn(usize) -> Point3<f64> + Sync,
    bounds: Option<(Point3<f64>, Point3<f64>)>,
) -> Vec<u32> {
    let (low, high) = bounds.unwrap_or_default();
    let scale = 2_097_151.0 / (high - low).amax().max(f64::MIN_POSITIVE);
    let code = |index: usize| {
        let place = point(index) - low;
        let spread = |axis: usize| spread((place[axis] * scale) as u64);
        (spread(0) | spread(1) << 1 | spread(2) << 2, index as u32)
    };
    let mut order: Vec<(u64, u32)> = (0..count).into_par_iter().map(code).collect();
    order.par_sort_unstable();
    order.into_par_iter().map(|(_, index)| index).collect()
}

fn around(point: Point3<f64>) -> Bounds {
    let below = |x: f64| {
        let rounded = x as f32;
        if f64::from(rounded) > x { rounded.next_down() } else { rounded }
    };
    let point = <[f64; 3]>::from(point.coords);
    [point.map(below), point.map(|x| -below(-x))]
}

fn join(a: Bounds, b: Bounds) -> Bounds {
    [
        [0, 1, 2].map(|axis| f32::min(a[0][axis], b[0][axis])),
        [0, 1, 2].map(|axis| f32::max(a[1][axis], b[1][axis])),
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
    let outside = |axis: usize| {
        f64::max(f64::from(low[axis]) - point[axis], point[axis] - f64::from(high[axis])).max(0.0)
    };
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
    use super::super::Faces;
    use super::*;

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
        let tree = TriangleTree::new(&mesh);
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
