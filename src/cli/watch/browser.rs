//! `--open`: opens the live page in the user's browser.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use super::launch::{find, split_words, start};

/// The time within which a browser command must not fail. If it does, it has not opened the page.
const MIN_FAILURE_TIME: Duration = Duration::from_secs(5);

/// Opens a file in the browser of `$BROWSER` or in the default browser, without waiting for the browser to end. If that fails, calls
/// `failed` with the reason.
pub(super) fn open(file: &Path, failed: impl FnOnce(&str) + Send + 'static) {
    let commands = commands(file);
    std::thread::spawn(move || {
        if let Err(why) = commands.and_then(first_that_works) {
            failed(&why);
        }
    });
}

/// Returns the commands that may open a file. They are tried in this order.
fn commands(file: &Path) -> Result<Vec<Command>, String> {
    match std::env::var("BROWSER") {
        Ok(named) if !named.trim().is_empty() => Ok(browser_commands(&named, file)),
        _ if !has_display() => Err("there is no display".into()),
        _ => Ok(open::commands(file)),
    }
}

/// Parses the variable `$BROWSER` as `xdg-open` does: commands separated by `:`, with `%s` in place of the file.
fn browser_commands(named: &str, file: &Path) -> Vec<Command> {
    let separator = if cfg!(windows) { '\n' } else { ':' };
    fn parse_command(text: &str, file: &Path) -> Option<Command> {
        let words = split_words(text);
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
    }
    named.split(separator).filter_map(|text| parse_command(text, file)).collect()
}

/// Returns true if a graphical browser can open a window. A text browser would take over the terminal of the watch.
fn has_display() -> bool {
    let names = ["DISPLAY", "WAYLAND_DISPLAY", "WSL_DISTRO_NAME"];
    cfg!(any(windows, target_os = "macos"))
        || names
            .into_iter()
            .any(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()))
}

fn first_that_works(commands: Vec<Command>) -> Result<(), String> {
    let mut why = "no browser command is set".to_owned();
    for mut command in commands {
        let began = Instant::now();
        let program = command.get_program().to_string_lossy().into_owned();
        match start(&mut command).and_then(|mut child| child.wait()) {
            Ok(status) if status.success() || began.elapsed() > MIN_FAILURE_TIME => return Ok(()),
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
    fn the_variable_contains_browsers_and_the_position_of_the_file() {
        let separator = if cfg!(windows) { '\n' } else { ':' };
        let named = format!("no-such --new{separator}no-such-either %s -x{separator}");
        let commands = browser_commands(&named, Path::new("/a b.html"));
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
