//! Exchanges values with a host as files of plain numbers: writes values to such files, and reads values from them.

use std::borrow::Cow;
use std::collections::{BTreeSet, VecDeque};
use std::path::Path;

use maquette_engine::writing::ExchangeFolder;
use maquette_graph::catalog::Catalog;
use maquette_render::{Look, picture};
use maquette_value::fs;
use maquette_value::{
    AnyValue, Attribute, Axes, Cloud, ElementKind, FactValue, Hash, Image, Items, Layer, Material,
    Meaning, Mesh, Part, Parts, Points, RangeImage, Value, ValueType,
};
use serde_json::{Map, Value as Json, json};

use super::materials::{MaterialMessage, with_materials};
use super::request::{Form, Input, Numbers};

/// The files that the host may read. A file is named by the hash of its content, so equal columns share one file.
pub(super) struct Columns {
    folder: ExchangeFolder,
    files: BTreeSet<String>,
    /// For each slot, the names of the files that its last answers contain. A slot is a series of runs that replace each other. The slot
    /// with the newest answer is the last in this list.
    recent_answers: VecDeque<(String, VecDeque<BTreeSet<String>>)>,
    /// Cached descriptions of files that take long to create: the edges of faces, and pictures. The text identifies the value from which
    /// the files were made.
    descriptions: VecDeque<(String, Vec<Json>)>,
    /// The names of the files in the answer that is being created.
    current_names: BTreeSet<String>,
}

/// The files of this number of the latest answers per slot are not removed.
const MAX_ANSWERS: usize = 2;

/// The maximum number of slots whose files are not removed.
const MAX_SLOTS: usize = 256;

/// The maximum number of cached descriptions.
const MAX_DESCRIPTIONS: usize = 64;

impl Columns {
    pub(super) fn new(folder: ExchangeFolder) -> Self {
        Self {
            folder,
            files: BTreeSet::new(),
            recent_answers: VecDeque::new(),
            descriptions: VecDeque::new(),
            current_names: BTreeSet::new(),
        }
    }

    /// Returns the folder that contains the files.
    pub(super) fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Writes the files of a value, and returns its description for the answer.
    pub(super) fn value(
        &mut self,
        value: &AnyValue,
        form: Form,
        catalog: &Catalog,
    ) -> Result<Json, String> {
        let mut answer = json!({ "type": value.kind().name, "hash": value.hash().to_string() });
        match form {
            Form::Facts => answer["facts"] = facts_json(&value.parts()),
            Form::Parts => {
                let parts = value.parts();
                answer["facts"] = facts_json(&parts);
                answer["row"] = parts.row.into();
                answer["columns"] = self.columns(&parts.columns, false)?.into();
            }
            Form::Mesh => self.mesh(value, &mut answer, catalog)?,
            Form::Picture => {
                let image = picture(&value.show(), &Look::front());
                let image = image.ok_or("the value has no picture")?;
                answer["picture"] = self.picture(image, catalog)?;
            }
        }
        Ok(answer)
    }

    /// Ends an answer. Removes the files whose names are in none of the last answers.
    pub(super) fn finish_answer(&mut self, slot: &str) {
        let index = self.recent_answers.iter().position(|(known, _)| known == slot);
        let known = index.and_then(|index| self.recent_answers.remove(index));
        let (slot, mut answers) = known.unwrap_or_else(|| (slot.to_owned(), VecDeque::new()));
        answers.push_back(std::mem::take(&mut self.current_names));
        if answers.len() > MAX_ANSWERS {
            answers.pop_front();
        }
        self.recent_answers.push_back((slot, answers));
        if self.recent_answers.len() > MAX_SLOTS {
            self.recent_answers.pop_front();
        }
        let answers = self.recent_answers.iter().flat_map(|(_, answers)| answers).flatten();
        let needed: BTreeSet<&String> = answers.collect();
        let unused = self.files.iter().filter(|name| !needed.contains(name));
        for name in unused.cloned().collect::<Vec<_>>() {
            self.folder.drop_file(&name);
            self.files.remove(&name);
        }
        let held = &self.files;
        self.descriptions.retain(|(_, files)| {
            files.iter().all(|file| file["file"].as_str().is_some_and(|it| held.contains(it)))
        });
    }

    /// Writes bytes to a file with the extension `ending`, unless that file exists. Returns the name of the file.
    fn keep(&mut self, bytes: &[u8], ending: &str) -> Result<String, String> {
        let name = format!("{}.{ending}", Hash::compute(bytes));
        if !self.files.contains(&name) {
            self.folder.put(&name, bytes).map_err(|error| {
                format!("{}: {error}", self.folder.path().join(&name).display())
            })?;
            self.files.insert(name.clone());
        }
        self.current_names.insert(name.clone());
        Ok(name)
    }

    fn columns(&mut self, parts: &[Part<'_>], single: bool) -> Result<Vec<Json>, String> {
        parts.iter().map(|part| self.column(part, single)).collect()
    }

    fn column(&mut self, part: &Part<'_>, single: bool) -> Result<Json, String> {
        let (bytes, numbers): (Cow<'_, [u8]>, _) = match &part.items {
            Items::F64(items) if single => {
                let items: Vec<_> = items.iter().map(|&x| x as f32).collect();
                (bytemuck::cast_slice(&items).to_vec().into(), "f32")
            }
            Items::F64(items) => (bytemuck::cast_slice(items).into(), "f64"),
            Items::F32(items) => (bytemuck::cast_slice(items).into(), "f32"),
            Items::U32(items) => (bytemuck::cast_slice(items).into(), "u32"),
            Items::U8(items) => (items[..].into(), "u8"),
        };
        let file = self.keep(&bytes, numbers)?;
        Ok(json!({
            "name": part.name,
            "on": part.element_kind.word(),
            "meaning": part.meaning.word(),
            "width": part.width,
            "type": numbers,
            "count": part.count(),
            "file": file,
        }))
    }

    fn picture(&mut self, image: Image, catalog: &Catalog) -> Result<Json, String> {
        let size = [image.width(), image.height()];
        let image = AnyValue::new(image);
        let source = format!("picture {}", image.hash());
        if let Some(known) = self.find_description(&source) {
            return Ok(known[0].clone());
        }
        let files = catalog.write(&image, "picture.png").map_err(|error| error.to_string())?;
        let file = files.first().ok_or("no picture file was written")?;
        let answer = json!({ "file": self.keep(&file.bytes, "png")?, "size": size });
        self.store_description(source, vec![answer.clone()]);
        Ok(answer)
    }

    /// Returns the cached descriptions of the files that were made from `source`. Also adds these files to the current answer, so that they
    /// are not removed.
    fn find_description(&mut self, source: &str) -> Option<Vec<Json>> {
        let (_, files) = self.descriptions.iter().find(|(known, _)| known == source)?;
        let names = files.iter().filter_map(|file| file["file"].as_str());
        self.current_names.extend(names.map(str::to_owned));
        Some(files.clone())
    }

    fn store_description(&mut self, source: String, files: Vec<Json>) {
        self.descriptions.push_back((source, files));
        if self.descriptions.len() > MAX_DESCRIPTIONS {
            self.descriptions.pop_front();
        }
    }

    /// Adds the vertices, edges and faces of a value to an answer.
    fn mesh(
        &mut self,
        value: &AnyValue,
        answer: &mut Json,
        catalog: &Catalog,
    ) -> Result<(), String> {
        if let Some(mesh) = value.get::<Mesh>() {
            return self.faces(mesh, answer, catalog);
        }
        if let Some(mesh) = value.as_mesh() {
            return self.faces(&mesh, answer, catalog);
        }
        let layers = layers(value);
        let axes =
            layers.iter().find_map(Layer::axes).ok_or("the value has no position in space")?;
        let (mut positions, mut edges) = (Vec::new(), Vec::new());
        for layer in &layers {
            let first = positions.len() as u32;
            match layer {
                Layer::Points(cloud) => positions.extend(cloud.points.positions().iter().copied()),
                Layer::Lines(lines) => {
                    positions.extend(lines.points.iter().copied());
                    let sides = lines.chains.iter().flat_map(|chain| chain.windows(2));
                    edges.extend(sides.flat_map(|side| [first + side[0], first + side[1]]));
                }
                Layer::Arrows(arrows) => {
                    let moves = arrows.from.iter().zip(arrows.to.iter());
                    for (from, to) in moves {
                        let start = positions.len() as u32;
                        positions.extend([*from, *to]);
                        edges.extend([start, start + 1]);
                    }
                }
                Layer::Triangles(_) | Layer::Picture(_) | Layer::Plot(_) | Layer::Marks(_) => {}
            }
        }
        let mut parts = Parts::default();
        parts.push("position", ElementKind::Vertex, Meaning::Position, 3, &positions[..]);
        parts.push("edges", ElementKind::Edge, Meaning::Index, 2, edges);
        if let [Layer::Points(cloud)] = &layers[..] {
            let own = cloud.points.parts().columns.into_iter();
            let own = own
                .filter(|part| part.element_kind == ElementKind::Point && part.name != "position");
            parts
                .columns
                .extend(own.map(|part| Part { element_kind: ElementKind::Vertex, ..part }));
        }
        answer["axes"] = axes_word(axes).into();
        answer["sides"] = Json::Null;
        answer["columns"] = self.columns(&parts.columns, true)?.into();
        Ok(())
    }

    fn faces(&mut self, mesh: &Mesh, answer: &mut Json, catalog: &Catalog) -> Result<(), String> {
        let axes = if mesh.frame().is_some() { Axes::Sensor } else { Axes::Upright };
        answer["axes"] = axes_word(axes).into();
        answer["sides"] = mesh.faces().sides().into();
        let corners = &mesh.faces().corners()[..];
        let mut parts = mesh.parts();
        for part in &mut parts.columns {
            if part.name == "corners" {
                (part.element_kind, part.width) = (ElementKind::Corner, 1);
            }
            let of = format!("{} ", part.element_kind.word());
            if let Some(name) = part.name.strip_prefix(&of) {
                part.name = name.to_owned().into();
            }
        }
        parts
            .columns
            .retain(|part| !matches!(part.element_kind, ElementKind::Texel | ElementKind::Whole));
        // Hosts expect a texture coordinate for each corner, even if the value has one for each vertex.
        let uv = parts
            .columns
            .iter()
            .position(|it| it.element_kind == ElementKind::Vertex && it.name == "uv");
        if let Some(Part { items: Items::F64(items), .. }) = uv.map(|uv| parts.columns.remove(uv)) {
            let items: Vec<_> = corners
                .iter()
                .flat_map(|&corner| {
                    let index = 2 * corner as usize;
                    [items[index], items[index + 1]]
                })
                .collect();
            parts.push("uv", ElementKind::Corner, Meaning::Number, 2, items);
        }
        let mut columns = self.columns(&parts.columns, true)?;
        let files = columns
            .iter()
            .filter(|column| column["name"] == "corners" || column["name"] == "sides")
            .map(|column| column["file"].to_string());
        let faces = format!("{:?} {}", mesh.faces().sides(), Vec::from_iter(files).join(" "));
        columns.extend(self.edges(mesh, faces)?);
        answer["columns"] = columns.into();
        if let Some(texture) = mesh.texture() {
            answer["texture"] = self.picture(texture.clone(), catalog)?;
        }
        let materials = mesh.materials();
        if materials.len() > 1 || !materials.iter().all(Material::is_plain) {
            let materials = materials.iter().map(|material| self.material(material, catalog));
            answer["materials"] = materials.collect::<Result<Vec<Json>, String>>()?.into();
        }
        Ok(())
    }

    fn material(&mut self, material: &Material, catalog: &Catalog) -> Result<Json, String> {
        let message =
            MaterialMessage::new(material, |bytes, extension| self.keep(bytes, extension))?;
        let mut answer = json!(message);
        if let Some(picture) = material.non_empty_picture() {
            answer["picture"] = self.picture(picture.clone(), catalog)?;
        }
        Ok(answer)
    }

    /// Writes two columns: the two vertices of each edge, and for each corner the edge that begins there. Returns their descriptions.
    fn edges(&mut self, mesh: &Mesh, faces: String) -> Result<Vec<Json>, String> {
        if let Some(known) = self.find_description(&faces) {
            return Ok(known);
        }
        let edges = mesh.edges();
        let mut parts = Parts::default();
        parts.push("edges", ElementKind::Edge, Meaning::Index, 2, edges.vertices.into_flattened());
        parts.push("edge of a corner", ElementKind::Corner, Meaning::Index, 1, edges.of_corner);
        let [ends, of_corner] = &parts.columns[..] else { return Err("no edges".into()) };
        let columns = vec![self.column(ends, true)?, self.column(of_corner, true)?];
        self.store_description(faces, columns.clone());
        Ok(columns)
    }

    /// Reads a value of the type `kind` from the files that a host has written.
    pub(super) fn read(&self, input: &Input, kind: &ValueType) -> Result<AnyValue, String> {
        let read = |file: &str| {
            let path = self.folder.path_of(file)?;
            fs::read_no_follow(&path).map_err(|error| format!("{file}: {error}"))
        };
        let contents = input.columns.iter().map(|column| read(&column.file));
        let contents = contents.collect::<Result<Vec<_>, String>>()?;
        let mut parts = Parts { row: input.row, ..Parts::default() };
        for (column, bytes) in input.columns.iter().zip(&contents) {
            let on = ElementKind::from_word(&column.on)?;
            let meaning = Meaning::from_word(&column.meaning)?;
            let items = decode_items(column.numbers, bytes).ok_or_else(|| {
                format!(
                    "{}: {} bytes are not a multiple of the size of its type",
                    column.file,
                    bytes.len()
                )
            })?;
            if column.width == 0 {
                return Err(format!("the column `{}` has a width of 0", column.name));
            }
            parts.push(&column.name[..], on, meaning, column.width, items);
        }
        for (name, fact) in &input.facts {
            parts.fact(name.clone(), parse_fact(name, fact)?);
        }
        let value = kind.from_parts(&parts).map_err(|error| error.to_string())?;
        if input.materials.is_empty() {
            return Ok(value);
        }
        let mesh = value.get::<Mesh>();
        let mesh = mesh.ok_or_else(|| format!("a {} has no materials", kind.name))?;
        Ok(AnyValue::new(with_materials(mesh, &input.materials, read)?))
    }
}

/// Returns the layers with which a value is drawn in 3D space. A range image is drawn as points.
fn layers(value: &AnyValue) -> Vec<Layer> {
    let Some(range) = value.get::<RangeImage>() else { return value.show() };
    let cells: Vec<_> =
        (0..range.points().len()).filter(|cell| range.point(*cell).is_some()).collect();
    let positions: Vec<_> = cells.iter().map(|&cell| range.points()[cell]).collect();
    let points = Points::new(positions).and_then(|points| match range.colors() {
        Some(colors) => {
            let colors: Vec<_> = cells.iter().map(|&cell| colors[cell]).collect();
            points.with_attribute("color", Attribute::Color(colors.into()))
        }
        None => Ok(points),
    });
    points.map(|points| Layer::Points(Cloud { points, axes: Axes::Sensor })).into_iter().collect()
}

fn axes_word(axes: Axes) -> &'static str {
    match axes {
        Axes::Upright => "upright",
        Axes::Sensor => "sensor",
    }
}

fn facts_json(parts: &Parts<'_>) -> Json {
    fn fact(fact: &FactValue) -> Json {
        match fact {
            FactValue::Count(count) => json!(count),
            FactValue::Size(size) => json!(size),
            FactValue::Flag(flag) => json!(flag),
            FactValue::Text(text) => json!(text),
        }
    }
    let facts = parts.facts.iter().map(|it| (it.name.to_string(), fact(&it.value)));
    Json::Object(Map::from_iter(facts))
}

fn parse_fact(name: &str, fact: &Json) -> Result<FactValue, String> {
    fn count(number: &Json) -> Option<usize> {
        usize::try_from(number.as_u64()?).ok()
    }
    let found = match fact {
        Json::Bool(flag) => Some((*flag).into()),
        Json::Number(_) => count(fact).map(FactValue::Count),
        Json::String(text) => Some(text.clone().into()),
        Json::Array(sizes) => match &sizes[..] {
            [a, b] => count(a).zip(count(b)).map(|(a, b)| [a, b].into()),
            _ => None,
        },
        Json::Null | Json::Object(_) => None,
    };
    found.ok_or_else(|| {
        format!(
            "expected a count, two counts, true or false, or a text as fact `{name}`, found {fact}"
        )
    })
}

/// Decodes little-endian numbers. Returns `None` if the last number is incomplete.
fn decode_items(numbers: Numbers, bytes: &[u8]) -> Option<Items<'_>> {
    fn decode<const N: usize, T>(bytes: &[u8], number: fn([u8; N]) -> T) -> Option<Vec<T>> {
        let (whole, rest) = bytes.as_chunks::<N>();
        rest.is_empty().then(|| whole.iter().map(|&bytes| number(bytes)).collect())
    }
    Some(match numbers {
        Numbers::F64 => decode(bytes, f64::from_le_bytes)?.into(),
        Numbers::F32 => Items::F32(decode(bytes, f32::from_le_bytes)?.into()),
        Numbers::U32 => decode(bytes, u32::from_le_bytes)?.into(),
        Numbers::U8 => bytes.into(),
    })
}
