//! Writes PLY files: binary little endian, `float` positions.

use std::ops::Range;

use blake3::Hasher;
use bytemuck::NoUninit;
use maquette_node::importers::{FileReader, InputFile};
use maquette_node::pack::{Content, FileFormat, NewFile};
use maquette_node::provenance::{Signature, comment_of_ply};
use maquette_syntax::error::Error;
use maquette_value::{Attribute, Column, ControlNet, Faces, Mesh};

use super::Contents;
use super::header::{self, CORNER_UV, Kind, TEXCOORD};
use crate::losses;
use crate::rows::{Rows, Table, concatenate, fill_column, floats, indices};
use crate::upright::{upright_points, upright_sign};
use crate::{check_mesh, finite, mesh_precision_note, picture_file, unjoined_note};

/// Writes a mesh with all attributes of its vertices and faces. If it has no vertex colors, those of its texture are written.
pub(crate) struct MeshPly;

impl FileFormat for MeshPly {
    type Value = Mesh;
    const EXTENSION: &'static str = "ply";
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::PLY;

    fn write(mesh: &Mesh, name: &str) -> Result<Vec<NewFile>, Error> {
        Ok(NewFile::single(name, content(mesh, "", upright_sign(mesh))?.into_bytes()))
    }

    fn content<'a>(
        mesh: &'a Mesh,
        signature: Option<&Signature>,
    ) -> Result<Option<Content<'a>>, Error> {
        let comment = signature.map(|signature| comment_of_ply(&signature.words));
        Ok(Some(content(mesh, comment.as_deref().unwrap_or(""), upright_sign(mesh))?))
    }

    fn warnings(mesh: &Mesh) -> Vec<String> {
        let mut warnings: Vec<_> = mesh_precision_note(mesh).into_iter().collect();
        warnings.extend(losses::mesh_warning(mesh, <Self as FileFormat>::FIDELITY));
        if corner_uv(mesh).is_some() && mesh.faces().sides() != Some(3) {
            warnings.push(
                "other programs will not find the texture coordinates: they are at corners of faces that are not triangles, \
                 which MeshLab does not support; write GLB or OBJ instead"
                    .to_owned(),
            );
        }
        warnings
    }
}

/// Writes a control net as quads, with weights and fixed flags.
pub(crate) struct ControlNetPly;

impl FileFormat for ControlNetPly {
    type Value = ControlNet;
    const EXTENSION: &'static str = "ply";

    fn write(net: &ControlNet, name: &str) -> Result<Vec<NewFile>, Error> {
        let (rows, columns) = (net.rows(), net.columns());
        let quads = (0..rows - 1).flat_map(|row| {
            (0..columns - 1).flat_map(move |column| {
                let first = row * columns + column;
                [first, first + columns, first + columns + 1, first + 1].map(|index| index as u32)
            })
        });
        let faces = Faces::uniform(4, quads.collect::<Vec<u32>>())?;
        let mesh = Mesh::new(upright_points(net.points(), net.frame().is_some()), faces)?
            .with_vertex("weight", Attribute::Number(net.weights().to_vec().into()))?
            .with_vertex("fixed", Attribute::Flag(net.fixed_points().to_vec().into()))?;
        Ok(NewFile::single(name, encode(&mesh)?))
    }
}

/// A column of a table: its lines in the header, the number of its bytes per row, and functions that fill and hash it.
struct TableColumn<'a> {
    /// The comment that declares the type of the attribute.
    comment: String,
    properties: String,
    size: usize,
    fill: Fill<'a>,
    hash: HashRows<'a>,
}

/// A function that fills a column. Its arguments are the rows, the index of the first row, the length of a row, and the offset of the
/// column in a row.
type Fill<'a> = Box<dyn Fn(&mut [u8], usize, usize, usize) + Send + Sync + 'a>;

/// A function that hashes the content of a column in a range of rows.
type HashRows<'a> = Box<dyn Fn(Range<usize>, &mut Hasher) + Send + Sync + 'a>;

impl<'a> TableColumn<'a> {
    /// Creates a column for the properties `names`. The hash of the column includes `sign`, because the sign changes the written bytes.
    fn new<T: NoUninit + Send + Sync, B: NoUninit>(
        kind: &str,
        names: &[&str],
        sign: f64,
        items: &Column<T>,
        entry: impl Fn(&T) -> B + Send + Sync + 'a,
    ) -> Self {
        let properties: String =
            names.iter().map(|name| format!("property {kind} {name}\n")).collect();
        let layout = format!("{properties}{sign}");
        let (items, hashed) = (items.clone(), items.clone());
        Self {
            comment: String::new(),
            properties,
            size: size_of::<B>(),
            fill: Box::new(move |rows, first, stride, offset| {
                fill_column(rows, stride, offset, &items[first..], &entry);
            }),
            hash: Box::new(move |rows, to| {
                to.update(layout.as_bytes());
                hashed.hash_rows(rows, to);
            }),
        }
    }

    /// Creates a column of vectors. Their y and z are multiplied by `sign`.
    fn vectors(names: &[&str], vectors: &Column<[f64; 3]>, sign: f64) -> Self {
        Self::new("float", names, sign, vectors, move |&[x, y, z]| floats([x, sign * y, sign * z]))
    }

    /// Creates a column for an attribute. A comment declares the type of its properties, unless the reader of this crate knows it. The
    /// comment ends with `domain`: ` face` for faces, nothing for vertices.
    fn attribute(name: &str, attribute: &'a Attribute, domain: &str, sign: f64) -> Self {
        let name: String = name
            .chars()
            .map(|letter| if letter.is_ascii_alphanumeric() { letter } else { '_' })
            .collect();
        let kind = match attribute {
            Attribute::Number(_) | Attribute::Index(_) => None,
            Attribute::Flag(_) if name == "filled" => None,
            Attribute::Flag(_) => Some(Kind::Flag),
            Attribute::Pair(_) => Some(Kind::Pair),
            Attribute::Vector(_) => Some(Kind::Vector),
            Attribute::Color(_) => Some(Kind::Color),
        };
        let suffixes = kind.map_or(&[""][..], Kind::suffixes).iter();
        let names: Vec<_> = suffixes.map(|suffix| format!("{name}{suffix}")).collect();
        let names: Vec<_> = names.iter().map(|name| &**name).collect();
        let comment =
            kind.map(|kind| format!("comment attribute {} {name}{domain}\n", kind.word()));
        Self { comment: comment.unwrap_or_default(), ..Self::numbers(&names, attribute, sign) }
    }

    /// Creates a column for the numbers of an attribute; `names` are the names of its properties.
    fn numbers(names: &[&str], attribute: &'a Attribute, sign: f64) -> Self {
        match attribute {
            Attribute::Number(numbers) => {
                Self::new("float", names, 1.0, numbers, |&number| floats([number]))
            }
            Attribute::Index(numbers) => {
                Self::new("uint", names, 1.0, numbers, |&number| indices([number]))
            }
            Attribute::Flag(flags) => Self::new("uchar", names, 1.0, flags, |&flag| [flag]),
            Attribute::Pair(pairs) => Self::new("float", names, 1.0, pairs, |&pair| floats(pair)),
            Attribute::Vector(vectors) => Self::vectors(names, vectors, sign),
            Attribute::Color(colors) => Self::new("uchar", names, 1.0, colors, |&color| color),
        }
    }
}

/// Encodes a mesh as a binary little-endian PLY file with `float` positions, normals, texture coordinates, colors and all other vertex
/// attributes by name. If the mesh has no vertex colors, those of the texture are written. Comments declare which attributes are flags,
/// pairs, vectors and colors. Texture coordinates of corners become lists of faces, and attributes of faces are written like those of
/// vertices.
///
/// Returns an error if a coordinate is too large for single precision.
pub fn encode(mesh: &Mesh) -> Result<Vec<u8>, Error> {
    Ok(content(mesh, "", 1.0)?.into_bytes())
}

/// Creates the file of [`encode`] in pieces. `lines` is inserted after the `format` line; y and z of all vectors are multiplied by `sign`.
fn content<'a>(mesh: &'a Mesh, lines: &str, sign: f64) -> Result<Content<'a>, Error> {
    check_mesh(mesh)?;
    let vertex = mesh.vertex();
    let positions = mesh.positions();
    let mut parts =
        vec![TableColumn::new("float", &["x", "y", "z"], sign, positions, move |point| {
            floats([point.x, sign * point.y, sign * point.z])
        })];
    const NORMALS: [&str; 3] = ["nx", "ny", "nz"];
    let given = vertex.vectors("normal");
    let normals = (given.is_none() && !mesh.faces().is_empty()).then(|| mesh.cached_normals());
    parts.extend(given.map(|given| TableColumn::vectors(&NORMALS, given, sign)));
    parts.extend(normals.as_ref().map(|normals| {
        TableColumn::new("float", &NORMALS, sign, normals, move |&[x, y, z]| {
            [x, sign as f32 * y, sign as f32 * z].map(f32::to_le_bytes)
        })
    }));
    if let Some(uv) = vertex.pairs("uv") {
        parts.push(TableColumn::new("float", &["s", "t"], 1.0, uv, |&uv| floats(uv)));
    }
    // Colors of the texture are written because they make the mesh colored in every viewer.
    let given = vertex.colors("color");
    let texture_colors = given.is_none().then(|| mesh.texture_colors()).flatten();
    parts.extend(given.or(texture_colors.as_ref()).map(|colors| {
        TableColumn::new("uchar", &["red", "green", "blue"], 1.0, colors, |&color| color)
    }));
    for (name, attribute) in vertex.iter() {
        let is_written = match name {
            "normal" => vertex.vectors(name).is_some(),
            "uv" => vertex.pairs(name).is_some(),
            "color" => vertex.colors(name).is_some(),
            _ => false,
        };
        if !is_written {
            parts.push(TableColumn::attribute(name, attribute, "", sign));
        }
    }
    let faces = FaceRows::new(mesh, corner_uv(mesh), sign);

    let comments = parts.iter().chain(&faces.parts.0).map(|part| &*part.comment);
    let comments: String = comments.collect();
    let properties: String = parts.iter().map(|part| &*part.properties).collect();
    let (n_vertices, n_faces) = (mesh.positions().len(), mesh.faces().len());
    let header = format!(
        "ply\nformat binary_little_endian 1.0\n{lines}{comments}element vertex {n_vertices}\n{properties}\
         element face {n_faces}\n{}end_header\n",
        faces.properties()
    );
    let parts = TableColumns(parts);
    let vertices = Table::new(n_vertices, parts.size(), parts);
    let tables = vec![Table::from_bytes(header.into_bytes()), vertices, faces.into_table()];
    Ok(concatenate(tables).with_cached_data((normals, texture_colors)))
}

/// Returns the texture coordinates of corners, unless vertices have texture coordinates.
fn corner_uv(mesh: &Mesh) -> Option<&Column<[f64; 2]>> {
    mesh.corner().pairs("uv").filter(|_| mesh.vertex().pairs("uv").is_none())
}

/// The columns of a table.
struct TableColumns<'a>(Vec<TableColumn<'a>>);

impl Rows for TableColumns<'_> {
    fn fill(&self, rows: &mut [u8], first: usize, stride: usize) {
        self.fill_from(0, rows, first, stride);
    }

    fn hash(&self, rows: Range<usize>, to: &mut Hasher) {
        self.0.iter().for_each(|part| (part.hash)(rows.clone(), to));
    }
}

impl TableColumns<'_> {
    /// Fills all columns, the first one at `offset` of each row. `first` is the index of the first row.
    fn fill_from(&self, mut offset: usize, rows: &mut [u8], first: usize, stride: usize) {
        for part in &self.0 {
            (part.fill)(rows, first, stride, offset);
            offset += part.size;
        }
    }

    /// The number of bytes in a row.
    fn size(&self) -> usize {
        self.0.iter().map(|part| part.size).sum()
    }
}

/// The table of faces: the corners, the texture coordinates of corners (unless vertices have them), and the attributes.
struct FaceRows<'a> {
    faces: &'a Faces,
    uv: Option<&'a Column<[f64; 2]>>,
    parts: TableColumns<'a>,
    /// True if a list is so long that its length does not fit in one byte.
    has_long_lists: bool,
}

impl<'a> FaceRows<'a> {
    fn new(mesh: &'a Mesh, uv: Option<&'a Column<[f64; 2]>>, sign: f64) -> Self {
        let faces = mesh.faces();
        let parts = TableColumns(
            mesh.face()
                .iter()
                .map(|(name, attribute): (&str, &'a Attribute)| match attribute {
                    Attribute::Color(_) if name == "color" => TableColumn {
                        comment: String::new(),
                        ..TableColumn::numbers(&["red", "green", "blue"], attribute, sign)
                    },
                    _ => TableColumn::attribute(name, attribute, " face", sign),
                })
                .collect(),
        );
        let entries = if uv.is_some() { 2 } else { 1 };
        let longest = match faces.sides() {
            Some(sides) => sides,
            None => faces.iter().map(<[u32]>::len).max().unwrap_or(0),
        };
        let has_long_lists = entries * longest > usize::from(u8::MAX);
        Self { faces, uv, parts, has_long_lists }
    }

    fn properties(&self) -> String {
        let length = if self.has_long_lists { "uint" } else { "uchar" };
        let mut text = format!("property list {length} uint vertex_indices\n");
        if self.uv.is_some() {
            let name = if self.faces.sides() == Some(3) { TEXCOORD } else { CORNER_UV };
            text += &format!("property list {length} float {name}\n");
        }
        self.parts.0.iter().for_each(|part| text += &part.properties);
        text
    }

    /// Converts the faces to a table. It is built in memory if the rows differ in length.
    fn into_table(self) -> Table<'a> {
        match self.faces.sides() {
            Some(sides) => {
                let stride = self.size_of_lists(sides) + self.parts.size();
                Table::new(self.faces.len(), stride, self)
            }
            None => Table::from_bytes(self.rows_of_varying_size(self.parts.size())),
        }
    }

    /// Encodes faces with different numbers of corners. Each face has `attributes` bytes of attributes.
    fn rows_of_varying_size(&self, attributes: usize) -> Vec<u8> {
        let mut table = vec![0; attributes * self.faces.len()];
        if 0 < attributes {
            self.parts.fill(&mut table, 0, attributes);
        }
        let sizes: Vec<usize> =
            self.faces.iter().map(|face| self.size_of_lists(face.len()) + attributes).collect();
        let mut bytes = vec![0; sizes.iter().sum()];
        let mut rest = &mut bytes[..];
        for (index, size) in sizes.into_iter().enumerate() {
            let (row, others) = rest.split_at_mut(size);
            let (lists, end) = row.split_at_mut(row.len() - attributes);
            self.put_lists(index, lists);
            end.copy_from_slice(&table[index * attributes..][..attributes]);
            rest = others;
        }
        bytes
    }

    /// The number of bytes that the lists of a face take.
    fn size_of_lists(&self, corners: usize) -> usize {
        let length = if self.has_long_lists { 4 } else { 1 };
        let uv = if self.uv.is_some() { length + 8 * corners } else { 0 };
        length + 4 * corners + uv
    }

    /// Writes the lists of a face into its row.
    fn put_lists(&self, index: usize, mut row: &mut [u8]) {
        let face = self.faces.face(index);
        fn put(bytes: &[u8], row: &mut &mut [u8]) {
            let (next, rest) = std::mem::take(row).split_at_mut(bytes.len());
            next.copy_from_slice(bytes);
            *row = rest;
        }
        fn length(count: usize) -> [u8; 4] {
            (count as u32).to_le_bytes()
        }
        let size = if self.has_long_lists { 4 } else { 1 };
        put(&length(face.len())[..size], &mut row);
        face.iter().for_each(|vertex| put(&vertex.to_le_bytes(), &mut row));
        if let Some(uv) = self.uv {
            put(&length(2 * face.len())[..size], &mut row);
            let uv = &uv[self.faces.first_corner(index)..][..face.len()];
            uv.iter().for_each(|&uv| put(floats(uv).as_flattened(), &mut row));
        }
    }
}

/// The rows for faces that all have the same number of corners.
impl Rows for FaceRows<'_> {
    fn fill(&self, rows: &mut [u8], first: usize, stride: usize) {
        let lists = stride - self.parts.size();
        match (self.faces.as_triangles(), self.uv) {
            (Some(triangles), None) => {
                for (row, &triangle) in rows.chunks_exact_mut(stride).zip(&triangles[first..]) {
                    row[0] = 3;
                    row[1..13].copy_from_slice(indices(triangle).as_flattened());
                }
            }
            _ => {
                let rows = rows.chunks_exact_mut(stride).enumerate();
                rows.for_each(|(k, row)| self.put_lists(first + k, &mut row[..lists]));
            }
        }
        self.parts.fill_from(lists, rows, first, stride);
    }

    fn hash(&self, rows: Range<usize>, to: &mut Hasher) {
        to.update(self.properties().as_bytes());
        let corners = self.faces.first_corner(rows.start)..self.faces.first_corner(rows.end);
        self.faces.corners().hash_rows(corners.clone(), to);
        self.uv.iter().for_each(|uv| uv.hash_rows(corners.clone(), to));
        self.parts.hash(rows, to);
    }
}

impl FileReader for MeshPly {
    type Value = Mesh;
    const EXTENSIONS: &'static [&'static str] = &["ply"];
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::PLY_READ;
    const SIZE: crate::SizeReader = Some(super::size::mesh);

    fn read(file: &InputFile<'_>) -> Result<Mesh, Error> {
        let Contents { mesh, finite, notes, face_notes, pictures } =
            super::read_contents(file.bytes(), file.color_range())?;
        notes.into_iter().chain(face_notes).for_each(|note| file.warn(note));
        let (mesh, left_out) = finite.mesh(mesh);
        finite::warn_left_out(file, left_out, "face");
        unjoined_note(&mesh).into_iter().for_each(|note| file.warn(note));
        if let [first, _, ..] = &pictures[..] {
            file.warn(format!(
                "the file has {} pictures, but the mesh uses only the first, `{first}`, for all faces",
                pictures.len()
            ));
        }
        Ok(match pictures.first() {
            Some(first) => picture_file::on_mesh(mesh, first, file),
            None => mesh,
        })
    }

    const COMPANIONS: Option<fn(&InputFile<'_>)> = Some(|file| {
        let pictures = header::read(file.bytes()).map(|header| header.pictures).unwrap_or_default();
        pictures.first().into_iter().for_each(|name| drop(file.companion(name)));
    });
}

#[cfg(test)]
mod tests {
    use maquette_value::Image;
    use nalgebra::Point3;

    use super::*;
    use crate::ply::read;

    /// Creates a quad beside a triangle.
    fn mesh() -> Mesh {
        fn point(x: f64, y: f64) -> Point3<f64> {
            Point3::new(x, y, 0.25)
        }
        let positions =
            vec![point(0., 0.), point(1., 0.), point(1., 1.), point(0., 1.), point(2., 0.)];
        let faces = Faces::polygons(&[4, 3], vec![0, 1, 2, 3, 1, 4, 2]).unwrap();
        Mesh::new(positions, faces).unwrap()
    }

    fn pairs(count: usize) -> Vec<[f64; 2]> {
        (0..count).map(|i| [i as f64 / 8.0, 1.0 - i as f64 / 16.0]).collect()
    }

    #[test]
    fn a_written_mesh_is_read_back_with_normals() {
        let mesh = mesh()
            .with_vertex("uv", Attribute::Pair(pairs(5).into()))
            .and_then(|mesh| mesh.with_vertex("color", Attribute::Color(vec![[1, 2, 3]; 5].into())))
            .and_then(|mesh| {
                mesh.with_vertex("filled", Attribute::Flag(vec![0, 1, 0, 0, 1].into()))
            })
            .and_then(|mesh| mesh.with_vertex("h", Attribute::Number(vec![0.5; 5].into())))
            .and_then(|mesh| mesh.with_vertex("part", Attribute::Index(vec![7; 5].into())))
            .unwrap();
        let again = read(&encode(&mesh).unwrap()).unwrap();
        let normals = Attribute::Vector(vec![[0.0, 0.0, 1.0]; 5].into());
        assert_eq!(again, mesh.with_vertex("normal", normals).unwrap());
    }

    #[test]
    fn texture_coordinates_of_corners_are_kept_where_vertices_have_none() {
        let mesh = mesh().with_corner("uv", Attribute::Pair(pairs(7).into())).unwrap();
        let again = read(&encode(&mesh).unwrap()).unwrap();
        assert_eq!(again.corner(), mesh.corner());
        assert_eq!(again.faces(), mesh.faces());
        assert!(MeshPly::warnings(&mesh)[0].contains("GLB or OBJ"));
    }

    #[test]
    fn texture_coordinates_of_corners_have_the_usual_name_on_triangles_alone() {
        let triangles = Faces::triangles(vec![[0, 1, 2], [1, 4, 2]]);
        let triangles = Mesh::new(mesh().positions().clone(), triangles).unwrap();
        let triangles = triangles.with_corner("uv", Attribute::Pair(pairs(6).into())).unwrap();
        let others = mesh().with_corner("uv", Attribute::Pair(pairs(7).into())).unwrap();
        for (mesh, name) in [(triangles, " texcoord\n"), (others, " corner_uv\n")] {
            let file = encode(&mesh).unwrap();
            assert!(String::from_utf8_lossy(&file).contains(name), "{name}");
            assert_eq!(read(&file).unwrap().corner(), mesh.corner());
            assert_eq!(MeshPly::warnings(&mesh).is_empty(), name.contains("texcoord"));
        }
    }

    #[test]
    fn attributes_of_faces_are_read_back_for_triangles_and_polygons() {
        let positions = mesh().positions().clone();
        let triangles = Faces::triangles(vec![[0, 1, 2], [1, 4, 2]]);
        for mesh in [mesh(), Mesh::new(positions, triangles).unwrap()] {
            let mesh = [
                ("area", Attribute::Number(vec![1.0, 0.5].into())),
                ("color", Attribute::Color(vec![[1, 2, 3], [4, 5, 6]].into())),
                ("material", Attribute::Index(vec![7, 70_000].into())),
                ("seen", Attribute::Flag(vec![1, 0].into())),
                ("up", Attribute::Vector(vec![[0.0, 0.5, 0.0], [1.0, 0.0, 0.0]].into())),
            ]
            .into_iter()
            .fold(mesh, |mesh, (name, attribute)| mesh.with_face(name, attribute).unwrap());
            let mesh = mesh.with_vertex("seen", Attribute::Number(vec![0.5; 5].into())).unwrap();
            let again = read(&encode(&mesh).unwrap()).unwrap();
            assert_eq!(again.face(), mesh.face());
            assert_eq!(again.faces(), mesh.faces());
            assert_eq!(again.vertex().get("seen"), mesh.vertex().get("seen"));
        }
    }

    #[test]
    fn attributes_of_a_degenerate_face_are_left_out() {
        let text = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
            element face 2\nproperty list uchar int vertex_indices\nproperty int part\nproperty float heat\nend_header\n\
            0 0 0\n1 0 0\n0 1 0\n3 0 0 1 4 0.25\n3 0 1 2 5 0.5\n";
        let mesh = read(text).unwrap();
        assert_eq!(mesh.face().get("part"), Some(&Attribute::Index(vec![5].into())));
        assert_eq!(mesh.face().get("heat"), Some(&Attribute::Number(vec![0.5].into())));
    }

    #[test]
    fn triangles_are_written_as_other_faces_are() {
        let positions = vec![Point3::origin(), Point3::new(1., 0., 0.), Point3::new(0., 1., 0.)];
        let faces = Faces::triangles(vec![[0, 1, 2], [2, 1, 0]]);
        let mesh = Mesh::new(positions, faces).unwrap();
        assert_eq!(read(&encode(&mesh).unwrap()).unwrap().faces(), mesh.faces());
    }

    #[test]
    fn a_face_of_three_hundred_corners_is_written() {
        let positions: Vec<_> = (0..300).map(|i| Point3::new(f64::from(i), 0.0, 0.0)).collect();
        let faces = Faces::uniform(300, (0..300).collect::<Vec<_>>()).unwrap();
        let mesh = Mesh::new(positions, faces).unwrap();
        assert_eq!(read(&encode(&mesh).unwrap()).unwrap().faces(), mesh.faces());
    }

    #[test]
    fn a_texture_colors_the_vertices() {
        let image = Image::new(2, 1, vec![[10, 20, 30], [40, 50, 60]]).unwrap();
        let uv = vec![[0.0, 0.5], [1.0, 0.5], [1.0, 0.5], [0.0, 0.5], [0.5, 0.5]];
        let mesh = mesh().with_vertex("uv", Attribute::Pair(uv.into())).unwrap();
        let again = read(&encode(&mesh.with_texture(Some(image))).unwrap()).unwrap();
        let colors = again.vertex().colors("color").unwrap();
        assert_eq!(colors[..2], [[10, 20, 30], [40, 50, 60]]);
        assert_eq!(colors[4], [25, 35, 45]);
    }

    #[test]
    fn vectors_pairs_colors_and_flags_keep_their_type() {
        let attributes = [
            ("direction1", Attribute::Vector(vec![[1.0, 2.0, 3.0]; 5].into())),
            ("at", Attribute::Pair(vec![[4.0, 5.0]; 5].into())),
            ("paint", Attribute::Color(vec![[7, 8, 9]; 5].into())),
            ("unknown", Attribute::Flag(vec![0, 1, 0, 1, 1].into())),
            ("extraordinary", Attribute::Flag(vec![0; 5].into())),
            ("at_2", Attribute::Number(vec![0.5; 5].into())),
        ];
        let mut mesh = mesh();
        for (name, attribute) in &attributes {
            mesh = mesh.with_vertex(name, attribute.clone()).unwrap();
        }
        let again = read(&encode(&mesh).unwrap()).unwrap();
        for (name, attribute) in &attributes {
            assert_eq!(again.vertex().get(name), Some(attribute), "{name}");
        }
        assert_eq!(again.vertex().iter().count(), attributes.len() + 1, "and normals");
    }

    #[test]
    fn other_programs_find_vectors_and_pairs_by_coordinate() {
        let mesh = mesh()
            .with_vertex("along it", Attribute::Vector(vec![[1.0, 2.0, 3.0]; 5].into()))
            .and_then(|mesh| mesh.with_vertex("at", Attribute::Pair(vec![[4.0, 5.0]; 5].into())))
            .unwrap();
        let file = encode(&mesh).unwrap();
        // Other programs ignore the comments that declare attributes.
        let start = file.windows(11).position(|window| window == b"end_header\n").unwrap();
        let header = std::str::from_utf8(&file[..start]).unwrap().lines();
        let header: String = header
            .filter(|line| !line.starts_with("comment"))
            .map(|line| format!("{line}\n"))
            .collect();
        let again = read(&[header.as_bytes(), &file[start..]].concat()).unwrap();
        for (name, number) in
            [("along_it_x", 1.0), ("along_it_z", 3.0), ("at_0", 4.0), ("at_1", 5.0)]
        {
            let expected = Attribute::Number(vec![number; 5].into());
            assert_eq!(again.vertex().get(name), Some(&expected), "{name}");
        }
    }

    #[test]
    fn a_net_becomes_quads() {
        let points: Vec<_> = (0..6).map(|i| Point3::new(f64::from(i), 0.0, 1.0)).collect();
        let net = ControlNet::new(2, 3, points).unwrap();
        let net = net.with_weights(vec![1., 2., 3., 4., 5., 6.]).unwrap();
        let mesh = read(&ControlNetPly::write(&net, "net.ply").unwrap()[0].bytes).unwrap();
        assert_eq!(mesh.faces().iter().collect::<Vec<_>>(), [[0, 3, 4, 1], [1, 4, 5, 2]]);
        let weights = Attribute::Number(net.weights().to_vec().into());
        assert_eq!(mesh.vertex().get("weight"), Some(&weights));
    }
}
