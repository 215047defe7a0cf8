//! Scenarios: text files of commands with their expected output, in `tests/commands/scenarios`. Each file is a test of its own name.
//!
//! ```text
//! Title. Commands before the first case are run in each case, and must succeed.
//! $ cp -r $GRAPHS/doll .
//!
//! # Sentence that says what is tested. It begins a case: a new folder with the files below, and a cache of its own.
//! $ maquette check a.ron
//! checked 1 graph: 1 error
//! [1]
//! error[G004]: ReadMesh has no field `pth`
//! ...
//!
//! ## A remark within a case.
//! $ replace a.ron pth path
//! $ maquette check a.ron
//! checked 1 graph: 0 errors
//!
//! -- a.ron --
//! Graph(format: 1, nodes: { "m": ReadMesh(pth: "m.obj") }, outputs: {})
//! ```
//!
//! A line `[1]` is the exit code; the lines after it are standard error. The line is omitted if the code is 0 and standard error is empty.
//! In expected lines, `[..]` stands for any text, and a line `...` for any number of lines. Spaces at the end of a line and blank lines at
//! the end of an output are ignored. In outputs, `$FOLDER` is the path of the case's folder. `UPDATE_EXPECT=1` writes the actual outputs
//! into the files. It keeps lines with `[..]` that still match, and writes `[..]` for durations.
//!
//! A command is `maquette` or a program of the system, such as `cat`, `cmp` (are two files equal?), `cp`, `git`, `ls` and `rm`. Words are
//! quoted as in a shell; `$GRAPHS` is the folder `graphs` of the repository. Variables may be set before a command (`CI=true maquette ..`).
//! Two commands are built in: `write FILE TEXT` makes a file and its folder, `replace FILE OLD NEW ..` replaces texts that the file must
//! have.
//!
//! A command may be followed by these, in this order: `< NAME` passes a section as standard input, or as the text of `write`; such a
//! section is not written as a file. `> FILE` writes standard output to a file. `| grep TEXT ..` keeps the lines of both outputs that
//! contain one of the texts, and `| json PATH ..` prints values of the JSON document on standard output, such as `tasks.*.name,state`.
#![cfg(unix)]

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::{ExitStatus, Output, Stdio};

use serde_json::Value as Json;

use crate::output::stdout_of;
use crate::project::{GRAPHS, Project};

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/commands/scenarios");

macro_rules! scenarios {
    ($($name:ident)*) => {
        const NAMES: &[&str] = &[$(stringify!($name)),*];
        $(#[test] fn $name() { check(stringify!($name)); })*
    };
}

scenarios! {
    all_mistakes batch batch_reports blessing blessing_meshes command_line command_names compare forecasts
    graph_inputs graph_mistakes graph_tests handover kept_failures language_cases language_each language_help
    language_merging language_messages language_patterns language_pins language_provenance language_tables
    language_unknown language_versions missing_files moves new partial_files pictures replaying sheet sweeps
    telling text_commands used_graphs
}

#[test]
fn every_scenario_is_listed() {
    let files = fs::read_dir(FOLDER).unwrap().map(|file| file.unwrap().path());
    let files = files.map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned());
    let names = NAMES.iter().map(|&name| name.to_owned());
    assert_eq!(names.collect::<BTreeSet<_>>(), files.collect());
}

/// Runs a scenario; panics with the commands whose output is not the expected one.
fn check(name: &str) {
    let path = Path::new(FOLDER).join(format!("{name}.txt"));
    let text = fs::read_to_string(&path).unwrap();
    let (script, sections) = split_sections(&text);
    let (mut actual, mut failures, mut case) = (String::new(), String::new(), None);
    let mut lines = script.lines().enumerate().peekable();
    while let Some((number, line)) = lines.next() {
        let _ = writeln!(actual, "{line}");
        if line.starts_with("# ") {
            case = Some(new_case(script, &sections));
        }
        let (Some(command), Some(project)) = (line.strip_prefix("$ "), &case) else { continue };
        let mut expected = Vec::new();
        while let Some((_, line)) = lines.next_if(|(_, line)| !is_command_or_comment(line)) {
            expected.push(line);
        }
        let blank = expected.iter().rev().take_while(|line| line.is_empty()).count();
        let blank = expected.split_off(expected.len() - blank);
        let mut found = lines_of(&run_line(project, command, &sections), project);
        if matches_lines(&expected, &found) {
            found = expected.iter().map(|&line| line.to_owned()).collect();
        } else {
            let _ = writeln!(failures, "{}:{}: {line}", path.display(), number + 1);
            for line in
                expected.iter().filter(|line| !found.iter().any(|it| matches_line(line, it)))
            {
                let _ = writeln!(failures, "  -{line}");
            }
            for line in &mut found {
                if let Some(pattern) = expected.iter().find(|it| matches_line(it, line)) {
                    *line = (*pattern).to_owned();
                } else {
                    let _ = writeln!(failures, "  +{line}");
                    *line = to_pattern(line);
                }
            }
        }
        for line in found.iter().map(String::as_str).chain(blank) {
            let _ = writeln!(actual, "{line}");
        }
    }
    assert!(case.is_some(), "{}: there is no case", path.display());
    if !failures.is_empty() && std::env::var_os("UPDATE_EXPECT").is_some() {
        return fs::write(path, actual + &text[script.len()..]).unwrap();
    }
    assert!(failures.is_empty(), "{failures}UPDATE_EXPECT=1 writes the actual outputs");
}

/// Splits the text of a scenario into its script and its sections: their names and texts.
fn split_sections(text: &str) -> (&str, Vec<(&str, String)>) {
    let mut parts = text.split("\n-- ");
    let script = parts.next().unwrap();
    let sections = parts.map(|part| {
        let (name, rest) = part.split_once(" --").unwrap();
        let lines = rest.lines().skip(1).map(|line| line.to_owned() + "\n");
        (name, lines.collect())
    });
    (script, sections.collect())
}

/// Makes a folder with the sections that no command reads as its input, and runs the commands before the first case in it.
fn new_case(script: &str, sections: &[(&str, String)]) -> Project {
    let project = Project::empty();
    for (name, text) in sections {
        if !script.lines().any(|line| has_input(line, name)) {
            project.write(name, text);
        }
    }
    let setup = script.lines().take_while(|line| !line.starts_with("# "));
    for command in setup.filter_map(|line| line.strip_prefix("$ ")) {
        let output = run_line(&project, command, sections);
        assert!(output.status.success(), "{command}: {output:?}");
    }
    project
}

/// Returns true if the line is a command with this section as its input.
fn has_input(line: &str, section: &str) -> bool {
    line.starts_with("$ ") && format!("{line} ").contains(&format!(" < {section} "))
}

fn is_command_or_comment(line: &str) -> bool {
    ["$ ", "# ", "## "].iter().any(|start| line.starts_with(start))
}

/// Returns the lines that a scenario expects for this output.
fn lines_of(output: &Output, project: &Project) -> Vec<String> {
    let [stdout, stderr] = [&output.stdout, &output.stderr].map(|bytes| {
        let text = String::from_utf8_lossy(bytes).replace(GRAPHS, "$GRAPHS");
        text.replace(project.folder().to_str().unwrap(), "$FOLDER").trim_end().to_owned()
    });
    let mut lines: Vec<_> = stdout.lines().map(|line| line.trim_end().to_owned()).collect();
    if !output.status.success() || !stderr.is_empty() {
        lines.push(format!("[{}]", output.status.code().unwrap_or(-1)));
        lines.extend(stderr.lines().map(|line| line.trim_end().to_owned()));
    }
    lines
}

fn matches_lines(expected: &[&str], found: &[String]) -> bool {
    match expected {
        [] => found.is_empty(),
        ["...", rest @ ..] => (0..=found.len()).any(|count| matches_lines(rest, &found[count..])),
        [line, rest @ ..] => {
            found.first().is_some_and(|first| matches_line(line, first))
                && matches_lines(rest, &found[1..])
        }
    }
}

fn matches_line(pattern: &str, line: &str) -> bool {
    let Some((start, rest)) = pattern.split_once("[..]") else { return pattern == line };
    let Some(line) = line.strip_prefix(start) else { return false };
    (0..=line.len()).any(|at| line.is_char_boundary(at) && matches_line(rest, &line[at..]))
}

/// Replaces the first duration in a line, and everything after it, by the pattern `[..]`. Also replaces the start of a line that looks like
/// a command or a comment.
fn to_pattern(line: &str) -> String {
    if is_command_or_comment(line) {
        return "[..]".to_owned() + &line[1..];
    }
    let words: Vec<_> = line.split(' ').collect();
    let Some(at) = words.windows(2).position(is_duration) else { return line.to_owned() };
    words[..at].join(" ").trim_end().to_owned() + " [..]"
}

fn is_duration(words: &[&str]) -> bool {
    words[0].parse::<f64>().is_ok() && ["ms", "s"].contains(&words[1])
}

/// Splits a command line into words, as a shell does.
fn split_words(line: &str) -> Vec<String> {
    let (mut words, mut word, mut quote) = (Vec::new(), None::<String>, None);
    let mut chars = line.chars();
    while let Some(next) = chars.next() {
        match (quote, next) {
            (Some(open), _) if next == open => quote = None,
            (None, '"' | '\'') => {
                quote = Some(next);
                word.get_or_insert_default();
            }
            (None, ' ') => words.extend(word.take()),
            (Some('"'), '\\') => word.get_or_insert_default().extend(chars.next()),
            _ => word.get_or_insert_default().push(next),
        }
    }
    assert!(quote.is_none(), "unclosed quote: {line}");
    words.extend(word);
    words.iter().map(|word| word.replace("$GRAPHS", GRAPHS)).collect()
}

/// Runs a command of a scenario with its redirections and its filter.
fn run_line(project: &Project, line: &str, sections: &[(&str, String)]) -> Output {
    let mut words = split_words(line);
    let filter = split_at_word(&mut words, "|");
    let file = split_at_word(&mut words, ">").pop();
    let input = split_at_word(&mut words, "<").pop().map_or("", |name| {
        let section = sections.iter().find(|section| section.0 == name);
        &section.unwrap_or_else(|| panic!("there is no section `{name}`")).1[..]
    });
    let mut output = run_command(project, &words, input);
    if let Some(file) = file {
        fs::write(project.folder().join(file), std::mem::take(&mut output.stdout)).unwrap();
    }
    match filter.split_first() {
        None => {}
        Some((name, texts)) if name == "grep" => {
            for bytes in [&mut output.stdout, &mut output.stderr] {
                let text = String::from_utf8_lossy(bytes).into_owned();
                let lines = text.split_inclusive('\n');
                let lines = lines.filter(|line| texts.iter().any(|text| line.contains(text)));
                *bytes = lines.collect::<String>().into();
            }
        }
        Some((name, paths)) if name == "json" => {
            let document = serde_json::from_str(&stdout_of(&output));
            let document = document.unwrap_or_else(|why| panic!("{line}: {why}"));
            let values = paths.iter().flat_map(|path| select(&document, path));
            output.stdout = values.map(|value| value + "\n").collect::<String>().into();
        }
        Some(_) => panic!("unknown filter: {line}"),
    }
    output
}

/// Removes `word` and all words after it from a command line. Returns the words after it.
fn split_at_word(words: &mut Vec<String>, word: &str) -> Vec<String> {
    let Some(at) = words.iter().position(|it| it == word) else { return Vec::new() };
    words.split_off(at).split_off(1)
}

/// Returns the values at a path of keys, indices and `*`. The last part may have several keys, separated by commas.
fn select(value: &Json, path: &str) -> Vec<String> {
    match (path.split_once('.'), value) {
        (Some(("*", rest)), Json::Array(items)) => {
            items.iter().flat_map(|item| select(item, rest)).collect()
        }
        (Some((key, rest)), _) => find(value, key).map_or(Vec::new(), |value| select(value, rest)),
        (None, _) => {
            let values = path.split(',').map(|key| match find(value, key) {
                Some(Json::String(text)) => text.clone(),
                value => value.unwrap_or(&Json::Null).to_string(),
            });
            vec![values.collect::<Vec<_>>().join(" ")]
        }
    }
}

fn find<'a>(value: &'a Json, key: &str) -> Option<&'a Json> {
    value.get(key).or_else(|| value.get(key.parse::<usize>().ok()?))
}

fn run_command(project: &Project, words: &[String], input: &str) -> Output {
    let words: Vec<_> = words.iter().map(String::as_str).collect();
    match words[..] {
        ["write", file] => project.write(file, input),
        ["write", file, text] => project.write(file, text),
        ["replace", file, ref pairs @ ..] => {
            let mut text = project.read(file);
            for pair in pairs.chunks(2) {
                assert!(text.contains(pair[0]), "{file} has no `{}`", pair[0]);
                text = text.replace(pair[0], pair[1]);
            }
            project.write(file, &text);
        }
        _ => return run_program(project, &words, input),
    }
    Output { status: ExitStatus::default(), stdout: Vec::new(), stderr: Vec::new() }
}

fn run_program(project: &Project, words: &[&str], input: &str) -> Output {
    let count = words.iter().take_while(|word| is_variable(word)).count();
    let (variables, words) = words.split_at(count);
    let folder = Path::new(env!("CARGO_BIN_EXE_maquette")).parent().unwrap().display();
    let path = format!("{folder}:{}", std::env::var("PATH").unwrap_or_default());
    let mut command = project.program(words[0], &words[1..]);
    command.env("PATH", path).env("NO_COLOR", "1").env("LC_ALL", "C");
    command.env("GIT_CONFIG_GLOBAL", "/dev/null").env("GIT_CONFIG_NOSYSTEM", "1");
    for role in ["AUTHOR", "COMMITTER"] {
        command.env(format!("GIT_{role}_NAME"), "A").env(format!("GIT_{role}_EMAIL"), "a@b.c");
    }
    command.envs(variables.iter().filter_map(|variable| variable.split_once('=')));
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap_or_else(|why| panic!("{}: {why}", words[0]));
    // A program that refuses its arguments may end before it reads its input.
    let _ = child.stdin.take().unwrap().write_all(input.as_bytes());
    child.wait_with_output().unwrap()
}

/// Returns true for a word such as `CI=true`.
fn is_variable(word: &str) -> bool {
    word.starts_with(char::is_uppercase) && word.contains('=')
}
