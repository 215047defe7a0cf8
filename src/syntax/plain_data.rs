//! Files of plain data, such as locks. Their comments need not be preserved, so the crate `ron` writes and reads them.

use ron::Options;
use ron::extensions::Extensions;
use ron::ser::PrettyConfig;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::Span;

/// Formats data as a line with a comment, followed by `NAME(..)`. Values nested deeper than `depth` are written on one line.
pub fn format_plain_data(comment: &str, name: &str, depth: usize, data: &impl Serialize) -> String {
    let config = PrettyConfig::new().new_line("\n").depth_limit(depth).escape_strings(false);
    let text =
        options().to_string_pretty(data, config).expect("plain data has no type that RON lacks");
    format!("// {comment}\n{name}{text}\n")
}

/// Parses plain data. A value of type `Option` may be written without `Some`.
///
/// # Errors
/// The text is not RON, or does not have the type `T`. The error is the position and the reason.
pub fn parse_plain_data<T: DeserializeOwned>(text: &str) -> Result<T, (Span, String)> {
    options().from_str(text).map_err(|error| {
        let [start, end] = [error.span.start, error.span.end].map(|position| {
            let lines = text.split_inclusive('\n').take(position.line.saturating_sub(1));
            let before: usize = lines.map(str::len).sum();
            let columns = text[before..].chars().take(position.col.saturating_sub(1));
            before + columns.map(char::len_utf8).sum::<usize>()
        });
        let start = text.len() - text[start..].trim_start().len();
        (Span { start, end: end.max(start) }, error.code.to_string())
    })
}

fn options() -> Options {
    Options::default().with_default_extension(Extensions::IMPLICIT_SOME)
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Data {
        text: String,
        number: Option<f64>,
        pairs: Vec<(String, u32)>,
    }

    #[test]
    fn data_is_read_as_it_was_written() {
        for text in ["", "plain", "a \"# b \"## c\n", "two\nlines\n", "\\ \t \u{1F600}"] {
            let data = Data {
                text: text.into(),
                number: Some(1.5),
                pairs: vec![("a".into(), 1), ("b".into(), 2)],
            };
            let written = format_plain_data("A comment.", "Data", 1, &data);
            assert!(written.starts_with("// A comment.\nData(\n"), "{written}");
            assert_eq!(parse_plain_data(&written), Ok(data), "{written}");
        }
    }

    #[test]
    fn an_error_has_its_position() {
        let text = "Data(\n    text: \"é\", number: x,\n)";
        let (span, _) = parse_plain_data::<Data>(text).unwrap_err();
        assert_eq!(&text[..span.start], "Data(\n    text: \"é\", number: ");
        assert!(parse_plain_data::<Data>("").is_err());
    }
}
