//! The functions and constants of expressions.

use maquette_syntax::{Quantity, Unit};

/// A function that expressions can call.
pub(super) struct Function {
    name: &'static str,
    /// The minimum and the maximum number of arguments.
    pub(super) min_arguments: usize,
    pub(super) max_arguments: usize,
    pub(super) kind: FunctionKind,
}

/// The units that a function accepts and returns, and the code that computes its result.
#[derive(Clone, Copy)]
pub(super) enum FunctionKind {
    /// The arguments are converted to a common unit, which is also the unit of the result.
    Alike(fn(&[f64]) -> f64),
    /// The arguments are converted to a common unit. The result is an angle in rad.
    Angle(fn(&[f64]) -> f64),
    /// The function treats units itself. The text describes the accepted arguments, and an error is the index of a wrong argument.
    Quantity(&'static str, fn(&[Quantity]) -> Result<Quantity, usize>),
}

impl Function {
    const fn new(name: &'static str, least: usize, most: usize, computes: FunctionKind) -> Self {
        Self { name, min_arguments: least, max_arguments: most, kind: computes }
    }

    pub(super) fn find(name: &str) -> Option<&'static Self> {
        FUNCTIONS.iter().find(|function| function.name == name)
    }
}

const FUNCTIONS: [Function; 15] = [
    Function::new(
        "min",
        1,
        99,
        FunctionKind::Alike(|x| x.iter().copied().fold(f64::INFINITY, f64::min)),
    ),
    Function::new(
        "max",
        1,
        99,
        FunctionKind::Alike(|x| x.iter().copied().fold(f64::NEG_INFINITY, f64::max)),
    ),
    Function::new("clamp", 3, 3, FunctionKind::Alike(|x| x[0].max(x[1]).min(x[2]))),
    Function::new("abs", 1, 1, FunctionKind::Alike(|x| x[0].abs())),
    Function::new("floor", 1, 1, FunctionKind::Alike(|x| x[0].floor())),
    Function::new("round", 1, 1, FunctionKind::Alike(|x| x[0].round())),
    Function::new(
        "sqrt",
        1,
        1,
        FunctionKind::Quantity("a square, as mm^2 is", |x| x[0].root().ok_or(0)),
    ),
    Function::new(
        "pow",
        2,
        2,
        FunctionKind::Quantity("a pure number or a whole exponent", |x| power(x[0], x[1])),
    ),
    Function::new(
        "sin",
        1,
        1,
        FunctionKind::Quantity("an angle", |x| apply_to_angle(x[0], |(sin, _)| sin)),
    ),
    Function::new(
        "cos",
        1,
        1,
        FunctionKind::Quantity("an angle", |x| apply_to_angle(x[0], |(_, cos)| cos)),
    ),
    Function::new(
        "tan",
        1,
        1,
        FunctionKind::Quantity("an angle", |x| apply_to_angle(x[0], |(sin, cos)| sin / cos)),
    ),
    Function::new(
        "asin",
        1,
        1,
        FunctionKind::Quantity("a pure number", |x| angle_of(x[0], libm::asin)),
    ),
    Function::new(
        "acos",
        1,
        1,
        FunctionKind::Quantity("a pure number", |x| angle_of(x[0], libm::acos)),
    ),
    Function::new(
        "atan",
        1,
        1,
        FunctionKind::Quantity("a pure number", |x| angle_of(x[0], libm::atan)),
    ),
    Function::new("atan2", 2, 2, FunctionKind::Angle(|x| libm::atan2(x[0], x[1]))),
];

/// Returns the names of all functions.
pub(crate) fn function_names() -> impl Iterator<Item = &'static str> {
    FUNCTIONS.iter().map(|function| function.name).chain(["if"])
}

/// Returns true for the words `true`, `false` and `pi`, which have a fixed value.
pub(crate) fn is_constant(word: &str) -> bool {
    matches!(word, "true" | "false" | "pi")
}

/// Applies the function `value` to the sine and cosine of the angle `x`. A number without a unit is an angle in rad.
fn apply_to_angle(x: Quantity, value: fn((f64, f64)) -> f64) -> Result<Quantity, usize> {
    fn unit(name: &str) -> Unit {
        Unit::from_name(name).unwrap_or_default()
    }
    let rad = Quantity { unit: if x.unit.is_pure() { unit("rad") } else { x.unit }, ..x };
    match rad.unit {
        own if own == unit("deg") => Ok(Quantity::pure(value(sin_cos_degrees(x.value)))),
        own if own.is_compatible(unit("rad")) => {
            let angle = rad.to_unit(unit("rad"));
            Ok(Quantity::pure(value((libm::sin(angle), libm::cos(angle)))))
        }
        _ => Err(0),
    }
}

/// Returns the sine and cosine of an angle in degrees. The results are exact for multiples of 90 degrees.
fn sin_cos_degrees(degrees: f64) -> (f64, f64) {
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
    let unit = Unit::from_name("rad").unwrap_or_default();
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
