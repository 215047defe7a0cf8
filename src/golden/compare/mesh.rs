//! Compares two meshes. If their faces are equal, they are compared element by element. Otherwise the distances between their surfaces are
//! measured in both directions.

use maquette_engine::six_digits;
use maquette_value::Topology;
use maquette_value::parallel::*;
use maquette_value::{AnyValue, Attributes, Mesh};
use maquette_value::{NearestPoint, TriangleTree};
use nalgebra::{Point3, Vector3};

use super::columns::{difference, in_words, judge, measure, measure_with_relative, worst};
use super::{Comparison, Measure, Tolerance, Verdict, allowed_difference, compare_parts, order};
use crate::parts::{Class, GoldenColumn, GoldenParts};

/// Compares two meshes. `error` returns the rounding error of a column of the old mesh, given the name of the column.
pub(crate) fn compare_meshes(
    old: &Mesh,
    new: &Mesh,
    tolerance: &Tolerance,
    error: &dyn Fn(&str) -> f64,
) -> Comparison {
    let same_faces = old.faces() == new.faces() && old.positions().len() == new.positions().len();
    if same_faces && !tolerance.remeshed {
        fn parts(mesh: &Mesh) -> GoldenParts {
            GoldenParts::from_value(&AnyValue::new(mesh.clone())).unwrap_or_default()
        }
        let (old_parts, new_parts) = rayon::join(|| parts(old), || parts(new));
        let comparison = compare_parts(&old_parts, &new_parts, tolerance);
        if comparison.measures.iter().any(|measure| measure.max > 0.0)
            || !comparison.reasons.is_empty()
        {
            return comparison;
        }
    }
    let (a, b) = rayon::join(|| order::mesh_mark(old), || order::mesh_mark(new));
    if a == b && !same_faces {
        return Comparison::from_verdict(Verdict::Reordered);
    }
    let mut reasons = Vec::new();
    if !tolerance.remeshed {
        let (before, now) = rayon::join(|| Topology::from_mesh(old), || Topology::from_mesh(new));
        let pairs = before.facts().into_iter().zip(now.facts());
        let changed = pairs.filter(|((_, before), (_, now))| before != now);
        reasons
            .extend(changed.map(|((name, before), (_, now))| format!("{name}: {before} -> {now}")));
    }
    let (of_old, of_new) = rayon::join(|| TriangleTree::new(old), || TriangleTree::new(new));
    let places = bytemuck::cast_slice(old.positions()).to_vec();
    let limit =
        allowed_difference(&GoldenColumn::new("position", Class::Position, 3, places), tolerance);
    let rounding_error = error("position");
    let to_new = Search::new(old, &of_new, limit + rounding_error);
    let to_old = Search::new(new, &of_old, limit + rounding_error);
    if !tolerance.remeshed {
        reasons.extend(face_differences(old, new, &of_new, limit + rounding_error));
    }
    let mut measures = vec![
        to_new.measure("surface, old to new", old, &of_new, tolerance, [limit, rounding_error]),
        to_old.measure("surface, new to old", new, &of_old, tolerance, [limit, rounding_error]),
    ];
    let (of_attributes, lost) = attributes(old, new, &to_new, &of_new, tolerance, error);
    reasons.extend(lost);
    measures.extend(of_attributes);
    Comparison::new(reasons, measures)
}

/// Describes how the faces differ although the surfaces are equal: polygons are divided by other diagonals, or faces are flipped.
fn face_differences(old: &Mesh, new: &Mesh, tree: &TriangleTree, limit: f64) -> Option<String> {
    let same_places = old.positions().len() == new.positions().len()
        && old.positions().iter().zip(new.positions().iter()).all(|(a, b)| (a - b).norm() <= limit);
    if same_places {
        let (before, now) = rayon::join(|| sorted_faces(old), || sorted_faces(new));
        let gone = before.iter().filter(|ring| now.binary_search(ring).is_err()).count();
        return (gone > 0)
            .then(|| format!("{gone} faces have other vertices or another orientation"));
    }
    /// The maximum number of faces that are tested for being flipped.
    const MAX_TESTED_FACES: usize = 1 << 15;
    let middles = face_centers(old, old.faces().len().div_ceil(MAX_TESTED_FACES).max(1));
    let hits = tree.nearest_to_all(&middles.iter().map(|(_, middle)| *middle).collect::<Vec<_>>());
    let flipped = middles.iter().zip(&hits).filter(|((face, _), hit)| {
        hit.is_some_and(|hit| {
            let before = old.area_vector(old.faces().face(*face));
            before.dot(&new.area_vector(new.faces().face(hit.face as usize))) < 0.0
        })
    });
    // Ignore a few flipped faces. If two sheets are close together, the nearest point may be on the wrong sheet.
    let percent = 100.0 * flipped.count() as f64 / middles.len().max(1) as f64;
    (percent > 1.0)
        .then(|| format!("{} % of the faces have the opposite orientation", six_digits(percent)))
}

/// Returns the faces in a normal form for comparing them: each is a list of vertex indices that begins with the smallest index, and the
/// faces are sorted.
fn sorted_faces(mesh: &Mesh) -> Vec<Vec<u32>> {
    let mut rings: Vec<Vec<u32>> = (0..mesh.faces().len())
        .into_par_iter()
        .map(|face: usize| {
            let mut ring = mesh.faces().face(face).to_vec();
            let first = (0..ring.len()).min_by_key(|&k| ring[k]).unwrap_or(0);
            ring.rotate_left(first);
            ring
        })
        .collect();
    rings.par_sort_unstable();
    rings
}

/// For each vertex of a mesh, or for every n-th one, the nearest point on another mesh.
struct Search {
    /// The step between two measured vertices: 1 if all vertices are measured.
    stride: usize,
    hits: Vec<Option<NearestPoint>>,
}

impl Search {
    /// Finds the nearest point on the other mesh for every vertex. If there are very many vertices and searches are slow (because the
    /// meshes are far apart), searches only for some vertices, provided that one of their distances already exceeds the limit.
    fn new(from: &Mesh, to: &TriangleTree, limit: f64) -> Self {
        /// The approximate number of vertices that are measured first. They show how far apart the surfaces are and how slow a search is.
        const FIRST_VERTICES: usize = 1 << 15;
        /// The number of boxes of the search tree above which a search is slow. A search near the surface visits about 40 boxes.
        const SLOW_SEARCH_BOXES: usize = 200;
        let all = from.positions();
        let stride = all.len() / FIRST_VERTICES;
        if stride > 1 {
            let some: Vec<_> = all.iter().step_by(stride).copied().collect();
            let (hits, visited) = to.search(&some);
            if visited > SLOW_SEARCH_BOXES * some.len()
                && hits.iter().any(|hit| distance(hit) > limit)
            {
                return Self { stride, hits };
            }
        }
        Self { stride: 1, hits: to.nearest_to_all(all) }
    }

    /// Measures the distance of a surface from another surface at its vertices and faces. If the tolerance allows other faces, also
    /// measures at the midpoints of edges.
    fn measure(
        &self,
        name: &str,
        from: &Mesh,
        to: &TriangleTree,
        tolerance: &Tolerance,
        [limit, rounding_error]: [f64; 2],
    ) -> Measure {
        let mut nearest = self.hits.clone();
        let mut between = Vec::new();
        // If only some vertices were measured, one of them already exceeds the limit, so no more points are needed.
        if self.stride == 1 {
            (between, nearest) = add_face_samples(from, to, nearest);
            if tolerance.remeshed {
                let edges = edge_midpoints(from);
                nearest.extend(to.nearest_to_all(&edges));
                between.extend(edges.into_iter().map(|at| Sample { face: None, at }));
            }
        }
        let distances: Vec<f64> = nearest.iter().map(distance).collect();
        let mut measure = measure(name, &distances, Class::Position, limit);
        measure.error = rounding_error;
        measure.compared_fraction = 1.0 / self.stride as f64;
        if let Some(place) = worst(&distances) {
            let vertex = place * self.stride;
            let (element, at) = match between.get(place.wrapping_sub(self.hits.len())) {
                Some(Sample { face: Some(face), at }) => (format!("face {face} "), at),
                Some(Sample { face: None, at }) => (String::new(), at),
                None => (format!("vertex {vertex} "), &from.positions()[vertex]),
            };
            let face =
                nearest[place].map_or(String::new(), |hit| format!(", nearest face {}", hit.face));
            measure.worst = format!("{element}{}{face}", in_words(at.coords.as_slice()));
            if self.stride > 1 {
                measure.worst += &format!(" (of every {}. vertex)", self.stride);
            }
        }
        judge(&mut measure, Class::Position, tolerance);
        measure
    }
}

fn distance(hit: &Option<NearestPoint>) -> f64 {
    hit.map_or(f64::INFINITY, |hit| hit.distance_sq.sqrt())
}

/// A sample point of a surface: on the face `face`, or on an edge if `face` is `None`.
struct Sample {
    face: Option<usize>,
    at: Point3<f64>,
}

/// Adds the nearest point of a sample of each face to `hits`. The samples detect faces that the other mesh lacks, even if it has all their
/// vertices. The sample of a face is the centroid of three consecutive corners. The other mesh may divide a polygon into other triangles,
/// so every three consecutive corners are tried, and the centroid nearest to the other mesh is used. This is enough: every triangulation of
/// a polygon contains a triangle of three consecutive corners.
fn add_face_samples(
    mesh: &Mesh,
    to: &TriangleTree,
    mut hits: Vec<Option<NearestPoint>>,
) -> (Vec<Sample>, Vec<Option<NearestPoint>>) {
    fn place(vertex: u32, mesh: &Mesh) -> Vector3<f64> {
        mesh.positions()[vertex as usize].coords
    }
    fn triples(face: &[u32]) -> usize {
        if face.len() == 3 { 1 } else { face.len() }
    }
    let centroids = (0..mesh.faces().len()).into_par_iter().flat_map_iter(|index| {
        let face = mesh.faces().face(index);
        (0..triples(face)).map(move |k| {
            let corners = [0, 1, 2].map(|step| place(face[(k + step) % face.len()], mesh));
            Point3::from(corners.iter().sum::<Vector3<f64>>() / 3.0)
        })
    });
    let centroids: Vec<Point3<f64>> = centroids.collect();
    let found = to.nearest_to_all(&centroids);
    let mut samples = Vec::with_capacity(mesh.faces().len());
    let mut first = 0;
    for (index, face) in mesh.faces().iter().enumerate() {
        let own = first..first + triples(face);
        first = own.end;
        let Some(best) = own.min_by(|&a, &b| distance(&found[a]).total_cmp(&distance(&found[b])))
        else {
            continue;
        };
        samples.push(Sample { face: Some(index), at: centroids[best] });
        hits.push(found[best]);
    }
    (samples, hits)
}

/// Returns the midpoint of each edge.
fn edge_midpoints(mesh: &Mesh) -> Vec<Point3<f64>> {
    fn place(vertex: u32, mesh: &Mesh) -> Point3<f64> {
        mesh.positions()[vertex as usize]
    }
    let edges = mesh.edges();
    edges
        .vertices
        .iter()
        .map(|[a, b]| nalgebra::center(&place(*a, mesh), &place(*b, mesh)))
        .collect()
}

/// Compares the attributes of `old` with those of `new` at the nearest point. Also returns descriptions of attributes that only one of the
/// meshes has.
fn attributes(
    old: &Mesh,
    new: &Mesh,
    of_vertices: &Search,
    tree: &TriangleTree,
    tolerance: &Tolerance,
    error: &dyn Fn(&str) -> f64,
) -> (Vec<Measure>, Vec<String>) {
    let (mut measures, mut reasons) = (Vec::new(), Vec::new());
    let mut middles = None;
    for of in [Domain::Vertex, Domain::Corner, Domain::Face] {
        let [before, now] =
            [old, new].map(|mesh| GoldenParts::attribute_columns(of.attributes(mesh)));
        for mut part in before.iter().cloned() {
            let Some(other) =
                now.iter().find(|other| other.name == part.name && other.width == part.width)
            else {
                reasons.push(format!("`{}{}` is gone", of.word(), part.name));
                continue;
            };
            part.name = format!("{}{}", of.word(), part.name);
            let rounding_error = error(&part.name);
            measures.push(match of {
                Domain::Vertex => {
                    compare_at_vertices(&part, other, new, of_vertices, tolerance, rounding_error)
                }
                _ => {
                    let hits = middles.get_or_insert_with(|| {
                        let middles = face_centers(old, 1);
                        let places: Vec<_> = middles.iter().map(|(_, middle)| *middle).collect();
                        tree.nearest_to_all(&places)
                    });
                    compare_at_faces(&part, other, old, of, hits, tolerance, rounding_error)
                }
            });
        }
        let unknown = now.iter().filter(|part| !before.iter().any(|old| old.name == part.name));
        reasons.extend(unknown.map(|part| format!("`{}{}` is new", of.word(), part.name)));
    }
    fn rest(mesh: &Mesh) -> (usize, Option<maquette_value::Hash>) {
        (mesh.creases().len(), mesh.texture().map(maquette_value::hash_of))
    }
    if rest(old).0 != rest(new).0 {
        reasons.push(format!("creases: {} -> {}", rest(old).0, rest(new).0));
    }
    if rest(old).1 != rest(new).1 {
        reasons.push("the texture is another one".into());
    } else if old.materials() != new.materials() {
        reasons.push("the materials are others".into());
    }
    (measures, reasons)
}

/// The kind of element to which an attribute belongs.
#[derive(Clone, Copy)]
enum Domain {
    Vertex,
    Corner,
    Face,
}

impl Domain {
    fn attributes(self, mesh: &Mesh) -> &Attributes {
        match self {
            Self::Vertex => mesh.vertex(),
            Self::Corner => mesh.corner(),
            Self::Face => mesh.face(),
        }
    }

    fn word(self) -> &'static str {
        match self {
            Self::Vertex => "",
            Self::Corner => "corner ",
            Self::Face => "face ",
        }
    }
}

fn compare_at_vertices(
    part: &GoldenColumn,
    other: &GoldenColumn,
    new: &Mesh,
    search: &Search,
    tolerance: &Tolerance,
    rounding_error: f64,
) -> Measure {
    let difference_at = |place: usize, hit: &Option<NearestPoint>, relative: f64| {
        let Some(hit) = hit else { return f64::INFINITY };
        let corners = hit.corners.map(|corner| new.faces().corners()[corner as usize] as usize);
        let nearest_corner =
            (0..3).max_by(|&a, &b| hit.barycentric[a].total_cmp(&hit.barycentric[b])).unwrap_or(0);
        let there = match part.class {
            // Whole numbers and colors cannot be interpolated, so use the value of the nearest corner.
            Class::Exact | Class::Level => other.element(corners[nearest_corner]).to_vec(),
            _ => interpolate(other, corners, hit.barycentric),
        };
        difference(part.class, part.element(place * search.stride), &there, relative)
    };
    measure_attribute(
        part,
        "vertex",
        search.stride,
        |relative: f64| {
            let hits = search.hits.par_iter().enumerate();
            hits.map(|(place, hit)| difference_at(place, hit, relative)).collect()
        },
        tolerance,
        rounding_error,
    )
}

/// Returns every `stride`-th face, with the center of its first triangle. Unlike a corner, this point is near to only one face.
fn face_centers(mesh: &Mesh, stride: usize) -> Vec<(usize, Point3<f64>)> {
    fn middle(face: usize, mesh: &Mesh) -> (usize, Point3<f64>) {
        let corners = first_triangle(mesh, face).map(|corner| mesh.faces().corners()[corner]);
        let sum: Vector3<f64> =
            corners.map(|v| mesh.positions()[v as usize].coords).into_iter().sum();
        (face, Point3::from(sum / 3.0))
    }
    let count = mesh.faces().len().div_ceil(stride);
    (0..count).into_par_iter().map(|index| middle(index * stride, mesh)).collect()
}

/// Returns the corners of the first triangle of a face. The corners of all faces are numbered in one sequence.
fn first_triangle(mesh: &Mesh, face: usize) -> [usize; 3] {
    let first = mesh.faces().first_corner(face);
    let triangle = mesh.face_triangles(face).next().expect("a face has three corners");
    triangle.map(|corner| first + corner as usize)
}

fn compare_at_faces(
    part: &GoldenColumn,
    other: &GoldenColumn,
    old: &Mesh,
    of: Domain,
    hits: &[Option<NearestPoint>],
    tolerance: &Tolerance,
    rounding_error: f64,
) -> Measure {
    let difference_at = |face: usize, hit: &Option<NearestPoint>, relative: f64| {
        let Some(hit) = hit else { return f64::INFINITY };
        if let Domain::Face = of {
            let there = other.element(hit.face as usize);
            return difference(part.class, part.element(face), there, relative);
        }
        let here = interpolate(part, first_triangle(old, face), [1.0 / 3.0; 3]);
        let there = hit.corners.map(|corner| corner as usize);
        difference(part.class, &here, &interpolate(other, there, hit.barycentric), relative)
    };
    measure_attribute(
        part,
        "face",
        1,
        |relative: f64| {
            let hits = hits.par_iter().enumerate();
            hits.map(|(face, hit)| difference_at(face, hit, relative)).collect()
        },
        tolerance,
        rounding_error,
    )
}

fn interpolate(part: &GoldenColumn, elements: [usize; 3], shares: [f64; 3]) -> Vec<f64> {
    (0..part.width)
        .map(|k: usize| (0..3).map(|c| shares[c] * part.element(elements[c])[k]).sum())
        .collect()
}

fn measure_attribute(
    part: &GoldenColumn,
    what: &str,
    stride: usize,
    beyond: impl Fn(f64) -> Vec<f64>,
    tolerance: &Tolerance,
    rounding_error: f64,
) -> Measure {
    let (mut measure, differences) = measure_with_relative(
        &part.name,
        beyond,
        part.class,
        allowed_difference(part, tolerance),
        tolerance,
    );
    measure.error = rounding_error;
    measure.compared_fraction = 1.0 / stride as f64;
    if let Some(place) = worst(&differences) {
        measure.worst = format!("{what} {}", place * stride);
    }
    judge(&mut measure, part.class, tolerance);
    measure
}
