//! How the lines of a text end.

/// How all lines of a text end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ends {
    /// `\n`.
    Unix,
    /// `\r\n`.
    Windows,
}

impl Ends {
    /// None if they do not all end alike.
    pub fn of(text: &str) -> Option<Self> {
        let (all, windows) = (text.matches('\n').count(), text.matches("\r\n").count());
        match windows {
            0 => Some(Self::Unix),
            _ if windows == all => Some(Self::Windows),
            _ => None,
        }
    }

    /// A text, whose lines all end with `\n`, with these ends.
    pub fn put(self, text: String) -> String {
        match self {
            Self::Unix => text,
            Self::Windows => text.replace('\n', "\r\n"),
        }
    }
}
