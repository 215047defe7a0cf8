//! Cuts the data around a hole into the largest parts that a plane or a paraboloid fits.
//!
//! Creases are found by angles where faces are even. Noise makes gaps in them, through which parts run together that have nothing in
//! common. Here nothing is said of a single edge: small flat pieces are joined, those first that fit one surface best, as long as any
//! do. A smooth surface comes apart, too, but its parts go on from each other without an angle, which tells them from facets.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Point3, Vector3};

use super::chart::Chart;
use crate::fill::triangles::patch::NONE;

/// Cosine of the largest angle between a face and the flat piece that it joins: 12 degrees.
const FLAT: f64 = 0.9781476007338057;

/// How far the vertices of the smaller of two parts may be from the surface through both, in the distance allowed to all: a small part
/// would vanish in a large one otherwise.
const SMALLER: f64 = 1.5;

/// The band of data around a hole.
pub(crate) struct Band<'a> {
    pub(crate) points: &'a [Point3<f64>],
    pub(crate) faces: &'a [[u32; 3]],
    /// Twice the area of each face along its normal.
    pub(crate) areas: &'a [Vector3<f64>],
    /// Unit normals, smoothed.
    pub(crate) normals: &'a [Vector3<f64>],
    /// The pairs of faces that share an edge.
    pub(crate) neighbors: &'a [[u32; 2]],
}

/// The number of the part of each face; `tolerance` is how far vertices may be from their surface, the root of their mean square.
pub(crate) fn facets(band: &Band<'_>, tolerance: f64) -> Vec<u32> {
    let mut numbers = pieces(band);
    let mut faces: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (face, &part) in (0..).zip(&numbers) {
        faces.entry(part).or_default().push(face);
    }
    let parts = faces.into_iter().map(|(part, faces)| (part, band.part(faces))).collect();
    let mut joining = Joining { band, tolerance, parts, queue: BTreeSet::new() };
    for [a, b] in band.neighbors.iter().map(|pair| pair.map(|face| numbers[face as usize])) {
        if a != b && !joining.parts[&a].beside.contains_key(&b) {
            joining.compare(a, b);
        }
    }
    while let Some((_, [to, from])) = joining.queue.pop_first() {
        joining.join(to, from);
    }
    for (&part, own) in &joining.parts {
        own.faces.iter().for_each(|&face| numbers[face as usize] = part);
    }
    numbers
}

/// Some faces that one surface fits.
struct Part {
    faces: Vec<u32>,
    vertices: Vec<Point3<f64>>,
    area: Vector3<f64>,
    /// The parts next to it, and how far each together with it is from one surface; infinite if too far.
    beside: BTreeMap<u32, f64>,
}

/// Parts by their numbers, and the pairs of them that one surface fits.
struct Joining<'a> {
    band: &'a Band<'a>,
    tolerance: f64,
    parts: BTreeMap<u32, Part>,
    /// What fits best comes first. Bits of numbers that are not negative are in the order of the numbers.
    queue: BTreeSet<(u64, [u32; 2])>,
}

impl Joining<'_> {
    /// Finds how well two parts fit one surface.
    fn compare(&mut self, a: u32, b: u32) {
        let misfit = misfit(&self.parts[&a], &self.parts[&b], self.tolerance);
        for [part, other] in [[a, b], [b, a]] {
            if let Some(part) = self.parts.get_mut(&part) {
                part.beside.insert(other, misfit);
            }
        }
        if misfit.is_finite() {
            self.queue.insert((misfit.to_bits(), [a.min(b), a.max(b)]));
        }
    }

    /// Lets one part be a part of another.
    fn join(&mut self, to: u32, from: u32) {
        let mut others = BTreeSet::new();
        let mut faces = Vec::new();
        for own in [to, from] {
            let Some(part) = self.parts.remove(&own) else { continue };
            faces.extend(part.faces);
            for (other, misfit) in part.beside {
                self.queue.remove(&(misfit.to_bits(), [own.min(other), own.max(other)]));
                if let Some(other) = self.parts.get_mut(&other) {
                    other.beside.remove(&own);
                }
                others.insert(other);
            }
        }
        self.parts.insert(to, self.band.part(faces));
        for other in others.into_iter().filter(|&part| part != to && part != from) {
            self.compare(to, other);
        }
    }
}

/// Flat pieces: each grows around the face that is most like those next to it, of all that are left.
fn pieces(band: &Band<'_>) -> Vec<u32> {
    let mut beside: Vec<Vec<u32>> = vec![Vec::new(); band.faces.len()];
    for &[a, b] in band.neighbors {
        beside[a as usize].push(b);
        beside[b as usize].push(a);
    }
    let normal = |face: u32| band.normals[face as usize];
    let bend = |face: u32| {
        let like = beside[face as usize].iter().map(|&other| normal(face).dot(&normal(other)));
        like.fold(f64::INFINITY, f64::min)
    };
    let mut seeds: Vec<(f64, u32)> = (0..band.faces.len() as u32).map(|k| (bend(k), k)).collect();
    seeds.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut parts = vec![NONE; band.faces.len()];
    for (_, seed) in seeds {
        if parts[seed as usize] != NONE {
            continue;
        }
        parts[seed as usize] = seed;
        let (mut sum, mut queue, mut next) = (normal(seed), vec![seed], 0);
        while let Some(&face) = queue.get(next) {
            next += 1;
            for &other in &beside[face as usize] {
                let is_free = parts[other as usize] == NONE;
                if is_free && normal(other).dot(&sum) > FLAT * sum.norm() {
                    parts[other as usize] = seed;
                    sum += normal(other);
                    queue.push(other);
                }
            }
        }
    }
    parts
}

impl Band<'_> {
    fn part(&self, faces: Vec<u32>) -> Part {
        let corners = faces.iter().flat_map(|&face| self.faces[face as usize]);
        let mut vertices: Vec<u32> = corners.collect();
        vertices.sort_unstable();
        vertices.dedup();
        let area = faces.iter().map(|&face| self.areas[face as usize]).sum();
        let vertices = vertices.into_iter().map(|vertex| self.points[vertex as usize]).collect();
        Part { faces, vertices, area, beside: BTreeMap::new() }
    }
}

/// How far two parts together are from one surface; infinite if too far.
fn misfit(a: &Part, b: &Part, tolerance: f64) -> f64 {
    let both = [&a.vertices[..], &b.vertices[..]].concat();
    let chart = (a.area + b.area)
        .try_normalize(0.0)
        .and_then(|normal| Chart::fit(&both, normal, tolerance));
    let Some(chart) = chart else { return f64::INFINITY };
    let smaller = if a.vertices.len() < b.vertices.len() { a } else { b };
    if chart.misfit(&smaller.vertices) > SMALLER * tolerance {
        return f64::INFINITY;
    }
    chart.misfit(&both)
}
