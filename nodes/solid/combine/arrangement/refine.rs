//! Divides triangles along their intersections.

use std::cmp::Ordering;
use std::collections::BTreeSet;

use maquette_node::{CancelledError, Progress};
use maquette_value::{Bounds, BoxTree};

use super::points::{Plane, Points, Site, point_at_zero};
use super::triangulation::triangulate;

/// Number of triangles that are intersected or divided between two checks for cancellation.
const CHUNK: usize = 64;

/// A triangle of the grid.
#[derive(Clone, Copy, Debug)]
pub(super) struct GridTriangle {
    /// The numbers of its corners among all points.
    pub(super) corners: [u32; 3],
    pub(super) sites: [Site; 3],
    pub(super) plane: Plane,
    /// The index of the triangle among those of the mesh.
    pub(super) source: u32,
}

impl GridTriangle {
    pub(super) fn bounds(&self) -> Bounds {
        Bounds::from_points(&self.sites.map(|site| site.map(|x| x as f64).into()))
    }

    fn edges(&self) -> [[usize; 2]; 3] {
        [[0, 1], [1, 2], [2, 0]]
    }

    /// Returns true if a point of the triangle's plane is in the triangle or on its border.
    fn contains(&self, point: u32, points: &Points) -> bool {
        self.edges().into_iter().all(|[p, q]| {
            let side = [self.corners[p], self.corners[q], point];
            points.orientation(side, self.plane.axes) != Ordering::Less
        })
    }
}

/// A part of a triangle that no other triangle crosses.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part {
    /// The index of the triangle.
    pub(super) triangle: u32,
    /// The corners, with the orientation of the triangle.
    pub(super) corners: [u32; 3],
}

/// Divides triangles such that any two parts have no point, a corner, an edge or all points in common.
pub(super) fn refine(
    triangles: &[GridTriangle],
    points: &mut Points,
    progress: &Progress<'_>,
) -> Result<Vec<Part>, CancelledError> {
    let bounds: Vec<_> = triangles.iter().map(GridTriangle::bounds).collect();
    let boxes = BoxTree::new(bounds.iter().copied());
    // The lines in each triangle along which it is divided; a line whose ends are equal is a point.
    let mut lines = vec![Vec::new(); triangles.len()];
    for (number, triangle) in triangles.iter().enumerate() {
        if number.is_multiple_of(CHUNK) {
            progress.tick(0.6 * number as f64 / triangles.len() as f64)?;
        }
        let mut others = Vec::new();
        boxes.visit_overlapping(&bounds[number], |other| {
            if number < other as usize {
                others.push(other as usize);
            }
        });
        others.sort_unstable();
        for other in others {
            let found = intersect([triangle, &triangles[other]], points);
            for (of, found) in [number, other].into_iter().zip(found) {
                let corners = &triangles[of].corners;
                // A line between two corners is an edge of the triangle.
                lines[of].extend(
                    found.into_iter().filter(|it| it.iter().any(|end| !corners.contains(end))),
                );
            }
        }
    }
    let mut parts = Vec::with_capacity(triangles.len());
    for (number, (triangle, lines)) in triangles.iter().zip(lines).enumerate() {
        if number.is_multiple_of(CHUNK) {
            progress.tick(0.6 + 0.4 * number as f64 / triangles.len() as f64)?;
        }
        let triangle_number = number as u32;
        if lines.is_empty() {
            parts.push(Part { triangle: triangle_number, corners: triangle.corners });
        } else {
            let found = divide(triangle, lines, points).into_iter();
            parts.extend(found.map(|corners| Part { triangle: triangle_number, corners }));
        }
    }
    Ok(parts)
}

/// Returns the intersection of two triangles, as lines in the first and lines in the second.
fn intersect([a, b]: [&GridTriangle; 2], points: &mut Points) -> [Vec<[u32; 2]>; 2] {
    let of_a = a.sites.map(|site| b.plane.height(site));
    let of_b = b.sites.map(|site| a.plane.height(site));
    fn is_apart(heights: &[i128; 3]) -> bool {
        heights.iter().all(|it| *it < 0) || heights.iter().all(|it| 0 < *it)
    }
    if is_apart(&of_a) || is_apart(&of_b) {
        return [Vec::new(), Vec::new()];
    }
    if of_a == [0; 3] {
        return [edges_inside(b, a, points), edges_inside(a, b, points)];
    }
    let mut ends = Vec::new();
    for (own, heights, other) in [(a, of_a, b), (b, of_b, a)] {
        for [p, q] in own.edges() {
            let end = match heights[p].signum() * heights[q].signum() {
                -1 => {
                    let sites = [own.sites[p], own.sites[q]];
                    points.add(point_at_zero(sites, [heights[p], heights[q]]))
                }
                _ if heights[p] == 0 => own.corners[p],
                _ => continue,
            };
            if !ends.contains(&end) && other.contains(end, points) {
                ends.push(end);
            }
        }
    }
    let lines = lines_between(&ends);
    [lines.clone(), lines]
}

/// Returns the parts of the edges of `of` that are in the triangle `inside`, which is in the same plane.
fn edges_inside(of: &GridTriangle, inside: &GridTriangle, points: &mut Points) -> Vec<[u32; 2]> {
    let mut lines = Vec::new();
    let axes = inside.plane.axes;
    for edge in of.edges().map(|edge| edge.map(|k| of.corners[k])) {
        let mut ends: Vec<u32> =
            edge.into_iter().filter(|end| inside.contains(*end, points)).collect();
        for side in inside.edges().map(|side| side.map(|k| inside.corners[k])) {
            let is_on_edge = |it: &u32| is_between(*it, edge, axes, points);
            let end = match cross(edge, side, axes, points) {
                true => points.add_crossing([edge, side], &inside.plane),
                false if is_on_edge(&side[0]) => side[0],
                false => continue,
            };
            if !ends.contains(&end) {
                ends.push(end);
            }
        }
        lines.extend(lines_between(&ends));
    }
    lines
}

/// Returns the lines between each two of some points on one line, or the only point as a line.
fn lines_between(ends: &[u32]) -> Vec<[u32; 2]> {
    match ends {
        [only] => vec![[*only; 2]],
        _ => (1..ends.len()).flat_map(|k| ends[..k].iter().map(move |&it| [it, ends[k]])).collect(),
    }
}

/// Returns true if the interiors of two lines in a plane have exactly one point in common.
fn cross([p, q]: [u32; 2], [u, v]: [u32; 2], axes: [usize; 2], points: &Points) -> bool {
    let sides = [[p, q, u], [p, q, v], [u, v, p], [u, v, q]];
    let sides = sides.map(|it| points.orientation(it, axes));
    !sides.contains(&Ordering::Equal) && sides[0] != sides[1] && sides[2] != sides[3]
}

/// Returns true if a point is on a line, and not at its ends.
fn is_between(point: u32, [p, q]: [u32; 2], axes: [usize; 2], points: &Points) -> bool {
    point != p
        && point != q
        && points.orientation([p, q, point], axes) == Ordering::Equal
        && points.compare(p, point, axes) == points.compare(point, q, axes)
}

/// Divides a triangle along lines.
fn divide(triangle: &GridTriangle, mut lines: Vec<[u32; 2]>, points: &mut Points) -> Vec<[u32; 3]> {
    let axes = triangle.plane.axes;
    lines.extend(triangle.edges().map(|edge| edge.map(|k| triangle.corners[k])));
    lines.iter_mut().for_each(|ends| ends.sort_unstable());
    lines.sort_unstable();
    lines.dedup();
    let mut all: BTreeSet<u32> = lines.as_flattened().iter().copied().collect();
    let boxes: Vec<_> = lines.iter().map(|it| points.bounds(*it, axes)).collect();
    for [k, l] in (0..lines.len()).flat_map(|k| (0..k).map(move |l| [k, l])) {
        if boxes[k].overlaps(&boxes[l]) && cross(lines[k], lines[l], axes, points) {
            all.insert(points.add_crossing([lines[k], lines[l]], &triangle.plane));
        }
    }
    let mut sides = BTreeSet::new();
    for ([p, q], bounds) in lines.into_iter().zip(&boxes).filter(|it| it.0[0] != it.0[1]) {
        let mut stops: Vec<u32> = all
            .iter()
            .copied()
            .filter(|&it| {
                bounds.overlaps(&points.bounds([it; 2], axes))
                    && is_between(it, [p, q], axes, points)
            })
            .chain([p, q])
            .collect();
        stops.sort_by(|&a, &b| points.compare(a, b, axes));
        sides.extend(stops.windows(2).map(|ends| [ends[0].min(ends[1]), ends[0].max(ends[1])]));
    }
    triangulate(triangle.corners, &Vec::from_iter(all), &Vec::from_iter(sides), axes, points)
}
