//! Divides the surface around a hole into the largest regions that fit a plane or a paraboloid.
//!
//! Dihedral angles alone find creases only if faces are about equal in size and shape. Noise makes gaps in creases, and unrelated regions
//! would grow together through these gaps. So this module does not classify single edges: it merges small flat pieces, the best fitting
//! pair first, as long as one surface fits both. A smooth surface is divided too, but its segments meet without an angle, unlike the facets
//! of a creased surface.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Point3, Vector3};

use super::chart::Chart;
use crate::triangles::triangulation::NONE;

/// Cosine of the maximum angle, 12 degrees, between a face and the flat piece to which it is added.
const FLAT_COSINE: f64 = 0.9781476007338057;

/// Maximum misfit of the smaller of two merged segments to their common surface, as a multiple of the maximum misfit of both segments
/// together. Without this limit, a large segment would absorb small ones that do not fit.
const MAX_SMALLER_MISFIT: f64 = 1.5;

/// The band of faces around a hole.
pub(crate) struct Band<'a> {
    pub(crate) points: &'a [Point3<f64>],
    pub(crate) faces: &'a [[u32; 3]],
    /// For each face, its normal with twice its area as length.
    pub(crate) areas: &'a [Vector3<f64>],
    /// Smoothed unit normals of the faces.
    pub(crate) normals: &'a [Vector3<f64>],
    /// The pairs of faces that share an edge.
    pub(crate) neighbors: &'a [[u32; 2]],
}

/// Returns the segment number of each face. `tolerance` is the maximum root mean square distance of a segment's vertices from the plane or
/// paraboloid fitted to them.
pub(crate) fn segment(band: &Band<'_>, tolerance: f64) -> Vec<u32> {
    let mut numbers = pieces(band);
    let mut faces: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (face, &segment) in (0..).zip(&numbers) {
        faces.entry(segment).or_default().push(face);
    }
    let segments =
        faces.into_iter().map(|(segment, faces)| (segment, band.segment(faces))).collect();
    let mut merging = Merging { band, tolerance, segments, queue: BTreeSet::new() };
    for [a, b] in band.neighbors.iter().map(|pair| pair.map(|face| numbers[face as usize])) {
        if a != b && !merging.segments[&a].adjacent.contains_key(&b) {
            merging.compare(a, b);
        }
    }
    while let Some((_, [to, from])) = merging.queue.pop_first() {
        merging.merge(to, from);
    }
    for (&segment, own) in &merging.segments {
        own.faces.iter().for_each(|&face| numbers[face as usize] = segment);
    }
    numbers
}

/// Connected faces that fit one plane or paraboloid.
struct Segment {
    faces: Vec<u32>,
    vertices: Vec<Point3<f64>>,
    area: Vector3<f64>,
    /// The adjacent segments, each with the misfit of one surface fitted to both segments; infinite if that misfit is too large.
    adjacent: BTreeMap<u32, f64>,
}

/// The segments, keyed by number, and a queue of the pairs that can be merged.
struct Merging<'a> {
    band: &'a Band<'a>,
    tolerance: f64,
    segments: BTreeMap<u32, Segment>,
    /// The pairs of segments, best fit first. A misfit is stored as the bits of its `f64`: for nonnegative numbers, bits sort in the order
    /// of the numbers.
    queue: BTreeSet<(u64, [u32; 2])>,
}

impl Merging<'_> {
    /// Computes how well one surface fits two segments together, and queues the pair if the misfit is finite.
    fn compare(&mut self, a: u32, b: u32) {
        let misfit = misfit(&self.segments[&a], &self.segments[&b], self.tolerance);
        for [segment, other] in [[a, b], [b, a]] {
            if let Some(segment) = self.segments.get_mut(&segment) {
                segment.adjacent.insert(other, misfit);
            }
        }
        if misfit.is_finite() {
            self.queue.insert((misfit.to_bits(), [a.min(b), a.max(b)]));
        }
    }

    /// Merges the segment `from` into `to`.
    fn merge(&mut self, to: u32, from: u32) {
        let mut others = BTreeSet::new();
        let mut faces = Vec::new();
        for own in [to, from] {
            let Some(segment) = self.segments.remove(&own) else { continue };
            faces.extend(segment.faces);
            for (other, misfit) in segment.adjacent {
                self.queue.remove(&(misfit.to_bits(), [own.min(other), own.max(other)]));
                if let Some(other) = self.segments.get_mut(&other) {
                    other.adjacent.remove(&own);
                }
                others.insert(other);
            }
        }
        self.segments.insert(to, self.band.segment(faces));
        for other in others.into_iter().filter(|&segment| segment != to && segment != from) {
            self.compare(to, other);
        }
    }
}

/// Finds flat pieces by region growing. Each seed is the face, among those not yet assigned, whose normal differs least from its neighbors'
/// normals.
fn pieces(band: &Band<'_>) -> Vec<u32> {
    let mut beside: Vec<Vec<u32>> = vec![Vec::new(); band.faces.len()];
    for &[a, b] in band.neighbors {
        beside[a as usize].push(b);
        beside[b as usize].push(a);
    }
    // Sort the faces by the minimum cosine of the angles between a face and its neighbors.
    let mut seeds: Vec<(f64, u32)> = (0..)
        .zip(&beside)
        .map(|(face, others)| {
            let cosines = others
                .iter()
                .map(|&other| band.normals[face as usize].dot(&band.normals[other as usize]));
            (cosines.fold(f64::INFINITY, f64::min), face)
        })
        .collect();
    seeds.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut pieces = vec![NONE; band.faces.len()];
    for (_, seed) in seeds {
        if pieces[seed as usize] != NONE {
            continue;
        }
        pieces[seed as usize] = seed;
        let (mut sum, mut queue, mut next) = (band.normals[seed as usize], vec![seed], 0);
        while let Some(&face) = queue.get(next) {
            next += 1;
            for &other in &beside[face as usize] {
                let is_free = pieces[other as usize] == NONE;
                let normal = band.normals[other as usize];
                if is_free && normal.dot(&sum) > FLAT_COSINE * sum.norm() {
                    pieces[other as usize] = seed;
                    sum += normal;
                    queue.push(other);
                }
            }
        }
    }
    pieces
}

impl Band<'_> {
    fn segment(&self, faces: Vec<u32>) -> Segment {
        let corners = faces.iter().flat_map(|&face| self.faces[face as usize]);
        let mut vertices: Vec<u32> = corners.collect();
        vertices.sort_unstable();
        vertices.dedup();
        let area = faces.iter().map(|&face| self.areas[face as usize]).sum();
        let vertices = vertices.into_iter().map(|vertex| self.points[vertex as usize]).collect();
        Segment { faces, vertices, area, adjacent: BTreeMap::new() }
    }
}

/// Returns the root mean square distance of the vertices of two segments from the surface fitted to both; infinite if it exceeds the
/// tolerance.
fn misfit(a: &Segment, b: &Segment, tolerance: f64) -> f64 {
    let both = [&a.vertices[..], &b.vertices[..]].concat();
    let chart = (a.area + b.area)
        .try_normalize(0.0)
        .and_then(|normal| Chart::fit(&both, normal, tolerance));
    let Some(chart) = chart else { return f64::INFINITY };
    let smaller = if a.vertices.len() < b.vertices.len() { a } else { b };
    if chart.misfit(&smaller.vertices) > MAX_SMALLER_MISFIT * tolerance {
        return f64::INFINITY;
    }
    chart.misfit(&both)
}
