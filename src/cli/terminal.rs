//! Draws text on the alternate screen of the terminal, and reads keyboard input.

use std::io::{IsTerminal, Write, stdin, stdout};

use crossterm::event::{Event, KeyCode, KeyEventKind, KeyModifiers, read};
use crossterm::terminal::{
    BeginSynchronizedUpdate, Clear, ClearType, EndSynchronizedUpdate, EnterAlternateScreen,
    LeaveAlternateScreen, disable_raw_mode, enable_raw_mode, size,
};
use crossterm::{cursor, queue};

/// An input from the user.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Input {
    Key(char),
    /// The terminal was resized.
    Resized,
    /// The user pressed Ctrl-C.
    Stop,
}

/// The alternate screen of the terminal, which can be redrawn. Dropping it restores the normal screen.
pub(super) struct Screen {
    open: bool,
}

impl Screen {
    /// Returns true if a terminal can be used for drawing and for keyboard input.
    pub(super) fn is_possible() -> bool {
        let dumb = std::env::var_os("TERM").is_some_and(|terminal| terminal == "dumb");
        stdin().is_terminal() && stdout().is_terminal() && !dumb && is_in_foreground()
    }

    /// Switches to the alternate screen. A background thread passes the user's input to `sink`.
    pub(super) fn is_open(sink: impl Fn(Input) + Send + 'static) -> std::io::Result<Self> {
        enable_raw_mode()?;
        let screen = Self { open: true };
        queue!(stdout(), EnterAlternateScreen, cursor::Hide)?;
        stdout().flush()?;
        std::thread::spawn(move || {
            while let Ok(event) = read() {
                if let Some(input) = to_input(&event) {
                    sink(input);
                }
            }
        });
        Ok(screen)
    }

    /// Returns the size of the terminal as (columns, rows). Both are at least 1.
    pub(super) fn size(&self) -> (usize, usize) {
        let (columns, rows) = size().unwrap_or((80, 24));
        (usize::from(columns.max(1)), usize::from(rows.max(1)))
    }

    /// Clears the screen and draws the given rows, which must fit into its width and height.
    pub(super) fn draw(&self, rows: &[String]) {
        let mut bytes = Vec::new();
        // Ignore errors: writing to memory cannot fail. A closed terminal is noticed elsewhere, because keyboard input ends.
        let _ = queue!(bytes, BeginSynchronizedUpdate, cursor::MoveTo(0, 0));
        for (index, row) in rows.iter().enumerate() {
            bytes.extend_from_slice(if index > 0 { b"\r\n" } else { b"" });
            bytes.extend_from_slice(row.as_bytes());
            let _ = queue!(bytes, Clear(ClearType::UntilNewLine));
        }
        let _ = queue!(bytes, Clear(ClearType::FromCursorDown), EndSynchronizedUpdate);
        let mut stdout = stdout().lock();
        let _ = stdout.write_all(&bytes).and_then(|()| stdout.flush());
    }
}

impl Screen {
    /// Restores the normal screen.
    pub(super) fn close(&mut self) {
        if !std::mem::take(&mut self.open) {
            return;
        }
        let _ = queue!(stdout(), cursor::Show, LeaveAlternateScreen);
        let _ = stdout().flush();
        let _ = disable_raw_mode();
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        self.close();
    }
}

fn to_input(event: &Event) -> Option<Input> {
    match event {
        Event::Resize(..) => Some(Input::Resized),
        Event::Key(key) if key.kind == KeyEventKind::Press => match key.code {
            KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => {
                Some(Input::Stop)
            }
            KeyCode::Char(key) => Some(Input::Key(key.to_ascii_lowercase())),
            _ => None,
        },
        _ => None,
    }
}

/// Returns true if the program runs in the foreground. In the background (started with `&`) it must not use the terminal.
#[cfg(target_os = "linux")]
fn is_in_foreground() -> bool {
    rustix::termios::tcgetpgrp(stdin()).is_ok_and(|group| group == rustix::process::getpgrp())
}

/// Returns true, because on this system no background process shares the terminal.
#[cfg(not(target_os = "linux"))]
fn is_in_foreground() -> bool {
    true
}

/// Wraps a text into rows of at most `width` columns, at spaces where possible. Escape sequences for colors have no width. A color
/// continues in the next row.
pub(super) fn wrap(text: &str, width: usize) -> Vec<String> {
    text.lines().flat_map(|line| wrap_line(line, width.max(1))).collect()
}

fn wrap_line(line: &str, width: usize) -> Vec<String> {
    const RESET: &str = "\x1b[0m";
    let mut rows = vec![String::new()];
    let (mut used, mut style) = (0, String::new());
    for (part, is_style) in console::AnsiCodeIterator::new(line) {
        if is_style {
            if part == RESET {
                style.clear();
            } else {
                style += part;
            }
            rows.last_mut().expect("there is a row").push_str(part);
            continue;
        }
        for word in part.split_inclusive(' ') {
            let wide = console::measure_text_width(word.trim_end());
            if used > 0 && used + wide > width && wide <= width {
                new_row(&mut rows, &style);
                used = 0;
            }
            for letter in word.chars() {
                let wide = console::measure_text_width(letter.encode_utf8(&mut [0; 4]));
                if used + wide > width {
                    if letter == ' ' {
                        continue;
                    }
                    new_row(&mut rows, &style);
                    used = 0;
                }
                rows.last_mut().expect("there is a row").push(letter);
                used += wide;
            }
        }
    }
    rows
}

/// Begins a new row in the color `style`, after resetting the color at the end of the previous row. An empty `style` means no color.
fn new_row(rows: &mut Vec<String>, style: &str) {
    if !style.is_empty() {
        rows.last_mut().expect("there is a row").push_str("\x1b[0m");
    }
    rows.push(style.to_owned());
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(text: &str, width: usize, expected: &[&str]) {
        assert_eq!(wrap(text, width), expected);
    }

    #[test]
    fn text_breaks_between_words_and_long_words_anywhere() {
        check("one two three", 8, &["one two ", "three"]);
        check("one two", 3, &["one", "two"]);
        check("abcdefgh", 3, &["abc", "def", "gh"]);
        check("a\n\nb", 3, &["a", "", "b"]);
    }

    #[test]
    fn colors_have_no_width_and_continue_after_a_break() {
        check("\x1b[31mone two\x1b[0m", 4, &["\x1b[31mone \x1b[0m", "\x1b[31mtwo\x1b[0m"]);
    }

    #[test]
    fn wide_letters_count_twice() {
        check("日本語", 4, &["日本", "語"]);
    }
}
