//! `--open`: the user's browser at the live page.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use super::launch::{find, start, words};

/// What ends with an error sooner than this has opened nothing.
const SOON: Duration = Duration::from_secs(5);

/// Opens a file in the browser of `$BROWSER`, or the system's. Does not wait for it; if there is none `failed` is told why.
pub(super) fn open(file: &Path, failed: impl FnOnce(&str) + Send + 'static) {
    let commands = commands(file);
    std::thread::spawn(move || {
        if let Err(why) = commands.and_then(first_that_works) {
            failed(&why);
        }
    });
}

/// What may open a file, the best first.
fn commands(file: &Path) -> Result<Vec<Command>, String> {
    match std::env::var("BROWSER") {
        Ok(named) if !named.trim().is_empty() => Ok(of_variable(&named, file)),
        _ if !has_display() => Err("there is no display".into()),
        _ => Ok(open::commands(file)),
    }
}

/// Those that `$BROWSER` names, as `xdg-open` and others read it: with `:` between them, and `%s` for what to open.
fn of_variable(named: &str, file: &Path) -> Vec<Command> {
    let separator = if cfg!(windows) { '\n' } else { ':' };
    let command = |text: &str| {
        let words = words(text);
        let (program, arguments) = words.split_first()?;
        let mut command = Command::new(find(program).unwrap_or_else(|| program.into()));
        for word in arguments {
            match word == "%s" {
                true => command.arg(file),
                false => command.arg(word),
            };
        }
        if !arguments.iter().any(|word| word == "%s") {
            command.arg(file);
        }
        Some(command)
    };
    named.split(separator).filter_map(command).collect()
}

/// Whether a window can be opened. Where the system has no browser with windows, one in the watch's terminal is not wanted.
fn has_display() -> bool {
    let names = ["DISPLAY", "WAYLAND_DISPLAY", "WSL_DISTRO_NAME"];
    cfg!(any(windows, target_os = "macos"))
        || names
            .into_iter()
            .any(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()))
}

fn first_that_works(commands: Vec<Command>) -> Result<(), String> {
    let mut why = "none is named".to_owned();
    for mut command in commands {
        let began = Instant::now();
        let program = command.get_program().to_string_lossy().into_owned();
        match start(&mut command).and_then(|mut child| child.wait()) {
            Ok(status) if status.success() || began.elapsed() > SOON => return Ok(()),
            Ok(status) => why = format!("{program}: {status}"),
            Err(error) => why = format!("{program}: {error}"),
        }
    }
    Err(why)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_variable_names_browsers_and_where_the_file_stands() {
        let separator = if cfg!(windows) { '\n' } else { ':' };
        let named = format!("no-such --new{separator}no-such-either %s -x{separator}");
        let commands = of_variable(&named, Path::new("/a b.html"));
        let lines: Vec<_> = commands
            .iter()
            .map(|command| {
                let words = std::iter::once(command.get_program()).chain(command.get_args());
                words.map(|word| word.to_str().unwrap().to_owned()).collect::<Vec<_>>().join(" ")
            })
            .collect();
        assert_eq!(lines, ["no-such --new /a b.html", "no-such-either /a b.html -x"]);
        assert!(first_that_works(commands).unwrap_err().starts_with("no-such-either: "));
    }
}
