//! The question of `maquette lock --update` on a terminal.

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
    project.write("ball.obj", ball);
    std::fs::create_dir(project.folder().join("lib")).unwrap();
    save(&project, SKIRT);
    project.write("doll.test.ron", "Test(graph: \"doll.ron\")\n");
    project
}

fn save(project: &Project, skirt: &str) {
    project.write("lib/skirt.ron", skirt);
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
        // On Linux, reading from a terminal is an error after the end of its output.
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
        project.read("doll.lock.ron")
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
