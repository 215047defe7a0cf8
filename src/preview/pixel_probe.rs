//! Describes the value at a pixel. Used by `maquette inspect --at`, and by the live page for the pixel under the pointer.

use maquette_render::picture_layer;
use maquette_syntax::with_article;
use maquette_value::{AnyValue, ElementKind, Picture, Summary};
use serde_json::{Map, Value as Json};

/// Describes the value at a pixel, given as [column, row]. Returns `None` if the value has no such pixel or no data there.
pub fn probe(value: &AnyValue, pixel: [usize; 2]) -> Option<Summary> {
    let is_inside = size(value).is_none_or(|[w, h]| pixel[0] < w && pixel[1] < h);
    let found = is_inside.then(|| value.probe(pixel));
    found.filter(|found| !found.0.is_empty())
}

/// Returns the reason why a node has no data at a pixel. `found` contains the outputs of the node that were tried.
pub fn no_answer(node: &str, found: &[(&str, &AnyValue)], [x, y]: [usize; 2]) -> String {
    let sizes = found.iter().filter_map(|(name, value)| Some((name, size(value)?)));
    let sizes: Vec<_> = sizes
        .map(|(name, [width, height])| {
            format!("`{node}.{name}` has {width} x {height} pixels, counted from 0,0")
        })
        .collect();
    if !sizes.is_empty() {
        return format!("there is no pixel {x},{y}: {}", sizes.join("; "));
    }
    if let Some((name, _)) = found.iter().find(|(_, value)| {
        first_picture(value).is_some_and(|picture| picture.registration.is_some())
    }) {
        return format!("`{node}.{name}` has no cell under the pixel {x},{y}");
    }
    let kinds = found.iter().map(|(_, value)| with_article(value.kind().name));
    format!(
        "`{node}` gives {}, which has no pixels: --at supports pictures, masks, labels, fields and range images",
        kinds.collect::<Vec<_>>().join(" and ")
    )
}

/// Converts a list of facts to a JSON object.
pub fn facts(summary: Summary) -> Json {
    Json::Object(Map::from_iter(summary.0))
}

/// Returns the first picture in the visual representation of a value.
pub fn first_picture(value: &AnyValue) -> Option<Picture> {
    picture_layer(&value.show()).cloned()
}

/// Returns the width and height of a value in pixels. Returns `None` if the value has no pixels, or is a grid that is drawn on a picture of
/// another resolution.
fn size(value: &AnyValue) -> Option<[usize; 2]> {
    let parts = value.parts();
    if !parts.columns.iter().any(|part| part.element_kind == ElementKind::Pixel) {
        return None;
    }
    let is_registered = first_picture(value).is_some_and(|picture| picture.registration.is_some());
    parts.size().ok().filter(|_| !is_registered)
}
