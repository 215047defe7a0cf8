//! Reads the parameters of an editor's messages leniently. Unused fields may contain anything, and 5.0 is accepted instead of 5.

use gen_lsp_types::{Position, Range, Uri};
use serde_json::Value as Json;

/// An error in answering a request.
pub(crate) enum RequestError {
    /// The server does not know the method.
    Unknown(String),
    /// The parameters of the request are invalid.
    Invalid(String),
    /// The request failed; the message is for the user.
    Failed(String),
}

impl From<String> for RequestError {
    fn from(why: String) -> Self {
        Self::Failed(why)
    }
}

/// Reads an integer. A number out of range becomes the nearest number in range.
pub(super) fn number(json: &Json) -> Option<u32> {
    json.as_f64().map(|number| number as u32)
}

/// Reads the URI of the document that a request is about.
pub(super) fn uri(params: &Json) -> Result<Uri, RequestError> {
    let uri = params["textDocument"]["uri"].as_str();
    uri.map(|uri| Uri(uri.to_owned())).ok_or_else(|| missing("textDocument.uri"))
}

pub(super) fn position(json: &Json) -> Result<Position, RequestError> {
    fn need(name: &str, json: &Json) -> Result<u32, RequestError> {
        number(&json[name]).ok_or_else(|| missing(name))
    }
    Ok(Position { line: need("line", json)?, character: need("character", json)? })
}

pub(super) fn range(json: &Json) -> Result<Range, RequestError> {
    Ok(Range { start: position(&json["start"])?, end: position(&json["end"])? })
}

pub(super) fn missing(name: &str) -> RequestError {
    RequestError::Invalid(format!("expected `{name}`, found nothing of its type"))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn numbers_are_read_leniently() {
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
