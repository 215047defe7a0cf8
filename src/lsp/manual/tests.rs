//! Tests that the manual is complete: every file is a topic, `docs/language.md` contains all topics, and every keyword is documented.

use std::path::Path;

use expect_test::expect_file;
use maquette_graph::Word;
use maquette_syntax::{Body, Kind, Tree, parse};

use super::*;

#[test]
fn every_file_of_the_folder_is_a_topic() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("manual");
    let files = std::fs::read_dir(folder).unwrap().map(|file| file.unwrap().path());
    let pages = files.filter(|path| path.extension().is_some_and(|ending| ending == "md"));
    let mut pages: Vec<_> = pages.map(|path| path.file_stem().unwrap().to_owned()).collect();
    let mut topics: Vec<_> = TOPICS.iter().map(|topic| topic.name).collect();
    pages.sort();
    topics.sort_unstable();
    assert_eq!(topics, pages, "`TOPICS` in src/lsp/manual.rs lists them");
    for topic in TOPICS {
        assert!(topic.text.starts_with("# "), "{} begins with its title", topic.name);
        assert_eq!(topic.text.matches("```").count() % 2, 0, "{}: a fence is open", topic.name);
    }
}

/// With `UPDATE_EXPECT=1`, this test writes `docs/language.md` instead of comparing it.
#[test]
fn the_page_is_made_of_the_topics() {
    expect_file!["../../../docs/language.md"].assert_eq(&page());
}

fn page() -> String {
    let mut page =
        "# The language of graphs\n\nAlso printed by `maquette help TOPIC`, one topic at a time. \
        Generated from `src/lsp/manual/`; `UPDATE_EXPECT=1` in its test writes it again.\n\n"
            .to_owned();
    for topic in TOPICS {
        let title = topic.text.lines().next().unwrap().trim_start_matches("# ");
        page += &format!("- [{title}](#{}): `{}`\n", anchor(title), topic.name);
    }
    for topic in TOPICS {
        page.push('\n');
        let mut is_sample = false;
        for line in topic.text.lines() {
            is_sample ^= line.starts_with("```");
            let deeper = if line.starts_with('#') && !is_sample { "#" } else { "" };
            page += &format!("{deeper}{line}\n");
        }
    }
    page
}

/// Returns the anchor (the link target) that a Markdown title gets.
fn anchor(title: &str) -> String {
    title
        .chars()
        .filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'))
        .map(|c| if c == ' ' { '-' } else { c.to_ascii_lowercase() })
        .collect()
}

/// A word of a code sample, with the names of the calls and fields around it, from the outermost one. For example, `min` is in `Number` in
/// `params` in `Graph`.
type Use = (Vec<String>, String);

#[test]
fn every_word_of_the_language_has_a_sentence_and_a_sample() {
    fn belongs_to_topic(topic: &&Topic) -> bool {
        maquette_graph::words().iter().any(|word| word.topic == topic.name)
    }
    let mut lacking = Vec::new();
    let words = maquette_graph::words().into_iter().chain(maquette_golden::words());
    let words = words.chain(maquette_golden::sweep::words());
    for word in words {
        let about: Vec<_> = TOPICS
            .iter()
            .filter(|topic| topic.name == word.topic || !belongs_to_topic(topic))
            .collect();
        let forms = [format!("`{}`", word.name), format!("`{}(", word.name)];
        fn documents(topic: &&Topic, forms: &[String; 2]) -> bool {
            forms.iter().any(|form| prose(topic.text).contains(form))
        }
        if !about.iter().copied().any(|topic| documents(&topic, &forms)) {
            lacking.push(format!(
                "no sentence has `{}` of {}: {}.md",
                word.name, word.within, word.topic
            ));
        }
        if !about.iter().any(|topic| uses(topic.text).iter().any(|used| is_used(&word, used))) {
            lacking.push(format!(
                "no sample has `{}` of {}: {}.md",
                word.name, word.within, word.topic
            ));
        }
    }
    assert!(lacking.is_empty(), "{}", lacking.join("\n"));
}

fn is_used(word: &Word, (around, name): &Use) -> bool {
    let is_anywhere = word.within.is_empty();
    *name == word.name
        && (is_anywhere || around.iter().rev().take(2).any(|around| *around == word.within))
}

/// Removes the code samples from a text.
fn prose(text: &str) -> String {
    text.split("```").step_by(2).collect()
}

/// Returns all words in the code samples of a topic.
fn uses(text: &str) -> Vec<Use> {
    let mut uses = Vec::new();
    for sample in text.split("```ron\n").skip(1) {
        let (tree, mistakes) = parse(sample.split("```").next().unwrap_or_default());
        assert_eq!(mistakes, [], "{sample}");
        collect(&tree, &mut Vec::new(), &mut uses);
    }
    uses
}

fn collect(tree: &Tree, around: &mut Vec<String>, uses: &mut Vec<Use>) {
    let depth = around.len();
    match &tree.kind {
        Kind::Word(word) => uses.push((around.clone(), word.clone())),
        Kind::List(items) => items.iter().for_each(|item| collect(item, around, uses)),
        Kind::Map(entries) => entries.iter().for_each(|(_, value)| collect(value, around, uses)),
        Kind::Call { name, body } => {
            if let Some(name) = name {
                uses.push((around.clone(), name.text.clone()));
                around.push(name.text.clone());
            }
            match body {
                Body::Empty => {}
                Body::Items(items) => items.iter().for_each(|item| collect(item, around, uses)),
                Body::Fields(fields) => {
                    for field in fields {
                        uses.push((around.clone(), field.name.text.clone()));
                        around.push(field.name.text.clone());
                        collect(&field.value, around, uses);
                        around.pop();
                    }
                }
            }
        }
        // Add the functions of an expression: the words before its parentheses.
        Kind::Text(text) if around.last().is_some_and(|around| around == "Expr") => {
            let words = text.split('(').map(|before| before.rsplit(|c: char| !c.is_alphanumeric()));
            let words = words.filter_map(|mut words| words.next().map(str::to_owned));
            uses.extend(words.map(|word| (around.clone(), word)));
        }
        _ => {}
    }
    around.truncate(depth);
}
