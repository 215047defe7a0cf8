//! The cache folder: its reported sizes, and files in it that cannot be removed, are forged, or are incomplete.

use std::fs;
use std::path::{Path, PathBuf};

use maquette::Hash;
use serde_json::Value as Json;

use crate::output::stderr_of;
use crate::project::{LIFTED, Project, TETRAHEDRON};

fn project() -> Project {
    Project::with_tetrahedron(LIFTED)
}

/// Runs a command with the cache in the project's folder; returns the exit code, stdout and stderr.
fn run(project: &Project, words: &[&str]) -> (Option<i32>, String, String) {
    let output = project.maquette(&[words, &["--cache", "cache"]].concat());
    fn text(bytes: &[u8]) -> String {
        String::from_utf8_lossy(bytes).into_owned()
    }
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

/// Each build has a folder in the cache. Lists the files in the subfolder `what` of each of these folders.
fn files(project: &Project, what: &str) -> Vec<PathBuf> {
    fn list(
        folder: &Path,
    ) -> std::iter::Flatten<std::iter::Flatten<std::result::IntoIter<fs::ReadDir>>> {
        fs::read_dir(folder).into_iter().flatten().flatten()
    }
    let homes = list(&project.folder().join("cache")).map(|home| home.path().join(what));
    homes.flat_map(|folder| list(&folder).map(|file| file.path()).collect::<Vec<_>>()).collect()
}

#[test]
fn sizes_are_told_by_node_and_graph() {
    let project = project();
    run(&project, &["run", "doll.ron"]);
    run(&project, &["run", "doll.ron", "--set", "lift=6"]);
    let (code, text, _) = run(&project, &["cache", "du", "--json"]);
    let told: Json = serde_json::from_str(&text).unwrap();
    assert_eq!(code, Some(0));
    let nodes = told["nodes"].as_array().unwrap();
    fn size(node: &str, kind: &str, text: &str, nodes: &[Json]) -> Json {
        nodes
            .iter()
            .find(|it| it["node"] == *node && it["type"] == *kind)
            .unwrap_or_else(|| panic!("{node}: {text}"))
            .clone()
    }
    let graph = project.graph().display().to_string();
    for (node, kind) in [("mesh", "ReadMesh"), ("lifted", "Transform")] {
        let size = size(node, kind, &text, nodes);
        assert_eq!((&size["graph"], &size["results"]), (&graph.clone().into(), &1.into()));
        assert!(size["bytes"].as_u64().unwrap() > 100, "{size}");
    }
    // The result of the first run belongs to an older version of the graph, but its node type is known.
    let older = nodes.iter().find(|it| it["graph"].is_null()).unwrap();
    assert_eq!((&older["type"], &older["results"]), (&"Transform".into(), &1.into()), "{text}");
    fn bytes(value: &Json) -> u64 {
        value.as_u64().unwrap()
    }
    let all = nodes.iter().map(|node| bytes(&node["bytes"])).sum::<u64>() + bytes(&told["other"]);
    assert_eq!(all, bytes(&told["bytes"]));
    let (_, ls, _) = run(&project, &["cache", "ls", "--json"]);
    let ls: Json = serde_json::from_str(&ls).unwrap();
    assert_eq!((&ls["bytes"], &ls["results"]), (&told["bytes"], &told["results"]));
    assert!(nodes.is_sorted_by_key(|node| std::cmp::Reverse(bytes(&node["bytes"]))));
    let (_, text, _) = run(&project, &["cache", "du"]);
    assert!(text.contains("  doll.ron  lifted  Transform\n"), "{text}");
    assert!(text.contains(" total, 3 results\n"), "{text}");
}

#[cfg(unix)]
#[test]
fn what_cannot_be_removed_is_an_error() {
    use std::os::unix::fs::PermissionsExt;

    let project = project();
    run(&project, &["run", "doll.ron"]);
    let cache = project.folder().join("cache");
    let mut folders = vec![cache.clone()];
    let mut next = 0;
    while let Some(folder) = folders.get(next).cloned() {
        let inner = fs::read_dir(&folder).unwrap().map(|it| it.unwrap().path());
        folders.extend(inner.filter(|it| it.is_dir()));
        next += 1;
    }
    fn mode(mode: u32, folders: &[PathBuf]) {
        folders.iter().for_each(|folder| {
            fs::set_permissions(folder, fs::Permissions::from_mode(mode)).unwrap();
        });
    }
    let program = env!("CARGO_BIN_EXE_maquette");
    let mut command = if rustix::process::geteuid().is_root() {
        // Root may remove any file unless it drops this capability.
        let mut command = std::process::Command::new("setpriv");
        command.args(["--bounding-set=-dac_override,-dac_read_search", program]);
        command
    } else {
        std::process::Command::new(program)
    };
    command.current_dir(project.folder()).args(["cache", "clear", "--cache", "cache"]);
    mode(0o555, &folders);
    let count = files(&project, "entries").len();
    assert!(count > 0);
    let output = command.output().unwrap();
    let told = stderr_of(&output);
    assert_eq!(output.status.code(), Some(1), "{told}");
    assert!(
        told.contains("error: cannot remove") && told.contains("= help: make the folder writable"),
        "{told}"
    );
    assert_eq!(files(&project, "entries").len(), count);
    mode(0o755, &folders);
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", stderr_of(&output));
    assert_eq!(files(&project, "entries").len(), 0);
}

/// Computes the checksum that ends a cache file.
fn seal(path: &Path, content: &[u8]) -> [u8; 32] {
    let mut all = Vec::new();
    for name in [path.parent().unwrap().file_name(), path.file_name()] {
        let name = name.unwrap().as_encoded_bytes();
        all.extend((name.len() as u64).to_le_bytes());
        all.extend(name);
    }
    all.extend(content);
    Hash::compute(&all).0
}

fn replace_bytes(bytes: &[u8], old: &str, new: &str) -> Vec<u8> {
    let (mut all, mut rest) = (Vec::new(), bytes);
    while let Some(place) = rest.windows(old.len()).position(|part| part == old.as_bytes()) {
        all.extend(&rest[..place]);
        all.extend(new.as_bytes());
        rest = &rest[place + old.len()..];
    }
    all.extend(rest);
    all
}

/// Returns the hash of the value of the node `lifted`, computed with this value of the parameter `lift`.
fn hash(project: &Project, lift: &str) -> String {
    project.hash("lifted", &[&format!("lift={lift}")])
}

/// Tests an input file that was not changed, and one that was just written. Results that depend on an unchanged file are looked up before
/// anything runs. A file that was just written must be read first, and results that depend on it are looked up later.
#[test]
fn a_result_that_a_node_does_not_give_is_named_by_verify_cache() {
    for is_rewritten in [false, true] {
        name_a_forged_result(is_rewritten);
    }
}

fn name_a_forged_result(is_rewritten: bool) {
    let project = project();
    fn verify(project: &Project) -> (Option<i32>, String, String) {
        run(project, &["run", "doll.ron", "--verify-cache", "100"])
    }
    run(&project, &["run", "doll.ron", "--set", "lift=6"]);
    let other = files(&project, "entries");
    run(&project, &["run", "doll.ron"]);
    assert_eq!(verify(&project).0, Some(0));
    let (right, wrong) = (hash(&project, "5"), hash(&project, "6"));
    // Forges a cache file: it contains the result for another lift, which is valid, but is not the result of this node.
    fn content(path: &Path) -> Vec<u8> {
        let bytes = fs::read(path).unwrap();
        bytes[..bytes.len() - 32].to_vec()
    }
    fn holds(path: &&PathBuf, hash: &str) -> bool {
        let bytes = fs::read(path).unwrap();
        bytes.windows(hash.len()).any(|part| part == hash.as_bytes())
    }
    fn name(path: &Path) -> String {
        path.file_name().unwrap().to_str().unwrap().to_owned()
    }
    let source = other.iter().find(|path| holds(path, &wrong)).unwrap();
    let entries = files(&project, "entries");
    let place = entries.iter().find(|path| holds(path, &right)).unwrap();
    fn forge(path: &Path, content: &[u8]) {
        fs::write(path, [content, &seal(path, content)].concat()).unwrap();
    }
    forge(place, &replace_bytes(&content(source), &name(source), &name(place)));
    for record in files(&project, "graphs") {
        forge(&record, &replace_bytes(&content(&record), &right, &wrong));
    }
    // A run accepts the forged result unless verification is requested.
    assert_eq!(run(&project, &["run", "doll.ron"]).0, Some(0));
    if is_rewritten {
        project.write("tet.obj", TETRAHEDRON);
    }
    let (_, forecast, _) = run(&project, &["run", "-n", "doll.ron", "--verify-cache", "100"]);
    assert_eq!(forecast.matches("computed again to compare it").count(), 2, "{forecast}");
    let (code, out, told) = verify(&project);
    assert_eq!(code, Some(1), "{out}{told}");
    assert!(
        told.contains("error[G019]: `lifted` gave another result than the one in the cache"),
        "{told}"
    );
    assert!(!told.contains("`mesh` gave another result"), "{told}");
    // The output file is made from the newly computed result, not from the forged one.
    let out = project.read("out/doll/out.obj");
    assert!(out.contains("v 0.0 5.0 0.0"), "{out}");
}
