//! PLY, the polygon file format of Stanford: meshes, point clouds and range grids with data per vertex.
//!
//! All three encodings are read. Files are written `binary_little_endian` with `float` positions.

use body::Body;
use faces::FaceTable;
use header::{Element, Property};
use maquette_syntax::error::Error;
use maquette_value::{Faces, Mesh, Points};
use table::Table;

use super::colors::ColorRange;
use super::finite::FiniteMask;

mod blocks;
mod body;
mod faces;
mod header;
mod points;
mod range;
pub(crate) mod size;
mod table;
mod write;

pub(super) use points::{CurvePly, HandlesPly, PointsPly, RangePly, RegionPly};
pub use range::read_range;
pub use write::encode;
pub(super) use write::{ControlNetPly, MeshPly};

/// Reads the mesh in a PLY file; a point cloud becomes a mesh without faces. Faces that have a vertex with NaN or infinite coordinates are
/// left out.
///
/// Properties of vertices become attributes: `nx ny nz` become the vectors `normal`; `s t`, `u v` or `texture_u texture_v` become the pairs
/// `uv`; three properties with names of colors become the colors `color`; `filled` of type `uchar` becomes flags. Any other floating-point
/// property becomes numbers; any other integer property except `alpha` becomes indices, or numbers if some values are negative. The names
/// of colors are `red green blue`, `diffuse_red diffuse_green diffuse_blue`, or for integers `r g b`, in lower or upper case; the range of
/// colors, 1, 255 or 65535, is guessed from the largest value. Comments in which [`encode`] declares vectors, pairs, colors and flags are
/// respected. Lists `texcoord` or `corner_uv` of faces become the pairs `uv` per corner if all faces have them; other properties of faces
/// become attributes of faces by the rules for vertices. Lists of `tristrips` are triangle strips, each of which ends with -1. Other
/// elements are ignored.
///
/// Returns an error if the bytes are not a PLY file, the file is truncated, or vertices and faces are not a valid mesh.
pub fn read(bytes: &[u8]) -> Result<Mesh, Error> {
    let Contents { mesh, finite, .. } = read_contents(bytes, None)?;
    Ok(finite.mesh(mesh).0)
}

/// The contents of a PLY file.
struct Contents {
    mesh: Mesh,
    /// Marks the vertices with finite positions.
    finite: FiniteMask,
    /// Warnings about vertices and unknown elements.
    notes: Vec<String>,
    /// Warnings about faces.
    face_notes: Vec<String>,
    /// The file names of the mesh's pictures.
    pictures: Vec<String>,
}

fn read_contents(bytes: &[u8], color_range: Option<ColorRange>) -> Result<Contents, Error> {
    let header = header::read(bytes)?;
    let mut body = Body::new(&header, bytes);
    let (mut notes, mut face_notes) = (Vec::new(), Vec::new());
    let mut vertices = None;
    let mut faces = None;
    let has_strips = header.elements.iter().any(|element| element.name == STRIPS);
    for element in &header.elements {
        body.check_room(element)?;
        fn is_list(property: &Property) -> bool {
            property.length.is_some()
        }
        let has_list = element.properties.iter().any(is_list);
        match &*element.name {
            "vertex" if vertices.is_none() => {
                let lists = element.properties.iter().filter(|property| is_list(property));
                notes.extend(
                    lists.map(|list| format!("the list `{}` of vertices is left out", list.name)),
                );
                vertices = Some(Table::read(element, &mut body)?);
            }
            "face" if faces.is_none() && has_list => {
                faces = Some(FaceTable::read(element, &mut body, !has_strips, &mut face_notes)?);
            }
            STRIPS if has_list => {
                let table = faces.get_or_insert_with(FaceTable::default);
                table.add_strips(element, &mut body, &mut face_notes)?;
            }
            _ => {
                if element.count > 0 {
                    notes.push(format!(
                        "the element `{}` is left out ({} rows)",
                        element.name, element.count
                    ));
                }
                skip(element, &mut body)?;
            }
        }
    }
    notes.extend(body.rest());
    let mut vertices = vertices.ok_or_else(no_vertices)?;
    let mut faces = faces.unwrap_or_default();
    vertices.color_range = color_range;
    faces.scalars.iter_mut().for_each(|scalars| scalars.color_range = color_range);
    face_notes.extend(faces.list.notes());
    let (mesh, finite) = vertices.into_mesh(&header, faces, &mut notes)?;
    Ok(Contents { mesh, finite, notes, face_notes, pictures: header.pictures })
}

/// Reads the points of a PLY file, with the attributes that [`read`] describes. Faces are left out, and so are points with NaN or infinite
/// coordinates.
///
/// # Errors
/// The errors of [`read`].
pub fn read_points(bytes: &[u8]) -> Result<Points, Error> {
    Ok(read_finite(bytes, None)?.0)
}

/// Reads the points of a PLY file. Also returns the number of points that are left out, and the warnings.
fn read_finite(
    bytes: &[u8],
    color_range: Option<ColorRange>,
) -> Result<(Points, usize, Vec<String>), Error> {
    let Contents { mesh, finite, notes, .. } = read_contents(bytes, color_range)?;
    Ok((finite.points(points_of(&mesh)), finite.n_left_out(), notes))
}

/// Returns the vertices of a mesh, with their attributes.
fn points_of(mesh: &Mesh) -> Points {
    let mut points = Points::new(mesh.positions().clone()).expect("a mesh has finite positions");
    for (name, attribute) in mesh.vertex().iter() {
        points = points
            .with_attribute(name, attribute.clone())
            .expect("a mesh has an entry for each vertex");
    }
    points
}

fn skip(element: &Element, body: &mut Body<'_>) -> Result<(), Error> {
    // Do not loop over rows without properties: they take no bytes, so a small file may state any number of them.
    if element.properties.is_empty() {
        return Ok(());
    }
    for _ in 0..element.count {
        for property in &element.properties {
            match property.length {
                Some(length) => body.skip_list(length, property.scalar)?,
                None => drop(body.number(property.scalar)?),
            }
        }
        body.end_row(element)?;
    }
    Ok(())
}

fn no_vertices() -> Error {
    Error::new("the file has no vertices with x, y and z")
}

/// The name of the element that contains triangle strips.
const STRIPS: &str = "tristrips";

/// Returns an empty set of faces.
fn no_faces() -> Faces {
    Faces::triangles(Vec::new())
}

#[cfg(test)]
mod tests {
    use maquette_node::importers::InputFile;
    use maquette_value::Attribute;
    use nalgebra::Point3;

    use super::*;
    use crate::hostile;

    const GRIDS: [&[u8]; 4] = [
        include_bytes!("../../tests/data/formats/range_grid_ascii.ply"),
        include_bytes!("../../tests/data/formats/range_grid_crlf.ply"),
        include_bytes!("../../tests/data/formats/range_grid_le.ply"),
        include_bytes!("../../tests/data/formats/range_grid_be.ply"),
    ];

    /// A square of two triangles, and a degenerate face.
    const SQUARE: &str = "ply\nformat ascii 1.0\nelement camera 1\nproperty list uchar float view\nproperty int id\n\
        element vertex 4\nproperty uchar blue\nproperty uchar green\nproperty uchar red\nproperty double y\n\
        property float x\nproperty float z\nproperty float s\nproperty float t\nproperty uchar filled\n\
        property float weight\nproperty uint group\nproperty short step\nelement face 3\n\
        property float area\nproperty list uchar int vertex_index\nend_header\n\
        2 0.5 0.25 7\n\
        1 2 3 0 0 0 0 0 1 0.5 9 -4\n4 5 6 0 1 0 1 0 0 1.5 8 -4\n7 8 9 1 1 0 1 1 0 2.5 7 -4\n0 0 0 1 0 0 0 1 0 3.5 6 -4\n\
        1 3 0 1 2\n1 3 2 3 0\n0 3 1 1 2\n";

    #[test]
    fn properties_become_attributes_and_unknown_elements_are_ignored() {
        let mesh = read(SQUARE.as_bytes()).unwrap();
        assert_eq!(mesh.faces().iter().collect::<Vec<_>>(), [[0, 1, 2], [2, 3, 0]]);
        assert_eq!(mesh.positions()[1], Point3::new(1.0, 0.0, 0.0));
        let vertex = mesh.vertex();
        assert_eq!(vertex.colors("color").unwrap()[0], [3, 2, 1]);
        assert_eq!(vertex.pairs("uv").unwrap()[2], [1.0, 1.0]);
        assert_eq!(vertex.get("filled"), Some(&Attribute::Flag(vec![1, 0, 0, 0].into())));
        assert_eq!(vertex.get("group"), Some(&Attribute::Index(vec![9, 8, 7, 6].into())));
        let weights = Attribute::Number(vec![0.5, 1.5, 2.5, 3.5].into());
        assert_eq!(vertex.get("weight"), Some(&weights));
        assert_eq!(vertex.get("step"), Some(&Attribute::Number(vec![-4.0; 4].into())));
        assert_eq!(vertex.iter().count(), 6);
    }

    #[test]
    fn a_missing_or_additional_number_in_a_line_is_an_error() {
        fn file(rows: &str) -> Result<Mesh, Error> {
            let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                element face 1\nproperty list uchar int vertex_indices\nend_header\n";
            read(format!("{header}{rows}").as_bytes())
        }
        // Spaces, all kinds of line endings, and rows that extend over several lines are valid.
        for valid in [
            "0 0 0\n1 0 0 \t\n0 1 0\n3 0 1 2",
            "0 0 0\r\n1 0 0\r\n\r\n0 1 0\r\n3 0 1 2\r\n",
            "0 0 0\r1 0 0\r0 1 0\r3 0 1 2\r",
            "0 0\n0\n1 0\n0\n0 1\n0\n3\n0 1 2\n",
        ] {
            let positions = file(valid).unwrap().positions().to_vec();
            assert_eq!(positions[2], Point3::new(0.0, 1.0, 0.0), "{valid:?}");
        }
        for (invalid, name, line) in [
            ("0 0 0\n1 0\n0 1 0\n3 0 1 2\n9 9\n", "vertex", 12),
            ("0 0 0\n1 0 0 7\n0 1 0\n3 0 1 2\n", "vertex", 11),
            ("0 0 0\n1 0 0\n0 1 0\n3 0 1 2 255\n", "face", 13),
        ] {
            let row = format!(
                "line {line}: expected one row of `{name}` per line: this line has too many numbers, or the previous one too few"
            );
            assert_eq!(file(invalid).unwrap_err().to_string(), row, "{invalid:?}");
        }
    }

    #[test]
    fn whole_numbers_of_vertices_are_indices_or_numbers() {
        let file = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
            property int region\nproperty short step\nproperty uchar alpha\nend_header\n0 0 0 7 -1 255\n0 0 1 2 3 255\n";
        let mesh = read(file.as_bytes()).unwrap();
        let region = Attribute::Index(vec![7, 2].into());
        assert_eq!(mesh.vertex().get("region"), Some(&region));
        let step = Attribute::Number(vec![-1.0, 3.0].into());
        assert_eq!(mesh.vertex().get("step"), Some(&step));
        assert_eq!(mesh.vertex().iter().count(), 2);
    }

    #[test]
    fn faces_and_points_that_are_not_finite_are_left_out() {
        let file = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\n\
            property float ny\nproperty float nz\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n0 0 0 0 0 1\n1 0 0 0 0 1\n\
            0 1 0 0 0 1\nnan 0 0 nan nan nan\n5 5 inf 0 0 1\n3 0 1 2\n3 1 3 2\n";
        let mesh = InputFile::standalone("a.ply", file.as_bytes());
        assert_eq!(crate::read::<Mesh>(&mesh).unwrap().faces().len(), 1);
        let why = "a coordinate is NaN or infinite";
        assert_eq!(mesh.warnings(), [format!("1 face is left out: {why}")]);
        let points = InputFile::standalone("a.ply", file.as_bytes());
        assert_eq!(crate::read::<Points>(&points).unwrap().positions().len(), 3);
        assert_eq!(points.warnings(), [format!("2 points are left out: {why}")]);
    }

    #[test]
    fn every_encoding_gives_the_same_points() {
        let [ascii, crlf, little, big] = GRIDS.map(|file| read(file).unwrap());
        assert_eq!(ascii.positions().len(), 43);
        assert_eq!(ascii.positions(), crlf.positions());
        assert_eq!(little.positions(), big.positions());
        let farthest = ascii
            .positions()
            .iter()
            .zip(&**little.positions())
            .map(|(a, b): (&Point3<f64>, &Point3<f64>)| (a - b).norm());
        assert!(farthest.fold(0.0, f64::max) < 1e-4);
    }

    #[test]
    fn colors_may_be_floats() {
        let file = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
            property float red\nproperty float green\nproperty float blue\nend_header\n0 0 0 0 0.5 1";
        let mesh = read(file.as_bytes()).unwrap();
        assert_eq!(mesh.vertex().colors("color").unwrap()[..], [[0, 128, 255]]);
    }

    fn error(from: &str, to: &str) -> String {
        assert!(SQUARE.contains(from));
        read(SQUARE.replacen(from, to, 1).as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn invalid_files_are_rejected_with_their_line() {
        assert_eq!(error("ply", "plx"), "expected `ply` in the first line: this is not a PLY file");
        assert_eq!(
            error("ascii", "utf8"),
            "line 2: `format utf8 1.0` is not a line of a PLY header"
        );
        assert_eq!(
            error("double y", "real y"),
            "line 10: `property real y` is not a line of a PLY header"
        );
        assert_eq!(error("list uchar int", "list float int").split(':').next(), Some("line 21"));
        assert_eq!(error("float z", "float w"), "the file has no vertices with x, y and z");
        assert_eq!(error("1 2 3 0 0", "1 2 c 0 0"), "line 24: `c` is not a number");
        assert_eq!(error("3 0 1 2\n", "-3 0 1 2\n"), "line 28: a list cannot have -3 entries");
        assert_eq!(error("3 0 1 2\n", "3 0 -1 2\n"), "line 28: there is no vertex -1");
        assert_eq!(error("0 1 2\n", "0 1 9\n"), "face 0 refers to vertex 9, but there are only 4");
        assert_eq!(error("0 3 1 1 2\n", "0 3 1"), "line 30: the file ends too early");
        assert_eq!(
            error("vertex 4", "vertex 4000000000000000000"),
            "line 6: 4000000000000000000 rows of `vertex` need at least 18446744073709551615 bytes, but only 139 are left"
        );
    }

    #[test]
    fn rows_without_properties_take_no_time() {
        let file = "ply\nformat ascii 1.0\nelement nothing 18446744073709551615\nelement vertex 18446744073709551615\nend_header\n";
        let error = read(file.as_bytes()).unwrap_err().to_string();
        assert_eq!(error, "the file has no vertices with x, y and z");
    }

    #[test]
    fn hostile_files_give_errors() {
        for file in GRIDS.into_iter().chain([SQUARE.as_bytes()]) {
            hostile::check_no_panic(file, read);
        }
    }
}
