//! Texts with syntax errors. The check must report these errors, and also the errors in the rest of the text.

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
    check(
        &[],
        expect![[r#"
        10:32-41 G007 there is no node `nowhere` (the graph's nodes: mesh, red, blue, bad)
        10:43-51 G004 Transform has no field `trnslate` (did you mean `translate`?)
    "#]],
    );
    check(
        &[("(0, Param(\"lift\"), 0)),", "(0, Param(\"lift\"), 0),")],
        expect![[r#"
        8:25-26 G001 this `(` is not closed before the `}` at 11:5 (add the missing `)`)
        10:32-41 G007 there is no node `nowhere` (the graph's nodes: mesh, red, blue, bad)
        10:43-51 G004 Transform has no field `trnslate` (did you mean `translate`?)
    "#]],
    );
    check(
        &[("(0, 0, 30)),", "(0, 0, 30),")],
        expect![[r#"
        9:26-27 G001 this `(` is not closed before the `}` at 11:5 (add the missing `)`)
        10:32-41 G007 there is no node `nowhere` (the graph's nodes: mesh, red, blue, bad)
        10:43-51 G004 Transform has no field `trnslate` (did you mean `translate`?)
    "#]],
    );
    check(
        &[("(0, 0, 1)),\n    },", "(0, 0, 1)),")],
        expect![[r#"
        6:12-13 G001 this `{` is not closed before the `)` at 15:1 (add the missing `}`)
        10:32-41 G007 there is no node `nowhere` (the graph's nodes: mesh, red, blue, bad)
        10:43-51 G004 Transform has no field `trnslate` (did you mean `translate`?)
    "#]],
    );
    check(
        &[("Param(\"lift\"), 0)", "Param(\"lift\", 0)")],
        expect![[r#"
        8:25-26 G001 this `(` is not closed before the `}` at 11:5 (add the missing `)`)
        10:32-41 G007 there is no node `nowhere` (the graph's nodes: mesh, red, blue, bad)
        10:43-51 G004 Transform has no field `trnslate` (did you mean `translate`?)
    "#]],
    );
    check(
        &[("\"doll.obj\"),", "\"doll.obj),")],
        expect![[r#"
        7:32-41 G001 missing closing quote (add the missing `"`)
        10:32-41 G007 there is no node `nowhere` (the graph's nodes: mesh, red, blue, bad)
        10:43-51 G004 Transform has no field `trnslate` (did you mean `translate`?)
    "#]],
    );
    check(
        &[("(0, 0, 30)),", "(0, 0, 30))")],
        expect![[r#"
        10:9-14 G001 missing comma before `"bad"` (add a comma before it)
        10:32-41 G007 there is no node `nowhere` (the graph's nodes: mesh, red, blue, bad)
        10:43-51 G004 Transform has no field `trnslate` (did you mean `translate`?)
    "#]],
    );
    check(
        &[("\"red\", rotate", "\"red\" rotate")],
        expect![[r#"
        9:39-45 G001 missing comma before `rotate` (add a comma before it)
        10:32-41 G007 there is no node `nowhere` (the graph's nodes: mesh, red, blue, bad)
        10:43-51 G004 Transform has no field `trnslate` (did you mean `translate`?)
    "#]],
    );
    check(
        &[("\"blue\": Transform", "\"blue\" Transform")],
        expect![[r#"
        9:16-25 G001 expected a comma or a colon before this (add a comma or a colon)
        10:32-41 G007 there is no node `nowhere` (the graph's nodes: mesh, red, blue, bad)
        10:43-51 G004 Transform has no field `trnslate` (did you mean `translate`?)
    "#]],
    );
    check(
        &[("doc: \"l\"),\n    }", "doc: \"l\"),\n    )")],
        expect![[r#"
            5:5-6 G001 expected `}`, which closes the `{` at 3:13, found `)` (write `}`)
            10:32-41 G007 there is no node `nowhere` (the graph's nodes: mesh, red, blue, bad)
            10:43-51 G004 Transform has no field `trnslate` (did you mean `translate`?)
        "#]],
    );
    check(
        &[("default: 5.0", "default: 5.0.0")],
        expect![[r#"
        4:36-38 G001 unexpected `.0` (remove it)
        10:32-41 G007 there is no node `nowhere` (the graph's nodes: mesh, red, blue, bad)
        10:43-51 G004 Transform has no field `trnslate` (did you mean `translate`?)
    "#]],
    );
    check(
        &[("    },\n)\n", "")],
        expect![[r#"
        10:32-41 G007 there is no node `nowhere` (the graph's nodes: mesh, red, blue, bad)
        10:43-51 G004 Transform has no field `trnslate` (did you mean `translate`?)
        12:14-15 G001 this `{` is never closed (add the missing `}`)
    "#]],
    );
    check(
        &[("format: 1,", "format: 1"), ("(0, 0, 30)),", "(0, 0, 30),"), ("rotate:", "rotate =")],
        expect![[r#"
            3:5-11 G001 missing comma before `params` (add a comma before it)
            9:26-27 G001 this `(` is not closed before the `}` at 11:5 (add the missing `)`)
            10:32-41 G007 there is no node `nowhere` (the graph's nodes: mesh, red, blue, bad)
            10:43-51 G004 Transform has no field `trnslate` (did you mean `translate`?)
        "#]],
    );
}
