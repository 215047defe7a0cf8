//! Patches: file paths in patches and from outside, duplicate names, and edits that set values which the patch does not contain.

use std::fs;
use std::path::{Path, PathBuf};

use maquette::value::Mesh;
use maquette::{Catalog, Graph, Options, Run, Session, Settings};
use maquette_nodes::PACKS;

const GRAPH: &str = r#"Graph(
    format: 1,
    params: { "file": Text(default: "three.obj"), "levels": Integer(default: Draft(final: 2, draft: 0)), "far": Number(default: 1.0) },
    nodes: {
        "a": ReadMesh(path: Param("file")),
        "s": Subdivide(mesh: "a", scheme: Loop, levels: Param("levels"), limit: Draft(final: true, draft: false)),
        "t": Transform(mesh: "a", translate: (1, 2, Param("far")), scale: Draft(final: (1, 1, 1), draft: (2, 2, 2))),
    },
    outputs: { "a.ply": "a", "s.ply": "s", "t.ply": "t" },
)"#;

const PATCH: &str = "Patch(format: 1, of: \"../g.ron\"";

/// A project with a graph that reads a mesh of three faces. The subfolder `sub` contains a patch of the graph, and meshes of two faces and
/// of one face.
struct Project(tempfile::TempDir);

impl Project {
    fn new() -> Self {
        let project = Self(tempfile::tempdir().unwrap());
        fs::create_dir(project.path("sub")).unwrap();
        fn mesh(faces: usize) -> String {
            let vertices = (0..faces + 2).map(|k: usize| format!("v {} {} 0\n", k / 2, k % 2));
            vertices
                .chain(
                    (1..=faces).map(|k: usize| {
                        format!("f {} {} {}\n", k, k + 1 + (k + 1) % 2, k + 1 + k % 2)
                    }),
                )
                .collect::<String>()
        }
        project.write("maquette.toml", "");
        project.write("g.ron", GRAPH);
        project.write("three.obj", &mesh(3));
        project.write("sub/three.obj", &mesh(2));
        project.write("sub/one.obj", &mesh(1));
        project
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    fn patch(&self, fields: &str) -> PathBuf {
        let path = self.path("sub/patch.ron");
        let gap = if fields.is_empty() { "" } else { ", " };
        fs::write(&path, format!("{PATCH}{gap}{fields})")).unwrap();
        path
    }
}

fn faces(path: &Path, set: &[(&str, &str)]) -> usize {
    let set = set.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
    let options = Options { set, ..Options::default() };
    let mut session = Session::new(PACKS, &Settings::in_memory()).unwrap();
    let checked = session.load(path, &options);
    let graph = checked.graph.unwrap_or_else(|| panic!("{:?}", checked.diagnostics));
    let done = session.run(&graph, &Run::default()).unwrap();
    done.get::<Mesh>("a.ply").unwrap().faces().len()
}

/// Returns each error as `FILE:LINE:COLUMN message`.
fn problems(path: &Path) -> Vec<String> {
    let checked = Graph::load(path, &Catalog::new(PACKS), &Options::default());
    checked.diagnostics.iter().map(position_and_message).collect()
}

fn position_and_message(problem: &maquette::Diagnostic) -> String {
    let place = maquette::Position::from_offset(&problem.source.text, problem.span.start);
    let file = problem.source.name.file_name().unwrap().to_string_lossy().into_owned();
    format!("{file}:{}:{} {}", place.line, place.column, problem.message)
}

#[test]
fn a_path_is_relative_to_the_file_in_which_it_is_written() {
    let project = Project::new();
    assert_eq!(faces(&project.path("g.ron"), &[]), 3);
    let by_field = "nodes: { \"a\": (path: \"three.obj\") }";
    let by_parameter = "params: { \"file\": \"three.obj\" }";
    for patch in
        [by_field, by_parameter, "params: { \"file\": Draft(final: \"three.obj\", draft: \"x\") }"]
    {
        let patch = project.patch(patch);
        assert_eq!(faces(&patch, &[]), 2, "{}", patch.display());
        // `outer.ron` patches the patch of this test from another folder. The path stays relative to the file that contains it.
        project
            .write("outer.ron", "Patch(format: 1, of: \"sub/patch.ron\", params: { \"far\": 2 })");
        assert_eq!(faces(&project.path("outer.ron"), &[]), 2);
    }
    // A value that the patch does not set has the value of the graph.
    assert_eq!(faces(&project.patch("params: { \"far\": 2 }"), &[]), 3);
}

#[test]
fn a_path_that_is_set_is_relative_to_the_file_that_was_named() {
    let project = Project::new();
    for target in ["a.path", "file"] {
        for patch in
            ["nodes: { \"a\": (path: \"three.obj\") }", "params: { \"file\": \"three.obj\" }", ""]
        {
            // A patch that sets the field `path` itself hides the parameter `file`, so setting `file` has no effect.
            if target == "file" && patch.contains("path") {
                continue;
            }
            let patched = project.patch(patch);
            assert_eq!(faces(&patched, &[(target, "one.obj")]), 1, "{target} of {patch}");
            project.write("outer.ron", "Patch(format: 1, of: \"sub/patch.ron\")");
            assert_eq!(faces(&project.path("outer.ron"), &[(target, "three.obj")]), 3);
        }
        assert_eq!(faces(&project.path("g.ron"), &[(target, "sub/one.obj")]), 1);
    }
}

#[test]
fn a_file_that_is_not_there_is_told_where_it_is_named() {
    let project = Project::new();
    let wrong = [
        ("nodes: { \"a\": (path: \"none.obj\") }", 55),
        ("params: { \"file\": \"none.obj\" }", 52),
    ];
    for (patch, column) in wrong {
        let found = problems(&project.patch(patch));
        assert_eq!(found, [format!("patch.ron:1:{column} there is no file `none.obj`")]);
    }
}

#[test]
fn a_name_that_stands_twice_in_a_patch_is_told_at_the_second_one_and_nothing_is_set() {
    let project = Project::new();
    let twice = [
        ("params: { \"far\": 1, \"far\": 2 }", "patch.ron:1:54 parameter `far` is given twice"),
        (
            "nodes: { \"t\": (scale: (2, 2, 2)), \"t\": (translate: (3, 3, 3)) }",
            "patch.ron:1:68 node `t` is given twice",
        ),
        (
            "nodes: { \"t\": (scale: (2, 2, 2), scale: (3, 3, 3)) }",
            "patch.ron:1:67 field `scale` is given twice",
        ),
        (
            "params: { \"far\": 1 }, params: { \"levels\": 2 }",
            "patch.ron:1:56 field `params` is given twice",
        ),
    ];
    for (patch, message) in twice {
        let path = project.patch(patch);
        assert_eq!(problems(&path), [message]);
        let set = [("far".to_owned(), "7".to_owned())];
        let text = fs::read_to_string(&path).unwrap();
        let edited = maquette::edit::set_values(
            &path,
            &text,
            &set,
            &Catalog::new(PACKS),
            &Options::default(),
        );
        assert_eq!(
            edited.unwrap_err().iter().map(position_and_message).collect::<Vec<_>>(),
            [message]
        );
    }
}

/// Sets a value in a patch. Returns the old value that the edit reports, and the fields after `of` in the new patch.
fn set(
    project: &Project,
    patch: &str,
    target: &str,
    value: &str,
    draft: bool,
) -> Result<String, String> {
    let path = project.patch(patch);
    let text = fs::read_to_string(&path).unwrap();
    let options = Options { draft, ..Options::default() };
    let set = [(target.to_owned(), value.to_owned())];
    let edited = maquette::edit::set_values(&path, &text, &set, &Catalog::new(PACKS), &options);
    let edited = edited.map_err(|problems| problems[0].message.clone())?;
    // Setting the value in the patched graph itself must report the same new value as setting it in the patch.
    let graph = maquette::edit::set_values(
        &project.path("g.ron"),
        GRAPH,
        &set,
        &Catalog::new(PACKS),
        &options,
    );
    if patch.is_empty() {
        assert_eq!(edited.changes[0].after, graph.unwrap().changes[0].after);
    }
    let before = edited.changes[0].before.clone().unwrap_or_default();
    let fields = edited.text.strip_prefix(PATCH).and_then(|text| text.strip_suffix(')')).unwrap();
    Ok(format!("{before}; {}", fields.trim_start_matches(", ")))
}

#[test]
fn a_patch_is_set_as_the_graph_is() {
    let project = Project::new();
    let cases = [
        // Set one number of a vector, in a patch that contains the vector and in one that does not.
        (
            "",
            "t.translate.1",
            "9",
            false,
            "2; nodes: { \"t\": (translate: (1, 9, Param(\"far\"))) }",
        ),
        (
            "nodes: { \"t\": (translate: (4, 5, 6)) }",
            "t.translate.1",
            "9",
            false,
            "5; nodes: { \"t\": (translate: (4, 9, 6)) }",
        ),
        (
            "nodes: { \"t\": (pivot: (4, 5, 6)) }",
            "t.translate.1",
            "9",
            false,
            "2; nodes: { \"t\": (pivot: (4, 5, 6), translate: (1, 9, Param(\"far\"))) }",
        ),
        // Setting the draft value must not change the final value, and vice versa.
        ("", "levels", "1", true, "0; params: { \"levels\": Draft(final: 2, draft: 1) }"),
        ("", "levels", "1", false, "; params: { \"levels\": 1 }"),
        (
            "params: { \"levels\": 3 }",
            "levels",
            "1",
            true,
            "0; params: { \"levels\": Draft(final: 3, draft: 1) }",
        ),
        (
            "",
            "s.limit",
            "true",
            true,
            "false; nodes: { \"s\": (limit: Draft(final: true, draft: true)) }",
        ),
        (
            "nodes: { \"s.limit\": (draft: false) }",
            "s.limit",
            "true",
            true,
            "false; nodes: { \"s.limit\": (draft: true) }",
        ),
        ("", "s.limit.draft", "true", false, "; nodes: { \"s.limit\": (draft: true) }"),
        (
            "",
            "t.scale.0",
            "5",
            true,
            "2; nodes: { \"t\": (scale: Draft(final: (1, 1, 1), draft: (5, 2, 2))) }",
        ),
        ("", "far", "3", true, "1.0; params: { \"far\": Draft(final: 1.0, draft: 3) }"),
    ];
    for (patch, target, value, draft, told) in cases {
        let done = set(&project, patch, target, value, draft);
        assert_eq!(done.as_deref(), Ok(told), "{target}={value} of {patch}");
    }
    let refused = [
        ("t.translate.2", "its value is Param(\"far\"), a parameter of the graph"),
        ("t.translate.3", "there is no item `3`"),
        ("u.translate.1", "the graph has no node `u`"),
    ];
    for (target, message) in refused {
        let done = set(&project, "", target, "9", false).unwrap_err();
        assert!(done.ends_with(message), "{done}");
    }
}
