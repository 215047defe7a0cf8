//! A value as pages show it: what a page is told of it, and the columns of bytes that a graphics card takes.
//!
//! A column is named by what is in it, so that nobody takes the same bytes twice.
//!
//! Columns that only some views need, such as edges and numbers of attributes, are named by the value and made on request.

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use axum::body::Bytes;
use bytemuck::NoUninit;
use maquette_graph::{Asked, Broken};
use maquette_render::{Field, Ground, Look, Ruler, Shape, Shapes, fitted, picture, picture_of};
use maquette_value::{
    AnyValue, Axes, Column, Hash, Image, Layer, Material, Picture, Series, hash_of,
};
use serde_json::{Value as Json, json};

use super::pick::Pickable;

/// The longest side of a picture that every graphics card takes.
const MOST_PIXELS: usize = 8192;

/// The most numbers of a series that pages draw.
const MOST_NUMBERS: usize = 4096;

/// The most elements that pages list for each property that a value does not have.
const MOST_LISTED: usize = 100;

/// Bytes that are compared at once when a column has changed.
const BLOCK: usize = 1024;

/// A value that somebody looks at.
pub struct Shown {
    pub value: AnyValue,
    /// The picture that it shows, if it is one.
    pub picture: Option<Picture>,
    /// What that lies on.
    pub(crate) ground: Option<Ground>,
    /// What a page is told of it.
    pub(super) about: Json,
    /// What is asked of it, and what of this it is not.
    pub asked: Vec<Asked>,
    broken: Vec<Broken>,
    columns: HashMap<String, Content>,
    /// What lies in space.
    shapes: Vec<Arc<Shape>>,
    /// The columns of pictures that are seen, by their hashes, and the size of what is in them.
    pixels: HashMap<Hash, (Column<[u8; 4]>, [usize; 2])>,
    size: usize,
    pickable: OnceLock<Pickable>,
}

/// The bytes of a column, or what makes them.
#[derive(Clone)]
pub(super) enum Content {
    Ready(Bytes),
    Made(Arc<dyn Fn() -> Vec<u8> + Send + Sync>),
}

/// Makes a column of a shape.
type Make = Box<dyn Fn(&Shape) -> Vec<u8> + Send + Sync>;

impl Content {
    pub(super) fn bytes(&self) -> Bytes {
        match self {
            Self::Ready(bytes) => bytes.clone(),
            Self::Made(make) => make().into(),
        }
    }
}

impl Shown {
    /// `layers` are what the value shows, `asked` is what is asked of it, `ground` is what a picture of it lies on. What was shown `before`
    /// in its place is a start: it is changed where that is quicker.
    pub fn new(
        value: AnyValue,
        layers: Vec<Layer>,
        asked: Vec<Asked>,
        ground: Option<Ground>,
        before: Option<&Self>,
    ) -> Self {
        let broken = Asked::broken(&asked, &value);
        let layers = &marked(layers, &broken)[..];
        let picture = picture_of(layers).cloned();
        let mut shown = Self {
            value,
            picture,
            ground,
            about: json!({}),
            asked,
            broken,
            columns: HashMap::new(),
            shapes: Vec::new(),
            pixels: before.map(|before| before.pixels.clone()).unwrap_or_default(),
            size: 0,
            pickable: OnceLock::new(),
        };
        let flat = shown.flat(layers);
        // Pages draw plots themselves, with words at their axes.
        let in_space = layers.iter().filter(|layer| !matches!(layer, Layer::Plot(_))).cloned();
        let start = before.map_or(&[][..], |before| &before.shapes);
        let shapes = Shapes::of(&Vec::from_iter(in_space), start);
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
            "broken": shown.broken.iter().map(|it| it.to_json(MOST_LISTED)).collect::<Vec<_>>(),
        });
        shown
    }

    /// All that is seen of it.
    pub(super) fn layers(&self) -> Vec<Layer> {
        marked(self.value.show(), &self.broken)
    }

    /// The bytes of one of its columns.
    pub(super) fn column(&self, name: &str) -> Option<&Content> {
        self.columns.get(name)
    }

    /// It, prepared for being pointed at: once, when somebody first does so.
    pub(super) fn pickable(&self) -> &Pickable {
        self.pickable.get_or_init(|| Pickable::new(&self.value))
    }

    /// Bytes that it holds.
    pub(super) fn size(&self) -> usize {
        self.size
    }

    /// Whether it would be shown the same way on this ground.
    pub fn lies_on(&self, ground: Option<&Ground>) -> bool {
        fn about(ground: &Ground) -> (Hash, Option<maquette_value::Registration>) {
            (ground.image.hash(), ground.registration)
        }
        self.ground.as_ref().map(about) == ground.map(about)
    }

    fn flat(&mut self, layers: &[Layer]) -> Option<Json> {
        let registration = self.picture.as_ref()?.registration.filter(|_| self.ground.is_none());
        let capture = registration.map(|it| json!({ "scale": it.scale, "offset": it.offset }));
        let below = self.ground.as_ref().and_then(Ground::below);
        let image = picture(layers, &Look { below, ..Look::own() })?;
        let size = [image.width(), image.height()];
        Some(json!({ "size": size, "pixels": self.image(&image), "capture": capture }))
    }

    fn space(&mut self, shapes: Shapes) -> Json {
        let Shapes { axes, ruler: Ruler { center, scale }, shapes } = shapes;
        let about = shapes.iter().enumerate().map(|(place, shape)| self.shape(place, shape));
        let about = Vec::from_iter(about);
        self.shapes = shapes;
        let center = [center.x, center.y, center.z];
        json!({ "upright": axes == Axes::Upright, "center": center, "scale": scale, "shapes": about })
    }

    fn shape(&mut self, place: usize, shape: &Arc<Shape>) -> Json {
        let position = self.keep(&shape.places);
        let normal = self.keep(&shape.normals);
        let color = shape.colors.as_ref().map(|colors| self.keep(colors));
        let uv = shape.uv.as_ref().map(|uv| self.keep(uv));
        let triangle = self.keep(&shape.triangles);
        let texture = shape.textured().map(|material| self.texture(material));
        // One after the other: how many triangles there are, and their picture.
        let stretches: Vec<_> = shape.stretches.iter().map(|&(count, number)| {
            let material = number.and_then(|number| shape.materials().get(number));
            json!({ "count": count, "texture": material.map(|material| self.texture(material)) })
        }).collect();
        self.size += shape.size();
        let value = self.value.hash().to_string();
        let mut later = |what: &str, make: Make| {
            let name = name_of(Hash::of(format!("{value} {place} {what}").as_bytes()));
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
            let Field { name, on, range, usual } = &field;
            let mut about =
                json!({ "name": name, "on": on.word(), "range": range, "usual": usual });
            let what = format!("{} {name}", on.word());
            let column = later(&what, Box::new(move |shape| bytes_of(&shape.field(&field))));
            about["column"] = column.into();
            about
        });
        let fields = Vec::from_iter(fields);
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

    /// The picture of a material, and how it goes on beyond its border.
    fn texture(&mut self, material: &Material) -> Json {
        let wrap = material.wrap().map(|wrap| format!("{wrap:?}"));
        let picture = material.shown();
        let size = picture.map(|image| [image.width(), image.height()]);
        json!({ "size": size, "pixels": picture.map(|image| self.image(image)), "wrap": wrap })
    }

    /// The pixels of a picture, with 255 behind each.
    fn image(&mut self, image: &Image) -> Json {
        let hash = hash_of(image);
        let (pixels, size) = self.pixels.remove(&hash).unwrap_or_else(|| pixels_of(image));
        let about = json!({ "column": self.keep(&pixels), "size": size });
        self.pixels.insert(hash, (pixels, size));
        about
    }

    /// Keeps a column, and gives its name.
    fn keep<T: NoUninit + Send + Sync>(&mut self, items: &Column<T>) -> String {
        let name = name_of(items.hash());
        self.size += items.size();
        let bytes = Bytes::from_owner(Plain(items.clone()));
        self.columns.insert(name.clone(), Content::Ready(bytes));
        name
    }
}

/// The pixels of a picture, and the size in which every graphics card takes it.
fn pixels_of(image: &Image) -> (Column<[u8; 4]>, [usize; 2]) {
    let longest = image.width().max(image.height()).max(1);
    let share = (MOST_PIXELS as f64 / longest as f64).min(1.0);
    let size = [image.width(), image.height()];
    let size = size.map(|side| ((side as f64 * share) as usize).max(side.min(1)));
    let smaller = (share < 1.0).then(|| fitted(image, size));
    let pixels = smaller.as_ref().unwrap_or(image).pixels();
    (pixels.iter().map(|&[r, g, b]| [r, g, b, 255]).collect(), size)
}

/// What is seen of a value, with marks where it is not as it is asked to be.
fn marked(mut layers: Vec<Layer>, broken: &[Broken]) -> Vec<Layer> {
    broken.iter().for_each(|broken| broken.offence.mark(&mut layers));
    layers
}

/// Items as bytes.
struct Plain<T>(Column<T>);

impl<T: NoUninit + Send + Sync> AsRef<[u8]> for Plain<T> {
    fn as_ref(&self) -> &[u8] {
        bytemuck::cast_slice(&self.0)
    }
}

fn bytes_of<T: NoUninit>(items: &[T]) -> Vec<u8> {
    bytemuck::cast_slice(items).to_vec()
}

/// The name of a column of which the content, or what it is made of, has this hash.
fn name_of(hash: Hash) -> String {
    hash.to_string()[..32].to_owned()
}

/// A series as pages draw it: every n-th of very many numbers.
fn about_series(series: &Series) -> Json {
    let stride = series.numbers.len().div_ceil(MOST_NUMBERS).max(1);
    fn each(numbers: &[f64], stride: usize) -> Json {
        Json::from_iter(numbers.iter().step_by(stride).copied())
    }
    json!({ "name": series.name, "at": each(&series.at, stride), "numbers": each(&series.numbers, stride) })
}

/// What has changed between two columns of the same length, if that is less than the whole: the length of a block in bytes, the number
/// of blocks, the number of each, and the blocks, all numbers in 32 bits, the lowest byte first.
pub(super) fn changes(old: &[u8], new: &[u8]) -> Option<Vec<u8>> {
    if old.len() != new.len() {
        return None;
    }
    let pairs = old.chunks(BLOCK).zip(new.chunks(BLOCK)).enumerate();
    let changed: Vec<_> = pairs.filter(|(_, (old, new))| old != new).collect();
    let size = 8 + changed.len() * (4 + BLOCK);
    if size > new.len() {
        return None;
    }
    let mut bytes = Vec::with_capacity(size);
    let head = [BLOCK as u32, changed.len() as u32];
    let numbers = head.into_iter().chain(changed.iter().map(|(block, _)| *block as u32));
    numbers.for_each(|number| bytes.extend(number.to_le_bytes()));
    changed.iter().for_each(|(_, (_, new))| bytes.extend_from_slice(new));
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use maquette_value::TYPES;

    use super::*;

    /// A column after its changes.
    fn changed(old: &[u8], changes: &[u8]) -> Vec<u8> {
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
    fn changes_make_the_new_column_of_the_old_one() {
        let old: Vec<_> = (0..100_003u32).map(|k| (k % 251) as u8).collect();
        let mut new = old.clone();
        for k in [0, 1, 5000, 99_999, 100_002] {
            new[k] ^= 255;
        }
        let few = changes(&old, &new).unwrap();
        assert!(few.len() < 5 * BLOCK, "{}", few.len());
        assert_eq!(changed(&old, &few), new);
        assert_eq!(changed(&old, &changes(&old, &old).unwrap()), old);
        assert_eq!(changes(&old, &new[1..]), None);
        let all: Vec<_> = old.iter().map(|byte| !byte).collect();
        assert_eq!(changes(&old, &all), None);
    }

    #[test]
    fn every_type_of_values_is_told_and_its_columns_are_there() {
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
            for value in kind.hostile() {
                let shown = Shown::new(value.clone(), value.show(), Vec::new(), None, None);
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
    fn what_was_shown_before_changes_nothing_of_what_is_shown() {
        fn bytes(shown: &Shown) -> Vec<(String, Bytes)> {
            let columns = shown.columns.iter();
            let mut columns: Vec<_> =
                columns.map(|(name, it)| (name.clone(), it.bytes())).collect();
            columns.sort();
            columns
        }
        for kind in TYPES {
            let values = kind.hostile();
            let anew =
                |value: &AnyValue| Shown::new(value.clone(), value.show(), Vec::new(), None, None);
            for pair in values.windows(2) {
                let (before, anew) = (anew(&pair[0]), anew(&pair[1]));
                let after =
                    Shown::new(pair[1].clone(), pair[1].show(), Vec::new(), None, Some(&before));
                assert_eq!(after.about, anew.about, "{}", kind.name);
                assert!(bytes(&after) == bytes(&anew), "{}", kind.name);
                assert_eq!(after.size(), anew.size(), "{}", kind.name);
            }
        }
    }
}
