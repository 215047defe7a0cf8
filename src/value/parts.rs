//! What a value is made of: named columns of numbers, and facts.
//!
//! Tests compare them, `maquette inspect --table` prints them, and programs that embed the engine take them as arrays. The other way
//! round, arrays make values by [`Value::from_parts`](super::Value::from_parts). Nobody needs to know the value's type for it.
//!
//! ```
//! use maquette_value::{Mask, Meaning, Value};
//!
//! let mask = Mask::drawn(&["#.", ".."]);
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

pub use kinds::{Meaning, On};

/// The facts and the columns of a value, in a fixed order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parts<'a> {
    /// Counts, sizes and kinds: what must be equal before columns are compared.
    pub facts: Vec<Fact>,
    /// The numbers.
    pub columns: Vec<Part<'a>>,
    /// Elements in a row, where the elements are pixels or control points.
    pub row: Option<usize>,
}

/// One fact.
#[derive(Clone, Debug, PartialEq)]
pub struct Fact {
    /// Its name, such as `vertices`.
    pub name: Cow<'static, str>,
    /// What is so.
    pub value: FactValue,
}

/// What a fact says.
#[derive(Clone, Debug, PartialEq)]
pub enum FactValue {
    /// A number of things.
    Count(usize),
    /// Two numbers of things: columns and rows of pixels, or rows and columns of control points.
    Size([usize; 2]),
    /// Whether it is so.
    Flag(bool),
    /// A word, or several.
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

/// One column: `width` numbers for each element.
#[derive(Clone, Debug, PartialEq)]
pub struct Part<'a> {
    /// Its name, such as `position`.
    pub name: Cow<'a, str>,
    /// What its elements are.
    pub on: On,
    /// What its numbers mean.
    pub meaning: Meaning,
    /// Numbers of an element, at least 1.
    pub width: usize,
    /// The numbers, element by element: a multiple of `width`.
    pub items: Items<'a>,
    /// Whether tests leave it out: what it says is in a fact, or in the value's hash alone.
    pub aside: bool,
}

/// Numbers, not copied where a value holds them side by side.
#[derive(Clone, Debug, PartialEq)]
pub enum Items<'a> {
    /// Double precision.
    F64(Cow<'a, [f64]>),
    /// Single precision.
    F32(Cow<'a, [f32]>),
    /// Whole numbers.
    U32(Cow<'a, [u32]>),
    /// Flags and levels.
    U8(Cow<'a, [u8]>),
}

/// Why parts make no value.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PartsError {
    /// A column that is needed is not there.
    #[error("the part `{part}` is missing")]
    Missing {
        /// Its name.
        part: String,
    },
    /// A column of elements with too many or too few numbers.
    #[error("the part `{part}` has {width} numbers an element, where {expected} are expected")]
    Width {
        /// Its name.
        part: String,
        /// Its numbers for an element.
        width: usize,
        /// How many there must be.
        expected: usize,
    },
    /// A column of too many or too few elements, or whose last one is cut off.
    #[error("the part `{part}` has {numbers} numbers, where {expected} are expected")]
    Length {
        /// Its name.
        part: String,
        /// How many numbers it has.
        numbers: usize,
        /// How many there must be; a multiple of the width if nothing else is known.
        expected: usize,
    },
    /// A number that cannot stand where it does.
    #[error("number {index} of the part `{part}` is {number}, where {expected} is expected")]
    Number {
        /// The name of the part.
        part: String,
        /// Which number of it, from 0.
        index: usize,
        /// The number.
        number: f64,
        /// What must stand there, in words.
        expected: String,
    },
    /// A fact that is needed is not there, or not what it must be.
    #[error("the fact `{fact}` must be {expected}")]
    Fact {
        /// Its name.
        fact: String,
        /// What it must be, in words.
        expected: &'static str,
    },
    /// The type's own constructor refuses the parts.
    #[error("{why}")]
    Refused {
        /// What it says.
        why: String,
    },
    /// No value of the type can be made of parts.
    #[error("a {kind} cannot be made of parts")]
    Never {
        /// The type.
        kind: &'static str,
    },
}

impl PartsError {
    /// What a constructor said.
    pub fn refused(error: impl std::error::Error) -> Self {
        Self::Refused { why: error.to_string() }
    }
}

/// Least, greatest and mean of some numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// The least.
    pub least: f64,
    /// The greatest.
    pub greatest: f64,
    /// Their mean.
    pub mean: f64,
}

/// The range of each component of elements of `width` numbers; none where no number is finite. What is not finite does not count.
pub fn ranges(numbers: &[f64], width: usize) -> Vec<Option<Range>> {
    (0..width)
        .map(|component| {
            let column = numbers.iter().skip(component).step_by(width).filter(|x| x.is_finite());
            let start = (f64::INFINITY, f64::NEG_INFINITY, 0.0, 0usize);
            let (least, greatest, sum, count) =
                column.fold(start, |(least, greatest, sum, n), &x| {
                    (f64::min(least, x), f64::max(greatest, x), sum + x, n + 1)
                });
            (count > 0).then(|| Range { least, greatest, mean: sum / count as f64 })
        })
        .collect()
}

impl<'a> Parts<'a> {
    /// Whether there is nothing: neither fact nor column.
    pub fn is_empty(&self) -> bool {
        self.facts.is_empty() && self.columns.is_empty()
    }

    /// Adds a fact.
    pub fn fact(&mut self, name: impl Into<Cow<'static, str>>, value: impl Into<FactValue>) {
        self.facts.push(Fact { name: name.into(), value: value.into() });
    }

    /// Adds the fact `size`: of a picture of so many columns and rows.
    pub fn grid(&mut self, width: usize, height: usize) {
        self.fact("size", [width, height]);
        self.row = Some(width);
    }

    /// Adds a column.
    pub fn push(
        &mut self,
        name: impl Into<Cow<'a, str>>,
        on: On,
        meaning: Meaning,
        width: usize,
        items: impl Into<Items<'a>>,
    ) {
        let (name, items) = (name.into(), items.into());
        self.columns.push(Part { name, on, meaning, width, items, aside: false });
    }

    /// Adds a column that tests leave out; see [`Part::aside`].
    pub fn push_aside(
        &mut self,
        name: impl Into<Cow<'a, str>>,
        on: On,
        meaning: Meaning,
        width: usize,
        items: impl Into<Items<'a>>,
    ) {
        let (name, items) = (name.into(), items.into());
        self.columns.push(Part { name, on, meaning, width, items, aside: true });
    }

    /// Adds all of another value's.
    pub fn append(&mut self, mut other: Self) {
        self.facts.append(&mut other.facts);
        self.columns.append(&mut other.columns);
        self.row = other.row.or(self.row);
    }

    /// The first column of this name.
    pub fn column(&self, name: &str) -> Option<&Part<'a>> {
        self.columns.iter().find(|part| part.name == name)
    }

    /// The first column of this name that lies on such elements.
    pub fn on(&self, on: On, name: &str) -> Option<&Part<'a>> {
        self.columns.iter().find(|part| part.on == on && part.name == name)
    }

    /// The column of this name, of whole elements of `width` numbers; none if it is not there.
    ///
    /// # Errors
    /// If its width is another one, or its last element is cut off.
    pub fn column_of(&self, name: &str, width: usize) -> Result<Option<&Part<'a>>, PartsError> {
        self.column(name).map(|part| part.with_width(width)).transpose()
    }

    /// The column of this name, of whole elements of `width` numbers.
    ///
    /// # Errors
    /// If it is not there, its width is another one, or its last element is cut off.
    pub fn need(&self, name: &str, width: usize) -> Result<&Part<'a>, PartsError> {
        self.column_of(name, width)?.ok_or_else(|| PartsError::Missing { part: name.to_owned() })
    }

    /// The value of the first fact of this name.
    pub fn fact_of(&self, name: &str) -> Option<&FactValue> {
        self.facts.iter().find(|fact| fact.name == name).map(|fact| &fact.value)
    }

    /// The two counts that a fact says.
    ///
    /// # Errors
    /// If there is no such fact.
    pub fn size_of(&self, name: &str) -> Result<[usize; 2], PartsError> {
        match self.fact_of(name) {
            Some(FactValue::Size(size)) => Ok(*size),
            _ => Err(PartsError::Fact { fact: name.to_owned(), expected: "two counts" }),
        }
    }

    /// The count that a fact says.
    ///
    /// # Errors
    /// If there is no such fact.
    pub fn count_of(&self, name: &str) -> Result<usize, PartsError> {
        match self.fact_of(name) {
            Some(FactValue::Count(count)) => Ok(*count),
            _ => Err(PartsError::Fact { fact: name.to_owned(), expected: "a count" }),
        }
    }

    /// Columns and rows of a picture: what the fact `size` says, or what follows from [`row`](Self::row) and the number of pixels.
    ///
    /// # Errors
    /// If neither is known.
    pub fn size(&self) -> Result<[usize; 2], PartsError> {
        let pixels = self.columns.iter().find(|part| part.on == On::Pixel).map(Part::count);
        match (self.fact_of("size"), self.row, pixels) {
            (None, Some(row), Some(pixels)) if row > 0 => Ok([row, pixels.div_ceil(row)]),
            _ => self.size_of("size"),
        }
    }
}

impl Part<'_> {
    /// How many elements there are.
    pub fn count(&self) -> usize {
        self.items.len() / self.width.max(1)
    }

    /// The range of each number of an element; none where none is finite. What is not finite does not count.
    pub fn ranges(&self) -> Vec<Option<Range>> {
        ranges(&self.items.numbers(), self.width.max(1))
    }

    /// The same column if it has whole elements of so many numbers.
    ///
    /// # Errors
    /// If its width is another one, or its last element is cut off.
    pub fn with_width(&self, expected: usize) -> Result<&Self, PartsError> {
        let (numbers, width) = (self.items.len(), self.width);
        if width != expected {
            let part = self.name.clone().into_owned();
            return Err(PartsError::Width { part, width, expected });
        }
        match numbers % width.max(1) {
            0 => Ok(self),
            rest => Err(self.wrong_length(numbers - rest + width)),
        }
    }

    fn wrong_length(&self, expected: usize) -> PartsError {
        let (part, numbers) = (self.name.clone().into_owned(), self.items.len());
        PartsError::Length { part, numbers, expected }
    }

    /// The same column if it has so many elements.
    ///
    /// # Errors
    /// If it has more or fewer.
    pub fn with_count(&self, count: usize) -> Result<&Self, PartsError> {
        match count.checked_mul(self.width) {
            Some(numbers) if numbers == self.items.len() => Ok(self),
            numbers => Err(self.wrong_length(numbers.unwrap_or(usize::MAX))),
        }
    }

    /// What is wrong with one of its numbers.
    pub fn wrong(&self, index: usize, number: f64, expected: impl Into<String>) -> PartsError {
        let part = self.name.clone().into_owned();
        PartsError::Number { part, index, number, expected: expected.into() }
    }

    /// Its numbers as elements of `N`.
    ///
    /// # Errors
    /// If its elements have another number of them, or the last one is cut off.
    pub fn elements<const N: usize>(&self) -> Result<Vec<[f64; N]>, PartsError> {
        self.with_width(N)?;
        Ok(self.items.numbers().as_chunks().0.to_vec())
    }

    /// The only element of a part of the whole.
    ///
    /// # Errors
    /// If there is none or several, or its numbers are not `N`.
    pub fn only<const N: usize>(&self) -> Result<[f64; N], PartsError> {
        match self.elements::<N>()?[..] {
            [element] => Ok(element),
            _ => Err(self.wrong_length(N)),
        }
    }

    /// Its elements as places; the type that takes them decides whether they may be unknown (NaN).
    ///
    /// # Errors
    /// If its elements have not three numbers.
    pub fn places(&self) -> Result<Vec<Point3<f64>>, PartsError> {
        Ok(self.elements::<3>()?.into_iter().map(Point3::from).collect())
    }

    /// Its numbers as whole numbers.
    ///
    /// # Errors
    /// If one is no whole number from 0 to 4294967295.
    pub fn whole(&self) -> Result<Vec<u32>, PartsError> {
        match &self.items {
            Items::U32(items) => Ok(items.to_vec()),
            _ => self.whole_below(f64::from(u32::MAX), |x| x as u32),
        }
    }

    /// Its numbers as whole numbers up to `most`.
    ///
    /// # Errors
    /// If one is no whole number from 0 to `most`.
    pub fn small(&self, most: u8) -> Result<Vec<u8>, PartsError> {
        match &self.items {
            Items::U8(items) if items.iter().all(|x| *x <= most) => Ok(items.to_vec()),
            _ => self.whole_below(f64::from(most), |x| x as u8),
        }
    }

    /// Its numbers as colors.
    ///
    /// # Errors
    /// If its elements have not three numbers, or one is no whole number from 0 to 255.
    pub fn colors(&self) -> Result<Vec<super::Rgb>, PartsError> {
        self.with_width(3)?;
        Ok(self.small(u8::MAX)?.as_chunks().0.to_vec())
    }

    fn whole_below<T>(&self, most: f64, to: impl Fn(f64) -> T) -> Result<Vec<T>, PartsError> {
        self.items
            .numbers()
            .iter()
            .enumerate()
            .map(|(index, &x)| {
                let fits = (0.0..=most).contains(&x) && x.fract() == 0.0;
                fn expected(most: f64) -> String {
                    format!("a whole number from 0 to {most}")
                }
                fits.then(|| to(x)).ok_or_else(|| self.wrong(index, x, expected(most)))
            })
            .collect()
    }
}

impl Items<'_> {
    /// How many numbers there are.
    pub fn len(&self) -> usize {
        match self {
            Self::F64(items) => items.len(),
            Self::F32(items) => items.len(),
            Self::U32(items) => items.len(),
            Self::U8(items) => items.len(),
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// All of them in double precision, which tells them exactly.
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

/// Items of a slice and of a list.
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
