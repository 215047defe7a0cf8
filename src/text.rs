//! RON text alone: a file's tree with the place of every value, its lossless tokens, and checks of a value against a schema.

mod cursor;
mod ends;
mod expected;
mod file;
mod help;
mod hyphens;
mod marks;
#[cfg(test)]
mod peer;
mod problems;
mod reader;
mod ron;
mod schema;
mod sheet;
mod shell;
mod steps;
mod suggest;
mod tree;
mod tree_reader;
mod twice;
mod unit;

#[cfg(feature = "cli")]
pub(crate) use cursor::{Cursor, Frame, Passed, TypedKind, cursor, each_word};
pub(crate) use ends::Ends;
pub(crate) use expected::Expected;
pub(crate) use file::{DEEPEST, Mistake, Token, first_word, parse, printed, tokens};
pub(crate) use help::Help;
pub(crate) use problems::syntax_problems;
pub use reader::Reader;
pub(crate) use reader::{FILE, LINK, ReadError, Slots, read_tree};
pub(crate) use ron::{quoted, ron};
pub(crate) use schema::{Finding, FoundFile, FoundLink, Walk, as_tree, check_default};
pub(crate) use sheet::{Sheet, TextPart};
pub(crate) use shell::shell;
pub(crate) use steps::{inside, inside_option, merged, resolve, variants};
#[cfg(test)]
pub(crate) use suggest::tests::LOOKS;
pub(crate) use suggest::{nearest, nearest_or_all, unknown};
pub(crate) use tree::{Body, Field, Given, Kind, Name, Origin, Tree, cut};
pub(crate) use twice::{fields_twice, twice};
pub(crate) use unit::{Quantity, Unit, unit_names};

/// `a Mask`, `an Image`.
pub(crate) fn with_article(word: &str) -> String {
    let vowel = word.starts_with(['A', 'E', 'I', 'O', 'U', 'a', 'e', 'i', 'o', 'u']);
    format!("{} {word}", if vowel { "an" } else { "a" })
}

/// The names of some types, for a message: `Mesh or Surface`.
pub(crate) fn any_of<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    Vec::from_iter(names).join(" or ")
}
