//! A value as named columns of numbers: what goldens keep of it, and what comparisons compare.

use maquette_value as value;
use maquette_value::{AnyValue, Attributes, Meaning, On, Range};

/// What the numbers of a column mean, and so how two of them are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Class {
    /// Places in mm: by their distance.
    Place,
    /// Directions: by their angle.
    Normal,
    /// Numbers and vectors of any other kind: by the length of their difference.
    Number,
    /// Channels of colors, 0 to 255: by the largest difference of a channel.
    Level,
    /// Whole numbers that are equal or not.
    Exact,
}

impl From<Meaning> for Class {
    fn from(meaning: Meaning) -> Self {
        match meaning {
            Meaning::Position => Self::Place,
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
        let faces = match (&part.name[..], part.on, part.meaning) {
            (SIDES, On::Face, Meaning::Exact) => true,
            (CORNERS, on, Meaning::Index) => on == On::Face || on == On::Corner,
            _ => false,
        };
        Self { faces, ..Self::new(&part.name, part.meaning.into(), part.width.max(1), numbers) }
    }
}

/// What the columns are called that are the faces of a mesh, where they lie on faces and are numbers of vertices: how many corners each
/// face has, if not all have as many, and which these are.
pub(crate) const SIDES: &str = "sides";
pub(crate) const CORNERS: &str = "corners";

/// One column: `width` numbers for each element.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct GoldenColumn {
    pub(crate) name: String,
    pub(crate) class: Class,
    pub(crate) width: usize,
    /// Elements of the value; the column holds every `stride`-th of them.
    pub(crate) count: usize,
    pub(crate) stride: usize,
    /// Whether it is the faces of a mesh, and no other column that is called the same.
    pub(crate) faces: bool,
    pub(crate) numbers: Vec<f64>,
}

impl GoldenColumn {
    pub(crate) fn new(name: &str, class: Class, width: usize, numbers: Vec<f64>) -> Self {
        let count = numbers.len() / width;
        Self { name: name.to_owned(), class, width, count, stride: 1, faces: false, numbers }
    }

    /// The numbers of the element at this place of the column.
    pub(crate) fn element(&self, place: usize) -> &[f64] {
        &self.numbers[place * self.width..][..self.width]
    }

    /// Every `stride`-th element.
    pub(crate) fn every(&self, stride: usize) -> Self {
        let elements = self.numbers.chunks(self.width).step_by(stride).flatten();
        Self { numbers: elements.copied().collect(), stride, ..self.clone() }
    }

    /// The range of each component; none where no number is finite.
    pub(crate) fn ranges(&self) -> Vec<Option<Range>> {
        value::ranges(&self.numbers, self.width)
    }

    /// The length of the diagonal of the box around all elements; 0 without any.
    pub(crate) fn diagonal(&self) -> f64 {
        let sides = self.ranges().into_iter().flatten().map(|range| range.greatest - range.least);
        sides.map(|side| side * side).sum::<f64>().sqrt()
    }
}

/// The columns of a value, and the facts that must be equal before columns are compared.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct GoldenParts {
    /// Counts, sizes and kinds.
    pub(crate) facts: Vec<(String, String)>,
    pub(crate) columns: Vec<GoldenColumn>,
    /// Elements in a row, where the elements are pixels or control points.
    pub(crate) row: Option<usize>,
}

impl GoldenParts {
    /// The parts of a value that are compared; none for a value that tells of none.
    pub(crate) fn of(value: &AnyValue) -> Option<Self> {
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
                .filter(|part| !part.aside)
                .map(GoldenColumn::from)
                .collect(),
            row: parts.row,
        })
    }

    /// Attributes alone.
    pub(crate) fn of_attributes(attributes: &Attributes) -> Vec<GoldenColumn> {
        attributes.parts("", On::Vertex).map(|part| GoldenColumn::from(&part)).collect()
    }

    /// The column of this name.
    pub(crate) fn column(&self, name: &str) -> Option<&GoldenColumn> {
        self.columns.iter().find(|column| column.name == name)
    }
}
