//! The nearest point of a mesh, found by a tree of boxes over the triangles, which are sorted along a space-filling curve.
//!
//! Karras, "Maximizing parallelism in the construction of BVHs, octrees, and k-d trees" (2012). Only the order by Morton codes comes from
//! that paper. The tree is a complete binary tree over runs of triangles of equal length in this order, so it needs no pointers.

use nalgebra::Point3;

use super::Mesh;
use crate::parallel::*;
use crate::simd::{Kernel, Lanes, widest};

mod ray;

pub use ray::RayHit;

/// The number of triangles per leaf. With fewer triangles a search visits more boxes; with more triangles it measures more distances.
const LEAF: usize = 4;

/// The point of a mesh that is nearest to a given point.
#[derive(Clone, Copy, Debug)]
pub struct NearestPoint {
    /// The square of the distance, in mm^2.
    pub distance_sq: f64,
    /// The face that contains the nearest point.
    pub face: u32,
    /// The corners of the triangle that contains the nearest point, as indices among the corners of all faces.
    pub corners: [u32; 3],
    /// The barycentric coordinates of the nearest point in that triangle.
    pub barycentric: [f64; 3],
}

impl NearestPoint {
    /// The position of the nearest point.
    pub fn position(&self, mesh: &Mesh) -> Point3<f64> {
        let vertices = self.corners.map(|corner| mesh.faces().corners()[corner as usize] as usize);
        let parts =
            vertices.map(|vertex| mesh.positions()[vertex]).into_iter().zip(self.barycentric);
        parts.fold(Point3::origin(), |sum, (at, fraction)| sum + at.coords * fraction)
    }
}

/// The minimum and maximum coordinates of a box, rounded outwards to single precision, which needs half the memory.
type Bounds = [[f32; 3]; 2];

const EMPTY: Bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];

/// A tree of boxes over the triangles of a mesh, for fast nearest-point and ray queries.
pub struct TriangleTree {
    triangles: Vec<Triangle>,
    /// The boxes of a complete binary tree: the root is at index 1, the children of `n` are at `2n` and `2n + 1`.
    boxes: Vec<Bounds>,
    leaves: usize,
}

#[derive(Clone, Copy)]
struct Triangle {
    positions: [Point3<f64>; 3],
    face: u32,
    corners: [u32; 3],
}

impl Triangle {
    fn new(mesh: &Mesh, face: usize, corners: [u32; 3]) -> Self {
        let vertices = mesh.faces().corners();
        let positions = corners.map(|corner| mesh.positions()[vertices[corner as usize] as usize]);
        Self { positions, face: face as u32, corners }
    }

    fn center(&self) -> Point3<f64> {
        let [a, b, c] = self.positions;
        Point3::from((a.coords + b.coords + c.coords) / 3.0)
    }
}

impl TriangleTree {
    /// Builds the tree of a mesh. Polygons are cut into triangles by [`Mesh::face_triangles`]. Cost grows with n log n.
    pub fn new(mesh: &Mesh) -> Self {
        let unsorted = triangles(mesh);
        let order = along_curve(unsorted.len(), |index| unsorted[index].center(), mesh.bounds());
        let triangles: Vec<Triangle> =
            order.par_iter().map(|&index| unsorted[index as usize]).collect();
        let leaves = triangles.len().div_ceil(LEAF).max(1).next_power_of_two();
        let mut boxes = vec![EMPTY; 2 * leaves];
        let of_leaves = boxes[leaves..].par_iter_mut().zip(triangles.par_chunks(LEAF));
        of_leaves.for_each(|(bounds, leaf)| {
            let corners = leaf.iter().flat_map(|triangle| triangle.positions);
            *bounds = corners.fold(EMPTY, |bounds, corner| join(bounds, bounds_of_point(corner)));
        });
        for node in (1..leaves).rev() {
            boxes[node] = join(boxes[2 * node], boxes[2 * node + 1]);
        }
        Self { triangles, boxes, leaves }
    }

    /// The nearest point of the mesh for each point; `None` without triangles and for points that are not finite.
    pub fn nearest_to_all(&self, points: &[Point3<f64>]) -> Vec<Option<NearestPoint>> {
        self.search(points).0
    }

    /// For each point the nearest point of the mesh whose squared distance in mm^2 is below that of `squares`; `None` if all points of the
    /// mesh are farther away. It takes less time than [`nearest_to_all`](Self::nearest_to_all) if the squares are about those of the
    /// nearest points.
    pub fn nearest_below(
        &self,
        points: &[Point3<f64>],
        squares: &[f64],
    ) -> Vec<Option<NearestPoint>> {
        self.search_below(points, Some(squares)).0
    }

    /// For each point the nearest point of the mesh, as in [`nearest_to_all`](Self::nearest_to_all), and the total number of visited boxes.
    pub fn search(&self, points: &[Point3<f64>]) -> (Vec<Option<NearestPoint>>, usize) {
        self.search_below(points, None)
    }

    fn search_below(
        &self,
        points: &[Point3<f64>],
        squares: Option<&[f64]>,
    ) -> (Vec<Option<NearestPoint>>, usize) {
        const CHUNK: usize = 2048;
        let finite = points.iter().filter(|point| point.coords.iter().all(|x| x.is_finite()));
        // Each search begins in the leaf where the last one ended, because points that are neighbors along the curve are close to each
        // other.
        let order = along_curve(points.len(), |index| points[index], super::bounds(finite));
        let chunks: Vec<_> = order
            .par_chunks(CHUNK)
            .map(|indices| {
                let (mut found, mut visited) = (Vec::with_capacity(indices.len()), 0);
                let (found_here, visited_here) = (&mut found, &mut visited);
                widest(Search {
                    tree: self,
                    points,
                    squares,
                    indices,
                    found: found_here,
                    visited: visited_here,
                });
                (found, visited)
            })
            .collect();
        let mut hits = vec![None; points.len()];
        for (indices, (found, _)) in order.chunks(CHUNK).zip(&chunks) {
            for (&index, hit) in indices.iter().zip(found) {
                hits[index as usize] = *hit;
            }
        }
        (hits, chunks.iter().map(|(_, visited)| visited).sum())
    }
}

/// The number of points per group. A box is loaded once for a whole group and compared with all of its points.
const TOGETHER: usize = 8;

/// The search for the nearest points of points that are consecutive along the curve.
struct Search<'a> {
    tree: &'a TriangleTree,
    points: &'a [Point3<f64>],
    /// The squared distances below which points of the mesh are found, if they are limited.
    squares: Option<&'a [f64]>,
    indices: &'a [u32],
    found: &'a mut Vec<Option<NearestPoint>>,
    visited: &'a mut usize,
}

impl Kernel for Search<'_> {
    #[inline(always)]
    fn run(self) {
        let (mut stack, mut start) = (Vec::new(), 1);
        for indices in self.indices.chunks(TOGETHER) {
            let mut group = Group::new(self.points, self.squares, indices);
            group.search(self.tree, start, &mut stack);
            start = group.leaf;
            self.found.extend_from_slice(&group.best[..indices.len()]);
            *self.visited += group.visited;
        }
    }
}

/// A group of points whose searches run together.
struct Group {
    points: [Point3<f64>; TOGETHER],
    /// The coordinates of the points of the group, by axis.
    columns: [Lanes<TOGETHER>; 3],
    /// The squared distance from each point to the nearest point found so far. It is negative for unused lanes.
    bounds: Lanes<TOGETHER>,
    /// The maximum of `bounds`: a box farther away than this contains no nearer point for any point of the group.
    bound: f64,
    best: [Option<NearestPoint>; TOGETHER],
    /// The leaf in which a nearer point was found last.
    leaf: usize,
    /// The number of visited boxes, each counted for all points of the group. In a leaf only the points whose distances to triangles were
    /// measured count.
    visited: usize,
}

impl Group {
    #[inline(always)]
    fn new(points: &[Point3<f64>], squares: Option<&[f64]>, indices: &[u32]) -> Self {
        let mut group = Self {
            points: [Point3::origin(); TOGETHER],
            columns: [Lanes::ZERO; 3],
            bounds: Lanes([-1.0; TOGETHER]),
            bound: 0.0,
            best: [None; TOGETHER],
            leaf: 1,
            visited: 0,
        };
        for (lane, &index) in indices.iter().enumerate() {
            let point = points[index as usize];
            group.points[lane] = point;
            (0..3).for_each(|axis| group.columns[axis].0[lane] = point[axis]);
            group.bounds.0[lane] = squares.map_or(f64::INFINITY, |squares| squares[index as usize]);
        }
        group.update_bound();
        group
    }

    /// Searches from the leaf `start` upwards. Triangles that are close in the list are close in space, so few other boxes are visited. The
    /// stack is empty before and after the search.
    #[inline(always)]
    fn search(&mut self, tree: &TriangleTree, start: usize, stack: &mut Vec<(usize, f64)>) {
        self.leaf = start;
        self.look_into(tree, start, stack);
        let mut node = start;
        while node > 1 {
            self.look_into(tree, node ^ 1, stack);
            node /= 2;
        }
    }

    /// Searches for nearer triangles below a node of the tree.
    #[inline(always)]
    fn look_into(&mut self, tree: &TriangleTree, node: usize, stack: &mut Vec<(usize, f64)>) {
        stack.push((node, self.to_box(&tree.boxes[node])));
        while let Some((node, distance)) = stack.pop() {
            if self.bound <= distance {
                continue;
            }
            if tree.leaves <= node {
                self.measure(tree, node);
                continue;
            }
            self.visited += TOGETHER;
            let a = (2 * node, self.to_box(&tree.boxes[2 * node]));
            let b = (2 * node + 1, self.to_box(&tree.boxes[2 * node + 1]));
            let (near, far) = if a.1 <= b.1 { (a, b) } else { (b, a) };
            if far.1 < f64::INFINITY {
                stack.push(far);
            }
            if near.1 < f64::INFINITY {
                stack.push(near);
            }
        }
    }

    /// The minimum squared distance from a point of the group to a box. A point that is farther from the box than from its nearest point so
    /// far is ignored. The result is infinite if all points are ignored.
    #[inline(always)]
    fn to_box(&self, bounds: &Bounds) -> f64 {
        let Lanes(mut distances) = self.to_box_each(bounds);
        for (distance, &bound) in distances.iter_mut().zip(&self.bounds.0) {
            *distance = if *distance < bound { *distance } else { f64::INFINITY };
        }
        for half in [4, 2, 1] {
            let (kept, others) = distances.split_at_mut(half);
            for (kept, &other) in kept.iter_mut().zip(&*others) {
                *kept = if other < *kept { other } else { *kept };
            }
        }
        distances[0]
    }

    #[inline(always)]
    fn to_box_each(&self, [low, high]: &Bounds) -> Lanes<TOGETHER> {
        let mut sum = Lanes::ZERO;
        for axis in 0..3 {
            let (low, high) = (f64::from(low[axis]), f64::from(high[axis]));
            for lane in 0..TOGETHER {
                let x = self.columns[axis].0[lane];
                let outside = if x < low { low - x } else { x - high };
                let outside = if outside < 0.0 { 0.0 } else { outside };
                sum.0[lane] += outside * outside;
            }
        }
        sum
    }

    /// Measures the distances from the points of the group to the triangles of a leaf.
    #[inline(always)]
    fn measure(&mut self, tree: &TriangleTree, leaf: usize) {
        let distances = self.to_box_each(&tree.boxes[leaf]);
        let first = ((leaf - tree.leaves) * LEAF).min(tree.triangles.len());
        let triangles = &tree.triangles[first..(first + LEAF).min(tree.triangles.len())];
        for lane in 0..TOGETHER {
            if self.bounds.0[lane] <= distances.0[lane] {
                continue;
            }
            self.visited += 1;
            for &Triangle { positions, face, corners } in triangles {
                let (distance_sq, barycentric) = closest_on_triangle(self.points[lane], positions);
                if distance_sq < self.bounds.0[lane] {
                    self.bounds.0[lane] = distance_sq;
                    self.best[lane] =
                        Some(NearestPoint { distance_sq, face, corners, barycentric });
                    self.leaf = leaf;
                }
            }
        }
        self.update_bound();
    }

    #[inline(always)]
    fn update_bound(&mut self) {
        self.bound = self.bounds.0.into_iter().fold(0.0, |a, b| if b > a { b } else { a });
    }
}

fn triangles(mesh: &Mesh) -> Vec<Triangle> {
    if mesh.faces().sides() == Some(3) {
        let faces = (0..mesh.faces().len()).into_par_iter();
        return faces
            .map(|face| Triangle::new(mesh, face, [0, 1, 2].map(|k| 3 * face as u32 + k)))
            .collect();
    }
    (0..mesh.faces().len())
        .into_par_iter()
        .flat_map_iter(|face: usize| {
            let first = mesh.faces().first_corner(face) as u32;
            mesh.face_triangles(face)
                .map(move |it| Triangle::new(mesh, face, it.map(|corner| first + corner)))
        })
        .collect()
}

/// The indices of points in the order of a space-filling curve, in which consecutive points are close to each other.
fn along_curve(
    count: usize,
    point: impl Fn(usize) -> Point3<f64> + Sync,
    bounds: Option<(Point3<f64>, Point3<f64>)>,
) -> Vec<u32> {
    let (low, high) = bounds.unwrap_or_default();
    let scale = 2_097_151.0 / (high - low).amax().max(f64::MIN_POSITIVE);
    let mut order: Vec<(u64, u32)> = (0..count)
        .into_par_iter()
        .map(|index: usize| {
            let offset = point(index) - low;
            let [x, y, z] = [0, 1, 2].map(|axis| spread((offset[axis] * scale) as u64));
            (x | y << 1 | z << 2, index as u32)
        })
        .collect();
    order.par_sort_unstable();
    order.into_par_iter().map(|(_, index)| index).collect()
}

fn bounds_of_point(point: Point3<f64>) -> Bounds {
    fn round_down(x: f64) -> f32 {
        let rounded = x as f32;
        if f64::from(rounded) > x { rounded.next_down() } else { rounded }
    }
    let point = <[f64; 3]>::from(point.coords);
    [point.map(round_down), point.map(|x| -round_down(-x))]
}

fn join(a: Bounds, b: Bounds) -> Bounds {
    [
        [0, 1, 2].map(|axis| f32::min(a[0][axis], b[0][axis])),
        [0, 1, 2].map(|axis| f32::max(a[1][axis], b[1][axis])),
    ]
}

/// Spreads the lowest 21 bits by inserting two zero bits after each.
fn spread(x: u64) -> u64 {
    let x = x & 0x1f_ffff;
    let x = (x | x << 32) & 0x1f_0000_0000_ffff;
    let x = (x | x << 16) & 0x1f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

/// The squared distance from a point to a triangle, and the barycentric coordinates of the nearest point.
///
/// Algorithm and names of variables: Ericson, *Real-Time Collision Detection* (2005), section 5.1.5.
#[inline(always)]
pub fn closest_on_triangle(p: Point3<f64>, [a, b, c]: [Point3<f64>; 3]) -> (f64, [f64; 3]) {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let done = |barycentric: [f64; 3]| {
        let nearest = ab * barycentric[1] + ac * barycentric[2];
        ((ap - nearest).norm_squared(), barycentric)
    };
    #[inline(always)]
    fn ratio(part: f64, rest: f64) -> f64 {
        if part + rest > 0.0 { part / (part + rest) } else { 0.0 }
    }
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
    use super::super::tests::sheet;
    use super::*;

    #[test]
    fn the_tree_finds_the_same_nearest_points_as_a_full_scan() {
        let mesh = sheet([20, 20], 3, |k| f64::from(k * k % 17) / 5.0);
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
            let all = tree
                .triangles
                .iter()
                .map(|triangle| closest_on_triangle(*point, triangle.positions).0);
            let nearest = all.fold(f64::INFINITY, f64::min);
            assert!((hit.unwrap().distance_sq - nearest).abs() < 1e-12);
        }
        let squares: Vec<f64> =
            tree.nearest_to_all(&points).iter().flatten().map(|hit| hit.distance_sq).collect();
        assert!(tree.nearest_below(&points, &squares).iter().all(Option::is_none));
        let larger: Vec<f64> = squares.iter().map(|square| 1.01 * square + 1e-9).collect();
        for (hit, square) in tree.nearest_below(&points, &larger).iter().zip(&squares) {
            assert_eq!(hit.unwrap().distance_sq, *square);
        }
        let lost =
            [Point3::new(f64::NAN, 0.0, 0.0), points[7], Point3::new(0.0, f64::INFINITY, 0.0)];
        let hits = tree.nearest_to_all(&lost);
        assert!(hits[0].is_none() && hits[1].is_some());
    }
}
