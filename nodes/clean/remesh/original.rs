//! The surface that is given new triangles: as triangles that know their neighbors, and as what new vertices are put on.

use std::iter;

use maquette_base::linear::carry::Carry;
use maquette_base::linear::mix::Mix;
use maquette_base::topology::union_find::UnionFind;
use maquette_value::{Faces, Mesh, MeshError, NearestPlace, TriangleTree};
use nalgebra::{Point3, Vector3};

use super::net::{Kind, NONE, Net, next, previous};
use crate::remesh_error::RemeshError;

/// A curve that turns by more than this between two places that are an edge's length away has a corner: the cosine of 45 degrees.
const CORNER_COSINE: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Creases that are shorter than so many edges in all are noise.
const LEAST_CREASE: f64 = 2.0;

/// The surface before.
pub(super) struct Original<'a> {
    mesh: &'a Mesh,
    tree: TriangleTree,
    /// Its feature curves as triangles without area; none if it has none.
    curves: Option<(Mesh, TriangleTree)>,
}

impl<'a> Original<'a> {
    /// The surface with its features, and its triangles. A vertex that joins several fans of faces becomes one for
    /// each.
    ///
    /// # Errors
    /// If faces around an edge are more than two, or look to different sides.
    pub(super) fn new(mesh: &'a Mesh, length: f64, angle: f64) -> Result<(Self, Net), RemeshError> {
        let parents = (0u32..).zip(mesh.faces().iter());
        let parents = parents.flat_map(|(parent, face)| iter::repeat_n(parent, face.len() - 2));
        let parents = Vec::from_iter(parents);
        let faces = Faces::triangles(mesh.triangles().into_owned());
        let edges = faces.edges();
        let crowded = edges.faces.iter().filter(|&&faces| 2 < faces).count();
        if crowded > 0 {
            return Err(RemeshError::Crowded { edges: crowded });
        }
        if edges.misoriented > 0 {
            return Err(RemeshError::Twisted { edges: edges.misoriented });
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
        let mut net = Net::new(mesh.positions().to_vec(), triangles, twins);
        find_features(mesh, &parents, length, angle, &mut net);
        part_fans(&mut net);
        find_corners(&mut net, length);
        let curves = curves(&net)?;
        Ok((Self { mesh, tree: TriangleTree::new(mesh), curves }, net))
    }

    /// The nearest places of the surface, with its normals there: as long as twice the area of the triangle.
    pub(super) fn on_surface(
        &self,
        points: &[Point3<f64>],
    ) -> Vec<Option<(Point3<f64>, Vector3<f64>)>> {
        let found = self.tree.nearest_to_all(points).into_iter();
        found.map(|place| place.map(|place| on(self.mesh, &place))).collect()
    }

    /// The nearest places of the feature curves.
    pub(super) fn on_curves(&self, points: &[Point3<f64>]) -> Vec<Option<Point3<f64>>> {
        let Some((curves, tree)) = &self.curves else { return vec![None; points.len()] };
        let found = tree.nearest_to_all(points).into_iter();
        found.map(|place| place.map(|place| on(curves, &place).0)).collect()
    }

    /// What the triangles are now, with what lies on the surface in their places.
    pub(super) fn into_mesh(self, net: &Net) -> Result<Mesh, MeshError> {
        let mesh = self.mesh;
        let mut names = vec![NONE; net.places.len()];
        let mut places = Vec::new();
        for vertex in (0..net.places.len()).filter(|&vertex| net.leaving[vertex] != NONE) {
            names[vertex] = places.len() as u32;
            places.push(net.places[vertex]);
        }
        let triangles = (0..net.from.len() as u32 / 3).filter_map(|index| net.triangle(index));
        let triangles: Vec<_> =
            triangles.map(|it| it.map(|vertex| names[vertex as usize])).collect();
        let middles: Vec<_> = triangles
            .iter()
            .map(|&[a, b, c]| {
                let [a, b, c] = [a, b, c].map(|vertex| places[vertex as usize].coords);
                Point3::from((a + b + c) / 3.0)
            })
            .collect();
        let creases = net.edges().filter_map(|h| {
            let sharpness = net.features[h as usize].filter(|sharpness| *sharpness > 0.0)?;
            Some(([net.from(h), net.to(h)].map(|vertex| names[vertex as usize]), sharpness))
        });
        let creases = Vec::from_iter(creases);
        let of_vertices = AtPlaces { mesh, found: self.nearest(&places) };
        let of_faces: Vec<_> = self.nearest(&middles).iter().map(|place| place.face).collect();
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

    fn nearest(&self, points: &[Point3<f64>]) -> Vec<NearestPlace> {
        let found = self.tree.nearest_to_all(points).into_iter();
        // Places so far away that no distance can be told have what is on the first face.
        let far = NearestPlace {
            distance_sq: f64::INFINITY,
            face: 0,
            corners: [0; 3],
            shares: [1.0, 0.0, 0.0],
        };
        found.map(|place| place.unwrap_or(far)).collect()
    }
}

/// Vertex attributes at places of a mesh.
struct AtPlaces<'a> {
    mesh: &'a Mesh,
    found: Vec<NearestPlace>,
}

impl Carry for AtPlaces<'_> {
    fn column<T: Mix>(&self, old: &[T]) -> Vec<T> {
        let corners = self.mesh.faces().corners();
        self.found
            .iter()
            .map(|place| {
                let vertices = place.corners.map(|corner| corners[corner as usize]);
                let parts = [0, 1, 2].map(|k| (place.shares[k], old[vertices[k] as usize]));
                // Indices have no mean: the nearest one comes first. What has no share must not set a flag.
                let mut parts: Vec<_> =
                    parts.into_iter().filter(|(share, _)| *share > 0.0).collect();
                parts.sort_by(|a, b| b.0.total_cmp(&a.0));
                T::mix(parts.into_iter())
            })
            .collect()
    }
}

fn on(mesh: &Mesh, place: &NearestPlace) -> (Point3<f64>, Vector3<f64>) {
    let corners = mesh.faces().corners();
    let [a, b, c] = place.corners.map(|corner| mesh.positions()[corners[corner as usize] as usize]);
    let (ab, ac) = (b - a, c - a);
    (a + ab * place.shares[1] + ac * place.shares[2], ab.cross(&ac))
}

/// Borders, creases, and edges whose faces meet at more than `angle` degrees, unless these are short in all.
fn find_features(mesh: &Mesh, parents: &[u32], length: f64, angle: f64, net: &mut Net) {
    let given: Vec<_> = mesh.creases().filter(|(_, sharpness)| *sharpness > 0.0).collect();
    let cosine = libm::cos(angle.to_radians());
    let mut bent = Vec::new();
    for h in Vec::from_iter(net.edges()) {
        let (a, b, twin) = (net.from(h), net.to(h), net.twin(h));
        let ends = [a.min(b), a.max(b)];
        let crease = given.binary_search_by_key(&ends, |(ends, _)| *ends);
        let feature = match crease {
            Ok(crease) => Some(given[crease].1),
            Err(_) => (twin == NONE).then_some(0.0),
        };
        if let Some(sharpness) = feature {
            net.set_feature(h, sharpness);
        } else if parents[h as usize / 3] != parents[twin as usize / 3] {
            let (p, q) = (net.area(h), net.area(twin));
            if p.dot(&q) < cosine * p.norm() * q.norm() {
                bent.push(h);
            }
        }
    }
    let mut parts = UnionFind::new(net.places.len());
    bent.iter().for_each(|&h| {
        parts.join(net.from(h), net.to(h));
    });
    let mut lengths = vec![0.0; net.places.len()];
    for &h in &bent {
        lengths[parts.first(net.from(h)) as usize] += net.square(h).sqrt();
    }
    for h in bent {
        if LEAST_CREASE * length <= lengths[parts.first(net.from(h)) as usize] {
            net.set_feature(h, 0.0);
        }
    }
}

/// Gives each fan of triangles around a vertex a vertex of its own. What was one before does not move.
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
            net.kinds.push(Kind::Corner);
            net.kinds[old as usize] = Kind::Corner;
        }
        net.leaving[vertex as usize] = start;
        let mut fan = Vec::new();
        net.visit(vertex, |h| fan.push(h));
        for h in fan {
            is_seen[h as usize] = true;
            net.from[h as usize] = vertex;
        }
    }
}

/// Says how far vertices on features may move. Those do not where curves end or meet, and where one turns sharply, seen from `length` away.
fn find_corners(net: &mut Net, length: f64) {
    // The two vertices beside one along its curve; no entry where there is none, or not two.
    let mut beside = vec![[NONE; 2]; net.places.len()];
    let mut counts = vec![0u32; net.places.len()];
    for h in net.edges().filter(|&h| net.is_feature(h)) {
        for (vertex, other) in [(net.from(h), net.to(h)), (net.to(h), net.from(h))] {
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
    // Shows the vertices along a curve, from one into a direction, that are nearer than `reach`; gives the one at which it ends.
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

/// The feature curves as triangles without area.
fn curves(net: &Net) -> Result<Option<(Mesh, TriangleTree)>, MeshError> {
    let mut places = Vec::new();
    for h in net.edges().filter(|&h| net.is_feature(h)) {
        let [a, b] = [net.from(h), net.to(h)].map(|vertex| net.place(vertex));
        places.extend([a, b, b]);
    }
    if places.is_empty() {
        return Ok(None);
    }
    let corners: Vec<_> = (0..places.len() as u32).collect();
    let curves = Mesh::new(places, Faces::uniform(3, corners)?)?;
    let tree = TriangleTree::new(&curves);
    Ok(Some((curves, tree)))
}

impl Net {
    /// The two vertices beside one on a curve.
    pub(super) fn along_curve(&self, vertex: u32) -> Option<[u32; 2]> {
        let (mut found, mut count) = ([NONE; 2], 0);
        self.visit_neighbors(vertex, |other, h| {
            if self.is_feature(h) {
                if let Some(place) = found.get_mut(count) {
                    *place = other;
                }
                count += 1;
            }
        });
        (count == 2).then_some(found)
    }

    /// The normal at a vertex, as long as twice the area around it, and the middle of that area.
    pub(super) fn around(&self, vertex: u32) -> (Vector3<f64>, Point3<f64>) {
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
