//! Units of length, for files that do not state theirs.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A unit of length.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Unit {
    /// Millimeters.
    #[default]
    Mm,
    /// Centimeters.
    Cm,
    /// Meters.
    M,
    /// Inches of 25.4 mm.
    Inch,
}

impl Unit {
    /// The length of one unit, in mm.
    pub fn millimeters(self) -> f64 {
        match self {
            Self::Mm => 1.0,
            Self::Cm => 10.0,
            Self::M => 1000.0,
            Self::Inch => 25.4,
        }
    }

    /// Converts a length in this unit to mm. The result is the number that a file in mm would contain. The product with
    /// [`Self::millimeters`] alone often differs from this number in the last bit: 0.0234 m is 23.4 mm and not 23.400000000000002.
    pub fn in_millimeters(self, length: f64) -> f64 {
        let product = length * self.millimeters();
        // The product is rounded to 12, 9 or 6 decimals. A floating-point number of the product's size has at least as many correct
        // decimals.
        let decimals = match product.abs() {
            size if size < 1e3 => 1e12,
            size if size < 1e6 => 1e9,
            size if size < 1e9 => 1e6,
            _ => return product,
        };
        if self.is_millimeters() { product } else { (product * decimals).round() / decimals }
    }

    /// Returns true for millimeters, the unit of all values. A field with this unit is left out of a node's cache key.
    pub fn is_millimeters(&self) -> bool {
        *self == Self::Mm
    }

    /// The name of the unit in camera files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mm => "mm",
            Self::Cm => "cm",
            Self::M => "m",
            Self::Inch => "inch",
        }
    }
}
