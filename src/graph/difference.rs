//! Differences between the parameters of two nodes, for messages.

use maquette_syntax::{FILE, LINK};
use serde_json::Value as Json;

/// Returns the path of the first parameter that differs, with its old and its new value. Links and files are not parameters.
pub fn parameter_difference(before: &Json, now: &Json) -> Option<(Vec<String>, Json, Json)> {
    fn plain(json: &Json) -> bool {
        json.get(LINK).is_none() && json.get(FILE).is_none()
    }
    fn difference_inside(
        name: String,
        before: &Json,
        now: &Json,
    ) -> Option<(Vec<String>, Json, Json)> {
        let (mut path, before, now) = parameter_difference(before, now)?;
        path.insert(0, name);
        Some((path, before, now))
    }
    match (before, now) {
        _ if before == now || !plain(before) || !plain(now) => None,
        (Json::Object(a), Json::Object(b)) if a.keys().eq(b.keys()) => a
            .iter()
            .zip(b.values())
            .find_map(|((name, a), b)| difference_inside(name.clone(), a, b)),
        (Json::Array(a), Json::Array(b)) if a.len() == b.len() => {
            let mut pairs = a.iter().zip(b).enumerate();
            pairs.find_map(|(index, (a, b))| difference_inside(index.to_string(), a, b))
        }
        _ => Some((Vec::new(), before.clone(), now.clone())),
    }
}

/// Formats the path of a parameter for messages: `distance` for `select.Near.distance`, and `corners[2]` for `corners.2`.
pub fn parameter_name(path: &[String]) -> String {
    fn is_index(part: &str) -> bool {
        part.bytes().all(|byte| byte.is_ascii_digit())
    }
    let Some(last) = path.iter().rposition(|part| !is_index(part)) else { return path.join(".") };
    let indices = path[last + 1..].iter().map(|index| format!("[{index}]"));
    path[last].clone() + &String::from_iter(indices)
}

/// Returns the value of a parameter as text, shortened for messages.
pub fn short_text(value: &Json) -> String {
    const MAX_CHARS: usize = 40;
    let text = match value {
        Json::Number(number) => {
            number.as_f64().map_or_else(|| number.to_string(), |x| x.to_string())
        }
        other => other.to_string(),
    };
    match text.char_indices().nth(MAX_CHARS) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn values_are_shown_as_people_write_them() {
        assert_eq!(
            (short_text(&json!(30.0)), short_text(&json!(25.5))),
            ("30".into(), "25.5".into())
        );
        let path = ["corners", "2"].map(str::to_owned);
        assert_eq!(parameter_name(&path), "corners[2]");
    }
}
