//! Writes OBJ files, with an MTL file and picture files for a mesh with materials.
//!
//! All lines are formatted before the file is written, because their lengths are not known in advance.

use std::borrow::Cow;
use std::ops::Range;
use std::path::Path;

use maquette_node::importers::{FileReader, InputFile};
use maquette_node::pack::{Content, FileFormat, NewFile};
use maquette_node::provenance::{Signature, comment_of_obj};
use maquette_syntax::error::Error;
use maquette_value::parallel::*;
use maquette_value::{Attribute, Column, MATERIAL_ATTRIBUTE, Material, Mesh, MeshError, Rgb};

use super::material::{read_named, request_files};
use super::material_writer::{self, MaterialWriter, without_unused};
use super::mtl::{Layout, names};
use crate::corners::{add_corner_data, split};
use crate::glb::is_extension;
use crate::losses;
use crate::upright::upright;
use crate::{check_mesh, mesh_precision_note};

/// Writes a mesh as `name.obj`. A mesh with materials is also written as `name.mtl` and picture files.
pub(crate) struct MeshObj;

impl FileFormat for MeshObj {
    type Value = Mesh;
    const EXTENSION: &'static str = "obj";
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::OBJ;

    fn write(mesh: &Mesh, name: &str) -> Result<Vec<NewFile>, Error> {
        let mesh = &*upright(mesh)?;
        check_mesh(mesh)?;
        if mesh.materials().is_empty() {
            return Ok(NewFile::single(name, encode(mesh, String::new(), &[]).into_bytes()));
        }
        let stem = companion_stem(name);
        let writer = MaterialWriter::new(mesh, &stem)?;
        let names = &writer.names[..];
        let start = match names {
            [only] => format!("mtllib {stem}.mtl\nusemtl {only}\n"),
            _ => format!("mtllib {stem}.mtl\n"),
        };
        let bytes = encode(mesh, start, names).into_bytes();
        let material = NewFile { name: format!("{stem}.mtl"), bytes: writer.text.into_bytes() };
        let files = [NewFile { name: name.to_owned(), bytes }, material];
        Ok(files.into_iter().chain(writer.pictures).collect())
    }

    fn content<'a>(
        mesh: &'a Mesh,
        signature: Option<&Signature>,
    ) -> Result<Option<Content<'a>>, Error> {
        if !mesh.materials().is_empty() {
            return Ok(None);
        }
        let mesh = &*upright(mesh)?;
        check_mesh(mesh)?;
        let comment = signature.map(|signature| comment_of_obj(&signature.words));
        Ok(Some(encode(mesh, comment.unwrap_or_default(), &[])))
    }

    fn warnings(mesh: &Mesh) -> Vec<String> {
        mesh_precision_note(mesh)
            .into_iter()
            .chain(losses::mesh_warning(mesh, <Self as FileFormat>::FIDELITY))
            .chain(losses::materials_warning(mesh, |name, _| !is_extension(name)))
            .chain(material_writer::warnings(mesh))
            .collect()
    }
}

/// Returns the stem for the names of the files beside an OBJ file. Blanks and some characters are replaced: OBJ and MTL separate names by
/// blanks and begin comments with `#`, and viewers in browsers treat names as parts of URLs.
fn companion_stem(name: &str) -> String {
    let stem = Path::new(name).file_stem().unwrap_or_default().to_string_lossy();
    stem.replace(|letter: char| letter.is_whitespace() || "#%?".contains(letter), "_")
}

/// The index by which a corner refers to its texture coordinate or its normal, from 0.
enum Reference {
    None,
    /// The index equals the index of the vertex.
    Vertex,
    /// Each corner has a separate index.
    Corner(Vec<u32>),
}

impl Reference {
    fn is_none(&self) -> bool {
        matches!(self, Self::None)
    }

    /// Appends the index of a corner. The digits of its vertex index are in the range `vertex` of the text.
    fn push(&self, text: &mut Vec<u8>, corner: usize, vertex: Range<usize>) {
        match self {
            Self::None => {}
            Self::Vertex => text.extend_from_within(vertex),
            Self::Corner(numbers) => push_index(text, numbers[corner]),
        }
    }
}

/// Formats a mesh. The text begins with the lines `start`; `materials` are the names of the face materials.
fn encode(mesh: &Mesh, start: String, materials: &[String]) -> Content<'static> {
    let colors = mesh.vertex().colors("color").filter(|_| material_writer::shows_colors(mesh));
    let numbers = mesh.face_materials().filter(|_| materials.len() > 1);
    fn material(face: usize, numbers: Option<&Column<u32>>, mesh: &Mesh) -> Option<u32> {
        numbers.map(|numbers| mesh.resolve_material(numbers[face]))
    }
    let mut text = vec![start.into_bytes()];
    text.extend(lines(mesh.positions().len(), |text, index| {
        push_floats(text, "v", mesh.positions()[index].coords.as_slice());
        if let Some(colors) = colors {
            push_color(text, colors[index]);
        }
    }));
    let uv = per_vertex_or_corner(mesh, mesh.vertex().pairs("uv"), mesh.corner().pairs("uv"));
    let normals = per_vertex_or_corner(
        mesh,
        mesh.vertex().vectors("normal"),
        mesh.corner().vectors("normal"),
    );
    text.extend(lines(uv.0.len(), |text, index| push_floats(text, "vt", &uv.0[index])));
    text.extend(lines(normals.0.len(), |text, index| push_floats(text, "vn", &normals.0[index])));
    text.extend(lines(mesh.faces().len(), |text, face| {
        if let Some(number) = material(face, numbers, mesh)
            && (face == 0 || material(face - 1, numbers, mesh) != Some(number))
        {
            text.extend_from_slice(format!("usemtl {}\n", materials[number as usize]).as_bytes());
        }
        text.push(b'f');
        for (corner, &vertex) in (mesh.faces().first_corner(face)..).zip(mesh.faces().face(face)) {
            text.push(b' ');
            let start = text.len();
            push_index(text, vertex);
            let digits = start..text.len();
            if !uv.1.is_none() || !normals.1.is_none() {
                text.push(b'/');
                uv.1.push(text, corner, digits.clone());
            }
            if !normals.1.is_none() {
                text.push(b'/');
                normals.1.push(text, corner, digits);
            }
        }
    }));
    join_pieces(text)
}

/// Returns the list of entries to write, and for each corner the index of its entry. Data of vertices are listed unchanged. Data of corners
/// are listed vertex by vertex, and equal entries at one vertex only once.
fn per_vertex_or_corner<'a, T: Copy + PartialEq>(
    mesh: &Mesh,
    vertices: Option<&'a Column<T>>,
    corners: Option<&'a Column<T>>,
) -> (Cow<'a, [T]>, Reference) {
    if let Some(vertices) = vertices {
        return (Cow::Borrowed(vertices), Reference::Vertex);
    }
    let Some(corners) = corners else { return (Cow::Borrowed(&[]), Reference::None) };
    let split = split(mesh, |a, b| corners[a] == corners[b]);
    let entries = split.corners.iter().map(|&corner| corners[corner as usize]).collect();
    (Cow::Owned(entries), Reference::Corner(split.of_corner))
}

/// Formats `count` lines in parallel. Each returned piece contains consecutive lines.
fn lines(count: usize, line: impl Fn(&mut Vec<u8>, usize) + Sync) -> Vec<Vec<u8>> {
    const PIECE: usize = 2048;
    (0..count.div_ceil(PIECE))
        .into_par_iter()
        .map(|piece: usize| {
            // The capacity is sufficient for long lines and avoids reallocation.
            let mut text = Vec::with_capacity(48 * PIECE);
            for index in piece * PIECE..count.min((piece + 1) * PIECE) {
                line(&mut text, index);
                text.push(b'\n');
            }
            text
        })
        .collect()
}

/// Concatenates the pieces.
fn join_pieces(pieces: Vec<Vec<u8>>) -> Content<'static> {
    let mut len = 0;
    let starts: Vec<_> = pieces
        .iter()
        .map(|piece| {
            len += piece.len();
            len - piece.len()
        })
        .collect();
    Content::pieces(len, move |mut offset, mut bytes| {
        let first = starts.partition_point(|&start| start <= offset) - 1;
        for (piece, start) in pieces[first..].iter().zip(&starts[first..]) {
            let there = &piece[offset - start..];
            let (here, remaining) = bytes.split_at_mut(there.len().min(bytes.len()));
            here.copy_from_slice(&there[..here.len()]);
            offset += here.len();
            bytes = remaining;
            if bytes.is_empty() {
                break;
            }
        }
    })
}

fn push_floats(text: &mut Vec<u8>, keyword: &str, numbers: &[f64]) {
    text.extend_from_slice(keyword.as_bytes());
    numbers.iter().for_each(|&number| push_float(text, number));
}

fn push_color(text: &mut Vec<u8>, color: Rgb) {
    color.into_iter().for_each(|channel| push_float(text, f64::from(channel) / 255.0));
}

/// Appends a blank and the shortest text that reads as the same single-precision number. A number that is not finite becomes 0.
fn push_float(text: &mut Vec<u8>, number: f64) {
    let number = number as f32;
    text.push(b' ');
    serde_json::to_writer(text, if number.is_finite() { &number } else { &0.0 })
        .expect("numbers are JSON, and a vector takes all bytes");
}

/// Appends an index, which OBJ counts from 1.
fn push_index(text: &mut Vec<u8>, index: u32) {
    serde_json::to_writer(text, &(u64::from(index) + 1))
        .expect("numbers are JSON, and a vector takes all bytes");
}

/// Applies the placement of each material's pictures to the texture coordinates. `layouts` has the placements for each material.
fn apply_layouts(mut mesh: Mesh, layouts: &[Vec<Layout>]) -> Result<Mesh, MeshError> {
    let plain = mesh.clone();
    let (vertex, corner) = (plain.vertex().pairs("uv"), plain.corner().pairs("uv"));
    let sets = layouts.iter().map(Vec::len).max().unwrap_or(0);
    let numbers = match plain.face().get(MATERIAL_ATTRIBUTE) {
        Some(Attribute::Index(numbers)) => Some(numbers),
        _ => None,
    };
    for set in 0..sets {
        let name = if set == 0 { "uv".to_owned() } else { format!("uv{set}") };
        fn layout(material: usize, set: usize, layouts: &[Vec<Layout>]) -> Layout {
            layouts.get(material).and_then(|all| all.get(set)).copied().unwrap_or_default()
        }
        let first = layout(0, set, layouts);
        let is_one = numbers.is_none()
            || (1..=layouts.len()).all(|number| layout(number, set, layouts) == first);
        if is_one && set == 0 && first == Layout::default() {
            continue;
        }
        fn apply_layout(layout: Layout, uv: &Column<[f64; 2]>) -> Attribute {
            Attribute::Pair(uv.iter().map(|&uv| layout.apply(uv)).collect())
        }
        mesh = match (vertex, corner) {
            (Some(uv), _) if is_one => mesh.with_vertex(&name, apply_layout(first, uv))?,
            (None, Some(uv)) if is_one => mesh.with_corner(&name, apply_layout(first, uv))?,
            (None, None) => mesh,
            _ => {
                let mut moved = Vec::with_capacity(mesh.faces().corners().len());
                for (face, corners) in plain.faces().iter().enumerate() {
                    let layout = layout(numbers.map_or(0, |all| all[face] as usize), set, layouts);
                    for &vertex_index in corners {
                        let uv = match (vertex, corner) {
                            (Some(uv), _) => uv[vertex_index as usize],
                            (None, uv) => uv.map_or([0.0; 2], |uv| uv[moved.len()]),
                        };
                        moved.push(layout.apply(uv));
                    }
                }
                add_corner_data(
                    mesh.without_attribute(&name),
                    &name,
                    moved,
                    [0.0; 2],
                    Attribute::Pair,
                )?
            }
        };
    }
    Ok(mesh)
}

impl FileReader for MeshObj {
    type Value = Mesh;
    const EXTENSIONS: &'static [&'static str] = &["obj"];
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::OBJ_READ;
    const SIZE: crate::SizeReader = Some(crate::size::obj);

    fn read(file: &InputFile<'_>) -> Result<Mesh, Error> {
        let (mesh, notes, used) = super::read_with_notes(file.bytes(), file.color_range())?;
        notes.into_iter().for_each(|note| file.warn(note));
        let has_uv = [mesh.vertex(), mesh.corner()].iter().any(|it| it.pairs("uv").is_some());
        let [libraries, _] = names(file.bytes());
        let found = read_named(&libraries, &used, has_uv, &mut |name| file.companion(name));
        found.warnings.into_iter().for_each(|warning| file.warn(warning));
        let mut all = found.materials;
        let has_several = mesh.face().get(MATERIAL_ATTRIBUTE).is_some();
        if has_several && !all.is_empty() {
            // The default material is for the faces before the first line `usemtl`.
            all.push(Material::default());
        }
        let mesh = apply_layouts(mesh, &found.layouts)?;
        Ok(match all.len() {
            0 => mesh.without_face(MATERIAL_ATTRIBUTE),
            _ => without_unused(mesh.with_materials(all)),
        })
    }

    const COMPANIONS: Option<fn(&InputFile<'_>)> = Some(|file| {
        request_files(file.bytes(), &mut |name| file.companion(name));
    });
}

#[cfg(test)]
mod tests {
    use maquette_value::{Attribute, Faces, Image};
    use nalgebra::Point3;

    use super::*;
    use crate::obj::read;

    fn mesh() -> Mesh {
        fn point(x: f64, y: f64) -> Point3<f64> {
            Point3::new(x, y, -0.125)
        }
        let positions =
            vec![point(0., 0.), point(0.5, 0.), point(1., 1.), point(0., 1e9), point(2.5, 0.)];
        let faces = Faces::polygons(&[4, 3], vec![0, 1, 2, 3, 1, 4, 2]).unwrap();
        Mesh::new(positions, faces).unwrap()
    }

    fn write_files(mesh: &Mesh) -> Vec<NewFile> {
        MeshObj::write(mesh, "my.model.obj").unwrap()
    }

    #[test]
    fn a_written_mesh_is_read_back() {
        fn uv(count: i32) -> Attribute {
            Attribute::Pair((0..count).map(|i| [f64::from(i), 0.5]).collect())
        }
        fn normals(count: i32) -> Attribute {
            Attribute::Vector((0..count).map(|i| [f64::from(i), 0., 1.]).collect())
        }
        let colors = (0..5).map(|i| [i * 60, 255, 1 + i]).collect();
        let plain = mesh();
        let colored = mesh().with_vertex("color", Attribute::Color(colors)).unwrap();
        let textured = mesh().with_vertex("uv", uv(5)).unwrap();
        let cut = mesh().with_corner("uv", uv(7)).unwrap();
        let shaded = mesh().with_vertex("normal", normals(5)).unwrap();
        let both = cut.clone().with_corner("normal", normals(7)).unwrap();
        for mesh in [plain, colored, textured, cut, shaded, both] {
            assert_eq!(read(&write_files(&mesh)[0].bytes).unwrap(), mesh);
        }
    }

    #[test]
    fn single_precision_survives() {
        let single = [1e-7f32, -1.0 / 3.0, 3.4e38, 16_777_217.0, f32::MIN_POSITIVE, 0.1];
        let points = single.chunks(3).map(|x| Point3::new(x[0], x[1], x[2]).map(f64::from));
        let mesh = Mesh::new(points.collect::<Vec<_>>(), Faces::triangles(vec![])).unwrap();
        let again = read(&write_files(&mesh)[0].bytes).unwrap();
        let numbers = again.positions().iter().flat_map(|point| Vec::from(point.coords.as_slice()));
        assert_eq!(numbers.map(|x| x as f32).collect::<Vec<_>>(), single);
    }

    #[test]
    fn a_texture_comes_with_a_material_and_a_picture() {
        let image = Image::new(1, 1, vec![[1, 2, 3]]).unwrap();
        let mesh = mesh().with_texture(Some(image.clone()));
        let files = write_files(&mesh);
        let names: Vec<_> = files.iter().map(|file| &*file.name).collect();
        assert_eq!(names, ["my.model.obj", "my.model.mtl", "my.model.png"]);
        assert!(files[0].bytes.starts_with(b"mtllib my.model.mtl\nusemtl material\nv "));
        assert!(files[1].bytes.ends_with(b"map_Kd my.model.png\n"));
        assert_eq!(crate::png::read(&files[2].bytes).unwrap(), image);
    }

    #[test]
    fn companion_files_have_names_that_other_programs_accept() {
        let mesh = mesh().with_texture(Some(Image::new(1, 1, vec![[1, 2, 3]]).unwrap()));
        for (name, stem) in [
            ("my größe #1.obj", "my_größe__1"),
            ("50%20 a?b.c.obj", "50_20_a_b.c"),
            ("a-b_(c).obj", "a-b_(c)"),
        ] {
            let files = MeshObj::write(&mesh, name).unwrap();
            let names: Vec<_> = files.iter().map(|file| &*file.name).collect();
            assert_eq!(names, [name, &format!("{stem}.mtl"), &format!("{stem}.png")]);
            let [obj, mtl] = [0, 1].map(|k| String::from_utf8_lossy(&files[k].bytes).into_owned());
            assert!(obj.starts_with(&format!("mtllib {stem}.mtl\n")));
            assert!(mtl.ends_with(&format!("map_Kd {stem}.png\n")));
        }
    }

    #[test]
    fn many_vertices_keep_their_order() {
        let positions: Vec<_> = (0..10_000).map(|i| Point3::new(f64::from(i), 0., 0.)).collect();
        let mesh = Mesh::new(positions, Faces::triangles(vec![[0, 1, 9999]])).unwrap();
        assert_eq!(read(&write_files(&mesh)[0].bytes).unwrap(), mesh);
    }
}
