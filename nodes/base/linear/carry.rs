//! How data on the elements of a mesh become data on the elements of another one that is made of it.

use maquette_value::Attribute;

use super::mix::Mix;
use super::stencils::Stencils;

/// A way from old elements to new ones, the same for every type of data.
pub trait Carry {
    /// The data of the new elements.
    fn column<T: Mix>(&self, old: &[T]) -> Vec<T>;

    /// The same for an attribute of any type.
    fn attribute(&self, old: &Attribute) -> Attribute {
        match old {
            Attribute::Number(old) => Attribute::Number(self.column(old).into()),
            Attribute::Index(old) => Attribute::Index(self.column(old).into()),
            Attribute::Flag(old) => Attribute::Flag(self.column(old).into()),
            Attribute::Pair(old) => Attribute::Pair(self.column(old).into()),
            Attribute::Vector(old) => Attribute::Vector(self.column(old).into()),
            Attribute::Color(old) => Attribute::Color(self.column(old).into()),
        }
    }
}

/// Each new element is a mean of old ones.
impl Carry for Stencils {
    fn column<T: Mix>(&self, old: &[T]) -> Vec<T> {
        self.apply(old)
    }
}
