//! Line endings of texts.

/// The line ending that all lines of a text share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineEnding {
    /// `\n`.
    Unix,
    /// `\r\n`.
    Windows,
    /// `\r`, as on classic Mac OS.
    Mac,
}

impl LineEnding {
    /// Returns the line ending of a text. `None` if the lines have different endings.
    pub fn detect(text: &str) -> Option<Self> {
        let [feeds, returns, both] = ["\n", "\r", "\r\n"].map(|end| text.matches(end).count());
        match (feeds, returns) {
            // A single carriage return may also occur in the middle of a line, as a space character.
            (_, 0) => Some(Self::Unix),
            (0, _) => Some(Self::Mac),
            _ if both == 0 => Some(Self::Unix),
            _ if both == feeds => Some(Self::Windows),
            _ => None,
        }
    }

    fn sequence(self) -> &'static str {
        match self {
            Self::Unix => "\n",
            Self::Windows => "\r\n",
            Self::Mac => "\r",
        }
    }

    /// Converts the line endings of a text from `self` to `\n`.
    pub fn normalize(self, text: &str) -> String {
        text.replace(self.sequence(), "\n")
    }

    /// Converts the line endings of a text from `\n` to `self`.
    pub fn apply(self, text: String) -> String {
        match self {
            Self::Unix => text,
            Self::Windows | Self::Mac => text.replace('\n', self.sequence()),
        }
    }
}
