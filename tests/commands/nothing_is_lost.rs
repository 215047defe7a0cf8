//! Whatever the arguments and the surrounding files are, the program replaces and deletes only its own files.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::symlink;
use std::time::{Duration, Instant};

mod cache;
mod project;
mod surrounded;
mod words;
use project::{GRAPH, Project};

use crate::output::text_of;

#[test]
fn a_case_cannot_name_a_folder_outside_of_the_goldens() {
    for name in ["../../../home/.ssh", "..", "", "a/b", "/etc", "a\\b", ".hidden", "a\u{1b}[2J"] {
        let project = Project::new();
        project.write_outside("home/.ssh/key", "secret");
        let text = format!("Test(graph: \"net.ron\",\n cases: {{{name:?}: ()}})");
        project.write("net.test.ron", &text.replace("\\u{1b}", "\u{1b}"));
        let output = project.maquette(&["test", "--bless"]);
        assert!(!output.status.success(), "{name:?}: {}", text_of(&output));
        assert!(text_of(&output).contains("net.test.ron:2:"), "{name:?}: {}", text_of(&output));
        assert_eq!(project.read_outside("home/.ssh/key"), "secret", "{name:?}");
        assert!(!project.path("goldens").exists(), "{name:?}");
    }
}

#[test]
fn blessing_follows_no_link_out_of_the_goldens() {
    for link in
        ["goldens", "goldens/net", "goldens/net/default", "goldens/other", "goldens/net/old"]
    {
        let project = Project::new();
        for name in ["key", "net.txt", "net.bin", "nodes.txt", "default/net.txt", "old/net.txt"] {
            project.write_outside(&format!("home/{name}"), "secret");
        }
        let before = project.everything_outside();
        project.write("net.test.ron", "Test(graph: \"net.ron\")");
        fs::create_dir_all(project.path(link).parent().unwrap()).unwrap();
        symlink(project.root().join("home"), project.path(link)).unwrap();
        let output = project.maquette(&["test", "--bless"]);
        assert_eq!(project.everything_outside(), before, "{link}: {}", text_of(&output));
    }
}

#[test]
fn goldens_that_nothing_asks_for_go_and_no_other_file_does() {
    let project = Project::new();
    project.write("net.test.ron", "Test(graph: \"net.ron\", cases: {\"old\": (), \"new\": ()})");
    assert!(project.maquette(&["test", "--bless"]).status.success());
    let foreign = [
        "goldens/net/old/photo.png",
        "goldens/net/old/net.view.png",
        "goldens/net/old/notes.txt",
        "goldens/net/new/photo.bin",
        "goldens/net/new/net.png",
        "goldens/readme.txt",
        "goldens/x/nodes.txt",
    ];
    for file in foreign {
        project.write(file, "mine");
    }
    project.write("net.test.ron", "Test(graph: \"net.ron\", cases: {\"new\": ()})");
    let told = project.maquette(&["test"]);
    assert!(
        text_of(&told).contains("goldens/net/old/net.txt belongs to no test"),
        "{}",
        text_of(&told)
    );
    project.write("net.ron", &GRAPH.replace("\"net.json\": \"net\", ", ""));
    let output = project.maquette(&["test", "--bless"]);
    assert!(output.status.success(), "{}", text_of(&output));
    for file in foreign {
        assert_eq!(project.read(file), "mine", "{file}");
    }
    for file in [
        "old/net.txt",
        "old/net.bin",
        "old/mesh.txt",
        "old/nodes.txt",
        "new/net.txt",
        "new/net.bin",
    ] {
        assert!(!project.path("goldens/net").join(file).exists(), "{file}");
    }
    assert!(project.path("goldens/net/new/mesh.txt").exists());
}

#[test]
fn a_misspelled_test_beside_loses_no_golden() {
    let project = Project::new();
    project.write("a.test.ron", "Test(graph: \"net.ron\")");
    project.write("other.ron", GRAPH);
    project.write("b.test.ron", "Test(graph: \"other.ron\")");
    assert!(project.maquette(&["test", "--bless"]).status.success());
    let goldens = project.everything("goldens");
    project.write("b.test.ron", "Test(graf: \"other.ron\")");
    let output = project.maquette(&["test", "a.test.ron", "--bless"]);
    assert!(output.status.success(), "{}", text_of(&output));
    assert_eq!(project.everything("goldens"), goldens);
}

#[test]
fn a_test_reads_no_graph_outside_of_its_project() {
    let project = Project::new();
    project.write_outside("home/net.ron", GRAPH);
    symlink(project.root().join("home/net.ron"), project.path("link.ron")).unwrap();
    let absolute = project.root().join("home/net.ron").display().to_string();
    for graph in ["../home/net.ron", "../home/*.ron", "link.ron", "li*.ron", &absolute] {
        project.write("net.test.ron", &format!("Test(\n graph: \"{graph}\")"));
        let output = project.maquette(&["test", "--bless"]);
        assert!(!output.status.success(), "{graph}: {}", text_of(&output));
        assert!(text_of(&output).contains("net.test.ron:2:"), "{graph}: {}", text_of(&output));
    }
    assert!(!project.path("goldens").exists() && !project.path("home").exists());
}

#[test]
fn goldens_of_a_graph_beside_the_tests_folder_stay_in_it() {
    let project = Project::new();
    project.write("maquette.toml", "");
    project.write("tests/net.test.ron", "Test(graph: \"../net.ron\")");
    assert!(project.maquette(&["test", "--bless"]).status.success());
    assert!(project.maquette(&["test"]).status.success());
    assert!(!project.path("net").exists());
    assert_eq!(fs::read_dir(project.path("tests/goldens")).unwrap().count(), 1);
}

/// Another program replaces an output with a file of equal size immediately after the output was written. The next run must write the
/// output again.
#[test]
fn an_output_that_another_program_replaced_is_made_again() {
    for round in 0..12 {
        let project = Project::new();
        let run = ["run", "net.ron", "--only", "net.json"];
        let place = project.path("out/net/net.json");
        let mut child = project.command(&run).spawn().unwrap();
        let start = Instant::now();
        while !place.exists() {
            assert!(start.elapsed() < Duration::from_secs(60), "no output");
            std::hint::spin_loop();
        }
        let other = "x".repeat(fs::metadata(&place).unwrap().len() as usize);
        match round % 2 {
            0 => fs::write(&place, &other).unwrap(),
            _ => {
                fs::write(project.path("other"), &other).unwrap();
                fs::rename(project.path("other"), &place).unwrap();
            }
        }
        assert!(child.wait().unwrap().success());
        for _ in 0..2 {
            assert!(project.maquette(&run).status.success());
            assert!(project.read("out/net/net.json").starts_with('{'), "round {round}");
        }
    }
}

#[test]
fn outputs_follow_no_link_out_of_their_folder() {
    let project = Project::new();
    project.write_outside("home/app/mesh.ply", "secret");
    let before = project.everything_outside();
    project.write("net.ron", &GRAPH.replace("mesh.ply", "x/mesh.ply"));
    fn run(
        arguments: &[&str],
        project: &Project,
        before: &std::collections::BTreeMap<std::path::PathBuf, Vec<u8>>,
    ) {
        let output = project.maquette(arguments);
        assert_eq!(output.status.code(), Some(1), "{}", text_of(&output));
        assert!(text_of(&output).contains("cannot write"), "{}", text_of(&output));
        assert_eq!(project.everything_outside(), *before, "{}", text_of(&output));
    }
    fs::create_dir_all(project.path("out/net")).unwrap();
    symlink(project.root().join("home/app"), project.path("out/net/x")).unwrap();
    run(&["run", "net.ron"], &project, &before);
    fs::remove_file(project.path("out/net/x")).unwrap();
    symlink(project.root().join("home/new/app"), project.path("out/net/x")).unwrap();
    run(&["run", "net.ron"], &project, &before);
    fs::remove_dir_all(project.path("out")).unwrap();
    symlink(project.root().join("home"), project.path("out")).unwrap();
    run(&["run", "net.ron", "--profile"], &project, &before);
    // A link is followed if the user names it with `--out`.
    assert!(project.maquette(&["run", "net.ron", "--out", "out"]).status.success());
    assert!(project.root().join("home/x/mesh.ply").exists());
}

#[test]
fn only_plain_files_that_may_be_written_are_replaced() {
    let project = Project::new();
    project.write("out/net/mesh.ply", "mine");
    let mut permissions = fs::metadata(project.path("out/net/mesh.ply")).unwrap().permissions();
    permissions.set_readonly(true);
    fs::set_permissions(project.path("out/net/mesh.ply"), permissions).unwrap();
    project.write("target.json", "mine");
    symlink("../../target.json", project.path("out/net/net.json")).unwrap();
    let output = project.maquette(&["run", "net.ron"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text_of(&output).contains("out/net/mesh.ply: it is read-only"), "{}", text_of(&output));
    assert!(text_of(&output).contains("out/net/net.json: it is a link"), "{}", text_of(&output));
    assert_eq!(project.read("out/net/mesh.ply") + &project.read("target.json"), "minemine");
    project.pipe("pipe.svg");
    for place in ["/dev/null", "pipe.svg"] {
        let output = project.maquette(&["test", "--junit", place, "net.test.ron"]);
        assert_eq!(output.status.code(), Some(2), "{place}: {}", text_of(&output));
    }
    assert!(!fs::metadata("/dev/null").unwrap().is_file());
}

#[test]
fn no_command_replaces_what_a_graph_is_made_of_or_reads() {
    let project = Project::new();
    project.write("mug.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    fs::copy(
        concat!(env!("CARGO_MANIFEST_DIR"), "/../../graphs/doll/color.png"),
        project.path("color.png"),
    )
    .unwrap();
    project.write(
        "part.graph",
        "Graph(format: 1, inputs: {\"mesh\": Mesh}, nodes: {\"moved\": Transform(mesh: \"mesh\")}, outputs: {\"moved\": \"moved\"})",
    );
    project.write(
        "mug.ron",
        "Graph(format: 1, use: {\"Part\": \"part.graph\"}, nodes: {
            \"mug\": ReadMesh(path: \"mug.obj\"), \"moved\": Part(mesh: \"mug\"), \"picture\": ReadImage(path: \"color.png\"),
        }, outputs: {\"a.ply\": \"moved\"})",
    );
    project.write("mug.test.ron", "Test(graph: \"mug.ron\")");
    let checked = project.maquette(&["check", "mug.ron"]);
    assert!(checked.status.success(), "{}", text_of(&checked));
    assert!(project.maquette(&["test", "--bless"]).status.success());
    let before = project.everything("");
    let refused = |arguments: &[&str]| {
        let output = project.maquette(arguments);
        assert_ne!(output.status.code(), Some(0), "{arguments:?}: {}", text_of(&output));
        assert_eq!(project.everything(""), before, "{arguments:?}: {}", text_of(&output));
    };
    refused(&["inspect", "mug.ron", "mug", "--out", "mug.obj"]);
    refused(&["inspect", "mug.ron", "picture", "--out", "color.png"]);
    refused(&["render", "mug.ron", "mug", "color.png"]);
    for file in ["mug.ron", "mug.test.ron", "part.graph", "color.png", "mug.obj", "maquette.toml"] {
        refused(&["test", "--report", file]);
        refused(&["test", "--junit", file]);
        // This path leads through a folder that does not exist yet, but it denotes the same file.
        refused(&["test", "--report", &format!("new/../{file}")]);
    }
    refused(&["inspect", "mug.ron", "mug", "--out", "new/../mug.obj"]);
    refused(&["inspect", "mug.ron", "mug", "--csv", "new/../mug.ron"]);
    refused(&["render", "mug.ron", "mug", "new/../color.png"]);
    fs::rename(project.path("mug.ron"), project.path("mug.svg")).unwrap();
    fs::write(project.path("mug.trace.json"), "mine").unwrap();
    let before = project.everything("");
    let output = project.maquette(&["draw", "mug.svg", "--out", "mug.svg"]);
    assert_ne!(output.status.code(), Some(0), "{}", text_of(&output));
    assert_eq!(project.everything(""), before);
}

#[test]
fn a_profile_does_not_replace_what_the_graph_reads() {
    let project = Project::new();
    project.write("out/cam.trace.json", "{}");
    project.write(
        "out/cam.ron",
        "Graph(format: 1, nodes: {\"c\": ReadHandles(path: \"cam.trace.json\")}, outputs: {})",
    );
    project.maquette(&["run", "out/cam.ron", "--out", "out", "--profile"]);
    assert_eq!(project.read("out/cam.trace.json"), "{}");
}

#[test]
fn a_gallery_replaces_no_page_and_no_picture_that_it_did_not_make() {
    let project = Project::new();
    project.write("README.md", "# Mine\n");
    let output = project.maquette(&["render", "gallery", "."]);
    assert_eq!(output.status.code(), Some(1), "{}", text_of(&output));
    assert!(text_of(&output).contains("README.md"), "{}", text_of(&output));
    assert_eq!(project.read("README.md"), "# Mine\n");
    assert!(!project.path("pictures").exists());
    fs::remove_file(project.path("README.md")).unwrap();
    project.write("pictures/net.png", "mine");
    assert_eq!(project.maquette(&["render", "gallery", "."]).status.code(), Some(1));
    assert_eq!(project.read("pictures/net.png"), "mine");
    fs::remove_file(project.path("pictures/net.png")).unwrap();
    assert!(project.maquette(&["render", "gallery", "."]).status.success());
    project.write("net.ron", &GRAPH.replace("1, 1, 2", "1, 1, 3"));
    assert!(project.maquette(&["render", "gallery", "."]).status.success());
    assert!(project.maquette(&["render", "gallery", ".", "--check"]).status.success());
}

#[test]
fn what_killed_runs_left_is_swept_and_what_is_being_written_stays() {
    let project = Project::new();
    let [left, busy] =
        ["aB3dE5gH7jK9", "zY8xW6vU4tS2"].map(|name| format!("out/net/.maquette-{name}.part"));
    let own = [
        "out/net/.maquette-backup",
        "out/net/.maquette-.part",
        "out/net/.maquette-aB3dE5gH7jK9.part.txt",
    ];
    for file in [&left[..], &busy].into_iter().chain(own) {
        project.write(file, "half");
    }
    symlink("../../net.ron", project.path("out/net/.maquette-kkkkkkkkkkkk.part")).unwrap();
    let writing = fs::File::options().append(true).open(project.path(&busy)).unwrap();
    writing.lock().unwrap();
    assert!(project.maquette(&["run", "net.ron"]).status.success());
    assert!(!project.path(&left).exists(), "nobody writes it");
    for file in [&busy[..]].into_iter().chain(own) {
        assert_eq!(project.read(file), "half", "{file}");
    }
    assert!(project.path("out/net/.maquette-kkkkkkkkkkkk.part").is_symlink());
    drop(writing);
    assert!(project.maquette(&["run", "net.ron"]).status.success());
    assert!(!project.path(&busy).exists());
}

#[test]
fn forty_killed_runs_leave_nothing_behind_after_the_next_one() {
    let project = Project::new();
    for round in 0..40 {
        let set = format!("net.points.1.1=(1, 1, {round})");
        let mut child =
            project.command(&["run", "net.ron", "--no-cache", "--set", &set]).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(round * 2));
        let _ = child.kill();
        child.wait().unwrap();
    }
    assert!(project.maquette(&["run", "net.ron"]).status.success());
    let names = fs::read_dir(project.path("out/net")).unwrap();
    let mut names: Vec<_> = names.map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["mesh.ply", "net.json"]);
}

#[test]
fn links_that_lead_in_a_circle_and_pipes_hang_nothing() {
    let project = Project::new();
    project.write("net.test.ron", "Test(graph: \"net.ron\")");
    assert!(project.maquette(&["test", "--bless"]).status.success());
    for folder in ["", "goldens/", "goldens/net/"] {
        for name in ["a", "b", "c"] {
            symlink(".", project.path(&format!("{folder}{name}"))).unwrap();
        }
    }
    assert!(project.maquette(&["test"]).status.success());
    assert!(project.maquette(&["fmt", "."]).status.success());
    project.pipe("x.test.ron");
    let output = project.maquette(&["test"]);
    assert_eq!(output.status.code(), Some(2), "{}", text_of(&output));
    assert!(text_of(&output).contains("it is not a regular file"), "{}", text_of(&output));
    fs::remove_file(project.path("x.test.ron")).unwrap();
    for golden in ["mesh.txt", "nodes.txt", "mesh.bin"] {
        let place = project.path("goldens/net/default").join(golden);
        let text = fs::read(&place).unwrap();
        fs::remove_file(&place).unwrap();
        project.pipe(&format!("goldens/net/default/{golden}"));
        project.maquette(&["test"]);
        fs::remove_file(&place).unwrap();
        fs::write(&place, text).unwrap();
    }
    project.pipe("pipe.ron");
    for command in ["check", "run", "draw", "fmt"] {
        for place in ["pipe.ron", "/dev/zero"] {
            let output = project.maquette(&[command, place]);
            assert_eq!(output.status.code(), Some(1), "{command} {place}: {}", text_of(&output));
            assert!(
                text_of(&output).contains("not a regular file"),
                "{command} {place}: {}",
                text_of(&output)
            );
        }
    }
    assert_ne!(project.maquette(&["compare", "/dev/zero", "pipe.ron"]).status.code(), Some(0));
}

#[test]
fn no_command_waits_for_who_writes_to_a_pipe() {
    let project = Project::new();
    project.pipe("pipe.ron");
    project.pipe("pipe.sweep.ron");
    let commands: &[&[&str]] = &[
        &["diff", "net.ron", "pipe.ron"],
        &["diff", "pipe.ron", "net.ron"],
        &["merge", "net.ron", "pipe.ron", "net.ron"],
        &["merge", "net.ron", "net.ron", "pipe.ron"],
        &["edit", "pipe.ron", "set", "a=1"],
        &["edit", "pipe.ron", "remove", "a"],
        &["edit", "pipe.ron", "extract", "a", "--to", "b.ron"],
        &["edit", "pipe.ron", "inline", "a"],
        &["edit", "pipe.ron", "migrate"],
        &["lock", "pipe.ron"],
        &["pin", "pipe.ron", "a"],
        &["why", "pipe.ron", "a"],
        &["inspect", "pipe.ron", "a"],
        &["render", "pipe.ron", "a", "a.png"],
        &["batch", "pipe.sweep.ron"],
        &["batch", "pipe.ron", "--sweep", "a=1"],
        &["render", "sheet", "pipe.ron"],
        &["test", "pipe.ron"],
        &["new", "--from", "pipe.ron"],
        &["run", "net.ron", "--input", "a=pipe.ron"],
    ];
    for words in commands {
        let output = project.maquette(words);
        assert!(matches!(output.status.code(), Some(1 | 2)), "{words:?}: {}", text_of(&output));
    }
    let output = project.maquette(&["diff", "net.ron", "pipe.ron"]);
    assert!(
        text_of(&output).contains("cannot read pipe.ron: it is not a regular file"),
        "{}",
        text_of(&output)
    );
}

#[test]
fn a_pipe_beside_a_capture_is_an_error_and_no_hang() {
    let project = Project::new();
    for file in ["color.png", "range.pcd"] {
        let from = concat!(env!("CARGO_MANIFEST_DIR"), "/../../graphs/doll");
        fs::copy(format!("{from}/{file}"), project.path(file)).unwrap();
    }
    project.pipe("camera.json");
    project.write(
        "scan.ron",
        "Graph(format: 1, nodes: {\"scan\": ReadCapture(color: \"color.png\", range: \"range.pcd\")}, outputs: {\"a.pcd\": \"scan.range\"})",
    );
    let output = project.maquette(&["run", "scan.ron"]);
    assert_eq!(output.status.code(), Some(1), "{}", text_of(&output));
    assert!(text_of(&output).contains("not a regular file"), "{}", text_of(&output));
}
