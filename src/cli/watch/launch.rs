//! Starts programs of the user, such as a browser or an editor.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// Starts a program that does not depend on the watch or its terminal.
pub(super) fn start(command: &mut Command) -> std::io::Result<Child> {
    #[cfg(unix)]
    // Put the program into a new process group, so that Ctrl-C in the terminal of the watch does not end it.
    std::os::unix::process::CommandExt::process_group(command, 0);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn()
}

/// Splits a command line at spaces outside of quotes, as a shell does. If the whole text is the path of an existing file, it is one word.
pub(super) fn split_words(text: &str) -> Vec<String> {
    if Path::new(text).is_file() {
        return vec![text.to_owned()];
    }
    let (mut words, mut word, mut quote) = (Vec::new(), None::<String>, None);
    for letter in text.chars() {
        match (quote, letter) {
            (Some(open), _) if open == letter => quote = None,
            (None, '"' | '\'') => {
                quote = Some(letter);
                word.get_or_insert_default();
            }
            (None, _) if letter.is_whitespace() => words.extend(word.take()),
            _ => word.get_or_insert_default().push(letter),
        }
    }
    words.extend(word);
    words
}

/// Returns the path of a program, which is given by its path or searched in `$PATH`.
pub(super) fn find(program: &str) -> Option<PathBuf> {
    let endings: &[&str] = if cfg!(windows) { &["", ".exe", ".cmd", ".bat"] } else { &[""] };
    fn find_in_folder(folder: &Path, program: &str, endings: &[&str]) -> Option<PathBuf> {
        let paths = endings.iter().map(|ending| folder.join(format!("{program}{ending}")));
        paths.into_iter().find(|path| is_program(path))
    }
    if Path::new(program).components().count() > 1 {
        return find_in_folder(Path::new(""), program, endings);
    }
    let folders = std::env::var_os("PATH")?;
    std::env::split_paths(&folders).find_map(|folder| find_in_folder(&folder, program, endings))
}

fn is_program(path: &Path) -> bool {
    let Ok(metadata) = std::fs::metadata(path) else { return false };
    #[cfg(unix)]
    let may_run = std::os::unix::fs::PermissionsExt::mode(&metadata.permissions()) & 0o111 != 0;
    #[cfg(not(unix))]
    let may_run = true;
    metadata.is_file() && may_run
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_is_split_as_in_a_shell() {
        let cases: [(&str, &[&str]); 6] = [
            ("code --wait", &["code", "--wait"]),
            ("  code\t-g  ", &["code", "-g"]),
            ("'/my programs/code' -x", &["/my programs/code", "-x"]),
            ("a\"b c\"d ''", &["ab cd", ""]),
            ("\"it's\"", &["it's"]),
            ("", &[]),
        ];
        for (text, expected) in cases {
            assert_eq!(split_words(text), expected, "{text}");
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("my code");
        std::fs::write(&path, "").unwrap();
        let path = path.to_str().unwrap();
        assert_eq!(split_words(path), [path]);
    }
}
