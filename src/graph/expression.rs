//! Arithmetic on a graph's parameters: `Expr("growth / 2 + 1")`.
//!
//! An expression consists of numbers and truth values, `+ - * / %`, comparisons, `and or not`, the functions in `functions`, and
//! `if(condition, then, else)`. There are no loops and no I/O. Names of parameters may contain hyphens: `eye-step` is the parameter of that
//! name if the graph has one, and otherwise the difference `eye - step`. `shift.x` is the first number of the vector `shift`.
//!
//! Numbers can have units, from the declaration of a parameter or as written in `growth + cm(1)`. The operands of a sum, comparison or
//! choice must measure the same quantity. They are converted to the unit of the first operand that has one, and operands without a unit
//! take that unit. Products and quotients combine units.

use std::collections::BTreeMap;
use std::fmt;
use std::ops::Range;

use maquette_syntax::{Help, Quantity, Unit, nearest, truncate, unit_names};

mod functions;

use functions::{Function, FunctionKind};
pub(super) use functions::{function_names, is_constant};

/// The result of an expression: a number with its unit, or a truth value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    Number(Quantity),
    Truth(bool),
}

/// An error in an expression, with a suggestion.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExpressionError {
    pub(crate) message: String,
    /// `at` is the byte range of the error in the text; `None` if the error concerns the whole expression. `note` is a second range with an
    /// explanation.
    pub(crate) at: Option<Range<usize>>,
    pub(crate) note: Option<Box<(Range<usize>, String)>>,
    help: Help,
    /// The name of the unknown parameter, for errors of this kind. Otherwise `None`.
    unknown: Option<String>,
}

impl ExpressionError {
    /// Returns the name of the unknown parameter, for errors of this kind. Otherwise `None`.
    pub(crate) fn unknown(&self) -> Option<&str> {
        self.unknown.as_deref()
    }

    /// Returns a suggestion for correcting the expression, such as a parameter with a similar name.
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

/// The maximum number of hyphens in a parameter name that an expression can contain.
const MAX_HYPHENS: usize = 31;

/// Evaluates the expression `text` with the given values of parameters.
///
/// # Errors
/// The text is not an expression, names an unknown parameter, or mixes numbers and truth values. Also if an infinite or NaN part
/// contributes to the result.
pub fn evaluate(
    text: &str,
    parameters: &BTreeMap<String, Outcome>,
) -> Result<Outcome, ExpressionError> {
    evaluate_with(text, parameters, true)
}

/// Evaluates the expression `text`. Infinite numbers and NaN are allowed; comparisons with NaN are false.
pub fn evaluate_any(
    text: &str,
    parameters: &BTreeMap<String, Outcome>,
) -> Result<Outcome, ExpressionError> {
    evaluate_with(text, parameters, false)
}

fn evaluate_with(
    text: &str,
    parameters: &BTreeMap<String, Outcome>,
    must_be_finite: bool,
) -> Result<Outcome, ExpressionError> {
    let tokens = tokenize(text, &|name| parameters.contains_key(name))?;
    let tokens = &tokens[..];
    let mut parser = Parser { text, tokens, next: 0, parameters, depth: 0, must_be_finite };
    let outcome = parser.binary(0)?;
    match parser.peek() {
        Some(token) => error(format!("expected the end of the expression, found `{token}`")),
        None => Ok(outcome),
    }
}

/// Maximum nesting depth of an expression, far below the depth that would overflow the stack.
const MAX_DEPTH: usize = 64;

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

/// The selectors of the numbers of a vector, as in `shift.x`, in the order of the numbers.
const COMPONENTS: [&str; 4] = [".x", ".y", ".z", ".w"];

/// Returns the names of the numbers of the vector `name` in expressions: `shift.x`, `shift.y` and so on. A fifth number has no name.
pub(crate) fn component_names(name: &str) -> impl Iterator<Item = String> {
    COMPONENTS.iter().map(move |component| format!("{name}{component}"))
}

/// The operators by precedence, from the lowest to the highest.
const LEVELS: [&[&str]; 5] =
    [&["or"], &["and"], &["<=", ">=", "==", "!=", "<", ">"], &["+", "-"], &["*", "/", "%"]];

/// Returns the byte ranges of the parameter names in an expression. `None` if the text cannot be split into tokens.
pub fn named_parameters(text: &str, is_known: &dyn Fn(&str) -> bool) -> Option<Vec<Range<usize>>> {
    let tokens = tokenize(text, is_known).ok()?;
    let mut names = Vec::new();
    fn is_allowed(name: &str, is_known: &dyn Fn(&str) -> bool) -> bool {
        is_constant(name) && !is_known(name)
    }
    // True if the previous token ends an operand. Only in that position, a word such as `and` is an operator.
    let mut is_behind = false;
    for (index, (at, token)) in tokens.iter().enumerate() {
        let opens = matches!(tokens.get(index + 1), Some((_, Token::Sign("("))));
        let is_name = matches!(token, Token::Name(name) if name != "not" && !is_behind && !opens);
        if is_name && !is_allowed(&text[at.clone()], is_known) {
            names.push(at.clone());
        }
        is_behind = is_name
            || match token {
                Token::Number(_) => true,
                Token::Sign(sign) => *sign == ")" || COMPONENTS.contains(sign),
                Token::Name(_) => false,
            };
    }
    Some(names)
}

/// Splits an expression into tokens with their ranges.
fn tokenize(
    text: &str,
    is_known: &dyn Fn(&str) -> bool,
) -> Result<Vec<(Range<usize>, Token)>, ExpressionError> {
    let mut tokens = Vec::new();
    let mut rest = text.trim_start();
    while let Some(first) = rest.chars().next() {
        let start = text.len() - rest.len();
        let length = if let Some(component) = component_at(rest) {
            tokens.push((start..start + component.len(), Token::Sign(component)));
            component.len()
        } else if first.is_ascii_digit() || first == '.' {
            let length = number_length(rest);
            match rest[..length].parse() {
                Ok(number) if !f64::is_finite(number) => {
                    return error(format!(
                        "`{}` is too large for a number",
                        truncate(&rest[..length])
                    ));
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

/// Returns the selector of a component at the start of the text, if there is one.
fn component_at(text: &str) -> Option<&'static str> {
    COMPONENTS.into_iter().find(|component| {
        let behind = text.strip_prefix(component).and_then(|behind| behind.chars().next());
        text.starts_with(component)
            && !behind.is_some_and(|c| c.is_ascii_alphanumeric() || c == '_')
    })
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

/// Returns the longest known parameter name at the start of the text, or else the word up to the first hyphen. Names with more than
/// [`MAX_HYPHENS`] hyphens are not recognized, which keeps the time linear in the length of the text.
fn name_at<'a>(text: &'a str, is_known: &dyn Fn(&str) -> bool) -> &'a str {
    fn is_part(c: char) -> bool {
        c.is_ascii_alphanumeric() || c == '-' || c == '_'
    }
    let mut hyphens = 0;
    let whole = &text[..text
        .bytes()
        .take_while(|byte| {
            hyphens += usize::from(*byte == b'-');
            is_part(char::from(*byte)) && hyphens <= MAX_HYPHENS
        })
        .count()];
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
    /// False in a branch of `if`, `and` or `or` that does not contribute to the result. The numbers in such a branch may be infinite.
    must_be_finite: bool,
}

/// An operand: the range of its tokens, and its value.
type Part = (Range<usize>, Quantity);

impl Parser<'_> {
    fn peek(&self) -> Option<&Token> {
        self.tokens.get(self.next).map(|(_, token)| token)
    }

    /// Reads an operator, if it is one of `wanted`.
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
            let right = self.read_counting(!decided, |it| it.binary(level + 1))?;
            left = self.combine(operator, (first..end, left), (second..self.next, right))?;
        }
        Ok(left)
    }

    /// Reads an operand. `counts` is true if the operand contributes to the result.
    fn read_counting<T>(&mut self, counts: bool, read: impl FnOnce(&mut Self) -> T) -> T {
        let before = self.must_be_finite;
        self.must_be_finite &= counts;
        let part = read(self);
        self.must_be_finite = before;
        part
    }

    /// Returns the result of an operator or a function. Returns an error if the result contributes to the expression and is not finite.
    fn finite_outcome(
        &self,
        value: Quantity,
        user: &str,
        at: Range<usize>,
        from: &[f64],
    ) -> Result<Outcome, ExpressionError> {
        if value.value.is_finite() || !self.must_be_finite {
            return Ok(Outcome::Number(value));
        }
        let from = from
            .iter()
            .map(|x| if x.abs() < 1e16 { x.to_string() } else { format!("{x:e}") })
            .collect::<Vec<_>>()
            .join(" and ");
        let message = format!("{} gives {}, from {from}", self.quoted_text(&at), value.value);
        let at = Some(self.text_range(&at));
        let help = match user {
            "/" | "%" => "give another value where it is 0: if(b == 0, 0, a / b)",
            "sqrt" => "keep it at 0 or above: sqrt(max(a, 0))",
            "asin" | "acos" => "keep it between -1 and 1: clamp(a, -1, 1)",
            _ => "use smaller numbers",
        };
        Err(ExpressionError { message, at, help: help.into(), ..ExpressionError::default() })
    }

    fn unary(&mut self) -> Result<Outcome, ExpressionError> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return error("the expression is nested too deeply");
        }
        let outcome = match self.operator(&["-", "+", "not"]) {
            Some("not") => match self.unary()? {
                Outcome::Truth(truth) => Ok(Outcome::Truth(!truth)),
                Outcome::Number(_) => error("`not`: expected a condition, found a number"),
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
            Some(Token::Name(name)) => match self.operator(&COMPONENTS) {
                Some(component) => self.component(&name, component),
                None => self.parameter(&name),
            },
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

    /// Returns a number of a vector.
    fn component(&self, name: &str, component: &str) -> Result<Outcome, ExpressionError> {
        if let Some(outcome) = self.parameters.get(&format!("{name}{component}")) {
            return Ok(*outcome);
        }
        let components: Vec<_> =
            component_names(name).filter(|it| self.parameters.contains_key(it)).collect();
        if let (Some(last), false) = (components.last(), self.parameters.contains_key(name)) {
            let message = format!("`{name}` has no `{component}`: its last number is `{last}`");
            return error(message);
        }
        self.parameter(name)?;
        error(format!("`{name}{component}`: `{name}` is not a vector"))
            .map_err(|error| ExpressionError { help: format!("write `{name}`").into(), ..error })
    }

    /// Reads the arguments of a call up to the closing `)`. `counts` is called with the arguments read so far. It returns true if the next
    /// argument contributes to the result.
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
            let argument = self.read_counting(counts(&arguments), |it| it.binary(0))?;
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
                    self.in_common_unit("if", &[(then.0.clone(), a), (otherwise.0.clone(), b)])?;
                }
                Ok(if *condition { then.1 } else { otherwise.1 })
            }
            _ => error("`if` wants a condition and two values: if(a < b, a, b)"),
        }
    }

    fn call(&mut self, name: &str) -> Result<Outcome, ExpressionError> {
        // The name of the function and its `(` are the previous two tokens.
        let start = self.next - 2;
        if name == "if" {
            return self.choice();
        }
        let arguments = self.arguments(|_| true)?;
        let function = Function::find(name);
        let unit = Unit::from_name(name);
        let (least, most) = match function {
            Some(function) => (function.min_arguments, function.max_arguments),
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
        let parts = arguments
            .into_iter()
            .map(|(at, argument): (Range<usize>, _)| Ok((at, number(argument, name)?)))
            .collect::<Result<Vec<Part>, _>>()?;
        let from: Vec<_> = parts.iter().map(|(_, argument)| argument.value).collect();
        let found = match function.map(|function| function.kind) {
            Some(FunctionKind::Alike(compute)) => {
                let (values, unit) = self.in_common_unit(name, &parts)?;
                Quantity { value: compute(&values), unit }
            }
            Some(FunctionKind::Angle(compute)) => {
                let (values, _) = self.in_common_unit(name, &parts)?;
                Quantity {
                    value: compute(&values),
                    unit: Unit::from_name("rad").unwrap_or_default(),
                }
            }
            Some(FunctionKind::Quantity(wanted, compute)) => {
                let quantities: Vec<_> = parts.iter().map(|(_, argument)| *argument).collect();
                compute(&quantities)
                    .map_err(|place| self.unit_error(name, wanted, &parts[place]))?
            }
            None => match unit {
                Some(unit) if parts[0].1.unit.is_pure() => Quantity { unit, ..parts[0].1 },
                _ => return Err(self.unit_error(name, "a pure number", &parts[0])),
            },
        };
        // Given a NaN, `f64::min` and `libm::pow` may return a number, but the result of a function of NaN must be NaN.
        let is_none = from.iter().any(|x| x.is_nan());
        let found = if is_none { Quantity { value: f64::NAN, ..found } } else { found };
        self.finite_outcome(found, name, start..self.next, &from)
    }

    /// Returns the error for an argument with a wrong unit.
    fn unit_error(&self, name: &str, wanted: &str, (at, argument): &Part) -> ExpressionError {
        let unit = match argument.unit {
            unit if unit.is_pure() => "a pure number".to_owned(),
            unit => format!("in {unit}"),
        };
        let message = format!("`{name}` wants {wanted}, but {} is {unit}", self.quoted_text(at));
        ExpressionError { message, at: Some(self.text_range(at)), ..ExpressionError::default() }
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
                _ => error(format!("`{operator}`: expected numbers, found conditions")),
            };
        }
        let (left, right) = (number(left, operator)?, number(right, operator)?);
        let both = left_at.start..right_at.end;
        let from = [left.value, right.value];
        match operator {
            "*" => return self.finite_outcome(left.times(right), operator, both, &from),
            "/" => return self.finite_outcome(left.divided_by(right), operator, both, &from),
            "and" | "or" => {
                return error(format!("`{operator}`: expected conditions, found numbers"));
            }
            _ => {}
        }
        let (values, unit) =
            self.in_common_unit(operator, &[(left_at, left), (right_at, right)])?;
        let (a, b) = (values[0], values[1]);
        let number =
            |value| self.finite_outcome(Quantity { value, unit }, operator, both.clone(), &from);
        Ok(match operator {
            "+" => number(a + b)?,
            "-" => number(a - b)?,
            "%" => number(a % b)?,
            "<" => Outcome::Truth(a < b),
            "<=" => Outcome::Truth(a <= b),
            ">" => Outcome::Truth(a > b),
            ">=" => Outcome::Truth(a >= b),
            "==" => Outcome::Truth(a == b),
            _ => Outcome::Truth(a != b && !a.is_nan() && !b.is_nan()),
        })
    }

    /// Converts the numbers to the unit of the first number that has a unit. Numbers without a unit take that unit.
    fn in_common_unit(
        &self,
        user: &str,
        parts: &[Part],
    ) -> Result<(Vec<f64>, Unit), ExpressionError> {
        let Some((first, Quantity { unit, .. })) = parts.iter().find(|(_, it)| !it.unit.is_pure())
        else {
            return Ok((parts.iter().map(|(_, it)| it.value).collect(), Unit::default()));
        };
        let values = parts.iter().map(|(at, it)| match it.unit {
            own if own.is_pure() => Ok(it.value),
            own if own.is_compatible(*unit) => Ok(it.to_unit(*unit)),
            own => Err(ExpressionError {
                message: format!(
                    "`{user}` wants one unit, but {} is in {unit} and {} in {own}",
                    self.quoted_text(first),
                    self.quoted_text(at)
                ),
                at: Some(self.text_range(at)),
                note: Some(Box::new((self.text_range(first), format!("this is in {unit}")))),
                help: "use values of the same kind".into(),
                ..ExpressionError::default()
            }),
        });
        Ok((values.collect::<Result<_, _>>()?, *unit))
    }

    /// Returns the range in the text that a range of tokens covers.
    fn text_range(&self, tokens: &Range<usize>) -> Range<usize> {
        self.tokens[tokens.start].0.start..self.tokens[tokens.end - 1].0.end
    }

    fn quoted_text(&self, tokens: &Range<usize>) -> String {
        format!("`{}`", truncate(&self.text[self.text_range(tokens)]))
    }
}

fn number(outcome: Outcome, user: &str) -> Result<Quantity, ExpressionError> {
    match outcome {
        Outcome::Number(x) => Ok(x),
        Outcome::Truth(_) => error(format!("`{user}`: expected a number, found a condition")),
    }
}

#[cfg(test)]
mod tests;
