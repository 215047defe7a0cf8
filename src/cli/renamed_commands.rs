//! Former names of commands. The program rejects them, with a message that contains the new command line.

use std::ffi::OsString;

use maquette_syntax::quote_for_shell;

use crate::output::program;

/// The options of the renamed commands whose value is a separate argument.
const WITH_VALUE: [&str; 4] = ["--root", "--to", "--name", "--as"];

/// The new name of a command.
struct NewName {
    /// The new command, and its subcommand or option.
    words: [&'static str; 2],
    /// True if the graph is written between the two words, as in `edit GRAPH set`.
    has_graph_between: bool,
}

/// Returns the new name of a command, or `None` if `name` is not a former name.
fn find_new_name(name: &str) -> Option<NewName> {
    let (words, has_graph_between) = match name {
        "set" => (["edit", "set"], true),
        "extract" => (["edit", "extract"], true),
        "inline" => (["edit", "inline"], true),
        "migrate" => (["edit", "migrate"], true),
        "sheet" => (["render", "sheet"], false),
        "gallery" => (["render", "gallery"], false),
        "update" => (["lock", "--update"], false),
        "unpin" => (["pin", "--remove"], false),
        _ => return None,
    };
    Some(NewName { words, has_graph_between })
}

impl NewName {
    /// Returns the new name as a text, such as `edit GRAPH set`.
    fn name(&self) -> String {
        let [first, second] = self.words;
        let between = if self.has_graph_between { " GRAPH " } else { " " };
        format!("{first}{between}{second}")
    }

    /// Returns the new command line. `arguments` are the arguments after the former name.
    fn command_line(&self, arguments: &[String]) -> String {
        let mut rest: Vec<_> = arguments.iter().map(|argument| quote_for_shell(argument)).collect();
        let [first, second] = self.words.map(str::to_owned);
        let mut words = vec![program(), first];
        if self.has_graph_between {
            let graph = graph_index(arguments).map(|index| rest.remove(index));
            words.push(graph.unwrap_or_else(|| "GRAPH".into()));
        }
        words.push(second);
        words.append(&mut rest);
        words.join(" ")
    }
}

/// Returns the index of the first argument that is neither an option nor the value of an option.
fn graph_index(arguments: &[String]) -> Option<usize> {
    let mut is_value = false;
    for (index, argument) in arguments.iter().enumerate() {
        if !is_value && !argument.starts_with('-') {
            return Some(index);
        }
        is_value = WITH_VALUE.contains(&argument.as_str());
    }
    None
}

/// Returns the error message if `arguments` begin with the former name of a command.
pub(crate) fn message(arguments: &[OsString]) -> Option<String> {
    let (name, rest) = arguments.split_first()?;
    let name = name.to_str()?;
    let renamed = find_new_name(name)?;
    let rest: Vec<_> = rest.iter().map(|it| it.to_string_lossy().into_owned()).collect();
    let line = renamed.command_line(&rest);
    Some(format!("error: `{name}` is now `{}`\n  = help: use `{line}` instead\n", renamed.name()))
}

/// Returns the arguments of `maquette help` that explain a command with this former name, such as `edit set`.
pub(crate) fn help_words(name: &str) -> Option<String> {
    let [first, second] = find_new_name(name)?.words;
    Some(if second.starts_with('-') { first.to_owned() } else { format!("{first} {second}") })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Checks the new command line for a command line with a former name. Both are given without the name of the program.
    fn check(former: &str, expected: &str) {
        let arguments: Vec<String> = former.split(' ').map(str::to_owned).collect();
        let (name, rest) = arguments.split_first().unwrap();
        let line = find_new_name(name).unwrap().command_line(rest);
        assert_eq!(line, format!("{} {expected}", program()));
    }

    #[test]
    fn the_graph_is_moved_before_the_subcommand() {
        check("set g.ron a=1 b=2", "edit g.ron set a=1 b=2");
        check("set --root lib --dry-run g.ron a=1", "edit g.ron set --root lib --dry-run a=1");
        check("extract g.ron a b --to lib/c.ron", "edit g.ron extract a b --to lib/c.ron");
        check("migrate a.ron b.ron --write", "edit a.ron migrate b.ron --write");
    }

    #[test]
    fn a_missing_graph_is_a_placeholder() {
        check("set --help", "edit GRAPH set --help");
    }

    #[test]
    fn other_arguments_stay_in_their_order() {
        check("gallery . --check", "render gallery . --check");
        check("update g.ron Skirt --yes", "lock --update g.ron Skirt --yes");
        check("unpin g.ron a b", "pin --remove g.ron a b");
    }
}
