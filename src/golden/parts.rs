//! Represents a value as named columns of numbers. Goldens store these columns, and comparisons compare them.

use maquette_value as value;
use maquette_value::{AnyValue, Attributes, ElementKind, Meaning, Range};

/// The meaning of the numbers in a column. It determines how they are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Class {
    /// Positions in mm, compared by distance.
    Position,
    /// Directions, compared by angle.
    Normal,
    /// Other numbers and vectors, compared by the length of the difference vector.
    Number,
    /// Color channels from 0 to 255, compared by the largest difference of a channel.
    Level,
    /// Whole numbers, which are either equal or different.
    Exact,
}

impl From<Meaning> for Class {
    fn from(meaning: Meaning) -> Self {
        match meaning {
            Meaning::Position => Self::Position,
            Meaning::Direction => Self::Normal,
            Meaning::Number => Self::Number,
            Meaning::Level => Self::Level,
            Meaning::Index | Meaning::Exact => Self::Exact,
        }
    }
}

impl From<&value::Part<'_>> for GoldenColumn {
    fn from(part: &value::Part<'_>) -> Self {
        let numbers = part.items.numbers().into_owned();
        let faces = match (&part.name[..], part.element_kind, part.meaning) {
            (SIDES, ElementKind::Face, Meaning::Exact) => true,
            (CORNERS, on, Meaning::Index) => on == ElementKind::Face || on == ElementKind::Corner,
            _ => false,
        };
        Self {
            is_faces: faces,
            ..Self::new(&part.name, part.meaning.into(), part.width.max(1), numbers)
        }
    }
}

/// The names of the two columns with the faces of a mesh. `SIDES` contains the number of corners of each face; it is missing if all faces
/// have the same number. `CORNERS` contains the vertex at each corner of all faces.
pub(crate) const SIDES: &str = "sides";
pub(crate) const CORNERS: &str = "corners";

/// A column of numbers: for each element (such as a vertex), it has `width` numbers.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct GoldenColumn {
    pub(crate) name: String,
    pub(crate) class: Class,
    pub(crate) width: usize,
    /// The number of elements in the value. The column stores every `stride`-th of them.
    pub(crate) count: usize,
    pub(crate) stride: usize,
    /// True if the column contains the faces of a mesh. The name does not tell, because other values may have a column with the same name.
    pub(crate) is_faces: bool,
    pub(crate) numbers: Vec<f64>,
}

impl GoldenColumn {
    pub(crate) fn new(name: &str, class: Class, width: usize, numbers: Vec<f64>) -> Self {
        let count = numbers.len() / width;
        Self { name: name.to_owned(), class, width, count, stride: 1, is_faces: false, numbers }
    }

    /// Returns the numbers of the element at this index of the column.
    pub(crate) fn element(&self, place: usize) -> &[f64] {
        &self.numbers[place * self.width..][..self.width]
    }

    /// Returns a copy of the column with every `stride`-th element.
    pub(crate) fn sample(&self, stride: usize) -> Self {
        let elements = self.numbers.chunks(self.width).step_by(stride).flatten();
        Self { numbers: elements.copied().collect(), stride, ..self.clone() }
    }

    /// Returns the range of each component of the elements, or `None` for a component without finite numbers.
    pub(crate) fn ranges(&self) -> Vec<Option<Range>> {
        value::ranges(&self.numbers, self.width)
    }

    /// Returns the diagonal of the bounding box of all elements, or 0 if there are none.
    pub(crate) fn diagonal(&self) -> f64 {
        let sides = self.ranges().into_iter().flatten().map(|range| range.max - range.min);
        sides.map(|side| side * side).sum::<f64>().sqrt()
    }
}

/// The columns of a value, and its facts. If facts of two values differ, the values are different, even if their columns are equal.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct GoldenParts {
    /// Counts, sizes and kinds. Each has a name, such as `vertices`.
    pub(crate) facts: Vec<(String, String)>,
    pub(crate) columns: Vec<GoldenColumn>,
    /// The number of elements per row, if the elements form a grid of pixels or control points.
    pub(crate) row: Option<usize>,
}

impl GoldenParts {
    /// Splits a value into the parts that are compared. Returns `None` if its type does not support this.
    pub(crate) fn from_value(value: &AnyValue) -> Option<Self> {
        let parts = value.parts();
        (!parts.is_empty()).then(|| Self {
            facts: parts
                .facts
                .iter()
                .map(|fact| (fact.name.to_string(), fact.value.to_string()))
                .collect(),
            columns: parts
                .columns
                .iter()
                .filter(|part| !part.is_hidden)
                .map(GoldenColumn::from)
                .collect(),
            row: parts.row,
        })
    }

    /// Returns a column for each attribute.
    pub(crate) fn attribute_columns(attributes: &Attributes) -> Vec<GoldenColumn> {
        attributes.parts("", ElementKind::Vertex).map(|part| GoldenColumn::from(&part)).collect()
    }

    /// Returns the column with this name.
    pub(crate) fn column(&self, name: &str) -> Option<&GoldenColumn> {
        self.columns.iter().find(|column| column.name == name)
    }
}
