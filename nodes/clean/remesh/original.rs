//! The original surface: its triangles with their neighbors, and the curves and corners that are kept.

use maquette_base::linear::attribute_transfer::AttributeTransfer;
use maquette_base::linear::weighted_mean::WeightedMean;
use maquette_base::topology::flat_faces::unit_normals;
use maquette_base::topology::union_find::UnionFind;
use maquette_node::{Error, bail};
use maquette_value::{Faces, Mesh, MeshError, NearestPoint};
use nalgebra::{Point3, Vector3};

use super::curves::Curves;
use super::net::{Kind, NONE, Net, next, previous};
use super::sheet::Sheet;

/// Cosine of the angle, 45 degrees, by which a curve must turn between two points an edge length apart to have a corner.
const CORNER_COSINE: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Minimum total length of a connected set of sharp edges, in target edge lengths; shorter sets count as noise.
const MIN_CREASE: f64 = 2.0;

/// The original surface, on which new vertices are placed.
pub(super) struct Original<'a> {
    pub mesh: &'a Mesh,
    pub sheet: Sheet<'a>,
    pub curves: Curves,
}

impl<'a> Original<'a> {
    /// Returns the original surface with its feature curves, and its triangles as half-edges. A vertex that joins several fans of faces is
    /// split into one vertex for each fan.
    ///
    /// # Errors
    /// Returns an error if an edge has more than two faces, or its faces are oriented inconsistently.
    pub(super) fn new(mesh: &'a Mesh, length: f64, angle: f64) -> Result<(Self, Net), Error> {
        let faces = Faces::triangles(mesh.triangles().into_owned());
        let edges = faces.edges();
        let crowded = edges.faces.iter().filter(|&&faces| 2 < faces).count();
        if let Some(first) = edges.faces.iter().position(|&faces| 2 < faces) {
            let [a, b] = edges.vertices[first].map(|end| mesh.positions()[end as usize]);
            let at = nalgebra::center(&a, &b);
            bail!(
                "{crowded} edges have more than two faces, the first one at ({:.3}, {:.3}, {:.3}): the mesh is not a surface there; use `Reconstruct` to make one of it",
                at.x,
                at.y,
                at.z
            );
        }
        if edges.misoriented > 0 {
            bail!(
                "{} edges have faces with different orientations; use `Orient` to make them consistent",
                edges.misoriented
            );
        }
        let mut first = vec![NONE; edges.vertices.len()];
        let mut twins = vec![NONE; edges.of_corner.len()];
        for (h, &edge) in (0..).zip(&edges.of_corner) {
            match first[edge as usize] {
                NONE => first[edge as usize] = h,
                other => (twins[h as usize], twins[other as usize]) = (other, h),
            }
        }
        let triangles = faces.as_triangles().unwrap_or_default();
        let sheet = Sheet::new(mesh, twins.clone());
        let mut net = Net::new(mesh.positions().to_vec(), triangles, twins);
        find_features(mesh, sheet.parents(), length, angle, &mut net);
        part_fans(&mut net);
        find_corners(&mut net, length);
        let curves = Curves::trace(&mut net);
        Ok((Self { mesh, sheet, curves }, net))
    }

    /// Builds the mesh of the current triangles; vertices and faces get the attributes of the original surface at their positions.
    pub(super) fn into_mesh(self, net: &Net) -> Result<Mesh, MeshError> {
        let mesh = self.mesh;
        let mut names = vec![NONE; net.places.len()];
        let (mut places, mut near) = (Vec::new(), Vec::new());
        for vertex in (0..net.places.len()).filter(|&vertex| net.leaving[vertex] != NONE) {
            names[vertex] = places.len() as u32;
            places.push(net.places[vertex]);
            near.push(net.near[vertex]);
        }
        let triangles = (0..net.from.len() as u32 / 3).filter_map(|index| net.triangle(index));
        let triangles = Vec::from_iter(triangles);
        let starts: Vec<_> = triangles.iter().map(|it| net.near[it[0] as usize]).collect();
        let middles: Vec<_> = triangles.iter().map(|&it| net.middle(it)).collect();
        let triangles: Vec<_> =
            triangles.iter().map(|it| it.map(|vertex| names[vertex as usize])).collect();
        let creases = net.edges().filter_map(|h| {
            let feature = net.features[h as usize].filter(|feature| feature.sharpness > 0.0)?;
            let ends = [net.from(h), net.end(h)].map(|vertex| names[vertex as usize]);
            Some((ends, feature.sharpness))
        });
        let creases = Vec::from_iter(creases);
        let of_vertices = AtPlaces { mesh, found: self.sheet.nearest(&places, &near) };
        let of_faces = self.sheet.nearest(&middles, &starts);
        let of_faces: Vec<_> = of_faces.iter().map(|place| place.face).collect();
        let mut even = Mesh::new(places, Faces::triangles(triangles))?
            .with_creases(creases)?
            .with_materials(mesh.materials().clone())
            .with_frame(mesh.frame().copied());
        for (name, attribute) in mesh.vertex().iter().filter(|(name, _)| *name != "normal") {
            even = even.with_vertex(name, of_vertices.attribute(attribute))?;
        }
        for (name, attribute) in mesh.face().iter() {
            even = even.with_face(name, attribute.select(&of_faces))?;
        }
        Ok(even)
    }
}

/// A vertex attribute, evaluated at points of a mesh.
struct AtPlaces<'a> {
    mesh: &'a Mesh,
    found: Vec<NearestPoint>,
}

impl AttributeTransfer for AtPlaces<'_> {
    fn column<T: WeightedMean>(&self, old: &[T]) -> Vec<T> {
        let corners = self.mesh.faces().corners();
        self.found
            .iter()
            .map(|place| {
                let vertices = place.corners.map(|corner| corners[corner as usize]);
                let parts = [0, 1, 2].map(|k| (place.barycentric[k], old[vertices[k] as usize]));
                // Indices have no mean, and take the value of the vertex with the largest weight. Vertices of weight 0 are left out,
                // because they must not set a flag.
                let mut parts: Vec<_> =
                    parts.into_iter().filter(|(share, _)| *share > 0.0).collect();
                parts.sort_by(|a, b| b.0.total_cmp(&a.0));
                T::weighted_mean(parts.into_iter())
            })
            .collect()
    }
}

/// Finds the feature edges: borders, creases, and edges whose faces meet at more than `angle` degrees. A connected set of sharp edges with
/// a small total length is noise and is left out.
fn find_features(mesh: &Mesh, parents: &[u32], length: f64, angle: f64, net: &mut Net) {
    let given: Vec<_> = mesh.creases().filter(|(_, sharpness)| *sharpness > 0.0).collect();
    let cosine = libm::cos(angle.to_radians());
    let normals = unit_normals(mesh, &mesh.edges());
    let mut bent = Vec::new();
    for h in Vec::from_iter(net.edges()) {
        let (a, b, twin) = (net.from(h), net.end(h), net.twin(h));
        let ends = [a.min(b), a.max(b)];
        let crease = given.binary_search_by_key(&ends, |(ends, _)| *ends);
        let feature = match crease {
            Ok(crease) => Some(given[crease].1),
            Err(_) => (twin == NONE).then_some(0.0),
        };
        if let Some(sharpness) = feature {
            net.set_feature(h, sharpness);
        } else {
            let [own, other] = [h, twin].map(|h| parents[h as usize / 3] as usize);
            let (p, q) = (normals[own], normals[other]);
            if own != other && p.dot(&q) < cosine * p.norm() * q.norm() {
                bent.push(h);
            }
        }
    }
    let mut parts = UnionFind::new(net.places.len());
    bent.iter().for_each(|&h| {
        parts.union(net.from(h), net.end(h));
    });
    let mut lengths = vec![0.0; net.places.len()];
    for &h in &bent {
        lengths[parts.find(net.from(h)) as usize] += net.square(h).sqrt();
    }
    for h in bent {
        if MIN_CREASE * length <= lengths[parts.find(net.from(h)) as usize] {
            net.set_feature(h, 0.0);
        }
    }
}

/// Splits vertices that several fans of triangles share: each fan gets a vertex of its own. Triangles that share an edge stay connected.
fn part_fans(net: &mut Net) {
    let mut is_seen = vec![false; net.from.len()];
    let mut is_taken = vec![false; net.places.len()];
    for start in 0..net.from.len() as u32 {
        if is_seen[start as usize] {
            continue;
        }
        let old = net.from(start);
        let mut vertex = old;
        if std::mem::replace(&mut is_taken[old as usize], true) {
            vertex = net.places.len() as u32;
            net.places.push(net.place(old));
            net.leaving.push(start);
            net.near.push(start / 3);
            net.kinds.push(Kind::Corner);
            net.kinds[old as usize] = Kind::Corner;
        }
        net.leaving[vertex as usize] = start;
        net.near[vertex as usize] = start / 3;
        let mut fan = Vec::new();
        net.visit(vertex, |h| fan.push(h));
        for h in fan {
            is_seen[h as usize] = true;
            net.from[h as usize] = vertex;
        }
    }
}

/// Determines how vertices on feature curves may move. A vertex is fixed where curves end or meet, or where a curve bends sharply within
/// `length`.
fn find_corners(net: &mut Net, length: f64) {
    // For each vertex, its two neighbors along the feature curve that contains it; [`NONE`] for missing neighbors.
    let mut beside = vec![[NONE; 2]; net.places.len()];
    let mut counts = vec![0u32; net.places.len()];
    for h in net.edges().filter(|&h| net.is_feature(h)) {
        for (vertex, other) in [(net.from(h), net.end(h)), (net.end(h), net.from(h))] {
            let count = &mut counts[vertex as usize];
            if let Some(place) = beside[vertex as usize].get_mut(*count as usize) {
                *place = other;
            }
            *count += 1;
        }
    }
    for (kind, &count) in net.kinds.iter_mut().zip(&counts) {
        *kind = match (*kind, count) {
            (Kind::Smooth, 0) => Kind::Smooth,
            (Kind::Smooth, 2) => Kind::Curve,
            _ => Kind::Corner,
        };
    }
    // Walks along a curve from a vertex to one side, and visits the vertices closer than `reach`. Returns the vertex at which the walk
    // ends.
    let walk = |start: u32, side: usize, reach: f64, see: &mut dyn FnMut(u32)| {
        let (mut before, mut at, mut gone) = (start, beside[start as usize][side], 0.0);
        loop {
            gone += (net.place(at) - net.place(before)).norm();
            if gone < reach {
                see(at);
            }
            if reach <= gone || counts[at as usize] != 2 || at == start {
                return at;
            }
            let [p, q] = beside[at as usize];
            (before, at) = (at, if p == before { q } else { p });
        }
    };
    let mut turns = Vec::new();
    for vertex in (0..net.places.len() as u32).filter(|&vertex| net.kind(vertex) == Kind::Curve) {
        let [p, q] = [0, 1].map(|side| net.place(walk(vertex, side, length, &mut |_| {})));
        let (to, from) = (net.place(vertex) - p, q - net.place(vertex));
        let cosine = to.dot(&from) / (to.norm() * from.norm());
        if cosine < CORNER_COSINE {
            turns.push((cosine, vertex));
        }
    }
    turns.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut is_beside = vec![false; net.places.len()];
    let mut corners = Vec::new();
    for (_, vertex) in turns {
        if !is_beside[vertex as usize] {
            corners.push(vertex);
            for side in [0, 1] {
                walk(vertex, side, length / 2.0, &mut |near| is_beside[near as usize] = true);
            }
        }
    }
    corners.into_iter().for_each(|vertex| net.kinds[vertex as usize] = Kind::Corner);
}

impl Net {
    /// Returns the middle of a triangle.
    pub(super) fn middle(&self, triangle: [u32; 3]) -> Point3<f64> {
        let [a, b, c] = triangle.map(|vertex| self.place(vertex).coords);
        Point3::from((a + b + c) / 3.0)
    }

    /// Returns the normal at a vertex, whose length is twice the area around the vertex, and the centroid of that area.
    pub(super) fn normal_and_center(&self, vertex: u32) -> (Vector3<f64>, Point3<f64>) {
        let (mut normal, mut sum, mut total) = (Vector3::zeros(), Vector3::zeros(), 0.0);
        let at = self.place(vertex);
        self.visit(vertex, |h| {
            let [b, c] = [next(h), previous(h)].map(|h| self.place(self.from(h)) - at);
            let area = b.cross(&c);
            let weight = area.norm();
            normal += area;
            sum += (b + c) * (weight / 3.0);
            total += weight;
        });
        (normal, if total > 0.0 { at + sum / total } else { at })
    }
}
