//! Runs every command that writes or deletes files in a project that is full of links, pipes, devices and foreign files.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use super::project::{GRAPH, Project, everything};
use crate::output::text_of;

const HASH: &str = "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef";

/// The folders to which the program writes. Each contains foreign files named `NAMES`, which resemble the names of the program's files.
const FOLDERS: [&str; 9] = [
    ".",
    "goldens",
    "goldens/net",
    "goldens/net/default",
    "goldens/stale/default",
    "out",
    "out/net",
    "gallery",
    "gallery/pictures",
];
const NAMES: [&str; 9] = [
    "mine.txt",
    "mine.bin",
    "mine.view.png",
    "mine.ply",
    ".maquette-backup",
    ".maquette-aB3dE5gH7jK9.part.old",
    "mesh.view.txt",
    "mine.trace.json",
    "CACHEDIR.TAG",
];

fn project_with_neighbors() -> Project {
    let project = Project::new();
    for name in [
        "key",
        "net.txt",
        "net.bin",
        "nodes.txt",
        "mesh.ply",
        "net.json",
        "app/config",
        "README.md",
        "a.ron",
        "net.png",
    ] {
        project.write_outside(&format!("home/{name}"), "secret");
    }
    project.write_outside("home/graph.ron", "Graph(format:1,nodes:{},outputs:{})");
    project.write_outside(&format!("home/entries/{HASH}"), "secret");
    for folder in FOLDERS {
        for name in NAMES {
            project.write(&format!("{folder}/{name}"), "mine");
        }
        for (name, target) in [
            ("here", "."),
            ("up", ".."),
            ("zero", "/dev/zero"),
            ("zero.ron", "/dev/zero"),
            ("nothing", "no/such"),
        ] {
            symlink(target, project.path(folder).join(name)).unwrap();
        }
        for name in ["home", "home.txt", "old"] {
            symlink(project.root().join("home"), project.path(folder).join(name)).unwrap();
        }
        symlink(project.root().join("home/graph.ron"), project.path(folder).join("link.ron"))
            .unwrap();
        project.pipe(&format!("{folder}/pipe.ron"));
        project.pipe(&format!("{folder}/pipe.txt"));
    }
    project.write("net.test.ron", "Test(graph: \"net.ron\")\n");
    project
        .write("evil/a.test.ron", "Test(graph: \"../net.ron\", cases: {\"../../../home\": ()})\n");
    project.write("evil/b.test.ron", "Test(graph: \"../../home/graph.ron\")\n");
    project.write("evil/c.test.ron", "Test(graph: \"../net.ron\", cases: {\"default\": ()})\n");
    project.write("evil/misspelled.test.ron", "Test(graf: \"../net.ron\")\n");
    symlink(project.root().join("home"), project.path("evil/goldens")).unwrap();
    let linked =
        GRAPH.replace("mesh.ply", "home/mesh.ply").replace("net.json", "home.txt/net.json");
    project.write("linked.ron", &linked);
    symlink(project.root().join("home"), project.path("out/linked")).unwrap();
    fs::create_dir(project.path("out/partly")).unwrap();
    symlink(project.root().join("home"), project.path("out/partly/home")).unwrap();
    project.write("partly.ron", &GRAPH.replace("mesh.ply", "home/mesh.ply"));
    project.write("gallery/net.ron", GRAPH);
    project.write("gallery/README.md", "mine");
    project.write("read-only.ron", "Graph(format:1,nodes:{},outputs:{})");
    let mut permissions = fs::metadata(project.path("read-only.ron")).unwrap().permissions();
    permissions.set_readonly(true);
    fs::set_permissions(project.path("read-only.ron"), permissions).unwrap();
    let texts = ["evil", "net.test.ron", "linked.ron", "partly.ron"];
    assert!(project.maquette(&[&["fmt"][..], &texts].concat()).status.success());
    project.write("programs/film.mov", "mine");
    project.write(&format!("programs/{HASH}"), "mine");
    project
}

/// Returns all files except the goldens, outputs and pictures that the commands may write.
fn foreign(project: &Project) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = everything(project.root(), &[project.root().join("cache")]);
    let ours = [
        "goldens/net/default/net.txt",
        "goldens/net/default/net.bin",
        "goldens/net/default/mesh.txt",
        "goldens/net/default/mesh.bin",
        "goldens/net/default/nodes.txt",
        "out/net/net.json",
        "out/net/mesh.ply",
        "out/net/net.trace.json",
        "out/partly/net.json",
        "inspected.ply",
        "rendered.png",
        "drawn.svg",
        "report.html",
        "junit.xml",
    ];
    for name in ours {
        all.remove(&project.path(name));
    }
    all
}

#[test]
fn nothing_outside_and_nothing_of_others_changes_whatever_is_run() {
    let project = project_with_neighbors();
    let before = foreign(&project);
    let commands: &[(&[&str], i32)] = &[
        (&["test", "net.test.ron", "--bless"], 0),
        (&["test", "net.test.ron", "--report", "report.html", "--junit", "junit.xml"], 0),
        (&["test", "--bless"], 2),
        (&["test", "evil", "--bless"], 2),
        (&["test", "evil/c.test.ron", "--bless"], 2),
        (&["test", "net.test.ron", "--report", "home/key/report.html"], 2),
        (&["test", "net.test.ron", "--junit", "zero"], 2),
        (&["run", "net.ron", "--profile"], 0),
        (&["run", "linked.ron"], 1),
        (&["run", "linked.ron", "--out", "out/net"], 1),
        (&["run", "partly.ron"], 1),
        (&["run", "zero.ron"], 1),
        (&["run", "pipe.ron"], 1),
        (&["inspect", "net.ron", "mesh", "--out", "inspected.ply"], 0),
        (&["inspect", "net.ron", "mesh", "--out", "home.txt"], 2),
        (&["inspect", "net.ron", "mesh", "--out", "nothing/mesh.ply"], 2),
        (&["render", "net.ron", "mesh", "rendered.png"], 0),
        (&["render", "net.ron", "mesh", "net.ron"], 2),
        (&["draw", "net.ron", "--out", "drawn.svg"], 0),
        (&["render", "gallery", "gallery"], 1),
        (&["render", "gallery", "."], 1),
        (&["fmt", "net.ron", "."], 1),
        (&["fmt", "read-only.ron"], 1),
        (&["edit", "read-only.ron", "set", "x.y=1"], 1),
        (&["cache", "gc", "--limit", "0", "--cache", "."], 2),
        (&["cache", "clear", "--cache", "home"], 2),
        (&["cache", "doctor", "--cache", "goldens"], 2),
        (&["run", "net.ron", "--cache", "."], 2),
        (&["cache", "gc", "--limit", "0"], 0),
        (&["cache", "clear"], 0),
    ];
    for &(arguments, code) in commands {
        let output = project.maquette(arguments);
        let after = foreign(&project);
        assert_same(&before, &after, arguments);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {}", text_of(&output));
    }
    assert!(project.path("goldens/net/default/mesh.txt").is_file());
    assert!(project.path("out/net/mesh.ply").is_file());
}

fn assert_same(
    before: &BTreeMap<PathBuf, Vec<u8>>,
    after: &BTreeMap<PathBuf, Vec<u8>>,
    arguments: &[&str],
) {
    let changed: Vec<&Path> = before
        .keys()
        .chain(after.keys())
        .filter(|path| before.get(*path) != after.get(*path))
        .map(|path| &**path)
        .collect();
    assert!(changed.is_empty(), "{arguments:?} changed {changed:?}");
}
