//! Build ids that cargo embeds in programs: they are equal for equal code, and different for different code.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use maquette::{Catalog, Disk, Pack};

/// A cargo workspace for the test. Its libraries `a` and `b` have build ids (`b` depends on `a`). Its programs `one` and `two` print the
/// ids.
struct Workspace(tempfile::TempDir);

const PROGRAM: &str = r#"fn main() { println!("{}\n{}", a::BUILD, b::BUILD) }"#;

/// The folder that contains the manifest of maquette's workspace.
const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

const LIBRARY: &str = r#"pub const BUILD: &str = env!("MAQUETTE_BUILD");"#;

impl Workspace {
    fn new() -> Self {
        let workspace = Self(tempfile::tempdir().unwrap());
        fn package(name: &str, more: &str, workspace: &Workspace) {
            let text = format!(
                "[package]\nname = '{name}'\nversion = '1.0.0'\nedition = '2024'\n{more}\n"
            );
            workspace.write(&format!("{name}/Cargo.toml"), &text);
        }
        fn with_id(name: &str, more: &str, workspace: &Workspace) {
            package(name, &format!("build = '../build.rs'\nlinks = '{name}'\n{more}"), workspace);
        }
        with_id("a", "", &workspace);
        // Put the sources of `b` into its root folder instead of `src`, as in a node pack.
        with_id("b", "[lib]\npath = 'lib.rs'\n[dependencies]\na.path = '../a'", &workspace);
        for name in ["one", "two"] {
            package(name, "[dependencies]\na.path = '../a'\nb.path = '../b'", &workspace);
            workspace.write(&format!("{name}/src/main.rs"), PROGRAM);
        }
        for file in ["a/src/lib.rs", "b/lib.rs"] {
            workspace.write(file, LIBRARY);
        }
        let ours = Path::new(env!("CARGO_MANIFEST_DIR")).join("../build.rs");
        workspace.write("build.rs", &fs::read_to_string(ours).unwrap());
        let members = "[workspace]\nmembers = ['*']\nexclude = ['target']\nresolver = '3'\n";
        let profile = "[profile.dev]\ndebug = false\nincremental = false\n";
        workspace.write("Cargo.toml", &[members, profile].concat());
        workspace
    }

    fn path(&self, file: &str) -> PathBuf {
        self.0.path().join(file)
    }

    fn write(&self, file: &str, text: &str) {
        let path = self.path(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }

    fn append(&self, file: &str, text: &str) {
        self.write(file, &(fs::read_to_string(self.path(file)).unwrap() + text));
    }

    fn command(&self, program: &str) -> Command {
        let mut command = cargo();
        command.args(["run", "--offline", "--quiet", "--package", program]);
        command.current_dir(self.0.path()).env("CARGO_TARGET_DIR", self.path("target"));
        command
    }

    /// Builds a program and runs it. Returns the ids of `a` and `b` that it prints.
    fn ids(&self, program: &str) -> [String; 2] {
        ids(self.command(program))
    }
}

fn cargo() -> Command {
    Command::new(std::env::var_os("CARGO").unwrap_or_else(|| OsString::from("cargo")))
}

fn ids(mut command: Command) -> [String; 2] {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().map(str::to_owned).collect::<Vec<_>>().try_into().unwrap()
}

#[test]
fn an_id_is_that_of_all_that_the_code_is_made_of() {
    let workspace = Workspace::new();
    let first = workspace.ids("one");
    fn is_id(id: &str) -> bool {
        id.len() == 32 && id.bytes().all(|byte| byte.is_ascii_hexdigit())
    }
    assert!(first.iter().all(|id| is_id(id)) && first[0] != first[1], "{first:?}");
    assert_eq!(workspace.ids("two"), first);

    workspace.append("b/lib.rs", "// More.");
    let [a, b] = workspace.ids("one");
    assert!(a == first[0] && b != first[1]);

    fn changes_both(what: &str, before: [String; 2], workspace: &Workspace) -> [String; 2] {
        let after = workspace.ids("one");
        assert!(after[0] != before[0] && after[1] != before[1], "{what}");
        after
    }
    workspace.append("a/src/lib.rs", "// More.");
    let ids = changes_both("a source of `a`", [a, b], &workspace);
    // Changing the program `two` does not change the ids of the libraries that `one` uses, although the lock file lists `two`.
    let manifest = fs::read_to_string(workspace.path("two/Cargo.toml")).unwrap();
    workspace.write("two/Cargo.toml", &manifest.replace("1.0.0", "1.0.1"));
    assert_eq!(workspace.ids("one"), ids);
    // A dev-dependency is not part of the built code, so it need not have an id.
    workspace.write("c/Cargo.toml", "[package]\nname = 'c'\nedition = '2024'\n");
    workspace.write("c/src/lib.rs", "");
    workspace.append("b/Cargo.toml", "\n[dev-dependencies]\nc.path = '../c'\n");
    let [a, b] = workspace.ids("one");
    assert!(a == ids[0] && b != ids[1] && is_id(&b), "{b}");
    let ids = [a, b];
    workspace.append(
        "Cargo.toml",
        "overflow-checks = false\n[profile.dev.package]\ntwo.opt-level = 1\n",
    );
    let ids = changes_both("a profile", ids, &workspace);
    workspace.append("Cargo.toml", "one.opt-level = 1\n");
    assert_eq!(workspace.ids("one"), ids, "the profile of a program above");
    workspace.append("Cargo.toml", "a.codegen-units = 1\n");
    changes_both("the profile of `a` itself", ids, &workspace);
}

#[test]
fn where_a_change_would_go_unnoticed_there_is_no_id() {
    let workspace = Workspace::new();
    let elsewhere = tempfile::tempdir().unwrap();
    let mut command = workspace.command("one");
    command.env("CARGO_TARGET_DIR", elsewhere.path());
    assert_eq!(ids(command), ["", ""]);
    // The library `c` has no id, and the lock file does not record edits of a local library. So a change of `c` would be missed, and no ids
    // are given.
    workspace.write("c/Cargo.toml", "[package]\nname = 'c'\nedition = '2024'\n");
    workspace.write("c/src/lib.rs", "");
    workspace.append("a/Cargo.toml", "[dependencies]\nc.path = '../c'\n");
    assert_eq!(workspace.ids("one"), ["", ""]);
}

/// Returns the number of packs without a build id. The code of such a pack is identified by the hash of the executable that contains it.
fn files_of_code(packs: &[&Pack]) -> usize {
    let folder = tempfile::tempdir().unwrap();
    Disk::open(folder.path(), 1 << 30, &Catalog::new(packs)).unwrap();
    fs::read_dir(folder.path().join("programs")).map_or(0, |found| found.count())
}

#[test]
fn our_packs_are_known_by_their_ids_and_those_of_others_by_their_file() {
    let has_ids = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .ancestors()
        .any(|folder| folder.join("Cargo.lock").is_file());
    assert_eq!(files_of_code(maquette_nodes::PACKS), usize::from(!has_ids));
    // Wait until the hash of the executable is stored on disk. It is stored with a delay, because a file that was just written may still
    // change.
    let is_over = Instant::now() + Duration::from_secs(5);
    while files_of_code(&[&maquette_third_party::PACK]) != 1 {
        assert!(Instant::now() < is_over, "its file was not looked at");
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// Runs `cargo tree` with these arguments. Returns the packages that it lists, each with its features.
fn packages(arguments: &[&str]) -> BTreeSet<String> {
    let mut command = cargo();
    command.args(["tree", "--locked", "--offline", "--prefix", "none", "--format", "{p} {f}"]);
    let output = command.args(arguments).current_dir(FOLDER).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    // `cargo tree` marks repeated packages with `(*)`.
    text.lines().map(|line| line.trim_end_matches(" (*)").to_owned()).collect()
}

#[test]
fn tests_take_the_libraries_that_the_program_was_compiled_with() {
    let program = packages(&["--package", "maquette-program", "--edges", "normal,build"]);
    let tests = packages(&["--edges", "normal,build,dev"]);
    let twice = Vec::from_iter(program.difference(&tests));
    assert!(twice.is_empty(), "with other features in tests: {twice:#?}");
    let manifest = fs::read_to_string(Path::new(FOLDER).join("Cargo.toml")).unwrap();
    assert!(!manifest.contains("[profile.test"), "tests have the profile of `cargo run`");
}
