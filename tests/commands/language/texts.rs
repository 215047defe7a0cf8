//! Damaged, conflicting or unusual text files cause an error with file, line and help, and never a panic.

use crate::output::text_of;
use crate::project::{Project, TETRAHEDRON};

const GRAPH: &str = r#"Graph(
    format: 1,
    use: { "Part": "part.ron" },
    nodes: {
        "mesh": ReadMesh(path: "a.obj"),
        "part": Part(mesh: "mesh"),
        "up": Transform(mesh: "part", translate: (0, 0, 1)),
    },
    outputs: { "up.ply": "up" },
)
"#;

const PART: &str = "Graph(format: 1, inputs: { \"mesh\": Mesh() }, nodes: { \"it\": Transform(mesh: \"mesh\") }, outputs: { \"mesh\": \"it\" })\n";

/// Makes a project with a graph, its test and golden, a pin, a lock and a sweep.
fn project() -> Project {
    let project = Project::new(GRAPH);
    project.write("a.obj", TETRAHEDRON);
    project.write("part.ron", PART);
    project.write("maquette.toml", "");
    project.write("doll.test.ron", "Test(\n    graph: \"doll.ron\",\n)\n");
    project.write(
        "doll.sweep.ron",
        "Sweep(\n    graph: \"doll.ron\",\n    over: Values(\"up.translate\", [(0, 0, 1)]),\n)\n",
    );
    for words in [
        &["pin", "doll.ron", "up"][..],
        &["lock", "doll.ron"],
        &["test", "doll.test.ron", "--bless"],
    ] {
        let done = project.maquette(words);
        assert!(done.status.success(), "{words:?}: {}", text_of(&done));
    }
    project
}

/// Returns the text files of the project, each with a command that reads it.
fn texts(project: &Project) -> Vec<(String, Vec<String>)> {
    let golden = std::fs::read_dir(project.folder().join("goldens")).unwrap();
    let golden = golden.map(|file| file.unwrap().path());
    let golden = golden.filter(|path| path.extension().is_some_and(|ending| ending == "txt"));
    let golden =
        golden.map(|path| path.strip_prefix(project.folder()).unwrap().display().to_string());
    let mut all = vec![
        ("doll.ron".to_owned(), "check doll.ron"),
        ("doll.ron".to_owned(), "run doll.ron"),
        ("doll.ron".to_owned(), "fmt doll.ron"),
        ("doll.ron".to_owned(), "edit doll.ron set up.scale=(1,2,1)"),
        ("doll.pins.ron".to_owned(), "run doll.ron"),
        ("doll.pins.ron".to_owned(), "pin --remove doll.ron up"),
        ("doll.test.ron".to_owned(), "test doll.test.ron"),
        ("doll.sweep.ron".to_owned(), "batch doll.sweep.ron --out sweep"),
    ];
    all.push(("doll.lock.ron".to_owned(), "check doll.ron"));
    all.push(("part.ron".to_owned(), "check doll.ron"));
    all.extend(golden.map(|name: String| (name, "test doll.test.ron")));
    fn words(words: &str) -> Vec<String> {
        words.split(' ').map(str::to_owned).collect()
    }
    all.into_iter().map(|(file, command)| (file, words(command))).collect()
}

/// Damages each text file in turn, runs its command, and checks that the message contains `wanted`.
fn check_each_text(damage: impl Fn(&[u8]) -> Vec<u8>, wanted: &str) {
    let project = project();
    for (file, words) in texts(&project) {
        let path = project.folder().join(&file);
        let good = std::fs::read(&path).unwrap();
        std::fs::write(&path, damage(&good)).unwrap();
        let words: Vec<_> = words.iter().map(String::as_str).collect();
        let done = project.maquette(&words);
        let told = text_of(&done);
        // An unreadable lock file is only a warning, so the command may succeed.
        let is_refused = matches!(done.status.code(), Some(1 | 2));
        assert!(is_refused || file == "doll.lock.ron", "{file} {words:?}: {told}");
        assert!(told.contains(wanted), "{file} {words:?}: {told}");
        let name = file.rsplit('/').next().unwrap();
        let stem = name.trim_end_matches(".txt");
        assert!(told.contains(stem) && !told.contains("panic"), "{file} {words:?}: {told}");
        std::fs::write(&path, good).unwrap();
    }
}

#[test]
fn marks_of_a_merge_are_one_message_in_every_file() {
    check_each_text(
        |good| {
            let text = String::from_utf8_lossy(good);
            format!("<<<<<<< ours\n{text}=======\n{text}>>>>>>> theirs\n").into_bytes()
        },
        "this file contains merge conflict markers",
    );
}

#[test]
fn what_is_no_utf_8_is_told_with_its_line() {
    check_each_text(
        |good| [&good[..good.len() - 2], b"\xe4", &good[good.len() - 2..]].concat(),
        "expected text in UTF-8, found the byte 0xE4",
    );
    check_each_text(
        |good| {
            let units = String::from_utf8_lossy(good).encode_utf16().collect::<Vec<_>>();
            let bytes = units.into_iter().flat_map(u16::to_le_bytes);
            [0xff, 0xfe].into_iter().chain(bytes).collect()
        },
        "line 1, column 1: expected text in UTF-8, found UTF-16",
    );
    check_each_text(
        |good| [&good[..good.len() - 2], b"\0", &good[good.len() - 2..]].concat(),
        "found the byte 0",
    );
}

#[test]
fn a_mark_of_the_byte_order_is_no_part_of_a_text() {
    let project = project();
    let text = std::fs::read_to_string(project.graph()).unwrap();
    project.save(&format!("\u{feff}{text}"));
    assert!(project.maquette(&["check", "doll.ron"]).status.success());
}

#[test]
fn pins_are_those_of_the_graph_wherever_a_link_leads_to_it_from() {
    let project = project();
    #[cfg(unix)]
    {
        let elsewhere = project.folder().join("elsewhere");
        std::fs::create_dir(&elsewhere).unwrap();
        std::os::unix::fs::symlink(project.folder(), elsewhere.join("link")).unwrap();
        let linked = "elsewhere/link/doll.ron";
        assert_eq!(text_of(&project.maquette(&["pin", linked, "--list"])), "up  Mesh\n");
        let done = project.maquette(&["pin", "--remove", linked, "up"]);
        assert!(done.status.success(), "{}", text_of(&done));
        assert_eq!(text_of(&project.maquette(&["pin", "doll.ron", "--list"])), "");
        assert!(project.maquette(&["pin", linked, "mesh"]).status.success());
        assert_eq!(text_of(&project.maquette(&["pin", "doll.ron", "--list"])), "mesh  Mesh\n");
    }
}

#[cfg(unix)]
#[test]
fn names_of_several_lines_are_printed_on_one() {
    let project = project();
    let name = "odd\nerror: no\u{1b}[2J.ron";
    project.write(name, GRAPH.replace("\"part\", tr", "\"prat\", tr"));
    for words in
        [&["check", name][..], &["run", name], &["fmt", "--check", name], &["why", name, "up"]]
    {
        let told = text_of(&project.maquette(words));
        assert!(!told.contains("\nerror: no") && !told.contains('\u{1b}'), "{words:?}: {told}");
    }
    let outputs = GRAPH.replace("up.ply", "u\\n\\u{1b}p.ply");
    project.write("b.ron", outputs);
    let told = text_of(&project.maquette(&["check", "b.ron"]));
    assert!(told.contains("output `u␊␛p.ply` has a control character in its name"), "{told}");
}
