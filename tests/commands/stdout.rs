//! Standard output that cannot be written, for example to a full disk, is an error of each command. Otherwise a script that replaces a file
//! by the output of a command would get half of it.
#![cfg(target_os = "linux")]

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::process::{Command, Output, Stdio};

use crate::output::{stderr_of, stdout_of};
use crate::project::{LIFTED, Project, TETRAHEDRON};

const USED: &str = r#"Graph(
    format: 1,
    inputs: { "skin": Mesh(doc: "It.") },
    nodes: { "it": Transform(mesh: "skin") },
    outputs: { "skin": "it" },
)
"#;

const USER: &str = r#"Graph(
    format: 1,
    use: { "Lib": "lib.ron" },
    nodes: { "mesh": ReadMesh(path: "tet.obj"), "whole": Lib(skin: "mesh") },
    outputs: { "whole.ply": "whole" },
)
"#;

/// Returns a graph that is longer than any output buffer.
fn long_graph() -> String {
    let nodes = (0..2000)
        .map(|k| format!("        \"n{k}\": Transform(mesh: \"mesh\", translate: ({k}, 0, 0)),\n"));
    format!(
        "Graph(\n    format: 1,\n    nodes: {{\n        \"mesh\": ReadMesh(path: \"tet.obj\"),\n{}    }},\n    outputs: {{ \"o.obj\": \"n0\" }},\n)\n",
        String::from_iter(nodes)
    )
}

fn project() -> Project {
    let project = Project::new(LIFTED);
    let long = long_graph();
    let graph = fs::read_to_string(project.graph()).unwrap();
    let other = graph.replace("5.0", "6.0");
    for folder in ["scans", "graphs"] {
        fs::create_dir(project.folder().join(folder)).unwrap();
    }
    for (name, text) in [
        ("maquette.toml", ""),
        ("tet.obj", TETRAHEDRON),
        ("scans/tet.obj", TETRAHEDRON),
        ("graphs/tet.obj", TETRAHEDRON),
        ("graphs/doll.ron", &graph),
        ("lib.ron", USED),
        ("use.ron", USER),
        ("other.ron", &other),
        ("doll.test.ron", "Test(graph: \"doll.ron\")"),
        ("long.ron", &long),
    ] {
        project.write(name, text);
    }
    project
}

/// The tested command lines, each after the name of the tested command. Commands before `;` only prepare the last command.
const TRIED: [(&str, &str); 38] = [
    ("new", "new scans"),
    ("run", "run doll.ron"),
    ("run", "run doll.ron --json"),
    ("run", "run doll.ron -n"),
    ("batch", "batch doll.ron --sweep lift=1,2"),
    ("batch", "batch doll.ron --sweep lift=1,2 --emit slurm"),
    ("watch", "watch doll.ron --once"),
    ("check", "check long.ron --json"),
    ("draw", "draw long.ron"),
    ("fmt", "fmt -"),
    ("edit", "edit long.ron set n3.translate.0=7 --dry-run"),
    ("edit", "edit doll.ron rename lifted raised"),
    ("edit", "edit doll.ron extract lifted --to new.ron"),
    ("edit", "edit use.ron inline whole"),
    ("diff", "diff doll.ron long.ron --json"),
    ("merge", "merge long.ron long.ron long.ron --print"),
    ("edit", "edit long.ron migrate"),
    ("lock", "lock use.ron"),
    ("lock", "lock use.ron ; lock --update use.ron"),
    ("test", "test ."),
    ("compare", "compare tet.obj tet.obj"),
    ("replay", "run doll.ron ; replay out/doll/out.obj"),
    ("render", "render sheet doll.ron"),
    ("nodes", "nodes"),
    ("nodes", "nodes --json"),
    ("render", "render gallery graphs"),
    ("inspect", "inspect doll.ron lifted"),
    ("inspect", "inspect doll.ron lifted --table vertices --csv -"),
    ("why", "why doll.ron lifted"),
    ("pin", "pin doll.ron lifted"),
    ("pin", "pin doll.ron lifted ; pin --remove doll.ron lifted"),
    ("serve", "serve --stdio"),
    ("cache", "cache ls"),
    ("cache", "run doll.ron ; cache du"),
    ("help", "help"),
    ("help", "help run"),
    ("completions", "completions bash"),
    ("", "--version"),
];

/// Commands that print only answers to an editor, so that they write nothing if no editor asks.
const SILENT: [&str; 1] = ["lsp"];

/// Runs several commands in a new project, and returns the output of the last one, whose standard output is `stdout`. The commands before
/// it prepare the project.
fn run(words: &str, stdout: impl Into<Stdio>) -> Output {
    let project = project();
    let mut commands = words.split(" ; ").collect::<Vec<_>>();
    let last = commands.pop().unwrap();
    let command =
        |words: &str| -> Command { project.command(&words.split(' ').collect::<Vec<_>>()) };
    for words in commands {
        assert!(command(words).output().unwrap().status.success(), "{words}");
    }
    let mut command = command(last);
    command.stdin(File::open(project.folder().join("long.ron")).unwrap());
    command.stdout(stdout).stderr(Stdio::piped()).spawn().unwrap().wait_with_output().unwrap()
}

#[test]
fn every_command_is_tried() {
    let help = project().maquette(&["--help"]);
    let help = stdout_of(&help);
    let (_, commands) = help.split_once("\n\nmake:\n").unwrap();
    let lines = commands
        .lines()
        .take_while(|line| !line.is_empty())
        .filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    let known = lines.filter_map(|line| line.split_whitespace().next());
    let tried = TRIED.iter().map(|(name, _)| *name).chain(SILENT).filter(|name| !name.is_empty());
    assert_eq!(BTreeSet::from_iter(tried), BTreeSet::from_iter(known));
}

#[test]
fn what_cannot_be_printed_is_an_error_of_every_command() {
    for (_, words) in TRIED {
        let printed = run(words, Stdio::piped());
        assert!(!printed.stdout.is_empty(), "{words} prints nothing: {printed:?}");
        let code = printed.status.code().unwrap();
        let full = run(words, File::options().write(true).open("/dev/full").unwrap());
        let told = stderr_of(&full);
        assert!(told.contains("error: cannot write to standard output: "), "{words}: {told}");
        assert_eq!(full.status.code(), Some(code.max(1)), "{words}: {told}");
    }
}

/// Runs a command in a shell that redirects its standard output. Returns the exit code and stderr.
fn run_redirected(words: &str, to: &str) -> (Option<i32>, String) {
    let project = project();
    let script = format!("exec {} {words} {to}", env!("CARGO_BIN_EXE_maquette"));
    let own = project.command(&[]);
    let set = own.get_envs().filter_map(|(name, value)| Some((name, value?)));
    let output =
        Command::new("bash").args(["-c", &script]).current_dir(project.folder()).envs(set).output();
    let output = output.unwrap();
    (output.status.code(), stderr_of(&output))
}

#[test]
fn a_closed_output_is_an_error_of_what_prints_and_null_is_none() {
    for words in ["nodes", "check doll.ron", "run doll.ron --json", "help run", "--version"] {
        let (code, told) = run_redirected(words, ">&-");
        assert_eq!(code, Some(1), "{words}: {told}");
        assert!(told.contains("error: cannot write to standard output: "), "{words}: {told}");
        // `/dev/null` is accepted, in whichever way the shell opens it.
        for null in ["> /dev/null", "1<> /dev/null", "<&- > /dev/null"] {
            assert_eq!(run_redirected(words, null).0, Some(0), "{words} {null}");
        }
    }
    let quiet = "render doll.ron lifted picture.png";
    let (code, told) = run_redirected(quiet, ">&-");
    assert_eq!(code, Some(0), "nothing is printed: {told}");
}

#[test]
fn a_reader_that_has_read_enough_is_no_error() {
    let project = project();
    let command = format!("{} nodes | head -1", env!("CARGO_BIN_EXE_maquette"));
    let script = format!("set -o pipefail; {command}; echo ${{PIPESTATUS[0]}}");
    let output = Command::new("bash").args(["-c", &script]).current_dir(project.folder()).output();
    let output = output.unwrap();
    let text = stdout_of(&output);
    assert_eq!(text.lines().last(), Some("0"), "{text}");
    assert_eq!(stderr_of(&output), "");
}
