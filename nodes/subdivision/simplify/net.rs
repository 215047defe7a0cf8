//! The triangle mesh during a simplification, with the costs of edge collapses.

use std::cmp::Ordering;
use std::{iter, mem, thread};

use maquette_base::linear::attribute_transfer::AttributeTransfer;
use maquette_base::linear::weighted_mean::WeightedMean;
use maquette_value::parallel::*;
use maquette_value::{Faces, Mesh, MeshError, closest_on_triangle};
use nalgebra::{Point3, Vector3, center};

use super::quadric::Quadric;
use super::wedges::{Side, Wedges};

/// The weight of the planes that preserve borders and creases, relative to the weight of the planes of faces.
const BORDER_WEIGHT: f64 = 1000.0;

/// The weight of the planes that preserve seams, relative to the weight of the planes of faces. It is small because the cost of the texture
/// shift preserves seams, too, and because the planes at a zigzag seam intersect far from the surface.
const SEAM_WEIGHT: f64 = 0.1;

/// The minimum cosine of the angle between the old and the new normal of a face: the cosine of 75 degrees.
const MIN_COSINE: f64 = 0.25881904510252074;

/// A face whose area is less than this fraction of the squared diagonal of the mesh's bounding box counts as degenerate.
const MIN_AREA: f64 = 1e-20;

/// An edge that may be collapsed, with the cost of the collapse and the position of the merged vertex.
#[derive(Clone, Copy, Debug)]
pub(super) struct Collapse {
    pub(super) cost: f64,
    /// The squared length of the edge that is collapsed.
    pub(super) length_sq: f64,
    /// The vertex that is kept and the vertex that is removed, in this order.
    pub(super) ends: [u32; 2],
    /// The versions that both vertices had when the cost was computed. Another version means that the cost is outdated.
    versions: [u32; 2],
    position: Point3<f64>,
}

/// Orders collapses by cost, then by length, then by vertex indices.
///
/// In a plane all costs are 0. If the length were ignored, one vertex would absorb all others, and each collapse would visit all faces
/// around that vertex.
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

/// The triangles of a mesh during the simplification.
pub(super) struct Net {
    positions: Vec<Point3<f64>>,
    /// The point to which positions in quadrics are relative. Their rounding errors grow with the square of the distance from it, so it is
    /// near the mesh. It is on none of the planes, so that a quadric can tell its own rounding errors.
    origin: Point3<f64>,
    quadrics: Vec<Quadric>,
    /// The version of each vertex: the number of collapses in which the vertex was an end of the collapsed edge.
    versions: Vec<u32>,
    triangles: Vec<[u32; 3]>,
    /// The face of the input mesh that contains each triangle.
    parents: Vec<u32>,
    alive: Vec<bool>,
    pub(super) n_faces: usize,
    /// The triangles around each vertex.
    around: Vec<Vec<u32>>,
    /// For each vertex its sharp edges: the vertex at the other end and the sharpness. Border edges are included with the sharpness 0.
    sharp: Vec<Vec<(u32, f64)>>,
    min_area: f64,
    /// The wedges (sets of corners with equal attributes), if the mesh has corner attributes.
    wedges: Option<Wedges>,
    /// The history of merges: the vertex that was kept, the vertex that was removed, and the weight of the removed one in the mean of their
    /// attributes.
    merges: Vec<([u32; 2], f64)>,
}

impl Drop for Net {
    /// Frees the many lists of a large mesh on another thread, since nobody has to wait for that.
    fn drop(&mut self) {
        const MANY: usize = 1 << 18;
        let lists = mem::take(&mut self.around);
        if MANY < lists.len() {
            // Ignore an error: if the thread cannot be started, the lists are dropped here.
            let _ = thread::Builder::new().spawn(move || drop(lists));
        }
    }
}

impl Net {
    pub(super) fn new(mesh: &Mesh) -> Self {
        let positions = mesh.positions().to_vec();
        let corners = mesh.triangle_corners();
        let triangles: Vec<_> = corners
            .iter()
            .map(|it| it.map(|corner: u32| mesh.faces().corners()[corner as usize]))
            .collect();
        let parents = (0..).zip(mesh.faces().iter());
        let parents = parents.flat_map(|(parent, face)| iter::repeat_n(parent, face.len() - 2));
        let parents: Vec<_> = parents.collect();
        let mut around = vec![Vec::new(); positions.len()];
        for (index, triangle) in (0..).zip(&triangles).until_stopped() {
            triangle.iter().for_each(|&vertex| around[vertex as usize].push(index));
        }
        let (low, high) = mesh.bounds().unwrap_or_default();
        let diagonal = (high - low).norm();
        let origin = low - diagonal * Vector3::new(0.71, 0.83, 0.97);
        let n_faces = triangles.len();
        let mut net = Self {
            quadrics: vec![Quadric::default(); positions.len()],
            versions: vec![0; positions.len()],
            alive: vec![true; n_faces],
            sharp: vec![Vec::new(); positions.len()],
            min_area: MIN_AREA * diagonal * diagonal,
            merges: Vec::new(),
            wedges: Wedges::new(mesh, origin, &triangles, &corners),
            positions,
            origin,
            triangles,
            parents,
            n_faces,
            around,
        };
        net.add_planes(mesh);
        net
    }

    /// Adds to the cost functions the planes of all faces, and the planes that preserve borders, creases and seams.
    fn add_planes(&mut self, mesh: &Mesh) {
        let net = &*self;
        let planes: Vec<Quadric> =
            self.triangles.par_iter().with_min_len(1024).map(|&face| net.plane(face)).collect();
        let vertices = self.around.par_iter().with_min_len(1024);
        self.quadrics = vertices
            .map(|faces| {
                faces.iter().fold(Quadric::default(), |sum, &face| sum + planes[face as usize])
            })
            .collect();
        let edges = mesh.edges();
        let borders = edges.vertices.iter().zip(&edges.faces).until_stopped();
        let borders = borders.filter(|(_, faces)| **faces == 1);
        let borders = borders.map(|(&ends, _)| (ends, 0.0, BORDER_WEIGHT));
        let creases = mesh.creases().filter(|(_, sharpness)| *sharpness > 0.0);
        let creases = creases.map(|(ends, sharpness)| (ends, sharpness, BORDER_WEIGHT));
        let seams = self.seams().into_iter().map(|ends| (ends, 0.0, SEAM_WEIGHT));
        for (ends, sharpness, weight) in creases.chain(borders).chain(seams) {
            let [a, b] = ends;
            if self.sharp[a as usize].iter().any(|(end, _)| *end == b) {
                continue;
            }
            self.sharp[a as usize].push((b, sharpness));
            self.sharp[b as usize].push((a, sharpness));
            self.add_border_planes(ends, weight);
        }
    }

    /// Returns the squared distance from the plane of a triangle, times its area.
    fn plane(&self, triangle: [u32; 3]) -> Quadric {
        let area = self.area(triangle);
        let Some(normal) = area.try_normalize(0.0) else { return Quadric::default() };
        let first = self.positions[triangle[0] as usize] - self.origin;
        Quadric::plane(normal, first, area.norm() / 2.0)
    }

    /// Returns the edges at which the two adjacent faces have different wedges.
    fn seams(&self) -> Vec<[u32; 2]> {
        let Some(wedges) = &self.wedges else { return Vec::new() };
        let mut sides = Vec::with_capacity(3 * self.triangles.len());
        for (index, corners) in (0..).zip(&self.triangles).until_stopped() {
            let of = wedges.triangle_wedges(index);
            sides.extend([(0, 1), (1, 2), (2, 0)].map(|(k, l)| {
                if corners[k] < corners[l] {
                    ([corners[k], corners[l]], [of[k], of[l]])
                } else {
                    ([corners[l], corners[k]], [of[l], of[k]])
                }
            }));
        }
        sides.par_sort_unstable();
        let edges = sides.chunk_by(|a, b| a.0 == b.0);
        let seams = edges.filter(|edge| edge.iter().any(|side| side.1 != edge[0].1));
        seams.map(|edge| edge[0].0).collect()
    }

    /// Returns the two sides of an edge (one at a border); equal sides are listed once. Also returns, for each end of the edge, true if the
    /// end has a wedge that belongs to no side of the edge.
    fn edge_sides(&self, [a, b]: [u32; 2]) -> (Vec<Side>, [bool; 2]) {
        let Some(wedges) = &self.wedges else { return Default::default() };
        let mut sides = Vec::new();
        for &face in &self.around[a as usize] {
            if let (Some(k), Some(l)) = (self.corner(face, a), self.corner(face, b)) {
                let of = wedges.triangle_wedges(face);
                sides.push([of[k], of[l]]);
            }
        }
        sides.sort_unstable();
        sides.dedup();
        let others = [(0, a), (1, b)].map(|(end, vertex)| {
            self.around[vertex as usize].iter().any(|&face| {
                let wedge = self.corner(face, vertex).map(|k| wedges.triangle_wedges(face)[k]);
                !sides.iter().any(|side| Some(side[end]) == wedge)
            })
        });
        (sides, others)
    }

    /// Returns the index, from 0 to 2, of the corner of a face that is at a vertex; `None` if the face does not contain the vertex.
    fn corner(&self, face: u32, vertex: u32) -> Option<usize> {
        self.triangles[face as usize].iter().position(|&corner| corner == vertex)
    }

    /// Adds to the cost functions planes through an edge, each perpendicular to one of the edge's faces, with the given weight.
    fn add_border_planes(&mut self, [a, b]: [u32; 2], weight: f64) {
        let along = self.positions[b as usize] - self.positions[a as usize];
        let at = self.positions[a as usize] - self.origin;
        let faces = self.around[a as usize].iter().map(|&face| self.triangles[face as usize]);
        let faces: Vec<_> = faces.filter(|face| face.contains(&b)).collect();
        for face in faces {
            if let Some(normal) = along.cross(&self.area(face)).try_normalize(0.0) {
                let plane = Quadric::plane(normal, at, weight * along.norm_squared());
                [a, b].iter().for_each(|&end| self.quadrics[end as usize] += plane);
            }
        }
    }

    /// Returns the area vector of a triangle: it is normal to the triangle, and its length is twice the triangle's area.
    fn area(&self, triangle: [u32; 3]) -> Vector3<f64> {
        let [a, b, c] = triangle.map(|vertex| self.positions[vertex as usize]);
        (b - a).cross(&(c - a))
    }

    /// Computes the cost of the collapse of each edge.
    pub(super) fn collapses(&self) -> Vec<Collapse> {
        let edges = Faces::triangles(self.triangles.clone()).edges().vertices;
        edges.par_iter().with_min_len(256).filter_map(|&edge| self.collapse(edge)).collect()
    }

    /// The number of vertices of the input mesh.
    pub(super) fn vertices(&self) -> usize {
        self.positions.len()
    }

    /// The corners of all faces around a vertex.
    pub(super) fn corners_around(&self, vertex: u32) -> impl Iterator<Item = u32> {
        self.around[vertex as usize].iter().flat_map(|&face| self.triangles[face as usize])
    }

    /// The neighbors of a vertex, ascending.
    pub(super) fn neighbors(&self, vertex: u32) -> Vec<u32> {
        let corners = self.corners_around(vertex);
        let mut neighbors: Vec<_> = corners.filter(|&corner| corner != vertex).collect();
        neighbors.sort_unstable();
        neighbors.dedup();
        neighbors
    }

    fn is_sharp(&self, [a, b]: [u32; 2]) -> bool {
        self.sharp[a as usize].iter().any(|(end, _)| *end == b)
    }

    /// Computes the cost of collapsing an edge. Returns `None` if creases do not allow the collapse.
    pub(super) fn collapse(&self, [a, b]: [u32; 2]) -> Option<Collapse> {
        let ends = [a.min(b), a.max(b)];
        let mut quadric = self.quadrics[a as usize] + self.quadrics[b as usize];
        let (sides, others) = self.edge_sides(ends);
        if let Some(wedges) = &self.wedges {
            quadric += wedges.cost(&sides);
        }
        let [first, second] = ends.map(|end| self.positions[end as usize]);
        let sharp_edge = self.is_sharp(ends);
        // A vertex is fixed if it is the end of a crease or on several creases. When a smooth edge is collapsed, every vertex of a crease
        // is fixed. A vertex with a wedge that is on no side of the edge is fixed, too, so this wedge need not change.
        let is_fixed = [0, 1].map(|end| {
            others[end]
                || match self.sharp[ends[end] as usize].len() {
                    0 => false,
                    2 => !sharp_edge,
                    _ => true,
                }
        });
        let (positions, count) = match is_fixed {
            [true, true] => return None,
            [true, false] => ([first; 3], 1),
            [false, true] => ([second; 3], 1),
            [false, false] => match quadric.minimum() {
                // If costs are equal the first candidate wins. The ends of the edge come before the minimum, because they are exactly on
                // the surface.
                Some(lowest) => ([first, second, self.origin + lowest], 3),
                None => ([center(&first, &second), first, second], 3),
            },
        };
        let costs = positions[..count]
            .iter()
            .map(|&position| (quadric.evaluate(position - self.origin), position));
        let (cost, position) = costs.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let versions = ends.map(|end| self.versions[end as usize]);
        let length_sq = (second - first).norm_squared();
        Some(Collapse { cost, length_sq, ends, versions, position })
    }

    /// Returns true if neither end of the edge has changed since the cost of the collapse was computed.
    pub(super) fn is_current(&self, collapse: &Collapse) -> bool {
        collapse.ends.map(|end| self.versions[end as usize]) == collapse.versions
    }

    /// Returns true if the surface stays manifold and no face flips.
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
        // The link condition also concerns edges (Dey et al., "Topology preserving edge contraction", 1999). A side that joins both apexes
        // in a face at `a` and in a face at `b` would get two equal faces, as when an edge of a tetrahedron is collapsed.
        if let [c, d] = apexes[..]
            && [a, b].iter().all(|&end| self.has_face([end, c, d]))
        {
            return false;
        }
        // If the two other sides of a triangle at the edge are both sharp, the collapse would merge them into one sharp edge.
        !apexes.iter().any(|v| self.is_sharp([a, *v]) && self.is_sharp([b, *v]))
            && self.keeps_sides(collapse, a, b)
            && self.keeps_sides(collapse, b, a)
    }

    /// Returns true if there is a face with these vertices.
    fn has_face(&self, vertices: [u32; 3]) -> bool {
        let mut faces = self.around[vertices[0] as usize].iter();
        faces.any(|&face| vertices.iter().all(|v| self.triangles[face as usize].contains(v)))
    }

    /// Returns true if the faces of `vertex` keep their orientation and some area when it moves to its new position. Faces that also have
    /// the vertex `other` are not checked, because the collapse removes them.
    fn keeps_sides(&self, collapse: &Collapse, vertex: u32, other: u32) -> bool {
        let faces = self.around[vertex as usize].iter().map(|&face| self.triangles[face as usize]);
        let mut faces = faces.filter(|face| !face.contains(&other));
        faces.all(|face| {
            let before = self.area(face);
            let [p, q, r] =
                face.map(
                    |v: u32| {
                        if v == vertex { collapse.position } else { self.positions[v as usize] }
                    },
                );
            let after = (q - p).cross(&(r - p));
            let turned = before.dot(&after) < MIN_COSINE * before.norm() * after.norm();
            // A face that was degenerate before may stay degenerate.
            let lost = after.norm() < self.min_area && self.min_area <= before.norm();
            !turned && !lost
        })
    }

    pub(super) fn apply(&mut self, collapse: &Collapse) {
        let [a, b] = collapse.ends;
        let [first, second] = collapse.ends.map(|end| self.positions[end as usize]);
        let along = second - first;
        let share = (collapse.position - first).dot(&along) / along.norm_squared();
        self.merges.push(([a, b], if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) }));
        self.merge_wedges(collapse);
        for face in mem::take(&mut self.around[b as usize]) {
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
        for (end, sharpness) in mem::take(&mut self.sharp[b as usize]) {
            self.sharp[end as usize].retain(|(other, _)| *other != b);
            if end != a {
                self.sharp[end as usize].push((a, sharpness));
                self.sharp[a as usize].push((end, sharpness));
            }
        }
        let quadric = self.quadrics[b as usize];
        self.quadrics[a as usize] += quadric;
        self.positions[a as usize] = collapse.position;
        [a, b].iter().for_each(|&end| self.versions[end as usize] += 1);
    }

    /// Merges the two wedges on each side of an edge. On each side, the merged wedge gets the attributes of that point of the old surface,
    /// on this side, that is nearest to the new vertex.
    fn merge_wedges(&mut self, collapse: &Collapse) {
        let [a, b] = collapse.ends;
        let (sides, _) = self.edge_sides([a, b]);
        let Some(wedges) = &self.wedges else { return };
        let faces = || self.around[a as usize].iter().chain(&self.around[b as usize]).copied();
        let mixed = sides.iter().map(|side| {
            let on_side = faces()
                .filter(|&face| wedges.triangle_wedges(face).iter().any(|it| side.contains(it)));
            let nearest = on_side.map(|face| {
                let corners = self.triangles[face as usize].map(|v| self.positions[v as usize]);
                let (square, shares) = closest_on_triangle(collapse.position, corners);
                let of = wedges.triangle_wedges(face);
                (square, [0, 1, 2].map(|k| (shares[k], of[k])))
            });
            let nearest = nearest.min_by(|a, b| a.0.total_cmp(&b.0));
            (*side, nearest.map_or([(1.0, side[0]); 3], |(_, parts)| parts))
        });
        let mixed: Vec<_> = mixed.collect();
        let replaced = self.around[b as usize].iter().filter_map(|&face| {
            let corner = self.corner(face, b)?;
            let side = sides.iter().find(|side| side[1] == wedges.triangle_wedges(face)[corner])?;
            Some((face, corner, side[0]))
        });
        let replaced: Vec<_> = replaced.collect();
        let time = self.merges.len() as u32;
        if let Some(wedges) = &mut self.wedges {
            wedges.merge(time, mixed.into_iter());
            for (face, corner, wedge) in replaced {
                wedges.replace(face, corner, wedge);
            }
        }
    }

    /// Builds the resulting mesh. Vertices and faces keep their order.
    pub(super) fn into_mesh(self, mesh: &Mesh) -> Result<Mesh, MeshError> {
        const REMOVED: u32 = u32::MAX;
        let faces: Vec<_> = (0..self.alive.len()).filter(|&face| self.alive[face]).collect();
        let mut indices = vec![REMOVED; self.positions.len()];
        let corners = faces.iter().flat_map(|&face| self.triangles[face]);
        corners.for_each(|vertex| indices[vertex as usize] = 0);
        let kept: Vec<_> =
            (0..indices.len() as u32).filter(|&v| indices[v as usize] != REMOVED).collect();
        (0..).zip(&kept).for_each(|(new, &old)| indices[old as usize] = new);
        let positions: Vec<_> =
            kept.iter().map(|&vertex| self.positions[vertex as usize]).collect();
        let triangles = faces.iter().map(|&face| self.triangles[face].map(|v| indices[v as usize]));
        let creases = kept.iter().flat_map(|&a| self.sharp[a as usize].iter().map(move |s| (a, s)));
        let creases = creases.filter(|(a, (b, sharpness))| a < b && *sharpness > 0.0);
        let creases = creases.map(|(a, (b, s))| ([a, *b].map(|v| indices[v as usize]), *s));
        let mut simple = Mesh::new(positions, Faces::triangles(triangles.collect()))?
            .with_creases(creases)?
            .with_materials(mesh.materials().clone())
            .with_frame(mesh.frame().copied());
        let merged = MergedAttributes { merges: &self.merges, kept: &kept };
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

/// Transfers vertex attributes by repeating the merges of vertices in their order.
struct MergedAttributes<'a> {
    merges: &'a [([u32; 2], f64)],
    kept: &'a [u32],
}

impl AttributeTransfer for MergedAttributes<'_> {
    fn column<T: WeightedMean>(&self, old: &[T]) -> Vec<T> {
        let mut mixed = old.to_vec();
        for &([a, b], share) in self.merges.iter().until_stopped() {
            let [stays, goes] = [a, b].map(|end| mixed[end as usize]);
            // Integer indices have no mean; the mean takes the index of the first part. Therefore put the nearer vertex first.
            let mut parts = [(1.0 - share, stays), (share, goes)];
            if share > 0.5 {
                parts.reverse();
            }
            mixed[a as usize] = T::weighted_mean(parts.into_iter());
        }
        self.kept.iter().map(|&vertex| mixed[vertex as usize]).collect()
    }
}
