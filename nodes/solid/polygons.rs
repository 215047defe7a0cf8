//! Triangulates plane polygons with holes. All sides of the polygons become sides of triangles, and no vertices are added.

use std::collections::BTreeMap;

pub(crate) use maquette_value::polygon::project_to_plane;
use maquette_value::polygon::{self, PlanePoint, is_in_triangle, orientation};

/// Connects directed sides, each given by its start and its end, to closed loops of vertices. The loops are in the order of their lowest
/// vertex indices.
pub(crate) fn loops(sides: &[[u32; 2]]) -> Vec<Vec<u32>> {
    let mut next: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    sides.iter().for_each(|&[start, end]| next.entry(start).or_default().push(end));
    let mut loops = Vec::new();
    while let Some((&first, _)) = next.first_key_value() {
        let (mut own, mut at) = (Vec::new(), first);
        while let Some(ends) = next.get_mut(&at) {
            own.push(at);
            let end = ends.pop().expect("lists without an end are taken out");
            if ends.is_empty() {
                next.remove(&at);
            }
            at = end;
        }
        loops.push(own);
    }
    loops
}

fn area(places: &[PlanePoint]) -> f64 {
    let next = places[1..].iter().chain(&places[..1]);
    let from = places[0];
    places
        .iter()
        .zip(next)
        .map(|(a, b)| (a[0] - from[0]) * (b[1] - from[1]) - (a[1] - from[1]) * (b[0] - from[0]))
        .sum()
}

/// Triangulates the polygons between the given loops; `position` gives the position of a vertex in the plane. Outer loops are
/// counter-clockwise, holes clockwise. Loops that rounding has made slightly invalid are triangulated as well as possible.
pub(crate) fn triangulate(
    loops: &[Vec<u32>],
    position: impl Fn(u32) -> PlanePoint,
) -> Vec<[u32; 3]> {
    let (mut outer, mut holes) = (Vec::new(), Vec::new());
    for own in loops.iter().filter(|own| own.len() > 2) {
        let corners: Vec<_> = own.iter().map(|&vertex| (vertex, position(vertex))).collect();
        let places: Vec<_> = corners.iter().map(|corner| corner.1).collect();
        match area(&places) >= 0.0 || loops.len() == 1 {
            true => outer.push(corners),
            false => holes.push(corners),
        }
    }
    // Connect the hole that reaches farthest to the right first: no other hole can be between this hole and the polygon around it.
    fn reach(hole: &[(u32, PlanePoint)]) -> f64 {
        hole.iter().fold(f64::NEG_INFINITY, |x, it| x.max(it.1[0]))
    }
    holes.sort_by(|a, b| reach(b).total_cmp(&reach(a)));
    for hole in holes {
        match bridge(&outer, &hole) {
            Some((polygon, corner, start)) => {
                let own = &mut outer[polygon];
                let ring = hole[start..].iter().chain(&hole[..=start]);
                let with = own[..=corner].iter().chain(ring).chain(&own[corner..]);
                *own = with.copied().collect();
            }
            None => outer.push(hole),
        }
    }
    outer.into_iter().flat_map(clip_ears).collect()
}

/// Finds a bridge between a hole and an outer polygon. Returns the polygon, one of its corners, and a corner of the hole, such that nothing
/// is between the two corners: Eberly, "Triangulation by ear clipping" (2002), section 3. If because of rounding there is no such pair,
/// takes the nearest corner of any polygon.
fn bridge(
    outer: &[Vec<(u32, PlanePoint)>],
    hole: &[(u32, PlanePoint)],
) -> Option<(usize, usize, usize)> {
    let start = (0..hole.len()).max_by(|&a, &b| hole[a].1[0].total_cmp(&hole[b].1[0]))?;
    let from = hole[start].1;
    fn distance_sq(at: PlanePoint, from: PlanePoint) -> f64 {
        (at[0] - from[0]) * (at[0] - from[0]) + (at[1] - from[1]) * (at[1] - from[1])
    }
    // Find the nearest side that a ray from the hole to the right crosses.
    let mut met: Option<(f64, usize, usize)> = None;
    for (polygon, corners) in outer.iter().enumerate() {
        for k in 0..corners.len() {
            let [a, b] = [corners[k].1, corners[(k + 1) % corners.len()].1];
            if a[1] <= from[1] && from[1] < b[1] {
                let x = a[0] + (from[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
                if from[0] <= x && met.is_none_or(|(best, ..)| x < best) {
                    met = Some((x, polygon, k));
                }
            }
        }
    }
    let Some((x, polygon, side)) = met else {
        let corners = outer.iter().enumerate();
        let corners = corners.flat_map(|(polygon, own)| (0..own.len()).map(move |k| (polygon, k)));
        let nearest = corners
            .map(|(polygon, k)| (distance_sq(outer[polygon][k].1, from), polygon, k))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        return nearest.map(|(_, polygon, corner)| (polygon, corner, start));
    };
    let corners = &outer[polygon];
    let count = corners.len();
    let end = (side + 1) % count;
    let farther = if corners[side].1[0] > corners[end].1[0] { side } else { end };
    let hit = [x, from[1]];
    let tip = corners[farther].1;
    // Among the reflex corners inside of the triangle, find the one in the direction with the smallest angle to the ray.
    let triangle =
        if orientation([from, hit, tip]) > 0.0 { [from, hit, tip] } else { [from, tip, hit] };
    fn slope(k: usize, from: [f64; 2], corners: &[(u32, [f64; 2])]) -> f64 {
        let at = corners[k].1;
        (at[1] - from[1]).abs() / (at[0] - from[0]).max(f64::MIN_POSITIVE)
    }
    let order = |a: &usize, b: &usize| {
        let by_slope = slope(*a, from, corners).total_cmp(&slope(*b, from, corners));
        by_slope.then(distance_sq(corners[*a].1, from).total_cmp(&distance_sq(corners[*b].1, from)))
    };
    let blocking = (0..count)
        .filter(|k| *k != farther)
        .filter(|&k| {
            let at = corners[k].1;
            let [before, after] = [(k + count - 1) % count, (k + 1) % count].map(|k| corners[k].1);
            orientation([before, at, after]) <= 0.0
                && from[0] <= at[0]
                && is_in_triangle(triangle, at)
        })
        .min_by(order);
    let candidates = blocking.into_iter().chain([farther]);
    let place = candidates.min_by(order).map(|k| corners[k].1)?;
    // If several corners are at the same position, take the one whose interior angle contains the bridge.
    let mut same = (0..count).filter(|&k| corners[k].1 == place);
    let first = same.clone().next()?;
    Some((
        polygon,
        same.find(|&k| {
            let [before, after] = [(k + count - 1) % count, (k + 1) % count].map(|k| corners[k].1);
            let (left, right) = (
                orientation([place, after, from]) >= 0.0,
                orientation([before, place, from]) >= 0.0,
            );
            match orientation([before, place, after]) > 0.0 {
                true => left && right,
                false => left || right,
            }
        })
        .unwrap_or(first),
        start,
    ))
}

/// Triangulates a polygon by ear clipping; returns the vertices of each triangle.
fn clip_ears(corners: Vec<(u32, PlanePoint)>) -> Vec<[u32; 3]> {
    let points: Vec<_> = corners.iter().map(|corner| corner.1).collect();
    let triangles = polygon::clip_ears(&points).into_iter();
    triangles.map(|it| it.map(|corner| corners[corner as usize].0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangulates loops of points, and checks that the triangles are counter-clockwise and have the area of the polygon.
    #[track_caller]
    fn check(loops_of: &[&[PlanePoint]]) {
        let places = loops_of.concat();
        let mut first = 0;
        let loops = loops_of.iter().map(|own| {
            let numbers: Vec<_> = (first..first + own.len() as u32).collect();
            first += own.len() as u32;
            numbers
        });
        let loops = Vec::from_iter(loops);
        let triangles = triangulate(&loops, |vertex| places[vertex as usize]);
        let holes = loops_of.iter().filter(|own| area(own) < 0.0).count();
        let outer = loops_of.len() - holes;
        assert_eq!(triangles.len(), places.len() + 2 * holes - 2 * outer);
        fn corners(triangle: &[u32; 3], places: &[[f64; 2]]) -> [[f64; 2]; 3] {
            triangle.map(|vertex| places[vertex as usize])
        }
        let areas: Vec<_> =
            triangles.iter().map(|triangle| area(&corners(triangle, &places))).collect();
        assert!(areas.iter().all(|area| *area >= 0.0), "{triangles:?}");
        let wanted: f64 = loops_of.iter().map(|own| area(own)).sum();
        assert!((areas.iter().sum::<f64>() - wanted).abs() < 1e-9 * wanted);
    }

    #[test]
    fn sides_become_loops() {
        let sides = [[0, 1], [5, 6], [1, 2], [2, 0], [6, 7], [7, 5]];
        assert_eq!(loops(&sides), [vec![0, 1, 2], vec![5, 6, 7]]);
    }

    #[test]
    fn polygons_with_holes_become_triangles() {
        let square: &[PlanePoint] = &[[0., 0.], [9., 0.], [9., 9.], [0., 9.]];
        fn hole(x: f64, y: f64) -> [[f64; 2]; 4] {
            [[x, y], [x, y + 1.0], [x + 1.0, y + 1.0], [x + 1.0, y]]
        }
        check(&[square]);
        check(&[&[[0., 0.], [4., 0.], [4., 1.], [1., 1.], [1., 4.], [0., 4.]]]);
        check(&[square, &hole(4., 4.)]);
        check(&[square, &hole(2., 4.), &hole(5., 4.), &hole(4., 7.), &hole(7., 1.)]);
        let island: &[PlanePoint] = &[[4.2, 4.2], [4.8, 4.2], [4.5, 4.8]];
        check(&[square, &hole(4., 4.), island]);
    }

    #[test]
    fn corners_on_straight_sides_make_no_flat_triangles_where_others_can_be_made() {
        let sides: &[PlanePoint] =
            &[[0., 0.], [1., 0.], [2., 0.], [3., 0.], [3., 3.], [2., 3.], [1., 3.], [0., 3.]];
        check(&[sides]);
        let triangles = triangulate(&[(0..8).collect::<Vec<_>>()], |vertex| sides[vertex as usize]);
        assert!(
            triangles.iter().all(|it| orientation(it.map(|vertex| sides[vertex as usize])) > 0.0)
        );
    }

    #[test]
    fn loops_without_an_area_get_triangles_too() {
        fn line(vertex: u32) -> [f64; 2] {
            [f64::from(vertex), 0.0]
        }
        assert_eq!(triangulate(&[vec![0, 1, 2, 3]], line).len(), 2);
        assert_eq!(triangulate(&[vec![0, 1]], line).len(), 0);
    }
}
