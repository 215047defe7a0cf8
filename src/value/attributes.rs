//! Attributes: named data on the elements of a mesh.

use std::collections::BTreeMap;

use thiserror::Error;

use super::content::Content;
use super::{
    Bytes, Column, DecodeError, Decoder, ElementKind, Encoder, Items, Meaning, Part, PartsError,
    Rgb,
};
use crate::parallel::*;

/// Error of adding an attribute. Contains the message.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{0}")]
pub struct AttributeError(String);

impl AttributeError {
    /// Checks that the attribute `name` has as many entries as there are elements.
    pub(super) fn check_len(name: &str, count: usize, elements: usize) -> Result<(), Self> {
        if count == elements {
            return Ok(());
        }
        Err(Self(format!("attribute `{name}` has {count} entries for {elements} elements")))
    }
}

/// One column of data: an entry per vertex, corner or face.
#[derive(Clone, Debug, PartialEq)]
pub enum Attribute {
    /// A real number per element.
    Number(Column<f64>),
    /// A whole number per element, such as an index.
    Index(Column<u32>),
    /// A flag per element, 0 or 1.
    Flag(Column<u8>),
    /// A pair of numbers per element, such as a texture coordinate.
    Pair(Column<[f64; 2]>),
    /// A vector per element, such as a normal.
    Vector(Column<[f64; 3]>),
    /// A color per element, in 8-bit sRGB.
    Color(Column<Rgb>),
}

impl Attribute {
    /// The number of entries, one per element.
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

    /// Returns true if there are no entries.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The entries at the given indices, in this order.
    ///
    /// # Panics
    /// If an index is out of bounds.
    #[must_use]
    pub fn select(&self, indices: &[u32]) -> Self {
        fn select<T: Copy + Send + Sync>(column: &[T], indices: &[u32]) -> Column<T> {
            let entries = indices.par_iter().with_min_len(4096);
            entries.map(|&index| column[index as usize]).collect::<Vec<_>>().into()
        }
        match self {
            Self::Number(column) => Self::Number(select(column, indices)),
            Self::Index(column) => Self::Index(select(column, indices)),
            Self::Flag(column) => Self::Flag(select(column, indices)),
            Self::Pair(column) => Self::Pair(select(column, indices)),
            Self::Vector(column) => Self::Vector(select(column, indices)),
            Self::Color(column) => Self::Color(select(column, indices)),
        }
    }

    /// Returns true if the entries at the indices `a` and `b` are equal.
    ///
    /// # Panics
    /// If an index is out of bounds.
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

    /// The index of the first pair or vector with a component that is NaN or infinite.
    fn first_not_finite(&self) -> Option<usize> {
        fn position_not_finite<const N: usize>(column: &Column<[f64; N]>) -> Option<usize> {
            column.par_iter().position_first(|entry| !entry.iter().all(|x| x.is_finite()))
        }
        match self {
            Self::Pair(column) => position_not_finite(column),
            Self::Vector(column) => position_not_finite(column),
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

    /// Converts the attribute to a part: a named column of numbers for elements of the kind `on`.
    fn part<'a>(&'a self, name: String, on: ElementKind, is_normal: bool) -> Part<'a> {
        let vector = if is_normal { Meaning::Direction } else { Meaning::Number };
        let (meaning, width, items): (_, _, Items<'a>) = match self {
            Self::Number(column) => (Meaning::Number, 1, column[..].into()),
            Self::Index(column) => (Meaning::Exact, 1, column[..].into()),
            Self::Flag(column) => (Meaning::Exact, 1, column[..].into()),
            Self::Pair(column) => (Meaning::Number, 2, column[..].into()),
            Self::Vector(column) => (vector, 3, column[..].into()),
            Self::Color(column) => (Meaning::Level, 3, column[..].into()),
        };
        Part { name: name.into(), element_kind: on, meaning, width, items, is_hidden: false }
    }

    /// Builds an attribute from a column. The column's meaning and width determine the type of the attribute. For whole numbers the type of
    /// the column's items decides too: bytes become flags, larger integers become indices.
    ///
    /// # Errors
    /// If no type of attribute can store the column.
    pub(super) fn from_part(part: &Part<'_>) -> Result<Self, PartsError> {
        let is_exact = matches!(part.meaning, Meaning::Exact | Meaning::Index);
        Ok(match (part.meaning, part.width) {
            (Meaning::Level, _) => Self::Color(part.colors()?.into()),
            (_, 1) if is_exact && matches!(part.items, Items::U8(_)) => {
                Self::Flag(part.to_u8(1)?.into())
            }
            (_, 1) if is_exact => Self::Index(part.to_u32()?.into()),
            (_, 1) => Self::Number(part.items.numbers().into_owned().into()),
            (_, 2) => Self::Pair(part.elements()?.into()),
            _ => Self::Vector(part.elements()?.into()),
        })
    }

    /// The number of the attribute's type, as stored values contain it.
    pub(super) fn tag(&self) -> u8 {
        match self {
            Self::Number(_) => 0,
            Self::Index(_) => 1,
            Self::Flag(_) => 2,
            Self::Pair(_) => 3,
            Self::Vector(_) => 4,
            Self::Color(_) => 5,
        }
    }

    /// The attribute's column, whatever the type of its items is.
    pub(super) fn column(&self) -> &dyn Bytes {
        match self {
            Self::Number(column) => column,
            Self::Index(column) => column,
            Self::Flag(column) => column,
            Self::Pair(column) => column,
            Self::Vector(column) => column,
            Self::Color(column) => column,
        }
    }

    /// Joins attributes of one type; `None` if they have several types, or there are none.
    pub(super) fn concat(all: &[&Self]) -> Option<Self> {
        macro_rules! concat {
            ($($variant:ident)+) => {
                match all.first()? {
                    $(Self::$variant(_) => {
                        let mut items = Vec::with_capacity(all.iter().map(|it| it.len()).sum());
                        for attribute in all {
                            let Self::$variant(column) = attribute else { return None };
                            items.extend_from_slice(column);
                        }
                        Some(Self::$variant(items.into()))
                    })+
                }
            };
        }
        concat!(Number Index Flag Pair Vector Color)
    }

    fn encode(&self, to: &mut Encoder) {
        to.plain(&self.tag());
        match self {
            Self::Number(column) => to.column(column),
            Self::Index(column) => to.column(column),
            Self::Flag(column) => to.column(column),
            Self::Pair(column) => to.column(column),
            Self::Vector(column) => to.column(column),
            Self::Color(column) => to.column(column),
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
/// Well-known names: `uv` (pairs; (0, 0) is the picture's lower left corner), `normal` (unit vectors), `color`, and `filled` (flags: 1
/// marks an element that was computed, not measured). All numbers in `uv` and `normal` are finite.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Attributes(BTreeMap<String, Attribute>);

impl Attributes {
    /// The attribute with this name.
    pub fn get(&self, name: &str) -> Option<&Attribute> {
        self.0.get(name)
    }

    /// The attribute with this name, if it holds pairs.
    pub fn pairs(&self, name: &str) -> Option<&Column<[f64; 2]>> {
        match self.0.get(name) {
            Some(Attribute::Pair(column)) => Some(column),
            _ => None,
        }
    }

    /// The attribute with this name, if it holds vectors.
    pub fn vectors(&self, name: &str) -> Option<&Column<[f64; 3]>> {
        match self.0.get(name) {
            Some(Attribute::Vector(column)) => Some(column),
            _ => None,
        }
    }

    /// The attribute with this name, if it holds colors.
    pub fn colors(&self, name: &str) -> Option<&Column<Rgb>> {
        match self.0.get(name) {
            Some(Attribute::Color(column)) => Some(column),
            _ => None,
        }
    }

    /// Iterates over all attributes, by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Attribute)> {
        self.0.iter().map(|(name, attribute)| (name.as_str(), attribute))
    }

    /// The attributes of the elements at the given indices, which must exist.
    pub(super) fn select(&self, indices: &[u32]) -> Self {
        let entries = self.0.iter();
        Self(entries.map(|(name, all)| (name.clone(), all.select(indices))).collect())
    }

    /// All attributes as columns. The name of each column is the prefix `of` followed by the attribute's name.
    pub fn parts<'a>(&'a self, of: &'a str, on: ElementKind) -> impl Iterator<Item = Part<'a>> {
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
        AttributeError::check_len(name, attribute.len(), elements)?;
        let checked = Some(&attribute).filter(|_| matches!(name, "uv" | "normal"));
        if let Some(index) = checked.and_then(Attribute::first_not_finite) {
            let why = format!("attribute `{name}` of {element} {index} is not finite");
            return Err(AttributeError(why));
        }
        self.0.insert(name.to_owned(), attribute);
        Ok(())
    }

    pub(super) fn remove(&mut self, name: &str) {
        self.0.remove(name);
    }
}

impl Content for Attributes {
    fn encode(&self, to: &mut Encoder) {
        to.counts(&[self.0.len()]);
        for (name, attribute) in &self.0 {
            to.text(name);
            attribute.encode(to);
        }
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let [count] = from.counts()?;
        let attributes = (0..count).map(|_| Ok((from.text()?, Attribute::decode(from)?)));
        Ok(Self(attributes.collect::<Result<_, _>>()?))
    }

    fn size(&self) -> usize {
        self.0.values().map(Attribute::size).sum()
    }
}
