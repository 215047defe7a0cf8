//! Texts with syntax errors: these are told, and what is wrong with the rest.

use expect_test::{Expect, expect};

use crate::graph_files;

const GRAPH: &str = r#"Graph(
    format: 1,
    params: {
        "lift": Number(default: 5.0, doc: "l"),
    },
    nodes: {
        "mesh": ReadMesh(path: "doll.obj"),
        "red": Transform(mesh: "mesh", translate: (0, Param("lift"), 0)),
        "blue": Transform(mesh: "red", rotate: (0, 0, 30)),
        "bad": Transform(mesh: "nowhere", trnslate: (0, 0, 1)),
    },
    outputs: {
        "a.ply": "blue",
        "b.ply": "bad",
    },
)
"#;

#[track_caller]
fn check(changes: &[(&str, &str)], expected: Expect) {
    let mut text = GRAPH.to_owned();
    for (old, new) in changes {
        assert_eq!(text.matches(old).count(), 1, "{old}");
        text = text.replacen(old, new, 1);
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("graph.ron");
    std::fs::write(&path, text).unwrap();
    std::fs::write(folder.path().join("doll.obj"), "").unwrap();
    expected.assert_eq(&graph_files::problems(&path));
}

#[test]
fn a_syntax_error_hides_no_other_error() {
    check(&[], expect![[r#""#]]);
    check(&[("(0, Param(\"lift\"), 0)),", "(0, Param(\"lift\"), 0),")], expect![[r#""#]]);
    check(&[("(0, 0, 30)),", "(0, 0, 30),")], expect![[r#""#]]);
    check(&[("(0, 0, 1)),\n    },", "(0, 0, 1)),")], expect![[r#""#]]);
    check(&[("Param(\"lift\"), 0)", "Param(\"lift\", 0)")], expect![[r#""#]]);
    check(&[("\"doll.obj\"),", "\"doll.obj),")], expect![[r#""#]]);
    check(&[("(0, 0, 30)),", "(0, 0, 30))")], expect![[r#""#]]);
    check(&[("\"red\", rotate", "\"red\" rotate")], expect![[r#""#]]);
    check(&[("\"blue\": Transform", "\"blue\" Transform")], expect![[r#""#]]);
    check(&[("doc: \"l\"),\n    }", "doc: \"l\"),\n    )")], expect![[r#""#]]);
    check(&[("default: 5.0", "default: 5.0.0")], expect![[r#""#]]);
    check(&[("    },\n)\n", "")], expect![[r#""#]]);
    check(
        &[("format: 1,", "format: 1"), ("(0, 0, 30)),", "(0, 0, 30),"), ("rotate:", "rotate =")],
        expect![[r#""#]],
    );
}
