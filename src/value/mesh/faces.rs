//! The faces of a mesh, and the edges between them.

use super::{MeshError, check_count};
use crate::value::{Column, DecodeError, Decoder, Encoder};

/// The faces of a mesh: corners by vertex index, counter-clockwise seen from outside.
///
/// Invariant, checked by its constructors: every face has at least 3 corners.
#[derive(Clone, Debug, PartialEq)]
pub struct Faces {
    corners: Column<u32>,
    shape: Shape,
}

#[derive(Clone, Debug, PartialEq)]
enum Shape {
    /// All faces have this many corners.
    Uniform(usize),
    /// The first corner of each face, and behind the last face the number of corners.
    Mixed(Column<u32>),
}

impl Faces {
    /// Faces of `sides` corners each.
    ///
    /// # Errors
    /// If `sides` is less than 3 or does not divide the number of corners.
    pub fn uniform(sides: usize, corners: impl Into<Column<u32>>) -> Result<Self, MeshError> {
        let corners = corners.into();
        if sides < 3 {
            return Err(MeshError::FewCorners { face: 0, corners: sides });
        }
        if corners.len() % sides != 0 {
            return Err(MeshError::CutOff { corners: corners.len(), sides });
        }
        check_count("corners", corners.len())?;
        Ok(Self { corners, shape: Shape::Uniform(sides) })
    }

    /// Triangles.
    pub fn triangles(triangles: Vec<[u32; 3]>) -> Self {
        Self { corners: triangles.into_flattened().into(), shape: Shape::Uniform(3) }
    }

    /// Faces with these numbers of corners, one after the other.
    ///
    /// # Errors
    /// If a face has fewer than 3 corners, or the numbers do not add up to the corners.
    pub fn polygons(sides: &[usize], corners: Vec<u32>) -> Result<Self, MeshError> {
        if let Some(face) = sides.iter().position(|&sides| sides < 3) {
            return Err(MeshError::FewCorners { face, corners: sides[face] });
        }
        if sides.iter().sum::<usize>() != corners.len() {
            return Err(MeshError::CutOff { corners: corners.len(), sides: 0 });
        }
        check_count("corners", corners.len())?;
        let first = sides.first().copied().unwrap_or(3);
        if sides.iter().all(|&sides| sides == first) {
            return Self::uniform(first, corners);
        }
        let mut starts = vec![0u32];
        starts.extend(sides.iter().scan(0, |end, &sides| {
            *end += sides as u32;
            Some(*end)
        }));
        Ok(Self { corners: corners.into(), shape: Shape::Mixed(starts.into()) })
    }

    /// Number of faces.
    pub fn len(&self) -> usize {
        match &self.shape {
            Shape::Uniform(sides) => self.corners.len() / sides,
            Shape::Mixed(starts) => starts.len() - 1,
        }
    }

    /// Whether there is no face.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The number of corners of every face, if it is the same.
    pub fn sides(&self) -> Option<usize> {
        match self.shape {
            Shape::Uniform(sides) => Some(sides),
            Shape::Mixed(_) => None,
        }
    }

    /// All faces as triangles, if they are.
    pub fn as_triangles(&self) -> Option<&[[u32; 3]]> {
        (self.sides() == Some(3)).then(|| bytemuck::cast_slice(&self.corners))
    }

    /// The index of a face's first corner.
    pub fn first_corner(&self, face: usize) -> usize {
        match &self.shape {
            Shape::Uniform(sides) => face * sides,
            Shape::Mixed(starts) => starts[face] as usize,
        }
    }

    /// The vertices at a face's corners.
    ///
    /// # Panics
    /// If there is no such face.
    pub fn face(&self, face: usize) -> &[u32] {
        &self.corners[self.first_corner(face)..self.first_corner(face + 1)]
    }

    /// The vertices at the corners of each face in turn.
    pub fn iter(&self) -> impl Iterator<Item = &[u32]> {
        (0..self.len()).map(|face| self.face(face))
    }

    /// The vertices at all corners, face by face.
    pub fn corners(&self) -> &Column<u32> {
        &self.corners
    }

    /// Their edges.
    ///
    /// Each edge is listed at the end that has fewer corners, so that the lists to be searched are short even around the tip
    /// of a large fan: Chiba and Nishizeki, "Arboricity and subgraph listing algorithms" (1985), lemma 2.
    pub fn edges(&self) -> Edges {
        let vertices = self.corners.iter().max().map_or(0, |&vertex| vertex as usize + 1);
        let mut degrees = vec![0u32; vertices];
        self.corners.iter().for_each(|&vertex| degrees[vertex as usize] += 1);
        let mut newest = vec![NONE; vertices];
        let mut listed: Vec<Listed> = Vec::with_capacity(self.corners.len() / 2 + 1);
        let mut edges = Edges {
            vertices: Vec::with_capacity(self.corners.len() / 2 + 1),
            faces: Vec::with_capacity(self.corners.len() / 2 + 1),
            misoriented: 0,
            of_corner: Vec::with_capacity(self.corners.len()),
        };
        for face in self.iter() {
            let ends = face.iter().zip(face[1..].iter().chain(&face[..1]));
            for (&from, &to) in ends {
                let (low, high) = (from.min(to), from.max(to));
                let lists_it = degrees[low as usize] <= degrees[high as usize];
                let (at, other) = if lists_it { (low, high) } else { (high, low) };
                let mut edge = newest[at as usize];
                while edge != NONE && listed[edge as usize].other != other {
                    edge = listed[edge as usize].older;
                }
                if edge == NONE {
                    edge = listed.len() as u32;
                    listed.push(Listed { other, older: newest[at as usize], from });
                    newest[at as usize] = edge;
                    edges.vertices.push([low, high]);
                    edges.faces.push(1);
                } else {
                    let listed = &mut listed[edge as usize];
                    edges.faces[edge as usize] += 1;
                    edges.misoriented += usize::from(listed.from == from);
                    listed.from = from;
                }
                edges.of_corner.push(edge);
            }
        }
        edges
    }

    /// Writes them as part of a value that holds them.
    pub fn encode(&self, to: &mut Encoder) {
        let (sides, starts) = match &self.shape {
            Shape::Uniform(sides) => (*sides, None),
            Shape::Mixed(starts) => (0, Some(starts)),
        };
        to.column(&self.corners).counts(&[sides]).option(starts, |to, starts| {
            to.column(starts);
        });
    }

    /// Reads what [`Faces::encode`] wrote, for types that hold faces.
    ///
    /// # Errors
    /// If it is not that.
    pub fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let corners = from.column()?;
        let [sides] = from.counts()?;
        let shape = from.option(Decoder::column)?.map_or(Shape::Uniform(sides), Shape::Mixed);
        Ok(Self { corners, shape })
    }

    pub(super) fn size(&self) -> usize {
        self.corners.size()
            + match &self.shape {
                Shape::Uniform(_) => 0,
                Shape::Mixed(starts) => starts.size(),
            }
    }
}

/// No edge.
const NONE: u32 = u32::MAX;

/// An edge in the list of one of its ends.
struct Listed {
    /// The other end.
    other: u32,
    /// The edge listed before it at the same vertex.
    older: u32,
    /// Where the last face that met it came from.
    from: u32,
}

/// The edges of a mesh between vertices a < b, in the order in which the faces meet them.
#[derive(Clone, Debug, PartialEq)]
pub struct Edges {
    /// The two vertices of each edge, the lower one first.
    pub vertices: Vec<[u32; 2]>,
    /// How many faces meet at each edge: 1 at a boundary, more than 2 where the mesh is not manifold.
    pub faces: Vec<u32>,
    /// Edges which two faces run through in the same direction: their orientations disagree.
    pub misoriented: usize,
    /// The edge from each corner to the next corner of its face.
    pub of_corner: Vec<u32>,
}
