//! The smooth segments of the data around a hole, which meet in creases. Each is a plane or a paraboloid that continues into the hole.

use maquette_base::topology::union_find::UnionFind;
use nalgebra::{Point3, Vector3};

use super::chart::Chart;
use super::segmentation::{Band, segment};
use crate::border::rim::Rim;
use crate::triangles::filling::Filling;
use crate::triangles::triangulation::{NONE, area_vector};

/// Rows of faces around the rim that are segmented: with fewer a crease or a plane is found by chance, with more a segment that bends
/// farther out is no plane any more.
const ROWS: usize = 6;

/// Cosines of the angles between two faces from which on their edge is a crease: 25, 17 and 11 degrees. Less takes the facets of a curved
/// scan for segments, more misses the corners of bevels; where noise makes a gap in a crease, the segments beside it fit no surface
/// together, and the next angle is tried.
const SHARP: [f64; 3] = [0.9063077870366499, 0.9563047559630354, 0.981627183447664];

/// Cosine of the least angle at which segments that were found by their surfaces meet in a crease: 20 degrees. Paraboloids on a smooth
/// surface go on from each other at less.
const FACETS: f64 = 0.9396926207859084;

/// A segment counts if it has at least so many edges of the rim.
const LEAST_EDGES: usize = 3;

/// Faces smaller than this share of the mean belong to no segment.
const LEAST_AREA: f64 = 0.15;

/// How far the vertices of a segment may be from its surface: the root of the mean square, in lengths of edges.
const FIT: f64 = 0.12;

/// Segments meet in creases if the edges between them bend at least so many times as much as those within them, on the mean of smoothed
/// normals.
const TIMES: f64 = 4.0;

/// The most segments: a set of them is kept in the bits of a `u32`.
const MOST: usize = 32;

/// How the segments around a hole meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Edge {
    /// As the faces of a cube seen from outside.
    Convex,
    /// As the walls of a room seen from inside.
    Concave,
    /// In both ways.
    Mixed,
}

/// The segments around a hole.
pub(crate) struct Charts {
    pub(crate) charts: Vec<Chart>,
    /// The set of segments at each vertex of the rim, one bit each.
    pub(crate) of_rim: Vec<u32>,
    pub(crate) meeting: Edge,
}

impl Charts {
    /// Finds the segments; none unless there are at least two, which together take in the whole rim.
    pub(crate) fn around(filling: &Filling, rim: &Rim) -> Option<Self> {
        let faces = band(filling, rim);
        let areas: Vec<Vector3<f64>> = faces
            .iter()
            .map(|face| area_vector(face.map(|vertex: u32| filling.points[vertex as usize])))
            .collect();
        let mean = areas.iter().map(|area| area.norm()).sum::<f64>() / areas.len() as f64;
        // Noise gives tiny faces any normals, so that they would connect segments that have nothing in common.
        let mut neighbors = neighbors(&faces);
        neighbors.retain(|pair| {
            pair.iter().all(|face| areas[*face as usize].norm() > LEAST_AREA * mean)
        });
        let normals = smoothed(&areas, &neighbors);
        let even = SHARP.iter().find_map(|&sharp| {
            let segments = smooth_segments(&normals, &neighbors, sharp);
            let found = Self::of_segments(filling, rim, &faces, &segments);
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
            let segments = segment(&band, FIT * edge);
            let found = Self::of_segments(filling, rim, &faces, &segments);
            let found = found.filter(|charts| charts.are_facets(rim));
            found.filter(|_| bend_in_creases(&segments, &normals, &neighbors))
        })
    }

    /// Whether segments that meet at the rim do so at an angle.
    fn are_facets(&self, rim: &Rim) -> bool {
        fn normal(
            chart: u32,
            k: usize,
            charts: &[Chart],
            rim_points: &[Point3<f64>],
        ) -> Vector3<f64> {
            charts[chart as usize].distance(rim_points[k]).1
        }
        (0..rim.len()).filter(|&k| self.of_rim[k].count_ones() == 2).all(|k| {
            let set = self.of_rim[k];
            let [a, b] = [set.trailing_zeros(), 31 - set.leading_zeros()];
            normal(a, k, &self.charts, &rim.points).dot(&normal(b, k, &self.charts, &rim.points))
                < FACETS
        })
    }

    fn of_segments(
        filling: &Filling,
        rim: &Rim,
        faces: &[[u32; 3]],
        segments: &[u32],
    ) -> Option<Self> {
        let place = |vertex: u32| filling.points[vertex as usize];
        // The segment beyond each rim edge.
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
            of_edges.iter().filter(|&&other| other == segment).count() >= LEAST_EDGES
        });
        if known.len() < 2 || known.len() > MOST || known.contains(&NONE) {
            return None;
        }
        let edge = rim.lengths.iter().sum::<f64>() / count as f64;
        let mut members: Vec<Vec<Point3<f64>>> = Vec::new();
        let mut charts = Vec::new();
        for &segment in &known {
            let own = || (0..faces.len()).filter(|&face| segments[face] == segment);
            let mut vertices: Vec<u32> = own().flat_map(|face| faces[face]).collect();
            vertices.sort_unstable();
            vertices.dedup();
            let points: Vec<Point3<f64>> = vertices.into_iter().map(place).collect();
            let normal: Vector3<f64> = own().map(|face| area_vector(faces[face].map(place))).sum();
            charts.push(Chart::fit(&points, normal.try_normalize(0.0)?, FIT * edge)?);
            members.push(points);
        }
        fn number(segment: u32, known: &[u32]) -> Option<usize> {
            known.binary_search(&segment).ok()
        }
        let numbers: Vec<Option<usize>> =
            of_edges.iter().map(|&segment| number(segment, &known)).collect();
        let of_rim = (0..count).map(|k| {
            let near = [numbers[(k + count - 1) % count], numbers[k]];
            near.iter().flatten().fold(0, |set, &number| set | 1 << number)
        });
        let mut of_rim: Vec<u32> = of_rim.collect();
        fill_gaps(&mut of_rim);
        follow_creases(&mut of_rim, &charts, &rim.points, FIT * edge);
        Some(Self { meeting: meeting(&charts, &members), charts, of_rim })
    }
}

/// Vertices without a segment that counts take the set of the vertex before them.
fn fill_gaps(sets: &mut [u32]) {
    let Some(start) = sets.iter().position(|&set| set != 0) else { return };
    for k in 1..=sets.len() {
        let (before, at) = ((start + k - 1) % sets.len(), (start + k) % sets.len());
        if sets[at] == 0 {
            sets[at] = sets[before];
        }
    }
}

/// Where the rim runs along a crease, the data there may be of one segment alone, and the fill continues the other one. So vertices next to
/// a vertex of both segments that lie within `tolerance` of both surfaces are taken to be of both.
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

/// The data's faces in some rows around a rim.
fn band(filling: &Filling, rim: &Rim) -> Vec<[u32; 3]> {
    let mut is_near = vec![false; filling.data];
    rim.vertices.iter().for_each(|&vertex| is_near[vertex as usize] = true);
    let mut faces = Vec::new();
    for _ in 0..ROWS {
        faces = filling.faces[..filling.kept]
            .iter()
            .filter(|face| face.iter().any(|&vertex| is_near[vertex as usize]))
            .copied()
            .collect();
        faces.as_flattened().iter().for_each(|&vertex| is_near[vertex as usize] = true);
    }
    faces
}

/// The pairs of faces that share an edge.
fn neighbors(faces: &[[u32; 3]]) -> Vec<[u32; 2]> {
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

/// How often normals are smoothed: a few rows of faces take segment in each in the end.
const SMOOTHINGS: usize = 5;

/// The difference of two normals at which one counts for the other less than half: some 12 degrees. Noise is below, creases are above.
const DIFFERENCE: f64 = 0.2;

/// Normals without noise, but with creases: each becomes the mean of those of the faces next to it that are like it.
///
/// Jones, Durand and Desbrun, "Non-iterative, feature-preserving mesh smoothing" (2003), with the normals alone.
fn smoothed(areas: &[Vector3<f64>], neighbors: &[[u32; 2]]) -> Vec<Vector3<f64>> {
    fn unit(area: &Vector3<f64>) -> Vector3<f64> {
        area.try_normalize(0.0).unwrap_or_default()
    }
    let mut normals: Vec<Vector3<f64>> = areas.iter().map(unit).collect();
    for _ in 0..SMOOTHINGS {
        let mut sums = normals.clone();
        for &[a, b] in neighbors {
            let [of_a, of_b] = [a, b].map(|face| normals[face as usize]);
            let share = (of_a - of_b).norm_squared() / (2.0 * DIFFERENCE * DIFFERENCE);
            let weight = libm::exp(-share);
            sums[a as usize] += of_b * weight;
            sums[b as usize] += of_a * weight;
        }
        normals = sums.iter().map(unit).collect();
    }
    normals
}

/// The number of the smooth segment that each face belongs to.
fn smooth_segments(normals: &[Vector3<f64>], neighbors: &[[u32; 2]], sharp: f64) -> Vec<u32> {
    let mut segments = UnionFind::new(normals.len());
    for &[a, b] in neighbors {
        if normals[a as usize].dot(&normals[b as usize]) > sharp {
            segments.join(a, b);
        }
    }
    (0..normals.len() as u32).map(|face| segments.first(face)).collect()
}

/// Whether a surface bends where its segments meet, and much less within them: the bumps of a relief fit paraboloids, too, but are round.
fn bend_in_creases(segments: &[u32], normals: &[Vector3<f64>], neighbors: &[[u32; 2]]) -> bool {
    let (mut within, mut between) = ((0.0, 0.0), (0.0, 0.0));
    for &[a, b] in neighbors {
        let [m, n] = [a, b].map(|face| normals[face as usize]);
        let sum =
            if segments[a as usize] == segments[b as usize] { &mut within } else { &mut between };
        sum.0 += libm::atan2(m.cross(&n).norm(), m.dot(&n));
        sum.1 += 1.0;
    }
    between.1 == 0.0 || TIMES * within.0 * between.1 < between.0 * within.1
}

/// Segments meet convexly if all lie below each other's surfaces.
fn meeting(charts: &[Chart], members: &[Vec<Point3<f64>>]) -> Edge {
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
        (_, 0) => Edge::Convex,
        (0, _) => Edge::Concave,
        _ => Edge::Mixed,
    }
}
