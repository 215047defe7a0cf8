//! A triangle mesh with edge operations: collapse, split, swap, and change of sharpness.

use std::collections::BTreeMap;

use maquette_value::{Faces, Mesh, MeshError};
use nalgebra::{Point3, Vector3, center};

/// The entry of a removed face in the list of faces.
const REMOVED: [u32; 3] = [u32::MAX; 3];

/// The cosine of 20 degrees. An edge may become sharp only if the angle between the normals of its two faces is greater; edges with a
/// smaller angle look smooth.
const SMOOTH_COSINE: f64 = 0.939_692_620_785_908_4;

/// The kind of an edge operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Move {
    /// Merges the two ends of an edge.
    Collapse,
    /// Inserts a vertex at the midpoint of an edge.
    Split,
    /// Replaces the diagonal of the quad formed by an edge's two triangles by the quad's other diagonal.
    Swap,
    /// Makes a smooth edge sharp, or a sharp edge smooth.
    Tag,
}

impl Move {
    pub(super) const ALL: [Self; 4] = [Self::Collapse, Self::Split, Self::Swap, Self::Tag];
}

/// The effect of an edge operation on the net.
#[derive(Debug, Default)]
pub(super) struct Change {
    pub(super) removed: Vec<u32>,
    pub(super) added: Vec<[u32; 3]>,
    /// A vertex that moves or is added, and its new position; `None` if no vertex moves.
    pub(super) position: Option<(u32, Point3<f64>)>,
    /// The edges whose sharpness changes, with the new sharpness; 0 means smooth.
    pub(super) sharp: Vec<([u32; 2], f64)>,
    /// The changes in the number of vertices and in the number of sharp edges.
    pub(super) count_changes: [f64; 2],
}

/// The triangles of a control mesh. Edge operations change them.
pub(super) struct Net {
    pub(super) positions: Vec<Point3<f64>>,
    pub(super) faces: Vec<[u32; 3]>,
    /// The indices of the faces around each vertex.
    around: Vec<Vec<u32>>,
    /// The sharpness of each sharp edge. The key is the edge's vertices in ascending order.
    sharp: BTreeMap<[u32; 2], f64>,
}

fn sort_ends([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Sorts numbers and removes duplicates.
pub(super) fn sort_and_dedup(mut numbers: Vec<u32>) -> Vec<u32> {
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}

impl Net {
    /// Creates the net of a triangle mesh.
    pub(super) fn new(mesh: &Mesh) -> Self {
        let faces = mesh.faces().iter().map(|face| [face[0], face[1], face[2]]).collect();
        let sharp = mesh.creases().filter(|crease| 0.0 < crease.1).collect();
        let mut net =
            Self { positions: mesh.positions().to_vec(), faces, around: Vec::new(), sharp };
        net.around = vec![Vec::new(); net.positions.len()];
        for (index, face) in (0..).zip(&net.faces) {
            face.iter().for_each(|&vertex| net.around[vertex as usize].push(index));
        }
        net
    }

    /// Returns the net as a mesh. Also returns for each vertex of the mesh its index in the net, and for each face its index in the net.
    ///
    /// # Errors
    /// If a position is infinite.
    pub(super) fn mesh(&self) -> Result<(Mesh, Vec<u32>, Vec<u32>), MeshError> {
        let faces: Vec<u32> = (0..self.faces.len() as u32)
            .filter(|&face| self.faces[face as usize] != REMOVED)
            .collect();
        let (mesh, vertices) = self
            .part(faces.iter().map(|&face| self.faces[face as usize]), |v| {
                self.positions[v as usize]
            })?;
        Ok((
            with_sharp(&mesh, &vertices, |ends: [u32; 2]| self.sharp.get(&ends).copied())?,
            vertices,
            faces,
        ))
    }

    /// Returns some faces of the net as a mesh. Also returns for each vertex of the mesh its index in the net.
    pub(super) fn part(
        &self,
        faces: impl Iterator<Item = [u32; 3]>,
        position: impl Fn(u32) -> Point3<f64>,
    ) -> Result<(Mesh, Vec<u32>), MeshError> {
        let faces: Vec<[u32; 3]> = faces.collect();
        let vertices = sort_and_dedup(faces.as_flattened().to_vec());
        let faces = faces
            .into_iter()
            .map(|face| {
                face.map(|vertex: u32| vertices.partition_point(|&other| other < vertex) as u32)
            })
            .collect();
        let positions: Vec<Point3<f64>> = vertices.iter().map(|&vertex| position(vertex)).collect();
        Ok((Mesh::new(positions, Faces::triangles(faces))?, vertices))
    }

    /// Returns the sharpness that an edge has after a change; `None` if the edge is smooth then.
    pub(super) fn sharpness(&self, ends: [u32; 2], change: &Change) -> Option<f64> {
        let new = change.sharp.iter().find(|(other, _)| *other == ends).map(|(_, sharp)| *sharp);
        new.or_else(|| self.sharp.get(&ends).copied()).filter(|sharp| 0.0 < *sharp)
    }

    /// Returns the edges of some faces, without duplicates.
    pub(super) fn edges(&self, faces: impl Iterator<Item = u32>) -> Vec<[u32; 2]> {
        let faces = faces.map(|face| self.faces[face as usize]).filter(|face| *face != REMOVED);
        let mut edges: Vec<[u32; 2]> =
            faces.flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]].map(sort_ends)).collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    }

    /// Returns the faces that contain at least one of the given vertices, without duplicates.
    pub(super) fn faces_around(&self, vertices: &[u32]) -> Vec<u32> {
        sort_and_dedup(
            vertices.iter().flat_map(|&vertex| self.around[vertex as usize].clone()).collect(),
        )
    }

    /// Returns the corners of the given faces, without duplicates.
    pub(super) fn corners_of(&self, faces: &[u32]) -> Vec<u32> {
        let corners = faces.iter().map(|&face| self.faces[face as usize]);
        sort_and_dedup(corners.filter(|corners| *corners != REMOVED).flatten().collect())
    }

    fn neighbors(&self, vertex: u32) -> Vec<u32> {
        let mut all = self.corners_of(&self.around[vertex as usize]);
        all.retain(|&other| other != vertex);
        all
    }

    /// Returns the faces that contain both ends of an edge.
    pub(super) fn faces_at_edge(&self, [a, b]: [u32; 2]) -> Vec<u32> {
        let around = self.around[a as usize].iter().copied();
        around.filter(|&face| self.faces[face as usize].contains(&b)).collect()
    }

    /// Returns the vertices at the other ends of a vertex's sharp edges and border edges.
    pub(super) fn sharp_neighbors(&self, vertex: u32) -> Vec<u32> {
        self.neighbors(vertex)
            .into_iter()
            .filter(|&other| {
                let ends = [vertex, other];
                self.sharp.contains_key(&sort_ends(ends)) || self.faces_at_edge(ends).len() == 1
            })
            .collect()
    }

    /// Returns the sectors of a corner (a vertex with at least three sharp edges). A sector is the list of the other ends of the vertex's
    /// edges, from one sharp edge or border to the next. Returns no sectors for other vertices.
    pub(super) fn sectors(&self, vertex: u32) -> Vec<Vec<u32>> {
        let sharp = self.sharp_neighbors(vertex);
        if sharp.len() < 3 {
            return Vec::new();
        }
        sharp
            .iter()
            .map(|&first| {
                let mut ends = vec![first];
                while let Some(next) = self.next_neighbor(vertex, ends[ends.len() - 1]) {
                    ends.push(next);
                    if sharp.contains(&next) {
                        break;
                    }
                }
                ends
            })
            .filter(|ends| 1 < ends.len())
            .collect()
    }

    /// Returns the neighbor of a vertex that follows the neighbor `end` counter-clockwise; `None` at a border.
    fn next_neighbor(&self, vertex: u32, end: u32) -> Option<u32> {
        self.around[vertex as usize].iter().find_map(|&face| {
            let face = self.faces[face as usize];
            let index = face.iter().position(|&corner| corner == vertex)?;
            (face[(index + 1) % 3] == end).then(|| face[(index + 2) % 3])
        })
    }

    /// Sets the sharpness of an edge.
    pub(super) fn sharpen(&mut self, edge: [u32; 2], sharpness: f64) {
        self.sharp.insert(sort_ends(edge), sharpness);
    }

    /// Returns the effect of an operation on an edge; `None` if the operation would change the topology of the surface, of its border or of
    /// its creases.
    pub(super) fn change(&self, kind: Move, edge: [u32; 2]) -> Option<Change> {
        match kind {
            Move::Collapse => self.collapse(edge),
            Move::Split => self.split(edge),
            Move::Swap => self.swap(edge),
            Move::Tag => self.tag(edge),
        }
    }

    /// Returns the effect of collapsing an edge. Checks the link condition of Dey, Edelsbrunner, Guha and Nekhayev, "Topology preserving
    /// edge contraction" (1999). The collapse of a smooth edge does not move vertices of a crease; ends of creases and vertices on several
    /// creases never move.
    fn collapse(&self, [a, b]: [u32; 2]) -> Option<Change> {
        let sides = self.faces_at_edge([a, b]);
        let sharp = [a, b].map(|end| self.sharp_neighbors(end));
        let is_sharp = sharp[0].contains(&b);
        let held = sharp.each_ref().map(|others| match others.len() {
            0 => false,
            2 => !is_sharp,
            _ => true,
        });
        let [first, second] = [a, b].map(|end| self.positions[end as usize]);
        let position = match held {
            [true, true] => return None,
            [true, false] => first,
            [false, true] => second,
            [false, false] => center(&first, &second),
        };
        let others = self.neighbors(b);
        let common: Vec<_> = self.neighbors(a).into_iter().filter(|v| others.contains(v)).collect();
        // A vertex opposite the collapsed edge loses a face. The vertex's remaining faces must still form a fan.
        let ring = common.iter().any(|v| sharp[0].contains(v) && sharp[1].contains(v));
        if common.len() != sides.len()
            || common.iter().any(|&apex| {
                let is_border = self
                    .sharp_neighbors(apex)
                    .iter()
                    .any(|&v| self.faces_at_edge([apex, v]).len() == 1);
                self.around[apex as usize].len() < if is_border { 2 } else { 4 }
            })
            || ring
        {
            return None;
        }
        let removed = self.around[b as usize].clone();
        let stay = removed.iter().filter(|face| !sides.contains(face));
        let added = stay.map(|&face| self.faces[face as usize].map(|v| if v == b { a } else { v }));
        let added = added.collect();
        let mut moved = Vec::new();
        for &other in &others {
            if let Some(&sharp) = self.sharp.get(&sort_ends([b, other])) {
                moved.push((sort_ends([b, other]), 0.0));
                if other != a {
                    moved.push((sort_ends([a, other]), sharp));
                }
            }
        }
        let lost = self.sharp.contains_key(&sort_ends([a, b]));
        let more = [-1.0, if lost { -1.0 } else { 0.0 }];
        Some(Change {
            removed,
            added,
            position: Some((a, position)),
            sharp: moved,
            count_changes: more,
        })
    }

    fn split(&self, [a, b]: [u32; 2]) -> Option<Change> {
        let removed = self.faces_at_edge([a, b]);
        let new = self.positions.len() as u32;
        let added = removed
            .iter()
            .flat_map(|&face| {
                let face = self.faces[face as usize];
                [a, b].map(|end| face.map(|vertex| if vertex == end { new } else { vertex }))
            })
            .collect();
        let [first, second] = [a, b].map(|end| self.positions[end as usize]);
        let sharp = self.sharp.get(&sort_ends([a, b])).copied();
        let more = [1.0, if sharp.is_some() { 1.0 } else { 0.0 }];
        let position = Some((new, center(&first, &second)));
        Some(Change {
            removed,
            added,
            position,
            sharp: sharp
                .map(|sharp| vec![([a, b], 0.0), ([a, new], sharp), ([b, new], sharp)])
                .unwrap_or_default(),
            count_changes: more,
        })
    }

    fn swap(&self, [a, b]: [u32; 2]) -> Option<Change> {
        let removed = self.faces_at_edge([a, b]);
        let [f, g] = removed[..] else { return None };
        // Find the corners of the two faces at the edge, beginning with the corner opposite the edge. The second face traverses the edge in
        // the other direction.
        let [c, from, to] = self.corners_from_opposite(f, [a, b])?;
        let [d, ..] = self.corners_from_opposite(g, [a, b])?;
        let taken = c == d || !self.faces_at_edge([c, d]).is_empty();
        if self.sharp.contains_key(&sort_ends([a, b]))
            || taken
            || [a, b].iter().any(|&end| self.around[end as usize].len() < 4)
        {
            return None;
        }
        let added = vec![[c, from, d], [d, to, c]];
        Some(Change { removed, added, position: None, sharp: Vec::new(), count_changes: [0.0; 2] })
    }

    /// Returns the corners of a face, beginning with the corner opposite an edge.
    fn corners_from_opposite(&self, face: u32, [a, b]: [u32; 2]) -> Option<[u32; 3]> {
        let corners = self.faces[face as usize];
        let index = corners.iter().position(|&vertex| vertex != a && vertex != b)?;
        Some([0, 1, 2].map(|k| corners[(index + k) % 3]))
    }

    /// Returns the unit normal of a face; 0 for a face without area.
    fn normal(&self, face: u32) -> Vector3<f64> {
        let [a, b, c] = self.faces[face as usize].map(|vertex| self.positions[vertex as usize]);
        (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default()
    }

    fn tag(&self, edge: [u32; 2]) -> Option<Change> {
        let sides = self.faces_at_edge(edge);
        let [f, g] = sides[..] else { return None };
        let is_sharp = self.sharp.contains_key(&edge);
        if !is_sharp && SMOOTH_COSINE < self.normal(f).dot(&self.normal(g)) {
            return None;
        }
        let (sharpness, more) = if is_sharp { (0.0, -1.0) } else { (SHARP, 1.0) };
        Some(Change {
            sharp: vec![(edge, sharpness)],
            count_changes: [0.0, more],
            ..Change::default()
        })
    }

    /// Performs a change. `new` is the index for the new vertex, if the change adds one. Returns the indices of the added faces.
    pub(super) fn apply(&mut self, change: &Change, new: u32) -> Vec<u32> {
        for &face in &change.removed {
            for vertex in std::mem::replace(&mut self.faces[face as usize], REMOVED) {
                self.around[vertex as usize].retain(|&other| other != face);
            }
        }
        let renumbered =
            |vertex: u32| if vertex == new { self.positions.len() as u32 } else { vertex };
        let added: Vec<[u32; 3]> = change.added.iter().map(|face| face.map(renumbered)).collect();
        for (ends, sharpness) in &change.sharp {
            let ends = ends.map(renumbered);
            if 0.0 < *sharpness {
                self.sharp.insert(ends, *sharpness);
            } else {
                self.sharp.remove(&ends);
            }
        }
        if change.position.is_some_and(|(vertex, _)| vertex == new) {
            self.positions.push(Point3::origin());
            self.around.push(Vec::new());
        }
        let first = self.faces.len() as u32;
        self.faces.extend(added);
        for face in first..self.faces.len() as u32 {
            for vertex in self.faces[face as usize] {
                self.around[vertex as usize].push(face);
            }
        }
        (first..self.faces.len() as u32).collect()
    }
}

/// Adds the net's sharp edges to `mesh`, which is a part of the net.
pub(super) fn with_sharp(
    mesh: &Mesh,
    vertices: &[u32],
    sharpness: impl Fn([u32; 2]) -> Option<f64>,
) -> Result<Mesh, MeshError> {
    let edges = mesh.edges().vertices;
    mesh.clone().with_creases(
        edges
            .into_iter()
            .filter_map(|ends| Some((ends, sharpness(ends.map(|end| vertices[end as usize]))?))),
    )
}

/// Edges with this sharpness stay sharp in all refinement steps.
pub(super) const SHARP: f64 = 10.0;
