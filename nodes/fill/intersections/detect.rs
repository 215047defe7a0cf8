//! Finds intersections of the fill's triangles with each other and with the input mesh, using exact predicates.

use maquette_node::{Error, Limit, Progress};
use maquette_value::parallel::*;
use nalgebra::Point3;
use robust::{Coord, Coord3D, orient2d, orient3d};

use super::boxes::{Bounds, BoxedTriangle, Boxes, Triangle};
use crate::triangles::filling::Filling;
use crate::triangles::triangulation::area_vector;

/// Maximum number of triangle pairs to test, in addition to [`USUAL_PAIRS_PER_TRIANGLE`]. A pair is tested if it contains a triangle of the
/// fill and its boxes overlap. Testing the maximum takes some tenths of a second. The limit is exceeded if many triangles are as long as
/// the fill: their boxes overlap the boxes of all others.
const MAX_PAIRS: Limit = Limit {
    max: 500_000,
    items: "comparisons of triangles",
    help: "check whether a vertex of a rim is an outlier, or leave the rim out with `holes: Edges` or `holes: Loops`",
};

/// The usual number of pairs to test per triangle of the fill: twice the number found in fills whose triangles are no thinner than those of
/// a good mesh.
const USUAL_PAIRS_PER_TRIANGLE: usize = 60;

/// The number of tree leaves from which the number of pairs is estimated.
const SAMPLED_LEAVES: usize = 64;

/// The number of tree leaves that one task tests.
const CHUNK_SIZE: usize = 32;

/// The intersections of the fill's triangles with other triangles, apart from shared vertices and edges. When the fills of some holes
/// change, only the triangles of these fills are tested again.
pub(crate) struct Intersections {
    /// The triangles of the input mesh that overlap `bounds`.
    data: Boxes,
    bounds: Bounds,
    filled: Boxes,
    /// The faces of each intersecting pair, the lower index first; at least one of them belongs to the fill. The pairs are in ascending
    /// order.
    pairs: Vec<[u32; 2]>,
}

impl Intersections {
    /// Tests all faces of the fill.
    ///
    /// # Errors
    /// Returns an error if there would be too many pairs to test, or if the evaluation is cancelled.
    pub(crate) fn new(filling: &Filling, progress: &Progress<'_>) -> Result<Self, Error> {
        let mut intersections = Self {
            data: Boxes::default(),
            bounds: Bounds::EMPTY,
            filled: Boxes::default(),
            pairs: Vec::new(),
        };
        intersections.update(filling, |_| true, progress)?;
        Ok(intersections)
    }

    /// Tests the faces of the fill for which `changed` returns true, and updates the intersecting pairs.
    ///
    /// # Errors
    /// Returns an error if there would be too many pairs to test, or if the evaluation is cancelled.
    pub(crate) fn update(
        &mut self,
        filling: &Filling,
        changed: impl Fn(u32) -> bool + Sync,
        progress: &Progress<'_>,
    ) -> Result<(), Error> {
        let first = filling.n_data_faces as u32;
        let faces = first..filling.faces.len() as u32;
        let filled: Vec<Triangle> = faces.map(|face| Triangle::new(filling, face)).collect();
        let bounds =
            filled.iter().fold(Bounds::EMPTY, |bounds, triangle| bounds.join(&triangle.bounds()));
        let filled = filled.into_iter();
        self.filled = join(|| Boxes::new(filled), || self.extend_data(filling, bounds)).0;
        let is_changed = |face: u32| first <= face && changed(face);
        self.pairs.retain(|pair| !pair.iter().any(|&face| is_changed(face)));
        let leaves: Vec<&[BoxedTriangle]> = self.filled.leaves().collect();
        let ordinary = USUAL_PAIRS_PER_TRIANGLE * (filling.faces.len() - filling.n_data_faces);
        let limit = Limit { max: MAX_PAIRS.max + ordinary, ..MAX_PAIRS };
        limit.check("the fill of the holes", self.estimate(&leaves, &is_changed))?;
        let found: Vec<Vec<[u32; 2]>> = leaves
            .par_chunks(CHUNK_SIZE)
            .map(|leaves| {
                let mut pairs = Vec::new();
                for leaf in leaves {
                    progress.check()?;
                    self.test_leaf(leaf, &is_changed, &mut pairs);
                }
                Ok(pairs)
            })
            .collect::<Result<_, Error>>()?;
        self.pairs.extend(found.into_iter().flatten());
        self.pairs.par_sort_unstable();
        Ok(())
    }

    /// Estimates the number of pairs of triangles whose boxes overlap and of which at least one has changed.
    fn estimate(
        &self,
        leaves: &[&[BoxedTriangle]],
        is_changed: &(impl Fn(u32) -> bool + Sync),
    ) -> f64 {
        let step = leaves.len().div_ceil(SAMPLED_LEAVES).max(1);
        let sampled: Vec<_> = leaves.iter().step_by(step).collect();
        let found: usize = sampled
            .par_iter()
            .map(|leaf| {
                let mut count = 0;
                for own in leaf.iter().filter(|own| is_changed(own.triangle.face)) {
                    self.data.for_each_near(&own.bounds, |_| count += 1);
                    self.filled.for_each_near(&own.bounds, |_| count += 1);
                }
                count
            })
            .sum();
        (found * step) as f64
    }

    /// Adds the intersecting pairs of the changed triangles in a leaf of `filled`. The triangles of a leaf are close together, so one
    /// search finds the triangles near all of them.
    fn test_leaf(
        &self,
        leaf: &[BoxedTriangle],
        is_changed: &impl Fn(u32) -> bool,
        pairs: &mut Vec<[u32; 2]>,
    ) {
        let changed = || leaf.iter().filter(|own| is_changed(own.triangle.face));
        let bounds = changed().fold(Bounds::EMPTY, |bounds, own| bounds.join(&own.bounds));
        let mut test = |other: &BoxedTriangle, is_data: bool| {
            let (triangle, number) = (&other.triangle, other.triangle.face);
            for own in changed().filter(|own| own.bounds.overlaps(&other.bounds)) {
                // Test a pair of two changed triangles once, for the triangle with the lower index.
                let face = own.triangle.face;
                let is_new = is_data || face < number || (face != number && !is_changed(number));
                if is_new && intersect(&own.triangle, triangle) {
                    pairs.push([face.min(number), face.max(number)]);
                }
            }
        };
        self.data.for_each_near(&bounds, |other| test(other, true));
        self.filled.for_each_near(&bounds, |other| test(other, false));
    }

    /// Extends `data` to all input triangles that could intersect a fill within `bounds`.
    fn extend_data(&mut self, filling: &Filling, bounds: Bounds) {
        if self.bounds.contains(&bounds) {
            return;
        }
        self.bounds = self.bounds.join(&bounds);
        let data = filling.points[..filling.n_data_vertices].iter();
        let outcodes: Vec<u8> = data.map(|point| self.bounds.outcode(point)).collect();
        let near = (0..).zip(&filling.faces[..filling.n_data_faces]).filter(|(_, face)| {
            let [a, b, c] = face.map(|vertex| outcodes[vertex as usize]);
            a & b & c == 0
        });
        self.data = Boxes::new(near.map(|(face, _)| Triangle::new(filling, face)));
    }

    /// Renumbers the faces of all pairs. A pair is removed if `number` returns `None` for one of its faces.
    pub(crate) fn renumber(&mut self, number: impl Fn(u32) -> Option<u32>) {
        let renumbered = self.pairs.iter().filter_map(|&[a, b]| Some([number(a)?, number(b)?]));
        self.pairs = renumbered.collect();
    }

    /// Returns the faces of the fill that intersect other faces, in ascending order.
    pub(crate) fn faces(&self, filling: &Filling) -> Vec<u32> {
        let faces = self.pairs.as_flattened().iter().copied();
        let mut faces: Vec<u32> =
            faces.filter(|&face| filling.n_data_faces <= face as usize).collect();
        faces.sort_unstable();
        faces.dedup();
        faces
    }

    /// Returns the intersecting pairs of faces in ascending order. In each pair the lower index is first, and at least one face belongs to
    /// the fill.
    pub(crate) fn pairs(&self) -> &[[u32; 2]] {
        &self.pairs
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// Calls `found` with each face that intersects `triangle`: faces of the input mesh and of the fill.
    pub(crate) fn for_each_intersecting(&self, triangle: &Triangle, mut found: impl FnMut(u32)) {
        for boxes in [&self.data, &self.filled] {
            boxes.for_each_near(&triangle.bounds(), |other| {
                if intersect(triangle, &other.triangle) {
                    found(other.triangle.face);
                }
            });
        }
    }
}

/// Returns true if two triangles have more in common than shared vertices and edges.
pub(crate) fn intersect(one: &Triangle, other: &Triangle) -> bool {
    let (a, b) = (one.vertices, other.vertices);
    let (on_a, on_b) = (one.corners, other.corners);
    match a.iter().filter(|vertex| b.contains(vertex)).count() {
        0 => {
            let Some(of_a) = sides(on_b, on_a) else { return false };
            let Some(of_b) = sides(on_a, on_b) else { return false };
            fn any_side_pierces(
                edges: [Point3<f64>; 3],
                sides: [f64; 3],
                triangle: [Point3<f64>; 3],
            ) -> bool {
                (0..3)
                    .map(|k| [k, (k + 1) % 3])
                    .any(|ends| pierces(ends.map(|k| edges[k]), ends.map(|k| sides[k]), triangle))
            }
            any_side_pierces(on_a, of_a, on_b)
                || any_side_pierces(on_b, of_b, on_a)
                || (of_a == [0.0; 3] && of_b == [0.0; 3] && overlap_in_plane(on_a, on_b))
        }
        1 => {
            fn opposite(face: &Triangle, other: &Triangle) -> [Point3<f64>; 2] {
                let k = (0..3).find(|&k| other.vertices.contains(&face.vertices[k])).unwrap_or(0);
                [(k + 1) % 3, (k + 2) % 3].map(|k| face.corners[k])
            }
            let (ends_a, ends_b) = (opposite(one, other), opposite(other, one));
            // If the plane of one triangle meets the other triangle only in the shared vertex, the triangles have nothing else in common.
            let Some(of_a) = sides(on_b, ends_a) else { return false };
            let Some(of_b) = sides(on_a, ends_b) else { return false };
            pierces(ends_a, of_a, on_b)
                || pierces(ends_b, of_b, on_a)
                || (of_a == [0.0; 2] && of_b == [0.0; 2] && overlap_in_plane(on_a, on_b))
        }
        2 => is_folded(one, other),
        _ => true,
    }
}

fn side([a, b, c]: [Point3<f64>; 3], p: Point3<f64>) -> f64 {
    fn coord(p: Point3<f64>) -> Coord3D<f64> {
        Coord3D { x: p.x, y: p.y, z: p.z }
    }
    orient3d(coord(a), coord(b), coord(c), coord(p))
}

/// Returns, for each point, a number whose sign is the side of the triangle's plane on which the point is; `None` if all points are on one
/// side.
fn sides<const N: usize>(
    triangle: [Point3<f64>; 3],
    corners: [Point3<f64>; N],
) -> Option<[f64; N]> {
    let sides = corners.map(|p| side(triangle, p));
    let is_beside = sides.iter().all(|&side| side > 0.0) || sides.iter().all(|&side| side < 0.0);
    (!is_beside).then_some(sides)
}

/// Returns true if the segment from `p` to `q` pierces a triangle. This is the case if `from` and `to`, the sides of the plane on which its
/// ends are, differ, and if it passes all three edges of the triangle on the same side.
fn pierces([p, q]: [Point3<f64>; 2], [from, to]: [f64; 2], [a, b, c]: [Point3<f64>; 3]) -> bool {
    if !((from > 0.0 && to < 0.0) || (from < 0.0 && to > 0.0)) {
        return false;
    }
    let sides = [[a, b], [b, c], [c, a]].map(|[from, to]| side([p, q, from], to));
    sides.iter().all(|&side| side >= 0.0) || sides.iter().all(|&side| side <= 0.0)
}

/// Returns the points without the coordinate `drop`, that is, projected along this axis.
fn drop_axis<const N: usize>(points: [Point3<f64>; N], drop: usize) -> [Coord<f64>; N] {
    points.map(|point| Coord { x: point[(drop + 1) % 3], y: point[(drop + 2) % 3] })
}

/// Returns the axis along which the projection of two coplanar triangles has the largest area.
fn best_axis(a: [Point3<f64>; 3], b: [Point3<f64>; 3]) -> usize {
    let (a, b) = (area_vector(a), area_vector(b));
    if a.norm_squared() < b.norm_squared() { b.iamax() } else { a.iamax() }
}

/// Returns true if two coplanar triangles overlap.
fn overlap_in_plane(a: [Point3<f64>; 3], b: [Point3<f64>; 3]) -> bool {
    let drop = best_axis(a, b);
    let (a, b) = (drop_axis(a, drop), drop_axis(b, drop));
    fn cross([p, q]: [Coord<f64>; 2], [r, s]: [Coord<f64>; 2]) -> bool {
        orient2d(p, q, r) * orient2d(p, q, s) < 0.0 && orient2d(r, s, p) * orient2d(r, s, q) < 0.0
    }
    fn edges(t: [Coord<f64>; 3]) -> [[Coord<f64>; 2]; 3] {
        [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]
    }
    fn contains_point(p: Coord<f64>, t: [Coord<f64>; 3]) -> bool {
        let sides = edges(t).map(|[from, to]| orient2d(from, to, p));
        sides.iter().all(|&side| side > 0.0) || sides.iter().all(|&side| side < 0.0)
    }
    edges(a).into_iter().any(|edge| edges(b).into_iter().any(|other| cross(edge, other)))
        || a.into_iter().any(|corner| contains_point(corner, b))
        || b.into_iter().any(|corner| contains_point(corner, a))
}

/// Returns true if two triangles with a common edge are coplanar and on the same side of the edge.
fn is_folded(one: &Triangle, other: &Triangle) -> bool {
    fn apex(face: &Triangle, vertices: [u32; 3]) -> usize {
        (0..3).find(|&k| !vertices.contains(&face.vertices[k])).unwrap_or(0)
    }
    let (k, l) = (apex(one, other.vertices), apex(other, one.vertices));
    let q = other.corners[l];
    if side(one.corners, q) != 0.0 {
        return false;
    }
    let [p, u, v] = [k, (k + 1) % 3, (k + 2) % 3].map(|corner| one.corners[corner]);
    // A projection axis parallel to the plane projects both triangles to lines and gives no result, so try all axes.
    (0..3).any(|drop| {
        let [u, v, p, q] = drop_axis([u, v, p, q], drop);
        orient2d(u, v, p) * orient2d(u, v, q) > 0.0
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::{grid, random};

    #[test]
    fn an_update_finds_the_intersections_of_a_full_test() {
        let mut filling = Filling::new(&grid(12, 12, |_, _| 0.0));
        (filling.n_data_vertices, filling.n_data_faces) = (72, 100);
        let progress = Progress::silent();
        let mut intersections = Intersections::new(&filling, &progress).unwrap();
        assert!(intersections.is_empty());
        let mut counts = Vec::new();
        for round in 0..30u64 {
            // Move some vertices, some of them far away, and then move some of them back.
            let mut moved = vec![false; filling.points.len()];
            for k in 0..6 {
                let number = |i: u64| random(round << 20 | k << 4 | i);
                let vertex = 72 + (72.0 * number(0)) as usize;
                let spread = if number(1) < 0.2 { 12.0 } else { 3.0 };
                let off = nalgebra::Vector3::new(number(2), number(3), number(4)) * spread;
                let start = Point3::new((vertex % 12) as f64, (vertex / 12) as f64, 0.0);
                filling.points[vertex] = if number(5) < 0.5 { start } else { start + off };
                moved[vertex] = true;
            }
            let faces = filling.faces.clone();
            intersections
                .update(
                    &filling,
                    |face: u32| faces[face as usize].iter().any(|&v| moved[v as usize]),
                    &progress,
                )
                .unwrap();
            let all = Intersections::new(&filling, &progress).unwrap();
            assert_eq!(intersections.pairs(), all.pairs());
            counts.push(all.pairs().len());
        }
        assert!(counts.iter().any(|&count| count > 50), "{counts:?}");
    }

    #[test]
    fn triangles_intersect_in_more_than_corners_and_edges() {
        fn check(one: [[f64; 3]; 3], numbers: [u32; 3], other: [[f64; 3]; 3], meets: bool) {
            fn triangle(vertices: [u32; 3], corners: [[f64; 3]; 3]) -> Triangle {
                Triangle { vertices, corners: corners.map(Point3::from), face: 0 }
            }
            let (one, other) = (triangle([0, 1, 2], one), triangle(numbers, other));
            assert_eq!(
                [intersect(&one, &other), intersect(&other, &one)],
                [meets; 2],
                "{numbers:?}"
            );
        }
        let [o, x, y, z] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let [low, in_middle] = [[0.2, 0.2, -1.0], [0.2, 0.2, 1.0]];
        check([o, x, y], [3, 4, 5], [low, in_middle, [9.0, 9.0, 0.0]], true);
        check([o, x, y], [3, 4, 5], [low, in_middle, [-9.0, 0.1, 0.0]], true);
        check([o, x, y], [3, 4, 5], [z, in_middle, [9.0, 9.0, 1.0]], false);
        // Two coplanar triangles.
        check([o, x, y], [3, 4, 5], [[0.1, 0.1, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]], true);
        check([o, x, y], [3, 4, 5], [[1.0, 1.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]], false);
        // Two triangles with a common vertex, or with a common edge.
        check([o, x, y], [0, 4, 5], [o, low, in_middle], true);
        check([o, x, y], [0, 4, 5], [o, z, in_middle], false);
        check([o, x, y], [0, 4, 5], [o, [0.9, 0.2, 0.0], [0.2, 0.9, 0.0]], true);
        check([o, x, y], [0, 4, 5], [o, [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], false);
        check([o, x, y], [1, 0, 5], [x, o, y], true);
        check([o, x, y], [1, 0, 5], [x, o, [0.3, -1.0, 0.0]], false);
        check([o, x, y], [1, 0, 5], [x, o, z], false);
        // A triangle without area next to a triangle that is not in the same plane.
        check([o, o, x], [3, 4, 5], [[0.0, 0.2, 0.0], [1.0, 0.3, 0.1], [0.5, -0.1, 1.0]], false);
    }
}
