//! Adds vertices on the border edges of a mesh.

use std::collections::BTreeMap;

use maquette_base::linear::attribute_transfer::AttributeTransfer;
use maquette_base::linear::stencils::Stencils;
use maquette_value::{Faces, Mesh, MeshError};

/// A new vertex on a border edge.
#[derive(Clone, Copy, Debug)]
pub(super) struct EdgeSplit {
    /// The corner of the edge's face at which the edge begins.
    pub(super) corner: u32,
    /// The position on the edge: 0 at its start, 1 at its end.
    pub(super) at: f64,
    /// The vertex that has the position of the new one.
    pub(super) vertex: u32,
}

/// A mesh whose new vertices come after all others.
pub(super) struct SplitMesh {
    pub(super) mesh: Mesh,
    /// For each new vertex, the vertex at its position.
    pub(super) vertices: Vec<u32>,
}

/// A corner of a new face.
#[derive(Clone, Copy)]
struct NewCorner {
    vertex: u32,
    /// The corners of the old face between which the attributes are interpolated, and the weight of the second one.
    between: [u32; 2],
    at: f64,
}

/// Adds vertices to border edges, and interpolates attributes along these. Triangles are divided into triangles, other faces get more
/// corners.
///
/// # Errors
/// Does not fail for a valid mesh.
pub(super) fn split_edges(mesh: &Mesh, mut splits: Vec<EdgeSplit>) -> Result<SplitMesh, MeshError> {
    splits.sort_by(|a, b| a.corner.cmp(&b.corner).then(a.at.total_cmp(&b.at)));
    if splits.is_empty() {
        return Ok(SplitMesh { mesh: mesh.clone(), vertices: Vec::new() });
    }
    let count = mesh.positions().len() as u32;
    let mut on_edges: BTreeMap<u32, Vec<NewCorner>> = BTreeMap::new();
    let (faces, corners) = (mesh.faces(), mesh.faces().corners());
    let mut by_vertex = StencilRows::identity(count);
    let mut divided: BTreeMap<[u32; 2], Vec<u32>> = BTreeMap::new();
    for face in 0..faces.len() {
        let (first, end) = (faces.first_corner(face) as u32, faces.first_corner(face + 1) as u32);
        let from = splits.partition_point(|split| split.corner < first);
        for (k, split) in (from..).zip(&splits[from..]).take_while(|(_, split)| split.corner < end)
        {
            let next = if split.corner + 1 == end { first } else { split.corner + 1 };
            let vertex = count + k as u32;
            let between = [split.corner, next];
            let new = NewCorner { vertex, between, at: split.at };
            on_edges.entry(split.corner).or_default().push(new);
            let [a, b] = between.map(|corner| corners[corner as usize]);
            by_vertex.push([a, b], split.at);
            divided.entry([a, b]).or_default().push(vertex);
        }
    }
    let (mut sides, mut new_corners, mut parents) = (Vec::new(), Vec::new(), Vec::new());
    for face in 0..faces.len() {
        let (first, end) = (faces.first_corner(face) as u32, faces.first_corner(face + 1) as u32);
        let rings: Vec<(NewCorner, &[NewCorner])> = (first..end)
            .map(|corner| {
                let vertex = corners[corner as usize];
                let own = NewCorner { vertex, between: [corner; 2], at: 0.0 };
                (own, on_edges.get(&corner).map_or(&[][..], |all| &all[..]))
            })
            .collect();
        let mut add = |corners: &[NewCorner]| {
            sides.push(corners.len());
            parents.push(face as u32);
            new_corners.extend_from_slice(corners);
        };
        match rings[..] {
            [a, b, c] => divide([a, b, c], &mut add),
            _ => {
                let ring = rings.iter().flat_map(|(own, on_edge)| {
                    std::iter::once(*own).chain(on_edge.iter().copied())
                });
                add(&ring.collect::<Vec<_>>());
            }
        }
    }
    let mut by_corner = StencilRows::default();
    new_corners.iter().for_each(|corner| by_corner.push(corner.between, corner.at));
    let (by_vertex, by_corner) = (by_vertex.finish(), by_corner.finish());
    let vertices: Vec<u32> = splits.iter().map(|split| split.vertex).collect();
    let points = mesh.positions().iter().copied();
    let points = points.chain(vertices.iter().map(|&vertex| mesh.positions()[vertex as usize]));
    let corners = new_corners.iter().map(|corner| corner.vertex).collect();
    let creases = mesh.creases().flat_map(|([a, b], sharpness)| {
        let on_edge = divided.get(&[a, b]).or(divided.get(&[b, a]));
        let is_turned = divided.contains_key(&[b, a]);
        let mut chain = vec![a];
        match on_edge {
            Some(on_edge) if is_turned => chain.extend(on_edge.iter().rev()),
            on_edge => chain.extend(on_edge.into_iter().flatten()),
        }
        chain.push(b);
        chain.windows(2).map(|ends| ([ends[0], ends[1]], sharpness)).collect::<Vec<_>>()
    });
    let mut split = Mesh::new(points.collect::<Vec<_>>(), Faces::polygons(&sides, corners)?)?
        .with_creases(creases)?
        .with_materials(mesh.materials().clone())
        .with_frame(mesh.frame().copied());
    for (name, attribute) in mesh.vertex().iter() {
        split = split.with_vertex(name, by_vertex.attribute(attribute))?;
    }
    for (name, attribute) in mesh.corner().iter() {
        split = split.with_corner(name, by_corner.attribute(attribute))?;
    }
    for (name, attribute) in mesh.face().iter() {
        split = split.with_face(name, attribute.select(&parents))?;
    }
    Ok(SplitMesh { mesh: split, vertices })
}

/// Divides a triangle, given by its corners and the new vertices on the edge after each, into triangles.
fn divide(triangle: [(NewCorner, &[NewCorner]); 3], add: &mut impl FnMut(&[NewCorner])) {
    let Some(k) = (0..3).find(|&k| !triangle[k].1.is_empty()) else {
        return add(&triangle.map(|(corner, _)| corner));
    };
    let [(a, on_ab), (b, on_bc), (c, on_ca)] = [0, 1, 2].map(|i| triangle[(k + i) % 3]);
    let first = on_ab[0];
    divide([(a, &[]), (first, &[]), (c, on_ca)], add);
    divide([(first, &on_ab[1..]), (b, on_bc), (c, &[])], add);
}

/// Collects the rows of a matrix that interpolates between two elements.
#[derive(Default)]
struct StencilRows {
    starts: Vec<u32>,
    indices: Vec<u32>,
    weights: Vec<f64>,
}

impl StencilRows {
    fn identity(count: u32) -> Self {
        let mut rows = Self::default();
        (0..count).for_each(|index| rows.push([index; 2], 0.0));
        rows
    }

    fn push(&mut self, [a, b]: [u32; 2], at: f64) {
        self.starts.push(self.indices.len() as u32);
        self.indices.push(a);
        self.weights.push(1.0 - at);
        if a != b {
            self.indices.push(b);
            self.weights.push(at);
        }
    }

    fn finish(mut self) -> Stencils {
        self.starts.push(self.indices.len() as u32);
        Stencils::from_parts(self.starts, self.indices, self.weights)
    }
}
