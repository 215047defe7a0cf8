//! Writes the materials of a mesh as MTL.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use maquette_node::pack::NewFile;
use maquette_syntax::error::Error;
use maquette_value::{Column, Map, MapKind, Material, Mesh, Transparency, Wrap};

use crate::glb::{is_extension, vertex_colors_equal_material};
use crate::picture_kind::Kind;
use crate::png;

/// The text of an MTL file, and the picture files to which it refers.
pub(super) struct MaterialWriter {
    /// The names of the materials, made unique.
    pub(super) names: Vec<String>,
    pub(super) text: String,
    pub(super) pictures: Vec<NewFile>,
}

impl MaterialWriter {
    /// Writes the materials of a mesh. The names of picture files begin with `stem`.
    pub(super) fn new(mesh: &Mesh, stem: &str) -> Result<Self, Error> {
        let mut writer = Self { names: Vec::new(), text: String::new(), pictures: Vec::new() };
        if let [only] = &mesh.materials()[..]
            && only.is_plain()
            && let Some(picture) = &only.picture
        {
            let name = format!("{stem}.png");
            writer.text =
                format!("newmtl material\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {name}\n");
            writer.names.push("material".to_owned());
            writer.pictures.push(NewFile { name, bytes: png::encode_rgb(picture)? });
            return Ok(writer);
        }
        let has_one = mesh.materials().len() == 1;
        let mut files = Files { stem, has_one, written: Vec::new() };
        for material in mesh.materials().iter() {
            let name = unique(&material.name, "material", &writer.names);
            writer.names.push(name);
            writer.add(material, &mut files)?;
        }
        Ok(writer)
    }

    fn add(&mut self, material: &Material, files: &mut Files<'_>) -> Result<(), Error> {
        let text = &mut self.text;
        let name = self.names.last().map_or("", |name| name);
        let mut line = |keyword: &str, words: &str| {
            writeln!(text, "{keyword} {words}").expect("a text takes all");
        };
        line("newmtl", name);
        for (keyword, words) in material.others.iter().filter(|(name, _)| !is_extension(name)) {
            line(keyword, words);
        }
        fn numbers(numbers: &[f64]) -> String {
            numbers.iter().map(|number| number.to_string()).collect::<Vec<_>>().join(" ")
        }
        let [red, green, blue, opacity] = material.base_color;
        // Most programs ignore a color beside a picture, so the picture is written with the color multiplied into it.
        let is_multiplied = material.picture.is_some() && [red, green, blue] != [1.0; 3];
        if !material.others.contains_key("Kd") {
            line("Kd", &numbers(&if is_multiplied { [1.0; 3] } else { [red, green, blue] }));
        }
        if opacity != 1.0 {
            line("d", &numbers(&[opacity]));
        }
        if material.emissive != [0.0; 3] {
            line("Ke", &numbers(&material.emissive));
        }
        line("Pr", &numbers(&[material.roughness]));
        line("Pm", &numbers(&[material.metallic]));
        let base = material.maps.get(&MapKind::BaseColor);
        let base = match (&material.picture, base) {
            (Some(picture), base) if is_multiplied || base.is_none() => {
                let file = base.map_or("color.png".to_owned(), |map| format!("{}.png", map.file));
                let made = Map::new(file, png::encode_rgb(picture)?);
                let wrap = base.map_or([Wrap::Clamp; 2], |map| map.wrap);
                Some((files.add(&made, &mut self.pictures), Map { wrap, ..made }))
            }
            (_, base) => base.map(|map| (files.add(map, &mut self.pictures), map.clone())),
        };
        if let Some((file, map)) = base {
            line("map_Kd", &with_options(&map, &file));
            if material.transparency != Transparency::Opaque {
                line("map_d", &with_options(&map, &file));
            }
        }
        for (kind, map) in material.maps.iter().filter(|(_, map)| map.uv == "uv") {
            let keywords = match kind {
                MapKind::BaseColor => continue,
                MapKind::Emissive => &["map_Ke"][..],
                MapKind::Metallic => &["map_Pm"],
                // Write both keywords: some programs know only the first, others only the second.
                MapKind::Normal => &["norm", "map_Bump"],
                MapKind::Occlusion => &["map_ao"],
                MapKind::Roughness => &["map_Pr"],
                MapKind::Other(keyword) => &[&keyword[..]],
            };
            let file = files.add(map, &mut self.pictures);
            keywords.iter().for_each(|keyword| line(keyword, &with_options(map, &file)));
        }
        Ok(())
    }
}

/// The picture files that have been written, each once.
struct Files<'a> {
    stem: &'a str,
    /// True if the mesh has only one material, whose color picture then gets the name of the mesh.
    has_one: bool,
    written: Vec<(Column<u8>, String)>,
}

impl Files<'_> {
    /// Adds the picture file of a map unless it has been added before. Returns the name of the file.
    fn add(&mut self, map: &Map, pictures: &mut Vec<NewFile>) -> String {
        let known = self.written.iter().find(|(bytes, _)| bytes.hash() == map.bytes.hash());
        if let Some((_, name)) = known {
            return name.clone();
        }
        let names: Vec<_> = self.written.iter().map(|(_, name)| name.clone()).collect();
        if self.has_one && pictures.is_empty() {
            let name = format!("{}.{}", self.stem, extension(map));
            return self.write(name, map, pictures);
        }
        // The file from which the picture was read may be in the same folder; it must not be overwritten.
        let own = unique(&map.file, "picture", &[]);
        let own = own.strip_prefix(self.stem).map_or(&*own, |own| own.trim_start_matches('_'));
        let (start, extension) = own.rsplit_once('.').unwrap_or((own, extension(map)));
        let mut name = format!("{}_{start}.{extension}", self.stem);
        let mut count = 1;
        while names.contains(&name) {
            count += 1;
            name = format!("{}_{start}_{count}.{extension}", self.stem);
        }
        self.write(name, map, pictures)
    }

    fn write(&mut self, name: String, map: &Map, pictures: &mut Vec<NewFile>) -> String {
        pictures.push(NewFile { name: name.clone(), bytes: map.bytes.to_vec() });
        self.written.push((map.bytes.clone(), name.clone()));
        name
    }
}

/// Returns the file extension for the picture of a map, without the dot.
fn extension(map: &Map) -> &'static str {
    Kind::detect(&map.bytes).unwrap_or(Kind::Png).extension()
}

/// Converts `name` to a single word that is not among `others`. It is based on `instead` if nothing of `name` can be used.
fn unique(name: &str, instead: &str, others: &[String]) -> String {
    let name = name.trim().replace(
        |letter: char| {
            letter.is_whitespace() || letter.is_control() || "#%?/\\:*<>|\"".contains(letter)
        },
        "_",
    );
    let name = name.trim_start_matches(['.', '-']);
    let name = if name.is_empty() { instead } else { name };
    let numbered = (2..).map(|count| format!("{name}_{count}"));
    let mut names = std::iter::once(name.to_owned()).chain(numbered);
    names.find(|name| !others.contains(name)).expect("there is always another number")
}

/// Formats the options of a map, followed by the file name of its picture.
fn with_options(map: &Map, file: &str) -> String {
    let mut words = String::new();
    if map.strength != 1.0 {
        write!(words, "-bm {} ", map.strength).expect("a text takes all");
    }
    if map.wrap == [Wrap::Clamp; 2] {
        words.push_str("-clamp on ");
    }
    if let Some(channel) = map.channel {
        write!(words, "-imfchan {} ", ["r", "g", "b"][usize::from(channel.min(2))])
            .expect("a text takes all");
    }
    words + file
}

/// Returns true if some face shows vertex colors: its material has no picture, and the vertex colors differ from the color of the material.
pub(super) fn shows_colors(mesh: &Mesh) -> bool {
    let materials = mesh.materials();
    materials.is_empty()
        || used_materials(mesh).into_iter().any(|number| {
            let material = &materials[number as usize];
            material.picture.is_none()
                && (material.is_plain() || !vertex_colors_equal_material(mesh, number))
        })
}

/// Returns the indices of the materials that are used by faces.
fn used_materials(mesh: &Mesh) -> BTreeSet<u32> {
    match mesh.face_materials() {
        Some(numbers) => numbers.iter().map(|&number| mesh.resolve_material(number)).collect(),
        None => BTreeSet::from([0]),
    }
}

/// Removes materials that no face uses. If one material remains, the face attribute is removed, too.
pub(super) fn without_unused(mesh: Mesh) -> Mesh {
    let used = used_materials(&mesh);
    let Some(numbers) = mesh.face_materials() else { return mesh };
    let new_numbers: BTreeMap<u32, u32> = used.iter().copied().zip(0..).collect();
    let numbers =
        numbers.iter().map(|&number| new_numbers[&mesh.resolve_material(number)]).collect();
    let kept = used.iter().map(|&number| mesh.materials()[number as usize].clone());
    let kept: Vec<_> = kept.collect();
    let numbered = mesh
        .clone()
        .with_face(maquette_value::MATERIAL_ATTRIBUTE, maquette_value::Attribute::Index(numbers));
    numbered.expect("a number for each face").with_materials(kept)
}

/// Returns warnings about properties of materials that MTL cannot store.
pub(super) fn warnings(mesh: &Mesh) -> Vec<String> {
    let materials = mesh.materials();
    let has_other_uv =
        materials.iter().any(|material| material.maps.values().any(|map| map.uv != "uv"));
    let is_mixed = materials.iter().any(|material| material.has_vertex_colors);
    let has_cutoff = materials.iter().any(|it| matches!(it.transparency, Transparency::Cutoff(_)));
    [
        (has_other_uv, "pictures with other texture coordinates than `uv` are left out: an OBJ file has only one set"),
        (is_mixed, "pictures are written without the vertex colors that multiply them"),
        (has_cutoff, "opacity is written without its cutoff"),
    ]
    .into_iter()
    .filter(|(is_so, _)| *is_so)
    .map(|(_, text)| text.to_owned())
    .collect()
}
