//! Compares two meshes: face by face if they have the same faces, else by the distances between their surfaces in both directions.

use maquette_engine::six;
use maquette_value::Topology;
use maquette_value::parallel::*;
use maquette_value::{AnyValue, Attributes, Mesh};
use maquette_value::{NearestPlace, TriangleTree};
use nalgebra::{Point3, Vector3};

use super::columns::{difference, in_words, judge, measure, measure_beyond, worst};
use super::{Comparison, Measure, Tolerance, Verdict, allowed, compare_parts, order};
use crate::parts::{Class, GoldenColumn, GoldenParts};

/// Compares two meshes, of which the columns of the old one may be off by what `error` says for each name.
pub(crate) fn compare_meshes(
    old: &Mesh,
    new: &Mesh,
    tolerance: &Tolerance,
    error: &dyn Fn(&str) -> f64,
) -> Comparison {
    let same_faces = old.faces() == new.faces() && old.positions().len() == new.positions().len();
    if same_faces && !tolerance.remeshed {
        fn parts(mesh: &Mesh) -> GoldenParts {
            GoldenParts::of(&AnyValue::new(mesh.clone())).unwrap_or_default()
        }
        let (old_parts, new_parts) = rayon::join(|| parts(old), || parts(new));
        let comparison = compare_parts(&old_parts, &new_parts, tolerance);
        if comparison.measures.iter().any(|measure| measure.max > 0.0)
            || !comparison.reasons.is_empty()
        {
            return comparison;
        }
    }
    let (a, b) = rayon::join(|| order::of_mesh(old), || order::of_mesh(new));
    if a == b && !same_faces {
        return Comparison::alike(Verdict::Reordered);
    }
    let mut reasons = Vec::new();
    if !tolerance.remeshed {
        let (before, now) = rayon::join(|| Topology::of(old), || Topology::of(new));
        let pairs = before.facts().into_iter().zip(now.facts());
        let changed = pairs.filter(|((_, before), (_, now))| before != now);
        reasons
            .extend(changed.map(|((name, before), (_, now))| format!("{name}: {before} -> {now}")));
    }
    let (of_old, of_new) = rayon::join(|| TriangleTree::new(old), || TriangleTree::new(new));
    let places = bytemuck::cast_slice(old.positions()).to_vec();
    let limit = allowed(&GoldenColumn::new("position", Class::Place, 3, places), tolerance);
    let off = error("position");
    let to_new = Search::new(old, &of_new, limit + off);
    let to_old = Search::new(new, &of_old, limit + off);
    if !tolerance.remeshed {
        reasons.extend(other_faces(old, new, &of_new, limit + off));
    }
    let measure = |name: &str, search: &Search, from: &Mesh, to: &TriangleTree| {
        search.measure(name, from, to, tolerance, [limit, off])
    };
    let mut measures = vec![
        measure("surface, old to new", &to_new, old, &of_new),
        measure("surface, new to old", &to_old, new, &of_old),
    ];
    let (of_attributes, lost) = attributes(old, new, &to_new, &of_new, tolerance, error);
    reasons.extend(lost);
    measures.extend(of_attributes);
    Comparison::new(reasons, measures)
}

/// Faces that are no longer the same although the surface is: other diagonals, other sides.
fn other_faces(old: &Mesh, new: &Mesh, tree: &TriangleTree, limit: f64) -> Option<String> {
    let same_places = old.positions().len() == new.positions().len()
        && old.positions().iter().zip(new.positions().iter()).all(|(a, b)| (a - b).norm() <= limit);
    if same_places {
        let (before, now) = rayon::join(|| rings(old), || rings(new));
        let gone = before.iter().filter(|ring| now.binary_search(ring).is_err()).count();
        return (gone > 0)
            .then(|| format!("{gone} faces join other vertices, or in another sense"));
    }
    /// So many faces tell to which sides a surface looks.
    const SOME: usize = 1 << 15;
    let middles = middles_of(old, old.faces().len().div_ceil(SOME).max(1));
    let hits = tree.nearest_to_all(&middles.iter().map(|(_, middle)| *middle).collect::<Vec<_>>());
    let is_turned = |((face, _), hit): (&(usize, Point3<f64>), &Option<NearestPlace>)| {
        hit.is_some_and(|hit| {
            let before = old.area_vector(old.faces().face(*face));
            before.dot(&new.area_vector(new.faces().face(hit.face as usize))) < 0.0
        })
    };
    let turned = middles.iter().zip(&hits).filter(|pair| is_turned(*pair)).count();
    // Where two sheets lie close together, some places are nearest to the wrong one.
    let share = 100.0 * turned as f64 / middles.len().max(1) as f64;
    (share > 1.0).then(|| format!("{} % of the faces look to the other side", six(share)))
}

/// The vertices of each face, the least of them first, in order.
fn rings(mesh: &Mesh) -> Vec<Vec<u32>> {
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

/// Places of one mesh, and where another one is nearest to each.
struct Search {
    /// Every `stride`-th vertex was measured.
    stride: usize,
    hits: Vec<Option<NearestPlace>>,
}

impl Search {
    /// Measures all vertices. If there are very many, and each search is long because the meshes are far from each other, only some are
    /// measured, provided that one of these is beyond the limit already.
    fn new(from: &Mesh, to: &TriangleTree, limit: f64) -> Self {
        /// So many vertices are measured first: they tell how far apart the surfaces are, and how long the others would take.
        const SOME: usize = 1 << 15;
        /// Boxes that a long search visits; one near the surface visits some 40.
        const LONG: usize = 200;
        let all = from.positions();
        let stride = all.len() / SOME;
        if stride > 1 {
            let some: Vec<_> = all.iter().step_by(stride).copied().collect();
            let (hits, visited) = to.search(&some);
            if visited > LONG * some.len() && hits.iter().any(|hit| distance(hit) > limit) {
                return Self { stride, hits };
            }
        }
        Self { stride: 1, hits: to.nearest_to_all(all) }
    }

    /// Measures how far the surface is from another one: at its vertices and faces, and for other faces at its edges, too.
    fn measure(
        &self,
        name: &str,
        from: &Mesh,
        to: &TriangleTree,
        tolerance: &Tolerance,
        [limit, off]: [f64; 2],
    ) -> Measure {
        let mut nearest = self.hits.clone();
        let mut between = Vec::new();
        // Where only some vertices were measured, one of them is beyond the limit already.
        if self.stride == 1 {
            (between, nearest) = on_faces(from, to, nearest);
            if tolerance.remeshed {
                let edges = edge_midpoints(from);
                nearest.extend(to.nearest_to_all(&edges));
                between.extend(edges.into_iter().map(|at| Sample { face: None, at }));
            }
        }
        let distances: Vec<f64> = nearest.iter().map(distance).collect();
        let mut measure = measure(name, &distances, Class::Place, limit);
        measure.error = off;
        measure.seen = 1.0 / self.stride as f64;
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
        judge(&mut measure, Class::Place, tolerance);
        measure
    }
}

fn distance(hit: &Option<NearestPlace>) -> f64 {
    hit.map_or(f64::INFINITY, |hit| hit.distance_sq.sqrt())
}

/// A point of a surface between its vertices, on a face or on an edge.
struct Sample {
    face: Option<usize>,
    at: Point3<f64>,
}

/// Adds a sample of each face to `hits`: a face that the other mesh lacks is seen although all its vertices are there.
///
/// The sample is the centroid of three consecutive corners. A polygon may be cut into other triangles in the other mesh, so of its
/// triples the one nearest to that mesh counts: at two corners at least, every way to cut has this triangle.
fn on_faces(
    mesh: &Mesh,
    to: &TriangleTree,
    mut hits: Vec<Option<NearestPlace>>,
) -> (Vec<Sample>, Vec<Option<NearestPlace>>) {
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

/// The midpoint of each edge.
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

/// Compares the attributes of `old` with those of `new` at the nearest place; says, too, which are gone or new.
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
    for of in [Of::Vertex, Of::Corner, Of::Face] {
        let [before, now] = [old, new].map(|mesh| GoldenParts::of_attributes(of.attributes(mesh)));
        for mut part in before.iter().cloned() {
            let Some(other) =
                now.iter().find(|other| other.name == part.name && other.width == part.width)
            else {
                reasons.push(format!("`{}{}` is gone", of.word(), part.name));
                continue;
            };
            part.name = format!("{}{}", of.word(), part.name);
            let off = error(&part.name);
            measures.push(match of {
                Of::Vertex => at_vertices(&part, other, new, of_vertices, tolerance, off),
                _ => {
                    let hits = middles.get_or_insert_with(|| {
                        let middles = middles_of(old, 1);
                        let places: Vec<_> = middles.iter().map(|(_, middle)| *middle).collect();
                        tree.nearest_to_all(&places)
                    });
                    at_middles(&part, other, old, of, hits, tolerance, off)
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

/// The elements on which attributes lie.
#[derive(Clone, Copy)]
enum Of {
    Vertex,
    Corner,
    Face,
}

impl Of {
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

fn at_vertices(
    part: &GoldenColumn,
    other: &GoldenColumn,
    new: &Mesh,
    search: &Search,
    tolerance: &Tolerance,
    off: f64,
) -> Measure {
    let difference_at = |place: usize, hit: &Option<NearestPlace>, relative: f64| {
        let Some(hit) = hit else { return f64::INFINITY };
        let corners = hit.corners.map(|corner| new.faces().corners()[corner as usize] as usize);
        let most = (0..3).max_by(|&a, &b| hit.shares[a].total_cmp(&hit.shares[b])).unwrap_or(0);
        let there = match part.class {
            // What is equal or not has no mean.
            Class::Exact | Class::Level => other.element(corners[most]).to_vec(),
            _ => mixed(other, corners, hit.shares),
        };
        difference(part.class, part.element(place * search.stride), &there, relative)
    };
    judged(
        part,
        "vertex",
        search.stride,
        |relative: f64| {
            let hits = search.hits.par_iter().enumerate();
            hits.map(|(place, hit)| difference_at(place, hit, relative)).collect()
        },
        tolerance,
        off,
    )
}

/// Every n-th face and the middle of its first triangle: there, other than at its corners, only one face is near.
fn middles_of(mesh: &Mesh, stride: usize) -> Vec<(usize, Point3<f64>)> {
    fn middle(face: usize, mesh: &Mesh) -> (usize, Point3<f64>) {
        let corners = first_triangle(mesh, face).map(|corner| mesh.faces().corners()[corner]);
        let sum: Vector3<f64> =
            corners.map(|v| mesh.positions()[v as usize].coords).into_iter().sum();
        (face, Point3::from(sum / 3.0))
    }
    let count = mesh.faces().len().div_ceil(stride);
    (0..count).into_par_iter().map(|index| middle(index * stride, mesh)).collect()
}

/// The corners of the first triangle of a face, by index among the corners of all faces.
fn first_triangle(mesh: &Mesh, face: usize) -> [usize; 3] {
    let first = mesh.faces().first_corner(face);
    let triangle = mesh.face_triangles(face).next().expect("a face has three corners");
    triangle.map(|corner| first + corner as usize)
}

fn at_middles(
    part: &GoldenColumn,
    other: &GoldenColumn,
    old: &Mesh,
    of: Of,
    hits: &[Option<NearestPlace>],
    tolerance: &Tolerance,
    off: f64,
) -> Measure {
    let difference_at = |face: usize, hit: &Option<NearestPlace>, relative: f64| {
        let Some(hit) = hit else { return f64::INFINITY };
        if let Of::Face = of {
            let there = other.element(hit.face as usize);
            return difference(part.class, part.element(face), there, relative);
        }
        let here = mixed(part, first_triangle(old, face), [1.0 / 3.0; 3]);
        let there = hit.corners.map(|corner| corner as usize);
        difference(part.class, &here, &mixed(other, there, hit.shares), relative)
    };
    judged(
        part,
        "face",
        1,
        |relative: f64| {
            let hits = hits.par_iter().enumerate();
            hits.map(|(face, hit)| difference_at(face, hit, relative)).collect()
        },
        tolerance,
        off,
    )
}

fn mixed(part: &GoldenColumn, elements: [usize; 3], shares: [f64; 3]) -> Vec<f64> {
    (0..part.width)
        .map(|k: usize| (0..3).map(|c| shares[c] * part.element(elements[c])[k]).sum())
        .collect()
}

fn judged(
    part: &GoldenColumn,
    what: &str,
    stride: usize,
    beyond: impl Fn(f64) -> Vec<f64>,
    tolerance: &Tolerance,
    off: f64,
) -> Measure {
    let (mut measure, differences) =
        measure_beyond(&part.name, beyond, part.class, allowed(part, tolerance), tolerance);
    measure.error = off;
    measure.seen = 1.0 / stride as f64;
    if let Some(place) = worst(&differences) {
        measure.worst = format!("{what} {}", place * stride);
    }
    judge(&mut measure, part.class, tolerance);
    measure
}
