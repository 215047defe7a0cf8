//! Transfer of attributes from the elements of a mesh to the elements of a mesh derived from it. Elements are vertices, corners or faces.

use maquette_value::Attribute;

use super::stencils::Stencils;
use super::weighted_mean::WeightedMean;

/// A map from old elements to new elements that can be applied to attributes of every type.
pub trait AttributeTransfer {
    /// Computes the values of an attribute for the new elements, given its values `old` for the old elements.
    fn column<T: WeightedMean>(&self, old: &[T]) -> Vec<T>;

    /// Returns an attribute for the new elements, given the same attribute for the old elements. The attribute may have any type.
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

/// Each row of the sparse matrix expresses a new element as a weighted mean of old elements.
impl AttributeTransfer for Stencils {
    fn column<T: WeightedMean>(&self, old: &[T]) -> Vec<T> {
        self.apply(old)
    }
}
