//! OBJ, the text format of Wavefront: vertices, texture coordinates, normals and polygons.
//!
//! Read as a mesh, lines, groups and free-form geometry are passed over, and [`picture`] finds the picture on it; read as a curve, all but lines and free-form
//! curves. Surfaces and B-spline curves are written as free-form geometry, which loses nothing.

use maquette_value::{Attribute, CurveError, KnotVectorError, Mesh, MeshError, Rgb};
use nalgebra::Point3;
use thiserror::Error;

use super::corners::{FaceList, with_corners};
use super::finite::{self, Finite};
use super::{excerpt, parse, picture_file, words};

mod curve;
mod free_form;
mod material;
mod write;

pub use curve::read_curve;
pub(super) use free_form::{CurveObj, SurfaceObj};
pub use material::{Find, Picture, picture};
pub(super) use write::MeshObj;

/// Why bytes are not a mesh in an OBJ file.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ObjError {
    /// A word that is no number.
    #[error("line {line}: `{text}` is not a number")]
    Number {
        /// The line, from 1.
        line: usize,
        /// The word.
        text: String,
    },
    /// Too few numbers.
    #[error("line {line}: {found} numbers, where there must be at least {expected}")]
    Count {
        /// The line, from 1.
        line: usize,
        /// Numbers in it.
        found: usize,
        /// Numbers that there must be.
        expected: usize,
    },
    /// A corner that is not written as `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    #[error("line {line}: `{text}` is not a corner of a face")]
    Corner {
        /// The line, from 1.
        line: usize,
        /// The word.
        text: String,
    },
    /// A corner that names what is not there.
    #[error("line {line}: there is no {what} {index} among the {count} so far")]
    Index {
        /// The line, from 1.
        line: usize,
        /// `v`, `vt` or `vn`.
        what: &'static str,
        /// The number in the file.
        index: i64,
        /// How many there are before this line.
        count: usize,
    },
    /// A face with too few corners.
    #[error("line {line}: a face of {corners} corners")]
    FewCorners {
        /// The line, from 1.
        line: usize,
        /// Its corners.
        corners: usize,
    },
    /// Something else, or nothing.
    #[error("there is no vertex in the file")]
    Empty,
    /// A mesh that cannot be.
    #[error(transparent)]
    Mesh(MeshError),
    /// No line and no free-form curve, where one is wanted.
    #[error("there is no curve in the file: no line `l` and no `curv`")]
    NoCurve,
    /// A second curve.
    #[error(
        "line {line}: another curve begins here, which does not go on where the one before it ends"
    )]
    SecondCurve {
        /// The line, from 1.
        line: usize,
    },
    /// A free-form curve of another kind.
    #[error("line {line}: {what}")]
    FreeForm {
        /// The line, from 1.
        line: usize,
        /// What is not as it must be.
        what: &'static str,
    },
    /// Points that make no curve.
    #[error(transparent)]
    Curve(#[from] CurveError),
    /// Parameters that are no knots.
    #[error(transparent)]
    Knots(#[from] KnotVectorError),
}

/// The mesh in an OBJ file.
///
/// `vt` becomes the pairs `uv`, `vn` the vectors `normal`: attributes of vertices if each vertex has the same one at all of its
/// corners, else of corners; a corner without one has zeros. Colors behind the coordinates of all vertices (`v x y z r g b`, 0 to 1)
/// become the colors `color`. Corners that repeat the vertex before them are dropped.
///
/// # Errors
/// If a line cannot be understood, names what is not there yet, or vertices and faces make no mesh.
pub fn read(bytes: &[u8]) -> Result<Mesh, ObjError> {
    let mut reader = Reader::default();
    for_lines(bytes, |text, line| reader.read_line(text, line))?;
    Ok(reader.finish()?.0)
}

/// The mesh in an OBJ file with its picture, if `find` gives it and there are texture coordinates; and what the user should know.
///
/// # Errors
/// As for [`read`].
pub fn read_textured(bytes: &[u8], find: Find<'_>) -> Result<(Mesh, Vec<String>), ObjError> {
    let mut reader = Reader::default();
    for_lines(bytes, |text, line| reader.read_line(text, line))?;
    let (mesh, left_out) = reader.finish()?;
    let mut doubts = Vec::from_iter(finite::doubt(left_out, "face"));
    if mesh.vertex().pairs("uv").is_none() && mesh.corner().pairs("uv").is_none() {
        return Ok((mesh, doubts));
    }
    let Picture { file, doubts: more } = picture(bytes, find);
    doubts.extend(more);
    let image = file.and_then(|(name, bytes)| match picture_file::read(&bytes) {
        Ok(image) => Some(image),
        Err(error) => {
            doubts.push(format!("{name}: {error}: the mesh comes without its picture"));
            None
        }
    });
    Ok((mesh.with_texture(image), doubts))
}

/// Calls `read` with the words of each line, joined with those that a `\` at its end goes on in, and the number of its first one.
fn for_lines(
    bytes: &[u8],
    mut read: impl FnMut(&[u8], usize) -> Result<(), ObjError>,
) -> Result<(), ObjError> {
    let mut lines = bytes.split(|&byte| byte == b'\n').enumerate();
    while let Some((index, text)) = lines.next() {
        let text = text.trim_ascii_end();
        let Some(start) = text.strip_suffix(b"\\") else {
            read(without_comment(text), index + 1)?;
            continue;
        };
        // Only a line that goes on in the next one is copied.
        let mut joined = start.to_vec();
        for (_, next) in lines.by_ref() {
            let next = next.trim_ascii_end();
            let part = next.strip_suffix(b"\\");
            joined.push(b' ');
            joined.extend_from_slice(part.unwrap_or(next));
            if part.is_none() {
                break;
            }
        }
        read(without_comment(&joined), index + 1)?;
    }
    Ok(())
}

fn without_comment(text: &[u8]) -> &[u8] {
    let end = text.iter().position(|&byte| byte == b'#').unwrap_or(text.len());
    &text[..end]
}

/// Stands for what a corner does not have.
const NONE: u32 = u32::MAX;

#[derive(Default)]
struct Reader {
    positions: Vec<Point3<f64>>,
    colors: Vec<Rgb>,
    texture: Vec<[f64; 2]>,
    normals: Vec<[f64; 3]>,
    faces: FaceList,
    /// The texture coordinate and the normal of each corner by their numbers, [`NONE`] where it has none.
    corner_texture: Vec<u32>,
    corner_normals: Vec<u32>,
    /// The vertices of the face that is being read.
    face: Vec<u32>,
}

impl Reader {
    fn read_line(&mut self, text: &[u8], line: usize) -> Result<(), ObjError> {
        let mut words = words(text);
        match words.next() {
            Some(b"v") => {
                let (numbers, count) = numbers::<7>(words, 3, line)?;
                self.positions.push(Point3::new(numbers[0], numbers[1], numbers[2]));
                // A fourth number alone is a weight, which polygons do not use.
                if count >= 6 {
                    let byte = |k: usize| (numbers[k] * 255.0).round() as u8;
                    self.colors.push([byte(3), byte(4), byte(5)]);
                }
            }
            Some(b"vt") => {
                let (numbers, _) = numbers::<2>(words, 1, line)?;
                self.texture.push(numbers);
            }
            Some(b"vn") => {
                let (numbers, _) = numbers::<3>(words, 3, line)?;
                self.normals.push(numbers);
            }
            Some(b"f") => self.read_face(words, line)?,
            _ => {}
        }
        Ok(())
    }

    fn read_face<'a>(
        &mut self,
        corners: impl Iterator<Item = &'a [u8]>,
        line: usize,
    ) -> Result<(), ObjError> {
        self.face.clear();
        for corner in corners {
            let wrong = || ObjError::Corner { line, text: excerpt(corner) };
            let mut parts = corner.split(|&byte| byte == b'/');
            let mut next = |what, count| match parts.next() {
                None | Some(b"") => Ok(None),
                Some(part) => resolve(parse(part).ok_or_else(wrong)?, what, count, line).map(Some),
            };
            let vertex = next("v", self.positions.len())?.ok_or_else(wrong)?;
            let texture = next("vt", self.texture.len())?;
            let normal = next("vn", self.normals.len())?;
            if parts.next().is_some() {
                return Err(wrong());
            }
            self.face.push(vertex as u32);
            self.corner_texture.push(texture.map_or(NONE, |index| index as u32));
            self.corner_normals.push(normal.map_or(NONE, |index| index as u32));
        }
        match self.face.len() {
            corners @ 0..3 => Err(ObjError::FewCorners { line, corners }),
            _ => {
                self.faces.push(&self.face);
                Ok(())
            }
        }
    }

    /// The mesh, and how many faces were left out, since a vertex is at no finite place.
    fn finish(mut self) -> Result<(Mesh, usize), ObjError> {
        if self.positions.is_empty() {
            return Err(ObjError::Empty);
        }
        let finite = Finite::of(&mut self.positions);
        Ok(finite.mesh(self.into_mesh().map_err(ObjError::Mesh)?))
    }

    fn into_mesh(self) -> Result<Mesh, MeshError> {
        let (faces, origins) = self.faces.finish()?;
        let vertices = self.positions.len();
        let mut mesh = Mesh::new(self.positions, faces)?;
        if self.colors.len() == vertices {
            mesh = mesh.with_vertex("color", Attribute::Color(self.colors.into()))?;
        }
        if !self.texture.is_empty() {
            let data = corner_data(&self.texture, &self.corner_texture, &origins, [0.0; 2]);
            mesh = with_corners(mesh, "uv", data, [0.0; 2], Attribute::Pair)?;
        }
        if !self.normals.is_empty() {
            let data = corner_data(&self.normals, &self.corner_normals, &origins, [0.0; 3]);
            mesh = with_corners(mesh, "normal", data, [0.0; 3], Attribute::Vector)?;
        }
        Ok(mesh)
    }
}

/// The data of the corners that were kept; `none` for a corner without.
fn corner_data<T: Copy>(data: &[T], corners: &[u32], origins: &[usize], none: T) -> Vec<T> {
    let entry = |&origin: &usize| data.get(corners[origin] as usize).copied().unwrap_or(none);
    origins.iter().map(entry).collect()
}

/// The index that a number in a file means: 1 is the first of all, -1 the last so far.
fn resolve(index: i64, what: &'static str, count: usize, line: usize) -> Result<usize, ObjError> {
    let resolved = if index < 0 { index + count as i64 } else { index - 1 };
    match usize::try_from(resolved) {
        Ok(resolved) if resolved < count => Ok(resolved),
        _ => Err(ObjError::Index { line, what, index, count }),
    }
}

/// The first numbers of a line, at most N and at least `least`, and how many words there are.
fn numbers<'a, const N: usize>(
    words: impl Iterator<Item = &'a [u8]>,
    least: usize,
    line: usize,
) -> Result<([f64; N], usize), ObjError> {
    let mut numbers = [0.0; N];
    let mut found = 0;
    for (number, word) in numbers.iter_mut().zip(words) {
        *number = parse(word).ok_or_else(|| ObjError::Number { line, text: excerpt(word) })?;
        found += 1;
    }
    if found < least {
        return Err(ObjError::Count { line, found, expected: least });
    }
    Ok((numbers, found))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hostile;

    /// A square of two triangles and a quad below it, in all ways to write a corner.
    const PATCH: &str = "# a comment\nmtllib a.mtl\no patch\nv 0 0 0\r\nv 1 0 0 # another\nv 1 1 0\nv 0 1 0 1.0\n\
        v 0 -1 0\nv 1 -1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1 0\nvn 0 0 1\ng upper\nusemtl paint\ns off\n\
        f 1/1/1 2/2/1 3/3/1\nf 1/1 3/3/1 \\\n  4/4/\nf -2//1 6//-1 2 \\\r\n1\nl 1 2 3\n";

    #[test]
    fn corners_are_read_in_all_their_forms() {
        let mesh = read(PATCH.as_bytes()).unwrap();
        let faces = [&[0, 1, 2][..], &[0, 2, 3], &[4, 5, 1, 0]];
        assert_eq!(mesh.faces().iter().collect::<Vec<_>>(), faces);
        // Vertices 0 and 1 have no texture coordinate at the quad.
        assert_eq!(
            mesh.corner().pairs("uv").unwrap()[3..7],
            [[0., 0.], [1., 1.], [0., 1.], [0., 0.]]
        );
        assert_eq!(mesh.corner().vectors("normal").unwrap()[7], [0.0, 0.0, 1.0]);
    }

    #[test]
    fn texture_coordinates_that_agree_at_a_vertex_belong_to_the_vertex() {
        let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt 0 0\n\
            f 1/1 2/2 3/3\nf 1/5 3/3 4/4\n";
        let mesh = read(text.as_bytes()).unwrap();
        let expected = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        assert_eq!(mesh.vertex().pairs("uv").unwrap()[..], expected);
        assert!(mesh.corner().pairs("uv").is_none());
    }

    #[test]
    fn colors_follow_the_coordinates() {
        let mesh = read(b"v 0 0 0 1 0.5 0\nv 1 0 0 0 0 1").unwrap();
        assert_eq!(mesh.vertex().colors("color").unwrap()[..], [[255, 128, 0], [0, 0, 255]]);
        assert!(mesh.faces().is_empty());
    }

    #[test]
    fn dropped_corners_take_their_texture_coordinates_along() {
        let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 9 9\nvt 1 1\nf 1/1 1/1 2/2 2/2 3/4\nf 1/1 1/1 2/2\n";
        let mesh = read(text.as_bytes()).unwrap();
        assert_eq!(mesh.faces().iter().collect::<Vec<_>>(), [[0, 1, 2]]);
        assert_eq!(mesh.vertex().pairs("uv").unwrap()[..], [[0., 0.], [1., 0.], [1., 1.]]);
    }

    #[test]
    fn a_line_may_be_continued_more_than_once_and_at_the_end_of_the_file() {
        let mesh = read(b"v 0 \\\n0 \\\n 0\nv 1 0 0\nv 0 1 0\nf 1 \\\n\\\n2 3\\").unwrap();
        assert_eq!((mesh.positions().len(), mesh.faces().len()), (3, 1));
    }

    fn error(text: &str) -> String {
        read(text.as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn files_that_lie_are_refused_with_their_line() {
        let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
        let face = |line: &str| error(&format!("{vertices}{line}"));
        assert_eq!(face("f 1 2 4"), "line 4: there is no v 4 among the 3 so far");
        assert_eq!(face("f 1 2 -4"), "line 4: there is no v -4 among the 3 so far");
        assert_eq!(face("f 1 2 0"), "line 4: there is no v 0 among the 3 so far");
        assert_eq!(face("f 1/1 2 3"), "line 4: there is no vt 1 among the 0 so far");
        assert_eq!(face("f 1 2 \\\n x"), "line 4: `x` is not a corner of a face");
        assert_eq!(face("f 1 2 3////"), "line 4: `3////` is not a corner of a face");
        assert_eq!(face("f 1 2"), "line 4: a face of 2 corners");
        assert_eq!(face("f 1 2 3 1 2 3"), "face 0 meets vertex 0 twice");
        assert_eq!(
            face("f -9223372036854775808 2 3"),
            "line 4: there is no v -9223372036854775808 among the 3 so far"
        );
        assert_eq!(error("v 0 0"), "line 1: 2 numbers, where there must be at least 3");
        assert_eq!(error("v 0 0 z"), "line 1: `z` is not a number");
        assert_eq!(error("nothing of the kind"), "there is no vertex in the file");
    }

    #[test]
    fn hostile_files_give_errors() {
        hostile::survive(PATCH.as_bytes(), read);
    }
}
