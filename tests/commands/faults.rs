//! After a process fails in any way, or the cache is damaged, the next run gives the right result without any repair.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

use crate::output::{stderr_of, stdout_of};
use crate::project::GRAPHS;
use crate::thorough::is_thorough;

/// Returns the command that runs the example graph `doll.ron` with this value of `growth`, this cache and this output folder.
fn command(growth: &str, cache: &Path, out: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_maquette"));
    command.current_dir(GRAPHS).env("NO_COLOR", "1").env("MAQUETTE_CACHE", cache);
    command.args(["run", "doll.ron", "--set", &format!("growth={growth}"), "--out"]).arg(out);
    command
}

fn run(growth: &str, cache: &Path, out: &Path) -> Output {
    let output = command(growth, cache, out).output().unwrap();
    assert!(output.status.success(), "{}", stderr_of(&output));
    output
}

fn start(growth: &str, cache: &Path, out: &Path) -> Child {
    command(growth, cache, out).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

/// Returns the files of a folder by name, without the partial files of killed processes.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let entries = fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path());
    fn name(path: &Path) -> String {
        path.file_name().unwrap().to_str().unwrap().to_owned()
    }
    let whole = entries.filter(|path| !name(path).starts_with(".maquette-"));
    let mut files: Vec<_> = whole.map(|path| (name(&path), fs::read(&path).unwrap())).collect();
    files.sort();
    files
}

/// Returns the outputs for this value of `growth`, computed without a cache.
fn expected_files(growth: &str) -> Vec<(String, Vec<u8>)> {
    let out = tempfile::tempdir().unwrap();
    let output = command(growth, out.path(), out.path()).arg("--no-cache").output().unwrap();
    assert!(output.status.success());
    files(out.path())
}

/// Returns a pseudorandom number below `below` (xorshift).
fn random(state: &mut u64, below: u64) -> u64 {
    *state ^= *state << 13;
    *state ^= *state >> 7;
    *state ^= *state << 17;
    *state % below
}

#[test]
fn a_run_killed_at_any_moment_leaves_whole_files_and_a_right_cache() {
    let (cache, out) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let (old, new) = (expected_files("12"), expected_files("20"));
    run("12", cache.path(), out.path());
    let mut state = 0x9e37_79b9_7f4a_7c15;
    let rounds = if is_thorough() { 200 } else { 60 };
    for round in 0..rounds {
        // Some rounds begin with an empty cache, so that their process is killed while it computes or writes the cache.
        if round % 20 == 0 && cache.path().exists() {
            fs::remove_dir_all(cache.path()).unwrap();
        }
        let mut child = start("20", cache.path(), out.path());
        std::thread::sleep(Duration::from_micros(random(&mut state, 150_000)));
        let _ = child.kill();
        child.wait().unwrap();
        for (name, content) in files(out.path()) {
            fn is(files: &[(String, Vec<u8>)], name: &str, content: &[u8]) -> bool {
                files.contains(&(name.to_owned(), content.to_owned()))
            }
            assert!(
                is(&old, &name, &content) || is(&new, &name, &content),
                "{name} is neither the old nor the new one"
            );
        }
    }
    run("20", cache.path(), out.path());
    assert_eq!(files(out.path()), new);
    // The partial files of the killed processes have been removed.
    assert_eq!(fs::read_dir(out.path()).unwrap().count(), new.len());
}

#[test]
fn four_processes_hammer_one_cache() {
    let cache = tempfile::tempdir().unwrap();
    let growths = ["12", "20", "12", "20"];
    let expected = [expected_files("12"), expected_files("20")];
    for round in 0..5 {
        let outs = growths.map(|_| tempfile::tempdir().unwrap());
        let children =
            [0, 1, 2, 3].map(|worker| start(growths[worker], cache.path(), outs[worker].path()));
        for (worker, mut child) in children.into_iter().enumerate() {
            assert!(child.wait().unwrap().success());
            assert!(files(outs[worker].path()) == expected[worker % 2], "round {round}");
        }
        if round % 2 == 1 {
            let mut clear = Command::new(env!("CARGO_BIN_EXE_maquette"));
            clear.args(["cache", "clear"]).env("MAQUETTE_CACHE", cache.path());
            assert!(clear.output().unwrap().status.success());
        }
    }
}

/// Tests on a small file system. Linux lets ordinary users mount one in a namespace of their own; otherwise only root can mount one.
#[cfg(target_os = "linux")]
mod file_systems {
    use std::io::Write;

    use super::*;

    fn say(what: &str) {
        let _ = writeln!(std::io::stderr(), "{what}");
    }

    /// Runs the shell commands `then` with a small file system mounted at `mount`. Returns `None` if this machine does not allow the mount.
    fn with_mount(options: &str, then: &str, mount: &Path, out: &Path) -> Option<Output> {
        let program = env!("CARGO_BIN_EXE_maquette");
        let (mount, out) = (mount.display(), out.display());
        let script = format!(
            "mount -t tmpfs -o {options} none '{mount}' || exit 77
             run() {{ MAQUETTE_CACHE='{mount}' NO_COLOR=1 '{program}' run doll.ron \"$@\" --out '{out}'; }}
             {then}"
        );
        let mut command = Command::new("unshare");
        command.args(["--mount", "--map-root-user", "sh", "-c", &script]).current_dir(GRAPHS);
        let output = command.output().ok()?;
        let refused =
            output.status.code() == Some(77) || stderr_of(&output).starts_with("unshare:");
        if refused {
            say("skipped: this machine lets us mount no file system");
            return None;
        }
        Some(output)
    }

    #[test]
    fn a_full_disk_costs_the_cache_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let (mount, out) = (folder.path().join("cache"), folder.path().join("out"));
        fs::create_dir(&mount).unwrap();
        let Some(output) = with_mount("size=1m", "run && run", &mount, &out) else { return };
        let words = stderr_of(&output);
        assert!(output.status.success(), "{words}");
        assert!(words.contains("results are not kept for the next run"), "{words}");
        assert_eq!(files(&out), expected_files("12"));
    }

    #[test]
    fn a_cache_that_may_only_be_read_still_answers() {
        let folder = tempfile::tempdir().unwrap();
        let (mount, out) = (folder.path().join("cache"), folder.path().join("out"));
        fs::create_dir(&mount).unwrap();
        let then = format!(
            "run && mount -o remount,ro '{}' && run && run --set growth=20",
            mount.display()
        );
        let Some(output) = with_mount("size=100m", &then, &mount, &out) else { return };
        let words = stderr_of(&output);
        assert!(output.status.success(), "{words}");
        let text = stdout_of(&output);
        assert!(text.contains("15 nodes: 15 cached"), "{text}");
        assert!(text.contains("15 nodes: 8 computed, 7 cached"), "{text}");
        assert_eq!(files(&out), expected_files("20"));
    }
}
