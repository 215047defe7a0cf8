//! Compares names that are spelled with different characters, but look the same or refer to the same file.

use unicode_normalization::UnicodeNormalization;

/// Normalizes a file name, so that names of the same file on macOS or Windows become equal. Both systems ignore case, and macOS does not
/// distinguish composed and decomposed characters.
pub fn file_key(name: &str) -> String {
    let parts = name.split('/').filter(|part| !matches!(*part, "" | "."));
    let path = parts.collect::<Vec<_>>().join("/");
    path.nfd().flat_map(char::to_lowercase).nfd().collect()
}

/// Returns the message for two different names that refer to the same file.
pub fn same_file_message(what: &str, first: &str, second: &str) -> String {
    let spelled = match look_alike(first, second) {
        true => format!(", the second {}", difference(first, second)),
        false => String::new(),
    };
    format!("{what} `{first}` and `{second}` are one file on macOS and Windows{spelled}")
}

/// Returns true if two names differ, but look the same.
pub(crate) fn look_alike(a: &str, b: &str) -> bool {
    fn is_plain(name: &str) -> bool {
        name.bytes().all(|byte| byte.is_ascii_graphic())
    }
    a != b && !(is_plain(a) && is_plain(b)) && visible(a) == visible(b)
}

/// Describes how the characters of `known` differ from those of `given`, using character codes.
pub(crate) fn difference(given: &str, known: &str) -> String {
    let (given, known) = (given.chars().collect::<Vec<_>>(), known.chars().collect::<Vec<_>>());
    let begin = given.iter().zip(&known).take_while(|(a, b)| a == b).count();
    let (given, known) = (&given[begin..], &known[begin..]);
    let end = given.iter().rev().zip(known.iter().rev()).take_while(|(a, b)| a == b).count();
    fn codes(chars: &[char], end: usize) -> String {
        Vec::from_iter(
            chars[..chars.len() - end].iter().map(|c| format!("U+{:04X}", u32::from(*c))),
        )
        .join(" ")
    }
    match (codes(given, end), codes(known, end)) {
        (given, known) if known.is_empty() => format!("without {given}"),
        (given, known) if given.is_empty() => format!("with {known}"),
        (given, known) => format!("with {known} instead of {given}"),
    }
}

/// Normalizes a name, so that names that look the same become equal.
fn visible(name: &str) -> String {
    let seen = name.nfkc().filter(|c| !is_invisible(*c)).map(ascii_look_alike);
    let text = String::from_iter(seen.map(|c| if c.is_whitespace() { ' ' } else { c }));
    text.trim().to_owned()
}

/// Returns true for invisible characters, such as joiners and direction marks.
fn is_invisible(c: char) -> bool {
    c.is_control()
        || matches!(c,
            '\u{ad}' | '\u{34f}' | '\u{61c}' | '\u{180b}'..='\u{180e}' | '\u{200b}'..='\u{200f}'
            | '\u{202a}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{fe00}'..='\u{fe0f}' | '\u{feff}'
            | '\u{e0000}'..='\u{e0fff}')
}

/// Cyrillic and Greek letters and hyphens, and the ASCII characters that look like them, in the same order.
const LOOK_ALIKES: (&str, &str) = (
    "аеорсухіјѕһԁԛԝкАВЕКМНОРСТХІЈЅҮΑΒΕΖΗΙΚΜΝΟΡΤΥΧονικ‐‑‒–−",
    "aeopcyxijshdqwkABEKMHOPCTXIJSYABEZHIKMNOPTYXovik-----",
);

/// Returns the ASCII character that looks like `c`. If there is none, returns `c`.
fn ascii_look_alike(c: char) -> char {
    let place = LOOK_ALIKES.0.chars().position(|known| known == c);
    place.and_then(|place| LOOK_ALIKES.1.chars().nth(place)).unwrap_or(c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_the_same_file_have_the_same_key() {
        assert_eq!(file_key("Mask.PNG"), file_key("mask.png"));
        assert_eq!(file_key("caf\u{e9}.ply"), file_key("Cafe\u{301}.ply"));
        assert_eq!(file_key("\u{c9}"), file_key("e\u{301}"));
        assert_ne!(file_key("cafe.ply"), file_key("caf\u{e9}.ply"));
    }

    #[test]
    fn names_that_look_alike_differ_in_codes() {
        fn check(given: &str, known: &str, expected: &str) {
            assert!(look_alike(given, known), "{given} {known}");
            assert_eq!(difference(given, known), expected);
        }
        check("re\u{200b}d", "red", "without U+200B");
        check("red", "red ", "with U+0020");
        check("caf\u{e9}", "cafe\u{301}", "with U+0065 U+0301 instead of U+00E9");
        check("r\u{435}d", "red", "with U+0065 instead of U+0435");
        check("eye\u{2010}step", "eye-step", "with U+002D instead of U+2010");
        assert!(!look_alike("red", "red"));
        assert!(!look_alike("Red", "red"));
        assert_eq!(LOOK_ALIKES.0.chars().count(), LOOK_ALIKES.1.chars().count());
    }
}
