//! Values that are set from outside of a graph (by `--set`, a patch or an edit) can use the former names of fields.

use std::path::Path;

use maquette::{Catalog, CheckedGraph, Files, Graph, Hash, Options, Severity};

use super::migrations::{OLD_NAMES, graph_of_nodes};

fn catalog() -> Catalog {
    Catalog::new(&[maquette_nodes::PACKS, &[&OLD_NAMES]].concat())
}

fn options(set: &[(&str, &str)]) -> Options {
    let set = set.iter().map(|(target, value)| ((*target).into(), (*value).into())).collect();
    Options { files: Files::Ignored, set, ..Options::default() }
}

fn identity(checked: CheckedGraph) -> Hash {
    let warned = |it: &maquette::Diagnostic| (it.severity, it.code) == (Severity::Warning, "G032");
    assert!(checked.diagnostics.iter().all(warned), "{:?}", checked.diagnostics);
    checked.graph.unwrap().identity()
}

/// Assignments of a value to a field, by its former and by its present name. Each is a target and a value.
const PUTS: [[(&str, &str); 2]; 7] = [
    [("one.gap", "0.8"), ("one.jump", "8.0")],
    [("two.step", "0.9"), ("two.jump", "0.9")],
    [("four.gap", "Expr(\"cm\")"), ("four.jump", "Expr(\"(cm) * 10\")")],
    [("five.gap.draft", "0.5"), ("five.jump.draft", "5.0")],
    [("red.how.distance", "9.0"), ("red.select.distance", "9.0")],
    [("skin.scheme", "Triangles"), ("skin.scheme", "Loop")],
    [("loop.levels", "2"), ("loop.levels", "2")],
];

#[test]
fn a_value_that_is_set_goes_to_the_field_that_it_names_whatever_it_is_called() {
    let catalog = catalog();
    fn load(now: bool, set: &[(&str, &str)], catalog: &Catalog) -> CheckedGraph {
        let text = graph_of_nodes(now);
        Graph::load_text("graph.ron".as_ref(), text, catalog, &options(set))
    }
    let old = PUTS.map(|put| put[0]);
    let new = PUTS.map(|put| put[1]);
    let expected = identity(load(true, &new, &catalog));
    assert_ne!(expected, identity(load(true, &[], &catalog)));
    for [old, new] in PUTS {
        assert_eq!(
            identity(load(true, &[old], &catalog)),
            identity(load(true, &[new], &catalog)),
            "{old:?}"
        );
    }
    for (now, set) in [(true, old), (false, old), (false, new)] {
        assert_eq!(identity(load(now, &set, &catalog)), expected, "{now} {set:?}");
    }
    let told = load(true, &old, &catalog).diagnostics;
    let told: Vec<_> = told.iter().map(|it| format!("{} ({})", it.message, it.help)).collect();
    expect_test::expect![[r#"
        --set one.gap=0.8: field `gap` of Triangulate is called `step` now (set `one.jump`, with the migrated value)
        --set one.gap=0.8: field `step` of Triangulate is called `jump` now (set `one.jump`, with the migrated value)
        --set two.step=0.9: field `step` of Triangulate is called `jump` now (set `two.jump`, with the migrated value)
        --set four.gap=Expr("cm"): field `gap` of Triangulate is called `step` now (set `four.jump`, with the migrated value)
        --set four.gap=Expr("cm"): field `step` of Triangulate is called `jump` now (set `four.jump`, with the migrated value)
        --set five.gap.draft=0.5: field `gap` of Triangulate is called `step` now (set `five.jump.draft`, with the migrated value)
        --set five.gap.draft=0.5: field `step` of Triangulate is called `jump` now (set `five.jump.draft`, with the migrated value)
        --set red.how.distance=9.0: field `how` of Threshold is called `select` now (set `red.select.distance`, with the migrated value)
        --set skin.scheme=Triangles: field `scheme` of Subdivide is written differently now (set `skin.scheme`, with the migrated value)"#]].assert_eq(&told.join("\n"));
}

#[test]
fn a_patch_means_what_it_meant_whichever_of_both_files_has_the_old_names() {
    let catalog = catalog();
    let folder = tempfile::tempdir().unwrap();
    let old = r##"// Other values.
Patch(
    of: "base.ron",
    nodes: {
        "one": (gap: 0.8), // cm
        "four": (gap: Expr("cm")),
        "red": (how: Close(color: "#000000", distance: 1.0)),
        "red.how": (distance: 9.0),
        "skin": (scheme: Triangles, levels: 2),
    },
)
"##;
    let new = old
        .replace("gap: 0.8", "jump: 8.0")
        .replace("gap: Expr(\"cm\")", "jump: Expr(\"(cm) * 10\")")
        .replace("how: Close", "select: Near")
        .replace("red.how", "red.select")
        .replace("Triangles", "Loop");
    let path = folder.path().join("patch.ron");
    fn load(
        now: bool,
        patch: &str,
        folder: &tempfile::TempDir,
        path: &Path,
        catalog: &Catalog,
    ) -> Hash {
        std::fs::write(folder.path().join("base.ron"), graph_of_nodes(now)).unwrap();
        let options = options(&[]);
        identity(Graph::load_text(path, patch.to_owned(), catalog, &options))
    }
    let expected = load(true, &new, &folder, &path, &catalog);
    for (now, patch) in [(true, old), (false, old), (false, &new)] {
        assert_eq!(load(now, patch, &folder, &path, &catalog), expected, "{now} {patch}");
        assert_eq!(Graph::migrate(&path, patch, &catalog).unwrap(), new, "{now}");
    }
}

#[test]
fn an_edit_under_an_old_name_changes_the_field_that_it_names() {
    let catalog = catalog();
    fn set_value(
        now: bool,
        target: &str,
        value: &str,
        catalog: &Catalog,
    ) -> (String, maquette::ValueChange) {
        let (text, set) = (graph_of_nodes(now), [(target.to_owned(), value.to_owned())]);
        let edited =
            maquette::edit::set_values(Path::new("graph.ron"), &text, &set, catalog, &options(&[]))
                .unwrap();
        let line = edited.text.lines().find(|line| line.contains("\"one\":")).unwrap();
        (line.trim().to_owned(), edited.changes[0].clone())
    }
    let expected = r#""one": Triangulate(range: "scan.range", jump: 8.0),"#;
    for (now, target, value) in
        [(true, "one.gap", "0.8"), (false, "one.gap", "0.8"), (false, "one.jump", "8.0")]
    {
        let (line, put) = set_value(now, target, value, &catalog);
        assert_eq!(line, expected, "{now} {target}");
        assert_eq!((&put.target[..], put.before.as_deref()), ("one.jump", Some("6.0")));
    }
    // All nodes other than the edited one must stay unchanged, even those with former names.
    assert!(set_value(false, "red.how.distance", "9.0", &catalog).0.contains("Grid("));
}
