//! Signature help: shows the fields of the call at the cursor.

use maquette_syntax::{TypedKind, cursor};
use serde_json::{Value as Json, json};

use super::expected_syntax::{BracketContent, SyntaxResolver};
use super::library::Library;
use super::scope::Scope;

/// Returns the call that contains the offset `at`, and the field at that offset. Returns `null` outside of calls.
pub(super) fn signature(library: &Library<'_>, text: &str, at: usize) -> Json {
    let cursor = cursor(text, at);
    let scope = Scope::parse(text);
    let (inside, _) = SyntaxResolver { library, scope: &scope }.resolve(&cursor.frames);
    let (BracketContent::Fields(owner, fields), Some(frame)) = (inside, cursor.frames.last())
    else {
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
    // If the call has no field with the name at the cursor, highlight no field.
    let active = frame.field.as_ref().map(|name| {
        fields.iter().position(|field| field.name == name.text).unwrap_or(fields.len())
    });
    signature["activeParameter"] = active.unwrap_or(fields.len()).into();
    json!({ "signatures": [signature], "activeSignature": 0, "activeParameter": signature["activeParameter"] })
}
