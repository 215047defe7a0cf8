//! Arithmetic on a graph's parameters: `Expr("growth / 2 + 1")`.
//!
//! Numbers and truth values; `+ - * / %`, comparisons, `and or not`; the functions in `functions` and `if(condition, then,
//! else)`. No loops, no I/O. A parameter's name may hold hyphens: `eye-step` is the parameter of that name if there is one,
//! and otherwise a difference.
//!
//! Numbers have units: those of parameters, and those that are written, as in `growth + cm(1)`. What is added, compared or chosen from
//! measures the same, and is converted to the unit of the first that has one; a pure number takes on the unit of the others. Products and
//! quotients combine units.

use std::collections::BTreeMap;
use std::fmt;
use std::ops::Range;

use maquette_syntax::{Help, Quantity, Unit, cut, nearest, unit_names};

mod functions;

use functions::{Computes, Function};
pub(super) use functions::{function_names, is_constant};

/// What an expression gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    Number(Quantity),
    Truth(bool),
}

/// Why an expression cannot be computed, and what may have been meant.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExpressionError {
    pub(crate) message: String,
    /// Where in the text, if it is not the whole of it, and another place with words for it.
    pub(crate) at: Option<Range<usize>>,
    pub(crate) note: Option<Box<(Range<usize>, String)>>,
    help: Help,
    /// The parameter that is not there, if that is why.
    unknown: Option<String>,
}

impl ExpressionError {
    /// The parameter that is not there, if that is why.
    pub(crate) fn unknown(&self) -> Option<&str> {
        self.unknown.as_deref()
    }

    /// What may have been meant.
    pub(crate) fn help(&self, parameters: &BTreeMap<String, Outcome>) -> Help {
        match &self.unknown {
            Some(name) => nearest(name, parameters.keys().map(String::as_str)),
            None => self.help.clone(),
        }
    }
}

impl fmt::Display for ExpressionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

fn error<T>(message: impl Into<String>) -> Result<T, ExpressionError> {
    Err(ExpressionError { message: message.into(), ..ExpressionError::default() })
}

/// The greatest number of hyphens in a name that an expression looks for.
const MAX_HYPHENS: usize = 31;

/// Computes `text` with these values for parameters.
///
/// # Errors
/// If it is no expression, names an unknown parameter, mixes numbers and truth values, or a part of it that counts has no finite value.
pub fn evaluate(
    text: &str,
    parameters: &BTreeMap<String, Outcome>,
) -> Result<Outcome, ExpressionError> {
    computed(text, parameters, true)
}

/// The same, where numbers may be infinite or none: a comparison with NaN does not hold.
pub fn evaluate_any(
    text: &str,
    parameters: &BTreeMap<String, Outcome>,
) -> Result<Outcome, ExpressionError> {
    computed(text, parameters, false)
}

fn computed(
    text: &str,
    parameters: &BTreeMap<String, Outcome>,
    must_be_finite: bool,
) -> Result<Outcome, ExpressionError> {
    let tokens = pieces(text, &|name| parameters.contains_key(name))?;
    let tokens = &tokens[..];
    let mut parser = Parser { text, tokens, next: 0, parameters, depth: 0, must_be_finite };
    let outcome = parser.binary(0)?;
    match parser.peek() {
        Some(token) => error(format!("the expression has `{token}` where it should end")),
        None => Ok(outcome),
    }
}

/// Deepest nesting of an expression: far more than anyone writes, far less than the stack holds.
const DEEPEST: usize = 64;

#[derive(Clone, Debug, PartialEq)]
enum Token {
    Number(f64),
    Name(String),
    Sign(&'static str),
}

impl fmt::Display for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(x) => write!(f, "{x}"),
            Self::Name(name) => f.write_str(name),
            Self::Sign(sign) => f.write_str(sign),
        }
    }
}

const SIGNS: [&str; 14] =
    ["<=", ">=", "==", "!=", "<", ">", "+", "-", "*", "/", "%", "(", ")", ","];

/// Operators by how tightly they bind, loosest first.
const LEVELS: [&[&str]; 5] =
    [&["or"], &["and"], &["<=", ">=", "==", "!=", "<", ">"], &["+", "-"], &["*", "/", "%"]];

/// Where an expression names parameters: places in its text. None if it is no expression.
pub fn named_parameters(text: &str, is_known: &dyn Fn(&str) -> bool) -> Option<Vec<Range<usize>>> {
    let tokens = pieces(text, is_known).ok()?;
    let mut names = Vec::new();
    let is_constant = |name: &str| is_constant(name) && !is_known(name);
    // Whether a value has just ended, so that a word is an operator.
    let mut is_behind = false;
    for (index, (at, token)) in tokens.iter().enumerate() {
        let opens = matches!(tokens.get(index + 1), Some((_, Token::Sign("("))));
        let is_name = matches!(token, Token::Name(name) if name != "not" && !is_behind && !opens);
        if is_name && !is_constant(&text[at.clone()]) {
            names.push(at.clone());
        }
        is_behind = is_name || matches!(token, Token::Number(_) | Token::Sign(")"));
    }
    Some(names)
}

/// The tokens of an expression and their places.
fn pieces(
    text: &str,
    is_known: &dyn Fn(&str) -> bool,
) -> Result<Vec<(Range<usize>, Token)>, ExpressionError> {
    let mut tokens = Vec::new();
    let mut rest = text.trim_start();
    while let Some(first) = rest.chars().next() {
        let start = text.len() - rest.len();
        let length = if first.is_ascii_digit() || first == '.' {
            let length = number_length(rest);
            match rest[..length].parse() {
                Ok(number) if !f64::is_finite(number) => {
                    return error(format!("`{}` is too large for a number", cut(&rest[..length])));
                }
                Ok(number) => tokens.push((start..start + length, Token::Number(number))),
                Err(_) => return error(format!("`{}` is not a number", &rest[..length])),
            }
            length
        } else if first.is_ascii_alphabetic() {
            let name = name_at(rest, is_known);
            tokens.push((start..start + name.len(), Token::Name(name.to_owned())));
            name.len()
        } else if let Some(sign) = SIGNS.into_iter().find(|sign| rest.starts_with(sign)) {
            tokens.push((start..start + sign.len(), Token::Sign(sign)));
            sign.len()
        } else {
            return error(format!("`{first}` has no meaning in an expression"));
        };
        rest = rest[length..].trim_start();
    }
    Ok(tokens)
}

fn number_length(text: &str) -> usize {
    let bytes = text.as_bytes();
    (1..bytes.len())
        .find(|&k| {
            let sign_of_exponent =
                matches!(bytes[k], b'+' | b'-') && matches!(bytes[k - 1], b'e' | b'E');
            !(bytes[k].is_ascii_alphanumeric() || bytes[k] == b'.' || sign_of_exponent)
        })
        .unwrap_or(bytes.len())
}

/// The longest known parameter at the start of the text; if there is none, the word up to the first hyphen. Names with
/// more than [`MAX_HYPHENS`] are not looked for, so that a long text is read in time that grows with its length.
fn name_at<'a>(text: &'a str, is_known: &dyn Fn(&str) -> bool) -> &'a str {
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    let mut hyphens = 0;
    let is_in = |byte: &u8| {
        hyphens += usize::from(*byte == b'-');
        is_part(char::from(*byte)) && hyphens <= MAX_HYPHENS
    };
    let whole = &text[..text.bytes().take_while(is_in).count()];
    let mut known = whole;
    while !is_known(known) {
        match known.rfind('-') {
            Some(hyphen) => known = &known[..hyphen],
            None => return known,
        }
    }
    known
}

struct Parser<'a> {
    text: &'a str,
    tokens: &'a [(Range<usize>, Token)],
    next: usize,
    parameters: &'a BTreeMap<String, Outcome>,
    depth: usize,
    /// Not in the branches of `if`, `and` and `or` that do not count.
    must_be_finite: bool,
}

/// A part of an expression, by its tokens, and what it gives.
type Part = (Range<usize>, Quantity);

impl Parser<'_> {
    fn peek(&self) -> Option<&Token> {
        self.tokens.get(self.next).map(|(_, token)| token)
    }

    /// The operator that comes next, if it is one of these.
    fn operator(&mut self, wanted: &[&'static str]) -> Option<&'static str> {
        let found = match self.peek()? {
            Token::Sign(sign) => sign,
            Token::Name(name) => name.as_str(),
            Token::Number(_) => return None,
        };
        let found = wanted.iter().find(|sign| **sign == found)?;
        self.next += 1;
        Some(found)
    }

    fn expect(&mut self, sign: &'static str) -> Result<(), ExpressionError> {
        match self.operator(&[sign]) {
            Some(_) => Ok(()),
            None => error(match self.peek() {
                Some(token) => format!("the expression has `{token}` where `{sign}` should be"),
                None => format!("the expression ends where `{sign}` should be"),
            }),
        }
    }

    fn binary(&mut self, level: usize) -> Result<Outcome, ExpressionError> {
        let Some(operators) = LEVELS.get(level) else { return self.unary() };
        let first = self.next;
        let mut left = self.binary(level + 1)?;
        while let Some(operator) = self.operator(operators) {
            let (end, second) = (self.next - 1, self.next);
            let decided = matches!(
                (operator, left),
                ("and", Outcome::Truth(false)) | ("or", Outcome::Truth(true))
            );
            let right = self.counting(!decided, |it| it.binary(level + 1))?;
            left = self.combine(operator, (first..end, left), (second..self.next, right))?;
        }
        Ok(left)
    }

    /// Reads a part of the expression that may not count.
    fn counting<T>(&mut self, counts: bool, read: impl FnOnce(&mut Self) -> T) -> T {
        let before = self.must_be_finite;
        self.must_be_finite &= counts;
        let part = read(self);
        self.must_be_finite = before;
        part
    }

    /// The number that an operator or a function gives for some numbers, if it is finite or need not be.
    fn finite(
        &self,
        value: Quantity,
        user: &str,
        at: Range<usize>,
        from: &[f64],
    ) -> Result<Outcome, ExpressionError> {
        if value.value.is_finite() || !self.must_be_finite {
            return Ok(Outcome::Number(value));
        }
        let number = |x: &f64| if x.abs() < 1e16 { x.to_string() } else { format!("{x:e}") };
        let from = Vec::from_iter(from.iter().map(number)).join(" and ");
        let message = format!("{} gives {}, from {from}", self.words(&at), value.value);
        let at = Some(self.place(&at));
        let help = match user {
            "/" | "%" => "give another value where it is 0: if(b == 0, 0, a / b)",
            "sqrt" => "keep it at 0 or above: sqrt(max(a, 0))",
            "asin" | "acos" => "keep it between -1 and 1: clamp(a, -1, 1)",
            _ => "keep the numbers smaller",
        };
        Err(ExpressionError { message, at, help: help.into(), ..ExpressionError::default() })
    }

    fn unary(&mut self) -> Result<Outcome, ExpressionError> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return error("the expression is nested too deeply");
        }
        let outcome = match self.operator(&["-", "+", "not"]) {
            Some("not") => match self.unary()? {
                Outcome::Truth(truth) => Ok(Outcome::Truth(!truth)),
                Outcome::Number(_) => error("`not` wants a condition, not a number"),
            },
            Some(sign) => {
                let x = number(self.unary()?, sign)?;
                let value = if sign == "-" { -x.value } else { x.value };
                Ok(Outcome::Number(Quantity { value, ..x }))
            }
            None => self.primary(),
        };
        self.depth -= 1;
        outcome
    }

    fn primary(&mut self) -> Result<Outcome, ExpressionError> {
        if self.operator(&["("]).is_some() {
            let outcome = self.binary(0)?;
            self.expect(")")?;
            return Ok(outcome);
        }
        let token = self.peek().cloned();
        self.next += 1;
        match token {
            Some(Token::Number(x)) => Ok(Outcome::Number(Quantity::pure(x))),
            Some(Token::Name(name)) if self.operator(&["("]).is_some() => self.call(&name),
            Some(Token::Name(name)) => self.parameter(&name),
            Some(Token::Sign(sign)) => {
                error(format!("the expression has `{sign}` where a number or a name should be"))
            }
            None => error("the expression ends where a number or a name should be"),
        }
    }

    fn parameter(&self, name: &str) -> Result<Outcome, ExpressionError> {
        match (self.parameters.get(name), name) {
            (Some(outcome), _) => Ok(*outcome),
            (None, "true") => Ok(Outcome::Truth(true)),
            (None, "false") => Ok(Outcome::Truth(false)),
            (None, "pi") => Ok(Outcome::Number(Quantity::pure(std::f64::consts::PI))),
            (None, _) => error(format!("the graph has no parameter `{name}`"))
                .map_err(|error| ExpressionError { unknown: Some(name.to_owned()), ..error }),
        }
    }

    /// The arguments of a call, up to its `)`. `counts` says of each, by those before it, whether it counts.
    fn arguments(
        &mut self,
        counts: impl Fn(&[(Range<usize>, Outcome)]) -> bool,
    ) -> Result<Vec<(Range<usize>, Outcome)>, ExpressionError> {
        let mut arguments = Vec::new();
        while self.operator(&[")"]).is_none() {
            if !arguments.is_empty() {
                self.expect(",")?;
            }
            let first = self.next;
            let argument = self.counting(counts(&arguments), |it| it.binary(0))?;
            arguments.push((first..self.next, argument));
        }
        Ok(arguments)
    }

    fn choice(&mut self) -> Result<Outcome, ExpressionError> {
        let arguments = self.arguments(|before| match before {
            [(_, Outcome::Truth(condition))] => *condition,
            [(_, Outcome::Truth(condition)), _] => !condition,
            _ => true,
        })?;
        match &arguments[..] {
            [(_, Outcome::Truth(condition)), then, otherwise] => {
                if let (Outcome::Number(a), Outcome::Number(b)) = (then.1, otherwise.1) {
                    self.alike("if", &[(then.0.clone(), a), (otherwise.0.clone(), b)])?;
                }
                Ok(if *condition { then.1 } else { otherwise.1 })
            }
            _ => error("`if` wants a condition and two values: if(a < b, a, b)"),
        }
    }

    fn call(&mut self, name: &str) -> Result<Outcome, ExpressionError> {
        // Its name and `(` have been read.
        let start = self.next - 2;
        if name == "if" {
            return self.choice();
        }
        let arguments = self.arguments(|_| true)?;
        let function = Function::named(name);
        let unit = Unit::named(name);
        let (least, most) = match function {
            Some(function) => (function.least, function.most),
            None if unit.is_some() => (1, 1),
            None => {
                let help = nearest(name, function_names().chain(unit_names()));
                return error(format!("there is no function `{name}`"))
                    .map_err(|error| ExpressionError { help, ..error });
            }
        };
        if !(least..=most).contains(&arguments.len()) {
            return error(format!("`{name}` does not take {} arguments", arguments.len()));
        }
        let part = |(at, argument): (Range<usize>, _)| Ok((at, number(argument, name)?));
        let parts = arguments.into_iter().map(part).collect::<Result<Vec<Part>, _>>()?;
        let from = Vec::from_iter(parts.iter().map(|(_, argument)| argument.value));
        let found = match function.map(|function| function.computes) {
            Some(Computes::Alike(compute)) => {
                let (values, unit) = self.alike(name, &parts)?;
                Quantity { value: compute(&values), unit }
            }
            Some(Computes::Angle(compute)) => {
                let (values, _) = self.alike(name, &parts)?;
                Quantity { value: compute(&values), unit: Unit::named("rad").unwrap_or_default() }
            }
            Some(Computes::Quantity(wanted, compute)) => {
                let quantities = Vec::from_iter(parts.iter().map(|(_, argument)| *argument));
                compute(&quantities).map_err(|place| self.misfit(name, wanted, &parts[place]))?
            }
            None => match unit {
                Some(unit) if parts[0].1.unit.is_pure() => Quantity { unit, ..parts[0].1 },
                _ => return Err(self.misfit(name, "a pure number", &parts[0])),
            },
        };
        self.finite(found, name, start..self.next, &from)
    }

    /// Says that an argument is in a unit that the function does not take.
    fn misfit(&self, name: &str, wanted: &str, (at, argument): &Part) -> ExpressionError {
        let unit = match argument.unit {
            unit if unit.is_pure() => "a pure number".to_owned(),
            unit => format!("in {unit}"),
        };
        let message = format!("`{name}` wants {wanted}, but {} is {unit}", self.words(at));
        ExpressionError { message, at: Some(self.place(at)), ..ExpressionError::default() }
    }

    fn combine(
        &self,
        operator: &str,
        (left_at, left): (Range<usize>, Outcome),
        (right_at, right): (Range<usize>, Outcome),
    ) -> Result<Outcome, ExpressionError> {
        if let (Outcome::Truth(a), Outcome::Truth(b)) = (left, right) {
            return match operator {
                "and" => Ok(Outcome::Truth(a && b)),
                "or" => Ok(Outcome::Truth(a || b)),
                "==" => Ok(Outcome::Truth(a == b)),
                "!=" => Ok(Outcome::Truth(a != b)),
                _ => error(format!("`{operator}` wants numbers, not conditions")),
            };
        }
        let (left, right) = (number(left, operator)?, number(right, operator)?);
        let both = left_at.start..right_at.end;
        let from = [left.value, right.value];
        match operator {
            "*" => return self.finite(left.times(right), operator, both, &from),
            "/" => return self.finite(left.over(right), operator, both, &from),
            "and" | "or" => return error(format!("`{operator}` wants conditions, not numbers")),
            _ => {}
        }
        let (values, unit) = self.alike(operator, &[(left_at, left), (right_at, right)])?;
        let (a, b) = (values[0], values[1]);
        let number = |value| self.finite(Quantity { value, unit }, operator, both.clone(), &from);
        Ok(match operator {
            "+" => number(a + b)?,
            "-" => number(a - b)?,
            "%" => number(a % b)?,
            "<" => Outcome::Truth(a < b),
            "<=" => Outcome::Truth(a <= b),
            ">" => Outcome::Truth(a > b),
            ">=" => Outcome::Truth(a >= b),
            "==" => Outcome::Truth(a == b),
            _ => Outcome::Truth(a != b),
        })
    }

    /// The numbers in the unit of the first of them that has one, and that unit; pure numbers take it on.
    fn alike(&self, user: &str, parts: &[Part]) -> Result<(Vec<f64>, Unit), ExpressionError> {
        let Some((first, Quantity { unit, .. })) = parts.iter().find(|(_, it)| !it.unit.is_pure())
        else {
            return Ok((parts.iter().map(|(_, it)| it.value).collect(), Unit::default()));
        };
        let value = |(at, it): &Part| match it.unit {
            own if own.is_pure() => Ok(it.value),
            own if own.is_like(*unit) => Ok(it.in_unit(*unit)),
            own => Err(ExpressionError {
                message: format!(
                    "`{user}` wants one unit, but {} is in {unit} and {} in {own}",
                    self.words(first),
                    self.words(at)
                ),
                at: Some(self.place(at)),
                note: Some(Box::new((self.place(first), format!("this is in {unit}")))),
                help: "what is added, compared or chosen from measures the same".into(),
                ..ExpressionError::default()
            }),
        };
        Ok((parts.iter().map(value).collect::<Result<_, _>>()?, *unit))
    }

    /// Where in the text some tokens stand.
    fn place(&self, tokens: &Range<usize>) -> Range<usize> {
        self.tokens[tokens.start].0.start..self.tokens[tokens.end - 1].0.end
    }

    fn words(&self, tokens: &Range<usize>) -> String {
        format!("`{}`", cut(&self.text[self.place(tokens)]))
    }
}

fn number(outcome: Outcome, user: &str) -> Result<Quantity, ExpressionError> {
    match outcome {
        Outcome::Number(x) => Ok(x),
        Outcome::Truth(_) => error(format!("`{user}` wants a number, not a condition")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(text: &str) -> Result<Outcome, String> {
        let number = |value, unit: &str| {
            let unit = Unit::read(unit).unwrap_or_default();
            Outcome::Number(Quantity { value, unit })
        };
        let parameters = BTreeMap::from([
            ("growth".to_owned(), number(12.0, "")),
            ("eye-step".to_owned(), number(3.0, "")),
            ("eye".to_owned(), number(5.0, "")),
            ("zero".to_owned(), number(0.0, "")),
            ("depth".to_owned(), number(12.0, "mm")),
            ("width".to_owned(), number(2.5, "cm")),
            ("turn".to_owned(), number(30.0, "deg")),
            ("band".to_owned(), number(4.0, "px")),
            ("flat".to_owned(), Outcome::Truth(true)),
        ]);
        evaluate(text, &parameters).map_err(|error| {
            let place = |at: &Range<usize>| text[at.clone()].to_owned();
            let at = error.at.as_ref().map_or_else(String::new, |at| format!(" at {}", place(at)));
            let note = error.note.as_ref();
            let note = note.map_or_else(String::new, |note| {
                let (at, words) = &**note;
                format!(" ({}: {words})", place(at))
            });
            format!("{error}; {}{at}{note}", error.help(&parameters))
        })
    }

    fn check(text: &str, expected: f64) {
        assert_eq!(value(text), Ok(Outcome::Number(Quantity::pure(expected))), "{text}");
    }

    fn check_unit(text: &str, expected: f64, unit: &str) {
        let unit = Unit::read(unit).unwrap_or_else(|| panic!("{unit}"));
        let expected = Outcome::Number(Quantity { value: expected, unit });
        assert_eq!(value(text), Ok(expected), "{text}");
    }

    #[test]
    fn arithmetic_binds_as_usual() {
        check("growth / 2 + 1", 7.0);
        check("2 + 3 * -4", -10.0);
        check("(2 + 3) * 4 % 6", 2.0);
        check("10 - 2 - 3", 5.0);
        check("1e-3 * 1000", 1.0);
        check("clamp(growth, 0, 10) + max(1, 2, 3) + sqrt(4) + round(0.6)", 16.0);
        check("if(growth > 10 and not flat or false, 1, 2)", 2.0);
    }

    #[test]
    fn a_hyphen_belongs_to_a_known_name_and_subtracts_otherwise() {
        check("eye-step", 3.0);
        check("eye-1", 4.0);
        check("growth-eye-step", 9.0);
        check("eye -step-1".trim_end_matches("-step-1"), 5.0);
    }

    #[test]
    fn the_parameters_in_an_expression_are_those_that_it_is_computed_from() {
        let named = |text: &str| {
            let is_known = |name: &str| matches!(name, "a" | "a-b" | "min" | "and");
            let names = named_parameters(text, &is_known)?;
            Some(Vec::from_iter(names.into_iter().map(|at| text[at].to_owned())).join(" "))
        };
        assert_eq!(named("a - b-1").as_deref(), Some("a b"));
        assert_eq!(named(" a-b*min(min, 2)-a").as_deref(), Some("a-b min a"));
        assert_eq!(named("if(not a and and, (a) and 1e3, 2)").as_deref(), Some("a and a"));
        assert_eq!(named("a $"), None);
    }

    #[test]
    fn what_measures_the_same_is_added_in_the_unit_of_the_first() {
        check_unit("depth + cm(1)", 22.0, "mm");
        check_unit("cm(1) + depth", 2.2, "cm");
        check_unit("depth - width", -13.0, "mm");
        check_unit("width % mm(10)", 0.5, "cm");
        check_unit("min(depth, width, 3)", 3.0, "mm");
        check_unit("clamp(width, mm(5), inch(0.5))", 1.27, "cm");
        check_unit("if(depth < width, turn, rad(0))", 30.0, "deg");
        assert_eq!(value("depth == mm(12) and depth < width"), Ok(Outcome::Truth(true)));
    }

    #[test]
    fn a_pure_number_takes_on_the_unit_of_what_it_meets() {
        check_unit("depth + 2", 14.0, "mm");
        check_unit("2 * 4 + depth", 20.0, "mm");
        check_unit("max(1, width)", 2.5, "cm");
        check_unit("-depth / 2", -6.0, "mm");
        check_unit("floor(width)", 2.0, "cm");
        check_unit("mm(2 * growth)", 24.0, "mm");
    }

    #[test]
    fn products_and_quotients_combine_units_or_cancel_them() {
        check("depth / mm(2)", 6.0);
        check("width / mm(5)", 5.0);
        check_unit("depth * width", 300.0, "mm^2");
        check_unit("sqrt(depth * mm(3))", 6.0, "mm");
        check_unit("1 / width", 0.4, "1/cm");
        check_unit("depth * (band / mm(3))", 16.0, "px");
    }

    #[test]
    fn units_that_do_not_go_together_are_named_with_both_places() {
        let wrong = |text: &str| value(text).unwrap_err();
        let help = "what is added, compared or chosen from measures the same";
        assert_eq!(
            wrong("2 * depth + turn"),
            format!(
                "`+` wants one unit, but `2 * depth` is in mm and `turn` in deg; {help} at turn (2 * depth: this is in mm)"
            )
        );
        assert_eq!(
            wrong("min(1, px(2), depth)"),
            format!(
                "`min` wants one unit, but `px(2)` is in px and `depth` in mm; {help} at depth (px(2): this is in px)"
            )
        );
        assert_eq!(
            wrong("if(flat, band, turn)"),
            format!(
                "`if` wants one unit, but `band` is in px and `turn` in deg; {help} at turn (band: this is in px)"
            )
        );
        assert!(wrong("depth < band").starts_with("`<` wants one unit, but `depth` is in mm"));
        assert!(
            wrong("depth * width - depth").contains("`depth * width` is in mm^2 and `depth` in mm")
        );
        assert_eq!(
            wrong("sqrt(depth)"),
            "`sqrt` wants a square, as mm^2 is, but `depth` is in mm;  at depth"
        );
        assert_eq!(wrong("cm(depth)"), "`cm` wants a pure number, but `depth` is in mm;  at depth");
        assert_eq!(wrong("inhc(2)"), "there is no function `inhc`; did you mean `inch`?");
    }

    #[test]
    fn what_is_not_finite_is_an_error_wherever_it_arises() {
        let wrong = |text: &str| value(text).unwrap_err();
        for (text, message) in [
            ("max(zero / zero, 3)", "`zero / zero` gives NaN, from 0 and 0"),
            ("min(growth % zero, 3)", "`growth % zero` gives NaN, from 12 and 0"),
            ("clamp(depth / zero, 0, 5)", "`depth / zero` gives inf, from 12 and 0"),
            ("max(sqrt(-growth), 1)", "`sqrt(-growth)` gives NaN, from -12"),
            ("1 / (1 / zero)", "`1 / zero` gives inf, from 1 and 0"),
            ("pow(growth, 999) > 1", "`pow(growth, 999)` gives inf, from 12 and 999"),
            ("min(asin(growth), 1)", "`asin(growth)` gives NaN, from 12"),
            ("tan(deg(90)) - 1", "`tan(deg(90))` gives inf, from 90"),
            ("1e308 * 10 > 0", "`1e308 * 10` gives inf, from 1e308 and 10"),
            ("if(zero / zero > 1, 1, 2)", "`zero / zero` gives NaN, from 0 and 0"),
            ("min(1, 1e999)", "`1e999` is too large for a number"),
        ] {
            assert!(wrong(text).starts_with(message), "{text}: {}", wrong(text));
        }
    }

    #[test]
    fn what_does_not_count_need_not_be_finite() {
        check("if(zero > 0, growth / zero, 7)", 7.0);
        check("if(zero == 0, 7, if(flat, growth % zero, sqrt(-1)))", 7.0);
        assert_eq!(value("zero > 0 and growth / zero > 1"), Ok(Outcome::Truth(false)));
        assert_eq!(value("zero == 0 or growth / zero > 1"), Ok(Outcome::Truth(true)));
        let parameters =
            BTreeMap::from([("a".to_owned(), Outcome::Number(Quantity::pure(f64::NAN)))]);
        assert_eq!(evaluate_any("a * 2 > 1", &parameters), Ok(Outcome::Truth(false)));
    }

    #[test]
    fn angles_are_computed_in_their_units() {
        let near = |text: &str, expected: f64, unit: &str| {
            let Ok(Outcome::Number(found)) = value(text) else {
                panic!("{text}: {:?}", value(text))
            };
            assert!((found.value - expected).abs() < 1e-14, "{text}: {}", found.value);
            assert_eq!(found.unit, Unit::read(unit).unwrap_or_default(), "{text}");
        };
        near("sin(turn)", 0.5, "");
        near("sin(pi / 6)", 0.5, "");
        near("depth * cos(deg(60))", 6.0, "mm");
        near("tan(rad(pi / 4))", 1.0, "");
        near("asin(1) / deg(1)", 90.0, "");
        near("acos(0)", std::f64::consts::FRAC_PI_2, "rad");
        near("atan(1)", std::f64::consts::FRAC_PI_4, "rad");
        near("atan2(depth, cm(1.2))", std::f64::consts::FRAC_PI_4, "rad");
        check("cos(deg(90)) + sin(deg(-180)) + sin(deg(720))", 0.0);
        check("sin(deg(450)) - cos(deg(-180))", 2.0);
        let wrong = |text: &str| value(text).unwrap_err();
        assert_eq!(wrong("sin(depth)"), "`sin` wants an angle, but `depth` is in mm;  at depth");
        assert!(wrong("atan2(depth, turn)").starts_with("`atan2` wants one unit"));
        assert_eq!(
            wrong("acos(turn)"),
            "`acos` wants a pure number, but `turn` is in deg;  at turn"
        );
    }

    #[test]
    fn powers_have_powers_of_units() {
        check("pow(2, 10) + pow(4, 0.5)", 1026.0);
        check_unit("pow(depth, 2)", 144.0, "mm^2");
        check_unit("pow(width, -1)", 0.4, "1/cm");
        check("pow(depth, 0)", 1.0);
        let wrong = |text: &str| value(text).unwrap_err();
        assert_eq!(
            wrong("pow(depth, 0.5)"),
            "`pow` wants a pure number or a whole exponent, but `depth` is in mm;  at depth"
        );
        assert!(wrong("pow(2, depth)").contains("but `depth` is in mm"));
    }

    #[test]
    fn a_parameter_may_have_the_name_of_a_constant() {
        let parameters = BTreeMap::from([("pi".to_owned(), Outcome::Number(Quantity::pure(3.0)))]);
        assert_eq!(evaluate("pi", &parameters), Ok(Outcome::Number(Quantity::pure(3.0))));
        assert_eq!(named_parameters("pi + true", &|name| name == "pi"), Some(vec![0..2]));
        assert_eq!(named_parameters("pi + a", &|_| false), Some(vec![5..6]));
    }

    #[test]
    fn a_long_expression_is_read_in_time() {
        let start = std::time::Instant::now();
        let parameters: BTreeMap<_, _> =
            (0..20_000).map(|k| (format!("a-{k}"), Outcome::Number(Quantity::pure(1.0)))).collect();
        let names = "a-".repeat(50_000) + "a-1";
        assert!(evaluate(&names, &parameters).is_err());
        let sum = (0..20_000).map(|k| format!("a-{k}")).collect::<Vec<_>>().join(" + ");
        assert_eq!(evaluate(&sum, &parameters), Ok(Outcome::Number(Quantity::pure(20_000.0))));
        assert!(start.elapsed().as_secs() < 60, "{:?}", start.elapsed());
    }

    #[test]
    fn mistakes_are_explained() {
        let wrong = |text: &str| value(text).unwrap_err();
        assert_eq!(wrong("growth * "), "the expression ends where a number or a name should be; ");
        assert_eq!(wrong("grwth"), "the graph has no parameter `grwth`; did you mean `growth`?");
        assert_eq!(wrong("flor(1)"), "there is no function `flor`; did you mean `floor`?");
        assert_eq!(
            wrong("1 + 1 / 0"),
            "`1 / 0` gives inf, from 1 and 0; give another value where it is 0: if(b == 0, 0, a / b) at 1 / 0"
        );
        assert_eq!(wrong("1 + flat"), "`+` wants a number, not a condition; ");
        assert_eq!(wrong("(1"), "the expression ends where `)` should be; ");
        assert_eq!(wrong("1 2"), "the expression has `2` where it should end; ");
        assert_eq!(wrong("1 $ 2"), "`$` has no meaning in an expression; ");
        assert!(wrong(&"(".repeat(9999)).contains("nested too deeply"));
    }
}
