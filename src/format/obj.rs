//! OBJ, the text format of Wavefront: vertices, texture coordinates, normals and polygons.
//!
//! Read as a mesh, lines, groups and free-form geometry are passed over; read as a curve, all but lines and free-form
//! curves. Surfaces and B-spline curves are written as free-form geometry, which loses nothing.

use std::collections::{BTreeMap, HashMap};

use lines::{for_lines, numbers, resolve, without_comment};
use maquette_value::{Attribute, CurveError, KnotVectorError, MATERIAL, Mesh, MeshError, Rgb};
use nalgebra::Point3;
use thiserror::Error;

use super::colors::{self, ColorRange};
use super::corners::{FaceList, with_corners};
use super::finite::{self, Finite};
use super::{excerpt, parse, words};

mod curve;
mod free_form;
mod lines;
mod looks;
mod material;
mod mtl;
mod write;

pub use curve::read_curve;
pub(super) use free_form::{CurveObj, SurfaceObj};
pub use material::{Find, materials};
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
    /// A corner that names what no line of the file has.
    #[error("line {line}: there is no {what} {index}: the file has {count}")]
    Missing {
        /// The line, from 1.
        line: usize,
        /// `v`, `vt` or `vn`.
        what: &'static str,
        /// The number in the file.
        index: usize,
        /// How many there are.
        count: usize,
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
/// corners, else of corners; a corner without one has zeros. Colors behind the coordinates of all vertices (`v x y z r g b`, or behind a
/// weight `v x y z w r g b`) become the colors `color`; whether they go to 1 or 255 the largest of them says. Corners that repeat the vertex before them are
/// dropped, a face that comes back to a vertex is cut there, and one with fewer than three corners is left out. A corner may name what stands
/// further below in the file.
///
/// # Errors
/// If a line cannot be understood, names what is not there yet, or vertices and faces make no mesh.
pub fn read(bytes: &[u8]) -> Result<Mesh, ObjError> {
    Ok(read_noted(bytes, None)?.0.without_face(MATERIAL))
}

/// The same, and what the user should know of what is left out or understood in one of several ways. Where faces have several materials, the
/// attribute [`MATERIAL`] has the place of each face's in the names that are given, or the place behind the last one.
fn read_noted(
    bytes: &[u8],
    color_range: Option<ColorRange>,
) -> Result<(Mesh, Vec<String>, Vec<String>), ObjError> {
    let mut reader = Reader { color_range, ..Reader::default() };
    for_lines(bytes, |text, line| reader.read_line(text, line))?;
    let used = std::mem::take(&mut reader.used);
    let (mesh, notes) = reader.finish(used.len() as u32)?;
    Ok((mesh, notes, used))
}

/// Stands for what a corner does not have.
const NONE: u32 = u32::MAX;

/// What a corner names of each kind of data.
const KINDS: [&str; 3] = ["v", "vt", "vn"];

/// Lines that say nothing of a mesh's shape: how it is called, grouped, shaded and drawn.
const SILENT: [&[u8]; 15] = [
    b"o",
    b"g",
    b"s",
    b"mg",
    b"mtllib",
    b"usemap",
    b"maplib",
    b"lod",
    b"bevel",
    b"c_interp",
    b"d_interp",
    b"shadow_obj",
    b"trace_obj",
    b"call",
    b"end",
];

#[derive(Default)]
struct Reader {
    /// The range of colors, if the user says it.
    color_range: Option<ColorRange>,
    positions: Vec<Point3<f64>>,
    /// What stands behind the coordinates of a vertex.
    behind: Vec<[f64; 4]>,
    /// How many numbers stand behind them at some vertex: the fewest and the most.
    counts: Option<(usize, usize)>,
    /// Colors that ZBrush writes in comments.
    painted: Vec<Rgb>,
    texture: Vec<[f64; 2]>,
    normals: Vec<[f64; 3]>,
    faces: FaceList,
    /// The texture coordinate and the normal of each corner by their numbers, [`NONE`] where it has none.
    corner_texture: Vec<u32>,
    corner_normals: Vec<u32>,
    /// The vertices of the face that is being read.
    face: Vec<u32>,
    /// Corners that name what stands further below: the line, the kind and the number.
    forward: Vec<(usize, usize, usize)>,
    /// The names of materials in the order in which they are first used.
    used: Vec<String>,
    /// The place of each of them.
    places: HashMap<String, u32>,
    /// The place of the name of each face's material; the one behind the last line `usemtl` is the last one.
    of_faces: Vec<u32>,
    current: Option<u32>,
    /// The first words of lines that are left out, and how many there are of each.
    left_out: BTreeMap<String, usize>,
}

impl Reader {
    fn read_line(&mut self, text: &[u8], line: usize) -> Result<(), ObjError> {
        if let Some(colors) = text.strip_prefix(b"#MRGB") {
            self.read_painted(colors.trim_ascii());
        }
        let mut words = words(without_comment(text));
        match words.next() {
            None => {}
            Some(b"v") => {
                let (numbers, count) = numbers::<7>(words, 3, line)?;
                self.positions.push(Point3::new(numbers[0], numbers[1], numbers[2]));
                let behind = count - 3;
                if behind > 0 {
                    self.behind.push([numbers[3], numbers[4], numbers[5], numbers[6]]);
                }
                let (fewest, most) = self.counts.unwrap_or((behind, behind));
                self.counts = Some((fewest.min(behind), most.max(behind)));
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
            Some(b"usemtl") => {
                let text = text.trim_ascii_start();
                let name = String::from_utf8_lossy(&text[b"usemtl".len()..]).trim().to_owned();
                let next = self.used.len() as u32;
                let place = *self.places.entry(name.clone()).or_insert(next);
                if place == next {
                    self.used.push(name);
                }
                self.current = Some(place);
            }
            Some(word) if SILENT.contains(&word) => {}
            Some(word) => {
                let word = excerpt(word);
                // A file of something else has any number of words.
                if self.left_out.len() < 16 || self.left_out.contains_key(&word) {
                    *self.left_out.entry(word).or_default() += 1;
                }
            }
        }
        Ok(())
    }

    /// Colors of vertices in their order, each eight hexadecimal digits: a mask, red, green, blue.
    fn read_painted(&mut self, text: &[u8]) {
        fn byte(digits: &[u8]) -> Option<u8> {
            u8::from_str_radix(str::from_utf8(digits).ok()?, 16).ok()
        }
        let color =
            |entry: &[u8]| Some([byte(&entry[2..4])?, byte(&entry[4..6])?, byte(&entry[6..8])?]);
        self.painted.extend(text.chunks_exact(8).map_while(color));
    }

    fn read_face<'a>(
        &mut self,
        corners: impl Iterator<Item = &'a [u8]>,
        line: usize,
    ) -> Result<(), ObjError> {
        self.face.clear();
        let counts = [self.positions.len(), self.texture.len(), self.normals.len()];
        for corner in corners {
            let wrong = || ObjError::Corner { line, text: excerpt(corner) };
            let mut parts = corner.split(|&byte| byte == b'/');
            let mut next = |kind: usize| match parts.next() {
                None | Some(b"") => Ok(None),
                Some(part) => match parse(part).ok_or_else(wrong)? {
                    // Some programs write faces before what they name.
                    index @ 1..0xffff_ffff if index as usize > counts[kind] => {
                        self.forward.push((line, kind, index as usize));
                        Ok(Some(index as usize - 1))
                    }
                    index => resolve(index, KINDS[kind], counts[kind], line).map(Some),
                },
            };
            let vertex = next(0)?.ok_or_else(wrong)?;
            let (texture, normal) = (next(1)?, next(2)?);
            if parts.next().is_some() {
                return Err(wrong());
            }
            self.face.push(vertex as u32);
            self.corner_texture.push(texture.map_or(NONE, |index| index as u32));
            self.corner_normals.push(normal.map_or(NONE, |index| index as u32));
        }
        let count = self.faces.push(&self.face);
        self.of_faces.resize(self.of_faces.len() + count, self.current.unwrap_or(NONE));
        Ok(())
    }

    /// The mesh, and what the user should know; `none` stands for the material of faces that have none.
    fn finish(mut self, none: u32) -> Result<(Mesh, Vec<String>), ObjError> {
        if self.positions.is_empty() {
            return Err(ObjError::Empty);
        }
        let counts = [self.positions.len(), self.texture.len(), self.normals.len()];
        if let Some(&(line, kind, index)) =
            self.forward.iter().find(|(_, kind, index)| *index > counts[*kind])
        {
            return Err(ObjError::Missing { line, what: KINDS[kind], index, count: counts[kind] });
        }
        let mut notes = self.faces.notes();
        notes.extend(self.left_out.iter().map(|(word, count): (&String, &usize)| match count {
            1 => format!("a line `{word}` is left out"),
            more => format!("{more} lines `{word}` are left out"),
        }));
        let finite = Finite::of(&mut self.positions);
        let colors = self.take_colors(&mut notes);
        let mesh = self.into_mesh(colors, none, &mut notes).map_err(ObjError::Mesh)?;
        let (mesh, left_out) = finite.mesh(mesh);
        notes.extend(finite::doubt(left_out, "face"));
        Ok((mesh, notes))
    }

    /// The colors of all vertices, if all have one.
    fn take_colors(&mut self, notes: &mut Vec<String>) -> Option<Vec<Rgb>> {
        let behind = std::mem::take(&mut self.behind);
        let first = match self.counts {
            Some((3, 3)) => 0,
            // Four numbers are a weight before the color, or an opacity behind it, which is the same everywhere.
            Some((4, 4)) if is_opacity(&behind) => 0,
            Some((4, 4)) => 1,
            // A number alone is a weight, which polygons do not use.
            Some((_, 3..)) => {
                notes.push("colors are left out: some vertices have none".to_owned());
                return None;
            }
            _ if self.painted.len() == self.positions.len() => {
                return Some(std::mem::take(&mut self.painted));
            }
            _ => {
                if !self.painted.is_empty() {
                    notes.push(format!(
                        "colors of `#MRGB` are left out: there are {} for {} vertices",
                        self.painted.len(),
                        self.positions.len()
                    ));
                }
                return None;
            }
        };
        let channels = |numbers: &[f64; 4]| [0, 1, 2].map(|k| numbers[first + k]);
        let all = behind.iter().flat_map(channels);
        let range = colors::decide(self.color_range, all, false, ColorRange::To1, notes);
        let color =
            |numbers: &[f64; 4]| channels(numbers).map(|channel| colors::byte(range, channel));
        Some(behind.iter().map(color).collect())
    }

    fn into_mesh(
        self,
        colors: Option<Vec<Rgb>>,
        none: u32,
        notes: &mut Vec<String>,
    ) -> Result<Mesh, MeshError> {
        let (faces, origins) = self.faces.finish()?;
        let mut mesh = Mesh::new(self.positions, faces)?;
        if self.of_faces.windows(2).any(|pair| pair[0] != pair[1]) {
            let of_faces = self.of_faces.iter().map(|&place| place.min(none));
            mesh = mesh.with_face(MATERIAL, Attribute::Index(of_faces.collect()))?;
        }
        if let Some(colors) = colors {
            mesh = mesh.with_vertex("color", Attribute::Color(colors.into()))?;
        }
        if !self.texture.is_empty() {
            let mut data = corner_data(&self.texture, &self.corner_texture, &origins, [0.0; 2]);
            notes.extend(finite::mend(&mut data, "uv", "corner", |_| true));
            mesh = with_corners(mesh, "uv", data, [0.0; 2], Attribute::Pair)?;
        }
        if !self.normals.is_empty() {
            let mut data = corner_data(&self.normals, &self.corner_normals, &origins, [0.0; 3]);
            notes.extend(finite::mend(&mut data, "normal", "corner", |_| true));
            mesh = with_corners(mesh, "normal", data, [0.0; 3], Attribute::Vector)?;
        }
        Ok(mesh)
    }
}

/// Whether the fourth numbers behind the vertices are opacities: all are the largest of their range, and the first ones are not.
fn is_opacity(behind: &[[f64; 4]]) -> bool {
    fn all(k: usize, behind: &[[f64; 4]]) -> bool {
        behind.iter().all(|numbers| numbers[k] == behind[0][k])
    }
    all(3, behind) && !all(0, behind) && [1.0, 255.0].contains(&behind[0][3])
}

/// The data of the corners that were kept; `none` for a corner without.
fn corner_data<T: Copy>(data: &[T], corners: &[u32], origins: &[usize], none: T) -> Vec<T> {
    origins
        .iter()
        .map(|&origin| data.get(corners[origin] as usize).copied().unwrap_or(none))
        .collect()
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

    #[test]
    fn colors_are_read_in_whatever_range_they_are() {
        fn colors(text: &str) -> (Option<Vec<[u8; 3]>>, Vec<String>) {
            let (mesh, notes, _) = read_noted(text.as_bytes(), None).unwrap();
            (mesh.vertex().colors("color").map(|colors| colors.to_vec()), notes)
        }
        let expected = Some(vec![[255, 0, 0], [10, 200, 30]]);
        let to_255 = "colors are read as from 0 to 255, as their largest number says; `colors: To255` or another range says otherwise";
        for file in [
            "v 0 0 0 255 0 0\nv 1 0 0 10 200 30",
            // A weight before them, and an opacity behind them.
            "v 0 0 0 1.0 255 0 0\nv 1 0 0 1.0 10 200 30",
            "v 0 0 0 255 0 0 255\nv 1 0 0 10 200 30 255",
        ] {
            assert_eq!(colors(file), (expected.clone(), vec![to_255.to_owned()]), "{file}");
        }
        let painted = "v 0 0 0\nv 1 0 0\n#MRGB ffff0000ff0ac81e\n";
        assert_eq!(colors(painted), (expected, vec![]));
        let some = (None, vec!["colors are left out: some vertices have none".to_owned()]);
        assert_eq!(colors("v 0 0 0 1 0 0\nv 1 0 0"), some);
    }

    #[test]
    fn what_other_programs_write_is_read_and_what_is_left_out_is_told() {
        fn read(text: &str) -> (Mesh, Vec<String>) {
            let (mesh, notes, _) = read_noted(text.as_bytes(), None).unwrap();
            (mesh, notes)
        }
        let tetrahedron =
            "v 0 0 0\nv 10 0 0\nv 0 20 0\nv 0 0 30\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
        let (whole, notes) = read(tetrahedron);
        assert_eq!((whole.faces().len(), &notes[..]), (4, &[][..]));
        // Lines that end in CR alone, and faces before their vertices.
        assert_eq!(read(&tetrahedron.replace('\n', "\r")), (whole.clone(), vec![]));
        let (vertices, faces) = tetrahedron.split_at(tetrahedron.find('f').unwrap());
        assert_eq!(read(&format!("{faces}{vertices}")), (whole.clone(), vec![]));
        // Thin faces, one that comes back to a vertex, and lines that are no mesh's.
        let (mesh, notes) =
            read(&format!("{tetrahedron}f 1 2\nf 3\nf 1 2 3 1 4 2\nl 1 2\np 1\np 2\nsurf 0 1\n"));
        assert_eq!(mesh.faces().len(), 6);
        assert_eq!(
            notes,
            [
                "2 faces are left out: they have fewer than three different corners",
                "1 face meets a vertex twice, and is cut there",
                "a line `l` is left out",
                "2 lines `p` are left out",
                "a line `surf` is left out",
            ]
        );
        // Normals and texture coordinates that are no numbers, in all spellings.
        for nan in ["nan", "-nan(ind)", "1.#QNAN", "-1.#IND00", "inf", "-1.#INF"] {
            let text =
                format!("{vertices}vn {nan} 0 1\nvn 0 0 1\nvt 0 {nan}\nf 1/1/1 2/1/2 3/1/2\n");
            let (mesh, notes) = read(&text);
            assert_eq!(
                mesh.vertex().vectors("normal").unwrap()[..2],
                [[0.0; 3], [0.0, 0.0, 1.0]],
                "{nan}"
            );
            assert_eq!(
                notes,
                [
                    "`uv` of 3 corners is NaN or infinite: there are zeros in place of it",
                    "`normal` of 1 corner is NaN or infinite: there is a zero in place of it",
                ]
            );
        }
    }

    fn error(text: &str) -> String {
        read(text.as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn files_that_lie_are_refused_with_their_line() {
        let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
        fn face(line: &str, vertices: &str) -> String {
            error(&format!("{vertices}{line}"))
        }
        assert_eq!(face("f 1 2 4", vertices), "line 4: there is no v 4: the file has 3");
        assert_eq!(face("f 1 2 -4", vertices), "line 4: there is no v -4 among the 3 so far");
        assert_eq!(face("f 1 2 0", vertices), "line 4: there is no v 0 among the 3 so far");
        assert_eq!(face("f 1/1 2 3", vertices), "line 4: there is no vt 1: the file has 0");
        assert_eq!(face("f 1 2 \\\n x", vertices), "line 4: `x` is not a corner of a face");
        assert_eq!(face("f 1 2 3////", vertices), "line 4: `3////` is not a corner of a face");
        assert_eq!(
            face("f -9223372036854775808 2 3", vertices),
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
