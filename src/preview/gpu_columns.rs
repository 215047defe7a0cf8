//! Converts a value to the form in which live pages draw it: a description, and columns (arrays of bytes) for the graphics card.
//!
//! A column is named by the hash of its content, so a page loads the same bytes only once.
//!
//! Some columns are needed only in some views, such as those of edges and of attributes. They are computed when a page requests them, and
//! are named by the hash of the value.

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use axum::body::Bytes;
use bytemuck::NoUninit;
use maquette_graph::{Requirement, UnmetRequirement};
use maquette_render::{
    Field, Look, Normalization, OwnedBackdrop, Shape, Shapes, fit_picture, picture, picture_layer,
};
use maquette_value::{
    AnyValue, Axes, Column, Hash, Image, Layer, Material, Picture, Series, hash_of,
};
use serde_json::{Value as Json, json};

use super::pick::Pickable;

/// The maximum width and height in pixels of a picture. All graphics cards support this size.
const MAX_PIXELS: usize = 8192;

/// The maximum number of values of a plotted series that a page receives.
const MAX_NUMBERS: usize = 4096;

/// The maximum number of violating elements that a page lists for each required property.
const MAX_LISTED: usize = 100;

/// The size in bytes of the blocks in which two versions of a column are compared.
const BLOCK: usize = 1024;

/// A value that a live page shows.
pub struct ViewedValue {
    pub value: AnyValue,
    /// The picture that represents the value; `None` if the value is not shown as a picture.
    pub picture: Option<Picture>,
    /// The background picture on which `picture` is drawn; `None` for no background.
    pub(crate) ground: Option<OwnedBackdrop>,
    /// The description of the value that pages receive.
    pub(super) about: Json,
    /// The properties that nodes require of the value (`required`), and those required properties that the value lacks (`broken`).
    pub required: Vec<Requirement>,
    broken: Vec<UnmetRequirement>,
    columns: HashMap<String, Content>,
    /// The shapes with which the value is drawn in 3D.
    shapes: Vec<Arc<Shape>>,
    /// The pixels, width and height of each visible picture, by the hash of the picture.
    pixels: HashMap<Hash, (Column<[u8; 4]>, [usize; 2])>,
    size: usize,
    pickable: OnceLock<Pickable>,
}

/// The bytes of a column, or a function that computes the bytes.
#[derive(Clone)]
pub(super) enum Content {
    Ready(Bytes),
    Made(Arc<dyn Fn() -> Vec<u8> + Send + Sync>),
}

/// A function that computes a column of a shape.
type ColumnFunction = Box<dyn Fn(&Shape) -> Vec<u8> + Send + Sync>;

impl Content {
    pub(super) fn bytes(&self) -> Bytes {
        match self {
            Self::Ready(bytes) => bytes.clone(),
            Self::Made(make) => make().into(),
        }
    }
}

impl ViewedValue {
    /// Prepares a value for pages. `layers` are its visual representation, `required` are the properties that nodes require of it, and
    /// `ground` is the picture on which it is drawn. Parts of the earlier value `before` are reused where that is faster.
    pub fn new(
        value: AnyValue,
        layers: Vec<Layer>,
        required: Vec<Requirement>,
        ground: Option<OwnedBackdrop>,
        before: Option<&Self>,
    ) -> Self {
        let broken = Requirement::find_unmet(&required, &value);
        let layers = &mark_violations(layers, &broken)[..];
        let picture = picture_layer(layers).cloned();
        let mut shown = Self {
            value,
            picture,
            ground,
            about: json!({}),
            required,
            broken,
            columns: HashMap::new(),
            shapes: Vec::new(),
            pixels: before.map(|before| before.pixels.clone()).unwrap_or_default(),
            size: 0,
            pickable: OnceLock::new(),
        };
        let flat = shown.flat(layers);
        // Leave out plots, because pages draw plots and their labels themselves.
        let in_space = layers.iter().filter(|layer| !matches!(layer, Layer::Plot(_))).cloned();
        let start = before.map_or(&[][..], |before| &before.shapes);
        let shapes = Shapes::from_layers(&Vec::from_iter(in_space), start);
        let space = shapes.map(|shapes| shown.space(shapes));
        let series = layers.iter().find_map(|layer| match layer {
            Layer::Plot(series) => Some(series.iter().map(about_series).collect::<Vec<_>>()),
            _ => None,
        });
        let Self { pixels, columns, .. } = &mut shown;
        pixels.retain(|_, (column, _)| columns.contains_key(&name_of(column.hash())));
        shown.size += shown.value.size();
        shown.about = json!({
            "type": shown.value.kind().name,
            "hash": shown.value.hash().to_string(),
            "picture": flat,
            "space": space,
            "series": series,
            "broken": shown.broken.iter().map(|it| it.to_json(MAX_LISTED)).collect::<Vec<_>>(),
        });
        shown
    }

    /// Returns the layers of the value. Elements that violate a required property are marked.
    pub(super) fn layers(&self) -> Vec<Layer> {
        mark_violations(self.value.show(), &self.broken)
    }

    /// Returns the content of the column with this name, or `None` if the value has no such column.
    pub(super) fn column(&self, name: &str) -> Option<&Content> {
        self.columns.get(name)
    }

    /// Returns the index for finding the element under the pointer. It is built at the first call.
    pub(super) fn pickable(&self) -> &Pickable {
        self.pickable.get_or_init(|| Pickable::new(&self.value))
    }

    /// Returns the memory that the value and its columns need, in bytes.
    pub(super) fn size(&self) -> usize {
        self.size
    }

    /// Returns true if the value would look the same on the background picture `ground` as on its present one.
    pub fn looks_same_on(&self, ground: Option<&OwnedBackdrop>) -> bool {
        fn ground_key(ground: &OwnedBackdrop) -> (Hash, Option<maquette_value::Registration>) {
            (ground.image.hash(), ground.registration)
        }
        self.ground.as_ref().map(ground_key) == ground.map(ground_key)
    }

    fn flat(&mut self, layers: &[Layer]) -> Option<Json> {
        let registration = self.picture.as_ref()?.registration.filter(|_| self.ground.is_none());
        let capture = registration.map(|it| json!({ "scale": it.scale, "offset": it.offset }));
        let below = self.ground.as_ref().and_then(OwnedBackdrop::backdrop);
        let image = picture(layers, &Look { backdrop: below, ..Look::front() })?;
        let size = [image.width(), image.height()];
        Some(json!({ "size": size, "pixels": self.image(&image), "capture": capture }))
    }

    fn space(&mut self, shapes: Shapes) -> Json {
        let Shapes { axes, normalization: Normalization { center, scale }, shapes } = shapes;
        let about = shapes.iter().enumerate().map(|(place, shape)| self.shape(place, shape));
        let about = about.collect::<Vec<_>>();
        self.shapes = shapes;
        let center = [center.x, center.y, center.z];
        json!({ "upright": axes == Axes::Upright, "center": center, "scale": scale, "shapes": about })
    }

    fn shape(&mut self, place: usize, shape: &Arc<Shape>) -> Json {
        let position = self.store_column(&shape.positions);
        let normal = self.store_column(&shape.normals);
        let color = shape.colors.as_ref().map(|colors| self.store_column(colors));
        let uv = shape.uv.as_ref().map(|uv| self.store_column(uv));
        let triangle = self.store_column(&shape.triangles);
        let texture = shape.textured_material().map(|material| self.texture(material));
        // Each run of triangles with the same material, as the number of triangles and the texture.
        let stretches: Vec<_> = shape.material_runs.iter().map(|&(count, number)| {
            let material = number.and_then(|number| shape.materials().get(number));
            json!({ "count": count, "texture": material.map(|material| self.texture(material)) })
        }).collect();
        self.size += shape.size();
        let value = self.value.hash().to_string();
        let mut later = |what: &str, make: ColumnFunction| {
            let name = name_of(Hash::compute(format!("{value} {place} {what}").as_bytes()));
            let shape = shape.clone();
            self.columns.insert(name.clone(), Content::Made(Arc::new(move || make(&shape))));
            name
        };
        let edge =
            (!shape.is_solid).then(|| later("edge", Box::new(|shape| bytes_of(&shape.edges()))));
        let parameter = shape.has_parameters().then(|| {
            later("parameter", Box::new(|shape| bytes_of(&shape.parameters().unwrap_or_default())))
        });
        let fields = shape.fields.iter().cloned().map(|field| {
            let Field { name, element_kind: on, range, typical_range: usual } = &field;
            let mut about =
                json!({ "name": name, "on": on.word(), "range": range, "usual": usual });
            let what = format!("{} {name}", on.word());
            let column = later(&what, Box::new(move |shape| bytes_of(&shape.field(&field))));
            about["column"] = column.into();
            about
        });
        let fields = fields.collect::<Vec<_>>();
        json!({
            "solid": shape.is_solid,
            "position": position,
            "normal": normal,
            "color": color,
            "uv": uv,
            "triangle": triangle,
            "texture": texture,
            "stretches": stretches,
            "edge": edge,
            "parameter": parameter,
            "fields": fields,
        })
    }

    /// Describes the texture of a material and its wrap mode.
    fn texture(&mut self, material: &Material) -> Json {
        let wrap = material.wrap().map(|wrap| format!("{wrap:?}"));
        let picture = material.non_empty_picture();
        let size = picture.map(|image| [image.width(), image.height()]);
        json!({ "size": size, "pixels": picture.map(|image| self.image(image)), "wrap": wrap })
    }

    /// Describes a picture and stores its pixels as a column, in RGBA with alpha 255.
    fn image(&mut self, image: &Image) -> Json {
        let hash = hash_of(image);
        let (pixels, size) = self.pixels.remove(&hash).unwrap_or_else(|| pixels_of(image));
        let about = json!({ "column": self.store_column(&pixels), "size": size });
        self.pixels.insert(hash, (pixels, size));
        about
    }

    /// Stores a column and returns the name by which pages request it.
    fn store_column<T: NoUninit + Send + Sync>(&mut self, items: &Column<T>) -> String {
        let name = name_of(items.hash());
        self.size += items.size();
        let bytes = Bytes::from_owner(RawItems(items.clone()));
        self.columns.insert(name.clone(), Content::Ready(bytes));
        name
    }
}

/// Returns the pixels of a picture as RGBA, and its size. A picture that is too large for some graphics cards is scaled down.
fn pixels_of(image: &Image) -> (Column<[u8; 4]>, [usize; 2]) {
    let longest = image.width().max(image.height()).max(1);
    let share = (MAX_PIXELS as f64 / longest as f64).min(1.0);
    let size = [image.width(), image.height()];
    let size = size.map(|side| ((side as f64 * share) as usize).max(side.min(1)));
    let smaller = (share < 1.0).then(|| fit_picture(image, size));
    let pixels = smaller.as_ref().unwrap_or(image).pixels();
    (pixels.iter().map(|&[r, g, b]| [r, g, b, 255]).collect(), size)
}

/// Marks the elements that violate a required property in the layers of a value.
fn mark_violations(mut layers: Vec<Layer>, broken: &[UnmetRequirement]) -> Vec<Layer> {
    broken.iter().for_each(|broken| broken.violation.mark(&mut layers));
    layers
}

/// The items of a column, for reading them as bytes.
struct RawItems<T>(Column<T>);

impl<T: NoUninit + Send + Sync> AsRef<[u8]> for RawItems<T> {
    fn as_ref(&self) -> &[u8] {
        bytemuck::cast_slice(&self.0)
    }
}

fn bytes_of<T: NoUninit>(items: &[T]) -> Vec<u8> {
    bytemuck::cast_slice(items).to_vec()
}

/// Returns the name of a column. `hash` is the hash of the column's content, or of the value from which the column is computed.
fn name_of(hash: Hash) -> String {
    hash.to_string()[..32].to_owned()
}

/// Describes a series for pages. Of a long series, only every n-th number is sent.
fn about_series(series: &Series) -> Json {
    let stride = series.numbers.len().div_ceil(MAX_NUMBERS).max(1);
    fn sample_numbers(numbers: &[f64], stride: usize) -> Json {
        Json::from_iter(numbers.iter().step_by(stride).copied())
    }
    json!({ "name": series.name, "at": sample_numbers(&series.at, stride), "numbers": sample_numbers(&series.numbers, stride) })
}

/// Returns the changes between two versions of a column. Returns `None` if the columns differ in length, or if the changes are not smaller
/// than the column. The changes consist of the length of a block in bytes, the number of changed blocks, the indices of these blocks, and
/// their bytes. All numbers have 32 bits and are little-endian.
pub(super) fn changes(old: &[u8], new: &[u8]) -> Option<Vec<u8>> {
    if old.len() != new.len() {
        return None;
    }
    let pairs = old.chunks(BLOCK).zip(new.chunks(BLOCK)).enumerate();
    let apply_changes: Vec<_> = pairs.filter(|(_, (old, new))| old != new).collect();
    let size = 8 + apply_changes.len() * (4 + BLOCK);
    if size > new.len() {
        return None;
    }
    let mut bytes = Vec::with_capacity(size);
    let head = [BLOCK as u32, apply_changes.len() as u32];
    let numbers = head.into_iter().chain(apply_changes.iter().map(|(block, _)| *block as u32));
    numbers.for_each(|number| bytes.extend(number.to_le_bytes()));
    apply_changes.iter().for_each(|(_, (_, new))| bytes.extend_from_slice(new));
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use maquette_value::TYPES;

    use super::*;

    /// Applies changes to the old version of a column, as a page does.
    fn apply_changes(old: &[u8], changes: &[u8]) -> Vec<u8> {
        let number =
            |k: usize| u32::from_le_bytes(changes[4 * k..][..4].try_into().unwrap()) as usize;
        let (block, count) = (number(0), number(1));
        let mut new = old.to_vec();
        let mut from = 8 + 4 * count;
        for k in 0..count {
            let start = block * number(2 + k);
            let end = new.len().min(start + block);
            new[start..end].copy_from_slice(&changes[from..][..end - start]);
            from += end - start;
        }
        assert_eq!(from, changes.len());
        new
    }

    #[test]
    fn changes_convert_the_old_column_to_the_new_one() {
        let old: Vec<_> = (0..100_003u32).map(|k| (k % 251) as u8).collect();
        let mut new = old.clone();
        for k in [0, 1, 5000, 99_999, 100_002] {
            new[k] ^= 255;
        }
        let few = changes(&old, &new).unwrap();
        assert!(few.len() < 5 * BLOCK, "{}", few.len());
        assert_eq!(apply_changes(&old, &few), new);
        assert_eq!(apply_changes(&old, &changes(&old, &old).unwrap()), old);
        assert_eq!(changes(&old, &new[1..]), None);
        let all: Vec<_> = old.iter().map(|byte| !byte).collect();
        assert_eq!(changes(&old, &all), None);
    }

    #[test]
    fn every_type_of_values_has_a_description_and_columns() {
        fn names(about: &Json, all: &mut Vec<String>) {
            match about {
                Json::Object(fields) => fields.iter().for_each(|(field, value)| {
                    let named = ["column", "position", "normal", "color", "uv", "triangle"];
                    let is_name =
                        named.contains(&&field[..]) || ["edge", "parameter"].contains(&&field[..]);
                    let name = value.as_str().filter(|_| is_name);
                    all.extend(name.map(str::to_owned));
                    names(value, all);
                }),
                Json::Array(items) => items.iter().for_each(|item| names(item, all)),
                _ => {}
            }
        }
        for kind in TYPES {
            let mut seen = 0;
            for value in kind.edge_cases() {
                let shown = ViewedValue::new(value.clone(), value.show(), Vec::new(), None, None);
                let mut all = Vec::new();
                names(&shown.about, &mut all);
                let series = shown.about["series"].as_array().map_or(0, Vec::len);
                seen += all.len() + series;
                for name in all {
                    let column = shown.column(&name).expect("a column for each name");
                    assert!(shown.size() > 0 || column.bytes().is_empty());
                }
            }
            assert!(seen > 0, "{} has neither columns nor series", kind.name);
        }
    }

    #[test]
    fn the_previous_value_does_not_change_the_result() {
        fn bytes(shown: &ViewedValue) -> Vec<(String, Bytes)> {
            let columns = shown.columns.iter();
            let mut columns: Vec<_> =
                columns.map(|(name, it)| (name.clone(), it.bytes())).collect();
            columns.sort();
            columns
        }
        for kind in TYPES {
            let values = kind.edge_cases();
            fn view(value: &AnyValue) -> ViewedValue {
                ViewedValue::new(value.clone(), value.show(), Vec::new(), None, None)
            }
            for pair in values.windows(2) {
                let (before, anew) = (view(&pair[0]), view(&pair[1]));
                let after = ViewedValue::new(
                    pair[1].clone(),
                    pair[1].show(),
                    Vec::new(),
                    None,
                    Some(&before),
                );
                assert_eq!(after.about, anew.about, "{}", kind.name);
                assert!(bytes(&after) == bytes(&anew), "{}", kind.name);
                assert_eq!(after.size(), anew.size(), "{}", kind.name);
            }
        }
    }
}
