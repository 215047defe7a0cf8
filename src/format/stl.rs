//! STL, the triangles for 3D printers, as text or binary. The format stores corners, not vertices; corners with equal positions are merged
//! to one vertex.

use maquette_node::importers::{FileReader, InputFile};
use maquette_node::pack::{FileFormat, NewFile};
use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::{Attribute, DistinctPositions, Mesh, Rgb};
use nalgebra::Vector3;

use super::corners::FaceList;
use super::losses;
use super::rows::floats;
use super::upright::upright;
use super::{check_mesh, excerpt, finite, mesh_precision_note, open_mesh_note, parse_real, words};

/// Reads the mesh in an STL file, text or binary. Corners with equal positions become one vertex, in the order of first use.
/// Degenerate triangles are left out, as are those with a corner that is NaN or infinite. Normals are ignored: the order of the corners
/// defines the outside. Colors of triangles, as Magics and VisCAM write them, become the attribute `color` of faces.
///
/// # Errors
/// If the bytes are not an STL file.
pub fn read(bytes: &[u8]) -> Result<Mesh, Error> {
    Ok(read_with_notes(bytes)?.0)
}

/// Reads a mesh like [`read`]. Also returns warnings about data that are left out or ambiguous.
fn read_with_notes(bytes: &[u8]) -> Result<(Mesh, Vec<String>), Error> {
    let (mut corners, mut notes) = (Corners::default(), Vec::new());
    let stated = bytes.get(80..84).and_then(|count| count.first_chunk());
    let stated = stated.map(|count| u32::from_le_bytes(*count));
    fn expected_size(count: u32) -> usize {
        (count as usize).saturating_mul(TRIANGLE).saturating_add(84)
    }
    let is_text =
        bytes.trim_ascii_start().get(..5).is_some_and(|it| it.eq_ignore_ascii_case(b"solid"));
    // Programs that write a file as a stream cannot fill in the count in the header afterwards, so a file may be longer than its header
    // states.
    let room = bytes.len().saturating_sub(84);
    fn is_longer(count: u32, room: usize, bytes: &[u8]) -> bool {
        let is_whole = room.is_multiple_of(TRIANGLE) && room > 0;
        bytes.len() > expected_size(count) && (is_whole || count > 0)
    }
    // A binary header may begin with `solid`, too, so the length of the file decides.
    if stated.is_some_and(|count| bytes.len() == expected_size(count)) {
        read_binary(bytes, &mut corners);
    } else if is_text {
        read_text(bytes, &mut corners)?;
    } else if let Some(count) = stated.filter(|&count| is_longer(count, room, bytes)) {
        if room.is_multiple_of(TRIANGLE) {
            let actual = room / TRIANGLE;
            notes.push(format!(
                "the header states {count} triangles, but the file has {actual}: all are read"
            ));
            read_binary(bytes, &mut corners);
        } else {
            let end = expected_size(count);
            notes.push(format!(
                "{} bytes at the end are left out: the header states {count} triangles",
                bytes.len() - end
            ));
            read_binary(&bytes[..end], &mut corners);
        }
    } else {
        let bytes = bytes.len();
        // If the count in the header is close to the right one, the file is probably a truncated STL file: a file of another kind would
        // hardly have such a number at this position.
        let Some(triangles) = stated.filter(|&count| {
            room.is_multiple_of(TRIANGLE) || expected_size(count) / MAX_MISSING_FACTOR <= bytes
        }) else {
            bail!(
                "this is not an STL file: expected a text that begins with `solid`, or a header of 84 bytes and 50 bytes per triangle, found {bytes} bytes"
            );
        };
        let expected = 84 + TRIANGLE as u64 * u64::from(triangles);
        let defect = if (bytes as u64) < expected { "truncated" } else { "damaged" };
        bail!(
            "the header states {triangles} triangles, which take {expected} bytes, but the file has {bytes} bytes: it is {defect}, or not an STL file"
        );
    }
    notes.extend(corners.faces.notes());
    notes.extend(finite::left_out_note(corners.left_out, "face"));
    let (faces, _) = corners.faces.finish()?;
    let mut mesh = Mesh::new(corners.positions.into_positions(), faces)?;
    if corners.colors.iter().any(Option::is_some) {
        let colors = corners.colors.into_iter().map(|color| color.unwrap_or(corners.usual_color));
        mesh = mesh.with_face("color", Attribute::Color(colors.collect()))?;
    }
    Ok((mesh, notes))
}

/// Reads the triangles of a binary file.
fn read_binary(bytes: &[u8], corners: &mut Corners) {
    let (header, triangles) = bytes.split_at(84);
    // Magics stores in the header a color for all triangles that have no color of their own. In the colors of single triangles it reverses
    // the order of the channels.
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
        let corner_positions = [0, 3, 6]
            .map(|k| [number(k, triangle), number(k + 1, triangle), number(k + 2, triangle)]);
        corners.push(corner_positions, has_own.then_some(color));
    }
}

/// If a file is shorter than its header states by more than this factor, it is considered to be another format, not a truncated STL file.
const MAX_MISSING_FACTOR: usize = 1000;

/// The number of bytes of a triangle: a normal and three corners of floats, and two arbitrary bytes.
const TRIANGLE: usize = 50;

/// Collects triangles, and merges corners with equal positions.
#[derive(Default)]
struct Corners {
    positions: DistinctPositions,
    faces: FaceList,
    /// The color of each face, if it has its own.
    colors: Vec<Option<Rgb>>,
    /// The color of the faces that have no color of their own.
    usual_color: Rgb,
    /// The number of triangles that are left out because a corner is not finite.
    left_out: usize,
}

impl Corners {
    fn push(&mut self, corners: [[f64; 3]; 3], color: Option<Rgb>) {
        if !corners.as_flattened().iter().all(|x| x.is_finite()) {
            self.left_out += 1;
            return;
        }
        let face = corners.map(|position| self.positions.insert(position.into()));
        let faces = self.faces.push(&face);
        self.colors.extend(std::iter::repeat_n(color, faces));
    }
}

/// Reads a text file: the lines `facet normal ..`, `outer loop`, three `vertex x y z`, `endloop`, `endfacet`, between `solid` and
/// `endsolid`.
fn read_text(bytes: &[u8], corners: &mut Corners) -> Result<(), Error> {
    let mut facet: Option<Vec<[f64; 3]>> = None;
    let (mut last, mut is_open) = (1, true);
    // Very old programs end lines with CR alone.
    let end = if bytes.contains(&b'\n') { b'\n' } else { b'\r' };
    for (text, line) in bytes.split(|&byte| byte == end).zip(1..) {
        let mut words = words(text);
        let Some(first) = words.next() else { continue };
        last = line;
        fn word_error(wanted: &str, line: usize, text: &[u8]) -> Error {
            let text = excerpt(text.trim_ascii());
            Error::new(format!("line {line}: expected `{wanted}`, found `{text}`"))
        }
        fn vertex_error(line: usize, text: &[u8]) -> Error {
            let text = excerpt(text.trim_ascii());
            Error::new(format!("line {line}: expected a vertex of three numbers, found `{text}`"))
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
                let mut position = [0.0; 3];
                let mut found = 0;
                for word in words {
                    let number: f32 = parse_real(word).ok_or_else(|| vertex_error(line, text))?;
                    let coordinate = position.get_mut(found);
                    *coordinate.ok_or_else(|| vertex_error(line, text))? = number.into();
                    found += 1;
                }
                if found < 3 {
                    return Err(vertex_error(line, text));
                }
                facet.push(position);
            }
            (b"endfacet", Some(vertices)) => match vertices[..] {
                [a, b, c] => {
                    corners.push([a, b, c], None);
                    facet = None;
                }
                _ => {
                    let found = vertices.len();
                    bail!("line {line}: expected three vertices in a facet, found {found}")
                }
            },
            (_, None) => return Err(word_error("facet", line, text)),
            (_, Some(vertices)) => {
                return Err(word_error(
                    if vertices.len() < 3 { "vertex" } else { "endloop" },
                    line,
                    text,
                ));
            }
        }
    }
    match facet {
        Some(_) => bail!("line {last}: the file ends inside a facet"),
        None if is_open => bail!("line {last}: the file ends without `endsolid`: it is truncated"),
        None => Ok(()),
    }
}

/// Writes a mesh as binary STL; polygons are triangulated.
pub(super) struct MeshStl;

impl FileFormat for MeshStl {
    type Value = Mesh;
    const EXTENSION: &'static str = "stl";
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::STL;

    fn write(mesh: &Mesh, name: &str) -> Result<Vec<NewFile>, Error> {
        Ok(NewFile::single(name, encode(&*upright(mesh)?)?))
    }

    fn warnings(mesh: &Mesh) -> Vec<String> {
        mesh_precision_note(mesh)
            .into_iter()
            .chain(open_mesh_note(mesh))
            .chain(losses::mesh_warning(mesh, <Self as FileFormat>::FIDELITY))
            .collect()
    }
}

fn encode(mesh: &Mesh) -> Result<Vec<u8>, Error> {
    check_mesh(mesh)?;
    let triangles: usize = mesh.faces().iter().map(|face| face.len() - 2).sum();
    let Ok(count) = u32::try_from(triangles) else {
        bail!("an STL file cannot store {triangles} triangles");
    };
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
    const EXTENSIONS: &'static [&'static str] = &["stl"];
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::STL_READ;
    const SIZE: crate::SizeReader = Some(crate::size::stl);

    fn read(file: &InputFile<'_>) -> Result<Mesh, Error> {
        let (mesh, notes) = read_with_notes(file.bytes())?;
        notes.into_iter().for_each(|note| file.warn(note));
        Ok(mesh)
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::Faces;
    use nalgebra::Point3;

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
    fn files_of_other_programs_are_read() {
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
        fn point(x: f64, y: f64) -> Point3<f64> {
            Point3::new(x, y, 0.25)
        }
        let positions = vec![point(0., 0.), point(1., 0.), point(1., 1.), point(0., 1.)];
        let quad = Mesh::new(positions, Faces::uniform(4, vec![0, 1, 2, 3]).unwrap()).unwrap();
        let bytes = encode(&quad).unwrap();
        assert_eq!(bytes.len(), 84 + 2 * 50);
        assert_eq!(bytes[84..96], *floats([0.0, 0.0, 1.0]).as_flattened());
        let again = read(&bytes).unwrap();
        assert_eq!(again.positions(), quad.positions());
        assert_eq!(again.faces().iter().collect::<Vec<_>>(), [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn a_wrong_count_gives_a_warning_and_all_triangles_are_read() {
        let square = binary();
        fn with_count(count: u32, more: &[u8], square: &[u8]) -> Result<(usize, String), Error> {
            let mut bytes = [square, more].concat();
            bytes[80..84].copy_from_slice(&count.to_le_bytes());
            read_with_notes(&bytes).map(|(mesh, notes)| (mesh.faces().len(), notes.join("; ")))
        }
        fn wrong_count(count: u32) -> String {
            format!("the header states {count} triangles, but the file has 2: all are read")
        }
        assert_eq!(with_count(0, &[], &square).unwrap(), (2, wrong_count(0)));
        assert_eq!(with_count(1, &[], &square).unwrap(), (2, wrong_count(1)));
        let message = "7 bytes at the end are left out: the header states 2 triangles";
        assert_eq!(with_count(2, &[0; 7], &square).unwrap(), (2, message.to_owned()));
        assert!(
            with_count(0, &[0; 7], &square)
                .unwrap_err()
                .to_string()
                .ends_with("it is damaged, or not an STL file")
        );
        assert!(
            with_count(3, &[], &square)
                .unwrap_err()
                .to_string()
                .ends_with("it is truncated, or not an STL file")
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
        assert_eq!(read(text.as_bytes()).unwrap(), read(TEXT.as_bytes()).unwrap());
    }

    #[test]
    fn a_degenerate_triangle_is_left_out() {
        let mesh = read(TEXT.replacen("vertex 1 0 0", "vertex 0 0 0", 1).as_bytes()).unwrap();
        assert_eq!(mesh.faces().len(), 1);
    }

    #[test]
    fn a_triangle_that_is_not_finite_is_left_out_with_a_warning() {
        for nowhere in ["nan", "inf"] {
            let text = TEXT.replacen("vertex 1 0 0", &format!("vertex 1 0 {nowhere}"), 1);
            let file = InputFile::standalone("a.stl", text.as_bytes());
            assert_eq!(MeshStl::read(&file).unwrap().faces().len(), 1);
            assert_eq!(file.warnings(), ["1 face is left out: a coordinate is NaN or infinite"]);
        }
    }

    fn error(from: &str, to: &str) -> String {
        assert!(TEXT.contains(from));
        read(TEXT.replacen(from, to, 1).as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn invalid_files_are_rejected_with_their_line() {
        let text = "this is not an STL file: expected a text that begins with `solid`, or a header of 84 bytes and 50 bytes per triangle, found 3 bytes";
        assert_eq!(read(b"stl").unwrap_err().to_string(), text);
        let mut cut = binary();
        cut.pop();
        let message = "the header states 2 triangles, which take 184 bytes, but the file has 183 bytes: it is truncated, or not an STL file";
        assert_eq!(read(&cut).unwrap_err().to_string(), message);
        // In this text, the four bytes at the position of the count are letters.
        let text = b"a text that is no file of triangles, but has as many letters as their header would take".repeat(2);
        let message = read(&text).unwrap_err().to_string();
        assert!(message.starts_with("this is not an STL file"), "{message}");
        assert_eq!(
            error("   vertex 1 0 0\n", ""),
            "line 7: expected three vertices in a facet, found 2"
        );
        assert_eq!(
            error("vertex 1 0 0", "vertex 1 0"),
            "line 5: expected a vertex of three numbers, found `vertex 1 0`"
        );
        assert_eq!(
            error("vertex 1 0 0", "vertex 1 0 0 0"),
            "line 5: expected a vertex of three numbers, found `vertex 1 0 0 0`"
        );
        assert_eq!(error("vertex 1 0 0", "vortex"), "line 5: expected `vertex`, found `vortex`");
        assert_eq!(error("facet normal 0 0 1", "side"), "line 2: expected `facet`, found `side`");
        let start = &TEXT[..TEXT.find("endloop").unwrap()];
        let message = read(start.as_bytes()).unwrap_err().to_string();
        assert_eq!(message, "line 6: the file ends inside a facet");
    }

    #[test]
    fn keywords_may_be_upper_case() {
        let capitals = TEXT.to_ascii_uppercase();
        assert_eq!(read(capitals.as_bytes()).unwrap(), read(TEXT.as_bytes()).unwrap());
    }

    #[test]
    fn a_text_that_ends_after_a_facet_is_rejected() {
        let end = TEXT.find("endsolid").unwrap();
        let error = read(&TEXT.as_bytes()[..end]).unwrap_err().to_string();
        assert_eq!(error, "line 15: the file ends without `endsolid`: it is truncated");
        // Some files have several solids.
        let two = TEXT.repeat(2);
        assert_eq!(read(two.as_bytes()).unwrap().faces().len(), 4);
        assert!(read(&two.as_bytes()[..two.len() - 18]).is_err());
    }

    #[test]
    fn a_vertex_beyond_single_precision_is_not_written_as_infinite() {
        let positions = vec![Point3::origin(), Point3::new(1., 0., 0.), Point3::new(0., -1e39, 0.)];
        let mesh = Mesh::new(positions, Faces::triangles(vec![[0, 1, 2]])).unwrap();
        let text = "vertex 2 is at (0e0, -1e39, 0e0), but coordinates in this format are at most 3.4e38: scale it or \
            move it to the origin first";
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
        hostile::check_no_panic(TEXT.as_bytes(), read);
        hostile::check_no_panic(&binary(), read);
    }
}
