//! The next and the previous half-edge in a face.

use std::iter;

use maquette_value::Faces;
use maquette_value::memory::huge_vec;

use super::by_faces::by_faces;

/// The cyclic order of the half-edges of each face.
#[derive(Debug)]
pub(crate) enum FaceOrder {
    Triangles,
    Quads,
    /// Faces with any number of sides. The first list has the face of each half-edge, the second list the first half-edge of each face,
    /// followed by the total number of half-edges.
    Polygons(Vec<u32>, Vec<u32>),
}

impl FaceOrder {
    pub(crate) fn new(faces: &Faces) -> Self {
        match faces.sides() {
            Some(3) => Self::Triangles,
            Some(4) => Self::Quads,
            _ => {
                let mut of_halves = huge_vec(faces.corners().len());
                by_faces(faces, 0..faces.len(), &mut of_halves, |here, to| {
                    let of_halves =
                        here.flat_map(|k| iter::repeat_n(k as u32, faces.face(k).len()));
                    to.iter_mut().zip(of_halves).for_each(|(to, face)| *to = face);
                });
                Self::Polygons(
                    of_halves,
                    (0..=faces.len())
                        .map(|face: usize| faces.first_corner(face) as u32)
                        .collect::<Vec<_>>(),
                )
            }
        }
    }

    pub(crate) fn next(&self, half: u32) -> u32 {
        match self {
            Self::Triangles if half % 3 == 2 => half - 2,
            Self::Triangles => half + 1,
            Self::Quads => half & !3 | (half + 1) & 3,
            Self::Polygons(faces, firsts) => {
                let face = faces[half as usize] as usize;
                if half + 1 == firsts[face + 1] { firsts[face] } else { half + 1 }
            }
        }
    }

    pub(crate) fn previous(&self, half: u32) -> u32 {
        match self {
            Self::Triangles if half.is_multiple_of(3) => half + 2,
            Self::Triangles => half - 1,
            Self::Quads => half & !3 | half.wrapping_sub(1) & 3,
            Self::Polygons(faces, firsts) => {
                let face = faces[half as usize] as usize;
                if half == firsts[face] { firsts[face + 1] - 1 } else { half - 1 }
            }
        }
    }

    /// Returns the face to which a half-edge belongs.
    pub(crate) fn face(&self, half: u32) -> u32 {
        match self {
            Self::Triangles => half / 3,
            Self::Quads => half / 4,
            Self::Polygons(faces, _) => faces[half as usize],
        }
    }

    /// Returns the memory that this value uses, in bytes.
    pub(crate) fn size(&self) -> usize {
        match self {
            Self::Triangles | Self::Quads => 0,
            Self::Polygons(faces, firsts) => 4 * (faces.len() + firsts.len()),
        }
    }
}
