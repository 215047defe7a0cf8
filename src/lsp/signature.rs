//! The fields of the call around a place, as editors show them while somebody writes.

use maquette_syntax::{TypedKind, cursor};
use serde_json::{Value as Json, json};

use super::library::Library;
use super::scope::Scope;
use super::slot::{Inside, Slots};

/// The call around a place and the field that is written there; `null` if there is none.
pub(super) fn signature(library: &Library<'_>, text: &str, at: usize) -> Json {
    let cursor = cursor(text, at);
    let scope = Scope::of(text);
    let (inside, _) = Slots { library, scope: &scope }.at(&cursor.frames);
    let (Inside::Fields(owner, fields), Some(frame)) = (inside, cursor.frames.last()) else {
        return Json::Null;
    };
    if cursor.typed.kind == TypedKind::Comment || fields.is_empty() {
        return Json::Null;
    }
    let labels: Vec<_> = fields
        .iter()
        .map(|field| match field.takes.is_empty() {
            true => field.name.clone(),
            false => format!("{}: {}", field.name, field.takes),
        })
        .collect();
    let parameters: Vec<_> = fields
        .iter()
        .zip(&labels)
        .map(|(field, label)| json!({ "label": label, "documentation": field.doc }))
        .collect();
    let mut signature =
        json!({ "label": format!("{owner}({})", labels.join(", ")), "parameters": parameters });
    // A field that is not known is none of them.
    let active = frame.field.as_ref().map(|name| {
        fields.iter().position(|field| field.name == name.text).unwrap_or(fields.len())
    });
    signature["activeParameter"] = active.unwrap_or(fields.len()).into();
    json!({ "signatures": [signature], "activeSignature": 0, "activeParameter": signature["activeParameter"] })
}
