//! Generates the text of a sweep from the options `--sweep` and `--scans`.

use std::path::Path;

use maquette_syntax::paths::{folder_of_new, path_between, without_dots};
use maquette_syntax::{parse, quote};

/// Returns the text of a sweep over the files that match a pattern, and over values of parameters. Each parameter is a name with a list of
/// values, such as (`name`, `5,12,20`).
///
/// # Errors
/// A message if a value of a parameter is empty, or if there is no current folder.
pub(crate) fn generate_sweep(
    graph: &Path,
    scans: Option<&str>,
    values: &[(String, String)],
) -> Result<String, String> {
    let mut axes = Vec::new();
    if let Some(pattern) = scans {
        let current_folder = std::env::current_dir()
            .map_err(|error| format!("cannot determine the current folder: {error}"))?;
        let current_folder = std::fs::canonicalize(&current_folder).unwrap_or(current_folder);
        // Resolve the current folder if it is a symbolic link, because the pattern becomes relative to the real folder of the graph.
        let pattern_path = without_dots(&current_folder.join(pattern));
        let pattern_path =
            folder_of_new(&pattern_path).join(pattern_path.file_name().unwrap_or_default());
        let pattern = path_between(&folder_of_new(graph), &pattern_path);
        axes.push(format!("Files({}, name: \"scan\")", quote(&pattern)));
    }
    for (name, values) in values {
        let values: Vec<_> = split_values(values).into_iter().map(literal).collect();
        if values.iter().any(String::is_empty) {
            return Err(format!(
                "--sweep {name}: expected values separated by commas: {name}=5,12,20"
            ));
        }
        axes.push(format!("Values({}, [{}])", quote(name), values.join(", ")));
    }
    let name = graph.file_name().unwrap_or_default().to_string_lossy();
    let over = match &axes[..] {
        [axis] => axis.clone(),
        axes => format!("Product([{}])", axes.join(", ")),
    };
    Ok(format!("Sweep(graph: {}, over: {over})\n", quote(&name)))
}

/// Splits a text at its commas, except those inside of brackets or quotes.
fn split_values(text: &str) -> Vec<&str> {
    let (mut depth, mut in_text, mut start) = (0_usize, false, 0);
    let mut split_values = Vec::new();
    for (at, c) in text.char_indices() {
        match c {
            '"' => in_text = !in_text,
            _ if in_text => {}
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth = depth.saturating_sub(1),
            ',' if depth == 0 => {
                split_values.push(text[start..at].trim());
                start = at + 1;
            }
            _ => {}
        }
    }
    split_values.push(text[start..].trim());
    split_values
}

/// Returns a value as RON. A text that is not valid RON is put in quotes.
fn literal(text: &str) -> String {
    match text.is_empty() || parse(text).1.is_empty() {
        true => text.to_owned(),
        false => quote(text),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_split_at_commas_outside_of_brackets_and_texts() {
        assert_eq!(split_values("5, 12,20"), ["5", "12", "20"]);
        assert_eq!(split_values("(1,2,3),mm(4)"), ["(1,2,3)", "mm(4)"]);
        assert_eq!(split_values("\"a,b\",#c33923"), ["\"a,b\"", "#c33923"]);
        assert_eq!(literal("#c33923"), "\"#c33923\"");
        let values = [("levels".to_owned(), "0,1".to_owned())];
        let text = generate_sweep("a/doll.ron".as_ref(), None, &values).unwrap();
        assert_eq!(text, "Sweep(graph: \"doll.ron\", over: Values(\"levels\", [0, 1]))\n");
        assert!(
            generate_sweep("doll.ron".as_ref(), None, &[("levels".to_owned(), "1,,2".to_owned())])
                .is_err()
        );
    }
}
