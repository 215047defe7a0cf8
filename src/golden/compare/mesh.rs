//! Two meshes: face by face if they have the same faces, else by the distance of their surfaces.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::columns::{difference, in_words, judge, measure, worst};
use super::{Comparison, Measure, Tolerance, Verdict, allowed, compare_parts, order, six};
use crate::golden::parts::{Class, Part, Parts};
use crate::golden::topology::Topology;
use crate::value::{AnyValue, Attributes, Mesh};
use crate::value::{NearestPlace, TriangleTree};

pub(crate) fn compare_meshes(old: &Mesh, new: &Mesh, tolerance: &Tolerance) -> Comparison {
    let same_faces = old.faces() == new.faces() && old.positions().len() == new.positions().len();
    if same_faces {
        let parts = |mesh: &Mesh| Parts::of(&AnyValue::new(mesh.clone())).unwrap_or_default();
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
    let to_new = Search::new(old, &of_new);
    let to_old = Search::new(new, &of_old);
    let places = bytemuck::cast_slice(old.positions()).to_vec();
    let limit = allowed(&Part::new("position", Class::Place, 3, places), tolerance);
    if !tolerance.remeshed {
        reasons.extend(other_faces(old, new, &of_new, limit));
    }
    let mut measures = vec![
        to_new.measure("surface, old to new", old, tolerance, limit),
        to_old.measure("surface, new to old", new, tolerance, limit),
    ];
    let (of_attributes, lost) = attributes(old, new, &to_new, &of_new, tolerance);
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
    let ring = |face: usize| {
        let mut ring = mesh.faces().face(face).to_vec();
        let first = (0..ring.len()).min_by_key(|&k| ring[k]).unwrap_or(0);
        ring.rotate_left(first);
        ring
    };
    let mut rings: Vec<Vec<u32>> = (0..mesh.faces().len()).into_par_iter().map(ring).collect();
    rings.par_sort_unstable();
    rings
}

/// How far each vertex of one mesh is from the surface of another one, in mm.
pub(crate) fn distances(from: &Mesh, to: &Mesh) -> Vec<f64> {
    distances_of(from.positions(), to)
}

/// How far each place is from the surface of a mesh, in mm.
pub(crate) fn distances_of(places: &[Point3<f64>], to: &Mesh) -> Vec<f64> {
    let hits = TriangleTree::new(to).nearest_to_all(places);
    hits.iter().map(|hit| hit.map_or(f64::INFINITY, |hit| hit.distance_sq.sqrt())).collect()
}

/// Places of one mesh, and where another one is nearest to each.
struct Search {
    /// Every `stride`-th vertex was measured.
    stride: usize,
    hits: Vec<Option<NearestPlace>>,
}

impl Search {
    /// Measures all vertices. Of very many that are so far away that each search looks into half of the other mesh, only some:
    /// they tell the same.
    fn new(from: &Mesh, to: &TriangleTree) -> Self {
        /// So many tell what a surface is like, and how long the others would take.
        const SOME: usize = 1 << 15;
        /// A search near the surface looks into some 40 boxes.
        const LONG: usize = 200;
        let all = from.positions();
        let stride = all.len() / SOME;
        if stride > 1 {
            let some: Vec<_> = all.iter().step_by(stride).copied().collect();
            let (hits, visited) = to.search(&some);
            if visited > LONG * some.len() {
                return Self { stride, hits };
            }
        }
        Self { stride: 1, hits: to.nearest_to_all(all) }
    }

    fn measure(&self, name: &str, from: &Mesh, tolerance: &Tolerance, limit: f64) -> Measure {
        let distance =
            |hit: &Option<NearestPlace>| hit.map_or(f64::INFINITY, |hit| hit.distance_sq.sqrt());
        let distances: Vec<f64> = self.hits.iter().map(distance).collect();
        let mut measure = measure(name, &distances, "mm", limit);
        if let Some(place) = worst(&distances) {
            let vertex = place * self.stride;
            let at = in_words(from.positions()[vertex].coords.as_slice());
            let face = self.hits[place]
                .map_or(String::new(), |hit| format!(", nearest face {}", hit.face));
            measure.worst = format!("vertex {vertex} {at}{face}");
            if self.stride > 1 {
                measure.worst += &format!(" (of every {}. vertex)", self.stride);
            }
        }
        judge(&mut measure, Class::Place, tolerance);
        measure
    }
}

/// Compares the attributes of `old` with those of `new` at the nearest place; says, too, which are gone or new.
fn attributes(
    old: &Mesh,
    new: &Mesh,
    of_vertices: &Search,
    tree: &TriangleTree,
    tolerance: &Tolerance,
) -> (Vec<Measure>, Vec<String>) {
    let (mut measures, mut reasons) = (Vec::new(), Vec::new());
    let mut middles = None;
    for of in [Of::Vertex, Of::Corner, Of::Face] {
        let [before, now] = [old, new].map(|mesh| Parts::of_attributes(of.attributes(mesh)));
        for mut part in before.iter().cloned() {
            let same = |other: &&Part| other.name == part.name && other.width == part.width;
            let Some(other) = now.iter().find(same) else {
                reasons.push(format!("`{}{}` is gone", of.word(), part.name));
                continue;
            };
            part.name = format!("{}{}", of.word(), part.name);
            measures.push(match of {
                Of::Vertex => at_vertices(&part, other, new, of_vertices, tolerance),
                _ => {
                    let hits = middles.get_or_insert_with(|| {
                        let middles = middles_of(old, 1);
                        let places: Vec<_> = middles.iter().map(|(_, middle)| *middle).collect();
                        tree.nearest_to_all(&places)
                    });
                    at_middles(&part, other, [old, new], of, hits, tolerance)
                }
            });
        }
        let unknown = now.iter().filter(|part| !before.iter().any(|old| old.name == part.name));
        reasons.extend(unknown.map(|part| format!("`{}{}` is new", of.word(), part.name)));
    }
    let rest = |mesh: &Mesh| (mesh.creases().len(), mesh.texture().map(crate::value::hash_of));
    if rest(old).0 != rest(new).0 {
        reasons.push(format!("creases: {} -> {}", rest(old).0, rest(new).0));
    }
    if rest(old).1 != rest(new).1 {
        reasons.push("the texture is another one".into());
    }
    (measures, reasons)
}

/// What attributes are of.
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
    part: &Part,
    other: &Part,
    new: &Mesh,
    search: &Search,
    tolerance: &Tolerance,
) -> Measure {
    let of = |(place, hit): (usize, &Option<NearestPlace>)| {
        let Some(hit) = hit else { return f64::INFINITY };
        let corners = hit.corners(new).map(|corner| new.faces().corners()[corner] as usize);
        let most = (0..3).max_by(|&a, &b| hit.shares[a].total_cmp(&hit.shares[b])).unwrap_or(0);
        let there = match part.class {
            // What is equal or not has no mean.
            Class::Exact | Class::Level => other.element(corners[most]).to_vec(),
            _ => mixed(other, corners, hit.shares),
        };
        difference(part.class, part.element(place * search.stride), &there)
    };
    judged(part, "vertex", search.stride, search.hits.par_iter().enumerate().map(of), tolerance)
}

/// Every n-th face and the middle of its first triangle: there, other than at its corners, only one face is near.
fn middles_of(mesh: &Mesh, stride: usize) -> Vec<(usize, Point3<f64>)> {
    let middle = |face: usize| {
        let corners = mesh.faces().face(face)[..3].iter();
        let sum: Vector3<f64> = corners.map(|&v| mesh.positions()[v as usize].coords).sum();
        (face, Point3::from(sum / 3.0))
    };
    let faces = (0..mesh.faces().len()).into_par_iter().step_by(stride);
    faces.map(middle).collect()
}

fn at_middles(
    part: &Part,
    other: &Part,
    [old, new]: [&Mesh; 2],
    of: Of,
    hits: &[Option<NearestPlace>],
    tolerance: &Tolerance,
) -> Measure {
    let of = |(face, hit): (usize, &Option<NearestPlace>)| {
        let Some(hit) = hit else { return f64::INFINITY };
        if let Of::Face = of {
            return difference(part.class, part.element(face), other.element(hit.face as usize));
        }
        let first = old.faces().first_corner(face);
        let here = mixed(part, [first, first + 1, first + 2], [1.0 / 3.0; 3]);
        difference(part.class, &here, &mixed(other, hit.corners(new), hit.shares))
    };
    judged(part, "face", 1, hits.par_iter().enumerate().map(of), tolerance)
}

fn mixed(part: &Part, elements: [usize; 3], shares: [f64; 3]) -> Vec<f64> {
    let number = |k: usize| (0..3).map(|c| shares[c] * part.element(elements[c])[k]).sum();
    (0..part.width).map(number).collect()
}

fn judged(
    part: &Part,
    what: &str,
    stride: usize,
    differences: impl ParallelIterator<Item = f64>,
    tolerance: &Tolerance,
) -> Measure {
    let differences: Vec<f64> = differences.collect();
    let mut measure =
        measure(&part.name, &differences, super::unit(part.class), allowed(part, tolerance));
    if let Some(place) = worst(&differences) {
        measure.worst = format!("{what} {}", place * stride);
    }
    judge(&mut measure, part.class, tolerance);
    measure
}
