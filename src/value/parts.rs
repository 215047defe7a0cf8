//! The parts of a value: columns of numbers, and facts such as counts and sizes.
//!
//! Tests compare parts, `maquette inspect --table` prints them, and programs that embed the engine read them as arrays. Conversely,
//! [`Value::from_parts`](super::Value::from_parts) builds values from arrays. None of these uses needs to know the type of the value.
//!
//! ```
//! use maquette_value::{Mask, Meaning, Value};
//!
//! let mask = Mask::from_rows(&["#.", ".."]);
//! let parts = mask.parts();
//! let inside = parts.column("inside").unwrap();
//! assert_eq!((inside.meaning, inside.width, inside.count()), (Meaning::Exact, 1, 4));
//! assert_eq!(Mask::from_parts(&parts).unwrap(), mask);
//! ```

use std::borrow::Cow;
use std::fmt;

use nalgebra::Point3;
use thiserror::Error;

mod kinds;

pub use kinds::{ElementKind, Meaning};

/// The facts and the columns of a value, in a fixed order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parts<'a> {
    /// The facts: counts, sizes and kinds. Two values must have equal facts before their columns are compared.
    pub facts: Vec<Fact>,
    /// The columns of numbers, each with one entry per element of its kind.
    pub columns: Vec<Part<'a>>,
    /// The number of elements per row, if the elements are pixels or control points.
    pub row: Option<usize>,
}

/// A named property of a whole value, such as its number of vertices.
#[derive(Clone, Debug, PartialEq)]
pub struct Fact {
    /// The fact's name, such as `vertices`.
    pub name: Cow<'static, str>,
    /// The fact's content: a count, a size, a flag or a text.
    pub value: FactValue,
}

/// The content of a [`Fact`]: a count, a size, a flag or a text.
#[derive(Clone, Debug, PartialEq)]
pub enum FactValue {
    /// A number of elements, such as `vertices`.
    Count(usize),
    /// The size of a grid: columns and rows of pixels, or rows and columns of control points.
    Size([usize; 2]),
    /// A property that is either true or false, such as `closed`.
    Flag(bool),
    /// A word or sentence, such as the name of a space.
    Text(String),
}

impl fmt::Display for FactValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Count(count) => count.fmt(f),
            Self::Size([a, b]) => write!(f, "{a} x {b}"),
            Self::Flag(flag) => flag.fmt(f),
            Self::Text(text) => f.write_str(text),
        }
    }
}

impl From<usize> for FactValue {
    fn from(count: usize) -> Self {
        Self::Count(count)
    }
}

impl From<[usize; 2]> for FactValue {
    fn from(size: [usize; 2]) -> Self {
        Self::Size(size)
    }
}

impl From<bool> for FactValue {
    fn from(flag: bool) -> Self {
        Self::Flag(flag)
    }
}

impl From<String> for FactValue {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

/// A column with `width` numbers for each element.
#[derive(Clone, Debug, PartialEq)]
pub struct Part<'a> {
    /// The column's name, such as `position`.
    pub name: Cow<'a, str>,
    /// The kind of the column's elements.
    pub element_kind: ElementKind,
    /// The meaning of the column's numbers.
    pub meaning: Meaning,
    /// The number of numbers per element, which is at least 1. A position has the width 3.
    pub width: usize,
    /// The numbers, element by element. Their count is a multiple of `width`.
    pub items: Items<'a>,
    /// True if tests ignore the column, because a fact or the value's hash covers the content of the column.
    pub is_hidden: bool,
}

/// The numbers of a column. They are borrowed from the value if the value stores them contiguously.
#[derive(Clone, Debug, PartialEq)]
pub enum Items<'a> {
    /// Numbers in double precision.
    F64(Cow<'a, [f64]>),
    /// Numbers in single precision.
    F32(Cow<'a, [f32]>),
    /// Whole numbers.
    U32(Cow<'a, [u32]>),
    /// Flags and color levels, each a byte.
    U8(Cow<'a, [u8]>),
}

/// Error of building a value from parts.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PartsError {
    /// Values of the type cannot be built from parts.
    #[error("a {kind} cannot be made of parts")]
    Never {
        /// The name of the type of values.
        kind: &'static str,
    },
    /// The parts do not make a value; contains the message.
    #[error("{0}")]
    Invalid(String),
}

impl PartsError {
    /// The error of a missing part.
    pub(super) fn missing(part: &str) -> Self {
        Self::Invalid(format!("the part `{part}` is missing"))
    }

    /// Wraps the error of a constructor.
    pub fn from_error(error: impl std::error::Error) -> Self {
        Self::Invalid(error.to_string())
    }

    /// The error of a fact that is missing or has the wrong type.
    pub(super) fn wrong_fact(fact: &str, expected: &str) -> Self {
        Self::Invalid(format!("the fact `{fact}` must be {expected}"))
    }
}

/// The minimum, maximum and mean of some numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// The minimum of the numbers.
    pub min: f64,
    /// The maximum of the numbers.
    pub max: f64,
    /// The mean of the numbers.
    pub mean: f64,
}

/// Splits `numbers` into elements of `width` components. For each component, returns the range of its finite numbers, or `None` if it has
/// none.
pub fn ranges(numbers: &[f64], width: usize) -> Vec<Option<Range>> {
    (0..width)
        .map(|component| {
            let column = numbers.iter().skip(component).step_by(width).filter(|x| x.is_finite());
            let start = (f64::INFINITY, f64::NEG_INFINITY, 0.0, 0usize);
            let (min, max, sum, count) = column.fold(start, |(min, max, sum, n), &x| {
                (f64::min(min, x), f64::max(max, x), sum + x, n + 1)
            });
            (count > 0).then(|| Range { min, max, mean: sum / count as f64 })
        })
        .collect()
}

impl<'a> Parts<'a> {
    /// Returns true if there is neither a fact nor a column.
    pub fn is_empty(&self) -> bool {
        self.facts.is_empty() && self.columns.is_empty()
    }

    /// Adds a fact.
    pub fn fact(&mut self, name: impl Into<Cow<'static, str>>, value: impl Into<FactValue>) {
        self.facts.push(Fact { name: name.into(), value: value.into() });
    }

    /// Adds the fact `size` of a picture with the given numbers of columns and rows.
    pub fn grid(&mut self, width: usize, height: usize) {
        self.fact("size", [width, height]);
        self.row = Some(width);
    }

    /// Adds a column.
    pub fn push(
        &mut self,
        name: impl Into<Cow<'a, str>>,
        on: ElementKind,
        meaning: Meaning,
        width: usize,
        items: impl Into<Items<'a>>,
    ) {
        let (name, items) = (name.into(), items.into());
        self.columns.push(Part { name, element_kind: on, meaning, width, items, is_hidden: false });
    }

    /// Adds a column that tests ignore; see [`Part::is_hidden`].
    pub fn push_hidden(
        &mut self,
        name: impl Into<Cow<'a, str>>,
        on: ElementKind,
        meaning: Meaning,
        width: usize,
        items: impl Into<Items<'a>>,
    ) {
        let (name, items) = (name.into(), items.into());
        self.columns.push(Part { name, element_kind: on, meaning, width, items, is_hidden: true });
    }

    /// The first column with this name.
    pub fn column(&self, name: &str) -> Option<&Part<'a>> {
        self.columns.iter().find(|part| part.name == name)
    }

    /// The first column with this name whose elements are of the kind `on`.
    pub fn find(&self, on: ElementKind, name: &str) -> Option<&Part<'a>> {
        self.columns.iter().find(|part| part.element_kind == on && part.name == name)
    }

    /// Returns the first column with this name, if there is one. Its elements must be complete and have `width` numbers.
    ///
    /// # Errors
    /// If its width differs or its last element is incomplete.
    pub fn column_of(&self, name: &str, width: usize) -> Result<Option<&Part<'a>>, PartsError> {
        self.column(name).map(|part| part.with_width(width)).transpose()
    }

    /// Returns the first column with this name. Its elements must be complete and have `width` numbers.
    ///
    /// # Errors
    /// If it is missing, its width differs, or its last element is incomplete.
    pub fn require(&self, name: &str, width: usize) -> Result<&Part<'a>, PartsError> {
        self.column_of(name, width)?.ok_or_else(|| PartsError::missing(name))
    }

    /// The value of the first fact with this name.
    pub fn fact_of(&self, name: &str) -> Option<&FactValue> {
        self.facts.iter().find(|fact| fact.name == name).map(|fact| &fact.value)
    }

    /// The two counts of the fact with this name, whose value must be a [`FactValue::Size`].
    ///
    /// # Errors
    /// If the fact is missing or has another type.
    pub fn size_of(&self, name: &str) -> Result<[usize; 2], PartsError> {
        match self.fact_of(name) {
            Some(FactValue::Size(size)) => Ok(*size),
            _ => Err(PartsError::wrong_fact(name, "two counts")),
        }
    }

    /// The count of the fact with this name, whose value must be a [`FactValue::Count`].
    ///
    /// # Errors
    /// If the fact is missing or has another type.
    pub fn count_of(&self, name: &str) -> Result<usize, PartsError> {
        match self.fact_of(name) {
            Some(FactValue::Count(count)) => Ok(*count),
            _ => Err(PartsError::wrong_fact(name, "a count")),
        }
    }

    /// The columns and rows of a picture. They come from the fact `size`, or else are computed from [`row`](Self::row) and the number of
    /// pixels.
    ///
    /// # Errors
    /// If neither source is available.
    pub fn size(&self) -> Result<[usize; 2], PartsError> {
        let pixels = self
            .columns
            .iter()
            .find(|part| part.element_kind == ElementKind::Pixel)
            .map(Part::count);
        match (self.fact_of("size"), self.row, pixels) {
            (None, Some(row), Some(pixels)) if row > 0 => Ok([row, pixels.div_ceil(row)]),
            _ => self.size_of("size"),
        }
    }
}

impl Part<'_> {
    /// The number of elements of the column.
    pub fn count(&self) -> usize {
        self.items.len() / self.width.max(1)
    }

    /// For each component, the range of the finite numbers. `None` for a component without finite numbers.
    pub fn ranges(&self) -> Vec<Option<Range>> {
        ranges(&self.items.numbers(), self.width.max(1))
    }

    /// Returns the column, if its elements are complete and have `expected` numbers.
    ///
    /// # Errors
    /// If its width differs or its last element is incomplete.
    pub fn with_width(&self, expected: usize) -> Result<&Self, PartsError> {
        let (numbers, width) = (self.items.len(), self.width);
        if width != expected {
            let part = &self.name;
            return Err(PartsError::Invalid(format!(
                "the part `{part}` has {width} numbers per element, expected {expected}"
            )));
        }
        match numbers % width.max(1) {
            0 => Ok(self),
            rest => Err(self.wrong_length(numbers - rest + width)),
        }
    }

    fn wrong_length(&self, expected: usize) -> PartsError {
        let (part, numbers) = (&self.name, self.items.len());
        PartsError::Invalid(format!("the part `{part}` has {numbers} numbers, expected {expected}"))
    }

    /// Returns the column if it has `count` elements.
    ///
    /// # Errors
    /// If the number of elements differs.
    pub fn with_count(&self, count: usize) -> Result<&Self, PartsError> {
        match count.checked_mul(self.width) {
            Some(numbers) if numbers == self.items.len() => Ok(self),
            numbers => Err(self.wrong_length(numbers.unwrap_or(usize::MAX))),
        }
    }

    /// Returns the error for a number that is not allowed in the column.
    pub fn number_error(&self, index: usize, number: f64, expected: &str) -> PartsError {
        let part = &self.name;
        PartsError::Invalid(format!(
            "number {index} of the part `{part}` is {number}, expected {expected}"
        ))
    }

    /// The column's elements as arrays of `N` numbers.
    ///
    /// # Errors
    /// If the column's width is not `N` or the last element is incomplete.
    pub fn elements<const N: usize>(&self) -> Result<Vec<[f64; N]>, PartsError> {
        self.with_width(N)?;
        Ok(self.items.numbers().as_chunks().0.to_vec())
    }

    /// The only element of a column.
    ///
    /// # Errors
    /// If the column does not have exactly one element of `N` numbers.
    pub fn single<const N: usize>(&self) -> Result<[f64; N], PartsError> {
        match self.elements::<N>()?[..] {
            [element] => Ok(element),
            _ => Err(self.wrong_length(N)),
        }
    }

    /// The column's elements as points. Coordinates may be NaN; the type that takes the points decides whether to allow that.
    ///
    /// # Errors
    /// If the column's width is not 3.
    pub fn to_points(&self) -> Result<Vec<Point3<f64>>, PartsError> {
        Ok(self.elements::<3>()?.into_iter().map(Point3::from).collect())
    }

    /// The column's numbers as `u32`.
    ///
    /// # Errors
    /// If a number is not a whole number from 0 to 4294967295.
    pub fn to_u32(&self) -> Result<Vec<u32>, PartsError> {
        match &self.items {
            Items::U32(items) => Ok(items.to_vec()),
            _ => self.whole_below(f64::from(u32::MAX), |x| x as u32),
        }
    }

    /// The column's numbers as `u8`, at most `max`.
    ///
    /// # Errors
    /// If a number is not a whole number from 0 to `max`.
    pub fn to_u8(&self, max: u8) -> Result<Vec<u8>, PartsError> {
        match &self.items {
            Items::U8(items) if items.iter().all(|x| *x <= max) => Ok(items.to_vec()),
            _ => self.whole_below(f64::from(max), |x| x as u8),
        }
    }

    /// The column's elements as colors.
    ///
    /// # Errors
    /// If the column's width is not 3, or a number is not a whole number from 0 to 255.
    pub fn colors(&self) -> Result<Vec<super::Rgb>, PartsError> {
        self.with_width(3)?;
        Ok(self.to_u8(u8::MAX)?.as_chunks().0.to_vec())
    }

    fn whole_below<T>(&self, max: f64, to: impl Fn(f64) -> T) -> Result<Vec<T>, PartsError> {
        self.items
            .numbers()
            .iter()
            .enumerate()
            .map(|(index, &x)| {
                let fits = (0.0..=max).contains(&x) && x.fract() == 0.0;
                fits.then(|| to(x)).ok_or_else(|| {
                    self.number_error(index, x, &format!("a whole number from 0 to {max}"))
                })
            })
            .collect()
    }
}

impl Items<'_> {
    /// The number of numbers in the column.
    pub fn len(&self) -> usize {
        match self {
            Self::F64(items) => items.len(),
            Self::F32(items) => items.len(),
            Self::U32(items) => items.len(),
            Self::U8(items) => items.len(),
        }
    }

    /// Returns true if there are no numbers.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// All numbers in double precision, which represents each of these numbers exactly.
    pub fn numbers(&self) -> Cow<'_, [f64]> {
        fn wide<T: Copy + Into<f64>>(items: &[T]) -> Cow<'static, [f64]> {
            items.iter().map(|&x| x.into()).collect()
        }
        match self {
            Self::F64(items) => Cow::Borrowed(items),
            Self::F32(items) => wide(items),
            Self::U32(items) => wide(items),
            Self::U8(items) => wide(items),
        }
    }
}

/// Implements the conversions from slices and lists of numbers.
macro_rules! items_from {
    ($variant:ident, $number:ty) => {
        impl<'a> From<&'a [$number]> for Items<'a> {
            fn from(items: &'a [$number]) -> Self {
                Self::$variant(Cow::Borrowed(items))
            }
        }

        impl From<Vec<$number>> for Items<'_> {
            fn from(items: Vec<$number>) -> Self {
                Self::$variant(Cow::Owned(items))
            }
        }

        impl<'a, const N: usize> From<&'a [[$number; N]]> for Items<'a> {
            fn from(items: &'a [[$number; N]]) -> Self {
                Self::from(items.as_flattened())
            }
        }
    };
}

items_from!(F64, f64);
items_from!(F32, f32);
items_from!(U32, u32);
items_from!(U8, u8);

impl<'a> From<&'a [Point3<f64>]> for Items<'a> {
    fn from(items: &'a [Point3<f64>]) -> Self {
        Self::from(bytemuck::cast_slice::<_, f64>(items))
    }
}
