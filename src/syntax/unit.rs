//! Units of numbers: parses `cm(1.2)` and the units of fields and parameters, and converts between units.
//!
//! The unit of a field may be any text. A text that is not composed of [`KNOWN_UNITS`], such as `cells` or `%`, is only displayed: numbers
//! are not converted to that unit, and their units are not checked.

use std::fmt;

use super::tree::{Kind, Tree};

/// The physical quantity that a unit measures. Numbers of different quantities cannot be added.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Measure {
    Length,
    Angle,
    Pixels,
}

const MEASURES: [Measure; 3] = [Measure::Length, Measure::Angle, Measure::Pixels];

/// The units in which numbers may be written.
const KNOWN_UNITS: [(&str, Measure); 7] = [
    ("mm", Measure::Length),
    ("cm", Measure::Length),
    ("m", Measure::Length),
    ("inch", Measure::Length),
    ("deg", Measure::Angle),
    ("rad", Measure::Angle),
    ("px", Measure::Pixels),
];

/// The names of the units in which numbers may be written.
pub fn unit_names() -> impl Iterator<Item = &'static str> {
    KNOWN_UNITS.iter().map(|(name, _)| *name)
}

/// A product of powers of known units, such as `mm`, `1/mm` or `px/mm`. The empty product is the unit of a pure number.
///
/// The array contains the exponent of each known unit. At most one unit of each measure has an exponent other than 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Unit([i32; KNOWN_UNITS.len()]);

impl Unit {
    /// Returns the known unit of this name. `None` for other names.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::power(name, 1)
    }

    fn power(name: &str, exponent: i32) -> Option<Self> {
        let place = unit_names().position(|known| known == name)?;
        let mut unit = Self::default();
        unit.0[place] = exponent;
        Some(unit)
    }

    /// Parses a unit, such as `mm`, `mm^2`, `px/mm` or `1/mm`. Returns `None` if it is not composed of known units.
    pub fn read(text: &str) -> Option<Self> {
        let (above, below) = match text.split_once('/') {
            Some((above, below)) => (above, Some(below)),
            None => (text, None),
        };
        let above = above.split('*').filter(|name| *name != "1").map(|name| (name, 1));
        let below = below.into_iter().flat_map(|below| below.split('*')).map(|name| (name, -1));
        let mut unit = Self::default();
        for (factor, sign) in above.chain(below) {
            let (name, times) = factor.split_once('^').unwrap_or((factor, "1"));
            let times = times.parse().ok().filter(|times: &i32| (1..10).contains(times))?;
            let factor = Self::power(name, sign * times)?;
            if MEASURES
                .iter()
                .any(|&measure| unit.factor(measure).and(factor.factor(measure)).is_some())
            {
                return None;
            }
            unit = unit.times(factor);
        }
        (!unit.is_pure()).then_some(unit)
    }

    pub fn is_pure(self) -> bool {
        self == Self::default()
    }

    /// Returns true if numbers in the unit `self` can be converted to the unit `other`.
    pub fn is_compatible(self, other: Self) -> bool {
        MEASURES.iter().all(|&measure| {
            let [a, b] = [self, other].map(|unit| unit.factor(measure));
            a.map(|(_, exponent)| exponent) == b.map(|(_, exponent)| exponent)
        })
    }

    /// Returns the factor of the unit that has the given measure, such as length: the index of a known unit, and its exponent. `None` if no
    /// factor has this measure.
    fn factor(self, measure: Measure) -> Option<(usize, i32)> {
        let mut places = (0..KNOWN_UNITS.len()).filter(|&place| KNOWN_UNITS[place].1 == measure);
        places.find(|&place| self.0[place] != 0).map(|place| (place, self.0[place]))
    }

    /// Replaces each known unit by the unit of the same measure in `other`. Keeps a unit whose measure `other` does not contain.
    fn in_units_of(mut self, other: Self) -> Self {
        for measure in MEASURES {
            if let (Some((own, exponent)), Some((wanted, _))) =
                (self.factor(measure), other.factor(measure))
            {
                self.0[own] = 0;
                self.0[wanted] = exponent;
            }
        }
        self
    }

    fn times(self, other: Self) -> Self {
        Self(std::array::from_fn(|place| self.0[place].saturating_add(other.0[place])))
    }

    pub fn to_power(self, exponent: i32) -> Self {
        Self(self.0.map(|own| own.saturating_mul(exponent)))
    }

    fn inverse(self) -> Self {
        Self(self.0.map(|exponent| -exponent))
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let part = |sign: i32| {
            let powers =
                self.0.iter().zip(unit_names()).filter(|(exponent, _)| 0 < **exponent * sign);
            powers
                .map(|(exponent, name): (&i32, &str)| match exponent.abs() {
                    1 => name.to_owned(),
                    exponent => format!("{name}^{exponent}"),
                })
                .collect::<Vec<_>>()
                .join("*")
        };
        match (part(1), part(-1)) {
            (above, below) if below.is_empty() => f.write_str(&above),
            (above, below) if above.is_empty() => write!(f, "1/{below}"),
            (above, below) => write!(f, "{above}/{below}"),
        }
    }
}

/// A number with its unit, such as 1.2 cm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantity {
    pub value: f64,
    pub unit: Unit,
}

impl Quantity {
    pub fn pure(value: f64) -> Self {
        Self { value, unit: Unit::default() }
    }

    /// Reads a number with a unit, such as `cm(1.2)`. `None` for other values.
    pub fn read(tree: &Tree) -> Option<Self> {
        let name = tree.name()?.text;
        let unit = Unit::from_name(&name)?;
        match tree.call_of(&name)?.kind {
            Kind::Number { value, .. } => Some(Self { value, unit }),
            _ => None,
        }
    }

    /// Converts the number to another unit, which must be compatible. Returns the plain number.
    pub fn to_unit(self, unit: Unit) -> f64 {
        let mut value = self.value;
        for measure in MEASURES {
            let (Some((from, exponent)), Some((to, _))) =
                (self.unit.factor(measure), unit.factor(measure))
            else {
                continue;
            };
            let (from, to) = if exponent < 0 { (to, from) } else { (from, to) };
            let mut times = if from == to { 0 } else { exponent.unsigned_abs() };
            // Zero and infinite values are equal in all units, so they need no conversion.
            while 0 < times && value != 0.0 && value.is_finite() {
                value = convert(value, KNOWN_UNITS[from].0, KNOWN_UNITS[to].0);
                times -= 1;
            }
        }
        value
    }

    pub fn times(self, other: Self) -> Self {
        let unit = other.unit.in_units_of(self.unit);
        Self { value: self.value * other.to_unit(unit), unit: self.unit.times(unit) }
    }

    pub fn divided_by(self, other: Self) -> Self {
        let unit = other.unit.in_units_of(self.unit);
        Self { value: self.value / other.to_unit(unit), unit: self.unit.times(unit.inverse()) }
    }

    /// Returns the square root of the quantity, with the square root of its unit. `None` if the unit is not a square.
    pub fn root(self) -> Option<Self> {
        let is_square = self.unit.0.iter().all(|exponent| exponent % 2 == 0);
        let unit = Unit(self.unit.0.map(|exponent| exponent / 2));
        is_square.then(|| Self { value: self.value.sqrt(), unit })
    }
}

/// Converts a value between two units of the same measure.
fn convert(value: f64, from: &str, to: &str) -> f64 {
    match (from, to) {
        ("deg", "rad") => value.to_radians(),
        ("rad", "deg") => value.to_degrees(),
        _ => fraction(value, tenths(from), tenths(to)),
    }
}

/// Returns the size of a unit of length as a multiple of 0.1 mm.
fn tenths(name: &str) -> i128 {
    match name {
        "cm" => 100,
        "m" => 10_000,
        "inch" => 254,
        _ => 10,
    }
}

/// Computes `value * numerator / denominator` in decimal arithmetic on the shortest decimal representation of `value`. In decimals 1.13 cm
/// is exactly 11.3 mm, whereas the floating-point product `1.13 * 10.0` is a different number.
fn fraction(value: f64, numerator: i128, denominator: i128) -> f64 {
    let text = format!("{value:e}");
    let (digits, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let decimals = digits.split_once('.').map_or(0, |(_, behind)| behind.len());
    // A floating-point number has at most 17 significant digits, so the product does not overflow.
    let digits: i128 = digits.replace('.', "").parse().unwrap_or_default();
    let mut exponent = exponent.parse::<i32>().unwrap_or_default() - decimals as i32;
    let mut product = digits * numerator;
    // All denominators divide 127 * 10^4, so an exact decimal quotient has at most four more digits.
    for _ in 0..4 {
        if product % denominator != 0 {
            (product, exponent) = (product * 10, exponent - 1);
        }
    }
    let (product, rest) = match product % denominator {
        0 => (product / denominator, 1.0),
        _ => (product, denominator as f64),
    };
    format!("{product}e{exponent}").parse().unwrap_or(f64::NAN) / rest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit(text: &str) -> Unit {
        Unit::read(text).unwrap_or_else(|| panic!("{text}"))
    }

    fn check(value: f64, from: &str, to: &str, expected: f64) {
        let found = Quantity { value, unit: unit(from) }.to_unit(unit(to));
        assert_eq!(found, expected, "{value} {from} in {to}");
    }

    #[test]
    fn decimals_are_converted_exactly() {
        check(1.2, "cm", "mm", 12.0);
        check(1.13, "cm", "mm", 11.3);
        assert_ne!(1.13 * 10.0, 11.3);
        check(0.57, "m", "cm", 57.0);
        check(-4.35, "m", "mm", -4350.0);
        check(0.1, "inch", "mm", 2.54);
        check(2.54, "cm", "inch", 1.0);
        check(12.0, "mm", "m", 0.012);
        check(1.0, "mm", "inch", 1.0 / 25.4);
        check(1e-300, "m", "mm", 1e-297);
        check(0.0, "m", "mm", 0.0);
        check(2.0, "1/cm", "1/mm", 0.2);
        check(1.5, "cm^2", "mm^2", 150.0);
        check(180.0, "deg", "rad", std::f64::consts::PI);
        check(std::f64::consts::PI, "rad", "deg", 180.0);
    }

    #[test]
    fn conversion_of_short_decimals_is_exact() {
        for n in 1..20_000 {
            let cm: f64 = format!("{n}e-3").parse().unwrap();
            let mm: f64 = format!("{n}e-2").parse().unwrap();
            check(cm, "cm", "mm", mm);
            check(mm, "mm", "cm", cm);
        }
    }

    #[test]
    fn units_are_parsed_and_formatted() {
        for text in ["mm", "px", "inch", "1/mm", "mm^2", "px/mm", "mm*px", "1/mm^2", "m/deg*px"] {
            assert_eq!(unit(text).to_string(), text);
        }
        for text in
            ["", "1", "cells", "%", "MM", "mm/cm", "mm*mm", "mm^0", "mm^10", "mm/", "/mm", "mm^"]
        {
            assert_eq!(Unit::read(text), None, "{text}");
        }
    }

    #[test]
    fn products_combine_and_quotients_cancel() {
        fn quantity(value: f64, text: &str) -> Quantity {
            Quantity { value, unit: unit(text) }
        }
        let area = quantity(2.0, "cm").times(quantity(30.0, "mm"));
        assert_eq!(area, quantity(6.0, "cm^2"));
        assert_eq!(area.divided_by(quantity(30.0, "mm")), quantity(2.0, "cm"));
        assert_eq!(quantity(12.0, "mm").divided_by(quantity(1.2, "cm")), Quantity::pure(1.0));
        assert_eq!(quantity(9.0, "cm^2").root(), Some(quantity(3.0, "cm")));
        assert_eq!(quantity(9.0, "cm").root(), None);
        assert!(unit("cm").is_compatible(unit("inch")) && !unit("mm").is_compatible(unit("px")));
        assert!(!unit("mm^2").is_compatible(unit("mm")));
    }
}
