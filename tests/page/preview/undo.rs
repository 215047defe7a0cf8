//! Undo on the live page restores the text byte by byte.

use super::*;

#[test]
fn what_became_a_draft_or_was_left_out_is_taken_back_as_it_was() {
    let project = Project::new(
        r#"Graph(
    format: 1,
    params: { "far": Number(default: 1.0) },
    nodes: {
        "mesh": ReadMesh(path: "coarse.obj"),
        "moved": Transform(mesh: "mesh", translate: (Param("far"), 0, 0)),
    },
    outputs: { "a.ply": "moved" },
)
"#,
    );
    project.copy_asset("coarse.obj", "coarse.obj");
    let mut served = Server::start_with(&project, &["--preview", "--draft"], &[]);
    served.watch.run_until_ok();
    let mut page = served.page();
    page.wait("done");
    fn text(project: &Project) -> String {
        std::fs::read_to_string(project.graph()).unwrap()
    }
    let before = text(&project);
    fn set(page: &mut Page, target: &str, value: &str) {
        page.say(&json!({ "ask": "set", "values": [[target, value]] }));
        page.wait("done");
    }
    set(&mut page, "far", "2.5");
    let first = text(&project);
    assert!(first.contains("Draft(final: 1.0, draft: 2.5)"), "{first}");
    set(&mut page, "far", "3.5");
    set(&mut page, "moved.scale", "(2, 2, 2)");
    assert!(
        text(&project).contains("scale: Draft(final: (1.0, 1.0, 1.0), draft: (2, 2, 2))"),
        "{}",
        text(&project)
    );
    for expected in [first.replace("2.5", "3.5"), first.clone(), before] {
        page.say(&json!({ "ask": "undo" }));
        page.wait("done");
        assert_eq!(text(&project), expected);
    }
    // If the rest of the file has changed, undo is refused instead of restoring only a part.
    set(&mut page, "far", "2.5");
    let later = format!("// Mine.\n{first}");
    project.save(&later);
    page.wait("done");
    page.say(&json!({ "ask": "undo" }));
    let refused = page.wait("refused");
    let why = "the value was not a `Draft` before, and the file has been changed since; edit the file instead";
    assert_eq!(refused["why"], why);
    assert_eq!(text(&project), later);
    served.watch.end();
}
