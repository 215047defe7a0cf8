//! 3MF, the files of 3D printers: a mesh with its colors or its texture, in millimeters, on the build plate.
//!
//! 3MF Consortium, "3D Manufacturing Format Core Specification", 1.3.0 (2021), and "Materials and Properties Extension", 1.2.1 (2021). A
//! file is a ZIP archive that contains a model in XML, a picture, and relationship files that connect them. Meshes have y up and the build
//! plate has z up, so the build item rotates the mesh by 90 degrees about x, and moves it to positive coordinates. The stored object has
//! the coordinates of the mesh.

use std::collections::HashMap;
use std::fmt::Write;

use maquette_node::importers::{FileReader, InputFile};
use maquette_node::pack::{FileFormat, NewFile};
use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::{Material, Mesh, Rgb};
use nalgebra::Point3;

use super::losses;
use super::upright::upright;
use super::{check_mesh, mesh_precision_note, open_mesh_note, png, zip};

mod model;
mod read;

/// Writes a mesh with its texture, or its vertex colors; polygons are triangulated.
pub(super) struct MeshThreeMf;

impl FileFormat for MeshThreeMf {
    type Value = Mesh;
    const EXTENSION: &'static str = "3mf";
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::THREE_MF;

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

impl FileReader for MeshThreeMf {
    type Value = Mesh;
    const EXTENSIONS: &'static [&'static str] = &["3mf"];
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::THREE_MF_READ;

    fn read(file: &InputFile<'_>) -> Result<Mesh, Error> {
        let (mesh, notes) = read::read(file.bytes())?;
        notes.into_iter().for_each(|note| file.warn(note));
        Ok(mesh)
    }
}

const TYPES: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
 <Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
 <Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
 <Default Extension="png" ContentType="image/png"/>
 <Default Extension="json" ContentType="application/json"/>
</Types>
"#;

/// Creates a relationship file that refers to `target`. `kind` is the end of the relationship type's URL.
fn relation(target: &str, kind: &str) -> String {
    format!(
        r#"<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
 <Relationship Target="{target}" Id="rel0" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/{kind}"/>
</Relationships>
"#
    )
}

fn encode(mesh: &Mesh) -> Result<Vec<u8>, Error> {
    let Some((low, high)) = mesh.bounds().filter(|_| !mesh.faces().is_empty()) else {
        bail!("a mesh without faces cannot be written as 3MF");
    };
    check_mesh(mesh)?;
    let look = Appearance::new(mesh);
    let mut model = String::with_capacity(40 * mesh.positions().len() + 80 * mesh.faces().len());
    write_model(&mut model, mesh, &look, low, high).expect("a text takes all that is written");
    let [models, textures] = [
        relation("/3D/3dmodel.model", "3dmodel"),
        relation("/3D/Textures/texture.png", "3dtexture"),
    ];
    let mut files = vec![
        ("[Content_Types].xml", TYPES.as_bytes()),
        ("_rels/.rels", models.as_bytes()),
        ("3D/3dmodel.model", model.as_bytes()),
    ];
    let picture = match (&look, mesh.texture()) {
        (Appearance::Texture(..), Some(texture)) => png::encode_rgb(texture)?,
        _ => Vec::new(),
    };
    if !picture.is_empty() {
        files.push(("3D/_rels/3dmodel.model.rels", textures.as_bytes()));
        files.push(("3D/Textures/texture.png", &picture));
    }
    zip::archive(&files)
}

/// The appearance of the faces: a list of distinct entries, and for each corner the index of its entry.
enum Appearance {
    Plain,
    Colors(Vec<Rgb>, Vec<u32>),
    /// The distinct texture coordinates, and for each corner the index of its entry.
    Texture(Vec<[f32; 2]>, Vec<u32>),
}

impl Appearance {
    fn new(mesh: &Mesh) -> Self {
        let corners = mesh.faces().corners();
        let has_colors = mesh.vertex().colors("color").or(mesh.corner().colors("color")).is_some();
        let is_white = mesh
            .materials()
            .iter()
            .all(|it| it.non_empty_picture().is_none() && it.color() == [255; 3]);
        if mesh.face_materials().is_some() || !has_colors && mesh.texture().is_none() && !is_white {
            let (listed, of_corner) = deduplicate(corner_colors(mesh).into_iter(), |color| color);
            return Self::Colors(listed, of_corner);
        }
        if mesh.texture().is_some() {
            let (of_vertex, of_corner) = (mesh.vertex().pairs("uv"), mesh.corner().pairs("uv"));
            let uv = match (of_vertex, of_corner) {
                (Some(uv), _) => corners.iter().map(|&vertex| uv[vertex as usize]).collect(),
                (None, Some(uv)) => uv.to_vec(),
                (None, None) => Vec::new(),
            };
            if !uv.is_empty() {
                let single = uv.iter().map(|pair| pair.map(|x| x as f32));
                let (listed, of_corner) = deduplicate(single, |pair| pair.map(f32::to_bits));
                return Self::Texture(listed, of_corner);
            }
        }
        let colors: Vec<Rgb> = match (mesh.vertex().colors("color"), mesh.corner().colors("color"))
        {
            (Some(colors), _) => corners.iter().map(|&vertex| colors[vertex as usize]).collect(),
            (None, Some(colors)) => colors.to_vec(),
            (None, None) => return Self::Plain,
        };
        let (listed, of_corner) = deduplicate(colors.into_iter(), |color| color);
        Self::Colors(listed, of_corner)
    }
}

/// Computes the visible color at each corner of a mesh with materials.
fn corner_colors(mesh: &Mesh) -> Vec<Rgb> {
    let (of_vertex, of_corner) = (mesh.vertex().pairs("uv"), mesh.corner().pairs("uv"));
    let (own_vertex, own_corner) = (mesh.vertex().colors("color"), mesh.corner().colors("color"));
    let mut colors = Vec::with_capacity(mesh.faces().corners().len());
    for (number, face) in mesh.faces().iter().enumerate() {
        let material = mesh.material_of(number);
        for &vertex in face {
            let (vertex, corner) = (vertex as usize, colors.len());
            let uv = of_vertex.map(|uv| uv[vertex]).or(of_corner.map(|uv| uv[corner]));
            let own = own_vertex.map(|own| own[vertex]).or(own_corner.map(|own| own[corner]));
            let picture =
                material.filter(|material| material.non_empty_picture().is_some()).zip(uv);
            colors.push(match picture {
                Some((material, uv)) => material.sample(uv).map(|channel| channel.round() as u8),
                None => own.or(material.map(Material::color)).unwrap_or([255; 3]),
            });
        }
    }
    colors
}

/// Returns the distinct items in the order of first use, and for each item the index of its distinct item.
fn deduplicate<T: Copy, K: std::hash::Hash + Eq>(
    items: impl Iterator<Item = T>,
    key: impl Fn(T) -> K,
) -> (Vec<T>, Vec<u32>) {
    let (mut listed, mut numbers) = (Vec::new(), HashMap::new());
    let numbered = items.map(|item| {
        *numbers.entry(key(item)).or_insert_with(|| {
            listed.push(item);
            listed.len() as u32 - 1
        })
    });
    let numbered = numbered.collect();
    (listed, numbered)
}

fn write_model(
    to: &mut String,
    mesh: &Mesh,
    look: &Appearance,
    low: Point3<f64>,
    high: Point3<f64>,
) -> std::fmt::Result {
    to.push_str(
        r#"<?xml version="1.0" encoding="UTF-8"?>
<model unit="millimeter" xml:lang="en-US" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02">
<metadata name="Application">maquette</metadata>
<resources>
"#,
    );
    let of_corner = match look {
        Appearance::Plain => None,
        Appearance::Colors(colors, of_corner) => {
            to.push_str("<m:colorgroup id=\"2\">\n");
            for [red, green, blue] in colors {
                writeln!(to, "<m:color color=\"#{red:02X}{green:02X}{blue:02X}FF\"/>")?;
            }
            to.push_str("</m:colorgroup>\n");
            Some(of_corner)
        }
        Appearance::Texture(listed, of_corner) => {
            to.push_str("<m:texture2d id=\"3\" path=\"/3D/Textures/texture.png\" contenttype=\"image/png\" tilestyleu=\"clamp\" tilestylev=\"clamp\"/>\n<m:texture2dgroup id=\"2\" texid=\"3\">\n");
            for [u, v] in listed {
                writeln!(to, "<m:tex2coord u=\"{u}\" v=\"{v}\"/>")?;
            }
            to.push_str("</m:texture2dgroup>\n");
            Some(of_corner)
        }
    };
    let default_entry = if of_corner.is_some() { " pid=\"2\" pindex=\"0\"" } else { "" };
    writeln!(to, "<object id=\"1\" type=\"model\"{default_entry}>\n<mesh>\n<vertices>")?;
    for point in mesh.positions().iter() {
        let [x, y, z] = [point.x, point.y, point.z].map(|x| x as f32);
        writeln!(to, "<vertex x=\"{x}\" y=\"{y}\" z=\"{z}\"/>")?;
    }
    to.push_str("</vertices>\n<triangles>\n");
    let vertices = mesh.faces().corners();
    for corners in mesh.triangle_corners() {
        let [a, b, c] = corners.map(|corner| vertices[corner as usize]);
        write!(to, "<triangle v1=\"{a}\" v2=\"{b}\" v3=\"{c}\"")?;
        if let Some(entries) = of_corner {
            let [a, b, c] = corners.map(|corner| entries[corner as usize]);
            write!(to, " pid=\"2\" p1=\"{a}\" p2=\"{b}\" p3=\"{c}\"")?;
        }
        to.push_str("/>\n");
    }
    to.push_str("</triangles>\n</mesh>\n</object>\n</resources>\n<build>\n");
    // First the rotation, then the translation: x stays, y becomes z, and z becomes -y.
    let shift = [-low.x, high.z, -low.y].map(|x| x as f32 + 0.0);
    let [x, y, z] = shift;
    writeln!(to, "<item objectid=\"1\" transform=\"1 0 0 0 0 1 0 -1 0 {x} {y} {z}\"/>")?;
    to.push_str("</build>\n</model>\n");
    Ok(())
}

#[cfg(test)]
pub(crate) mod tests {
    use maquette_value::{Attribute, CaptureFrame, Faces, Image};
    use miniz_oxide::inflate::decompress_to_vec;

    use super::*;
    use crate::hostile;

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

    /// Reads the files of an archive by means of the archive's directory.
    pub(crate) fn files(bytes: &[u8]) -> Vec<(String, Vec<u8>)> {
        fn number(at: usize, size: usize, bytes: &[u8]) -> usize {
            bytes[at..at + size].iter().rev().fold(0, |sum, byte| sum << 8 | usize::from(*byte))
        }
        let end = bytes.len() - 22;
        assert_eq!(&bytes[end..end + 4], b"PK\x05\x06");
        let mut at = number(end + 16, 4, bytes);
        let found = (0..number(end + 10, 2, bytes)).map(|_| {
            assert_eq!(&bytes[at..at + 4], b"PK\x01\x02");
            let (method, packed, name, start) = (
                number(at + 10, 2, bytes),
                number(at + 20, 4, bytes),
                number(at + 28, 2, bytes),
                number(at + 42, 4, bytes),
            );
            assert_eq!(bytes[at + 6..at + 32], bytes[start + 4..start + 30]);
            let text = String::from_utf8(bytes[at + 46..at + 46 + name].to_vec()).unwrap();
            let data = &bytes[start + 30 + name..][..packed];
            let content =
                if method == 8 { decompress_to_vec(data).unwrap() } else { data.to_vec() };
            assert_eq!(crc32fast::hash(&content) as usize, number(at + 16, 4, bytes));
            assert_eq!(content.len(), number(at + 24, 4, bytes));
            at += 46 + name;
            (text, content)
        });
        let found = found.collect();
        assert_eq!(at, end);
        found
    }

    fn model(mesh: &Mesh) -> String {
        let mut files = files(&encode(mesh).unwrap());
        assert_eq!(files[2].0, "3D/3dmodel.model");
        String::from_utf8(files.remove(2).1).unwrap()
    }

    #[test]
    fn a_written_file_is_read_back_as_placed_on_the_plate() {
        let image = Image::new(2, 2, vec![[9; 3]; 4]).unwrap();
        let uv = (0..7).map(|corner| [f64::from(corner) / 8.0, 0.25]);
        let textured = mesh().with_corner("uv", Attribute::Pair(uv.collect())).unwrap();
        let textured = textured.with_texture(Some(image));
        let colors = Attribute::Color((0..5).map(|k| [k, 2, 3]).collect());
        let colored = mesh().with_vertex("color", colors).unwrap();
        for mesh in [mesh(), textured, colored] {
            let (again, notes) = read::read(&encode(&mesh).unwrap()).unwrap();
            assert_eq!(notes, [""; 0]);
            // The written mesh is moved: its minimum coordinates become 0.
            let shift = mesh.positions()[0] - again.positions()[0];
            let moved = again.positions().iter().map(|point| point + shift);
            assert_eq!(moved.collect::<Vec<_>>(), mesh.positions()[..]);
            assert_eq!(again.faces().iter().collect::<Vec<_>>(), [[0, 1, 2], [0, 2, 3], [1, 4, 2]]);
            assert_eq!(again.texture(), mesh.texture());
            assert_eq!(again.vertex().get("color"), mesh.vertex().get("color"));
            let uv = again.corner().pairs("uv").map(|uv| uv[8]);
            assert_eq!(uv, mesh.corner().pairs("uv").map(|uv| uv[6]));
        }
    }

    /// Creates an archive in the form that slicers write: an assembly in another part, a mirrored copy, inches, materials.
    fn assembly(item: &str) -> Vec<u8> {
        let root = format!(
            r##"<model unit="inch" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06" xmlns:b="http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02">
<resources>
<object id="9"><components>
<component objectid="1" p:path="/3D/Objects/part.model"/>
<component objectid="1" p:path="/3D/Objects/part.model" transform="-1 0 0 0 1 0 0 0 1 0 0 2"/>
</components></object>
</resources>
<build>{item}</build>
</model>"##
        );
        let part = r##"<model unit="inch" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">
<resources>
<basematerials id="5"><base name="red" displaycolor="#FF0000"/><base name="blue" displaycolor="#0000FF80"/></basematerials>
<object id="1" pid="5" pindex="1"><mesh>
<vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/><vertex x="0" y="1" z="0"/><vertex x="nan" y="0" z="0"/></vertices>
<triangles><triangle v1="0" v2="1" v3="2"/><triangle v1="0" v2="1" v3="3" p1="0"/></triangles>
<beamlattice/>
</mesh></object>
</resources><build/></model>"##;
        zip::archive(&[
            ("3D/3dmodel.model", root.as_bytes()),
            ("3D/Objects/part.model", part.as_bytes()),
        ])
        .unwrap()
    }

    #[test]
    fn files_of_slicers_are_read() {
        let (mesh, notes) =
            read::read(&assembly(r#"<item objectid="9" transform="1 0 0 0 1 0 0 0 1 3 0 0"/>"#))
                .unwrap();
        // y of the build plate is -z of the mesh; the mirrored copy keeps its faces oriented outwards.
        fn inch(x: f64, y: f64, z: f64) -> Point3<f64> {
            Point3::new(25.4 * x, 25.4 * y, 25.4 * z)
        }
        assert_eq!(mesh.positions()[..3], [inch(3., 0., 0.), inch(4., 0., 0.), inch(3., 0., -1.)]);
        assert_eq!(mesh.positions()[4..7], [inch(3., 2., 0.), inch(2., 2., 0.), inch(3., 2., -1.)]);
        assert_eq!(mesh.faces().iter().collect::<Vec<_>>(), [[0, 1, 2], [4, 6, 5]]);
        assert_eq!(mesh.vertex().colors("color").unwrap()[0], [0, 0, 255]);
        assert!(
            notes[0].starts_with("`beamlattice` of `3D/Objects/part.model` is left out"),
            "{notes:?}"
        );
        assert_eq!(notes[1], "2 faces are left out: a coordinate is NaN or infinite");
        // The first archive has an empty plate, the second one a plate with a missing object.
        assert_eq!(read::read(&assembly("")).unwrap().0.faces().len(), 2);
        let error = read::read(&assembly(r#"<item objectid="8"/>"#)).unwrap_err();
        assert_eq!(error.to_string(), "the file has no triangles");
    }

    #[test]
    fn invalid_files_are_rejected_with_their_position() {
        fn wrong(from: &str, to: &str) -> String {
            let model = r#"<model><resources><object id="1"><mesh><vertices><vertex x="0" y="0" z="0"/></vertices>
<triangles><triangle v1="0" v2="0" v3="0"/></triangles></mesh></object></resources><build><item objectid="1"/></build></model>"#;
            assert!(model.contains(from));
            let model = model.replacen(from, to, 1);
            read::read(&zip::archive(&[("3D/3dmodel.model", model.as_bytes())]).unwrap())
                .unwrap_err()
                .to_string()
        }
        assert_eq!(
            wrong("v3=\"0\"", "v3=\"7\""),
            "`3D/3dmodel.model`, line 2: a triangle refers to vertex 7, but there are only 1 vertices"
        );
        assert_eq!(wrong("v3=\"0\"", ""), "`3D/3dmodel.model`, line 2: `triangle` has no `v3`");
        assert_eq!(
            wrong("<model>", "<model unit=\"mile\">"),
            "`3D/3dmodel.model`, line 1: unknown unit `mile`"
        );
        assert!(wrong("</build>", "").starts_with("`3D/3dmodel.model`, line 2: "));
        let nested = r#"</mesh></object><object id="1"><components><component objectid="1"/></components></object>"#;
        assert_eq!(
            wrong("</mesh></object>", nested),
            "object 1 is a component of itself, or nested more than 64 levels deep"
        );
        let namespaces = "<model xmlns:a='b'>".repeat(300);
        assert!(wrong("<model>", &namespaces).ends_with("it declares more than 256 namespaces"));
        assert_eq!(
            read::read(b"PK").unwrap_err().to_string(),
            "a 3MF file is a ZIP archive, but this file is not one, or is truncated"
        );
    }

    #[test]
    fn hostile_files_give_errors() {
        let file = encode(&mesh()).unwrap();
        hostile::check_no_panic(&file, |bytes| read::read(bytes).is_ok());
        hostile::check_no_panic(&assembly(r#"<item objectid="9"/>"#), |bytes| {
            read::read(bytes).is_ok()
        });
    }

    #[test]
    fn a_mesh_is_placed_on_the_plate_in_millimeters() {
        let text = model(&mesh());
        for part in [
            "<model unit=\"millimeter\"",
            "<vertex x=\"2\" y=\"0\" z=\"0.25\"/>",
            "<triangle v1=\"0\" v2=\"1\" v3=\"2\"/>\n<triangle v1=\"0\" v2=\"2\" v3=\"3\"/>\n<triangle v1=\"1\" v2=\"4\" v3=\"2\"/>",
            "<item objectid=\"1\" transform=\"1 0 0 0 0 1 0 -1 0 0 0.25 0\"/>",
        ] {
            assert!(text.contains(part), "{part}");
        }
        let names = files(&encode(&mesh()).unwrap());
        let names: Vec<_> = names.iter().map(|(name, _)| &name[..]).collect();
        assert_eq!(names, ["[Content_Types].xml", "_rels/.rels", "3D/3dmodel.model"]);
        assert_eq!(encode(&mesh()).unwrap(), encode(&mesh()).unwrap());
    }

    #[test]
    fn each_color_is_listed_once() {
        let colors = [[255, 0, 128], [0; 3], [255, 0, 128], [0; 3], [0; 3]];
        let text =
            model(&mesh().with_vertex("color", Attribute::Color(colors.to_vec().into())).unwrap());
        assert!(text.contains(
            "<m:color color=\"#FF0080FF\"/>\n<m:color color=\"#000000FF\"/>\n</m:colorgroup>"
        ));
        assert!(text.contains(
            "<triangle v1=\"0\" v2=\"2\" v3=\"3\" pid=\"2\" p1=\"0\" p2=\"0\" p3=\"1\"/>"
        ));
    }

    #[test]
    fn a_texture_is_written_instead_of_colors() {
        let image = Image::new(2, 2, vec![[9; 3]; 4]).unwrap();
        let uv = (0..7).map(|corner| [f64::from(corner / 2) / 8.0, 0.25]);
        let mesh = mesh().with_corner("uv", Attribute::Pair(uv.collect())).unwrap();
        let mesh = mesh.with_texture(Some(image.clone()));
        let mesh = mesh.with_vertex("color", Attribute::Color(vec![[1; 3]; 5].into())).unwrap();
        let found = files(&encode(&mesh).unwrap());
        let text = String::from_utf8(found[2].1.clone()).unwrap();
        assert!(
            text.contains("<m:tex2coord u=\"0.125\" v=\"0.25\"/>") && !text.contains("m:color ")
        );
        assert!(text.contains(
            "<triangle v1=\"1\" v2=\"4\" v3=\"2\" pid=\"2\" p1=\"2\" p2=\"2\" p3=\"3\"/>"
        ));
        assert_eq!(found[4].0, "3D/Textures/texture.png");
        assert_eq!(png::read(&found[4].1).unwrap(), image);
        // Without texture coordinates the picture is ignored.
        assert!(model(&mesh.without_attribute("uv")).contains("m:color "));
    }

    #[test]
    fn a_capture_is_rotated_upright() {
        let frame =
            CaptureFrame { camera: None, picture: [2, 2], depth: 700.0, world_from_camera: None };
        let written = MeshThreeMf::write(&mesh().with_frame(Some(frame)), "a.3mf").unwrap();
        let files = files(&written[0].bytes);
        assert!(
            String::from_utf8_lossy(&files[2].1).contains("<vertex x=\"1\" y=\"-1\" z=\"-0.25\"/>")
        );
    }

    #[test]
    fn meshes_that_3mf_cannot_store_are_rejected() {
        let empty = Mesh::new(vec![Point3::origin()], Faces::triangles(vec![])).unwrap();
        let text = "a mesh without faces cannot be written as 3MF";
        assert_eq!(encode(&empty).unwrap_err().to_string(), text);
        let far = vec![Point3::origin(), Point3::new(1., 0., 0.), Point3::new(0., -1e39, 0.)];
        let far = Mesh::new(far, Faces::triangles(vec![[0, 1, 2]])).unwrap();
        assert!(
            encode(&far).unwrap_err().to_string().starts_with("vertex 2 is at (0e0, -1e39, 0e0)")
        );
    }
}
