//! Selects the parts that separate the inside of the result from its outside.

use std::cmp::Ordering;

use maquette_base::topology::union_find::UnionFind;
use maquette_node::{CancelledError, Progress};
use maquette_value::parallel::ParallelSliceMut;
use maquette_value::{Bounds, BoxTree};
use nalgebra::{Point3, Vector3};

use super::points::Points;
use super::refine::{GridTriangle, Part};
use crate::combine::rays::Hit;

/// Number of surface patches whose winding numbers are computed between two checks for cancellation.
const CHUNK: usize = 64;

/// Weights of the corners of a part for the points from which rays start. The next point is used if a ray meets an edge.
const STARTS: [[u32; 3]; 8] = [
    [1, 1, 1],
    [41, 27, 32],
    [23, 45, 33],
    [29, 19, 53],
    [53, 31, 17],
    [13, 37, 51],
    [67, 11, 23],
    [7, 59, 31],
];

/// Parts with the same three corners.
struct Sheet {
    /// The indices of the parts, ascending.
    parts: Vec<u32>,
    /// The index of a part whose normal points to where a winding number is smaller; `None` if the parts cancel each other.
    front: Option<u32>,
}

/// A part of the result's surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct KeptPart {
    /// The index of the triangle.
    pub(super) triangle: u32,
    /// The corners; counter-clockwise, seen from outside.
    pub(super) corners: [u32; 3],
}

/// The triangles of some solids, and the parts into which they are divided.
pub(super) struct Complex<'a> {
    pub(super) triangles: &'a [GridTriangle],
    /// The solid of each triangle.
    pub(super) solids: &'a [usize],
    pub(super) parts: &'a [Part],
    pub(super) points: &'a mut Points,
}

/// Returns the parts with the inside of the result on one side only. `is_inside` tells from the winding numbers of the solids, of which
/// there are `solids`, whether a place is inside of the result.
///
/// The surfaces divide the space into cells of constant winding numbers (Zhou, Grinspun, Zorin and Jacobson, "Mesh arrangements for solid
/// geometry", 2016). All parts that are connected without passing another surface separate the same two cells, so one ray decides for all
/// of them.
pub(super) fn select(
    complex: &mut Complex<'_>,
    solids: usize,
    is_inside: impl Fn(&[i32]) -> bool,
    progress: &Progress<'_>,
) -> Result<Vec<KeptPart>, CancelledError> {
    let sheets = complex.sheets();
    let patches = patches(&sheets, complex.parts);
    // For each patch, the sheet that is largest, from where the ray starts.
    let mut largest: Vec<Option<(f64, usize)>> = vec![None; sheets.len()];
    for (number, sheet) in sheets.iter().enumerate().filter(|it| it.1.front.is_some()) {
        let size = complex.size(sheet.parts[0]);
        let own = &mut largest[patches[number] as usize];
        if own.is_none_or(|(most, _)| most < size) {
            *own = Some((size, number));
        }
    }
    let boxes = BoxTree::new(complex.triangles.iter().map(GridTriangle::bounds));
    // For each patch, whether the result is inside in front of the patch, and behind it.
    let mut sides = vec![[false; 2]; sheets.len()];
    let starts = largest.iter().enumerate().filter_map(|(patch, it)| Some((patch, (*it)?.1)));
    for (number, (patch, sheet)) in starts.enumerate() {
        if number.is_multiple_of(CHUNK) {
            progress.tick(patch as f64 / sheets.len() as f64)?;
        }
        sides[patch] = complex.windings(&sheets[sheet], &boxes, solids).map(|it| is_inside(&it));
    }
    let kept = sheets.iter().zip(&patches).filter_map(|(sheet, &patch)| {
        let part = complex.parts[sheet.front? as usize];
        let [a, b, c] = part.corners;
        let corners = match sides[patch as usize] {
            [false, true] => [a, b, c],
            [true, false] => [a, c, b],
            _ => return None,
        };
        Some(KeptPart { triangle: part.triangle, corners })
    });
    Ok(kept.collect())
}

impl Complex<'_> {
    fn sheets(&self) -> Vec<Sheet> {
        let mut order: Vec<_> = (0..self.parts.len() as u32).collect();
        let key = |&part: &u32| (sorted(self.parts[part as usize].corners), part);
        order.sort_unstable_by_key(key);
        order
            .chunk_by(|a, b| key(a).0 == key(b).0)
            .map(|parts| Sheet { parts: parts.to_vec(), front: self.front(parts) })
            .collect()
    }

    fn solid(&self, part: u32) -> usize {
        self.solids[self.parts[part as usize].triangle as usize]
    }

    /// Returns a part of the first solid whose parts do not cancel each other, with the orientation of the majority of these parts.
    fn front(&self, parts: &[u32]) -> Option<u32> {
        let is_even = |part: u32| is_even(self.parts[part as usize].corners);
        let mut solids: Vec<_> = parts.iter().map(|&part| self.solid(part)).collect();
        solids.sort_unstable();
        solids.dedup();
        solids.into_iter().find_map(|solid| {
            let mut own = parts.iter().copied().filter(|&part| self.solid(part) == solid);
            let sum: i32 = own.clone().map(|part| if is_even(part) { 1 } else { -1 }).sum();
            own.find(|&part| sum != 0 && is_even(part) == (0 < sum))
        })
    }

    /// Returns a measure of a part's size, which is 0 for needles.
    fn size(&self, part: u32) -> f64 {
        let part = self.parts[part as usize];
        let [i, j] = self.triangles[part.triangle as usize].plane.axes;
        let places = part.corners.map(|it| self.points.rounded(it));
        let [u, v, w] = [[0, 1], [1, 2], [2, 0]]
            .map(|[a, b]: [usize; 2]| [places[b][i] - places[a][i], places[b][j] - places[a][j]]);
        let longest = [u, v, w].iter().map(|e| e[0] * e[0] + e[1] * e[1]).fold(0.0, f64::max);
        if longest > 0.0 { (u[0] * v[1] - u[1] * v[0]).abs() / longest.sqrt() } else { 0.0 }
    }

    /// Returns the winding numbers of the solids in front of a sheet and behind it: the numbers of exits minus those of entries along a ray
    /// from a point of the sheet.
    fn windings(&mut self, sheet: &Sheet, boxes: &BoxTree, solids: usize) -> [Vec<i32>; 2] {
        let front = self.parts[sheet.front.unwrap_or(sheet.parts[0]) as usize];
        let plane = self.triangles[front.triangle as usize].plane;
        let own: Vec<u32> =
            sheet.parts.iter().map(|&part| self.parts[part as usize].triangle).collect();
        let mut beyond = vec![0; solids];
        for weights in STARTS {
            beyond.fill(0);
            let from = self.points.add_inside(front.corners, weights);
            let place = Point3::from(self.points.rounded(from));
            // The box is larger than the rounding of the point.
            let low = place - Vector3::repeat(1.0);
            let mut high = place + Vector3::repeat(1.0);
            high[plane.axis] = f64::MAX;
            let mut is_clear = true;
            boxes.visit_overlapping(&Bounds { low, high }, |other| {
                if own.contains(&other) {
                    return;
                }
                match self.triangles[other as usize].hit(from, plane.axis, self.points) {
                    Hit::None => {}
                    Hit::Unclear => is_clear = false,
                    Hit::Leaves => beyond[self.solids[other as usize]] += 1,
                    Hit::Enters => beyond[self.solids[other as usize]] -= 1,
                }
            });
            if is_clear {
                break;
            }
        }
        let mut before = beyond.clone();
        for &triangle in &own {
            let is_up = 0 < self.triangles[triangle as usize].plane.normal[plane.axis];
            before[self.solids[triangle as usize]] += if is_up { 1 } else { -1 };
        }
        if 0 < plane.normal[plane.axis] { [beyond, before] } else { [before, beyond] }
    }
}

impl GridTriangle {
    /// Intersects the triangle with a ray in the positive direction of an axis. The ray is unclear if it meets an edge.
    fn hit(&self, from: u32, axis: usize, points: &Points) -> Hit {
        let is_up = match self.plane.normal[axis].cmp(&0) {
            Ordering::Equal => return Hit::None,
            order => order.is_gt(),
        };
        let [i, j] = [(axis + 1) % 3, (axis + 2) % 3];
        let axes = if is_up { [i, j] } else { [j, i] };
        let [a, b, c] = self.corners;
        let sides =
            [[a, b, from], [b, c, from], [c, a, from]].map(|it| points.orientation(it, axes));
        if sides.contains(&Ordering::Less) {
            return Hit::None;
        }
        // The triangle is beyond the start of the ray if the start is on the side to which the ray does not run.
        let is_beyond = match points.height(from, &self.plane) {
            Ordering::Equal => return Hit::Unclear,
            order => order.is_lt() == is_up,
        };
        match (is_beyond, sides.contains(&Ordering::Equal)) {
            (false, _) => Hit::None,
            (true, true) => Hit::Unclear,
            (true, false) if is_up => Hit::Leaves,
            (true, false) => Hit::Enters,
        }
    }
}

/// Joins sheets to patches: at an edge of exactly two sheets, both belong to one patch. Returns the patch of each sheet.
fn patches(sheets: &[Sheet], parts: &[Part]) -> Vec<u32> {
    let mut edges: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * sheets.len());
    for (number, sheet) in (0..).zip(sheets) {
        let [a, b, c] = sorted(parts[sheet.parts[0] as usize].corners);
        edges.extend([[a, b], [b, c], [a, c]].map(|edge| (edge, number)));
    }
    edges.par_sort_unstable();
    let mut sets = UnionFind::new(sheets.len());
    for same in edges.chunk_by(|a, b| a.0 == b.0) {
        if let [a, b] = same {
            sets.union(a.1, b.1);
        }
    }
    (0..sheets.len() as u32).map(|sheet| sets.find(sheet)).collect()
}

fn sorted(mut corners: [u32; 3]) -> [u32; 3] {
    corners.sort_unstable();
    corners
}

/// Returns true if an even number of exchanges sorts the corners.
fn is_even([a, b, c]: [u32; 3]) -> bool {
    [a < b, b < c, a < c].iter().filter(|it| !**it).count().is_multiple_of(2)
}
