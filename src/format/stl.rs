//! STL, the triangles of printers: text or binary. It has no vertices, only corners; equal ones become one vertex.

use std::collections::HashMap;

use maquette_node::pack::{FileFormat, NewFile};
use maquette_node::reading::{FileReader, Reading};
use maquette_syntax::error;
use maquette_value::{Attribute, Mesh, MeshError, Rgb};
use nalgebra::{Point3, Vector3};
use thiserror::Error;

use super::corners::FaceList;
use super::left_out;
use super::rows::floats;
use super::upright::upright;
use super::{TooFar, check_mesh, coarse_mesh, excerpt, finite, open, real, words};

/// Why bytes are not a mesh in an STL file, or a mesh cannot be written as one.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum StlError {
    /// Something else.
    #[error(
        "this is no STL file: {bytes} bytes are no text that begins with `solid`, nor a header of 84 bytes and 50 for each triangle"
    )]
    NotStl {
        /// Bytes in the file.
        bytes: usize,
    },
    /// A binary file of another length than its header says.
    #[error(
        "{bytes} bytes, but the header counts {triangles} triangles, which take {}: the file is {}, or no STL file",
        84 + TRIANGLE as u64 * u64::from(*triangles),
        if (*bytes as u64) < 84 + TRIANGLE as u64 * u64::from(*triangles) { "cut off" } else { "damaged" }
    )]
    Length {
        /// Bytes in the file.
        bytes: usize,
        /// How many triangles there must be.
        triangles: u32,
    },
    /// A word where another one must be.
    #[error("line {line}: `{text}`, where there must be `{wanted}`")]
    Word {
        /// The line, from 1.
        line: usize,
        /// What is there.
        text: String,
        /// What must be there.
        wanted: &'static str,
    },
    /// A corner that is not three numbers.
    #[error("line {line}: a vertex has three numbers, not `{text}`")]
    Vertex {
        /// The line, from 1.
        line: usize,
        /// What is there.
        text: String,
    },
    /// A facet that is not a triangle.
    #[error("line {line}: a facet has three vertices, not {found}")]
    Facet {
        /// Its last line, from 1.
        line: usize,
        /// Its vertices.
        found: usize,
    },
    /// A text that ends inside a facet.
    #[error("line {line}: the file ends inside a facet")]
    Ends {
        /// Its last line, from 1.
        line: usize,
    },
    /// A text that ends before its last line.
    #[error("line {line}: the file ends without `endsolid`: it is cut off")]
    Open {
        /// Its last line, from 1.
        line: usize,
    },
    /// Vertices and faces that make no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A vertex that the format cannot tell.
    #[error(transparent)]
    TooFar(#[from] TooFar),
    /// More triangles than the format can count.
    #[error("{triangles} triangles are more than an STL file can count")]
    TooLarge {
        /// How many there are.
        triangles: usize,
    },
}

/// The mesh in an STL file, text or binary. Corners at the same place, bit by bit, are one vertex, in the order in which the
/// file first has them. Triangles with two equal corners are left out, and normals are not read: the corners' order says where
/// the outside is. Triangles with a corner that is NaN or infinite are left out, too. Colors of triangles, as Magics and VisCAM write them, become
/// the colors `color` of faces.
///
/// # Errors
/// If the bytes are not an STL file.
pub fn read(bytes: &[u8]) -> Result<Mesh, StlError> {
    Ok(read_noted(bytes)?.0)
}

/// The same, and what the user should know of what is left out or understood in one of several ways.
fn read_noted(bytes: &[u8]) -> Result<(Mesh, Vec<String>), StlError> {
    let (mut corners, mut notes) = (Corners::default(), Vec::new());
    let promised = bytes.get(80..84).and_then(|count| count.first_chunk());
    let promised = promised.map(|count| u32::from_le_bytes(*count));
    fn wanted(count: u32) -> usize {
        (count as usize).saturating_mul(TRIANGLE).saturating_add(84)
    }
    let is_text =
        bytes.trim_ascii_start().get(..5).is_some_and(|it| it.eq_ignore_ascii_case(b"solid"));
    // Programs that write while they scan do not come back to the count.
    let room = bytes.len().saturating_sub(84);
    fn is_longer(count: u32, room: usize, bytes: &[u8]) -> bool {
        let is_whole = room.is_multiple_of(TRIANGLE) && room > 0;
        bytes.len() > wanted(count) && (is_whole || count > 0)
    }
    // Binary headers may begin with `solid` too, but their length gives them away.
    if promised.is_some_and(|count| bytes.len() == wanted(count)) {
        read_binary(bytes, &mut corners);
    } else if is_text {
        read_text(bytes, &mut corners)?;
    } else if let Some(count) = promised.filter(|&count| is_longer(count, room, bytes)) {
        if room.is_multiple_of(TRIANGLE) {
            let there = room / TRIANGLE;
            notes.push(format!(
                "the header counts {count} triangles, but there are {there}: all are read"
            ));
            read_binary(bytes, &mut corners);
        } else {
            let end = wanted(count);
            notes.push(format!(
                "{} bytes at the end are left out: the header counts {count} triangles",
                bytes.len() - end
            ));
            read_binary(&bytes[..end], &mut corners);
        }
    } else {
        let bytes = bytes.len();
        // Four bytes of anything else would hardly be about as many.
        return Err(
            match promised.filter(|&count| {
                room.is_multiple_of(TRIANGLE) || wanted(count) / MOST_LACKING <= bytes
            }) {
                Some(triangles) => StlError::Length { bytes, triangles },
                None => StlError::NotStl { bytes },
            },
        );
    }
    notes.extend(corners.faces.notes());
    notes.extend(finite::doubt(corners.left_out, "face"));
    let (faces, _) = corners.faces.finish()?;
    let mut mesh = Mesh::new(corners.positions, faces)?;
    if corners.colors.iter().any(Option::is_some) {
        let colors = corners.colors.into_iter().map(|color| color.unwrap_or(corners.usual_color));
        mesh = mesh.with_face("color", Attribute::Color(colors.collect()))?;
    }
    Ok((mesh, notes))
}

/// The triangles behind a header.
fn read_binary(bytes: &[u8], corners: &mut Corners) {
    let (header, triangles) = bytes.split_at(84);
    // Magics gives the color of all triangles that have none of their own, and its channels are the other way round.
    let magics = header.windows(9).find_map(|window| window.strip_prefix(b"COLOR="));
    if let Some([red, green, blue]) = magics {
        corners.usual_color = [*red, *green, *blue];
    }
    for triangle in triangles.as_chunks::<TRIANGLE>().0 {
        fn number(k: usize, triangle: &[u8; 50]) -> f64 {
            let at = 12 + 4 * k;
            let bytes = [triangle[at], triangle[at + 1], triangle[at + 2], triangle[at + 3]];
            f64::from(f32::from_le_bytes(bytes))
        }
        let bits = u16::from_le_bytes([triangle[48], triangle[49]]);
        let has_own = (bits & 0x8000 != 0) != magics.is_some();
        let [low, middle, high] =
            [0, 5, 10].map(|shift: u16| ((u32::from(bits >> shift & 31) * 255 + 15) / 31) as u8);
        let color = if magics.is_some() { [low, middle, high] } else { [high, middle, low] };
        let places = [0, 3, 6]
            .map(|k| [number(k, triangle), number(k + 1, triangle), number(k + 2, triangle)]);
        corners.push(places, has_own.then_some(color));
    }
}

/// A file that is shorter by more than this is taken for none of its kind.
const MOST_LACKING: usize = 1000;

/// Bytes of a triangle: a normal and three corners of floats, and two bytes of anything.
const TRIANGLE: usize = 50;

/// Collects triangles by their corners' places.
#[derive(Default)]
struct Corners {
    positions: Vec<Point3<f64>>,
    vertices: HashMap<[u64; 3], u32>,
    faces: FaceList,
    /// The color of each face that has one.
    colors: Vec<Option<Rgb>>,
    /// That of the others.
    usual_color: Rgb,
    /// Triangles with a corner nowhere.
    left_out: usize,
}

impl Corners {
    fn push(&mut self, corners: [[f64; 3]; 3], color: Option<Rgb>) {
        if !corners.as_flattened().iter().all(|x| x.is_finite()) {
            self.left_out += 1;
            return;
        }
        let face = corners.map(|place| {
            *self.vertices.entry(place.map(f64::to_bits)).or_insert_with(|| {
                self.positions.push(place.into());
                // A file of more corners than that does not fit into any memory; the mesh would refuse it.
                (self.positions.len() - 1) as u32
            })
        });
        let faces = self.faces.push(&face);
        self.colors.extend(std::iter::repeat_n(color, faces));
    }
}

/// The lines `facet normal ..`, `outer loop`, three `vertex x y z`, `endloop`, `endfacet`, between `solid` and `endsolid`.
fn read_text(bytes: &[u8], corners: &mut Corners) -> Result<(), StlError> {
    let mut facet: Option<Vec<[f64; 3]>> = None;
    let (mut last, mut is_open) = (1, true);
    // Very old programs end lines with CR alone.
    let end = if bytes.contains(&b'\n') { b'\n' } else { b'\r' };
    for (text, line) in bytes.split(|&byte| byte == end).zip(1..) {
        let mut words = words(text);
        let Some(first) = words.next() else { continue };
        last = line;
        fn wrong(wanted: &'static str, line: usize, text: &[u8]) -> StlError {
            StlError::Word { line, text: excerpt(text.trim_ascii()), wanted }
        }
        let mut first = first.to_ascii_lowercase();
        // Some programs write `end loop`.
        if first == b"end" {
            first.extend(words.next().unwrap_or_default().to_ascii_lowercase());
        }
        match (first.as_slice(), &mut facet) {
            (b"solid", None) => is_open = true,
            (b"endsolid", None) => is_open = false,
            (b"outer" | b"endloop", Some(_)) => {}
            (b"facet", None) => (facet, is_open) = (Some(Vec::with_capacity(3)), true),
            (b"vertex", Some(facet)) => {
                let mut place = [0.0; 3];
                let mut found = 0;
                for word in words {
                    let broken = || StlError::Vertex { line, text: excerpt(text.trim_ascii()) };
                    let number: f32 = real(word).ok_or_else(broken)?;
                    *place.get_mut(found).ok_or_else(broken)? = number.into();
                    found += 1;
                }
                if found < 3 {
                    return Err(StlError::Vertex { line, text: excerpt(text.trim_ascii()) });
                }
                facet.push(place);
            }
            (b"endfacet", Some(vertices)) => match vertices[..] {
                [a, b, c] => {
                    corners.push([a, b, c], None);
                    facet = None;
                }
                _ => return Err(StlError::Facet { line, found: vertices.len() }),
            },
            (_, None) => return Err(wrong("facet", line, text)),
            (_, Some(vertices)) => {
                return Err(wrong(
                    if vertices.len() < 3 { "vertex" } else { "endloop" },
                    line,
                    text,
                ));
            }
        }
    }
    match facet {
        Some(_) => Err(StlError::Ends { line: last }),
        None if is_open => Err(StlError::Open { line: last }),
        None => Ok(()),
    }
}

/// Writes a mesh as binary STL; polygons are cut into triangles.
pub(super) struct MeshStl;

impl FileFormat for MeshStl {
    type Value = Mesh;
    const ENDING: &'static str = "stl";
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::STL;

    fn write(mesh: &Mesh, name: &str) -> Result<Vec<NewFile>, error::Error> {
        Ok(NewFile::only(name, encode(&*upright(mesh)?)?))
    }

    fn doubts(mesh: &Mesh) -> Vec<String> {
        coarse_mesh(mesh)
            .into_iter()
            .chain(open(mesh))
            .chain(left_out::of_mesh(mesh, <Self as FileFormat>::FIDELITY))
            .collect()
    }
}

fn encode(mesh: &Mesh) -> Result<Vec<u8>, StlError> {
    check_mesh(mesh)?;
    let triangles: usize = mesh.faces().iter().map(|face| face.len() - 2).sum();
    let count = u32::try_from(triangles).map_err(|_| StlError::TooLarge { triangles })?;
    let mut bytes = Vec::with_capacity(84 + TRIANGLE * triangles);
    bytes.extend_from_slice(b"binary STL of maquette, mm");
    bytes.resize(80, b' ');
    bytes.extend_from_slice(&count.to_le_bytes());
    for triangle in mesh.triangles().iter() {
        let [a, b, c] = triangle.map(|vertex: u32| mesh.positions()[vertex as usize]);
        let normal = (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or(Vector3::zeros());
        bytes.extend_from_slice(floats(normal.into()).as_flattened());
        for corner in [a, b, c] {
            bytes.extend_from_slice(floats(corner.coords.into()).as_flattened());
        }
        bytes.extend_from_slice(&[0, 0]);
    }
    Ok(bytes)
}

impl FileReader for MeshStl {
    type Value = Mesh;
    const ENDINGS: &'static [&'static str] = &["stl"];
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::STL_READ;

    fn read(file: &Reading<'_>) -> Result<Mesh, error::Error> {
        let (mesh, notes) = read_noted(file.bytes())?;
        notes.into_iter().for_each(|note| file.doubt(note));
        Ok(mesh)
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::Faces;

    use super::*;
    use crate::{glb, hostile, obj, ply};

    const TEXT: &str = "solid a square\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1 0 0\n   vertex 1 1 0\n\
        \u{20} endloop\n endfacet\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1 1 0\n   vertex 0 1 -0.5e0\n\
        \u{20} endloop\n endfacet\nendsolid a square\n";

    fn binary() -> Vec<u8> {
        encode(&read(TEXT.as_bytes()).unwrap()).unwrap()
    }

    #[test]
    fn equal_corners_become_one_vertex_in_the_order_of_the_file() {
        let text = read(TEXT.as_bytes()).unwrap();
        assert_eq!(text.faces().iter().collect::<Vec<_>>(), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(text.positions()[3], Point3::new(0.0, 1.0, -0.5));
        assert_eq!(read(&binary()).unwrap(), text);
    }

    #[test]
    fn files_of_others_read() {
        let mesh = read(include_bytes!("../../tests/data/formats/square.stl")).unwrap();
        assert_eq!(mesh.faces().iter().collect::<Vec<_>>(), [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn a_binary_file_may_begin_like_a_text() {
        let mut bytes = binary();
        bytes[..5].copy_from_slice(b"solid");
        assert_eq!(read(&bytes).unwrap().faces().len(), 2);
    }

    #[test]
    fn a_quad_is_written_as_two_triangles_with_their_normals() {
        fn at(x: f64, y: f64) -> Point3<f64> {
            Point3::new(x, y, 0.25)
        }
        let positions = vec![at(0., 0.), at(1., 0.), at(1., 1.), at(0., 1.)];
        let quad = Mesh::new(positions, Faces::uniform(4, vec![0, 1, 2, 3]).unwrap()).unwrap();
        let bytes = encode(&quad).unwrap();
        assert_eq!(bytes.len(), 84 + 2 * 50);
        assert_eq!(bytes[84..96], *floats([0.0, 0.0, 1.0]).as_flattened());
        let again = read(&bytes).unwrap();
        assert_eq!(again.positions(), quad.positions());
        assert_eq!(again.faces().iter().collect::<Vec<_>>(), [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn a_wrong_count_is_told_and_all_that_is_there_is_read() {
        let square = binary();
        fn with_count(count: u32, more: &[u8], square: &[u8]) -> Result<(usize, String), StlError> {
            let mut bytes = [square, more].concat();
            bytes[80..84].copy_from_slice(&count.to_le_bytes());
            read_noted(&bytes).map(|(mesh, notes)| (mesh.faces().len(), notes.join("; ")))
        }
        let told =
            |count| format!("the header counts {count} triangles, but there are 2: all are read");
        assert_eq!(with_count(0, &[], &square).unwrap(), (2, told(0)));
        assert_eq!(with_count(1, &[], &square).unwrap(), (2, told(1)));
        let told = "7 bytes at the end are left out: the header counts 2 triangles";
        assert_eq!(with_count(2, &[0; 7], &square).unwrap(), (2, told.to_owned()));
        assert!(
            with_count(0, &[0; 7], &square)
                .unwrap_err()
                .to_string()
                .ends_with("the file is damaged, or no STL file")
        );
        assert!(
            with_count(3, &[], &square)
                .unwrap_err()
                .to_string()
                .ends_with("the file is cut off, or no STL file")
        );
    }

    #[test]
    fn triangles_have_the_colors_of_magics_and_of_viscam() {
        fn colors(header: &[u8], bits: [u16; 2]) -> Option<Vec<[u8; 3]>> {
            let mut bytes = binary();
            bytes[..header.len()].copy_from_slice(header);
            for (at, bits) in [132, 182].into_iter().zip(bits) {
                bytes[at..at + 2].copy_from_slice(&bits.to_le_bytes());
            }
            read(&bytes).unwrap().face().colors("color").map(|colors| colors.to_vec())
        }
        assert_eq!(colors(b"any", [0, 0]), None);
        assert_eq!(
            colors(b"any", [0x8000 | 31 << 10, 0x8000 | 31]),
            Some(vec![[255, 0, 0], [0, 0, 255]])
        );
        let magics = b"a solid; COLOR=\x0a\x14\x1e\xff,MATERIAL=";
        assert_eq!(colors(magics, [31, 0x8000]), Some(vec![[255, 0, 0], [10, 20, 30]]));
    }

    #[test]
    fn ends_may_be_two_words_and_lines_may_end_in_cr() {
        let text = TEXT.replace("endloop", "end loop").replace("endfacet", "end facet");
        let text = text.replace("endsolid", "end solid").replace('\n', "\r");
        assert_eq!(read(text.as_bytes()), read(TEXT.as_bytes()));
    }

    #[test]
    fn a_triangle_that_is_none_is_left_out() {
        let mesh = read(TEXT.replacen("vertex 1 0 0", "vertex 0 0 0", 1).as_bytes()).unwrap();
        assert_eq!(mesh.faces().len(), 1);
    }

    #[test]
    fn a_triangle_with_a_corner_nowhere_is_left_out_and_told() {
        for nowhere in ["nan", "inf"] {
            let text = TEXT.replacen("vertex 1 0 0", &format!("vertex 1 0 {nowhere}"), 1);
            let file = Reading::alone("a.stl", text.as_bytes());
            assert_eq!(MeshStl::read(&file).unwrap().faces().len(), 1);
            assert_eq!(file.doubts(), ["1 face is left out: a coordinate is NaN or infinite"]);
        }
    }

    fn error(from: &str, to: &str) -> String {
        assert!(TEXT.contains(from));
        read(TEXT.replacen(from, to, 1).as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn files_that_lie_are_refused_with_their_line() {
        let text = "this is no STL file: 3 bytes are no text that begins with `solid`, nor a header of 84 bytes and 50 for each triangle";
        assert_eq!(read(b"stl").unwrap_err().to_string(), text);
        let mut cut = binary();
        cut.pop();
        let told = "183 bytes, but the header counts 2 triangles, which take 184: the file is cut off, or no STL file";
        assert_eq!(read(&cut).unwrap_err().to_string(), told);
        // Four letters are no count.
        let text = b"a text that is no file of triangles, but has as many letters as their header would take".repeat(2);
        assert!(matches!(read(&text), Err(StlError::NotStl { .. })));
        assert_eq!(error("   vertex 1 0 0\n", ""), "line 7: a facet has three vertices, not 2");
        assert_eq!(
            error("vertex 1 0 0", "vertex 1 0"),
            "line 5: a vertex has three numbers, not `vertex 1 0`"
        );
        assert_eq!(
            error("vertex 1 0 0", "vertex 1 0 0 0"),
            "line 5: a vertex has three numbers, not `vertex 1 0 0 0`"
        );
        assert_eq!(
            error("vertex 1 0 0", "vortex"),
            "line 5: `vortex`, where there must be `vertex`"
        );
        assert_eq!(
            error("facet normal 0 0 1", "side"),
            "line 2: `side`, where there must be `facet`"
        );
        let start = &TEXT[..TEXT.find("endloop").unwrap()];
        assert_eq!(read(start.as_bytes()).unwrap_err(), StlError::Ends { line: 6 });
    }

    #[test]
    fn capitals_say_the_same() {
        let capitals = TEXT.to_ascii_uppercase();
        assert_eq!(read(capitals.as_bytes()).unwrap(), read(TEXT.as_bytes()).unwrap());
    }

    #[test]
    fn a_text_that_is_cut_after_a_facet_is_refused() {
        let end = TEXT.find("endsolid").unwrap();
        let error = read(&TEXT.as_bytes()[..end]).unwrap_err().to_string();
        assert_eq!(error, "line 15: the file ends without `endsolid`: it is cut off");
        // Some files have several solids.
        let two = TEXT.repeat(2);
        assert_eq!(read(two.as_bytes()).unwrap().faces().len(), 4);
        assert!(read(&two.as_bytes()[..two.len() - 18]).is_err());
    }

    #[test]
    fn a_vertex_beyond_single_precision_is_not_written_as_infinite() {
        let positions = vec![Point3::origin(), Point3::new(1., 0., 0.), Point3::new(0., -1e39, 0.)];
        let mesh = Mesh::new(positions, Faces::triangles(vec![[0, 1, 2]])).unwrap();
        let text = "vertex 2 is at (0e0, -1e39, 0e0), but coordinates in such a file are at most 3.4e38 in size: scale or move it \
            nearer before it is written";
        assert_eq!(encode(&mesh).unwrap_err().to_string(), text);
        assert_eq!(ply::encode(&mesh).unwrap_err().to_string(), text);
        for written in [
            obj::MeshObj::write(&mesh, "a.obj"),
            glb::MeshGlb::write(&mesh, "a.glb"),
            ply::MeshPly::write(&mesh, "a.ply"),
        ] {
            assert_eq!(written.unwrap_err().to_string(), text);
        }
    }

    #[test]
    fn hostile_files_give_errors() {
        hostile::survive(TEXT.as_bytes(), read);
        hostile::survive(&binary(), read);
    }
}
