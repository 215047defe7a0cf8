//! The kinds of elements of columns, and the meanings of their numbers.

/// The kind of the elements of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ElementKind {
    /// Vertices of a mesh.
    Vertex,
    /// Corners of faces, face by face.
    Corner,
    /// Faces of a mesh.
    Face,
    /// Edges of a mesh.
    Edge,
    /// Pixels of a picture or cells of a grid, row by row from the top.
    Pixel,
    /// Pixels of the picture on a surface, row by row from the top.
    Texel,
    /// Points, control points, handles.
    Point,
    /// Steps of an iteration.
    Step,
    /// Entries of a list whose length is independent of other columns, such as knots.
    Entry,
    /// The value itself: the column has one entry.
    Whole,
}

impl ElementKind {
    const ALL: [Self; 10] = [
        Self::Vertex,
        Self::Corner,
        Self::Face,
        Self::Edge,
        Self::Pixel,
        Self::Texel,
        Self::Point,
        Self::Step,
        Self::Entry,
        Self::Whole,
    ];

    /// The singular noun for an element of this kind.
    pub fn word(self) -> &'static str {
        match self {
            Self::Vertex => "vertex",
            Self::Corner => "corner",
            Self::Face => "face",
            Self::Edge => "edge",
            Self::Pixel => "pixel",
            Self::Texel => "texel",
            Self::Point => "point",
            Self::Step => "step",
            Self::Entry => "entry",
            Self::Whole => "whole",
        }
    }

    /// Parses a word that [`word`](Self::word) returns.
    ///
    /// # Errors
    /// If the word is unknown. The error is a message that lists the known words.
    pub fn from_word(word: &str) -> Result<Self, String> {
        find_by_word(word, &Self::ALL, Self::word, "element kind")
    }
}

/// The meaning of a column's numbers. It decides how two of the numbers are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meaning {
    /// Positions in mm: compared by their distance.
    Position,
    /// Directions: compared by their angle.
    Direction,
    /// Numbers and vectors of any other kind: compared by the length of their difference.
    Number,
    /// Color channels, 0 to 255, 8-bit sRGB: compared by the largest difference of a channel.
    Level,
    /// Indices of other elements, from 0, or the labels of components. Two indices are either equal or different.
    Index,
    /// Other whole numbers, including flags (0 and 1). Two of them are either equal or different.
    Exact,
}

impl Meaning {
    const ALL: [Self; 6] =
        [Self::Position, Self::Direction, Self::Number, Self::Level, Self::Index, Self::Exact];

    /// Returns the noun for this meaning, such as `position`.
    pub fn word(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::Direction => "direction",
            Self::Number => "number",
            Self::Level => "level",
            Self::Index => "index",
            Self::Exact => "exact",
        }
    }

    /// Parses a word that [`word`](Self::word) returns.
    ///
    /// # Errors
    /// If the word is unknown. The error is a message that lists the known words.
    pub fn from_word(word: &str) -> Result<Self, String> {
        find_by_word(word, &Self::ALL, Self::word, "meaning of numbers")
    }
}

fn find_by_word<T: Copy>(
    word: &str,
    all: &[T],
    name: fn(T) -> &'static str,
    what: &str,
) -> Result<T, String> {
    let found = all.iter().copied().find(|it| name(*it) == word);
    found.ok_or_else(|| {
        let known = all.iter().map(|it| name(*it)).collect::<Vec<_>>().join(", ");
        format!("unknown {what} `{word}`, expected one of {known}")
    })
}
