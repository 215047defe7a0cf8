//! `maquette lock`, `lock --update` and `--locked`, optional inputs of used graphs, and versions in the output of `nodes`.

use crate::output::text_of;
use crate::project::Project;

const SKIRT: &str = r#"// A skirt.
Graph(
    format: 1,
    version: "1.0.0",
    doc: "Moves a mesh.",
    inputs: {
        "mesh": Mesh(doc: "A mesh."),
        "hem": Optional(Mesh(doc: "What hangs on it.")),
    },
    params: { "step": Number(default: 1.0, min: 0.0, max: 9.0, unit: "mm", doc: "How far.") },
    nodes: {
        "moved": Transform(mesh: "mesh", translate: (Param("step"), 0, 0)),
        "all": Merge(meshes: ["moved", "hem"]),
    },
    outputs: { "mesh": "all" },
)
"#;

const DRESS: &str = r#"Graph(
    format: 1,
    use: { "Skirt": Graph("lib/skirt.ron", version: "1.0") },
    nodes: {
        "ball": ReadMesh(path: "ball.obj"),
        "skirt": Skirt(mesh: "ball"),
    },
    outputs: { "skirt.ply": "skirt" },
)
"#;

fn project() -> Project {
    let project = Project::new(DRESS);
    let ball = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";
    std::fs::write(project.folder().join("ball.obj"), ball).unwrap();
    std::fs::create_dir(project.folder().join("lib")).unwrap();
    save(&project, SKIRT);
    std::fs::write(project.folder().join("doll.test.ron"), "Test(graph: \"doll.ron\")\n").unwrap();
    project
}

fn save(project: &Project, skirt: &str) {
    std::fs::write(project.folder().join("lib/skirt.ron"), skirt).unwrap();
}

#[test]
fn a_lock_holds_graphs_to_what_they_were_until_an_update_takes_them() {
    let project = project();
    let lock = project.maquette(&["lock", "doll.ron"]);
    assert_eq!(text_of(&lock), "doll.lock.ron: 1 graph\n");
    fn text(project: &Project) -> String {
        std::fs::read_to_string(project.folder().join("doll.lock.ron")).unwrap()
    }
    let first = text(&project);
    let line = first.lines().find(|line| line.contains("lib/skirt.ron\":")).unwrap();
    assert!(
        line.starts_with("        \"lib/skirt.ron\": (version: \"1.0.0\", hash: \""),
        "{first}"
    );
    assert!(project.maquette(&["run", "doll.ron", "--locked"]).status.success());
    let bless = &["test", "--bless", "doll.ron"];
    let blessed = project.command(bless).env_remove("CI").output().unwrap();
    assert!(blessed.status.success(), "{blessed:?}");
    // Commands for all files of a folder skip the lock file, which is not a graph.
    for words in [&["check", "."][..], &["fmt", "."], &["edit", ".", "migrate"]] {
        let done = project.maquette(words);
        assert!(done.status.success(), "{words:?}: {}", text_of(&done));
    }
    assert_eq!(text(&project), first);

    save(&project, &SKIRT.replace("1.0.0", "1.1.0").replace("default: 1.0", "default: 2.0"));
    for words in [&["run", "doll.ron"][..], &["check", "doll.ron"]] {
        let done = project.maquette(words);
        assert!(done.status.success() && text_of(&done).contains("warning[G031]"), "{done:?}");
        let done = project.maquette(&[words, &["--locked"]].concat());
        assert_eq!(done.status.code(), Some(1), "{words:?}");
        let how = "`lib/skirt.ron` differs from doll.lock.ron: version: 1.0.0 -> 1.1.0; parameter step: changed default: 1 -> 2";
        assert!(text_of(&done).contains(how), "{}", text_of(&done));
    }
    let test = project.maquette(&["test", "--locked", "doll.ron"]);
    assert!(!test.status.success() && text_of(&test).contains("error[G031]"), "{}", text_of(&test));
    let mut watch = project.start(&["--locked"]);
    assert_eq!(watch.wait(|event| event["event"] == "problems")["problems"][0]["code"], "G031");

    let shown = "lib/skirt.ron: 1.0.0 -> 1.1.0\n    graph: changed version: \"1.0.0\" -> \"1.1.0\"\n    parameter step: changed default: 1 -> 2\n";
    let asked = project.maquette(&["lock", "--update", "doll.ron"]);
    assert_eq!(
        text_of(&asked),
        format!("{shown}no change was accepted; use --yes to accept all\n")
    );
    assert_eq!((asked.status.code(), text(&project)), (Some(1), first));
    let taken = project.maquette(&["lock", "--update", "doll.ron", "Skirt", "--yes"]);
    assert_eq!((taken.status.code(), text_of(&taken)), (Some(0), shown.to_owned()));
    assert!(project.maquette(&["run", "doll.ron", "--locked"]).status.success());
    let again = project.maquette(&["lock", "--update", "doll.ron"]);
    assert_eq!(text_of(&again), "doll.lock.ron is up to date\n");
    let unknown = project.maquette(&["lock", "--update", "doll.ron", "Skrt"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(text_of(&unknown).contains("did you mean `Skirt`?"), "{}", text_of(&unknown));
}

#[test]
fn a_graph_in_a_graph_is_locked_too_and_updated_with_the_one_that_uses_it() {
    let project = project();
    save(&project, &SKIRT.replace("    doc:", "    use: { \"In\": \"in.ron\" },\n    doc:"));
    let inner = SKIRT.replace("A skirt", "Inside");
    std::fs::write(project.folder().join("lib/in.ron"), &inner).unwrap();
    assert_eq!(text_of(&project.maquette(&["lock", "doll.ron"])), "doll.lock.ron: 2 graphs\n");
    std::fs::write(project.folder().join("lib/in.ron"), inner.replace("Inside", "Within")).unwrap();
    let taken = project.maquette(&["lock", "--update", "doll.ron", "Skirt", "--yes"]);
    assert_eq!(text_of(&taken), "lib/in.ron: 1.0.0\n    comments or spaces differ\n");
}

#[test]
fn an_optional_input_need_not_be_given_and_is_told_of_with_the_version() {
    let project = project();
    let call = ["run", "lib/skirt.ron", "--out", "out", "--input", "mesh=ball.obj"];
    let run = project.maquette(&call);
    assert!(run.status.success(), "{}", text_of(&run));
    let with = project.maquette(&[&call[..], &["--input", "hem=ball.obj"]].concat());
    assert!(with.status.success(), "{}", text_of(&with));
    let nodes = text_of(&project.maquette(&["nodes", "lib/skirt.ron"]));
    assert!(nodes.starts_with("skirt 1.0.0 (lib/skirt.ron)\n"), "{nodes}");
    assert!(nodes.contains("  hem: Mesh, optional\n      What hangs on it.\n"), "{nodes}");
    let json = project.maquette(&["nodes", "lib/skirt.ron", "--json"]);
    let json: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    let node = &json["nodes"][0];
    assert_eq!((&node["version"], &node["inputs"][1]["optional"]), (&"1.0.0".into(), &true.into()));
    // Editing and formatting keep the text as it is written.
    fn text(project: &Project) -> String {
        std::fs::read_to_string(project.folder().join("lib/skirt.ron")).unwrap()
    }
    assert!(project.maquette(&["edit", "lib/skirt.ron", "set", "step=2"]).status.success());
    assert_eq!(text(&project), SKIRT.replace("default: 1.0", "default: 2"));
    assert!(project.maquette(&["draw", "doll.ron"]).status.success());
    assert!(project.maquette(&["fmt", "--check", "doll.ron", "lib/skirt.ron"]).status.success());
}

/// Runs the program on a pseudoterminal and answers its question. Returns the output, and true if the program succeeds.
#[cfg(unix)]
fn answer_question(project: &Project, words: &[&str], answer: &str) -> (String, bool) {
    use std::fs::File;
    use std::io::{Read, Write};
    use std::time::Duration;

    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

    let ours = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&ours).unwrap();
    unlockpt(&ours).unwrap();
    let name = ptsname(&ours, Vec::new()).unwrap().into_string().unwrap();
    let terminal = File::options().read(true).write(true).open(name).unwrap();
    let mut command = project.command(words);
    for stream in 0..3 {
        let terminal = terminal.try_clone().unwrap();
        match stream {
            0 => command.stdin(terminal),
            1 => command.stdout(terminal),
            _ => command.stderr(terminal),
        };
    }
    let mut process = command.spawn().unwrap();
    drop((command, terminal));
    let mut ours = File::from(ours);
    let (sender, heard) = std::sync::mpsc::channel();
    let mut listener = ours.try_clone().unwrap();
    std::thread::spawn(move || {
        let mut part = [0; 1024];
        // On Linux, reading after the end of a terminal's output is an error.
        while let Ok(count @ 1..) = listener.read(&mut part) {
            let _ = sender.send(String::from_utf8_lossy(&part[..count]).into_owned());
        }
    });
    let mut said = String::new();
    while !said.contains("[y/N] ") {
        let part = heard.recv_timeout(Duration::from_secs(60));
        said += &part.unwrap_or_else(|why| panic!("nothing is asked: {why}, {said}"));
    }
    ours.write_all(answer.as_bytes()).unwrap();
    let done = process.wait().unwrap().success();
    said.extend(heard);
    (said.replace("\r\n", "\n"), done)
}

#[cfg(unix)]
#[test]
fn on_a_terminal_what_changed_is_shown_and_taken_only_if_the_answer_is_yes() {
    let project = project();
    project.maquette(&["lock", "doll.ron"]);
    fn text(project: &Project) -> String {
        std::fs::read_to_string(project.folder().join("doll.lock.ron")).unwrap()
    }
    let first = text(&project);
    save(&project, &SKIRT.replace("1.0.0", "1.1.0"));
    for no in ["\n", "n\n", "yess\n", "\u{4}"] {
        let (said, taken) = answer_question(&project, &["lock", "--update", "doll.ron"], no);
        assert!(said.contains("lib/skirt.ron: 1.0.0 -> 1.1.0\n"), "{said}");
        assert!(said.contains("no change was accepted"), "{said}");
        assert!(!taken && text(&project) == first, "{no:?}");
    }
    let (said, taken) = answer_question(&project, &["lock", "--update", "doll.ron"], "y\n");
    assert!(taken && text(&project).contains("1.1.0"), "{said}");
    assert!(said.contains("accept the changes? [y/N] y\n"), "{said}");
}
