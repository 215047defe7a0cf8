//! The smooth segments of the surface around a hole, which meet in creases. Each segment is approximated by a simple surface, which is
//! extrapolated into the hole.

use maquette_base::topology::union_find::UnionFind;
use nalgebra::{Point3, Vector3};

use super::chart::Chart;
use super::round_chart::Samples;
use super::segmentation::{Band, segment};
use crate::border::rim::Rim;
use crate::triangles::filling::Filling;
use crate::triangles::triangulation::{NONE, area_vector};

/// Number of rows of faces around the hole that are divided into segments. With fewer rows, creases or planes are found by chance. With
/// more, a plane is not recognized if it bends farther from the hole.
const ROWS: usize = 6;

/// Cosines of the crease angles to try in turn: 25, 17 and 11 degrees. An edge whose faces meet at a larger angle is a crease. With smaller
/// angles, the facets of a curved scan would count as segments; with larger ones, the corners of bevels are missed. If noise makes a gap in
/// a crease, the segments on its two sides are joined and no common surface fits them; then the next angle is tried.
const SHARP_COSINES: [f64; 3] = [0.9063077870366499, 0.9563047559630354, 0.981627183447664];

/// Cosine of the minimum angle, 20 degrees, between two segments found by surface fitting that meet in a crease. Paraboloids fitted to
/// parts of one smooth surface meet at smaller angles.
const FACET_COSINE: f64 = 0.9396926207859084;

/// Minimum number of edges that a segment must have on the hole's rim; smaller segments are ignored.
const MIN_EDGES: usize = 3;

/// Minimum area of a face divided by the mean face area; smaller faces belong to no segment.
const MIN_AREA: f64 = 0.15;

/// Maximum root mean square distance of a segment's vertices from the segment's surface, as a multiple of the mean edge length at the
/// hole's rim.
const MAX_MISFIT: f64 = 0.12;

/// Maximum distance of a rim vertex from the surface of its segment, in edge lengths. A ridge or groove between two segments, which is
/// narrower than [`MIN_EDGES`], is farther away: it is no crease.
const MAX_RIM_MISFIT: f64 = 0.36;

/// Minimum ratio of the mean bending at edges between segments to the mean bending at edges inside segments. Both are measured on smoothed
/// normals.
const MIN_BEND_RATIO: f64 = 4.0;

/// Maximum number of segments: a set of segments is stored in the bits of a `u32`.
const MAX_SEGMENTS: usize = 32;

/// The way in which the smooth segments around a hole meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum CreaseKind {
    /// Segments meet like the faces of a cube seen from outside.
    Convex,
    /// Segments meet like the walls of a room seen from inside.
    Concave,
    /// Some pairs of segments meet convexly, others concavely.
    Mixed,
}

/// The smooth segments of the surface around a hole.
pub(crate) struct Charts {
    pub(crate) charts: Vec<Chart>,
    /// For each vertex of the hole's rim, the set of segments that contain it, one bit per segment.
    pub(crate) rim_sets: Vec<u32>,
    pub(crate) kind: CreaseKind,
}

impl Charts {
    /// Divides the surface around a hole into smooth segments. Returns `None` if there are fewer than two segments, or if they do not
    /// contain the whole rim.
    pub(crate) fn find(filling: &Filling, rim: &Rim) -> Option<Self> {
        let faces = rim_band(filling, rim);
        let areas: Vec<Vector3<f64>> =
            faces.iter().map(|&face| area_vector(filling.corners(face))).collect();
        let mean = areas.iter().map(|area| area.norm()).sum::<f64>() / areas.len() as f64;
        // Leave out tiny faces: noise gives them arbitrary normals, which would connect unrelated segments.
        let mut neighbors = adjacent_faces(&faces);
        neighbors
            .retain(|pair| pair.iter().all(|face| areas[*face as usize].norm() > MIN_AREA * mean));
        let normals = smooth_normals(&areas, &neighbors);
        let even = SHARP_COSINES.iter().find_map(|&sharp| {
            let segments = smooth_segments(&normals, &neighbors, sharp);
            let found = Self::from_segments(filling, rim, &faces, &segments);
            found.filter(|_| bend_in_creases(&segments, &normals, &neighbors))
        });
        even.or_else(|| {
            let points = &filling.points;
            let band = Band {
                points,
                faces: &faces,
                areas: &areas,
                normals: &normals,
                neighbors: &neighbors,
            };
            let edge = rim.lengths.iter().sum::<f64>() / rim.len() as f64;
            let segments = segment(&band, MAX_MISFIT * edge);
            let found = Self::from_segments(filling, rim, &faces, &segments);
            let found = found.filter(|charts| charts.are_facets(rim));
            found.filter(|_| bend_in_creases(&segments, &normals, &neighbors))
        })
    }

    /// Returns true if, at every rim vertex where segments meet, they meet at an angle of more than 20 degrees.
    fn are_facets(&self, rim: &Rim) -> bool {
        (0..rim.len()).filter(|&k| self.rim_sets[k].count_ones() == 2).all(|k| {
            let set = self.rim_sets[k];
            let [a, b] = [set.trailing_zeros(), 31 - set.leading_zeros()]
                .map(|chart| self.charts[chart as usize].distance(rim.points[k]).1);
            a.dot(&b) < FACET_COSINE
        })
    }

    fn from_segments(
        filling: &Filling,
        rim: &Rim,
        faces: &[[u32; 3]],
        segments: &[u32],
    ) -> Option<Self> {
        // List all sides of faces, each with the segment of the face, to look up the rim's edges.
        let mut edges: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * faces.len());
        for (face, &segment) in faces.iter().zip(segments) {
            edges.extend((0..3).map(|k| ([face[k], face[(k + 1) % 3]], segment)));
        }
        edges.sort_unstable();
        let count = rim.len();
        let of_edges: Vec<u32> = (0..count)
            .map(|k: usize| {
                let ends = [rim.vertices[(k + 1) % count], rim.vertices[k]];
                edges
                    .binary_search_by_key(&ends, |edge| edge.0)
                    .map_or(NONE, |found| edges[found].1)
            })
            .collect();
        let mut known: Vec<u32> = of_edges.clone();
        known.sort_unstable();
        known.dedup();
        known.retain(|&segment| {
            of_edges.iter().filter(|&&other| other == segment).count() >= MIN_EDGES
        });
        if known.len() < 2 || known.len() > MAX_SEGMENTS || known.contains(&NONE) {
            return None;
        }
        let edge = rim.lengths.iter().sum::<f64>() / count as f64;
        let mut members: Vec<Vec<Point3<f64>>> = Vec::new();
        let mut charts = Vec::new();
        for &segment in &known {
            let members_of_segment =
                faces.iter().zip(segments).filter(|(_, other)| **other == segment);
            let own: Vec<[u32; 3]> = members_of_segment.map(|(face, _)| *face).collect();
            let samples = samples(filling, &own);
            charts.push(Chart::fit_best(&samples, edge, MAX_MISFIT * edge)?);
            members.push(samples.points);
        }
        let numbers: Vec<Option<usize>> =
            of_edges.iter().map(|segment| known.binary_search(segment).ok()).collect();
        let rim_sets = (0..count).map(|k| {
            let near = [numbers[(k + count - 1) % count], numbers[k]];
            near.iter().flatten().fold(0, |set, &number| set | 1 << number)
        });
        let mut rim_sets: Vec<u32> = rim_sets.collect();
        fill_gaps(&mut rim_sets);
        follow_creases(&mut rim_sets, &charts, &rim.points, MAX_MISFIT * edge);
        let is_on_segment = rim_sets.iter().zip(&rim.points).all(|(set, &point)| {
            let own = charts.iter().enumerate().filter(|(number, _)| set >> number & 1 == 1);
            own.map(|(_, chart)| chart.distance(point).0.abs())
                .any(|off| off <= MAX_RIM_MISFIT * edge)
        });
        if !is_on_segment {
            return None;
        }
        Some(Self { kind: crease_kind(&charts, &members), charts, rim_sets })
    }
}

/// Returns the vertices, the centers and the area vectors of faces.
fn samples(filling: &Filling, faces: &[[u32; 3]]) -> Samples {
    let mut vertices: Vec<u32> = faces.as_flattened().to_vec();
    vertices.sort_unstable();
    vertices.dedup();
    let corners = faces.iter().map(|&face| filling.corners(face));
    Samples {
        points: vertices.into_iter().map(|vertex| filling.point(vertex)).collect(),
        centers: corners
            .clone()
            .map(|[a, b, c]| Point3::from((a.coords + b.coords + c.coords) / 3.0))
            .collect(),
        areas: corners.map(area_vector).collect(),
    }
}

/// Gives each rim vertex without a segment the set of segments of the preceding rim vertex.
fn fill_gaps(sets: &mut [u32]) {
    let Some(start) = sets.iter().position(|&set| set != 0) else { return };
    for k in 1..=sets.len() {
        let (before, at) = ((start + k - 1) % sets.len(), (start + k) % sets.len());
        if sets[at] == 0 {
            sets[at] = sets[before];
        }
    }
}

/// Adds segments to rim vertices next to a crease. If the rim runs along a crease, the input faces at a rim vertex may belong to only one
/// of the two segments that meet in the crease; the fill continues the other segment. So a rim vertex next to a vertex of both segments is
/// added to both, if it is within `tolerance` of both surfaces.
fn follow_creases(sets: &mut [u32], charts: &[Chart], points: &[Point3<f64>], tolerance: f64) {
    let count = sets.len();
    let forth = (0..2 * count).map(|k| (k % count, (k + 1) % count));
    let back = (0..2 * count).rev().map(|k| ((k + 1) % count, k % count));
    for (from, to) in forth.chain(back) {
        if sets[from].count_ones() < 2 || sets[from] & sets[to] == 0 {
            continue;
        }
        for (number, chart) in charts.iter().enumerate() {
            let is_new = sets[from] & !sets[to] & 1 << number != 0;
            if is_new && chart.distance(points[to]).0.abs() <= tolerance {
                sets[to] |= 1 << number;
            }
        }
    }
}

/// Returns the input faces within [`ROWS`] rows around the rim of a hole.
fn rim_band(filling: &Filling, rim: &Rim) -> Vec<[u32; 3]> {
    let mut is_near = vec![false; filling.n_data_vertices];
    rim.vertices.iter().for_each(|&vertex| is_near[vertex as usize] = true);
    let mut faces = Vec::new();
    for _ in 0..ROWS {
        faces = filling.faces[..filling.n_data_faces]
            .iter()
            .filter(|face| face.iter().any(|&vertex| is_near[vertex as usize]))
            .copied()
            .collect();
        faces.as_flattened().iter().for_each(|&vertex| is_near[vertex as usize] = true);
    }
    faces
}

/// Returns the pairs of faces that share an edge.
pub(super) fn adjacent_faces(faces: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let mut edges: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * faces.len());
    for (index, face) in (0..).zip(faces) {
        for k in 0..3 {
            let (a, b) = (face[k], face[(k + 1) % 3]);
            edges.push(([a.min(b), a.max(b)], index));
        }
    }
    edges.sort_unstable();
    let pairs = edges.windows(2).filter(|pair| pair[0].0 == pair[1].0);
    pairs.map(|pair| [pair[0].1, pair[1].1]).collect()
}

/// Number of smoothing steps applied to face normals. With 5 steps, faces up to a few rows away contribute to each normal.
const SMOOTHING_STEPS: usize = 5;

/// Standard deviation of the Gaussian weight of one face normal in the mean at another, as length of the difference of the two normals:
/// about 12 degrees. Differences caused by noise are smaller, those at creases are larger.
const NORMAL_DIFFERENCE: f64 = 0.2;

/// Removes noise from face normals but keeps creases: each normal becomes the weighted mean of similar normals of adjacent faces.
///
/// Jones, Durand and Desbrun, "Non-iterative, feature-preserving mesh smoothing" (2003), applied to normals only.
pub(super) fn smooth_normals(areas: &[Vector3<f64>], neighbors: &[[u32; 2]]) -> Vec<Vector3<f64>> {
    fn unit(area: &Vector3<f64>) -> Vector3<f64> {
        area.try_normalize(0.0).unwrap_or_default()
    }
    let mut normals: Vec<Vector3<f64>> = areas.iter().map(unit).collect();
    for _ in 0..SMOOTHING_STEPS {
        let mut sums = normals.clone();
        for &[a, b] in neighbors {
            let [of_a, of_b] = [a, b].map(|face| normals[face as usize]);
            let exponent =
                (of_a - of_b).norm_squared() / (2.0 * NORMAL_DIFFERENCE * NORMAL_DIFFERENCE);
            let weight = libm::exp(-exponent);
            sums[a as usize] += of_b * weight;
            sums[b as usize] += of_a * weight;
        }
        normals = sums.iter().map(unit).collect();
    }
    normals
}

/// Returns the segment number of each face. Adjacent faces are in the same smooth segment if the cosine of their angle exceeds `sharp`.
fn smooth_segments(normals: &[Vector3<f64>], neighbors: &[[u32; 2]], sharp: f64) -> Vec<u32> {
    let mut segments = UnionFind::new(normals.len());
    for &[a, b] in neighbors {
        if normals[a as usize].dot(&normals[b as usize]) > sharp {
            segments.union(a, b);
        }
    }
    (0..normals.len() as u32).map(|face| segments.find(face)).collect()
}

/// Returns true if the surface bends much more between segments than inside them. This excludes reliefs: paraboloids fit their bumps too,
/// but a relief bends everywhere.
fn bend_in_creases(segments: &[u32], normals: &[Vector3<f64>], neighbors: &[[u32; 2]]) -> bool {
    let (mut within, mut between) = ((0.0, 0.0), (0.0, 0.0));
    for &[a, b] in neighbors {
        let [m, n] = [a, b].map(|face| normals[face as usize]);
        let sum =
            if segments[a as usize] == segments[b as usize] { &mut within } else { &mut between };
        sum.0 += libm::atan2(m.cross(&n).norm(), m.dot(&n));
        sum.1 += 1.0;
    }
    between.1 == 0.0 || MIN_BEND_RATIO * within.0 * between.1 < between.0 * within.1
}

/// Returns the way in which segments meet: convexly if each segment is below the surfaces fitted to its neighbors.
fn crease_kind(charts: &[Chart], members: &[Vec<Point3<f64>>]) -> CreaseKind {
    let (mut below, mut above) = (0, 0);
    for (a, chart) in charts.iter().enumerate() {
        for (b, points) in members.iter().enumerate() {
            if a != b {
                let sum: f64 = points.iter().map(|&point| chart.distance(point).0).sum();
                *if sum < 0.0 { &mut below } else { &mut above } += 1;
            }
        }
    }
    match (below, above) {
        (_, 0) => CreaseKind::Convex,
        (0, _) => CreaseKind::Concave,
        _ => CreaseKind::Mixed,
    }
}
