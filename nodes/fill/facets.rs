//! Cuts the data around a hole into the largest parts that a plane or a paraboloid fits.
//!
//! Creases are found by angles where faces are even. Noise makes gaps in them, through which parts run together that have nothing in
//! common. Here nothing is said of a single edge: small flat pieces are joined, those first that fit one surface best, as long as any
//! do. A smooth surface comes apart, too, but its parts go on from each other without an angle, which tells them from facets.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::charts::Chart;
use super::patch::NONE;

/// Cosine of the largest angle between a face and the flat piece that it joins: 12 degrees.
const FLAT: f64 = 0.9781476007338057;

/// How far the vertices of the smaller of two parts may be from the surface through both, in the distance allowed to all: a small part
/// would vanish in a large one otherwise.
const SMALLER: f64 = 1.5;

/// The band of data around a hole.
pub(super) struct Band<'a> {
    pub(super) points: &'a [Point3<f64>],
    pub(super) faces: &'a [[u32; 3]],
    /// Twice the area of each face along its normal.
    pub(super) areas: &'a [Vector3<f64>],
    /// Unit normals, smoothed.
    pub(super) normals: &'a [Vector3<f64>],
    /// The pairs of faces that share an edge.
    pub(super) neighbors: &'a [[u32; 2]],
}

/// The number of the part of each face; `tolerance` is how far vertices may be from their surface, the root of their mean square.
pub(super) fn facets(band: &Band<'_>, tolerance: f64) -> Vec<u32> {
    let mut parts = pieces(band);
    let mut members: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (face, &part) in (0..).zip(&parts) {
        members.entry(part).or_default().push(face);
    }
    let mut fits: BTreeMap<[u32; 2], f64> = BTreeMap::new();
    for [a, b] in band.neighbors.iter().map(|pair| pair.map(|face| parts[face as usize])) {
        if a != b {
            let pair = [a.min(b), a.max(b)];
            fits.entry(pair).or_insert_with(|| band.misfit(&members[&a], &members[&b], tolerance));
        }
    }
    loop {
        let best = fits.iter().min_by(|a, b| a.1.total_cmp(b.1).then(a.0.cmp(b.0)));
        let Some((&[to, from], _)) = best.filter(|(_, misfit)| misfit.is_finite()) else { break };
        let joined = members.remove(&from).unwrap_or_default();
        joined.iter().for_each(|&face| parts[face as usize] = to);
        members.entry(to).or_default().extend(joined);
        let ends = |pair: &[u32; 2]| pair.contains(&to) || pair.contains(&from);
        let stale: Vec<[u32; 2]> = fits.keys().filter(|pair| ends(pair)).copied().collect();
        for pair in stale {
            fits.remove(&pair);
            for other in pair.into_iter().filter(|&part| part != to && part != from) {
                let misfit = || band.misfit(&members[&to], &members[&other], tolerance);
                fits.entry([to.min(other), to.max(other)]).or_insert_with(misfit);
            }
        }
    }
    parts
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
    /// How far two parts together are from one surface; infinite if too far.
    fn misfit(&self, a: &[u32], b: &[u32], tolerance: f64) -> f64 {
        let vertices = |faces: &[u32]| -> Vec<Point3<f64>> {
            let corners = faces.iter().flat_map(|&face| self.faces[face as usize]);
            let mut vertices: Vec<u32> = corners.collect();
            vertices.sort_unstable();
            vertices.dedup();
            vertices.into_iter().map(|vertex| self.points[vertex as usize]).collect()
        };
        let (of_a, of_b) = (vertices(a), vertices(b));
        let area = |faces: &[u32]| -> Vector3<f64> {
            faces.iter().map(|&face| self.areas[face as usize]).sum()
        };
        let both = [&of_a[..], &of_b[..]].concat();
        let chart = (area(a) + area(b))
            .try_normalize(0.0)
            .and_then(|normal| Chart::fit(&both, normal, tolerance));
        let Some(chart) = chart else { return f64::INFINITY };
        let smaller = if of_a.len() < of_b.len() { &of_a } else { &of_b };
        if chart.misfit(smaller) > SMALLER * tolerance {
            return f64::INFINITY;
        }
        chart.misfit(&both)
    }
}
