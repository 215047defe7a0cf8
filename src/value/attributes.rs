//! Named data on the elements of a mesh.

use std::collections::BTreeMap;

use thiserror::Error;

use super::{Column, DecodeError, Decoder, Encoder, Items, Meaning, On, Part, PartsError, Rgb};
use crate::parallel::*;

/// Why an attribute does not fit.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum AttributeError {
    /// Too many or too few entries.
    #[error("attribute `{name}` has {count} entries for {elements} elements")]
    Length {
        /// The attribute's name.
        name: String,
        /// Its entries.
        count: usize,
        /// Elements that it is for.
        elements: usize,
    },
    /// A texture coordinate or a normal that is NaN or infinite.
    #[error("attribute `{name}` of {element} {index} is not finite")]
    NotFinite {
        /// The attribute's name.
        name: String,
        /// `vertex`, `corner` and so on.
        element: &'static str,
        /// Which of them, from 0.
        index: usize,
    },
}

/// One column of data: an entry per vertex, corner or face.
#[derive(Clone, Debug, PartialEq)]
pub enum Attribute {
    /// Real numbers.
    Number(Column<f64>),
    /// Whole numbers.
    Index(Column<u32>),
    /// 0 or 1.
    Flag(Column<u8>),
    /// Pairs, such as texture coordinates.
    Pair(Column<[f64; 2]>),
    /// Vectors, such as normals.
    Vector(Column<[f64; 3]>),
    /// Colors in 8-bit sRGB.
    Color(Column<Rgb>),
}

impl Attribute {
    /// Number of entries.
    pub fn len(&self) -> usize {
        match self {
            Self::Number(column) => column.len(),
            Self::Index(column) => column.len(),
            Self::Flag(column) => column.len(),
            Self::Pair(column) => column.len(),
            Self::Vector(column) => column.len(),
            Self::Color(column) => column.len(),
        }
    }

    /// Whether there is no entry.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The entries at these places, in this order.
    ///
    /// # Panics
    /// If a place is behind the last entry.
    #[must_use]
    pub fn select(&self, places: &[u32]) -> Self {
        fn select<T: Copy>(column: &[T], places: &[u32]) -> Column<T> {
            places.iter().map(|&place| column[place as usize]).collect()
        }
        match self {
            Self::Number(column) => Self::Number(select(column, places)),
            Self::Index(column) => Self::Index(select(column, places)),
            Self::Flag(column) => Self::Flag(select(column, places)),
            Self::Pair(column) => Self::Pair(select(column, places)),
            Self::Vector(column) => Self::Vector(select(column, places)),
            Self::Color(column) => Self::Color(select(column, places)),
        }
    }

    /// Whether two entries are the same.
    ///
    /// # Panics
    /// If one of them is not there.
    pub fn is_same(&self, a: usize, b: usize) -> bool {
        match self {
            Self::Number(column) => column[a] == column[b],
            Self::Index(column) => column[a] == column[b],
            Self::Flag(column) => column[a] == column[b],
            Self::Pair(column) => column[a] == column[b],
            Self::Vector(column) => column[a] == column[b],
            Self::Color(column) => column[a] == column[b],
        }
    }

    /// The first pair or vector that is no place and no direction.
    fn first_not_finite(&self) -> Option<usize> {
        fn first<const N: usize>(column: &Column<[f64; N]>) -> Option<usize> {
            column.par_iter().position_first(|entry| !entry.iter().all(|x| x.is_finite()))
        }
        match self {
            Self::Pair(column) => first(column),
            Self::Vector(column) => first(column),
            _ => None,
        }
    }

    fn size(&self) -> usize {
        match self {
            Self::Number(column) => column.size(),
            Self::Index(column) => column.size(),
            Self::Flag(column) => column.size(),
            Self::Pair(column) => column.size(),
            Self::Vector(column) => column.size(),
            Self::Color(column) => column.size(),
        }
    }

    /// It as a column of this name.
    fn part<'a>(&'a self, name: String, on: On, is_normal: bool) -> Part<'a> {
        let vector = if is_normal { Meaning::Direction } else { Meaning::Number };
        let (meaning, width, items): (_, _, Items<'a>) = match self {
            Self::Number(column) => (Meaning::Number, 1, column[..].into()),
            Self::Index(column) => (Meaning::Exact, 1, column[..].into()),
            Self::Flag(column) => (Meaning::Exact, 1, column[..].into()),
            Self::Pair(column) => (Meaning::Number, 2, column[..].into()),
            Self::Vector(column) => (vector, 3, column[..].into()),
            Self::Color(column) => (Meaning::Level, 3, column[..].into()),
        };
        Part { name: name.into(), on, meaning, width, items, aside: false }
    }

    /// The attribute that a column is: by what its numbers mean, how many an element has, and, where they are equal or not, whether
    /// they are small.
    ///
    /// # Errors
    /// If it is none.
    pub(super) fn of(part: &Part<'_>) -> Result<Self, PartsError> {
        let is_exact = matches!(part.meaning, Meaning::Exact | Meaning::Index);
        Ok(match (part.meaning, part.width) {
            (Meaning::Level, _) => Self::Color(part.colors()?.into()),
            (_, 1) if is_exact && matches!(part.items, Items::U8(_)) => {
                Self::Flag(part.small(1)?.into())
            }
            (_, 1) if is_exact => Self::Index(part.whole()?.into()),
            (_, 1) => Self::Number(part.items.numbers().into_owned().into()),
            (_, 2) => Self::Pair(part.elements()?.into()),
            _ => Self::Vector(part.elements()?.into()),
        })
    }

    fn encode(&self, to: &mut Encoder) {
        match self {
            Self::Number(column) => to.plain(&0u8).column(column),
            Self::Index(column) => to.plain(&1u8).column(column),
            Self::Flag(column) => to.plain(&2u8).column(column),
            Self::Pair(column) => to.plain(&3u8).column(column),
            Self::Vector(column) => to.plain(&4u8).column(column),
            Self::Color(column) => to.plain(&5u8).column(column),
        };
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        Ok(match from.plain::<u8>()? {
            0 => Self::Number(from.column()?),
            1 => Self::Index(from.column()?),
            2 => Self::Flag(from.column()?),
            3 => Self::Pair(from.column()?),
            4 => Self::Vector(from.column()?),
            5 => Self::Color(from.column()?),
            _ => return Err(DecodeError),
        })
    }
}

/// Attributes by name, in the order of their names.
///
/// The names that nodes agree on: `uv` (pairs, (0, 0) the picture's lower left corner), `normal` (unit vectors), `color`,
/// `filled` (flags: computed, not measured). `uv` and `normal` are finite.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Attributes(BTreeMap<String, Attribute>);

impl Attributes {
    /// The attribute of that name.
    pub fn get(&self, name: &str) -> Option<&Attribute> {
        self.0.get(name)
    }

    /// Pairs under that name, if it holds pairs.
    pub fn pairs(&self, name: &str) -> Option<&Column<[f64; 2]>> {
        match self.0.get(name) {
            Some(Attribute::Pair(column)) => Some(column),
            _ => None,
        }
    }

    /// Vectors under that name, if it holds vectors.
    pub fn vectors(&self, name: &str) -> Option<&Column<[f64; 3]>> {
        match self.0.get(name) {
            Some(Attribute::Vector(column)) => Some(column),
            _ => None,
        }
    }

    /// Colors under that name, if it holds colors.
    pub fn colors(&self, name: &str) -> Option<&Column<Rgb>> {
        match self.0.get(name) {
            Some(Attribute::Color(column)) => Some(column),
            _ => None,
        }
    }

    /// All of them, by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Attribute)> {
        self.0.iter().map(|(name, attribute)| (name.as_str(), attribute))
    }

    /// Their entries at these places, which are there.
    pub(super) fn select(&self, places: &[u32]) -> Self {
        let entries = self.0.iter();
        Self(entries.map(|(name, all)| (name.clone(), all.select(places))).collect())
    }

    /// All of them as columns, whose names begin with `of`.
    pub fn parts<'a>(&'a self, of: &'a str, on: On) -> impl Iterator<Item = Part<'a>> {
        self.0.iter().map(move |(name, attribute): (&'a String, &'a Attribute)| {
            attribute.part(format!("{of}{name}"), on, name == "normal")
        })
    }

    pub(super) fn insert(
        &mut self,
        name: &str,
        attribute: Attribute,
        elements: usize,
        element: &'static str,
    ) -> Result<(), AttributeError> {
        if attribute.len() != elements {
            let count = attribute.len();
            return Err(AttributeError::Length { name: name.to_owned(), count, elements });
        }
        let checked = Some(&attribute).filter(|_| matches!(name, "uv" | "normal"));
        if let Some(index) = checked.and_then(Attribute::first_not_finite) {
            return Err(AttributeError::NotFinite { name: name.to_owned(), element, index });
        }
        self.0.insert(name.to_owned(), attribute);
        Ok(())
    }

    pub(super) fn remove(&mut self, name: &str) {
        self.0.remove(name);
    }

    pub(super) fn size(&self) -> usize {
        self.0.values().map(Attribute::size).sum()
    }

    pub(super) fn encode(&self, to: &mut Encoder) {
        to.counts(&[self.0.len()]);
        for (name, attribute) in &self.0 {
            to.text(name);
            attribute.encode(to);
        }
    }

    pub(super) fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let [count] = from.counts()?;
        let attributes = (0..count).map(|_| Ok((from.text()?, Attribute::decode(from)?)));
        Ok(Self(attributes.collect::<Result<_, _>>()?))
    }
}
