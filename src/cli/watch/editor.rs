//! Opens a position in a file in the user's editor: `$MAQUETTE_EDITOR`, `$VISUAL`, or `code`.
//!
//! Common editors are known by name, with the arguments that open a position. For any other editor the user must give a template. The
//! editor is started without a shell, so file names need no quoting.

use std::path::Path;
use std::process::Command;

use maquette_preview::Location;

use super::launch::{find, split_words, start};

const VARIABLE: &str = "MAQUETTE_EDITOR";

/// The way in which an editor is started to open a position in a file.
#[derive(Clone, Copy)]
enum Form {
    /// An editor with its own window, and its arguments.
    Arguments(&'static [&'static str]),
    /// An editor that runs in a terminal, and its arguments.
    Terminal(&'static [&'static str]),
    /// An editor with its own window, and its arguments. The options in the second list make it run in a terminal.
    Asked(&'static [&'static str], &'static [&'static str]),
}

const GOTO: Form = Form::Arguments(&["-g", "{file}:{line}:{column}"]);
const SUFFIX: Form = Form::Arguments(&["{file}:{line}:{column}"]);
const CURSOR: &[&str] = &["+call cursor({line},{column})", "{file}"];
const PLUS: &[&str] = &["+{line}:{column}", "{file}"];
const NO_WINDOW: &[&str] = &["-nw", "--no-window-system", "-t", "--tty", "-tty"];
const LINE: Form = Form::Arguments(&["+{line}", "{file}"]);
const LONG: Form = Form::Arguments(&["--line", "{line}", "--column", "{column}", "{file}"]);

/// The known editors, by the name of the program.
const EDITORS: &[(&str, Form)] = &[
    ("code", GOTO),
    ("code-insiders", GOTO),
    ("code-oss", GOTO),
    ("codium", GOTO),
    ("vscodium", GOTO),
    ("cursor", GOTO),
    ("windsurf", GOTO),
    ("zed", SUFFIX),
    ("zeditor", SUFFIX),
    ("subl", SUFFIX),
    ("sublime_text", SUFFIX),
    ("gvim", Form::Arguments(CURSOR)),
    ("mvim", Form::Arguments(CURSOR)),
    ("nvim-qt", Form::Arguments(CURSOR)),
    ("neovide", Form::Arguments(CURSOR)),
    ("vim", Form::Terminal(CURSOR)),
    ("vi", Form::Terminal(CURSOR)),
    ("nvim", Form::Terminal(CURSOR)),
    ("nano", Form::Terminal(&["+{line},{column}", "{file}"])),
    ("micro", Form::Terminal(PLUS)),
    ("kak", Form::Terminal(PLUS)),
    ("hx", Form::Terminal(&["{file}:{line}:{column}"])),
    ("helix", Form::Terminal(&["{file}:{line}:{column}"])),
    ("emacs", Form::Asked(PLUS, NO_WINDOW)),
    ("emacsclient", Form::Asked(PLUS, NO_WINDOW)),
    ("kate", Form::Arguments(&["-l", "{line}", "-c", "{column}", "{file}"])),
    ("kwrite", Form::Arguments(&["-l", "{line}", "-c", "{column}", "{file}"])),
    ("gedit", Form::Arguments(PLUS)),
    ("gnome-text-editor", Form::Arguments(PLUS)),
    ("xed", LINE),
    ("pluma", LINE),
    ("mousepad", Form::Arguments(&["-l", "{line}", "-c", "{column}", "{file}"])),
    ("geany", Form::Arguments(&["-l", "{line}", "--column", "{column}", "{file}"])),
    ("mate", Form::Arguments(&["-l", "{line}:{column}", "{file}"])),
    ("bbedit", LINE),
    ("idea", LONG),
    ("clion", LONG),
    ("rustrover", LONG),
    ("pycharm", LONG),
    ("notepad++", Form::Arguments(&["-n{line}", "-c{column}", "{file}"])),
];

/// Opens a position in the editor, without waiting for the editor to end. If it cannot be started, calls `failed` with the reason.
pub(super) fn open(place: &Location, failed: impl FnOnce(String) + Send + 'static) {
    fn variable(name: &str) -> Option<String> {
        std::env::var(name).ok().filter(|text| !text.trim().is_empty())
    }
    let named = variable(VARIABLE).or_else(|| variable("VISUAL"));
    let text = named.or_else(|| find("code").map(|_| "code".to_owned()));
    let Some(text) = text else {
        return failed(format!(
            "no editor found: set {VARIABLE}, for example to code, or to edit {{file}} --line {{line}}"
        ));
    };
    let command = command_words(&split_words(&text), place).and_then(|words| {
        let found = find(&words[0]).ok_or_else(|| format!("program not found: {}", words[0]))?;
        let mut command = Command::new(found);
        command.args(&words[1..]);
        Ok(command)
    });
    let mut command = match command {
        Ok(command) => command,
        Err(why) => return failed(why),
    };
    std::thread::spawn(move || match start(&mut command).and_then(|mut child| child.wait()) {
        Ok(status) if status.success() => {}
        Ok(status) => failed(format!("the editor {text}: {status}")),
        Err(error) => failed(format!("the editor {text}: {error}")),
    });
}

/// Returns the command line that opens a position in an editor. The error is the reason why the editor cannot be used.
fn command_words(editor: &[String], place: &Location) -> Result<Vec<String>, String> {
    let Some(program) = editor.first() else { return Err("the editor has no name".into()) };
    // Make the path absolute, because a path that begins with `-` would be taken for an option.
    let file = std::path::absolute(&place.file).unwrap_or_else(|_| place.file.clone());
    fn fill(word: &str, file: &Path, place_line: usize, place_column: usize) -> String {
        // Replace `{file}` last, because the name of the file may contain braces.
        let word = word.replace("{line}", &place_line.to_string());
        word.replace("{column}", &place_column.to_string())
            .replace("{file}", &file.to_string_lossy())
    }
    if editor.iter().any(|word| word.contains("{file}")) {
        return Ok(editor.iter().map(|word| fill(word, &file, place.line, place.column)).collect());
    }
    // In `xterm -e vim`, the known editor is the last word, and runs in a terminal of its own.
    let known = editor.iter().rev().find_map(|word| find_form(word).map(|form| (word, form)));
    let is_alone = known.is_some_and(|(word, _)| word == program);
    let arguments = match known {
        Some((_, Form::Terminal(_))) if is_alone => return Err(needs_a_terminal(program)),
        Some((_, Form::Asked(_, asked)))
            if is_alone && editor.iter().any(|word| asked.contains(&&word[..])) =>
        {
            return Err(needs_a_terminal(program));
        }
        Some((
            _,
            Form::Arguments(arguments) | Form::Terminal(arguments) | Form::Asked(arguments, _),
        )) => arguments,
        None => &["{file}"],
    };
    Ok(editor
        .iter()
        .cloned()
        .chain(arguments.iter().map(|word| fill(word, &file, place.line, place.column)))
        .collect())
}

/// Returns the way in which an editor is started, if the name of its program is known.
fn find_form(program: &str) -> Option<Form> {
    let name = Path::new(program).file_name()?.to_string_lossy().to_lowercase();
    let name =
        [".exe", ".cmd", ".bat"].iter().find_map(|end| name.strip_suffix(end)).unwrap_or(&name);
    EDITORS.iter().find(|(known, _)| *known == name).map(|(_, form)| *form)
}

fn needs_a_terminal(program: &str) -> String {
    format!(
        "{program} would need the terminal of the watch: set {VARIABLE} to an editor with a window, or to a terminal \
         with this one, as in xterm -e {program}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the command that opens a file at line 3 and column 5. Its words are separated by ` | `.
    fn command(editor: &str) -> String {
        let file = if cfg!(windows) { "C:\\a b.ron" } else { "/a b.ron" };
        let place = Location { file: file.into(), line: 3, column: 5 };
        match command_words(&split_words(editor), &place) {
            Ok(words) => words.join(" | ").replace(file, "FILE"),
            Err(why) => format!("refused: {why}"),
        }
    }

    #[test]
    fn known_editors_get_the_position_in_their_own_syntax() {
        for (editor, expected) in [
            ("code", "code | -g | FILE:3:5"),
            ("code --wait", "code | --wait | -g | FILE:3:5"),
            ("/usr/bin/codium", "/usr/bin/codium | -g | FILE:3:5"),
            ("Cursor.exe", "Cursor.exe | -g | FILE:3:5"),
            ("zed", "zed | FILE:3:5"),
            ("subl -n", "subl | -n | FILE:3:5"),
            ("gvim", "gvim | +call cursor(3,5) | FILE"),
            ("emacs", "emacs | +3:5 | FILE"),
            ("emacsclient -n", "emacsclient | -n | +3:5 | FILE"),
            ("kate", "kate | -l | 3 | -c | 5 | FILE"),
            ("gedit", "gedit | +3:5 | FILE"),
            ("idea", "idea | --line | 3 | --column | 5 | FILE"),
            ("my-own", "my-own | FILE"),
            ("xterm -e vim", "xterm | -e | vim | +call cursor(3,5) | FILE"),
            ("kitty nvim", "kitty | nvim | +call cursor(3,5) | FILE"),
            ("tmux new-window nano", "tmux | new-window | nano | +3,5 | FILE"),
            ("ed {file}+{line}", "ed | FILE+3"),
            ("nvim --server s --remote '{file}'", "nvim | --server | s | --remote | FILE"),
        ] {
            assert_eq!(command(editor), expected);
        }
    }

    #[test]
    fn an_editor_that_needs_the_terminal_is_refused() {
        for editor in ["vim", "/usr/bin/nvim", "vi", "nano -l", "hx", "emacs -nw", "emacsclient -t"]
        {
            let refused = command(editor);
            assert!(refused.starts_with("refused: ") && refused.contains(VARIABLE), "{refused}");
        }
        assert_eq!(command("''"), " | FILE");
        assert!(command(" ").starts_with("refused: "));
    }

    #[test]
    fn a_file_with_a_strange_name_is_one_argument() {
        let name = "-x; rm {line} $(y).ron";
        let place = Location { file: name.into(), line: 1, column: 2 };
        let words = command_words(&split_words("edit {line} {file}"), &place).unwrap();
        assert_eq!(words.len(), 3);
        assert!(Path::new(&words[2]).is_absolute() && words[2].ends_with(name), "{words:?}");
    }
}
