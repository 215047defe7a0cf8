//! The fields of an editor's messages, read leniently: fields that nobody needs may hold anything, and 5.0 is 5.

use gen_lsp_types::{Position, Range, Uri};
use serde_json::Value as Json;

/// Why there is no answer.
pub(crate) enum Refused {
    /// There is no such method.
    Unknown(String),
    /// The fields of the request cannot be understood.
    Invalid(String),
    /// It can, but not be done: in words for the user.
    Failed(String),
}

impl From<String> for Refused {
    fn from(why: String) -> Self {
        Self::Failed(why)
    }
}

/// A whole number; those that do not fit are the nearest that does.
pub(super) fn number(json: &Json) -> Option<u32> {
    json.as_f64().map(|number| number as u32)
}

/// The text that a request is about.
pub(super) fn uri(params: &Json) -> Result<Uri, Refused> {
    let uri = params["textDocument"]["uri"].as_str();
    uri.map(|uri| Uri(uri.to_owned())).ok_or_else(|| missing("textDocument.uri"))
}

pub(super) fn position(json: &Json) -> Result<Position, Refused> {
    fn need(name: &str, json: &Json) -> Result<u32, Refused> {
        number(&json[name]).ok_or_else(|| missing(name))
    }
    Ok(Position { line: need("line", json)?, character: need("character", json)? })
}

pub(super) fn range(json: &Json) -> Result<Range, Refused> {
    Ok(Range { start: position(&json["start"])?, end: position(&json["end"])? })
}

pub(super) fn missing(name: &str) -> Refused {
    Refused::Invalid(format!("expected `{name}`, found nothing of its type"))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn numbers_are_read_as_they_are_meant() {
        fn read(json: Json) -> Option<(u32, u32)> {
            position(&json).ok().map(|it| (it.line, it.character))
        }
        assert_eq!(read(json!({ "line": 3.0, "character": 4 })), Some((3, 4)));
        assert_eq!(read(json!({ "line": -1, "character": 1e300 })), Some((0, u32::MAX)));
        assert_eq!(read(json!({ "line": "3", "character": 4 })), None);
        assert_eq!(read(json!([])), None);
        assert!(uri(&json!({ "textDocument": [] })).is_err());
    }
}
