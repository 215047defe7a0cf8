//! Extends creases across a hole as curves, and fills the parts of the hole between them.
//!
//! Each part is filled with a thin plate that continues the data on its own side. Beyond a crease, the surface of a part is continued by a
//! strip of triangles in the direction given by the normals beside the crease, so that the plate has the right direction there, too.
//!
//! The idea of filling between curves: Harary, Tal and Grinspun, "Feature-preserving surface completion using four points" (2014).

use maquette_node::Progress;
use nalgebra::{Point3, Vector3};

use super::charts::adjacent_faces;
use super::ends::{areas_around, find_ends};
use super::pairing::{Pair, pair};
use crate::border::rim::Rim;
use crate::plain::plates::{goes_too_far, membrane, min_weight_or_fan, plate};
use crate::plain::sizes::Sizes;
use crate::triangles::density::RefineError;
use crate::triangles::filling::Filling;
use crate::triangles::triangulation::Triangulation;

/// Maximum distance of a rim vertex from a curve at which the rim runs along the crease, in edge lengths.
const ALONG: f64 = 0.3;

/// Minimum mean angle, in radians, between adjacent triangles of a relief: 12 degrees. Noise of a twentieth of the edge length makes 8.
const MIN_RELIEF_BEND: f64 = 0.21;

/// A fill that is divided by curves which continue the creases of the data.
pub(crate) struct DividedFill {
    pub(crate) triangulation: Triangulation,
    /// True if all creases are joined, and curves describe them better than intersecting surfaces: if some are curved, or if the data
    /// beside them are a relief.
    pub(crate) is_clear: bool,
    /// For each vertex, true if it is inside of a part whose data are a relief.
    pub(crate) is_relief: Vec<bool>,
}

/// Fills a hole at which creases end that can be joined by curves. Returns `None` if there are no such creases, or if more creases remain
/// open than are joined.
///
/// # Errors
/// Returns an error if the fill would have too many triangles, or if the evaluation is cancelled.
pub(crate) fn divide(
    filling: &Filling,
    rim: &Rim,
    sizes: &Sizes,
    progress: &Progress<'_>,
) -> Result<Option<DividedFill>, RefineError> {
    let edge = rim.lengths.iter().sum::<f64>() / rim.len() as f64;
    let ends = find_ends(filling, rim);
    let Some(pairing) = pair(&ends, edge) else { return Ok(None) };
    if pairing.n_open > pairing.pairs.len() {
        return Ok(None);
    }
    let mut division = Division::new(rim);
    for pair in &pairing.pairs {
        if !division.cut(pair, edge) {
            return Ok(None);
        }
    }
    let is_curved = pairing.pairs.iter().any(|pair| !pair.joint.is_straight);
    let filled = division.fill(sizes, progress)?;
    Ok(filled.map(|(triangulation, is_relief)| DividedFill {
        triangulation,
        is_clear: pairing.n_open == 0 && is_curved || is_relief.contains(&true),
        is_relief,
    }))
}

/// A vertex on the boundary of a part of a hole.
#[derive(Clone, Copy)]
struct Corner {
    /// The index of the vertex: first those of the rim, then those of the curves.
    vertex: u32,
    /// True if the edge to the next corner is on a crease.
    is_crease: bool,
    /// The normal of the part's surface at the crease; zero for a corner that is on no crease.
    normal: Vector3<f64>,
    /// If the corner is the end of a crease, the next vertex of the crease in the data.
    behind: Option<Point3<f64>>,
}

/// A hole divided into parts by curves.
struct Division<'a> {
    rim: &'a Rim,
    /// The points of the rim, then those of the curves.
    points: Vec<Point3<f64>>,
    parts: Vec<Vec<Corner>>,
}

impl<'a> Division<'a> {
    fn new(rim: &'a Rim) -> Self {
        let corners = (0..rim.len() as u32).map(|vertex| Corner {
            vertex,
            is_crease: false,
            normal: Vector3::zeros(),
            behind: None,
        });
        Self { rim, points: rim.points.clone(), parts: vec![corners.collect()] }
    }

    fn position(&self, corner: &Corner) -> Point3<f64> {
        self.points[corner.vertex as usize]
    }

    /// Divides a part by a curve. Returns false if the curve does not begin and end in one part or leaves no room for a vertex.
    fn cut(&mut self, pair: &Pair, edge: f64) -> bool {
        fn index_of(part: &[Corner], vertex: usize) -> Option<usize> {
            part.iter().position(|corner| {
                corner.vertex as usize == vertex && corner.behind.is_none() && !corner.is_crease
            })
        }
        let found = self.parts.iter().enumerate().find_map(|(number, part)| {
            Some((number, index_of(part, pair.rim[0])?, index_of(part, pair.rim[1])?))
        });
        let Some((number, from, to)) = found else { return false };
        let mut part = self.parts.swap_remove(number);
        // The curve runs from corner 0 to corner `to`. The first side has the corners up to `to`, the second one the others.
        part.rotate_left(from);
        let count = part.len();
        let to = (to + count - from) % count;
        let reversed: Vec<Point3<f64>> = pair.joint.points.iter().rev().copied().collect();
        let runs = [
            self.run(&part, [0, to], &pair.joint.points, edge),
            self.run(&part, [to, 0], &reversed, edge),
        ];
        let Some(stop) = pair.joint.points.len().checked_sub(1 + runs[1].passed) else {
            return false;
        };
        let inner = runs[0].passed + 1..stop;
        let ends = [0, 1].map(|k| ([0, to][k] as isize + runs[k].steps).rem_euclid(count as isize));
        if inner.is_empty() {
            return false;
        }
        let first_vertex = self.points.len() as u32;
        self.points.extend(&pair.joint.points[inner.clone()]);
        for side in [0, 1] {
            // On each side, the rim leads from the end `start` to the end `1 - start`, and the curve back.
            let (start, normals) = (side, &pair.joint.normals[side]);
            let length = (ends[1 - start] - ends[start]).rem_euclid(count as isize) as usize;
            let mut corners: Vec<Corner> =
                (0..=length).map(|k| part[(ends[start] as usize + k) % count]).collect();
            // A negative run at the start and a positive run at the end are on this side.
            let run_start = (-runs[start].steps).max(0) as usize;
            let run_stop = runs[1 - start].steps.max(0) as usize;
            if run_start + run_stop >= length {
                return false;
            }
            let behind = |k: usize, own_sign: isize| {
                let steps = runs[k].steps * own_sign;
                let beside = (ends[k] - runs[k].steps.signum()).rem_euclid(count as isize);
                if steps > 0 { self.position(&part[beside as usize]) } else { pair.behind[k] }
            };
            fn normal_at(k: usize, normals: &[Vector3<f64>]) -> Vector3<f64> {
                if k == 0 { normals[0] } else { normals[normals.len() - 1] }
            }
            for corner in &mut corners[..run_start] {
                corner.is_crease = true;
            }
            for corner in &mut corners[..=run_start] {
                corner.normal = normal_at(start, normals);
            }
            for corner in &mut corners[length - run_stop..] {
                corner.is_crease = true;
                corner.normal = normal_at(1 - start, normals);
            }
            corners[run_start].behind = Some(behind(start, 1));
            corners[length - run_stop].behind = Some(behind(1 - start, -1));
            let mut curve: Vec<Corner> = (first_vertex..)
                .zip(inner.clone())
                .map(|(vertex, k)| Corner {
                    vertex,
                    is_crease: true,
                    normal: normals[k],
                    behind: None,
                })
                .collect();
            if side == 0 {
                curve.reverse();
            }
            corners.extend(curve);
            self.parts.push(corners);
        }
        true
    }

    /// Follows the rim from the corner `from` as long as it runs along the crease.
    fn run(
        &self,
        part: &[Corner],
        [from, to]: [usize; 2],
        curve: &[Point3<f64>],
        edge: f64,
    ) -> Run {
        let count = part.len();
        let mut longest = Run { steps: 0, passed: 0 };
        for sign in [1, -1] {
            let mut run = Run { steps: 0, passed: 0 };
            loop {
                let next = run.steps + sign;
                let corner = (from as isize + next).rem_euclid(count as isize) as usize;
                if corner == to || corner == from || part[corner].is_crease {
                    break;
                }
                let (nearest, distance) = nearest_segment(curve, self.position(&part[corner]));
                if distance > ALONG * edge || nearest < run.passed {
                    break;
                }
                run = Run { steps: next, passed: nearest };
            }
            if run.steps.abs() > longest.steps.abs() {
                longest = run;
            }
        }
        longest
    }

    /// Fills all parts. Returns `None` if a part cannot be filled.
    fn fill(
        &self,
        sizes: &Sizes,
        progress: &Progress<'_>,
    ) -> Result<Option<(Triangulation, Vec<bool>)>, RefineError> {
        let (mut points, mut faces) = (self.points.clone(), Vec::new());
        // The edges between vertices of the rim and the curves that parts have used.
        let mut used: Vec<[u32; 2]> = Vec::new();
        let mut is_relief = vec![false; points.len()];
        for part in &self.parts {
            progress.check()?;
            if part.len() < 3 {
                return Ok(None);
            }
            let PartRim { rim, data_bend } = self.part_rim(part, sizes, &used);
            let mut triangulation = min_weight_or_fan(&rim);
            sizes.check(&triangulation)?;
            let start = triangulation.clone();
            plate(&mut triangulation, &rim, sizes, progress)?;
            if goes_too_far(&triangulation, &rim) {
                triangulation = start;
                membrane(&mut triangulation, &rim, sizes, progress)?;
            }
            let (own, kept) = triangulation.compact();
            let first = points.len() as u32;
            points.extend(kept[part.len()..].iter().map(|&v| triangulation.points[v as usize]));
            is_relief.resize(points.len(), data_bend > MIN_RELIEF_BEND);
            for face in own.iter().map(|face| {
                face.map(|vertex: u32| match part.get(vertex as usize) {
                    Some(corner) => corner.vertex,
                    None => first + vertex - part.len() as u32,
                })
            }) {
                let sides = [[face[0], face[1]], [face[1], face[2]], [face[2], face[0]]];
                used.extend(
                    sides.iter().map(|&[a, b]| [a.min(b), a.max(b)]).filter(|s| s[1] < first),
                );
                faces.push(face);
            }
            used.sort_unstable();
            used.dedup();
        }
        Ok(Some((Triangulation::new(points, self.rim.len(), &faces), is_relief)))
    }

    /// Returns a part as a hole of its own: the surface around it is that of the data on its own side, and strips beyond the creases.
    fn part_rim(&self, part: &[Corner], sizes: &Sizes, used: &[[u32; 2]]) -> PartRim {
        let count = part.len();
        let data = self.rim.len();
        let points: Vec<Point3<f64>> = part.iter().map(|corner| self.position(corner)).collect();
        let lengths: Vec<f64> = part
            .iter()
            .zip(&points)
            .map(|(corner, &point)| {
                let known = self.rim.lengths.get(corner.vertex as usize);
                known.copied().unwrap_or_else(|| sizes.length_at(point))
            })
            .collect();
        let normals = (0..count).map(|k| match part[k].is_crease {
            true => edge_normal(part[k].normal, part[(k + 1) % count].normal),
            false => self.rim.normals[part[k].vertex as usize],
        });
        let connected = (0..count).map(|k| {
            (0..count)
                .filter(|&other| {
                    let [a, b] = [part[k].vertex, part[other].vertex];
                    let is_beside = (k + 1) % count == other || (other + 1) % count == k;
                    let is_used = used.binary_search(&[a.min(b), a.max(b)]).is_ok();
                    let on_rim = (a.max(b) as usize) < data;
                    !is_beside && other != k && (is_used || on_rim && self.is_rim_edge(a, b))
                })
                .map(|other| other as u32)
                .collect()
        });
        let mut rim = Rim {
            vertices: part.iter().map(|corner| corner.vertex).collect(),
            normals: normals.collect(),
            connected: connected.collect(),
            lengths,
            ring: Vec::new(),
            triangles: Vec::new(),
            points,
        };
        self.add_data(part, &mut rim);
        let data_bend = mean_bend(&rim);
        add_strips(part, &mut rim);
        PartRim { rim, data_bend }
    }

    /// Returns true if two rim vertices are neighbors on the rim, or are or may become connected outside of the hole.
    fn is_rim_edge(&self, a: u32, b: u32) -> bool {
        let count = self.rim.len() as u32;
        (a + 1) % count == b || (b + 1) % count == a || self.rim.is_taken(a as usize, b as usize)
    }

    /// Adds the triangles of the data on the part's side.
    fn add_data(&self, part: &[Corner], rim: &mut Rim) {
        let (count, data) = (part.len(), self.rim.len());
        let mut is_own = vec![false; self.rim.triangles.len()];
        for (k, corner) in part.iter().enumerate() {
            if corner.vertex as usize >= data {
                continue;
            }
            let previous = &part[(k + count - 1) % count];
            if !corner.is_crease && !previous.is_crease {
                for (own, face) in is_own.iter_mut().zip(&self.rim.triangles) {
                    *own |= face.contains(&corner.vertex);
                }
            } else if let Some(behind) = corner.behind {
                let next = part[(k + 1) % count].vertex;
                let neighbor = if corner.is_crease { previous.vertex } else { next };
                self.add_fan([corner.vertex, neighbor], !corner.is_crease, behind, &mut is_own);
            }
        }
        let mut indices = vec![u32::MAX; data + self.rim.ring.len()];
        for (k, corner) in (0..).zip(part).filter(|(_, corner)| (corner.vertex as usize) < data) {
            indices[corner.vertex as usize] = k;
        }
        for (face, _) in self.rim.triangles.iter().zip(is_own).filter(|(_, is_own)| *is_own) {
            rim.triangles.push(face.map(|vertex| {
                let index = &mut indices[vertex as usize];
                if *index == u32::MAX {
                    *index = (count + rim.ring.len()) as u32;
                    rim.ring.push(self.data_point(vertex));
                }
                *index
            }));
        }
    }

    fn data_point(&self, index: u32) -> Point3<f64> {
        match self.rim.points.get(index as usize) {
            Some(point) => *point,
            None => self.rim.ring[index as usize - self.rim.len()],
        }
    }

    /// Marks the triangles around a rim vertex from its neighbor on the rim to the vertex at `behind`. `forward` is true if the neighbor is
    /// the next vertex of the rim.
    fn add_fan(
        &self,
        [vertex, neighbor]: [u32; 2],
        forward: bool,
        behind: Point3<f64>,
        is_own: &mut [bool],
    ) {
        let mut spoke = neighbor;
        loop {
            let side = if forward { [spoke, vertex] } else { [vertex, spoke] };
            let found = self.rim.triangles.iter().enumerate().find_map(|(index, face)| {
                let k = (0..3).find(|&k| [face[k], face[(k + 1) % 3]] == side)?;
                Some((index, face[(k + 2) % 3]))
            });
            match found {
                Some((index, next)) if !is_own[index] || next != neighbor => {
                    is_own[index] = true;
                    spoke = next;
                }
                _ => return,
            }
            if self.data_point(spoke) == behind || spoke == neighbor {
                return;
            }
        }
    }
}

/// A part as a hole of its own.
struct PartRim {
    rim: Rim,
    /// The mean angle between adjacent triangles of the data at the rim, in radians.
    data_bend: f64,
}

/// Returns the mean angle between adjacent triangles around a hole, in radians; 0 if there are none.
fn mean_bend(rim: &Rim) -> f64 {
    let areas = areas_around(rim);
    let bends = adjacent_faces(&rim.triangles).into_iter().map(|pair| {
        let [a, b] = pair.map(|face| areas[face as usize]);
        libm::atan2(a.cross(&b).norm(), a.dot(&b))
    });
    let (sum, count) = bends.fold((0.0, 0.0), |(sum, count), bend| (sum + bend, count + 1.0));
    if count > 0.0 { sum / count } else { 0.0 }
}

/// The part of a rim that runs along a crease.
#[derive(Clone, Copy)]
struct Run {
    /// The number of corners; negative if the rim leads to them backward.
    steps: isize,
    /// The number of the curve's segments that the run has passed.
    passed: usize,
}

/// Returns the segment of a polyline that is nearest to a point, and its distance.
fn nearest_segment(curve: &[Point3<f64>], point: Point3<f64>) -> (usize, f64) {
    let distances = curve.windows(2).map(|ends| {
        let (along, offset) = (ends[1] - ends[0], point - ends[0]);
        let fraction =
            (along.dot(&offset) / along.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        (offset - along * fraction).norm()
    });
    let nearest = distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
    nearest.unwrap_or((0, f64::INFINITY))
}

fn edge_normal(a: Vector3<f64>, b: Vector3<f64>) -> Vector3<f64> {
    (a + b).try_normalize(0.0).unwrap_or_default()
}

/// Adds strips of triangles beyond the creases, which continue the surface of the part.
fn add_strips(part: &[Corner], rim: &mut Rim) {
    let count = part.len();
    // The outward vectors at the corners of creases, each with the index of its end.
    let mut beyond = vec![None; count];
    for k in 0..count {
        let (before, after) = ((k + count - 1) % count, (k + 1) % count);
        let along = [(before, k), (k, after)].into_iter().filter(|&(from, _)| part[from].is_crease);
        let sum: Vector3<f64> =
            along.map(|(from, to)| (rim.points[to] - rim.points[from]).normalize()).sum();
        let outward = sum.cross(&part[k].normal).try_normalize(1e-6);
        if let Some(outward) = outward.filter(|_| part[k].is_crease || part[before].is_crease) {
            beyond[k] = Some((count + rim.ring.len()) as u32);
            rim.ring.push(rim.points[k] + outward * rim.lengths[k]);
        }
    }
    for k in 0..count {
        let after = (k + 1) % count;
        if let (true, Some(a), Some(b)) = (part[k].is_crease, beyond[k], beyond[after]) {
            rim.triangles.extend([[after as u32, k as u32, a], [after as u32, a, b]]);
        }
        if let (Some(behind), Some(own)) = (part[k].behind, beyond[k]) {
            // Close the gap between the data's crease and the strip.
            let position = rim.ring.iter().position(|point| *point == behind);
            let index = match rim.points.iter().position(|point| *point == behind) {
                Some(index) => index as u32,
                None => match position {
                    Some(index) => (count + index) as u32,
                    None => continue,
                },
            };
            let k = k as u32;
            let is_start = part[k as usize].is_crease;
            rim.triangles.push(if is_start { [k, index, own] } else { [k, own, index] });
        }
    }
}
