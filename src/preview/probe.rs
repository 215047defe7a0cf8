//! What is under a pixel of a value: for `inspect --at` and the pointer on the live page.

use maquette_render::picture_of;
use maquette_syntax::with_article;
use maquette_value::{AnyValue, On, Picture, Summary};
use serde_json::{Map, Value as Json};

/// What is under a pixel (column, row), if the value has that pixel and something to say of it.
pub fn at(value: &AnyValue, pixel: [usize; 2]) -> Option<Summary> {
    let is_inside = size(value).is_none_or(|[w, h]| pixel[0] < w && pixel[1] < h);
    let found = is_inside.then(|| value.probe(pixel));
    found.filter(|found| !found.0.is_empty())
}

/// Why none of these outputs of a node has something to say of a pixel.
pub fn no_answer(node: &str, found: &[(&str, &AnyValue)], [x, y]: [usize; 2]) -> String {
    let sizes = found.iter().filter_map(|(name, value)| Some((name, size(value)?)));
    let sizes: Vec<_> = sizes
        .map(|(name, [width, height])| {
            format!("`{node}.{name}` has {width} x {height} pixels, the first of which is 0,0")
        })
        .collect();
    if !sizes.is_empty() {
        return format!("there is no pixel {x},{y}: {}", sizes.join("; "));
    }
    if let Some((name, _)) = found
        .iter()
        .find(|(_, value)| shown(value).is_some_and(|picture| picture.registration.is_some()))
    {
        return format!("`{node}.{name}` has no cell under the pixel {x},{y}");
    }
    let kinds = found.iter().map(|(_, value)| with_article(value.kind().name));
    format!(
        "`{node}` gives {}, which has no pixels: --at asks pictures, masks, labels, fields and range images",
        Vec::from_iter(kinds).join(" and ")
    )
}

/// Facts as JSON.
pub fn facts(summary: Summary) -> Json {
    Json::Object(Map::from_iter(summary.0))
}

/// The first picture that a value shows.
pub fn shown(value: &AnyValue) -> Option<Picture> {
    picture_of(&value.show()).cloned()
}

/// The pixels of what is asked by its own pixels: not of a grid that lies on a picture of other pixels.
fn size(value: &AnyValue) -> Option<[usize; 2]> {
    let parts = value.parts();
    if !parts.columns.iter().any(|part| part.on == On::Pixel) {
        return None;
    }
    let is_registered = shown(value).is_some_and(|picture| picture.registration.is_some());
    parts.size().ok().filter(|_| !is_registered)
}
