//! Edits of graph files. Each edit makes exactly the requested change, or is refused with a reason.

use std::path::Path;
use std::sync::OnceLock;

use expect_test::{Expect, expect};
use maquette::{Catalog, Diagnostic, Difference, Edit, EditedText, Graph, Options, Source};

mod commas;
mod extract;
mod inline;
mod law;
mod links;
mod moves;
mod names;
mod nodes;
mod schemas;
mod sketch;

fn catalog() -> &'static Catalog {
    static CATALOG: OnceLock<Catalog> = OnceLock::new();
    CATALOG.get_or_init(|| Catalog::new(maquette_nodes::PACKS))
}

fn edit(path: &Path, text: &str, edits: &[Edit]) -> Result<EditedText, Vec<Diagnostic>> {
    maquette::edit::edit(path, text, edits, catalog(), &Options::default())
}

fn differences(path: &Path, old: &str, new: &str) -> Vec<Difference> {
    fn source(text: &str, path: &Path) -> Source {
        Source { name: path.to_owned(), text: text.to_owned() }
    }
    Graph::differences(&source(old, path), &source(new, path), catalog()).unwrap()
}

const DOLL: &str = include_str!("../../graphs/doll.ron");

fn add(name: &str, node: &str, fields: &[(&str, &str)], after: Option<&str>) -> Edit {
    let fields = fields.iter().map(|&(field, value)| (field.to_owned(), value.to_owned()));
    let (name, node) = (name.to_owned(), node.to_owned());
    Edit::Add { name, node, fields: fields.collect(), after: after.map(str::to_owned) }
}

fn remove(name: &str, and_links: bool) -> Edit {
    Edit::Remove { name: name.to_owned(), and_links }
}

fn rename(from: &str, to: &str) -> Edit {
    Edit::Rename { from: from.to_owned(), to: to.to_owned() }
}

fn link(port: &str, to: &str) -> Edit {
    Edit::Link { port: port.to_owned(), to: to.to_owned() }
}

fn unlink(port: &str) -> Edit {
    Edit::Unlink { port: port.to_owned() }
}

fn output(name: &str, to: Option<&str>) -> Edit {
    Edit::Output { name: name.to_owned(), to: to.map(str::to_owned) }
}

fn apply_edits(text: &str, edits: &[Edit]) -> Result<String, String> {
    let edited = edit(Path::new("nowhere/graph.ron"), text, edits).map(|edited| edited.text);
    edited.map_err(|problems| {
        problems
            .iter()
            .map(|problem| {
                let place =
                    maquette::Position::from_offset(&problem.source.text, problem.span.start);
                let Diagnostic { code, message, help, .. } = problem;
                format!("{code} {}:{} {message} ({help})", place.line, place.column)
            })
            .collect::<Vec<_>>()
            .join("\n")
    })
}

/// Checks that an edit replaces exactly the given parts of a text, in this order.
#[track_caller]
fn check_edit(text: &str, edit: Edit, replaced: &[(&str, &str)]) {
    let mut expected = text.to_owned();
    for (old, new) in replaced {
        assert!(expected.contains(old), "{old}");
        expected = expected.replacen(old, new, 1);
    }
    assert_eq!(apply_edits(text, &[edit]), Ok(expected));
}

#[track_caller]
fn check_refused(text: &str, edit: Edit, expected: Expect) {
    expected.assert_eq(&apply_edits(text, &[edit]).unwrap_err());
}

#[test]
fn outputs_are_added_changed_and_taken_away() {
    let last = "        \"nose-mask.png\": \"red\",\n";
    let edges = "        \"skin.ply\": \"skin\",\n";
    check_edit(DOLL, output("skin.ply", Some("skin")), &[(last, &[last, edges].concat())]);
    check_edit(
        DOLL,
        output("model.ply", Some("skin")),
        &[("\"model.ply\": \"model\"", "\"model.ply\": \"skin\"")],
    );
    check_edit(DOLL, output("nose-mask.png", None), &[(last, "")]);
    check_refused(
        DOLL,
        output("skin.png", Some("net")),
        expect![
            "G015 39:9 a ControlNet cannot be written to a `.png` file (a ControlNet can be written to: json, ply)"
        ],
    );
    check_refused(
        DOLL,
        output("skin", Some("skin")),
        expect![
            "G015 39:9 output `skin` has no extension that determines how to write a Mesh (a Mesh can be written to: 3mf, glb, obj, ply, png, stl)"
        ],
    );
    check_refused(
        DOLL,
        output("model.obj", None),
        expect!["G007 1:1 the graph has no output `model.obj` (did you mean `model.glb`?)"],
    );
}

#[test]
fn edits_that_are_right_together_are_done_together() {
    let fields = [("mask", "blue")];
    let select = [("image", "scan.color"), ("select", "Otsu")];
    let edits = [
        add("dots", "Label", &fields, None),
        add("blue", "Threshold", &select, Some("red")),
        output("dots.png", Some("dots")),
    ];
    assert!(apply_edits(DOLL, &edits[..1]).is_err());
    let text = apply_edits(DOLL, &edits).unwrap();
    let found = differences(Path::new("nowhere/graph.ron"), DOLL, &text);
    let found = found.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
    expect![[r#"
        node blue: added: Threshold(image: "scan", select: Otsu())
        node dots: added: Label(mask: "blue")
        output dots.png: added: "dots""#]]
    .assert_eq(&found);
}

#[test]
fn a_patch_has_no_nodes_to_edit() {
    let patch = "Patch(format: 1, of: \"doll.ron\", params: { \"growth\": 3.0 })";
    check_refused(
        patch,
        rename("growth", "far"),
        expect![
            "G001 1:1 a patch has values of nodes, but no nodes of its own (edit the graph that it is `of`; values of a patch can be set)"
        ],
    );
}
