//! What the elements of a column are, and what its numbers mean.

/// What the elements of a column are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum On {
    /// Vertices of a mesh.
    Vertex,
    /// Corners of faces, face by face.
    Corner,
    /// Faces of a mesh.
    Face,
    /// Edges.
    Edge,
    /// Pixels of a picture or cells of a grid, row by row from the top.
    Pixel,
    /// Pixels of the picture on a surface, row by row from the top.
    Texel,
    /// Points, control points, handles.
    Point,
    /// Steps of an iteration.
    Step,
    /// Entries of a list of its own length, such as knots.
    Entry,
    /// The whole value: there is one element.
    Whole,
}

impl On {
    /// All of them.
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

    /// The word for one element.
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

    /// The one that a word names.
    ///
    /// # Errors
    /// In words, with those that there are.
    pub fn named(word: &str) -> Result<Self, String> {
        named(word, &Self::ALL, Self::word, "columns lie on")
    }
}

/// What the numbers of a column mean, and so how two of them are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meaning {
    /// Places in mm: compared by their distance.
    Position,
    /// Directions: by their angle.
    Direction,
    /// Numbers and vectors of any other kind: by the length of their difference.
    Number,
    /// Channels of colors, 0 to 255, 8-bit sRGB: by the largest difference of a channel.
    Level,
    /// Numbers of other elements, from 0, or of components: equal or not.
    Index,
    /// Other whole numbers, flags (0 and 1) among them: equal or not.
    Exact,
}

impl Meaning {
    /// All of them.
    const ALL: [Self; 6] =
        [Self::Position, Self::Direction, Self::Number, Self::Level, Self::Index, Self::Exact];

    /// The word for it.
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

    /// The one that a word names.
    ///
    /// # Errors
    /// In words, with those that there are.
    pub fn named(word: &str) -> Result<Self, String> {
        named(word, &Self::ALL, Self::word, "numbers mean")
    }
}

fn named<T: Copy>(
    word: &str,
    all: &[T],
    name: fn(T) -> &'static str,
    what: &str,
) -> Result<T, String> {
    let found = all.iter().copied().find(|it| name(*it) == word);
    found.ok_or_else(|| {
        let known = all.iter().map(|it| name(*it)).collect::<Vec<_>>().join(", ");
        format!("{what} one of {known}, not `{word}`")
    })
}
