//! OBJ, the text format of Wavefront: vertices, texture coordinates, normals and polygons.
//!
//! Reading a mesh ignores lines, groups and free-form geometry; reading a curve ignores everything except lines and free-form curves.
//! Surfaces and B-spline curves are written as free-form geometry, without loss.

use std::collections::{BTreeMap, HashMap};

use lines::{for_lines, numbers, resolve, without_comment};
use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::{Attribute, MATERIAL_ATTRIBUTE, Mesh, MeshError, Rgb};
use nalgebra::Point3;

use super::colors::{self, ColorRange};
use super::corners::{FaceList, add_corner_data};
use super::finite::{self, FiniteMask};
use super::{excerpt, parse, unjoined_note, words};

mod curve;
mod free_form;
mod lines;
mod material;
mod material_writer;
mod mtl;
mod write;

pub use curve::read_curve;
pub(super) use free_form::{CurveObj, SurfaceObj};
pub use material::{FindFile, materials};
pub(super) use write::MeshObj;

/// Reads a mesh from an OBJ file.
///
/// `vt` becomes the attribute `uv` of pairs, `vn` the attribute `normal` of vectors: attributes of vertices if all corners of each vertex
/// agree, else attributes of corners. A corner without a texture coordinate or normal gets zeros. If all vertices have colors after the
/// coordinates (`v x y z r g b`, or after a weight `v x y z w r g b`), the colors become `color`; their range, 1 or 255, is guessed from
/// the largest channel. Corners that repeat the previous vertex are dropped, a face that visits a vertex twice is cut at this vertex, and a
/// face with fewer than three corners is left out. A corner may refer to elements further below in the file.
///
/// Returns an error if a line is invalid or refers to a missing element, or the vertices and faces are not a valid mesh.
pub fn read(bytes: &[u8]) -> Result<Mesh, Error> {
    Ok(read_with_notes(bytes, None)?.0.without_face(MATERIAL_ATTRIBUTE))
}

/// Reads a mesh like [`read`]. Also returns warnings and the names of the mesh's materials. If faces have several materials, the attribute
/// [`MATERIAL_ATTRIBUTE`] of a face is an index into these names; for a face without a material it is the number of names.
fn read_with_notes(
    bytes: &[u8],
    color_range: Option<ColorRange>,
) -> Result<(Mesh, Vec<String>, Vec<String>), Error> {
    let mut reader = Reader { color_range, ..Reader::default() };
    for_lines(bytes, |text, line| reader.read_line(text, line))?;
    let used = std::mem::take(&mut reader.used);
    let (mesh, notes) = reader.finish(used.len() as u32)?;
    Ok((mesh, notes, used))
}

/// Marks a corner that has no texture coordinate or no normal.
const NONE: u32 = u32::MAX;

/// The kinds of elements to which a corner refers.
const KINDS: [&str; 3] = ["v", "vt", "vn"];

/// Keywords of lines that do not affect the shape: names, groups, shading and display options.
const IGNORED: [&[u8]; 15] = [
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
    /// The range of color channels, if the user has set it.
    color_range: Option<ColorRange>,
    positions: Vec<Point3<f64>>,
    /// Up to four numbers that follow the coordinates of each vertex.
    extra: Vec<[f64; 4]>,
    /// The minimum and the maximum count of numbers that follow the coordinates of a vertex.
    extra_counts: Option<(usize, usize)>,
    /// The vertex colors that ZBrush writes in comments.
    painted: Vec<Rgb>,
    texture: Vec<[f64; 2]>,
    normals: Vec<[f64; 3]>,
    faces: FaceList,
    /// For each corner the index of its texture coordinate, or [`NONE`]. `corner_normals` has the index of its normal, or [`NONE`].
    corner_texture: Vec<u32>,
    corner_normals: Vec<u32>,
    /// The vertices of the face that is currently being read.
    face: Vec<u32>,
    /// Corners that refer to elements further below in the file: the line, the kind of element and the index.
    forward: Vec<(usize, usize, usize)>,
    /// The names of materials in the order in which they are first used.
    used: Vec<String>,
    /// The index of each name in `used`.
    name_indices: HashMap<String, u32>,
    /// For each face the index of its material name.
    face_names: Vec<u32>,
    current: Option<u32>,
    /// The keywords of the ignored lines, each with the number of lines.
    left_out: BTreeMap<String, usize>,
}

impl Reader {
    fn read_line(&mut self, text: &[u8], line: usize) -> Result<(), Error> {
        if let Some(colors) = text.strip_prefix(b"#MRGB") {
            self.read_painted(colors.trim_ascii());
        }
        let mut words = words(without_comment(text));
        match words.next() {
            None => {}
            Some(b"v") => {
                let (numbers, count) = numbers::<7>(words, 3, line)?;
                self.positions.push(Point3::new(numbers[0], numbers[1], numbers[2]));
                let extra = count - 3;
                if extra > 0 {
                    self.extra.push([numbers[3], numbers[4], numbers[5], numbers[6]]);
                }
                let (min, max) = self.extra_counts.unwrap_or((extra, extra));
                self.extra_counts = Some((min.min(extra), max.max(extra)));
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
                let index = *self.name_indices.entry(name.clone()).or_insert(next);
                if index == next {
                    self.used.push(name);
                }
                self.current = Some(index);
            }
            Some(word) if IGNORED.contains(&word) => {}
            Some(word) => {
                let word = excerpt(word);
                // The limit of 16 words is necessary because a file of another format can have any number of different words.
                if self.left_out.len() < 16 || self.left_out.contains_key(&word) {
                    *self.left_out.entry(word).or_default() += 1;
                }
            }
        }
        Ok(())
    }

    /// Reads the colors of vertices in the order of the vertices. A color has eight hexadecimal digits: for mask, red, green and blue.
    fn read_painted(&mut self, text: &[u8]) {
        fn byte(digits: &[u8]) -> Option<u8> {
            u8::from_str_radix(str::from_utf8(digits).ok()?, 16).ok()
        }
        self.painted.extend(text.chunks_exact(8).map_while(|entry| {
            Some([byte(&entry[2..4])?, byte(&entry[4..6])?, byte(&entry[6..8])?])
        }));
    }

    fn read_face<'a>(
        &mut self,
        corners: impl Iterator<Item = &'a [u8]>,
        line: usize,
    ) -> Result<(), Error> {
        self.face.clear();
        let counts = [self.positions.len(), self.texture.len(), self.normals.len()];
        for corner in corners {
            let corner_error = || {
                let corner = excerpt(corner);
                Error::new(format!("line {line}: `{corner}` is not a corner of a face"))
            };
            let mut parts = corner.split(|&byte| byte == b'/');
            let mut next = |kind: usize| match parts.next() {
                None | Some(b"") => Ok(None),
                Some(part) => match parse(part).ok_or_else(corner_error)? {
                    // Some programs write faces before the vertices of these faces.
                    index @ 1..0xffff_ffff if index as usize > counts[kind] => {
                        self.forward.push((line, kind, index as usize));
                        Ok(Some(index as usize - 1))
                    }
                    index => resolve(index, KINDS[kind], counts[kind], line).map(Some),
                },
            };
            let vertex = next(0)?.ok_or_else(corner_error)?;
            let (texture, normal) = (next(1)?, next(2)?);
            if parts.next().is_some() {
                return Err(corner_error());
            }
            self.face.push(vertex as u32);
            self.corner_texture.push(texture.map_or(NONE, |index| index as u32));
            self.corner_normals.push(normal.map_or(NONE, |index| index as u32));
        }
        let count = self.faces.push(&self.face);
        self.face_names.resize(self.face_names.len() + count, self.current.unwrap_or(NONE));
        Ok(())
    }

    /// Returns the mesh and the warnings. `none` is the material index that faces without a material get.
    fn finish(mut self, none: u32) -> Result<(Mesh, Vec<String>), Error> {
        if self.positions.is_empty() {
            bail!("the file has no vertices");
        }
        let counts = [self.positions.len(), self.texture.len(), self.normals.len()];
        if let Some(&(line, kind, index)) =
            self.forward.iter().find(|(_, kind, index)| *index > counts[*kind])
        {
            let (what, count) = (KINDS[kind], counts[kind]);
            bail!("line {line}: there is no {what} {index}: the file has {count}");
        }
        let mut notes = self.faces.notes();
        notes.extend(self.left_out.iter().map(|(word, count): (&String, &usize)| match count {
            1 => format!("a line `{word}` is left out"),
            more => format!("{more} lines `{word}` are left out"),
        }));
        let finite = FiniteMask::clear_non_finite(&mut self.positions);
        let colors = self.take_colors(&mut notes);
        let mesh = self.into_mesh(colors, none, &mut notes)?;
        let (mesh, left_out) = finite.mesh(mesh);
        notes.extend(finite::left_out_note(left_out, "face"));
        notes.extend(unjoined_note(&mesh));
        Ok((mesh, notes))
    }

    /// Returns the colors of all vertices; `None` if a vertex has no color.
    fn take_colors(&mut self, notes: &mut Vec<String>) -> Option<Vec<Rgb>> {
        let extra = std::mem::take(&mut self.extra);
        let first = match self.extra_counts {
            Some((3, 3)) => 0,
            // Four numbers are either a weight and a color, or a color and an opacity. An opacity is constant.
            Some((4, 4)) if is_opacity(&extra) => 0,
            Some((4, 4)) => 1,
            // A single number is a weight, which is irrelevant for polygons.
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
        let colors: Vec<[f64; 3]> =
            extra.iter().map(|numbers| [0, 1, 2].map(|k| numbers[first + k])).collect();
        let channels = colors.iter().flatten().copied();
        let range = colors::decide(self.color_range, channels, false, ColorRange::To1, notes);
        Some(
            colors
                .into_iter()
                .map(|color: [f64; 3]| color.map(|channel| colors::byte(range, channel)))
                .collect(),
        )
    }

    fn into_mesh(
        self,
        colors: Option<Vec<Rgb>>,
        none: u32,
        notes: &mut Vec<String>,
    ) -> Result<Mesh, MeshError> {
        let (faces, origins) = self.faces.finish()?;
        let mut mesh = Mesh::new(self.positions, faces)?;
        if self.face_names.windows(2).any(|pair| pair[0] != pair[1]) {
            let face_names = self.face_names.iter().map(|&index| index.min(none));
            mesh = mesh.with_face(MATERIAL_ATTRIBUTE, Attribute::Index(face_names.collect()))?;
        }
        if let Some(colors) = colors {
            mesh = mesh.with_vertex("color", Attribute::Color(colors.into()))?;
        }
        if !self.texture.is_empty() {
            let mut data = corner_data(&self.texture, &self.corner_texture, &origins, [0.0; 2]);
            notes.extend(finite::replace_non_finite(&mut data, "uv", "corner", |_| true));
            mesh = add_corner_data(mesh, "uv", data, [0.0; 2], Attribute::Pair)?;
        }
        if !self.normals.is_empty() {
            let mut data = corner_data(&self.normals, &self.corner_normals, &origins, [0.0; 3]);
            notes.extend(finite::replace_non_finite(&mut data, "normal", "corner", |_| true));
            mesh = add_corner_data(mesh, "normal", data, [0.0; 3], Attribute::Vector)?;
        }
        Ok(mesh)
    }
}

/// Returns true if the fourth number after the coordinates is an opacity. This is assumed if it is constantly 1 or 255, and the first
/// number is not constant.
fn is_opacity(extra: &[[f64; 4]]) -> bool {
    fn is_constant(k: usize, extra: &[[f64; 4]]) -> bool {
        extra.iter().all(|numbers| numbers[k] == extra[0][k])
    }
    is_constant(3, extra) && !is_constant(0, extra) && [1.0, 255.0].contains(&extra[0][3])
}

/// Returns the data of the corners that were not left out; `origins` are the indices of these corners in `corners`. A corner without data
/// gets `none`.
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

    /// A square of two triangles, and a quad below it; the corners are written in all notations.
    const PATCH: &str = "# a comment\nmtllib a.mtl\no patch\nv 0 0 0\r\nv 1 0 0 # another\nv 1 1 0\nv 0 1 0 1.0\n\
        v 0 -1 0\nv 1 -1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1 0\nvn 0 0 1\ng upper\nusemtl paint\ns off\n\
        f 1/1/1 2/2/1 3/3/1\nf 1/1 3/3/1 \\\n  4/4/\nf -2//1 6//-1 2 \\\r\n1\nl 1 2 3\n";

    #[test]
    fn corners_are_read_in_all_their_forms() {
        let mesh = read(PATCH.as_bytes()).unwrap();
        let faces = [&[0, 1, 2][..], &[0, 2, 3], &[4, 5, 1, 0]];
        assert_eq!(mesh.faces().iter().collect::<Vec<_>>(), faces);
        // The quad has no texture coordinates at vertices 0 and 1.
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
    fn dropped_corners_drop_their_texture_coordinates() {
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
    fn colors_are_read_in_any_range() {
        fn colors(text: &str) -> (Option<Vec<[u8; 3]>>, Vec<String>) {
            let (mesh, notes, _) = read_with_notes(text.as_bytes(), None).unwrap();
            (mesh.vertex().colors("color").map(|colors| colors.to_vec()), notes)
        }
        let expected = Some(vec![[255, 0, 0], [10, 200, 30]]);
        let to_255 = "colors are read as 0 to 255, guessed from their largest value; set `colors: To255` or another range if that is wrong";
        for file in [
            "v 0 0 0 255 0 0\nv 1 0 0 10 200 30",
            // The next file has a weight before each color, the last one an opacity after it.
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
    fn variants_of_other_programs_are_read_and_ignored_lines_are_reported() {
        fn read(text: &str) -> (Mesh, Vec<String>) {
            let (mesh, notes, _) = read_with_notes(text.as_bytes(), None).unwrap();
            (mesh, notes)
        }
        let tetrahedron =
            "v 0 0 0\nv 10 0 0\nv 0 20 0\nv 0 0 30\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
        let (expected, notes) = read(tetrahedron);
        assert_eq!((expected.faces().len(), &notes[..]), (4, &[][..]));
        // The lines end in CR alone; in the second case the faces come before their vertices.
        assert_eq!(read(&tetrahedron.replace('\n', "\r")), (expected.clone(), vec![]));
        let (vertices, faces) = tetrahedron.split_at(tetrahedron.find('f').unwrap());
        assert_eq!(read(&format!("{faces}{vertices}")), (expected.clone(), vec![]));
        // The file has degenerate faces, a face that visits a vertex twice, and lines that do not belong to a mesh.
        let (mesh, notes) =
            read(&format!("{tetrahedron}f 1 2\nf 3\nf 1 2 3 1 4 2\nl 1 2\np 1\np 2\nsurf 0 1\n"));
        assert_eq!(mesh.faces().len(), 6);
        assert_eq!(
            notes,
            [
                "2 faces are left out: they have fewer than three different corners",
                "1 face visits a vertex twice and is cut there",
                "a line `l` is left out",
                "2 lines `p` are left out",
                "a line `surf` is left out",
            ]
        );
        // The normals and texture coordinates are NaN or infinite, in all spellings.
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
    fn invalid_files_are_rejected_with_their_line() {
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
        assert_eq!(error("v 0 0"), "line 1: expected at least 3 numbers, found 2");
        assert_eq!(error("v 0 0 z"), "line 1: `z` is not a number");
        assert_eq!(error("nothing of the kind"), "the file has no vertices");
    }

    #[test]
    fn hostile_files_give_errors() {
        hostile::check_no_panic(PATCH.as_bytes(), read);
    }
}
