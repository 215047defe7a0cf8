//! Names of tasks. Each is a valid folder name on every file system.

use std::collections::HashMap;

use maquette_syntax::spelling::file_key;
use maquette_value::Hash;
use unicode_normalization::UnicodeNormalization;
use unicode_normalization::char::is_combining_mark;

/// A template for the names of tasks, such as `{scan}/{growth}_{levels}`.
pub(super) struct Template {
    pieces: Vec<Piece>,
}

enum Piece {
    Text(String),
    /// The value with this index in the row of the task.
    Value(usize),
    /// The index of the task among the tasks of the sweep.
    Index,
}

/// An error in a template: its offset, its message, and the unknown name if that is the error.
#[derive(Debug, PartialEq)]
pub(super) struct TemplateError {
    pub(super) at: usize,
    pub(super) message: String,
    pub(super) unknown: Option<String>,
}

/// The names of folders and files that the batch itself writes.
const RESERVED: [&str; 2] = ["tasks", "index.html"];

/// The maximum length of a part of a name, in bytes. Longer parts are cut.
const MAX_PART_BYTES: usize = 100;

impl Template {
    /// Parses a template. `names` are the names of the values that it can contain. `{{` stands for a brace.
    pub(super) fn read(text: &str, names: &[&str]) -> Result<Self, TemplateError> {
        fn wrong(at: usize, message: &str) -> TemplateError {
            TemplateError { at, message: message.to_owned(), unknown: None }
        }
        if let Some(at) = text.find(['\\', ':', '\0']) {
            return Err(wrong(at, "expected folder names without `\\` and `:`, separated by `/`"));
        }
        let mut at = 0;
        for part in text.split('/') {
            if part.trim().is_empty() || part == "." || part == ".." {
                return Err(wrong(at, "expected a name between `/`"));
            }
            at += part.len() + 1;
        }
        let (mut pieces, mut plain, mut rest) = (Vec::new(), String::new(), text);
        while let Some(c) = rest.chars().next() {
            let at = text.len() - rest.len();
            rest = &rest[c.len_utf8()..];
            match c {
                '{' | '}' if rest.starts_with(c) => {
                    plain.push(c);
                    rest = &rest[1..];
                }
                '{' => {
                    let (name, behind) =
                        rest.split_once('}').ok_or_else(|| wrong(at, "`{` is not closed"))?;
                    let index = names.iter().position(|known| *known == name);
                    fn unknown(at: usize, name: &str) -> TemplateError {
                        TemplateError {
                            unknown: Some(name.to_owned()),
                            ..wrong(at, &format!("unknown name `{name}` in `over`"))
                        }
                    }
                    pieces.push(Piece::Text(std::mem::take(&mut plain)));
                    pieces.push(match index {
                        Some(index) => Piece::Value(index),
                        None if name == "index" => Piece::Index,
                        None => return Err(unknown(at, name)),
                    });
                    rest = behind;
                }
                '}' => return Err(wrong(at, "unmatched `}`; use `}}` for a brace")),
                c => plain.push(c),
            }
        }
        pieces.push(Piece::Text(plain));
        Ok(Self { pieces })
    }

    /// Creates a template that contains all `count` values, joined by `_`.
    pub(super) fn of_all(count: usize) -> Self {
        fn gap(index: usize) -> String {
            if index == 0 { String::new() } else { "_".to_owned() }
        }
        let pieces = (0..count).flat_map(|index| [Piece::Text(gap(index)), Piece::Value(index)]);
        Self { pieces: pieces.collect() }
    }

    /// Returns true if the template contains the value with this index.
    pub(super) fn contains(&self, value: usize) -> bool {
        self.pieces.iter().any(|piece| matches!(piece, Piece::Value(index) if *index == value))
    }

    /// Returns the name of the task with this index and values.
    pub(super) fn name(&self, index: usize, values: &[String]) -> String {
        let mut name = String::new();
        for piece in &self.pieces {
            match piece {
                Piece::Text(text) => name += text,
                Piece::Value(value) => name += &value_as_name(&values[*value]),
                Piece::Index => name += &index.to_string(),
            }
        }
        let parts = name.split('/').map(portable_name);
        Vec::from_iter(parts).join("/")
    }
}

/// Converts a value to a part of a name. Letters, digits, `.`, `_`, `+` and `-` are kept. Each run of other characters becomes one `-`.
fn value_as_name(value: &str) -> String {
    let mut name = String::new();
    let mut has_gap = false;
    // Convert the text to its composed form (Unicode NFC) first. In the decomposed form, which macOS uses for file names, an accent is not
    // a letter.
    for c in value.nfc() {
        if c.is_alphanumeric() || is_combining_mark(c) || ".+-_".contains(c) {
            if std::mem::take(&mut has_gap) && !name.is_empty() {
                name.push('-');
            }
            name.push(c);
        } else {
            has_gap = true;
        }
    }
    if name.is_empty() { "empty".to_owned() } else { name }
}

/// Converts a part of a name to a folder name that is valid on every file system.
fn portable_name(part: &str) -> String {
    const DEVICES: [&str; 4] = ["con", "prn", "aux", "nul"];
    let mut name = String::from_iter(part.chars().map(|c| match c {
        '<' | '>' | '"' | '|' | '?' | '*' => '-',
        c if c.is_control() => '-',
        c => c,
    }));
    if name.len() > MAX_PART_BYTES {
        let hash = Hash::compute(name.as_bytes()).to_string();
        let end =
            (0..=MAX_PART_BYTES - 9).rev().find(|&end| name.is_char_boundary(end)).unwrap_or(0);
        name = format!("{}-{}", &name[..end], &hash[..8]);
    }
    // Windows drops dots and spaces at the end of a name. On other systems, a dot at the start hides a folder.
    let trimmed = name.trim_end_matches(['.', ' ']).trim_start_matches(' ').to_owned();
    let name = if trimmed.is_empty() || trimmed.starts_with('.') {
        format!("_{trimmed}")
    } else {
        trimmed
    };
    let stem = name.split('.').next().unwrap_or_default().to_lowercase();
    let is_port = ["com", "lpt"].iter().any(|port| {
        stem.strip_prefix(port)
            .is_some_and(|nth| nth.len() == 1 && nth.starts_with(|c: char| c.is_ascii_digit()))
    });
    if is_port || DEVICES.contains(&&stem[..]) { format!("{name}_") } else { name }
}

/// A conflict between the names of tasks.
#[derive(Debug, PartialEq)]
pub(super) enum Clash {
    /// The names of two tasks, given by index, are equal if upper case and the encoding of accents are ignored.
    Same(usize, usize),
    /// The folder of the second task would be inside of the folder of the first.
    Inside(usize, usize),
    /// A task has a name that the batch itself uses for a file or folder.
    Reserved(usize),
}

/// Returns the first conflict between the names of tasks, or `None`.
pub(super) fn find_clash(names: &[String]) -> Option<Clash> {
    let key = file_key;
    let mut known = HashMap::with_capacity(names.len());
    for (index, name) in names.iter().enumerate() {
        let key = key(name);
        let first = key.split('/').next().unwrap_or_default();
        if RESERVED.contains(&first) {
            return Some(Clash::Reserved(index));
        }
        if let Some(other) = known.insert(key, index) {
            return Some(Clash::Same(other, index));
        }
    }
    names.iter().enumerate().find_map(|(index, name)| {
        let key = key(name);
        let outer = key.match_indices('/').find_map(|(at, _)| known.get(&key[..at]).copied());
        Some(Clash::Inside(outer?, index))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name_of(template: &str, values: &[&str]) -> String {
        let template = Template::read(template, &["scan", "growth"]).unwrap();
        template.name(7, &values.iter().map(|value| (*value).to_owned()).collect::<Vec<_>>())
    }

    #[test]
    fn names_are_valid_on_every_file_system() {
        assert_eq!(name_of("{scan}/{growth}", &["doll", "12.0"]), "doll/12.0");
        assert_eq!(name_of("{{{growth}}}", &["", "-3"]), "{-3}");
        assert_eq!(name_of("{index}-{scan}", &["doll", ""]), "7-doll");
        for (value, name) in [
            ("mm(0.4)", "mm-0.4"),
            ("(1, -2.5, 3)", "1--2.5-3"),
            ("#c33923", "c33923"),
            ("CON", "CON_"),
            ("com1.x", "com1.x_"),
            ("..", "_"),
            (".hidden", "_.hidden"),
            ("a/../b", "a-..-b"),
            ("über", "über"),
            ("Mu\u{308}ller", "Müller"),
            ("q\u{323}\u{307}", "q\u{323}\u{307}"),
            ("", "empty"),
            ("\u{202e}/\n", "empty"),
            ("end.", "end"),
        ] {
            assert_eq!(name_of("{scan}", &[value, ""]), name);
        }
        let long = name_of("{scan}", &[&"ä".repeat(300), ""]);
        assert!(
            long.len() <= MAX_PART_BYTES && long.ends_with(|c: char| c.is_ascii_hexdigit()),
            "{long}"
        );
        assert_ne!(long, name_of("{scan}", &[&"ä".repeat(301), ""]));
    }

    #[test]
    fn invalid_templates_are_reported_at_their_position() {
        fn wrong(template: &str) -> (usize, String) {
            let wrong = Template::read(template, &["scan"]).err().unwrap();
            (wrong.at, wrong.message)
        }
        for (template, at) in [
            ("{scan", 0),
            ("a}", 1),
            ("{scna}", 0),
            ("/a", 0),
            ("a//b", 2),
            ("a/../b", 2),
            ("c:/b", 1),
            ("", 0),
        ] {
            assert_eq!(wrong(template).0, at, "{template}: {}", wrong(template).1);
        }
    }

    #[test]
    fn clashing_task_names_are_found() {
        fn clash(names: &[&str]) -> Option<Clash> {
            find_clash(&names.iter().map(|it| (*it).to_owned()).collect::<Vec<_>>())
        }
        assert_eq!(clash(&["a", "b/c", "b/d"]), None);
        assert_eq!(clash(&["a", "b", "A"]), Some(Clash::Same(0, 2)));
        assert_eq!(clash(&["caf\u{e9}", "Cafe\u{301}"]), Some(Clash::Same(0, 1)));
        assert_eq!(clash(&["a/b", "c", "a"]), Some(Clash::Inside(2, 0)));
        assert_eq!(clash(&["a", "Tasks/b"]), Some(Clash::Reserved(1)));
        assert_eq!(clash(&["index.html"]), Some(Clash::Reserved(0)));
    }
}
