//! The faces of a mesh, and the edges between them.

use std::ops::Range;
use std::sync::{Arc, OnceLock};

use super::known::Spread;
use super::{BLOCK, MeshError, check_count};
use crate::memory::huge_vec;
use crate::parallel::*;
use crate::{Column, DecodeError, Decoder, Encoder};

/// The faces of a mesh: corners by vertex index, counter-clockwise seen from outside.
///
/// Invariant, checked by its constructors: every face has at least 3 corners.
#[derive(Clone, Debug)]
pub struct Faces {
    corners: Column<u32>,
    shape: Shape,
    /// How many vertices there must be for these faces to be sound, found when first asked for and shared by copies; none if a
    /// face meets a vertex twice.
    needed: Arc<OnceLock<Option<u32>>>,
    /// Where they are, found when first asked for and shared by copies.
    spread: Arc<OnceLock<Spread>>,
}

impl PartialEq for Faces {
    fn eq(&self, other: &Self) -> bool {
        self.corners == other.corners && self.shape == other.shape
    }
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
        Ok(Self::new(corners, Shape::Uniform(sides)))
    }

    /// Triangles.
    pub fn triangles(triangles: Vec<[u32; 3]>) -> Self {
        Self::new(triangles.into_flattened().into(), Shape::Uniform(3))
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
        let mut starts = huge_vec(sides.len() + 1);
        let mut end = 0;
        for (start, &sides) in starts[1..].iter_mut().zip(sides) {
            end += sides as u32;
            *start = end;
        }
        Ok(Self::new(corners.into(), Shape::Mixed(starts.into())))
    }

    fn new(corners: Column<u32>, shape: Shape) -> Self {
        Self { corners, shape, needed: Arc::default(), spread: Arc::default() }
    }

    pub(crate) fn spread(&self) -> &Spread {
        self.spread.get().unwrap_or_else(|| {
            // Made outside of the lock: its threads may take on other work meanwhile that asks for the same.
            let spread = Spread::new(self);
            self.spread.get_or_init(|| spread)
        })
    }

    /// Finds the first face that names no vertex, or one twice. Looks at the faces only once, however many meshes share them.
    pub(super) fn check(&self, vertices: usize) -> Result<(), MeshError> {
        match self.needed() {
            Some(needed) if needed as usize <= vertices => Ok(()),
            _ => {
                let bad = (0..self.len())
                    .find_map(|face| check_face(face, self.face(face), vertices).err());
                bad.map_or(Ok(()), Err)
            }
        }
    }

    /// How many vertices there must be for all corners; none if a face meets one twice.
    pub fn needed(&self) -> Option<u32> {
        *self.needed.get_or_init(|| self.count_needed())
    }

    fn count_needed(&self) -> Option<u32> {
        let blocks = (0..self.len().div_ceil(BLOCK)).into_par_iter();
        let faces = |block: usize| block * BLOCK..self.len().min((block + 1) * BLOCK);
        let needed = blocks.map(|block| match self.sides() {
            Some(3) => count_needed::<3>(&self.corners, faces(block)),
            Some(4) => count_needed::<4>(&self.corners, faces(block)),
            _ => {
                let mut faces = faces(block).map(|face| self.face(face));
                let needed =
                    |face: &[u32]| face.iter().max().map_or(0, |highest| highest.saturating_add(1));
                faces.try_fold(0, |most, face| {
                    (repeated(face).is_none()).then(|| u32::max(most, needed(face)))
                })
            }
        });
        needed
            .collect::<Vec<_>>()
            .into_iter()
            .try_fold(0, |most, of_block| Some(of_block?.max(most)))
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
    #[inline]
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
    #[inline]
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
        Ok(Self::new(corners, shape))
    }

    pub(super) fn size(&self) -> usize {
        self.corners.size()
            + match &self.shape {
                Shape::Uniform(_) => 0,
                Shape::Mixed(starts) => starts.size(),
            }
    }
}

/// The vertices that some faces of `N` corners need; none if one meets a vertex twice.
fn count_needed<const N: usize>(corners: &[u32], faces: Range<usize>) -> Option<u32> {
    let faces = corners[N * faces.start..N * faces.end].as_chunks::<N>().0;
    let (mut highest, mut repeats) = (0, false);
    for face in faces {
        for i in 0..N {
            highest = highest.max(face[i]);
            for j in 0..i {
                repeats |= face[i] == face[j];
            }
        }
    }
    (!repeats).then_some(if faces.is_empty() { 0 } else { highest.saturating_add(1) })
}

/// Faces up to this many corners are searched for repeated ones pair by pair; larger ones are sorted.
const FEW_CORNERS: usize = 16;

fn check_face(face: usize, corners: &[u32], vertices: usize) -> Result<(), MeshError> {
    if let Some(&vertex) = corners.iter().find(|&&vertex| vertices <= vertex as usize) {
        return Err(MeshError::NoVertex { face, vertex, vertices });
    }
    match repeated(corners) {
        Some(place) => Err(MeshError::RepeatedVertex { face, vertex: corners[place] }),
        None => Ok(()),
    }
}

/// The first corner whose vertex an earlier one has, too.
#[inline]
fn repeated(corners: &[u32]) -> Option<usize> {
    // What most faces are, without a loop.
    if let [a, b, c, d] = *corners
        && a != b
        && c != d
        && ![a, b].iter().any(|vertex| [c, d].contains(vertex))
    {
        return None;
    }
    if corners.len() <= FEW_CORNERS {
        return (1..corners.len()).find(|&k| corners[..k].contains(&corners[k]));
    }
    let mut places: Vec<(u32, usize)> = corners.iter().copied().zip(0..).collect();
    places.sort_unstable();
    let repeats = places.windows(2).filter(|pair| pair[0].0 == pair[1].0);
    repeats.map(|pair| pair[1].1).min()
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
