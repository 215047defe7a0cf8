//! Tests the fixes of diagnostics that have only one possible fix. Each fix removes its own diagnostic and causes no other.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use maquette::{Catalog, Diagnostic, Graph, Options};

use crate::beside::shared_folder;

fn problems(path: &Path, text: &str, catalog: &Catalog) -> Vec<Diagnostic> {
    let options = Options { pins: true, ..Options::default() };
    let checked = Graph::load_text(path, text.to_owned(), catalog, &options);
    let unused = checked.graph.as_ref().map(Graph::unused_warnings).unwrap_or_default();
    [&checked.diagnostics[..], unused].concat()
}

/// Returns true if the diagnostic `shown` could be reported only after `by` was fixed. Missing fields are known only after the type of the
/// node is, and the target of a name only after that name is right.
fn was_hidden(shown: &Diagnostic, by: &Diagnostic) -> bool {
    let is_carried = by.message.ends_with(" to carry");
    by.code == "G003" && shown.code == "G005" || is_carried && shown.code == "G007"
}

/// Counts the occurrences of each diagnostic.
fn count_diagnostics(problems: &[Diagnostic]) -> BTreeMap<(&str, &str), i32> {
    let mut told = BTreeMap::new();
    problems.iter().for_each(|it| *told.entry((it.code, &it.message[..])).or_insert(0) += 1);
    told
}

/// Returns the graph files of a folder.
fn graphs(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut paths: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| {
        let name = path.to_string_lossy();
        name.ends_with(".ron") && !name.ends_with(".pins.ron")
    });
    paths.sort();
    paths
}

#[test]
fn each_fix_makes_its_problem_go_away_and_brings_no_other() {
    let catalog = Catalog::new(maquette_nodes::PACKS);
    let root = &Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let shared = shared_folder("graphs/bad").map_or_else(Vec::new, |folder| graphs(&folder));
    let own = graphs(&root.join("tests/bad"));
    assert!(!own.is_empty());
    let mut fixes = 0;
    for path in own.iter().chain(&shared) {
        let text = std::fs::read_to_string(path).unwrap();
        let before = problems(path, &text, &catalog);
        for problem in before.iter().filter(|problem| !problem.fix.is_empty()) {
            let fixed = problem.apply_fix().expect("the edits fit into the text");
            let now = problems(path, &fixed, &catalog);
            let mut expected = count_diagnostics(&before);
            *expected.get_mut(&(problem.code, &problem.message[..])).unwrap() -= 1;
            let shown = now.iter().filter(|it| !was_hidden(it, problem));
            for (what, count) in count_diagnostics(&shown.cloned().collect::<Vec<_>>()) {
                let before = expected.get(&what).copied().unwrap_or_default();
                let name = path.display();
                assert!(count <= before, "{name}: {}: {what:?}\n{fixed}", problem.message);
            }
            fixes += 1;
        }
    }
    assert!(fixes >= 15, "only {fixes} fixes");
}

/// Applies all fixes to a text. Returns the fixed text, and the messages of the fixed diagnostics.
fn apply_fixes(text: &str) -> (String, Vec<String>) {
    let catalog = Catalog::new(maquette_nodes::PACKS);
    let folder = tempfile::tempdir().unwrap();
    let mesh = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    std::fs::write(folder.path().join("doll.obj"), mesh).unwrap();
    let path = folder.path().join("graph.ron");
    std::fs::write(&path, text).unwrap();
    let (fixed, mended) = maquette::edit::apply_fixes(&path, text, &catalog, &Options::default());
    (fixed, mended.into_iter().map(|problem| problem.message).collect())
}

/// Returns a graph that contains the additional node `node`.
fn graph(node: &str) -> String {
    format!(
        "Graph(\n    format: 1,\n    nodes: {{\n        \"doll\": ReadMesh(path: \"doll.obj\"),\n        {node}\n    }},\n    outputs: {{ \"end.ply\": \"end\" }},\n)\n"
    )
}

#[test]
fn what_has_one_answer_is_put_right() {
    for (wrong, right) in [
        // Misspelled names: of types, fields, variants, links, outputs and files.
        (
            r#""end": Subdivde(mesh: "doll", scheme: Loop),"#,
            r#""end": Subdivide(mesh: "doll", scheme: Loop),"#,
        ),
        (
            r#""end": Subdivide(mseh: "doll", scheme: Loop),"#,
            r#""end": Subdivide(mesh: "doll", scheme: Loop),"#,
        ),
        (
            r#""end": Subdivide(mesh: "doll", scheme: Lop),"#,
            r#""end": Subdivide(mesh: "doll", scheme: Loop),"#,
        ),
        (
            r#""end": Subdivide(mesh: "dol", scheme: Loop),"#,
            r#""end": Subdivide(mesh: "doll", scheme: Loop),"#,
        ),
        (
            r#""end": Subdivide(mesh: "doll.shape", scheme: Loop),"#,
            r#""end": Subdivide(mesh: "doll.mesh", scheme: Loop),"#,
        ),
        (r#""end": ReadMesh(path: "dol.obj"),"#, r#""end": ReadMesh(path: "doll.obj"),"#),
        // Missing commas, and missing parentheses whose position follows from the line breaks.
        (
            r#""end": Subdivide(mesh: "doll" scheme: Loop),"#,
            r#""end": Subdivide(mesh: "doll", scheme: Loop),"#,
        ),
        (
            r#""end": Subdivide(mesh: "doll",, scheme: Loop),"#,
            r#""end": Subdivide(mesh: "doll", scheme: Loop),"#,
        ),
        (
            r#""end": Subdivide(mesh: "doll", scheme: Loop,"#,
            r#""end": Subdivide(mesh: "doll", scheme: Loop),"#,
        ),
        // A missing link for which the graph has only one possible source.
        (r#""end": Subdivide(scheme: Loop),"#, r#""end": Subdivide(mesh: "doll", scheme: Loop),"#),
        (r#""end": Texture(mesh: "doll", image: "doll"),"#, ""),
        // A number with a unit in a field that has no unit.
        (
            r#""end": Transform(mesh: "doll", scale: (cm(2), 1, 1)),"#,
            r#""end": Transform(mesh: "doll", scale: (2, 1, 1)),"#,
        ),
    ] {
        let (found, mended) = apply_fixes(&graph(wrong));
        match right {
            "" => assert_eq!((&found, &mended[..]), (&graph(wrong), &[][..]), "nobody knows"),
            right => {
                assert_eq!(found, graph(right));
                assert_eq!(mended.len(), 1, "{mended:?}");
            }
        }
    }
}

#[test]
fn several_problems_are_put_right_one_after_the_other() {
    let wrong = graph(
        "\"soft\": Subdivde(msh: \"dol\" scheme: Lop),\n        \"end\": Transform(mesh: \"sofft\", scale: (1, Expr(\"mxa(1, 2)\"), 1)),",
    );
    let right = graph(
        "\"soft\": Subdivide(mesh: \"doll\", scheme: Loop),\n        \"end\": Transform(mesh: \"soft\", scale: (1, Expr(\"max(1, 2)\"), 1)),",
    );
    let (found, mended) = apply_fixes(&wrong);
    assert_eq!(found, right, "{mended:?}");
}

#[test]
fn a_value_of_another_type_goes_through_the_only_node_that_makes_it_fit() {
    fn text(middle: &str, link: &str) -> String {
        format!(
            r#"Graph(
    format: 1,
    nodes: {{
        "net": PointNet(points: [[(0, 0, 0), (1, 0, 0)], [(0, 1, 0), (1, 1, 1)]]),
        "skin": Nurbs(net: "net", u: "knots", v: "knots"),
        "knots": Knots(net: "net", along: U),
        {middle}"end": Transform(mesh: "{link}"),
    }},
    outputs: {{ "end.ply": "end" }},
)
"#
        )
    }
    let (found, mended) = apply_fixes(&text("", "skin"));
    let between = "\"skin-tessellate\": Tessellate(surface: \"skin\"),\n        ";
    assert_eq!(found, text(between, "skin-tessellate"), "{mended:?}");
}
