//! Names of tasks: folders that every file system takes.

use std::collections::HashMap;

use maquette_syntax::spelling::file_key;
use maquette_value::Hash;
use unicode_normalization::UnicodeNormalization;
use unicode_normalization::char::is_combining_mark;

/// A name made of values: `{scan}/{growth}_{levels}`.
pub(super) struct Template {
    pieces: Vec<Piece>,
}

enum Piece {
    Text(String),
    /// Which of the values.
    Value(usize),
    /// The number of the task.
    Index,
}

/// What is wrong with a template: where in it, what, and what was meant to be a name, if that is it.
#[derive(Debug, PartialEq)]
pub(super) struct Wrong {
    pub(super) at: usize,
    pub(super) message: String,
    pub(super) unknown: Option<String>,
}

/// Folders and files of a batch itself.
const OWN: [&str; 2] = ["tasks", "index.html"];

/// Longer parts of names are cut.
const LONGEST: usize = 100;

impl Template {
    /// Reads a template of values with these names; `{{` stands for a brace.
    pub(super) fn read(text: &str, names: &[&str]) -> Result<Self, Wrong> {
        fn wrong(at: usize, message: &str) -> Wrong {
            Wrong { at, message: message.to_owned(), unknown: None }
        }
        if let Some(at) = text.find(['\\', ':', '\0']) {
            return Err(wrong(
                at,
                "folders are divided by `/`, and have no `\\` and `:` in their names",
            ));
        }
        let mut at = 0;
        for part in text.split('/') {
            if part.trim().is_empty() || part == "." || part == ".." {
                return Err(wrong(at, "each part of a name between `/` has letters"));
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
                    fn unknown(at: usize, name: &str) -> Wrong {
                        Wrong {
                            unknown: Some(name.to_owned()),
                            ..wrong(at, &format!("nothing in `over` has the name `{name}`"))
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
                '}' => return Err(wrong(at, "`}` closes nothing; `}}` stands for one")),
                c => plain.push(c),
            }
        }
        pieces.push(Piece::Text(plain));
        Ok(Self { pieces })
    }

    /// All values, with `_` between them.
    pub(super) fn of_all(count: usize) -> Self {
        fn gap(index: usize) -> String {
            if index == 0 { String::new() } else { "_".to_owned() }
        }
        let pieces = (0..count).flat_map(|index| [Piece::Text(gap(index)), Piece::Value(index)]);
        Self { pieces: pieces.collect() }
    }

    /// Whether the name tells this one of the values.
    pub(super) fn tells(&self, value: usize) -> bool {
        self.pieces.iter().any(|piece| matches!(piece, Piece::Value(index) if *index == value))
    }

    /// The name of the task of this number with these values.
    pub(super) fn name(&self, index: usize, values: &[String]) -> String {
        let mut name = String::new();
        for piece in &self.pieces {
            match piece {
                Piece::Text(text) => name += text,
                Piece::Value(value) => name += &plain(&values[*value]),
                Piece::Index => name += &index.to_string(),
            }
        }
        let parts = name.split('/').map(safe);
        Vec::from_iter(parts).join("/")
    }
}

/// A value as a part of a name: letters, digits and `.`, `_`, `+`, `-`, with one `-` for what stands between.
fn plain(value: &str) -> String {
    let mut name = String::new();
    let mut has_gap = false;
    // An accent after its letter, as macOS writes names, is no letter: it is joined with it.
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

/// A folder's name that every file system takes.
fn safe(part: &str) -> String {
    const DEVICES: [&str; 4] = ["con", "prn", "aux", "nul"];
    let mut name = String::from_iter(part.chars().map(|c| match c {
        '<' | '>' | '"' | '|' | '?' | '*' => '-',
        c if c.is_control() => '-',
        c => c,
    }));
    if name.len() > LONGEST {
        let hash = Hash::of(name.as_bytes()).to_string();
        let end = (0..=LONGEST - 9).rev().find(|&end| name.is_char_boundary(end)).unwrap_or(0);
        name = format!("{}-{}", &name[..end], &hash[..8]);
    }
    // Windows leaves these out at the end; elsewhere a dot in front hides a folder.
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

/// Two tasks that would be in each other's way, and how.
#[derive(Debug, PartialEq)]
pub(super) enum Clash {
    /// They have one name where neither capital letters nor the form of letters with accents count.
    Same(usize, usize),
    /// The folder of the second lies in that of the first.
    Inside(usize, usize),
    /// A task has the name of what a batch has beside its tasks.
    Own(usize),
}

/// What is wrong with names as a whole.
pub(super) fn clash(names: &[String]) -> Option<Clash> {
    let key = file_key;
    let mut known = HashMap::with_capacity(names.len());
    for (index, name) in names.iter().enumerate() {
        let key = key(name);
        let first = key.split('/').next().unwrap_or_default();
        if OWN.contains(&first) {
            return Some(Clash::Own(index));
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

    fn named(template: &str, values: &[&str]) -> String {
        let template = Template::read(template, &["scan", "growth"]).unwrap();
        template.name(7, &values.iter().map(|value| (*value).to_owned()).collect::<Vec<_>>())
    }

    #[test]
    fn names_are_made_of_values_and_fit_every_file_system() {
        assert_eq!(named("{scan}/{growth}", &["doll", "12.0"]), "doll/12.0");
        assert_eq!(named("{{{growth}}}", &["", "-3"]), "{-3}");
        assert_eq!(named("{index}-{scan}", &["doll", ""]), "7-doll");
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
            assert_eq!(named("{scan}", &[value, ""]), name);
        }
        let long = named("{scan}", &[&"ä".repeat(300), ""]);
        assert!(long.len() <= LONGEST && long.ends_with(|c: char| c.is_ascii_hexdigit()), "{long}");
        assert_ne!(long, named("{scan}", &[&"ä".repeat(301), ""]));
    }

    #[test]
    fn a_template_that_means_nothing_is_told_at_its_place() {
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
    fn tasks_that_are_in_each_others_way_are_found() {
        let clash =
            |names: &[&str]| clash(&names.iter().map(|it| (*it).to_owned()).collect::<Vec<_>>());
        assert_eq!(clash(&["a", "b/c", "b/d"]), None);
        assert_eq!(clash(&["a", "b", "A"]), Some(Clash::Same(0, 2)));
        assert_eq!(clash(&["caf\u{e9}", "Cafe\u{301}"]), Some(Clash::Same(0, 1)));
        assert_eq!(clash(&["a/b", "c", "a"]), Some(Clash::Inside(2, 0)));
        assert_eq!(clash(&["a", "Tasks/b"]), Some(Clash::Own(1)));
        assert_eq!(clash(&["index.html"]), Some(Clash::Own(0)));
    }
}
