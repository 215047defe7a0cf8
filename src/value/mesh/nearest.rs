//! The nearest point of a mesh: a tree of boxes over its triangles, sorted along a space-filling curve.
//!
//! Karras, "Maximizing parallelism in the construction of BVHs, octrees, and k-d trees" (2012), of which only the order by
//! Morton codes is taken: the tree is a complete binary one over equally long runs of it, so that it needs no pointers.

use nalgebra::Point3;

use super::Mesh;
use crate::parallel::*;
use crate::simd::{Kernel, Lanes, widest};

mod ray;

pub use ray::RayHit;

/// Triangles of a leaf: with fewer there are more boxes to visit, with more there are more triangles to measure.
const LEAF: usize = 4;

/// Where a mesh is nearest to a point.
#[derive(Clone, Copy, Debug)]
pub struct NearestPlace {
    /// The square of the distance, in mm^2.
    pub distance_sq: f64,
    /// The face.
    pub face: u32,
    /// The corners of its triangle, by index among the corners of all faces.
    pub corners: [u32; 3],
    /// How far each corner of the triangle weighs in the nearest point.
    pub shares: [f64; 3],
}

impl NearestPlace {
    /// The nearest point.
    pub fn place(&self, mesh: &Mesh) -> Point3<f64> {
        let vertices = self.corners.map(|corner| mesh.faces().corners()[corner as usize] as usize);
        let parts = vertices.map(|vertex| mesh.positions()[vertex]).into_iter().zip(self.shares);
        parts.fold(Point3::origin(), |sum, (at, share)| sum + at.coords * share)
    }
}

/// Lowest and highest coordinates, rounded outwards: half the memory.
type Bounds = [[f32; 3]; 2];

const EMPTY: Bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];

/// The triangles of a mesh, so sorted that the nearest one is found fast.
pub struct TriangleTree {
    triangles: Vec<Triangle>,
    /// A complete binary tree: the root is at 1, the children of `n` at `2n` and `2n + 1`.
    boxes: Vec<Bounds>,
    leaves: usize,
}

#[derive(Clone, Copy)]
struct Triangle {
    places: [Point3<f64>; 3],
    face: u32,
    corners: [u32; 3],
}

impl TriangleTree {
    /// Sorts the triangles of a mesh, polygons as [`Mesh::face_triangles`] cuts them. Cost grows with n log n.
    pub fn new(mesh: &Mesh) -> Self {
        let unsorted = triangles(mesh);
        fn middle(triangle: &Triangle) -> Point3<f64> {
            let [a, b, c] = triangle.places;
            Point3::from((a.coords + b.coords + c.coords) / 3.0)
        }
        let order = along_curve(unsorted.len(), |index| middle(&unsorted[index]), mesh.bounds());
        let triangles: Vec<Triangle> =
            order.par_iter().map(|&index| unsorted[index as usize]).collect();
        let leaves = triangles.len().div_ceil(LEAF).max(1).next_power_of_two();
        let mut boxes = vec![EMPTY; 2 * leaves];
        let of_leaves = boxes[leaves..].par_iter_mut().zip(triangles.par_chunks(LEAF));
        of_leaves.for_each(|(bounds, leaf)| {
            let corners = leaf.iter().flat_map(|triangle| triangle.places);
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
    pub fn search(&self, points: &[Point3<f64>]) -> (Vec<Option<NearestPlace>>, usize) {
        const CHUNK: usize = 2048;
        let finite = points.iter().filter(|point| point.coords.iter().all(|x| x.is_finite()));
        let bounds = finite.fold(None, |bounds: Option<(Point3<f64>, Point3<f64>)>, point| {
            let (low, high) = bounds.unwrap_or((*point, *point));
            Some((low.inf(point), high.sup(point)))
        });
        // Each search begins where the last one ended: then it has little to look for.
        let order = along_curve(points.len(), |index| points[index], bounds);
        let chunks: Vec<_> = order
            .par_chunks(CHUNK)
            .map(|places| {
                let (mut found, mut visited) = (Vec::with_capacity(places.len()), 0);
                let (found_here, visited_here) = (&mut found, &mut visited);
                widest(Search {
                    tree: self,
                    points,
                    places,
                    found: found_here,
                    visited: visited_here,
                });
                (found, visited)
            })
            .collect();
        let mut hits = vec![None; points.len()];
        for (places, (found, _)) in order.chunks(CHUNK).zip(&chunks) {
            for (&place, hit) in places.iter().zip(found) {
                hits[place as usize] = *hit;
            }
        }
        (hits, chunks.iter().map(|(_, visited)| visited).sum())
    }
}

/// Points that search together: a box is loaded once, and compared with all of them at once.
const TOGETHER: usize = 8;

/// The search of points that follow each other along a curve.
struct Search<'a> {
    tree: &'a TriangleTree,
    points: &'a [Point3<f64>],
    places: &'a [u32],
    found: &'a mut Vec<Option<NearestPlace>>,
    visited: &'a mut usize,
}

impl Kernel for Search<'_> {
    #[inline(always)]
    fn run(self) {
        let (mut stack, mut start) = (Vec::new(), 1);
        for places in self.places.chunks(TOGETHER) {
            let mut group = Group::new(self.points, places);
            group.search(self.tree, start, &mut stack);
            start = group.leaf;
            self.found.extend_from_slice(&group.best[..places.len()]);
            *self.visited += group.visited;
        }
    }
}

/// Points that search together.
struct Group {
    points: [Point3<f64>; TOGETHER],
    /// Their coordinates by axis.
    columns: [Lanes<TOGETHER>; 3],
    /// The squared distances of the nearest places so far; less than all of them for lanes that are left over.
    bounds: Lanes<TOGETHER>,
    /// The greatest of them.
    bound: f64,
    best: [Option<NearestPlace>; TOGETHER],
    /// The leaf of the last place that was found.
    leaf: usize,
    /// Boxes looked into, each counted for all points of the group, and leaves for those that measured something there.
    visited: usize,
}

impl Group {
    #[inline(always)]
    fn new(points: &[Point3<f64>], places: &[u32]) -> Self {
        let mut group = Self {
            points: [Point3::origin(); TOGETHER],
            columns: [Lanes::ZERO; 3],
            bounds: Lanes([-1.0; TOGETHER]),
            bound: f64::INFINITY,
            best: [None; TOGETHER],
            leaf: 1,
            visited: 0,
        };
        for (lane, &place) in places.iter().enumerate() {
            let point = points[place as usize];
            group.points[lane] = point;
            (0..3).for_each(|axis| group.columns[axis].0[lane] = point[axis]);
            group.bounds.0[lane] = f64::INFINITY;
        }
        group
    }

    /// Begins in the leaf `start` and goes up from there: what is near in the list is near in space, so that hardly anything else is
    /// looked into. The stack is empty before and after.
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

    /// Looks for nearer triangles below a node.
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

    /// The least squared distance to a box, of the points that may find something nearer in it; infinite if there are none.
    #[inline(always)]
    fn to_box(&self, bounds: &Bounds) -> f64 {
        let Lanes(mut least) = self.to_box_each(bounds);
        for (distance, &bound) in least.iter_mut().zip(&self.bounds.0) {
            *distance = if *distance < bound { *distance } else { f64::INFINITY };
        }
        for half in [4, 2, 1] {
            let (kept, others) = least.split_at_mut(half);
            for (kept, &other) in kept.iter_mut().zip(&*others) {
                *kept = if other < *kept { other } else { *kept };
            }
        }
        least[0]
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

    /// Measures the triangles of a leaf.
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
            for &Triangle { places, face, corners } in triangles {
                let (distance_sq, shares) = to_triangle(self.points[lane], places);
                if distance_sq < self.bounds.0[lane] {
                    self.bounds.0[lane] = distance_sq;
                    self.best[lane] = Some(NearestPlace { distance_sq, face, corners, shares });
                    self.leaf = leaf;
                }
            }
        }
        self.bound = self.bounds.0.into_iter().fold(0.0, |a, b| if b > a { b } else { a });
    }
}

fn triangles(mesh: &Mesh) -> Vec<Triangle> {
    let vertices = mesh.faces().corners();
    fn triangle(
        face: usize,
        corners: [u32; 3],
        mesh: &Mesh,
        vertices: &crate::Column<u32>,
    ) -> Triangle {
        let places = corners.map(|corner| mesh.positions()[vertices[corner as usize] as usize]);
        Triangle { places, face: face as u32, corners }
    }
    if mesh.faces().sides() == Some(3) {
        let faces = (0..mesh.faces().len()).into_par_iter();
        return faces
            .map(|face| triangle(face, [0, 1, 2].map(|k| 3 * face as u32 + k), mesh, vertices))
            .collect();
    }
    (0..mesh.faces().len())
        .into_par_iter()
        .flat_map_iter(|face: usize| {
            let first = mesh.faces().first_corner(face) as u32;
            mesh.face_triangles(face)
                .map(move |it| triangle(face, it.map(|corner| first + corner), mesh, vertices))
        })
        .collect()
}

/// The indices of points in such an order that neighbors in it are near each other.
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
            let place = point(index) - low;
            let [x, y, z] = [0, 1, 2].map(|axis| spread((place[axis] * scale) as u64));
            (x | y << 1 | z << 2, index as u32)
        })
        .collect();
    order.par_sort_unstable();
    order.into_par_iter().map(|(_, index)| index).collect()
}

fn around(point: Point3<f64>) -> Bounds {
    fn below(x: f64) -> f32 {
        let rounded = x as f32;
        if f64::from(rounded) > x { rounded.next_down() } else { rounded }
    }
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

/// The squared distance of a point to a triangle, and the nearest point as shares of the corners.
///
/// Ericson, *Real-Time Collision Detection* (2005), section 5.1.5, whose letters are kept.
#[inline(always)]
pub fn to_triangle(p: Point3<f64>, [a, b, c]: [Point3<f64>; 3]) -> (f64, [f64; 3]) {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let done = |shares: [f64; 3]| {
        let nearest = ab * shares[1] + ac * shares[2];
        ((ap - nearest).norm_squared(), shares)
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
    use super::super::Faces;
    use super::*;

    #[test]
    fn the_tree_finds_what_a_look_at_all_triangles_finds() {
        let quads = (0..19).flat_map(|row| (0..19).map(move |column| row * 20 + column));
        let faces = quads.flat_map(|a: u32| [[a, a + 1, a + 20], [a + 1, a + 21, a + 20]]);
        let mesh = Mesh::new(
            (0..400)
                .map(|k: u32| {
                    let bump = f64::from(k * k % 17) / 5.0;
                    Point3::new(f64::from(k % 20), f64::from(k / 20), bump)
                })
                .collect::<Vec<_>>(),
            Faces::triangles(faces.collect()),
        );
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
            let all = tree.triangles.iter().map(|triangle| to_triangle(*point, triangle.places).0);
            let nearest = all.fold(f64::INFINITY, f64::min);
            assert!((hit.unwrap().distance_sq - nearest).abs() < 1e-12);
        }
        let lost =
            [Point3::new(f64::NAN, 0.0, 0.0), points[7], Point3::new(0.0, f64::INFINITY, 0.0)];
        let hits = tree.nearest_to_all(&lost);
        assert!(hits[0].is_none() && hits[1].is_some());
    }
}
