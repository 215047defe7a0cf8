//! Units of length in files that do not say theirs.

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
    /// Millimeters in one of it.
    pub fn millimeters(self) -> f64 {
        match self {
            Self::Mm => 1.0,
            Self::Cm => 10.0,
            Self::M => 1000.0,
            Self::Inch => 25.4,
        }
    }

    /// A length in this unit, in mm. The decimal number that a file has comes out as the one that the file in mm would have, which the
    /// product alone often misses by its last bit: 0.0234 m is 23.4 mm and not 23.400000000000002.
    pub fn in_millimeters(self, length: f64) -> f64 {
        let product = length * self.millimeters();
        // So many decimals a double always has at this size, after the error of a product.
        let decimals = match product.abs() {
            size if size < 1e3 => 1e12,
            size if size < 1e6 => 1e9,
            size if size < 1e9 => 1e6,
            _ => return product,
        };
        if self.is_millimeters() { product } else { (product * decimals).round() / decimals }
    }

    /// Whether it is the one that values carry; as a field it is left out of a node's key then, as if there were no such field.
    pub fn is_millimeters(&self) -> bool {
        *self == Self::Mm
    }

    /// The word for it in camera files.
    pub fn word(self) -> &'static str {
        match self {
            Self::Mm => "mm",
            Self::Cm => "cm",
            Self::M => "m",
            Self::Inch => "inch",
        }
    }
}
