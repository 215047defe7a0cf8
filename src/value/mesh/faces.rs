//! The faces of a mesh, and the edges between them.

use std::ops::Range;
use std::sync::{Arc, OnceLock};

use super::derived::FaceBins;
use super::edges::Edges;
use super::{BLOCK, MeshError, check_count};
use crate::content::Content;
use crate::memory::huge_vec;
use crate::parallel::*;
use crate::{Column, DecodeError, Decoder, Encoder};

/// The faces of a mesh: for each corner, the index of its vertex. The corners of a face are counter-clockwise seen from outside.
///
/// Invariant, checked by its constructors: every face has at least 3 corners.
#[derive(Clone, Debug)]
pub struct Faces {
    corners: Column<u32>,
    shape: Shape,
    /// The minimum number of vertices that a mesh with these faces must have, which is the highest vertex index plus 1. `None` if a face
    /// contains a vertex twice. Computed on first use and shared by copies.
    min_vertices: Arc<OnceLock<Option<u32>>>,
    /// The bins of vertices that each block of faces uses. Computed on first use and shared by copies.
    face_bins: Arc<OnceLock<FaceBins>>,
}

impl PartialEq for Faces {
    fn eq(&self, other: &Self) -> bool {
        self.corners == other.corners && self.shape == other.shape
    }
}

#[derive(Clone, Debug, PartialEq)]
enum Shape {
    /// The number of corners that each face has.
    Uniform(usize),
    /// The index of the first corner of each face; the last entry is the number of corners.
    Mixed(Column<u32>),
}

impl Faces {
    /// Builds faces of `sides` corners each.
    ///
    /// # Errors
    /// If `sides` is less than 3 or does not divide the number of corners.
    pub fn uniform(sides: usize, corners: impl Into<Column<u32>>) -> Result<Self, MeshError> {
        let corners = corners.into();
        if sides < 3 {
            return Err(few_corners(0, sides));
        }
        if corners.len() % sides != 0 {
            return Err(cut_off(corners.len(), sides));
        }
        check_count("corners", corners.len())?;
        Ok(Self::new(corners, Shape::Uniform(sides)))
    }

    /// Builds faces of three corners each.
    pub fn triangles(triangles: Vec<[u32; 3]>) -> Self {
        Self::new(triangles.into_flattened().into(), Shape::Uniform(3))
    }

    /// Builds faces with the given numbers of corners, in order.
    ///
    /// # Errors
    /// If a face has fewer than 3 corners, or the sum of the numbers is not the number of corners.
    pub fn polygons(sides: &[usize], corners: Vec<u32>) -> Result<Self, MeshError> {
        if let Some(face) = sides.iter().position(|&sides| sides < 3) {
            return Err(few_corners(face, sides[face]));
        }
        if sides.iter().sum::<usize>() != corners.len() {
            return Err(cut_off(corners.len(), 0));
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
        Self { corners, shape, min_vertices: Arc::default(), face_bins: Arc::default() }
    }

    pub(crate) fn face_bins(&self) -> &FaceBins {
        self.face_bins.get().unwrap_or_else(|| {
            // The index is computed outside of the lock, because the thread pool may meanwhile run other work that needs the same value.
            let face_bins = FaceBins::new(self);
            self.face_bins.get_or_init(|| face_bins)
        })
    }

    /// Checks that all corners refer to one of `vertices` vertices, and that no face contains a vertex twice. The result is cached and
    /// shared by copies of the faces, so the faces are read only once.
    pub(super) fn check(&self, vertices: usize) -> Result<(), MeshError> {
        match self.min_vertices() {
            Some(needed) if needed as usize <= vertices => Ok(()),
            _ => {
                let bad = (0..self.len())
                    .find_map(|face| check_face(face, self.face(face), vertices).err());
                bad.map_or(Ok(()), Err)
            }
        }
    }

    /// The minimum number of vertices that the corners require. `None` if a face contains a vertex twice.
    pub fn min_vertices(&self) -> Option<u32> {
        *self.min_vertices.get_or_init(|| self.compute_min_vertices())
    }

    fn compute_min_vertices(&self) -> Option<u32> {
        let blocks = (0..self.len().div_ceil(BLOCK)).into_par_iter();
        blocks
            .map(|block| self.min_vertices_of_block(block))
            .collect::<Vec<_>>()
            .into_iter()
            .try_fold(0, |highest, of_block| Some(of_block?.max(highest)))
    }

    fn min_vertices_of_block(&self, block: usize) -> Option<u32> {
        let mut faces = block * BLOCK..self.len().min((block + 1) * BLOCK);
        match self.sides() {
            Some(3) => min_vertices_of_faces::<3>(&self.corners, faces),
            Some(4) => min_vertices_of_faces::<4>(&self.corners, faces),
            _ => faces.try_fold(0, |highest, face| {
                let face = self.face(face);
                let needed = face.iter().max().map_or(0, |vertex| vertex.saturating_add(1));
                first_repeated_vertex(face).is_none().then(|| u32::max(highest, needed))
            }),
        }
    }

    /// The number of faces.
    pub fn len(&self) -> usize {
        match &self.shape {
            Shape::Uniform(sides) => self.corners.len() / sides,
            Shape::Mixed(starts) => starts.len() - 1,
        }
    }

    /// Returns true if there are no faces.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The number of corners per face. `None` if the faces have different numbers of corners.
    pub fn sides(&self) -> Option<usize> {
        match self.shape {
            Shape::Uniform(sides) => Some(sides),
            Shape::Mixed(_) => None,
        }
    }

    /// All faces as triangles. `None` if a face does not have three corners.
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

    /// The vertices of a face.
    ///
    /// # Panics
    /// If there is no such face.
    #[inline]
    pub fn face(&self, face: usize) -> &[u32] {
        &self.corners[self.first_corner(face)..self.first_corner(face + 1)]
    }

    /// Iterates over the vertices of each face. The loop [stops](UntilStopped) with the running computation.
    pub fn iter(&self) -> impl Iterator<Item = &[u32]> {
        (0..self.len()).until_stopped().map(|face| self.face(face))
    }

    /// The vertices of all corners, face by face.
    pub fn corners(&self) -> &Column<u32> {
        &self.corners
    }

    /// The edges of the faces, each edge once.
    pub fn edges(&self) -> Edges {
        Edges::new(self)
    }

    /// Writes the faces as one part of a value that contains them.
    pub fn encode(&self, to: &mut Encoder) {
        let (sides, starts) = match &self.shape {
            Shape::Uniform(sides) => (*sides, None),
            Shape::Mixed(starts) => (0, Some(starts)),
        };
        to.column(&self.corners).counts(&[sides]).option(starts, |to, starts| {
            to.column(starts);
        });
    }
}

impl Content for Faces {
    fn encode(&self, to: &mut Encoder) {
        self.encode(to);
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let corners = from.column()?;
        let [sides] = from.counts()?;
        let shape = from.option(Decoder::column)?.map_or(Shape::Uniform(sides), Shape::Mixed);
        Ok(Self::new(corners, shape))
    }

    fn size(&self) -> usize {
        self.corners.size()
            + match &self.shape {
                Shape::Uniform(_) => 0,
                Shape::Mixed(starts) => starts.size(),
            }
    }
}

fn few_corners(face: usize, corners: usize) -> MeshError {
    MeshError::Invalid(format!("face {face} has {corners} corners; a face has at least 3"))
}

fn cut_off(corners: usize, sides: usize) -> MeshError {
    MeshError::Invalid(format!("{corners} corners do not make faces of {sides} corners each"))
}

/// The minimum number of vertices that some faces of `N` corners require. `None` if a face contains a vertex twice.
fn min_vertices_of_faces<const N: usize>(corners: &[u32], faces: Range<usize>) -> Option<u32> {
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

/// The maximum number of corners of a face that is searched for repeated vertices pair by pair. The corners of larger faces are sorted.
const FEW_CORNERS: usize = 16;

fn check_face(face: usize, corners: &[u32], vertices: usize) -> Result<(), MeshError> {
    if let Some(&vertex) = corners.iter().find(|&&vertex| vertices <= vertex as usize) {
        return Err(MeshError::Invalid(format!(
            "face {face} refers to vertex {vertex}, but there are only {vertices}"
        )));
    }
    match first_repeated_vertex(corners) {
        Some(corner) => {
            let vertex = corners[corner];
            Err(MeshError::Invalid(format!("face {face} contains vertex {vertex} twice")))
        }
        None => Ok(()),
    }
}

/// The first corner whose vertex is also at an earlier corner of the face. `None` if all vertices differ.
#[inline]
fn first_repeated_vertex(corners: &[u32]) -> Option<usize> {
    // The common case, a quad without a repeated vertex, needs no loop.
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
    let mut sorted: Vec<(u32, usize)> = corners.iter().copied().zip(0..).collect();
    sorted.sort_unstable();
    let repeats = sorted.windows(2).filter(|pair| pair[0].0 == pair[1].0);
    repeats.map(|pair| pair[1].1).min()
}
