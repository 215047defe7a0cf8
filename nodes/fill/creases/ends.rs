//! Finds the creases of the data that end at the rim of a hole, as polylines of edges that lead from the rim into the data.

use nalgebra::{Point3, Vector3};

use super::charts::{adjacent_faces, smooth_normals};
use crate::border::rim::Rim;
use crate::triangles::filling::Filling;
use crate::triangles::triangulation::area_vector;

/// Cosines of the angles, 32 and 20 degrees, between the faces at an edge. Most edges of a crease exceed the first angle, and all exceed
/// the second one.
const SHARP_COSINE: f64 = 0.848048096156426;
const BLUNT_COSINE: f64 = 0.9396926207859084;

/// Minimum fraction of the edges of a crease that exceed the first angle.
const MIN_SHARP: f64 = 0.6;

/// Minimum and maximum number of edges of a crease that are considered. Fewer edges do not determine a direction.
const MIN_EDGES: usize = 4;
const MAX_EDGES: usize = 40;

/// Cosine of the maximum angle, 60 degrees, by which a crease turns from its last [`HEADING`] edges to the next edge.
const MAX_TURN: f64 = 0.5;
const HEADING: usize = 3;

/// Number of edges whose faces determine the normals beside the end of a crease.
const NORMAL_EDGES: usize = 3;

/// A crease of the data that ends at the rim of a hole.
#[derive(Clone, Debug)]
pub(super) struct CreaseEnd {
    /// The index of the rim vertex.
    pub(super) rim: usize,
    /// The vertices of the crease, from the rim into the data.
    vertices: Vec<u32>,
    pub(super) points: Vec<Point3<f64>>,
    /// The unit normals of the data beside the crease at the rim: first on the side of the following rim edge, then on the other side.
    pub(super) normals: [Vector3<f64>; 2],
}

impl CreaseEnd {
    /// Returns the direction in which the crease enters the hole, from its last edges.
    pub(super) fn heading(&self) -> Vector3<f64> {
        let from = self.points[HEADING.min(self.points.len() - 1)];
        (self.points[0] - from).try_normalize(0.0).unwrap_or_default()
    }
}

/// Returns the creases that end at the rim, in the order of their rim vertices; at most one for each rim vertex.
pub(super) fn find_ends(filling: &Filling, rim: &Rim) -> Vec<CreaseEnd> {
    if !may_have_creases(rim) {
        return Vec::new();
    }
    let network = Network::new(filling, rim);
    let mut ends: Vec<CreaseEnd> = Vec::new();
    for (index, &vertex) in rim.vertices.iter().enumerate() {
        let found = network
            .crease_neighbors(vertex)
            .filter_map(|next| network.follow(filling, rim, index, next))
            .max_by_key(|end| end.points.len());
        ends.extend(found);
    }
    // Creases from neighboring rim vertices that join are one crease; keep the longest.
    let mut kept: Vec<CreaseEnd> = Vec::new();
    for end in ends {
        match kept.iter().position(|other| end.joins(other)) {
            Some(other) if kept[other].points.len() < end.points.len() => kept[other] = end,
            Some(_) => {}
            None => kept.push(end),
        }
    }
    kept.sort_by_key(|end| end.rim);
    kept
}

impl CreaseEnd {
    /// Returns true if two creases share one of their first vertices, in the same direction.
    fn joins(&self, other: &Self) -> bool {
        let first = |end: &Self| end.vertices[..=MIN_EDGES.min(end.vertices.len() - 1)].to_vec();
        let own = first(self);
        first(other).iter().any(|vertex| own.contains(vertex))
    }
}

/// Returns the area vectors of the triangles of the data around a hole.
pub(super) fn areas_around(rim: &Rim) -> Vec<Vector3<f64>> {
    rim.triangles
        .iter()
        .map(|face| {
            area_vector(face.map(|index: u32| match rim.points.get(index as usize) {
                Some(point) => *point,
                None => rim.ring[index as usize - rim.len()],
            }))
        })
        .collect()
}

/// Returns true if an edge of the data at the rim is sharp: a fast test that excludes most holes.
fn may_have_creases(rim: &Rim) -> bool {
    let areas = areas_around(rim);
    adjacent_faces(&rim.triangles).iter().any(|pair| {
        let [a, b] = pair.map(|face| areas[face as usize]);
        a.dot(&b) < BLUNT_COSINE * a.norm() * b.norm()
    })
}

/// The edges of the data near a hole, with the normals of their faces.
struct Network {
    /// The sides of the faces as directed edges, each with its face, sorted.
    sides: Vec<([u32; 2], u32)>,
    /// Smoothed unit normals of the faces.
    normals: Vec<Vector3<f64>>,
}

impl Network {
    fn new(filling: &Filling, rim: &Rim) -> Self {
        let count = rim.len() as f64;
        let middle =
            Point3::from(rim.points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / count);
        let edge = rim.lengths.iter().sum::<f64>() / count;
        let radius = rim.points.iter().map(|p| (p - middle).norm()).fold(0.0, f64::max);
        let reach = radius + (MAX_EDGES + 2) as f64 * edge;
        let faces: Vec<[u32; 3]> = filling.faces[..filling.n_data_faces]
            .iter()
            .filter(|face| (filling.point(face[0]) - middle).norm_squared() <= reach * reach)
            .copied()
            .collect();
        let areas: Vec<Vector3<f64>> =
            faces.iter().map(|&face| area_vector(filling.corners(face))).collect();
        let normals = smooth_normals(&areas, &adjacent_faces(&faces));
        let mut sides: Vec<([u32; 2], u32)> = (0..)
            .zip(&faces)
            .flat_map(|(index, &[a, b, c])| [([a, b], index), ([b, c], index), ([c, a], index)])
            .collect();
        sides.sort_unstable();
        Self { sides, normals }
    }

    fn normal_beside(&self, side: [u32; 2]) -> Option<Vector3<f64>> {
        let found = self.sides.binary_search_by_key(&side, |side| side.0).ok()?;
        Some(self.normals[self.sides[found].1 as usize])
    }

    /// Returns the unit normals of the faces to the left and to the right of an edge; `None` for an edge with one face.
    fn normals_beside(&self, [a, b]: [u32; 2]) -> Option<[Vector3<f64>; 2]> {
        Some([self.normal_beside([a, b])?, self.normal_beside([b, a])?])
    }

    fn is_bent(&self, edge: [u32; 2], cosine: f64) -> bool {
        self.normals_beside(edge).is_some_and(|[left, right]| left.dot(&right) < cosine)
    }

    /// Returns the vertices to which an edge leads from `vertex` whose faces meet at an angle.
    fn crease_neighbors(&self, vertex: u32) -> impl Iterator<Item = u32> {
        let first = self.sides.partition_point(|side| side.0 < [vertex, 0]);
        self.sides[first..]
            .iter()
            .map(|side| side.0)
            .take_while(move |side| side[0] == vertex)
            .filter(|&side| self.is_bent(side, BLUNT_COSINE))
            .map(|side| side[1])
    }

    /// Follows the crease that leads from a rim vertex to the vertex `next`. Returns `None` if it is too short or too blunt.
    fn follow(&self, filling: &Filling, rim: &Rim, index: usize, next: u32) -> Option<CreaseEnd> {
        let mut vertices = vec![rim.vertices[index], next];
        while vertices.len() <= MAX_EDGES {
            let here = vertices[vertices.len() - 1];
            let behind = vertices[vertices.len().saturating_sub(HEADING + 1)];
            let heading = (filling.point(here) - filling.point(behind)).normalize();
            let ahead: Vec<u32> =
                self.crease_neighbors(here).filter(|other| !vertices.contains(other)).collect();
            if rim.vertices.contains(&here)
                || ahead.iter().filter(|other| self.is_bent([here, **other], SHARP_COSINE)).count()
                    > 1
            {
                break;
            }
            let cosines = ahead.iter().map(|&other| {
                let step = filling.point(other) - filling.point(here);
                (step.dot(&heading) / step.norm(), other)
            });
            match cosines.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1))) {
                Some((cosine, other)) if cosine > MAX_TURN => vertices.push(other),
                _ => break,
            }
        }
        let edges = vertices.len() - 1;
        let sharp =
            vertices.windows(2).filter(|ends| self.is_bent([ends[0], ends[1]], SHARP_COSINE));
        if edges < MIN_EDGES || (sharp.count() as f64) < MIN_SHARP * edges as f64 {
            return None;
        }
        let points: Vec<Point3<f64>> = vertices.iter().map(|&v| filling.point(v)).collect();
        let mut end = CreaseEnd { rim: index, vertices, points, normals: [Vector3::zeros(); 2] };
        end.normals = self.end_normals(&end)?;
        Some(end)
    }

    /// Returns the normals beside the end of a crease: the means over its last edges, turned with the crease.
    fn end_normals(&self, end: &CreaseEnd) -> Option<[Vector3<f64>; 2]> {
        let into_data = -end.heading();
        let mut sums = [Vector3::zeros(); 2];
        for k in 0..NORMAL_EDGES {
            let along = end.points[k + 1] - end.points[k];
            let beside = self.normals_beside([end.vertices[k], end.vertices[k + 1]])?;
            for (sum, normal) in sums.iter_mut().zip(beside) {
                *sum += transport(normal, along, into_data);
            }
        }
        let [left, right] = sums.map(|sum| sum.try_normalize(0.0));
        Some([left?, right?])
    }
}

/// Turns a vector by the smallest rotation that turns one direction into another. Directions of opposite or no length leave it unchanged.
pub(super) fn transport(
    vector: Vector3<f64>,
    from: Vector3<f64>,
    to: Vector3<f64>,
) -> Vector3<f64> {
    let (Some(from), Some(to)) = (from.try_normalize(0.0), to.try_normalize(0.0)) else {
        return vector;
    };
    let (axis, cosine) = (from.cross(&to), from.dot(&to));
    if cosine <= -1.0 + 1e-12 {
        return vector;
    }
    let turned = axis.cross(&vector);
    vector + turned + axis.cross(&turned) / (1.0 + cosine)
}
