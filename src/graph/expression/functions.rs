//! The functions and constants of expressions.

use maquette_syntax::{Quantity, Unit};

/// A function of an expression.
pub(super) struct Function {
    name: &'static str,
    /// The least and the greatest number of its arguments.
    pub(super) least: usize,
    pub(super) most: usize,
    pub(super) computes: Computes,
}

/// What a function computes.
#[derive(Clone, Copy)]
pub(super) enum Computes {
    /// A number in the unit of its arguments, which are converted to one.
    Alike(fn(&[f64]) -> f64),
    /// An angle in rad, of arguments that are converted to one unit.
    Angle(fn(&[f64]) -> f64),
    /// Anything, of arguments that this is wanted of; an error is the number of an argument that does not fit.
    Quantity(&'static str, fn(&[Quantity]) -> Result<Quantity, usize>),
}

impl Function {
    const fn new(name: &'static str, least: usize, most: usize, computes: Computes) -> Self {
        Self { name, least, most, computes }
    }

    pub(super) fn named(name: &str) -> Option<&'static Self> {
        FUNCTIONS.iter().find(|function| function.name == name)
    }
}

const FUNCTIONS: [Function; 15] = [
    Function::new(
        "min",
        1,
        99,
        Computes::Alike(|x| x.iter().copied().fold(f64::INFINITY, f64::min)),
    ),
    Function::new(
        "max",
        1,
        99,
        Computes::Alike(|x| x.iter().copied().fold(f64::NEG_INFINITY, f64::max)),
    ),
    Function::new("clamp", 3, 3, Computes::Alike(|x| x[0].max(x[1]).min(x[2]))),
    Function::new("abs", 1, 1, Computes::Alike(|x| x[0].abs())),
    Function::new("floor", 1, 1, Computes::Alike(|x| x[0].floor())),
    Function::new("round", 1, 1, Computes::Alike(|x| x[0].round())),
    Function::new(
        "sqrt",
        1,
        1,
        Computes::Quantity("a square, as mm^2 is", |x| x[0].root().ok_or(0)),
    ),
    Function::new(
        "pow",
        2,
        2,
        Computes::Quantity("a pure number or a whole exponent", |x| power(x[0], x[1])),
    ),
    Function::new("sin", 1, 1, Computes::Quantity("an angle", |x| of_angle(x[0], |(sin, _)| sin))),
    Function::new("cos", 1, 1, Computes::Quantity("an angle", |x| of_angle(x[0], |(_, cos)| cos))),
    Function::new(
        "tan",
        1,
        1,
        Computes::Quantity("an angle", |x| of_angle(x[0], |(sin, cos)| sin / cos)),
    ),
    Function::new(
        "asin",
        1,
        1,
        Computes::Quantity("a pure number", |x| angle_of(x[0], libm::asin)),
    ),
    Function::new(
        "acos",
        1,
        1,
        Computes::Quantity("a pure number", |x| angle_of(x[0], libm::acos)),
    ),
    Function::new(
        "atan",
        1,
        1,
        Computes::Quantity("a pure number", |x| angle_of(x[0], libm::atan)),
    ),
    Function::new("atan2", 2, 2, Computes::Angle(|x| libm::atan2(x[0], x[1]))),
];

/// The names of all functions.
pub(crate) fn function_names() -> impl Iterator<Item = &'static str> {
    FUNCTIONS.iter().map(|function| function.name).chain(["if"])
}

/// Returns true for a word that has a value by itself.
pub(crate) fn is_constant(word: &str) -> bool {
    matches!(word, "true" | "false" | "pi")
}

/// A value of the sine and cosine of an angle; a pure number is one in rad.
fn of_angle(x: Quantity, value: fn((f64, f64)) -> f64) -> Result<Quantity, usize> {
    fn named(name: &str) -> Unit {
        Unit::named(name).unwrap_or_default()
    }
    let rad = Quantity { unit: if x.unit.is_pure() { named("rad") } else { x.unit }, ..x };
    match rad.unit {
        unit if unit == named("deg") => Ok(Quantity::pure(value(of_degrees(x.value)))),
        unit if unit.is_like(named("rad")) => {
            let angle = rad.in_unit(named("rad"));
            Ok(Quantity::pure(value((libm::sin(angle), libm::cos(angle)))))
        }
        _ => Err(0),
    }
}

/// Sine and cosine, which are exact for multiples of a right angle.
fn of_degrees(degrees: f64) -> (f64, f64) {
    let turn = degrees % 360.0;
    match (turn + 360.0) % 360.0 {
        0.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        _ => (libm::sin(turn.to_radians()), libm::cos(turn.to_radians())),
    }
}

fn angle_of(x: Quantity, angle: fn(f64) -> f64) -> Result<Quantity, usize> {
    let unit = Unit::named("rad").unwrap_or_default();
    if x.unit.is_pure() { Ok(Quantity { value: angle(x.value), unit }) } else { Err(0) }
}

fn power(base: Quantity, exponent: Quantity) -> Result<Quantity, usize> {
    let value = libm::pow(base.value, exponent.value);
    let is_whole = exponent.value.fract() == 0.0 && exponent.value.abs() <= 99.0;
    match (base.unit.is_pure(), exponent.unit.is_pure()) {
        (_, false) => Err(1),
        (true, true) => Ok(Quantity::pure(value)),
        (false, true) if is_whole => {
            Ok(Quantity { value, unit: base.unit.to_power(exponent.value as i32) })
        }
        (false, true) => Err(0),
    }
}
