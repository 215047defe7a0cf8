//! How the lines of a text end.

/// How all lines of a text end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ends {
    /// `\n`.
    Unix,
    /// `\r\n`.
    Windows,
    /// `\r`, as once on the Macintosh.
    Mac,
}

impl Ends {
    /// None if they do not all end alike.
    pub fn of(text: &str) -> Option<Self> {
        let [feeds, returns, both] = ["\n", "\r", "\r\n"].map(|end| text.matches(end).count());
        match (feeds, returns) {
            // A return may be a space, too.
            (_, 0) => Some(Self::Unix),
            (0, _) => Some(Self::Mac),
            _ if both == 0 => Some(Self::Unix),
            _ if both == feeds => Some(Self::Windows),
            _ => None,
        }
    }

    fn letters(self) -> &'static str {
        match self {
            Self::Unix => "\n",
            Self::Windows => "\r\n",
            Self::Mac => "\r",
        }
    }

    /// A text with these ends, with `\n` in their place.
    pub fn plain(self, text: &str) -> String {
        text.replace(self.letters(), "\n")
    }

    /// A text, whose lines all end with `\n`, with these ends.
    pub fn put(self, text: String) -> String {
        match self {
            Self::Unix => text,
            Self::Windows | Self::Mac => text.replace('\n', self.letters()),
        }
    }
}
