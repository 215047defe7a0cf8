//! The graph and the message that the README shows are real.

use crate::output::text_of;
use crate::project::Project;

const README: &str = include_str!("../../README.md");
const DOLL: &str = include_str!("../../graphs/doll.ron");

/// Returns the first fenced block of a language.
fn block(language: &str) -> &'static str {
    let (_, rest) = README.split_once(&format!("```{language}\n")).expect("a block");
    let (block, _) = rest.split_once("```").expect("the end of a block");
    block
}

#[test]
fn the_example_is_the_text_of_a_graph() {
    assert_eq!(block("ron"), DOLL);
}

#[test]
fn the_sample_message_is_printed_by_check() {
    let wrong = DOLL.replace(r#"Label(mask: "red""#, r#"Label(mask: "scan.color""#);
    assert_ne!(wrong, DOLL);
    let project = Project::with_files(&[("graphs/doll.ron", &wrong)]);
    let printed = text_of(&project.maquette(&["check", "graphs/doll.ron"]));
    assert!(printed.contains(block("text")), "{printed}");
}

#[test]
fn it_has_at_most_7_kilobytes() {
    assert!(README.len() <= 7_000, "{} bytes", README.len());
}
