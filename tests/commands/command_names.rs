//! The names of the commands: `maquette --help` lists six groups, and former names are errors with a hint.

use std::collections::BTreeSet;

use crate::project::Project;

/// Runs the program. Returns the exit code, standard output and standard error.
fn run(arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = Project::new("").maquette(arguments);
    let [stdout, stderr] = [output.stdout, output.stderr].map(|it| String::from_utf8(it).unwrap());
    (output.status.code(), stdout, stderr)
}

/// Returns the groups of `maquette --help` with their commands.
fn groups() -> Vec<(String, Vec<String>)> {
    let (_, help, _) = run(&["--help"]);
    let (_, list) = help.split_once("Usage: maquette <COMMAND>\n\n").unwrap();
    let mut groups: Vec<(String, Vec<String>)> = Vec::new();
    for line in list.lines().take_while(|line| !line.is_empty()) {
        match line.strip_prefix("  ") {
            Some(command) => {
                let (name, about) = command.split_once("  ").unwrap();
                assert!(!about.trim().is_empty(), "{line}: no description");
                groups.last_mut().unwrap().1.push(name.to_owned());
            }
            None => groups.push((line.trim_end_matches(':').to_owned(), Vec::new())),
        }
    }
    groups
}

#[test]
fn help_lists_at_most_24_commands_each_in_one_of_six_groups() {
    let groups = groups();
    let names: Vec<_> = groups.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["make", "run", "look", "test", "edit", "share"]);
    let commands: Vec<_> = groups.iter().flat_map(|(_, commands)| commands).collect();
    assert!(commands.len() <= 24, "{commands:?}");
    assert_eq!(BTreeSet::from_iter(&commands).len(), commands.len(), "{commands:?}");
}

#[test]
fn every_command_has_a_help_page() {
    let commands = groups().into_iter().flat_map(|(_, commands)| commands);
    for command in commands.filter(|command| command != "help") {
        let (code, help, _) = run(&[&command, "--help"]);
        assert!(code == Some(0) && help.contains("Usage: maquette"), "{command}: {help}");
    }
    for words in [&["edit", "set"][..], &["edit", "migrate"], &["render", "sheet"]] {
        let (code, help, _) = run(&[&["help"], words].concat());
        assert!(code == Some(0) && help.contains("Usage: maquette"), "{words:?}: {help}");
    }
}
