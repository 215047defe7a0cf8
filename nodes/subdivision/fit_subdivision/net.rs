//! Control triangles whose edges are collapsed, split, swapped and made sharp.

use std::collections::BTreeMap;

use maquette_value::{Faces, Mesh, MeshError};
use nalgebra::{Point3, center};

/// In place of the corners of a face that is gone.
const GONE: [u32; 3] = [u32::MAX; 3];

/// Edges become sharp where the control faces bend by more than 20 degrees: its cosine. Less is seen as smooth.
const SMOOTH_COSINE: f64 = 0.939_692_620_785_908_4;

/// A way to change the faces at an edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Move {
    /// Both ends become one vertex.
    Collapse,
    /// A vertex is put into its middle.
    Split,
    /// It connects the two vertices across from it instead.
    Swap,
    /// It becomes sharp, or smooth if it was sharp.
    Tag,
}

impl Move {
    pub(super) const ALL: [Self; 4] = [Self::Collapse, Self::Split, Self::Swap, Self::Tag];
}

/// What a move does.
#[derive(Debug, Default)]
pub(super) struct Change {
    pub(super) removed: Vec<u32>,
    pub(super) added: Vec<[u32; 3]>,
    /// A vertex that moves, or a new one.
    pub(super) place: Option<(u32, Point3<f64>)>,
    /// The edges that become sharp, and with 0 smooth.
    pub(super) sharp: Vec<([u32; 2], f64)>,
    /// How many more vertices and sharp edges there are.
    pub(super) more: [f64; 2],
}

/// Control triangles that change.
pub(super) struct Net {
    pub(super) places: Vec<Point3<f64>>,
    pub(super) faces: Vec<[u32; 3]>,
    /// The faces around each vertex.
    around: Vec<Vec<u32>>,
    /// The sharp edges, by vertices in order, and how sharp they are.
    sharp: BTreeMap<[u32; 2], f64>,
}

fn ordered([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Sorts, and leaves each once.
pub(super) fn set(mut numbers: Vec<u32>) -> Vec<u32> {
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}

impl Net {
    /// The net of a mesh of triangles.
    pub(super) fn new(mesh: &Mesh) -> Self {
        let faces = mesh.faces().iter().map(|face| [face[0], face[1], face[2]]).collect();
        let sharp = mesh.creases().filter(|crease| 0.0 < crease.1).collect();
        let mut net = Self { places: mesh.positions().to_vec(), faces, around: Vec::new(), sharp };
        net.around = vec![Vec::new(); net.places.len()];
        for (index, face) in (0..).zip(&net.faces) {
            face.iter().for_each(|&vertex| net.around[vertex as usize].push(index));
        }
        net
    }

    /// Its mesh, the vertex of the net that each of the mesh's is, and the faces likewise.
    ///
    /// # Errors
    /// If a place is infinite.
    pub(super) fn mesh(&self) -> Result<(Mesh, Vec<u32>, Vec<u32>), MeshError> {
        let faces: Vec<u32> = (0..self.faces.len() as u32)
            .filter(|&face| self.faces[face as usize] != GONE)
            .collect();
        let (mesh, vertices) = self
            .part(faces.iter().map(|&face| self.faces[face as usize]), |v| {
                self.places[v as usize]
            })?;
        Ok((
            with_sharp(&mesh, &vertices, |ends: [u32; 2]| self.sharp.get(&ends).copied())?,
            vertices,
            faces,
        ))
    }

    /// Some faces as a mesh, and the vertex of the net that each of its vertices is.
    pub(super) fn part(
        &self,
        faces: impl Iterator<Item = [u32; 3]>,
        place: impl Fn(u32) -> Point3<f64>,
    ) -> Result<(Mesh, Vec<u32>), MeshError> {
        let faces: Vec<[u32; 3]> = faces.collect();
        let vertices = set(faces.as_flattened().to_vec());
        let faces = faces
            .into_iter()
            .map(|face| {
                face.map(|vertex: u32| vertices.partition_point(|&other| other < vertex) as u32)
            })
            .collect();
        let places: Vec<Point3<f64>> = vertices.iter().map(|&vertex| place(vertex)).collect();
        Ok((Mesh::new(places, Faces::triangles(faces))?, vertices))
    }

    /// How sharp an edge is after a change.
    pub(super) fn sharpness(&self, ends: [u32; 2], change: &Change) -> Option<f64> {
        let new = change.sharp.iter().find(|(other, _)| *other == ends).map(|(_, sharp)| *sharp);
        new.or_else(|| self.sharp.get(&ends).copied()).filter(|sharp| 0.0 < *sharp)
    }

    /// The edges of some faces, each once.
    pub(super) fn edges(&self, faces: impl Iterator<Item = u32>) -> Vec<[u32; 2]> {
        let faces = faces.map(|face| self.faces[face as usize]).filter(|face| *face != GONE);
        let mut edges: Vec<[u32; 2]> =
            faces.flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]].map(ordered)).collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    }

    /// The faces around some vertices.
    pub(super) fn star(&self, vertices: &[u32]) -> Vec<u32> {
        set(vertices.iter().flat_map(|&vertex| self.around[vertex as usize].clone()).collect())
    }

    /// The corners of some faces.
    pub(super) fn corners(&self, faces: &[u32]) -> Vec<u32> {
        let corners = faces.iter().map(|&face| self.faces[face as usize]);
        set(corners.filter(|corners| *corners != GONE).flatten().collect())
    }

    fn neighbors(&self, vertex: u32) -> Vec<u32> {
        let mut all = self.corners(&self.around[vertex as usize]);
        all.retain(|&other| other != vertex);
        all
    }

    /// The faces at an edge.
    pub(super) fn sides(&self, [a, b]: [u32; 2]) -> Vec<u32> {
        let around = self.around[a as usize].iter().copied();
        around.filter(|&face| self.faces[face as usize].contains(&b)).collect()
    }

    /// The other ends of the sharp edges and borders at a vertex.
    pub(super) fn sharp_neighbors(&self, vertex: u32) -> Vec<u32> {
        self.neighbors(vertex)
            .into_iter()
            .filter(|&other| {
                let ends = [vertex, other];
                self.sharp.contains_key(&ordered(ends)) || self.sides(ends).len() == 1
            })
            .collect()
    }

    /// The other ends of a corner's edges, from each sharp edge or border to the next; none if it is no corner, with less than three.
    pub(super) fn sectors(&self, vertex: u32) -> Vec<Vec<u32>> {
        let sharp = self.sharp_neighbors(vertex);
        if sharp.len() < 3 {
            return Vec::new();
        }
        fn after(end: u32, vertex: u32, around: &[Vec<u32>], faces: &[[u32; 3]]) -> Option<u32> {
            around[vertex as usize].iter().find_map(|&face| {
                let face = faces[face as usize];
                let place = face.iter().position(|&corner| corner == vertex)?;
                (face[(place + 1) % 3] == end).then(|| face[(place + 2) % 3])
            })
        }
        sharp
            .iter()
            .map(|&first| {
                let mut ends = vec![first];
                while let Some(next) =
                    after(ends[ends.len() - 1], vertex, &self.around, &self.faces)
                {
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

    /// Makes an edge sharp.
    pub(super) fn sharpen(&mut self, edge: [u32; 2], sharpness: f64) {
        self.sharp.insert(ordered(edge), sharpness);
    }

    /// What a move at an edge does; none if the surface, its border or its creases would not stay what they are.
    pub(super) fn change(&self, kind: Move, edge: [u32; 2]) -> Option<Change> {
        match kind {
            Move::Collapse => self.collapse(edge),
            Move::Split => self.split(edge),
            Move::Swap => self.swap(edge),
            Move::Tag => self.tag(edge),
        }
    }

    /// The link condition of Dey, Edelsbrunner, Guha and Nekhayev, "Topology preserving edge contraction" (1999). Beside a smooth edge a
    /// vertex of a crease stays where it is; the ends of creases, and where several meet, always do.
    fn collapse(&self, [a, b]: [u32; 2]) -> Option<Change> {
        let sides = self.sides([a, b]);
        let sharp = [a, b].map(|end| self.sharp_neighbors(end));
        let is_sharp = sharp[0].contains(&b);
        let held = sharp.each_ref().map(|others| match others.len() {
            0 => false,
            2 => !is_sharp,
            _ => true,
        });
        let [first, second] = [a, b].map(|end| self.places[end as usize]);
        let place = match held {
            [true, true] => return None,
            [true, false] => first,
            [false, true] => second,
            [false, false] => center(&first, &second),
        };
        let others = self.neighbors(b);
        let common: Vec<_> = self.neighbors(a).into_iter().filter(|v| others.contains(v)).collect();
        // A vertex across from the edge loses a face and must keep a fan.
        let ring = common.iter().any(|v| sharp[0].contains(v) && sharp[1].contains(v));
        if common.len() != sides.len()
            || common.iter().any(|&apex| {
                let is_border =
                    self.sharp_neighbors(apex).iter().any(|&v| self.sides([apex, v]).len() == 1);
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
            if let Some(&sharp) = self.sharp.get(&ordered([b, other])) {
                moved.push((ordered([b, other]), 0.0));
                if other != a {
                    moved.push((ordered([a, other]), sharp));
                }
            }
        }
        let lost = self.sharp.contains_key(&ordered([a, b]));
        let more = [-1.0, if lost { -1.0 } else { 0.0 }];
        Some(Change { removed, added, place: Some((a, place)), sharp: moved, more })
    }

    fn split(&self, [a, b]: [u32; 2]) -> Option<Change> {
        let removed = self.sides([a, b]);
        let new = self.places.len() as u32;
        let added = removed
            .iter()
            .flat_map(|&face| {
                let face = self.faces[face as usize];
                [a, b].map(|end| face.map(|vertex| if vertex == end { new } else { vertex }))
            })
            .collect();
        let [first, second] = [a, b].map(|end| self.places[end as usize]);
        let sharp = self.sharp.get(&ordered([a, b])).copied();
        let more = [1.0, if sharp.is_some() { 1.0 } else { 0.0 }];
        let place = Some((new, center(&first, &second)));
        Some(Change {
            removed,
            added,
            place,
            sharp: sharp
                .map(|sharp| vec![([a, b], 0.0), ([a, new], sharp), ([b, new], sharp)])
                .unwrap_or_default(),
            more,
        })
    }

    fn swap(&self, [a, b]: [u32; 2]) -> Option<Change> {
        let removed = self.sides([a, b]);
        let [f, g] = removed[..] else { return None };
        fn across(face: u32, a: u32, b: u32, faces: &[[u32; 3]]) -> Option<[u32; 3]> {
            let corners = faces[face as usize];
            let place = corners.iter().position(|&vertex| vertex != a && vertex != b)?;
            Some([0, 1, 2].map(|k| corners[(place + k) % 3]))
        }
        // Each face from the corner across on; the second one runs the other way.
        let ([c, from, to], [d, ..]) =
            (across(f, a, b, &self.faces)?, across(g, a, b, &self.faces)?);
        fn is_thin(end: u32, around: &[Vec<u32>]) -> bool {
            around[end as usize].len() < 4
        }
        let taken = c == d || !self.sides([c, d]).is_empty();
        if self.sharp.contains_key(&ordered([a, b]))
            || taken
            || is_thin(a, &self.around)
            || is_thin(b, &self.around)
        {
            return None;
        }
        let added = vec![[c, from, d], [d, to, c]];
        Some(Change { removed, added, place: None, sharp: Vec::new(), more: [0.0; 2] })
    }

    fn tag(&self, edge: [u32; 2]) -> Option<Change> {
        let sides = self.sides(edge);
        let [f, g] = sides[..] else { return None };
        let is_sharp = self.sharp.contains_key(&edge);
        fn normal(face: u32, faces: &[[u32; 3]], places: &[Point3<f64>]) -> nalgebra::Vector3<f64> {
            let [a, b, c] = faces[face as usize].map(|vertex| places[vertex as usize]);
            (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default()
        }
        if !is_sharp
            && SMOOTH_COSINE
                < normal(f, &self.faces, &self.places).dot(&normal(g, &self.faces, &self.places))
        {
            return None;
        }
        let (sharpness, more) = if is_sharp { (0.0, -1.0) } else { (SHARP, 1.0) };
        Some(Change { sharp: vec![(edge, sharpness)], more: [0.0, more], ..Change::default() })
    }

    /// Makes a change whose new vertex, if it has one, has the number `new`; returns the faces that were added.
    pub(super) fn apply(&mut self, change: &Change, new: u32) -> Vec<u32> {
        for &face in &change.removed {
            for vertex in std::mem::replace(&mut self.faces[face as usize], GONE) {
                self.around[vertex as usize].retain(|&other| other != face);
            }
        }
        let renumbered =
            |vertex: u32| if vertex == new { self.places.len() as u32 } else { vertex };
        let added: Vec<[u32; 3]> = change.added.iter().map(|face| face.map(renumbered)).collect();
        for (ends, sharpness) in &change.sharp {
            let ends = ends.map(renumbered);
            if 0.0 < *sharpness {
                self.sharp.insert(ends, *sharpness);
            } else {
                self.sharp.remove(&ends);
            }
        }
        if change.place.is_some_and(|(vertex, _)| vertex == new) {
            self.places.push(Point3::origin());
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

/// The mesh of a part of the net with its sharp edges.
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

/// The sharpness of an edge that stays sharp however often it is subdivided.
pub(super) const SHARP: f64 = 10.0;
