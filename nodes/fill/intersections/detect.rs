//! Where filled triangles intersect each other or the data, decided by exact predicates.

use maquette_node::{Limit, Progress};
use maquette_value::parallel::*;
use nalgebra::Point3;
use robust::{Coord, Coord3D, orient2d, orient3d};

use super::boxes::{Bounds, Boxed, Boxes, Triangle};
use crate::fill_error::FillError;
use crate::triangles::filling::Filling;
use crate::triangles::triangulation::area_vector;

/// The most pairs of a filled triangle and another one whose boxes overlap, beyond [`PAIRS_OF_EACH`]: testing them takes some tenths of a
/// second, and at worst all of them intersect. Triangles as long as the fill overlap all others.
const PAIRS: Limit = Limit {
    most: 500_000,
    of: "comparisons of triangles",
    help: "see whether a vertex of a rim lies far off, or leave the rim out by `holes: Edges` or `holes: Loops`",
};

/// So many pairs of each filled triangle are ordinary: twice the number in fills whose triangles are as thin as those of good data.
const PAIRS_OF_EACH: usize = 60;

/// The number of pairs is estimated from so many leaves.
const SAMPLES: usize = 64;

/// Leaves of filled triangles that one task tests.
const CHUNK: usize = 32;

/// The intersections of filled triangles with others, beyond the vertices and the edge that they share. When some fills change, only those
/// are tested again.
pub(crate) struct Intersections {
    /// The data near what was filled so far: the triangles that overlap `within`.
    data: Boxes,
    within: Bounds,
    filled: Boxes,
    /// The faces of each pair, the lower one first; at least one of them is filled. Ascending.
    pairs: Vec<[u32; 2]>,
}

impl Intersections {
    /// Tests all filled faces.
    ///
    /// # Errors
    /// If there would be too many pairs to test, or the evaluation is told to stop.
    pub(crate) fn new(filling: &Filling, progress: &Progress<'_>) -> Result<Self, FillError> {
        let mut intersections = Self {
            data: Boxes::default(),
            within: Bounds::EMPTY,
            filled: Boxes::default(),
            pairs: Vec::new(),
        };
        intersections.update(filling, |_| true, progress)?;
        Ok(intersections)
    }

    /// Tests the filled faces that changed.
    ///
    /// # Errors
    /// If there would be too many pairs to test, or the evaluation is told to stop.
    pub(crate) fn update(
        &mut self,
        filling: &Filling,
        changed: impl Fn(u32) -> bool + Sync,
        progress: &Progress<'_>,
    ) -> Result<(), FillError> {
        let first = filling.kept as u32;
        let faces = first..filling.faces.len() as u32;
        let filled = || faces.clone().map(|face| Triangle::of(filling, face));
        let bounds =
            filled().fold(Bounds::EMPTY, |bounds, triangle| bounds.join(&triangle.bounds()));
        self.filled = rayon::join(|| Boxes::new(filled()), || self.take_in(filling, bounds)).0;
        let is_changed = |face: u32| first <= face && changed(face);
        self.pairs.retain(|pair| !pair.iter().any(|&face| is_changed(face)));
        let leaves: Vec<&[Boxed]> = self.filled.leaves().collect();
        let ordinary = PAIRS_OF_EACH * (filling.faces.len() - filling.kept);
        let limit = Limit { most: PAIRS.most + ordinary, ..PAIRS };
        limit.check("what fills the holes", self.estimate(&leaves, &is_changed))?;
        let found: Vec<Vec<[u32; 2]>> = leaves
            .par_chunks(CHUNK)
            .map(|leaves| {
                let mut pairs = Vec::new();
                for leaf in leaves {
                    progress.check()?;
                    self.test_leaf(leaf, &is_changed, &mut pairs);
                }
                Ok(pairs)
            })
            .collect::<Result<_, FillError>>()?;
        self.pairs.extend(found.into_iter().flatten());
        self.pairs.sort_unstable();
        Ok(())
    }

    /// About how many pairs of a changed triangle and another one there are whose boxes overlap.
    fn estimate(&self, leaves: &[&[Boxed]], is_changed: &(impl Fn(u32) -> bool + Sync)) -> f64 {
        let step = leaves.len().div_ceil(SAMPLES).max(1);
        let sampled: Vec<_> = leaves.iter().step_by(step).collect();
        let found: usize = sampled
            .par_iter()
            .map(|leaf| {
                let mut count = 0;
                for own in leaf.iter().filter(|own| is_changed(own.triangle.face)) {
                    self.data.near(&own.bounds, |_| count += 1);
                    self.filled.near(&own.bounds, |_| count += 1);
                }
                count
            })
            .sum();
        (found * step) as f64
    }

    /// Adds the pairs of the changed triangles of a leaf of `filled`. They lie side by side, so that one search finds what is near all of
    /// them.
    fn test_leaf(
        &self,
        leaf: &[Boxed],
        is_changed: &impl Fn(u32) -> bool,
        pairs: &mut Vec<[u32; 2]>,
    ) {
        let changed = || leaf.iter().filter(|own| is_changed(own.triangle.face));
        let bounds = changed().fold(Bounds::EMPTY, |bounds, own| bounds.join(&own.bounds));
        let mut test = |other: &Boxed, is_data: bool| {
            let (triangle, number) = (&other.triangle, other.triangle.face);
            for own in changed().filter(|own| own.bounds.overlaps(&other.bounds)) {
                // A pair of two changed triangles is tested once, for the first one.
                let face = own.triangle.face;
                let is_new = is_data || face < number || (face != number && !is_changed(number));
                if is_new && intersect(&own.triangle, triangle) {
                    pairs.push([face.min(number), face.max(number)]);
                }
            }
        };
        self.data.near(&bounds, |other| test(other, true));
        self.filled.near(&bounds, |other| test(other, false));
    }

    /// Makes `data` hold all triangles that could intersect what is filled within some bounds.
    fn take_in(&mut self, filling: &Filling, bounds: Bounds) {
        if self.within.holds(&bounds) {
            return;
        }
        self.within = self.within.join(&bounds);
        let data = filling.points[..filling.data].iter();
        let outcodes: Vec<u8> = data.map(|point| self.within.outcode(point)).collect();
        let near = (0..).zip(&filling.faces[..filling.kept]).filter(|(_, face)| {
            let [a, b, c] = face.map(|vertex| outcodes[vertex as usize]);
            a & b & c == 0
        });
        self.data = Boxes::new(near.map(|(face, _)| Triangle::of(filling, face)));
    }

    /// Gives faces other numbers; those that have none are gone.
    pub(crate) fn renumber(&mut self, number: impl Fn(u32) -> Option<u32>) {
        let renumbered = self.pairs.iter().filter_map(|&[a, b]| Some([number(a)?, number(b)?]));
        self.pairs = renumbered.collect();
    }

    /// The filled faces that intersect others, ascending.
    pub(crate) fn faces(&self, filling: &Filling) -> Vec<u32> {
        let faces = self.pairs.as_flattened().iter().copied();
        let mut faces: Vec<u32> = faces.filter(|&face| filling.kept <= face as usize).collect();
        faces.sort_unstable();
        faces.dedup();
        faces
    }

    /// The pairs of faces of which at least one is filled, the lower face first, ascending.
    pub(crate) fn pairs(&self) -> &[[u32; 2]] {
        &self.pairs
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// Calls `found` with each face, of the data or filled, that intersects a triangle.
    pub(crate) fn with(&self, triangle: &Triangle, mut found: impl FnMut(u32)) {
        for boxes in [&self.data, &self.filled] {
            boxes.near(&triangle.bounds(), |other| {
                if intersect(triangle, &other.triangle) {
                    found(other.triangle.face);
                }
            });
        }
    }
}

/// Whether two triangles intersect: whether they have more in common than the vertices and the edge that they share.
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
            // Where the plane of one contains nothing of the other but that vertex, they have no more in common.
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

/// On which sides of a triangle's plane some corners are; none if all are on the same one.
fn sides<const N: usize>(
    triangle: [Point3<f64>; 3],
    corners: [Point3<f64>; N],
) -> Option<[f64; N]> {
    let sides = corners.map(|p| side(triangle, p));
    let is_beside = sides.iter().all(|&side| side > 0.0) || sides.iter().all(|&side| side < 0.0);
    (!is_beside).then_some(sides)
}

/// Whether a segment pierces a triangle: its ends lie on different sides, which are given, and it passes all three edges on one.
fn pierces([p, q]: [Point3<f64>; 2], [from, to]: [f64; 2], [a, b, c]: [Point3<f64>; 3]) -> bool {
    if !((from > 0.0 && to < 0.0) || (from < 0.0 && to > 0.0)) {
        return false;
    }
    let sides = [[a, b], [b, c], [c, a]].map(|[from, to]| side([p, q, from], to));
    sides.iter().all(|&side| side >= 0.0) || sides.iter().all(|&side| side <= 0.0)
}

/// The coordinates of points without the one in which their triangle is seen edge-on.
fn flattened<const N: usize>(points: [Point3<f64>; N], drop: usize) -> [Coord<f64>; N] {
    points.map(|point| Coord { x: point[(drop + 1) % 3], y: point[(drop + 2) % 3] })
}

/// The axis along which the plane of two triangles is seen best.
fn best_axis(a: [Point3<f64>; 3], b: [Point3<f64>; 3]) -> usize {
    let (a, b) = (area_vector(a), area_vector(b));
    if a.norm_squared() < b.norm_squared() { b.iamax() } else { a.iamax() }
}

/// Whether two triangles in one plane cross there.
fn overlap_in_plane(a: [Point3<f64>; 3], b: [Point3<f64>; 3]) -> bool {
    let drop = best_axis(a, b);
    let (a, b) = (flattened(a, drop), flattened(b, drop));
    fn cross([p, q]: [Coord<f64>; 2], [r, s]: [Coord<f64>; 2]) -> bool {
        orient2d(p, q, r) * orient2d(p, q, s) < 0.0 && orient2d(r, s, p) * orient2d(r, s, q) < 0.0
    }
    fn edges(t: [Coord<f64>; 3]) -> [[Coord<f64>; 2]; 3] {
        [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]
    }
    fn within(p: Coord<f64>, t: [Coord<f64>; 3]) -> bool {
        let sides = edges(t).map(|[from, to]| orient2d(from, to, p));
        sides.iter().all(|&side| side > 0.0) || sides.iter().all(|&side| side < 0.0)
    }
    edges(a).into_iter().any(|edge| edges(b).into_iter().any(|other| cross(edge, other)))
        || a.into_iter().any(|corner| within(corner, b))
        || b.into_iter().any(|corner| within(corner, a))
}

/// Whether two triangles at one edge lie in one plane, on the same side of the edge.
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
    // Seen along an axis in the plane both are lines.
    (0..3).any(|drop| {
        let [u, v, p, q] = flattened([u, v, p, q], drop);
        orient2d(u, v, p) * orient2d(u, v, q) > 0.0
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::{grid, random};

    #[test]
    fn an_update_finds_the_same_as_a_test_of_all() {
        let mut filling = Filling::new(&grid(12, 12, |_, _| 0.0));
        (filling.data, filling.kept) = (72, 100);
        let progress = Progress::none();
        let mut intersections = Intersections::new(&filling, &progress).unwrap();
        assert!(intersections.is_empty());
        let mut counts = Vec::new();
        for round in 0..30u64 {
            // Some vertices go somewhere, sometimes far out, and some back.
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
        // In one plane.
        check([o, x, y], [3, 4, 5], [[0.1, 0.1, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]], true);
        check([o, x, y], [3, 4, 5], [[1.0, 1.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]], false);
        // At one vertex, and at one edge.
        check([o, x, y], [0, 4, 5], [o, low, in_middle], true);
        check([o, x, y], [0, 4, 5], [o, z, in_middle], false);
        check([o, x, y], [0, 4, 5], [o, [0.9, 0.2, 0.0], [0.2, 0.9, 0.0]], true);
        check([o, x, y], [0, 4, 5], [o, [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], false);
        check([o, x, y], [1, 0, 5], [x, o, y], true);
        check([o, x, y], [1, 0, 5], [x, o, [0.3, -1.0, 0.0]], false);
        check([o, x, y], [1, 0, 5], [x, o, z], false);
        // A triangle without area beside one in whose plane it is not.
        check([o, o, x], [3, 4, 5], [[0.0, 0.2, 0.0], [1.0, 0.3, 0.1], [0.5, -0.1, 1.0]], false);
    }
}
