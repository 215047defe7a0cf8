//! Escapes control characters for terminals. Names, documentation and files may contain control sequences that move the cursor or change
//! the window title.

use std::borrow::Cow;
use std::fmt::Display;

/// Returns true for control characters and for characters that change the direction of text, except line feeds and tabs.
fn affects_terminal(c: char) -> bool {
    let turns = matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    (c.is_control() && c != '\n' && c != '\t') || turns
}

/// Replaces control characters by visible symbols, such as `␛` for the character that begins escape sequences.
pub fn sanitize(text: &str) -> Cow<'_, str> {
    if !text.contains(affects_terminal) {
        return Cow::Borrowed(text);
    }
    // Windows line endings are converted to line feeds instead of being escaped.
    Cow::Owned(
        text.replace("\r\n", "\n")
            .chars()
            .map(|c: char| match u32::from(c) {
                _ if !affects_terminal(c) => c,
                code @ 0..0x20 => char::from_u32(0x2400 + code).unwrap_or('\u{fffd}'),
                0x7f => '\u{2421}',
                _ => '\u{fffd}',
            })
            .collect(),
    )
}

/// Like [`sanitize`], but also replaces line feeds and tabs. For names, which are printed on one line.
pub fn sanitize_line(text: &str) -> Cow<'_, str> {
    match sanitize(text) {
        text if !text.contains(['\n', '\t']) => text,
        text => Cow::Owned(text.replace('\n', "\u{240a}").replace('\t', "\u{2409}")),
    }
}

/// Replaces control characters of two or more bytes by symbols of the same length, so that byte offsets into the text stay valid. One-byte
/// control characters are left to `annotate_snippets`, which replaces them itself.
pub(super) fn sanitize_same_length(text: &str) -> Cow<'_, str> {
    fn is_long(c: char) -> bool {
        affects_terminal(c) && c.len_utf8() > 1
    }
    if !text.contains(is_long) {
        return Cow::Borrowed(text);
    }
    Cow::Owned(
        text.chars()
            .map(|c: char| match c.len_utf8() {
                _ if !is_long(c) => c,
                2 => '\u{a4}',
                _ => '\u{fffd}',
            })
            .collect(),
    )
}

/// Escapes the control characters of a JSON document. They can occur only in strings.
pub fn escape_json(json: &str) -> Cow<'_, str> {
    if !json.contains(affects_terminal) {
        return Cow::Borrowed(json);
    }
    let mut escaped = String::with_capacity(json.len());
    for c in json.chars() {
        match affects_terminal(c) {
            true => escaped += &format!("\\u{:04x}", u32::from(c)),
            false => escaped.push(c),
        }
    }
    Cow::Owned(escaped)
}

/// Escapes a text for XML and HTML. Characters that XML does not allow are removed.
pub fn escape_xml(text: impl Display) -> String {
    let mut escaped = String::new();
    for c in text.to_string().chars() {
        match c {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '"' => escaped += "&quot;",
            '\n' | '\t' => escaped.push(c),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => {}
            c => escaped.push(c),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn characters_that_xml_forbids_are_removed() {
        assert_eq!(
            escape_xml("a\u{0}\u{1b}[\u{7f}\u{9b}\u{fffe}\u{ffff}<\"&>\n\té"),
            "a[&lt;&quot;&amp;&gt;\n\té"
        );
    }

    #[test]
    fn control_characters_are_replaced_by_symbols() {
        assert_eq!(
            sanitize("a\u{1b}[2J\u{7}\r\u{7f}\u{9b}b\u{202e}\n\té"),
            "a␛[2J␇␍␡\u{fffd}b\u{fffd}\n\té"
        );
        assert!(matches!(sanitize("no harm: ␛é\n"), Cow::Borrowed(_)));
    }

    #[test]
    fn a_name_stays_on_its_line() {
        assert_eq!(sanitize_line("a\nb\t\u{1b}c"), "a␊b␉␛c");
        assert!(matches!(sanitize_line("a b"), Cow::Borrowed(_)));
    }

    #[test]
    fn byte_offsets_stay_valid() {
        let text = "a\u{9b}b\u{202e}c\u{1b}d";
        let harmless = sanitize_same_length(text);
        assert_eq!(harmless, "a\u{a4}b\u{fffd}c\u{1b}d");
        assert_eq!(harmless.len(), text.len());
    }

    #[test]
    fn an_escaped_document_is_equivalent() {
        let document = serde_json::json!({ "name": "a\u{1b}\u{7f}\u{9b}\u{202e}é\n" });
        let text = escape_json(&format!("{document:#}")).into_owned();
        assert!(text.chars().all(|c| c == '\n' || !affects_terminal(c)), "{text}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&text).unwrap(), document);
    }
}
