//! Triangles whose edges collapse.

use std::cmp::Ordering;
use std::iter;

use maquette_base::linear::carry::Carry;
use maquette_base::linear::mix::Mix;
use maquette_value::{Faces, Mesh, MeshError, to_triangle};
use nalgebra::{Point3, Vector3, center};

use super::quadric::Quadric;
use super::wedges::{Side, Wedges};

/// Weight of the planes that hold borders and creases, beside those of faces.
const HOLD: f64 = 1000.0;

/// The same for seams, whose slip on the surface the texture counts by itself: what holds them hard meets far off the surface where they
/// run to and fro.
const HOLD_SEAM: f64 = 0.1;

/// Largest turn of a face that stays: the cosine of 75 degrees.
const LEAST_COSINE: f64 = 0.25881904510252074;

/// A face with less area than this share of the mesh's diagonal squared has none.
const LEAST_AREA: f64 = 1e-20;

/// An edge that may become a vertex.
#[derive(Clone, Copy, Debug)]
pub(super) struct Collapse {
    cost: f64,
    /// The square of the edge's length.
    length_sq: f64,
    /// The vertex that stays, and the one that goes.
    pub(super) ends: [u32; 2],
    /// Theirs when the cost was computed.
    versions: [u32; 2],
    place: Point3<f64>,
}

/// The cheapest one first; of equals the shortest one, then the one with the lower vertices.
///
/// In a plane all cost nothing. By numbers alone one vertex would take all others in, and each time all faces around it would be looked at.
impl Ord for Collapse {
    fn cmp(&self, other: &Self) -> Ordering {
        let cost = other.cost.total_cmp(&self.cost);
        let length = other.length_sq.total_cmp(&self.length_sq);
        cost.then(length).then(other.ends.cmp(&self.ends))
    }
}

impl PartialOrd for Collapse {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Collapse {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Collapse {}

/// Triangles that lose their vertices one by one.
pub(super) struct Net {
    places: Vec<Point3<f64>>,
    quadrics: Vec<Quadric>,
    /// How often each vertex has changed.
    versions: Vec<u32>,
    triangles: Vec<[u32; 3]>,
    /// The face of the mesh that each triangle is part of.
    parents: Vec<u32>,
    alive: Vec<bool>,
    pub(super) n_faces: usize,
    /// The triangles around each vertex.
    around: Vec<Vec<u32>>,
    /// The other ends of each vertex's sharp edges, with their sharpness: creases, and borders with 0.
    sharp: Vec<Vec<(u32, f64)>>,
    least_area: f64,
    /// What lies on corners, if anything does.
    wedges: Option<Wedges>,
    /// What was done: the vertex that stayed, the one that went, and its share in the result.
    merges: Vec<([u32; 2], f64)>,
}

impl Net {
    pub(super) fn new(mesh: &Mesh) -> Self {
        let places = mesh.positions().to_vec();
        let corners = mesh.triangle_corners();
        let triangles: Vec<_> = corners
            .iter()
            .map(|it| it.map(|corner: u32| mesh.faces().corners()[corner as usize]))
            .collect();
        let parents = (0..).zip(mesh.faces().iter());
        let parents = parents.flat_map(|(parent, face)| iter::repeat_n(parent, face.len() - 2));
        let parents = Vec::from_iter(parents);
        let mut around = vec![Vec::new(); places.len()];
        for (index, triangle) in (0..).zip(&triangles) {
            triangle.iter().for_each(|&vertex| around[vertex as usize].push(index));
        }
        let diagonal = mesh.bounds().map_or(0.0, |(low, high)| (high - low).norm());
        let n_faces = triangles.len();
        let mut net = Self {
            quadrics: vec![Quadric::default(); places.len()],
            versions: vec![0; places.len()],
            alive: vec![true; n_faces],
            sharp: vec![Vec::new(); places.len()],
            least_area: LEAST_AREA * diagonal * diagonal,
            merges: Vec::new(),
            wedges: Wedges::new(mesh, &triangles, &corners),
            places,
            triangles,
            parents,
            n_faces,
            around,
        };
        net.add_planes(mesh);
        net
    }

    /// The planes of all faces, and those that hold borders, creases and seams.
    fn add_planes(&mut self, mesh: &Mesh) {
        for triangle in self.triangles.clone() {
            let area = self.area(triangle);
            if let Some(normal) = area.try_normalize(0.0) {
                let first = self.places[triangle[0] as usize].coords;
                let plane = Quadric::plane(normal, first, area.norm() / 2.0);
                triangle.iter().for_each(|&vertex| self.quadrics[vertex as usize] += plane);
            }
        }
        let edges = mesh.edges();
        let borders = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1);
        let borders = borders.map(|(&ends, _)| (ends, 0.0, HOLD));
        let creases = mesh.creases().filter(|(_, sharpness)| *sharpness > 0.0);
        let creases = creases.map(|(ends, sharpness)| (ends, sharpness, HOLD));
        let seams = self.seams().into_iter().map(|ends| (ends, 0.0, HOLD_SEAM));
        for (ends, sharpness, weight) in creases.chain(borders).chain(seams) {
            let [a, b] = ends;
            if self.sharp[a as usize].iter().any(|(end, _)| *end == b) {
                continue;
            }
            self.sharp[a as usize].push((b, sharpness));
            self.sharp[b as usize].push((a, sharpness));
            self.hold(ends, weight);
        }
    }

    /// The edges whose sides have different wedges at an end.
    fn seams(&self) -> Vec<[u32; 2]> {
        let Some(wedges) = &self.wedges else { return Vec::new() };
        let mut sides = Vec::with_capacity(3 * self.triangles.len());
        for (index, corners) in (0..).zip(&self.triangles) {
            let of = wedges.of(index);
            sides.extend([(0, 1), (1, 2), (2, 0)].map(|(k, l)| {
                if corners[k] < corners[l] {
                    ([corners[k], corners[l]], [of[k], of[l]])
                } else {
                    ([corners[l], corners[k]], [of[l], of[k]])
                }
            }));
        }
        sides.sort_unstable();
        let edges = sides.chunk_by(|a, b| a.0 == b.0);
        let seams = edges.filter(|edge| edge.iter().any(|side| side.1 != edge[0].1));
        seams.map(|edge| edge[0].0).collect()
    }

    /// The sides of an edge, and of each of its ends whether it has wedges that are on neither.
    fn sides(&self, [a, b]: [u32; 2]) -> (Vec<Side>, [bool; 2]) {
        let Some(wedges) = &self.wedges else { return Default::default() };
        let mut sides = Vec::new();
        for &face in &self.around[a as usize] {
            if let (Some(k), Some(l)) = (self.corner(face, a), self.corner(face, b)) {
                let of = wedges.of(face);
                sides.push([of[k], of[l]]);
            }
        }
        sides.sort_unstable();
        sides.dedup();
        let others = [(0, a), (1, b)].map(|(end, vertex)| {
            self.around[vertex as usize].iter().any(|&face| {
                let wedge = self.corner(face, vertex).map(|k| wedges.of(face)[k]);
                !sides.iter().any(|side| Some(side[end]) == wedge)
            })
        });
        (sides, others)
    }

    /// Which corner of a face a vertex is.
    fn corner(&self, face: u32, vertex: u32) -> Option<usize> {
        self.triangles[face as usize].iter().position(|&corner| corner == vertex)
    }

    /// Adds the planes through an edge that are perpendicular to its faces, of this weight.
    fn hold(&mut self, [a, b]: [u32; 2], weight: f64) {
        let along = self.places[b as usize] - self.places[a as usize];
        let at = self.places[a as usize].coords;
        let faces = self.around[a as usize].iter().map(|&face| self.triangles[face as usize]);
        let faces: Vec<_> = faces.filter(|face| face.contains(&b)).collect();
        for face in faces {
            if let Some(normal) = along.cross(&self.area(face)).try_normalize(0.0) {
                let plane = Quadric::plane(normal, at, weight * along.norm_squared());
                [a, b].iter().for_each(|&end| self.quadrics[end as usize] += plane);
            }
        }
    }

    /// The normal of a triangle, as long as twice its area.
    fn area(&self, triangle: [u32; 3]) -> Vector3<f64> {
        let [a, b, c] = triangle.map(|vertex| self.places[vertex as usize]);
        (b - a).cross(&(c - a))
    }

    pub(super) fn edges(&self) -> Vec<[u32; 2]> {
        let edges = self.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        let mut edges: Vec<_> = edges.map(|[a, b]| [a.min(b), a.max(b)]).collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    }

    /// The vertices next to one, ascending.
    pub(super) fn neighbors(&self, vertex: u32) -> Vec<u32> {
        let faces = self.around[vertex as usize].iter();
        let corners = faces.flat_map(|&face| self.triangles[face as usize]);
        let mut neighbors: Vec<_> = corners.filter(|&corner| corner != vertex).collect();
        neighbors.sort_unstable();
        neighbors.dedup();
        neighbors
    }

    fn is_sharp(&self, [a, b]: [u32; 2]) -> bool {
        self.sharp[a as usize].iter().any(|(end, _)| *end == b)
    }

    /// What making one vertex of an edge costs; none if creases forbid it.
    pub(super) fn collapse(&self, [a, b]: [u32; 2]) -> Option<Collapse> {
        let ends = [a.min(b), a.max(b)];
        let mut quadric = self.quadrics[a as usize] + self.quadrics[b as usize];
        let (sides, others) = self.sides(ends);
        if let Some(wedges) = &self.wedges {
            quadric += wedges.cost(&sides);
        }
        let [first, second] = ends.map(|end| self.places[end as usize]);
        let sharp_edge = self.is_sharp(ends);
        // Held: the ends of creases and where several meet; beside a smooth edge every vertex of a crease.
        // What has wedges beside those of the edge does not move either, so that they may stay as they are.
        let held = [0, 1].map(|end| {
            others[end]
                || match self.sharp[ends[end] as usize].len() {
                    0 => false,
                    2 => !sharp_edge,
                    _ => true,
                }
        });
        let places = match held {
            [true, true] => return None,
            [true, false] => vec![first],
            [false, true] => vec![second],
            [false, false] => match quadric.lowest() {
                // Of equals an end, which is exactly on the surface.
                Some(lowest) => vec![first, second, lowest],
                None => vec![center(&first, &second), first, second],
            },
        };
        let costs = places.into_iter().map(|place| (quadric.at(place.coords), place));
        let (cost, place) = costs.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let versions = ends.map(|end| self.versions[end as usize]);
        let length_sq = (second - first).norm_squared();
        Some(Collapse { cost, length_sq, ends, versions, place })
    }

    /// Whether its ends are as they were when its cost was computed.
    pub(super) fn is_current(&self, collapse: &Collapse) -> bool {
        collapse.ends.map(|end| self.versions[end as usize]) == collapse.versions
    }

    /// Whether the surface stays one, and no face turns over.
    pub(super) fn allows(&self, collapse: &Collapse) -> bool {
        let [a, b] = collapse.ends;
        let shared: Vec<_> = self.around[a as usize]
            .iter()
            .filter(|&&face| self.triangles[face as usize].contains(&b))
            .collect();
        let other = self.neighbors(b);
        let common = self.neighbors(a).into_iter().filter(|v| other.binary_search(v).is_ok());
        let mut apexes: Vec<_> = shared
            .iter()
            .flat_map(|&&face| {
                self.triangles[face as usize].into_iter().filter(|v| *v != a && *v != b)
            })
            .collect();
        apexes.sort_unstable();
        if !common.eq(apexes.iter().copied()) || shared.len() > 2 {
            return false;
        }
        // A crease of three edges around a face would become a line there and back.
        !apexes.iter().any(|v| self.is_sharp([a, *v]) && self.is_sharp([b, *v]))
            && self.keeps_sides(collapse, a, b)
            && self.keeps_sides(collapse, b, a)
    }

    /// Whether the faces of `vertex` without `other` keep their side and some area, with the vertex in its new place.
    fn keeps_sides(&self, collapse: &Collapse, vertex: u32, other: u32) -> bool {
        let faces = self.around[vertex as usize].iter().map(|&face| self.triangles[face as usize]);
        let mut faces = faces.filter(|face| !face.contains(&other));
        faces.all(|face| {
            let before = self.area(face);
            let [p, q, r] = face
                .map(|v: u32| if v == vertex { collapse.place } else { self.places[v as usize] });
            let after = (q - p).cross(&(r - p));
            let turned = before.dot(&after) < LEAST_COSINE * before.norm() * after.norm();
            // What had no area may stay without.
            let lost = after.norm() < self.least_area && self.least_area <= before.norm();
            !turned && !lost
        })
    }

    pub(super) fn apply(&mut self, collapse: &Collapse) {
        let [a, b] = collapse.ends;
        let [first, second] = collapse.ends.map(|end| self.places[end as usize]);
        let along = second - first;
        let share = (collapse.place - first).dot(&along) / along.norm_squared();
        self.merges.push(([a, b], if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) }));
        self.merge_wedges(collapse);
        for face in std::mem::take(&mut self.around[b as usize]) {
            let triangle = &mut self.triangles[face as usize];
            if triangle.contains(&a) {
                let apex = triangle.iter().copied().find(|&v| v != a && v != b);
                self.alive[face as usize] = false;
                self.n_faces -= 1;
                for vertex in [Some(a), apex].into_iter().flatten() {
                    self.around[vertex as usize].retain(|&other| other != face);
                }
            } else {
                triangle.iter_mut().filter(|vertex| **vertex == b).for_each(|vertex| *vertex = a);
                self.around[a as usize].push(face);
            }
        }
        for (end, sharpness) in std::mem::take(&mut self.sharp[b as usize]) {
            self.sharp[end as usize].retain(|(other, _)| *other != b);
            if end != a {
                self.sharp[end as usize].push((a, sharpness));
                self.sharp[a as usize].push((end, sharpness));
            }
        }
        let quadric = self.quadrics[b as usize];
        self.quadrics[a as usize] += quadric;
        self.places[a as usize] = collapse.place;
        [a, b].iter().for_each(|&end| self.versions[end as usize] += 1);
    }

    /// Makes one wedge of the two on each side of an edge: with what was on the nearest place of that side of the surface.
    fn merge_wedges(&mut self, collapse: &Collapse) {
        let [a, b] = collapse.ends;
        let (sides, _) = self.sides([a, b]);
        let Some(wedges) = &self.wedges else { return };
        let faces = || self.around[a as usize].iter().chain(&self.around[b as usize]).copied();
        let mixed = sides.iter().map(|side| {
            let on_side =
                faces().filter(|&face| wedges.of(face).iter().any(|it| side.contains(it)));
            let nearest = on_side.map(|face| {
                let corners = self.triangles[face as usize].map(|v| self.places[v as usize]);
                let (square, shares) = to_triangle(collapse.place, corners);
                let of = wedges.of(face);
                (square, [0, 1, 2].map(|k| (shares[k], of[k])))
            });
            let nearest = nearest.min_by(|a, b| a.0.total_cmp(&b.0));
            (*side, nearest.map_or([(1.0, side[0]); 3], |(_, parts)| parts))
        });
        let mixed = Vec::from_iter(mixed);
        let replaced = self.around[b as usize].iter().filter_map(|&face| {
            let corner = self.corner(face, b)?;
            let side = sides.iter().find(|side| side[1] == wedges.of(face)[corner])?;
            Some((face, corner, side[0]))
        });
        let replaced = Vec::from_iter(replaced);
        let time = self.merges.len() as u32;
        if let Some(wedges) = &mut self.wedges {
            wedges.merge(time, mixed.into_iter());
            for (face, corner, wedge) in replaced {
                wedges.replace(face, corner, wedge);
            }
        }
    }

    /// What is left, vertices and faces in their old order.
    pub(super) fn into_mesh(self, mesh: &Mesh) -> Result<Mesh, MeshError> {
        const GONE: u32 = u32::MAX;
        let faces: Vec<_> = (0..self.alive.len()).filter(|&face| self.alive[face]).collect();
        let mut names = vec![GONE; self.places.len()];
        let corners = faces.iter().flat_map(|&face| self.triangles[face]);
        corners.for_each(|vertex| names[vertex as usize] = 0);
        let kept: Vec<_> = (0..names.len() as u32).filter(|&v| names[v as usize] != GONE).collect();
        (0..).zip(&kept).for_each(|(new, &old)| names[old as usize] = new);
        let places: Vec<_> = kept.iter().map(|&vertex| self.places[vertex as usize]).collect();
        let triangles = faces.iter().map(|&face| self.triangles[face].map(|v| names[v as usize]));
        let creases = kept.iter().flat_map(|&a| self.sharp[a as usize].iter().map(move |s| (a, s)));
        let creases = creases.filter(|(a, (b, sharpness))| a < b && *sharpness > 0.0);
        let creases = creases.map(|(a, (b, s))| ([a, *b].map(|v| names[v as usize]), *s));
        let mut simple = Mesh::new(places, Faces::triangles(triangles.collect()))?
            .with_creases(creases)?
            .with_materials(mesh.materials().clone())
            .with_frame(mesh.frame().copied());
        let merged = Merged { merges: &self.merges, kept: &kept };
        for (name, attribute) in mesh.vertex().iter().filter(|(name, _)| *name != "normal") {
            simple = simple.with_vertex(name, merged.attribute(attribute))?;
        }
        let parents: Vec<_> = faces.iter().map(|&face| self.parents[face]).collect();
        for (name, attribute) in mesh.face().iter() {
            simple = simple.with_face(name, attribute.select(&parents))?;
        }
        if let Some(wedges) = &self.wedges {
            for (name, attribute) in wedges.attributes(mesh, &faces) {
                simple = simple.with_corner(name, attribute)?;
            }
        }
        Ok(simple)
    }
}

/// Vertex attributes, mixed as the vertices were.
struct Merged<'a> {
    merges: &'a [([u32; 2], f64)],
    kept: &'a [u32],
}

impl Carry for Merged<'_> {
    fn column<T: Mix>(&self, old: &[T]) -> Vec<T> {
        let mut mixed = old.to_vec();
        for &([a, b], share) in self.merges {
            let [stays, goes] = [a, b].map(|end| mixed[end as usize]);
            // Indices have no mean: the nearer one comes first.
            let mut parts = [(1.0 - share, stays), (share, goes)];
            if share > 0.5 {
                parts.reverse();
            }
            mixed[a as usize] = T::mix(parts.into_iter());
        }
        self.kept.iter().map(|&vertex| mixed[vertex as usize]).collect()
    }
}
