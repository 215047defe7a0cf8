//! Values as files of plain numbers, and such files as values.

use std::borrow::Cow;
use std::collections::{BTreeSet, VecDeque};
use std::path::Path;

use maquette_engine::writing::Shelf;
use maquette_graph::catalog::Catalog;
use maquette_render::{Look, picture};
use maquette_value::plain;
use maquette_value::{
    AnyValue, Attribute, Axes, Cloud, FactValue, Hash, Image, Items, Layer, Material, Meaning,
    Mesh, On, Part, Parts, Points, RangeImage, Value, ValueType,
};
use serde_json::{Map, Value as Json, json};

use super::materials::{MaterialMessage, with_materials};
use super::request::{Form, Input, Numbers};

/// The files that a host may read: each is named by what is in it, so that the same numbers keep their file.
pub(super) struct Columns {
    shelf: Shelf,
    held: BTreeSet<String>,
    /// What the last answers of each slot named; the slot that was answered last is the last.
    last: VecDeque<(String, VecDeque<BTreeSet<String>>)>,
    /// Cached descriptions of files that take long to make, by their source: edges of faces, and pictures.
    descriptions: VecDeque<(String, Vec<Json>)>,
    /// What the answer that is being made names.
    named: BTreeSet<String>,
}

/// So many answers of a slot keep their files.
const ANSWERS: usize = 2;

/// So many slots do: those that were answered last.
const SLOTS: usize = 256;

/// Number of cached descriptions.
const MAX_DESCRIPTIONS: usize = 64;

impl Columns {
    pub(super) fn new(shelf: Shelf) -> Self {
        let (held, last, descriptions, named) = Default::default();
        Self { shelf, held, last, descriptions, named }
    }

    /// Where the files are.
    pub(super) fn folder(&self) -> &Path {
        self.shelf.path()
    }

    /// What an answer says of a value.
    pub(super) fn value(
        &mut self,
        value: &AnyValue,
        form: Form,
        catalog: &Catalog,
    ) -> Result<Json, String> {
        let mut told = json!({ "type": value.kind().name, "hash": value.hash().to_string() });
        match form {
            Form::Facts => told["facts"] = facts(&value.parts()),
            Form::Parts => {
                let parts = value.parts();
                told["facts"] = facts(&parts);
                told["row"] = parts.row.into();
                told["columns"] = self.columns(&parts.columns, false)?.into();
            }
            Form::Mesh => self.mesh(value, &mut told, catalog)?,
            Form::Picture => {
                let image = picture(&value.show(), &Look::own());
                let image = image.ok_or("it has no picture")?;
                told["picture"] = self.picture(image, catalog)?;
            }
        }
        Ok(told)
    }

    /// The answer is whole: files that only older ones named go.
    pub(super) fn answered(&mut self, slot: &str) {
        let place = self.last.iter().position(|(known, _)| known == slot);
        let known = place.and_then(|place| self.last.remove(place));
        let (slot, mut answers) = known.unwrap_or_else(|| (slot.to_owned(), VecDeque::new()));
        answers.push_back(std::mem::take(&mut self.named));
        if answers.len() > ANSWERS {
            answers.pop_front();
        }
        self.last.push_back((slot, answers));
        if self.last.len() > SLOTS {
            self.last.pop_front();
        }
        let answers = self.last.iter().flat_map(|(_, answers)| answers).flatten();
        let needed: BTreeSet<&String> = answers.collect();
        let gone = self.held.iter().filter(|name| !needed.contains(name));
        for name in gone.cloned().collect::<Vec<_>>() {
            self.shelf.drop_file(&name);
            self.held.remove(&name);
        }
        let held = &self.held;
        self.descriptions.retain(|(_, files)| {
            files.iter().all(|file| file["file"].as_str().is_some_and(|it| held.contains(it)))
        });
    }

    /// Puts bytes into a file, if it is not there; gives its name.
    fn keep(&mut self, bytes: &[u8], ending: &str) -> Result<String, String> {
        let name = format!("{}.{ending}", Hash::of(bytes));
        if !self.held.contains(&name) {
            self.shelf
                .put(&name, bytes)
                .map_err(|error| format!("{}: {error}", self.shelf.path().join(&name).display()))?;
            self.held.insert(name.clone());
        }
        self.named.insert(name.clone());
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
            "on": part.on.word(),
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
        if let Some(known) = self.cached(&source) {
            return Ok(known[0].clone());
        }
        let files = catalog.write(&image, "picture.png").map_err(|error| error.to_string())?;
        let file = files.first().ok_or("the picture gives no file")?;
        let told = json!({ "file": self.keep(&file.bytes, "png")?, "size": size });
        self.cache(source, vec![told.clone()]);
        Ok(told)
    }

    /// Returns the cached descriptions of files, and keeps these files for the current answer.
    fn cached(&mut self, source: &str) -> Option<Vec<Json>> {
        let (_, files) = self.descriptions.iter().find(|(known, _)| known == source)?;
        let names = files.iter().filter_map(|file| file["file"].as_str());
        self.named.extend(names.map(str::to_owned));
        Some(files.clone())
    }

    fn cache(&mut self, source: String, files: Vec<Json>) {
        self.descriptions.push_back((source, files));
        if self.descriptions.len() > MAX_DESCRIPTIONS {
            self.descriptions.pop_front();
        }
    }

    /// A value as vertices, edges and faces.
    fn mesh(&mut self, value: &AnyValue, told: &mut Json, catalog: &Catalog) -> Result<(), String> {
        if let Some(mesh) = value.get::<Mesh>() {
            return self.faces(mesh, told, catalog);
        }
        if let Some(mesh) = value.as_mesh() {
            return self.faces(&mesh, told, catalog);
        }
        let layers = layers(value);
        let axes = layers.iter().find_map(Layer::axes).ok_or("nothing of it lies in space")?;
        let (mut places, mut edges) = (Vec::new(), Vec::new());
        for layer in &layers {
            let first = places.len() as u32;
            match layer {
                Layer::Points(cloud) => places.extend(cloud.points.positions().iter().copied()),
                Layer::Lines(lines) => {
                    places.extend(lines.points.iter().copied());
                    let sides = lines.chains.iter().flat_map(|chain| chain.windows(2));
                    edges.extend(sides.flat_map(|side| [first + side[0], first + side[1]]));
                }
                Layer::Arrows(arrows) => {
                    let moves = arrows.from.iter().zip(arrows.to.iter());
                    for (from, to) in moves {
                        let start = places.len() as u32;
                        places.extend([*from, *to]);
                        edges.extend([start, start + 1]);
                    }
                }
                Layer::Triangles(_) | Layer::Picture(_) | Layer::Plot(_) | Layer::Marks(_) => {}
            }
        }
        let mut parts = Parts::default();
        parts.push("position", On::Vertex, Meaning::Position, 3, &places[..]);
        parts.push("edges", On::Edge, Meaning::Index, 2, edges);
        if let [Layer::Points(cloud)] = &layers[..] {
            let own = cloud.points.parts().columns.into_iter();
            let own = own.filter(|part| part.on == On::Point && part.name != "position");
            parts.columns.extend(own.map(|part| Part { on: On::Vertex, ..part }));
        }
        told["axes"] = word(axes).into();
        told["sides"] = Json::Null;
        told["columns"] = self.columns(&parts.columns, true)?.into();
        Ok(())
    }

    fn faces(&mut self, mesh: &Mesh, told: &mut Json, catalog: &Catalog) -> Result<(), String> {
        let axes = if mesh.frame().is_some() { Axes::Sensor } else { Axes::Upright };
        told["axes"] = word(axes).into();
        told["sides"] = mesh.faces().sides().into();
        let corners = &mesh.faces().corners()[..];
        let mut parts = mesh.parts();
        for part in &mut parts.columns {
            if part.name == "corners" {
                (part.on, part.width) = (On::Corner, 1);
            }
            let of = format!("{} ", part.on.word());
            if let Some(name) = part.name.strip_prefix(&of) {
                part.name = name.to_owned().into();
            }
        }
        parts.columns.retain(|part| !matches!(part.on, On::Texel | On::Whole));
        // Programs that draw have texture coordinates at corners.
        let uv = parts.columns.iter().position(|it| it.on == On::Vertex && it.name == "uv");
        if let Some(Part { items: Items::F64(items), .. }) = uv.map(|uv| parts.columns.remove(uv)) {
            let items: Vec<_> = corners
                .iter()
                .flat_map(|&corner| {
                    let place = 2 * corner as usize;
                    [items[place], items[place + 1]]
                })
                .collect();
            parts.push("uv", On::Corner, Meaning::Number, 2, items);
        }
        let mut columns = self.columns(&parts.columns, true)?;
        let files = columns
            .iter()
            .filter(|column| column["name"] == "corners" || column["name"] == "sides")
            .map(|column| column["file"].to_string());
        let faces = format!("{:?} {}", mesh.faces().sides(), Vec::from_iter(files).join(" "));
        columns.extend(self.edges(mesh, faces)?);
        told["columns"] = columns.into();
        if let Some(texture) = mesh.texture() {
            told["texture"] = self.picture(texture.clone(), catalog)?;
        }
        let materials = mesh.materials();
        if materials.len() > 1 || !materials.iter().all(Material::is_plain) {
            let materials = materials.iter().map(|material| self.material(material, catalog));
            told["materials"] = materials.collect::<Result<Vec<Json>, String>>()?.into();
        }
        Ok(())
    }

    fn material(&mut self, material: &Material, catalog: &Catalog) -> Result<Json, String> {
        let message =
            MaterialMessage::new(material, |bytes, extension| self.keep(bytes, extension))?;
        let mut told = json!(message);
        if let Some(picture) = material.shown() {
            told["picture"] = self.picture(picture.clone(), catalog)?;
        }
        Ok(told)
    }

    /// The ends of all edges, and the edge at which each corner's side begins.
    fn edges(&mut self, mesh: &Mesh, faces: String) -> Result<Vec<Json>, String> {
        if let Some(known) = self.cached(&faces) {
            return Ok(known);
        }
        let edges = mesh.edges();
        let mut parts = Parts::default();
        parts.push("edges", On::Edge, Meaning::Index, 2, edges.vertices.into_flattened());
        parts.push("edge of a corner", On::Corner, Meaning::Index, 1, edges.of_corner);
        let [ends, of_corner] = &parts.columns[..] else { return Err("no edges".into()) };
        let columns = vec![self.column(ends, true)?, self.column(of_corner, true)?];
        self.cache(faces, columns.clone());
        Ok(columns)
    }

    /// The value that files make.
    pub(super) fn read(&self, input: &Input, kind: &ValueType) -> Result<AnyValue, String> {
        let read = |file: &str| {
            let path = self.shelf.place(file)?;
            plain::read_own(&path).map_err(|error| format!("{file}: {error}"))
        };
        let contents = input.columns.iter().map(|column| read(&column.file));
        let contents = contents.collect::<Result<Vec<_>, String>>()?;
        let mut parts = Parts { row: input.row, ..Parts::default() };
        for (column, bytes) in input.columns.iter().zip(&contents) {
            let on = On::named(&column.on)?;
            let meaning = Meaning::named(&column.meaning)?;
            let items = items(column.numbers, bytes).ok_or_else(|| {
                format!("{}: {} bytes are no whole numbers of its type", column.file, bytes.len())
            })?;
            if column.width == 0 {
                return Err(format!("the column `{}` has no number an element", column.name));
            }
            parts.push(&column.name[..], on, meaning, column.width, items);
        }
        for (name, fact) in &input.facts {
            parts.fact(name.clone(), self::fact(name, fact)?);
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

/// What is seen of a value in space: of a range image its points.
fn layers(value: &AnyValue) -> Vec<Layer> {
    let Some(range) = value.get::<RangeImage>() else { return value.show() };
    let cells: Vec<_> =
        (0..range.points().len()).filter(|cell| range.point(*cell).is_some()).collect();
    let places: Vec<_> = cells.iter().map(|&cell| range.points()[cell]).collect();
    let points = Points::new(places).and_then(|points| match range.colors() {
        Some(colors) => {
            let colors: Vec<_> = cells.iter().map(|&cell| colors[cell]).collect();
            points.with_attribute("color", Attribute::Color(colors.into()))
        }
        None => Ok(points),
    });
    points.map(|points| Layer::Points(Cloud { points, axes: Axes::Sensor })).into_iter().collect()
}

fn word(axes: Axes) -> &'static str {
    match axes {
        Axes::Upright => "upright",
        Axes::Sensor => "sensor",
    }
}

fn facts(parts: &Parts<'_>) -> Json {
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

fn fact(name: &str, fact: &Json) -> Result<FactValue, String> {
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
        format!("the fact `{name}` is a count, two counts, true or false, or a text, not {fact}")
    })
}

/// Numbers, little-endian; none if the last one is cut off.
fn items(numbers: Numbers, bytes: &[u8]) -> Option<Items<'_>> {
    fn all<const N: usize, T>(bytes: &[u8], number: fn([u8; N]) -> T) -> Option<Vec<T>> {
        let (whole, rest) = bytes.as_chunks::<N>();
        rest.is_empty().then(|| whole.iter().map(|&bytes| number(bytes)).collect())
    }
    Some(match numbers {
        Numbers::F64 => all(bytes, f64::from_le_bytes)?.into(),
        Numbers::F32 => Items::F32(all(bytes, f32::from_le_bytes)?.into()),
        Numbers::U32 => all(bytes, u32::from_le_bytes)?.into(),
        Numbers::U8 => bytes.into(),
    })
}
