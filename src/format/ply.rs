//! PLY, the polygon file format of Stanford: meshes, point clouds and range grids with data per vertex.
//!
//! Read in all three encodings. Written `binary_little_endian` with `float` positions.

use body::Body;
use faces::FaceTable;
use header::{Element, Property};
use maquette_value::{Faces, Mesh, Points};
use table::Table;

use super::colors::ColorRange;
use super::finite::Finite;

mod body;
mod error;
mod faces;
mod header;
mod points;
mod range;
mod table;
mod write;

pub use error::PlyError;
pub(super) use points::{CurvePly, HandlesPly, PointsPly, RangePly, RegionPly};
pub use range::read_range;
pub use write::encode;
pub(super) use write::{ControlNetPly, MeshPly};

/// The mesh in a PLY file; a point cloud is a mesh without faces. Faces at vertices that are at no finite place are left out.
///
/// Properties of vertices become attributes: `nx ny nz` the vectors `normal`; `s t`, `u v` or `texture_u texture_v` the pairs
/// `uv`; three that are called like colors the colors `color`; `filled` as `uchar` flags; every other
/// floating point property numbers, every other whole one but `alpha` indices, or numbers if some are negative. Colors are `red green blue`,
/// `diffuse_red diffuse_green diffuse_blue`, or whole numbers `r g b`, in small or capital letters; whether they go to 1, 255 or 65535 the largest of them says. What a file of [`encode`] says of its properties in comments is
/// believed: its vectors, pairs, colors and flags are read as such. Lists `texcoord` or `corner_uv` of faces become the pairs `uv` per corner if all
/// faces have them, and their other properties become attributes of faces as those of vertices do. Lists of `tristrips` are strips of triangles, ended by -1.
/// Other elements are passed over.
///
/// # Errors
/// If the bytes are not a PLY file, it ends too early, or vertices and faces make no mesh.
pub fn read(bytes: &[u8]) -> Result<Mesh, PlyError> {
    let Contents { mesh, finite, .. } = read_whole(bytes, None)?;
    Ok(finite.mesh(mesh).0)
}

/// What is in a PLY file.
struct Contents {
    mesh: Mesh,
    /// Which of its vertices are at finite places.
    finite: Finite,
    /// What the user should know of what is left out or understood in one of several ways,
    notes: Vec<String>,
    /// and of faces.
    face_notes: Vec<String>,
    /// The names of its pictures.
    pictures: Vec<String>,
}

fn read_whole(bytes: &[u8], color_range: Option<ColorRange>) -> Result<Contents, PlyError> {
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
                        "`{}` is left out, of which there are {}",
                        element.name, element.count
                    ));
                }
                skip(element, &mut body)?;
            }
        }
    }
    notes.extend(body.rest());
    let mut vertices = vertices.ok_or(PlyError::NoVertices)?;
    let mut faces = faces.unwrap_or_default();
    vertices.color_range = color_range;
    faces.scalars.iter_mut().for_each(|scalars| scalars.color_range = color_range);
    face_notes.extend(faces.list.notes());
    let (mesh, finite) = vertices.into_mesh(&header, faces, &mut notes)?;
    Ok(Contents { mesh, finite, notes, face_notes, pictures: header.pictures })
}

/// The points in a PLY file, with the attributes of [`read`]; faces, if there are some, and points at no finite place are left out.
///
/// # Errors
/// As for [`read`].
pub fn read_points(bytes: &[u8]) -> Result<Points, PlyError> {
    Ok(read_finite(bytes, None)?.0)
}

/// The points in a PLY file, how many were left out, and what the user should know.
fn read_finite(
    bytes: &[u8],
    color_range: Option<ColorRange>,
) -> Result<(Points, usize, Vec<String>), PlyError> {
    let Contents { mesh, finite, notes, .. } = read_whole(bytes, color_range)?;
    let mut points = Points::new(mesh.positions().clone()).expect("a mesh has finite positions");
    for (name, attribute) in mesh.vertex().iter() {
        points = points
            .with_attribute(name, attribute.clone())
            .expect("a mesh has an entry for each vertex");
    }
    Ok((finite.points(points), finite.n_left_out(), notes))
}

fn skip(element: &Element, body: &mut Body<'_>) -> Result<(), PlyError> {
    // Rows of nothing take no bytes, and a header may promise any number of them.
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

/// The element of strips of triangles.
const STRIPS: &str = "tristrips";

/// A mesh without faces.
fn no_faces() -> Faces {
    Faces::triangles(Vec::new())
}

#[cfg(test)]
mod tests {
    use maquette_node::reading::Reading;
    use maquette_value::Attribute;
    use nalgebra::Point3;

    use super::*;
    use crate::At;
    use crate::hostile;

    const GRIDS: [&[u8]; 4] = [
        include_bytes!("../../tests/data/formats/range_grid_ascii.ply"),
        include_bytes!("../../tests/data/formats/range_grid_crlf.ply"),
        include_bytes!("../../tests/data/formats/range_grid_le.ply"),
        include_bytes!("../../tests/data/formats/range_grid_be.ply"),
    ];

    /// A square of two triangles and a face that a lazy exporter left behind.
    const SQUARE: &str = "ply\nformat ascii 1.0\nelement camera 1\nproperty list uchar float view\nproperty int id\n\
        element vertex 4\nproperty uchar blue\nproperty uchar green\nproperty uchar red\nproperty double y\n\
        property float x\nproperty float z\nproperty float s\nproperty float t\nproperty uchar filled\n\
        property float weight\nproperty uint group\nproperty short step\nelement face 3\n\
        property float area\nproperty list uchar int vertex_index\nend_header\n\
        2 0.5 0.25 7\n\
        1 2 3 0 0 0 0 0 1 0.5 9 -4\n4 5 6 0 1 0 1 0 0 1.5 8 -4\n7 8 9 1 1 0 1 1 0 2.5 7 -4\n0 0 0 1 0 0 0 1 0 3.5 6 -4\n\
        1 3 0 1 2\n1 3 2 3 0\n0 3 1 1 2\n";

    #[test]
    fn properties_become_attributes_and_unknown_elements_are_passed_over() {
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
    fn a_line_with_a_number_too_few_or_too_many_shifts_nothing() {
        fn file(rows: &str) -> Result<Mesh, PlyError> {
            let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                element face 1\nproperty list uchar int vertex_indices\nend_header\n";
            read(format!("{header}{rows}").as_bytes())
        }
        // Spaces, any ends of lines, and rows of several lines are no mistake.
        for fine in [
            "0 0 0\n1 0 0 \t\n0 1 0\n3 0 1 2",
            "0 0 0\r\n1 0 0\r\n\r\n0 1 0\r\n3 0 1 2\r\n",
            "0 0 0\r1 0 0\r0 1 0\r3 0 1 2\r",
            "0 0\n0\n1 0\n0\n0 1\n0\n3\n0 1 2\n",
        ] {
            let places = file(fine).unwrap().positions().to_vec();
            assert_eq!(places[2], Point3::new(0.0, 1.0, 0.0), "{fine:?}");
        }
        for (wrong, name, line) in [
            ("0 0 0\n1 0\n0 1 0\n3 0 1 2\n9 9\n", "vertex", 12),
            ("0 0 0\n1 0 0 7\n0 1 0\n3 0 1 2\n", "vertex", 11),
            ("0 0 0\n1 0 0\n0 1 0\n3 0 1 2 255\n", "face", 13),
        ] {
            let row = PlyError::Row { at: At::Line(line), name: name.into() };
            assert_eq!(file(wrong).unwrap_err(), row, "{wrong:?}");
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
    fn faces_at_vertices_that_are_nowhere_are_left_out_and_so_are_such_points() {
        let file = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\n\
            property float ny\nproperty float nz\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n0 0 0 0 0 1\n1 0 0 0 0 1\n\
            0 1 0 0 0 1\nnan 0 0 nan nan nan\n5 5 inf 0 0 1\n3 0 1 2\n3 1 3 2\n";
        let mesh = Reading::alone("a.ply", file.as_bytes());
        assert_eq!(crate::read::<Mesh>(&mesh).unwrap().faces().len(), 1);
        let why = "a coordinate is NaN or infinite";
        assert_eq!(mesh.doubts(), [format!("1 face is left out: {why}")]);
        let points = Reading::alone("a.ply", file.as_bytes());
        assert_eq!(crate::read::<Points>(&points).unwrap().positions().len(), 3);
        assert_eq!(points.doubts(), [format!("2 points are left out: {why}")]);
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
    fn files_that_lie_are_refused_with_their_line() {
        assert_eq!(error("ply", "plx"), "this is not a PLY file: its first line is not `ply`");
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
        assert_eq!(error("0 1 2\n", "0 1 9\n"), "face 0 names vertex 9, but there are only 4");
        assert_eq!(error("0 3 1 1 2\n", "0 3 1"), "line 30: the file ends too early");
        assert_eq!(
            error("vertex 4", "vertex 4000000000000000000"),
            "line 6: 4000000000000000000 of `vertex` take at least 18446744073709551615 bytes, but only 139 are left"
        );
    }

    #[test]
    fn rows_without_properties_take_no_time() {
        let file = "ply\nformat ascii 1.0\nelement nothing 18446744073709551615\nelement vertex 18446744073709551615\nend_header\n";
        assert_eq!(read(file.as_bytes()), Err(PlyError::NoVertices));
    }

    #[test]
    fn hostile_files_give_errors() {
        for file in GRIDS.into_iter().chain([SQUARE.as_bytes()]) {
            hostile::survive(file, read);
        }
    }
}
