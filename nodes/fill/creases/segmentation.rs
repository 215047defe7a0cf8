//! Segments the data around a hole into the largest regions that a plane or a paraboloid fits.
//!
//! Dihedral angles find creases where faces are even. Noise makes gaps in creases, through which regions that have nothing in common grow
//! together. So no single edge is judged here: small flat pieces are merged, those first that one surface fits best, as long as any do. A
//! smooth surface is divided, too, but its segments continue each other without an angle, which tells them from facets.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Point3, Vector3};

use super::chart::Chart;
use crate::triangles::triangulation::NONE;

/// Cosine of the largest angle between a face and the flat piece to which it is added: 12 degrees.
const FLAT: f64 = 0.9781476007338057;

/// How far the vertices of the smaller of two segments may be from the surface fitted to both, in the distance allowed to all: otherwise a
/// small segment would vanish in a large one.
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

/// The segment of each face, by number; `tolerance` is how far its vertices may be from its surface, as the root of the mean square.
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
        if a != b && !merging.segments[&a].beside.contains_key(&b) {
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

/// Some connected faces that one surface fits.
struct Segment {
    faces: Vec<u32>,
    vertices: Vec<Point3<f64>>,
    area: Vector3<f64>,
    /// The adjacent segments, and the misfit of each together with this one; infinite if too large.
    beside: BTreeMap<u32, f64>,
}

/// Segments by number, and the pairs of them that one surface fits.
struct Merging<'a> {
    band: &'a Band<'a>,
    tolerance: f64,
    segments: BTreeMap<u32, Segment>,
    /// Pairs by misfit, the best first. The bits of numbers that are not negative have the order of the numbers.
    queue: BTreeSet<(u64, [u32; 2])>,
}

impl Merging<'_> {
    /// Finds how well one surface fits two segments.
    fn compare(&mut self, a: u32, b: u32) {
        let misfit = misfit(&self.segments[&a], &self.segments[&b], self.tolerance);
        for [segment, other] in [[a, b], [b, a]] {
            if let Some(segment) = self.segments.get_mut(&segment) {
                segment.beside.insert(other, misfit);
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
            for (other, misfit) in segment.beside {
                self.queue.remove(&(misfit.to_bits(), [own.min(other), own.max(other)]));
                if let Some(other) = self.segments.get_mut(&other) {
                    other.beside.remove(&own);
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

/// Flat pieces by region growing: each seed is the face that is most like its neighbors, of those that are left.
fn pieces(band: &Band<'_>) -> Vec<u32> {
    let mut beside: Vec<Vec<u32>> = vec![Vec::new(); band.faces.len()];
    for &[a, b] in band.neighbors {
        beside[a as usize].push(b);
        beside[b as usize].push(a);
    }
    fn normal(face: u32, band_normals: &[Vector3<f64>]) -> Vector3<f64> {
        band_normals[face as usize]
    }
    fn bend(face: u32, beside: &[Vec<u32>], band_normals: &[Vector3<f64>]) -> f64 {
        let like = beside[face as usize]
            .iter()
            .map(|&other| normal(face, band_normals).dot(&normal(other, band_normals)));
        like.fold(f64::INFINITY, f64::min)
    }
    let mut seeds: Vec<(f64, u32)> =
        (0..band.faces.len() as u32).map(|k| (bend(k, &beside, band.normals), k)).collect();
    seeds.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut pieces = vec![NONE; band.faces.len()];
    for (_, seed) in seeds {
        if pieces[seed as usize] != NONE {
            continue;
        }
        pieces[seed as usize] = seed;
        let (mut sum, mut queue, mut next) = (normal(seed, band.normals), vec![seed], 0);
        while let Some(&face) = queue.get(next) {
            next += 1;
            for &other in &beside[face as usize] {
                let is_free = pieces[other as usize] == NONE;
                if is_free && normal(other, band.normals).dot(&sum) > FLAT * sum.norm() {
                    pieces[other as usize] = seed;
                    sum += normal(other, band.normals);
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
        Segment { faces, vertices, area, beside: BTreeMap::new() }
    }
}

/// How far the vertices of two segments are from the surface fitted to both, as the root of the mean square; infinite if too far.
fn misfit(a: &Segment, b: &Segment, tolerance: f64) -> f64 {
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
