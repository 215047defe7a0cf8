//! Makes texts harmless for a terminal: names, docs and files may hold characters that move its cursor or change its title.

use std::borrow::Cow;

/// Whether a terminal acts on a character, or it turns the direction of text; ends of lines and tabs do not count.
fn acts(c: char) -> bool {
    let turns = matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    (c.is_control() && c != '\n' && c != '\t') || turns
}

/// The text with a picture of every such character: `␛` for the one that begins escape sequences.
pub fn harmless(text: &str) -> Cow<'_, str> {
    if !text.contains(acts) {
        return Cow::Borrowed(text);
    }
    // An end of a line is one in files of Windows, too.
    Cow::Owned(
        text.replace("\r\n", "\n")
            .chars()
            .map(|c: char| match u32::from(c) {
                _ if !acts(c) => c,
                code @ 0..0x20 => char::from_u32(0x2400 + code).unwrap_or('\u{fffd}'),
                0x7f => '\u{2421}',
                _ => '\u{fffd}',
            })
            .collect(),
    )
}

/// The text on one line, with pictures of ends of lines and tabs, too: names may hold them.
pub fn on_one_line(text: &str) -> Cow<'_, str> {
    match harmless(text) {
        text if !text.contains(['\n', '\t']) => text,
        text => Cow::Owned(text.replace('\n', "\u{240a}").replace('\t', "\u{2409}")),
    }
}

/// The same for lines of a file, in which places are told by bytes: what acts is replaced by something of as many bytes. Characters
/// of one byte stay; who draws lines of files shows pictures of them.
pub(super) fn harmless_in_place(text: &str) -> Cow<'_, str> {
    fn is_long(c: char) -> bool {
        acts(c) && c.len_utf8() > 1
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

/// A JSON document with every such character as an escape: they stand in its texts alone.
pub fn escaped(json: &str) -> Cow<'_, str> {
    if !json.contains(acts) {
        return Cow::Borrowed(json);
    }
    let mut escaped = String::with_capacity(json.len());
    for c in json.chars() {
        match acts(c) {
            true => escaped += &format!("\\u{:04x}", u32::from(c)),
            false => escaped.push(c),
        }
    }
    Cow::Owned(escaped)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_terminal_acts_on_is_shown_instead() {
        assert_eq!(
            harmless("a\u{1b}[2J\u{7}\r\u{7f}\u{9b}b\u{202e}\n\té"),
            "a␛[2J␇␍␡\u{fffd}b\u{fffd}\n\té"
        );
        assert!(matches!(harmless("no harm: ␛é\n"), Cow::Borrowed(_)));
    }

    #[test]
    fn a_name_stays_on_its_line() {
        assert_eq!(on_one_line("a\nb\t\u{1b}c"), "a␊b␉␛c");
        assert!(matches!(on_one_line("a b"), Cow::Borrowed(_)));
    }

    #[test]
    fn places_stay_where_they_are() {
        let text = "a\u{9b}b\u{202e}c\u{1b}d";
        let harmless = harmless_in_place(text);
        assert_eq!(harmless, "a\u{a4}b\u{fffd}c\u{1b}d");
        assert_eq!(harmless.len(), text.len());
    }

    #[test]
    fn a_document_says_the_same_with_escapes() {
        let document = serde_json::json!({ "name": "a\u{1b}\u{7f}\u{9b}\u{202e}é\n" });
        let text = escaped(&format!("{document:#}")).into_owned();
        assert!(text.chars().all(|c| c == '\n' || !acts(c)), "{text}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&text).unwrap(), document);
    }
}
