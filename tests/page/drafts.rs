//! Tests that pages learn which parameters have a draft value, and whether drafts are shown.

use crate::browser::Browser;
use crate::preview::Server;
use crate::project::Project;

const GRAPH: &str = r#"Graph(
    format: 1,
    params: {
        "levels": Integer(default: Draft(final: 2, draft: 0), min: 0, max: 5),
        "height": Number(default: 1.0),
    },
    nodes: {
        "coarse": ReadMesh(path: "coarse.obj"),
        "skin": Subdivide(mesh: "coarse", scheme: Loop, levels: Param("levels"), limit: Draft(final: true, draft: false)),
    },
    outputs: { "skin.ply": "skin" },
)"#;

fn project() -> Project {
    let project = Project::doll();
    let open = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\n";
    std::fs::write(project.folder().join("coarse.obj"), open).unwrap();
    project.save(GRAPH);
    project
}

#[test]
fn a_page_says_what_drafts_have_and_whether_it_shows_drafts() {
    let Some(mut browser) = Browser::start() else { return };
    for (more, title, level) in [
        (&["--preview"][..], "doll.ron - maquette", "2"),
        (&["--preview", "--draft"], "doll.ron (draft) - maquette", "0"),
    ] {
        let project = project();
        let mut served = Server::start_with(&project, more, &[]);
        served.watch.run_until_ok();
        browser.open(&served.link());
        browser.wait("document.querySelector('#parameter-levels')");
        assert_eq!(browser.ask("document.title"), title);
        let is_told = browser.ask("!document.querySelector('#draft').hidden");
        let is_draft = title.contains("draft");
        assert_eq!(is_told, is_draft);
        assert_eq!(browser.ask("document.querySelector('#parameter-levels').value"), level);
        let marks = "[...document.querySelectorAll('.parameter')].map((row) => row.querySelector('.draft')?.textContent ?? '').join('|')";
        assert_eq!(browser.ask(marks), "final 2, draft 0|");
        browser.wait("document.querySelector('#node table')");
        let told = "[...document.querySelectorAll('#node .draft')].map((it) => it.closest('tr').textContent).join('|')";
        let shown = if is_draft { "|showna draft, not the final result" } else { "" };
        assert_eq!(browser.ask(told), format!("limitfinal true, draft false{shown}"));
        if let Some(path) = std::env::var_os("LOOK") {
            let shot = browser.call("Page.captureScreenshot", serde_json::json!({}));
            std::fs::write(path, shot["data"].as_str().unwrap()).unwrap();
        }
        served.watch.end();
        browser.open("about:blank");
    }
}
