//! Tests a law of merging. If only one side adds or changes a comment, the result contains that comment exactly once. The comments are at
//! random positions in all graphs, and the other side makes random edits. The environment variable `LAW_EDITS` sets the number of edits,
//! and `PROPTEST_RNG_SEED` sets the seed.

use std::path::Path;
use std::sync::Mutex;

use maquette::{Catalog, Edit, Merge, Options, Source};
use proptest::prelude::*;
use proptest::sample::Index;
use proptest::test_runner::{Config, RngAlgorithm, TestCaseError, TestRng, TestRunner};
use rayon::prelude::*;

use crate::ron_files::ron_files;

/// The number of pairs of edits per graph if `LAW_EDITS` is not set.
const EDITS: u32 = 4;

/// The kind of a token.
#[derive(Clone, Copy, PartialEq)]
enum Piece {
    Comment,
    Number,
    Sign,
    Other,
}

/// Splits a valid text into tokens. Returns the kind, start and end of each.
fn pieces(text: &str) -> Vec<(Piece, usize, usize)> {
    let mut pieces = Vec::new();
    let mut at = 0;
    while let Some(first) = text[at..].chars().next() {
        let rest = &text[at..];
        let quotes =
            rest.strip_prefix('r').map(|rest| rest.len() - rest.trim_start_matches('#').len());
        let raw = quotes.filter(|&count| rest[count + 1..].starts_with('"'));
        let (piece, length) = if rest.starts_with("//") {
            (Piece::Comment, rest.find('\n').unwrap_or(rest.len()))
        } else if rest.starts_with("/*") {
            (Piece::Comment, rest.find("*/").unwrap() + 2)
        } else if let Some(count) = raw {
            let end = format!("\"{}", "#".repeat(count));
            (Piece::Other, rest[count + 2..].find(&end).unwrap() + 2 * count + 3)
        } else if first == '"' {
            let mut escaped = false;
            let end = rest[1..].find(|c| {
                let ends = c == '"' && !escaped;
                escaped = c == '\\' && !escaped;
                ends
            });
            (Piece::Other, end.unwrap() + 2)
        } else if first.is_ascii_digit() {
            let length = rest.find(|c: char| !(c.is_ascii_alphanumeric() || "._+-".contains(c)));
            (Piece::Number, length.unwrap())
        } else if first.is_alphabetic() {
            (Piece::Other, rest.find(|c: char| !(c.is_alphanumeric() || "_-".contains(c))).unwrap())
        } else {
            let is_sign = "([{,)]}".contains(first);
            (if is_sign { Piece::Sign } else { Piece::Other }, first.len_utf8())
        };
        pieces.push((piece, at, at + length));
        at += length;
    }
    pieces
}

/// Returns the text with a new or changed comment that contains `word`.
fn add_comment(text: &str, word: &str, [what, place, form]: &[Index; 3]) -> String {
    let pieces = pieces(text);
    let comments: Vec<_> = pieces.iter().filter(|it| it.0 == Piece::Comment).collect();
    if what.index(3) == 0 && !comments.is_empty() {
        let (_, start, _) = place.get(&comments);
        return format!("{} {word}{}", &text[..start + 2], &text[start + 2..]);
    }
    let signs: Vec<_> = pieces.iter().filter(|it| it.0 == Piece::Sign).collect();
    let (_, start, end) = **place.get(&signs);
    let at = if ")]}".contains(&text[start..end]) { start } else { end };
    let comment = match form.index(3) {
        0 => format!(" /* {word} */ "),
        1 => format!(" // {word}\n"),
        _ => format!("\n        // {word}\n        "),
    };
    format!("{}{comment}{}", &text[..at], &text[at..])
}

/// The parts of a text that a random edit does not change.
#[derive(Clone, Copy, PartialEq)]
enum Leaves {
    /// All comments keep their positions, so merging must not cause a conflict.
    Places,
    /// All comments are kept, but may be moved.
    Comments,
    /// Everything is kept, except for a removed node and its comments.
    Rest,
}

/// Makes a random edit: changes a number, renames a node, formats the text, or removes a node.
fn edit_randomly(
    path: &Path,
    text: &str,
    [what, place]: &[Index; 2],
    catalog: &Catalog,
) -> (String, Leaves) {
    let pieces = pieces(text);
    // Any number can be changed, except the value of the field `format`.
    let is_free =
        |it: &&(Piece, usize, usize)| it.0 == Piece::Number && !text[..it.1].ends_with("format: ");
    let numbers: Vec<_> = pieces.iter().filter(is_free).collect();
    let names: Vec<_> = pieces
        .iter()
        .filter(|it| {
            text[it.1..it.2].starts_with('"')
                && text[it.2..]
                    .strip_prefix(": ")
                    .is_some_and(|rest| rest.starts_with(char::is_uppercase))
        })
        .collect();
    let by = |edit: fn(String) -> Edit| {
        let name = (!names.is_empty()).then(|| place.get(&names));
        let edit = edit(name.map_or_else(String::new, |it| text[it.1 + 1..it.2 - 1].to_owned()));
        let edited = maquette::edit::edit(path, text, &[edit], catalog, &Options::default());
        edited.map_or_else(|_| text.to_owned(), |edited| edited.text)
    };
    match what.index(12) {
        0 => (text.replace('\n', "\r\n"), Leaves::Places),
        1 => (text.replace("\n    ", "\n  "), Leaves::Places),
        2 => (maquette::edit::format_text(path, text).unwrap(), Leaves::Comments),
        3 => {
            let short = maquette::edit::minimal(path, text, catalog, &Options::default());
            (short.unwrap(), Leaves::Comments)
        }
        4 => (by(|from| Edit::Rename { to: format!("{from}-2"), from }), Leaves::Places),
        5 => (by(|name| Edit::Remove { name, and_links: true }), Leaves::Rest),
        _ if numbers.is_empty() => (text.to_owned(), Leaves::Places),
        _ => {
            let (_, start, end) = **place.get(&numbers);
            (format!("{}7{}", &text[..start], &text[end..]), Leaves::Places)
        }
    }
}

fn merge(path: &Path, texts: [&str; 3], catalog: &Catalog) -> Merge {
    let sources = texts.map(|text| Source { name: path.to_owned(), text: text.to_owned() });
    maquette::edit::merge(path, sources.each_ref(), catalog)
}

/// Checks that two texts have the same comments, in any order.
fn same_comments(text: &str, other: &str) -> Result<(), TestCaseError> {
    fn comments(text: &str) -> Vec<String> {
        let all = pieces(text).into_iter().filter(|it| it.0 == Piece::Comment);
        let mut all: Vec<_> = all.map(|it| text[it.1..it.2].trim_end().to_owned()).collect();
        all.sort_unstable();
        all
    }
    prop_assert_eq!(comments(text), comments(other));
    Ok(())
}

type Dice = ([Index; 3], [Index; 2], bool);

fn one_comments_and_the_other_edits(
    path: &Path,
    base: &str,
    (comment, edit, is_ours): &Dice,
    catalog: &Catalog,
) -> Result<(), TestCaseError> {
    let with_comment = add_comment(base, "NEW", comment);
    let (edited, leaves) = edit_randomly(path, base, edit, catalog);
    let (ours, theirs) = match is_ours {
        true => (&with_comment, &edited),
        false => (&edited, &with_comment),
    };
    let merged = merge(path, [base, ours, theirs], catalog);
    let told = || format!("ours:\n{ours}\ntheirs:\n{theirs}\nmerged:\n{}", merged.text);
    let count = merged.text.matches("NEW").count();
    prop_assert!(count >= 1, "it is gone\n{}", told());
    let is_agreed = merged.conflicts.is_empty();
    prop_assert!(is_agreed || leaves != Leaves::Places, "{:?}\n{}", merged.conflicts, told());
    prop_assert!(count == 1 || !is_agreed, "{count} times\n{}", told());
    if is_agreed && leaves != Leaves::Rest {
        same_comments(&with_comment, &merged.text)?;
    }
    Ok(())
}

fn both_comment(
    path: &Path,
    base: &str,
    (mine, [other, form], is_same): &Dice,
    catalog: &Catalog,
) -> Result<(), TestCaseError> {
    let ours = add_comment(base, "MINE", mine);
    let place = if *is_same { mine } else { &[mine[0], *other, *form] };
    let theirs = add_comment(base, "NEW", place);
    let merged = merge(path, [base, &ours, &theirs], catalog);
    for word in ["MINE", "NEW"] {
        let told = || format!("{word}\nours:\n{ours}\ntheirs:\n{theirs}\nmerged:\n{}", merged.text);
        prop_assert!(merged.text.contains(word), "{}", told());
        prop_assert!(
            !merged.conflicts.is_empty() || merged.text.matches(word).count() == 1,
            "{}",
            told()
        );
    }
    Ok(())
}

/// Tests a law with random edits of all graphs.
fn try_on_all(law: fn(&Path, &str, &Dice, &Catalog) -> Result<(), TestCaseError>) {
    let paths = ron_files(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs"));
    let number =
        |name: &str| std::env::var(name).ok().and_then(|number| number.parse::<u64>().ok());
    let (cases, seed) = (number("LAW_EDITS"), number("PROPTEST_RNG_SEED").unwrap_or(0));
    let broken = Mutex::new(Vec::new());
    paths.par_iter().enumerate().for_each(|(index, path)| {
        let text = std::fs::read_to_string(path).unwrap();
        if !text.contains("Graph(") || path.to_string_lossy().ends_with(".lock.ron") {
            return;
        }
        let catalog = Catalog::new(maquette_nodes::PACKS);
        let config =
            Config { cases: cases.map_or(EDITS, |cases| cases as u32), ..Config::default() };
        let config = Config { failure_persistence: None, max_shrink_iters: 0, ..config };
        let mut bytes = [0; 32];
        bytes[..8].copy_from_slice(&(seed + index as u64).to_le_bytes());
        let rng = TestRng::from_seed(RngAlgorithm::ChaCha, &bytes);
        let mut runner = TestRunner::new_with_rng(config, rng);
        let dice = (any::<[Index; 3]>(), any::<[Index; 2]>(), any::<bool>());
        if let Err(error) = runner.run(&dice, |dice| law(path, &text, &dice, &catalog)) {
            broken.lock().unwrap().push(format!("{}: {error}", path.display()));
        }
    });
    let broken = broken.into_inner().unwrap();
    assert!(
        broken.is_empty(),
        "{} graphs:\n{}",
        broken.len(),
        broken[..broken.len().min(3)].join("\n\n")
    );
}

#[test]
fn a_comment_that_one_side_writes_is_there_once_whatever_the_other_one_edits() {
    try_on_all(one_comments_and_the_other_edits);
}

#[test]
fn comments_that_both_write_are_both_there() {
    try_on_all(both_comment);
}
