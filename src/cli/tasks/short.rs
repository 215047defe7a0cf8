//! The sweep that a command line stands for.

use std::path::Path;

use maquette_syntax::paths::{folder_of_new, path_between, without_dots};
use maquette_syntax::{parse, quoted};

/// The text of a sweep over files that fit a pattern, and over values of parameters: (`name`, `5,12,20`) each.
///
/// # Errors
/// In words, if a parameter gets no values, or there is no current folder.
pub(crate) fn text_of(
    graph: &Path,
    scans: Option<&str>,
    values: &[(String, String)],
) -> Result<String, String> {
    let mut axes = Vec::new();
    if let Some(pattern) = scans {
        let here = std::env::current_dir()
            .map_err(|error| format!("there is no current folder: {error}"))?;
        let here = std::fs::canonicalize(&here).unwrap_or(here);
        // A folder may be named by a link to it.
        let whole = without_dots(&here.join(pattern));
        let whole = folder_of_new(&whole).join(whole.file_name().unwrap_or_default());
        let pattern = path_between(&folder_of_new(graph), &whole);
        axes.push(format!("Files({}, name: \"scan\")", quoted(&pattern)));
    }
    for (name, values) in values {
        let values: Vec<_> = pieces(values).into_iter().map(literal).collect();
        if values.iter().any(String::is_empty) {
            return Err(format!(
                "--sweep {name}: write values with commas between them, {name}=5,12,20"
            ));
        }
        axes.push(format!("Values({}, [{}])", quoted(name), values.join(", ")));
    }
    let name = graph.file_name().unwrap_or_default().to_string_lossy();
    let over = match &axes[..] {
        [axis] => axis.clone(),
        axes => format!("Product([{}])", axes.join(", ")),
    };
    Ok(format!("Sweep(graph: {}, over: {over})\n", quoted(&name)))
}

/// What stands between commas, those in brackets and texts left out.
fn pieces(text: &str) -> Vec<&str> {
    let (mut depth, mut in_text, mut start) = (0_usize, false, 0);
    let mut pieces = Vec::new();
    for (at, c) in text.char_indices() {
        match c {
            '"' => in_text = !in_text,
            _ if in_text => {}
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth = depth.saturating_sub(1),
            ',' if depth == 0 => {
                pieces.push(text[start..at].trim());
                start = at + 1;
            }
            _ => {}
        }
    }
    pieces.push(text[start..].trim());
    pieces
}

/// A value as RON: what is none is text.
fn literal(text: &str) -> String {
    match text.is_empty() || parse(text).1.is_empty() {
        true => text.to_owned(),
        false => quoted(text),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_divided_by_commas_outside_of_brackets_and_texts() {
        assert_eq!(pieces("5, 12,20"), ["5", "12", "20"]);
        assert_eq!(pieces("(1,2,3),mm(4)"), ["(1,2,3)", "mm(4)"]);
        assert_eq!(pieces("\"a,b\",#c33923"), ["\"a,b\"", "#c33923"]);
        assert_eq!(literal("#c33923"), "\"#c33923\"");
        let values = [("levels".to_owned(), "0,1".to_owned())];
        let text = text_of("a/doll.ron".as_ref(), None, &values).unwrap();
        assert_eq!(text, "Sweep(graph: \"doll.ron\", over: Values(\"levels\", [0, 1]))\n");
        assert!(
            text_of("doll.ron".as_ref(), None, &[("levels".to_owned(), "1,,2".to_owned())])
                .is_err()
        );
    }
}
