//! Arithmetic on a graph's parameters: `Expr("growth / 2 + 1")`.
//!
//! Numbers and truth values; `+ - * / %`, comparisons, `and or not`; the functions in [`FUNCTIONS`] and `if(condition, then,
//! else)`. No loops, no I/O. A parameter's name may hold hyphens: `eye-step` is the parameter of that name if there is one,
//! and otherwise a difference.

use std::collections::BTreeMap;
use std::fmt;
use std::ops::Range;

use crate::text::nearest;

/// What an expression gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Outcome {
    Number(f64),
    Truth(bool),
}

/// Why an expression cannot be computed, and what may have been meant.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ExpressionError {
    pub(crate) message: String,
    help: String,
    /// The parameter that is not there, if that is why.
    unknown: Option<String>,
}

impl ExpressionError {
    /// What may have been meant.
    pub(crate) fn help(&self, parameters: &BTreeMap<String, Outcome>) -> String {
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
    Err(ExpressionError { message: message.into(), help: String::new(), unknown: None })
}

/// Functions by name: least number of arguments, most, and what they compute.
pub(super) type Function = (&'static str, usize, usize, fn(&[f64]) -> f64);
pub(super) const FUNCTIONS: [Function; 7] = [
    ("min", 1, 99, |x| x.iter().copied().fold(f64::INFINITY, f64::min)),
    ("max", 1, 99, |x| x.iter().copied().fold(f64::NEG_INFINITY, f64::max)),
    ("clamp", 3, 3, |x| x[0].max(x[1]).min(x[2])),
    ("abs", 1, 1, |x| x[0].abs()),
    ("sqrt", 1, 1, |x| x[0].sqrt()),
    ("floor", 1, 1, |x| x[0].floor()),
    ("round", 1, 1, |x| x[0].round()),
];

/// Deepest nesting of an expression: far more than anyone writes, far less than the stack holds.
const DEEPEST: usize = 64;

/// Computes `text` with these values for parameters.
///
/// # Errors
/// If it is no expression, names an unknown parameter, mixes numbers and truth values, or has no finite value.
pub(crate) fn evaluate(
    text: &str,
    parameters: &BTreeMap<String, Outcome>,
) -> Result<Outcome, ExpressionError> {
    let tokens = tokenize(text, parameters)?;
    let mut parser = Parser { tokens: &tokens, next: 0, parameters, depth: 0 };
    let outcome = parser.binary(0)?;
    if let Some(token) = parser.peek() {
        return error(format!("the expression has `{token}` where it should end"));
    }
    match outcome {
        Outcome::Number(x) if !x.is_finite() => {
            error(format!("the expression gives {x}, which is not a finite number"))
        }
        outcome => Ok(outcome),
    }
}

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

fn tokenize(
    text: &str,
    parameters: &BTreeMap<String, Outcome>,
) -> Result<Vec<Token>, ExpressionError> {
    let tokens = pieces(text, &|name| parameters.contains_key(name))?;
    Ok(tokens.into_iter().map(|(_, token)| token).collect())
}

/// Where an expression names parameters: places in its text. None if it is no expression.
pub(crate) fn named_parameters(
    text: &str,
    is_known: &dyn Fn(&str) -> bool,
) -> Option<Vec<Range<usize>>> {
    let tokens = pieces(text, is_known).ok()?;
    let mut names = Vec::new();
    // Whether a value has just ended, so that a word is an operator.
    let mut is_behind = false;
    for (index, (at, token)) in tokens.iter().enumerate() {
        let opens = matches!(tokens.get(index + 1), Some((_, Token::Sign("("))));
        let is_name = matches!(token, Token::Name(name) if name != "not" && !is_behind && !opens);
        if is_name {
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

/// The longest known parameter at the start of the text; if there is none, the word up to the first hyphen.
fn name_at<'a>(text: &'a str, is_known: &dyn Fn(&str) -> bool) -> &'a str {
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    let whole = &text[..text.find(|c| !is_part(c)).unwrap_or(text.len())];
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
    tokens: &'a [Token],
    next: usize,
    parameters: &'a BTreeMap<String, Outcome>,
    depth: usize,
}

impl Parser<'_> {
    fn peek(&self) -> Option<&Token> {
        self.tokens.get(self.next)
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
        let mut left = self.binary(level + 1)?;
        while let Some(operator) = self.operator(operators) {
            let right = self.binary(level + 1)?;
            left = combine(operator, left, right)?;
        }
        Ok(left)
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
                Ok(Outcome::Number(if sign == "-" { -x } else { x }))
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
            Some(Token::Number(x)) => Ok(Outcome::Number(x)),
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
            (None, _) => Err(ExpressionError {
                message: format!("the graph has no parameter `{name}`"),
                help: String::new(),
                unknown: Some(name.to_owned()),
            }),
        }
    }

    fn call(&mut self, name: &str) -> Result<Outcome, ExpressionError> {
        let mut arguments = Vec::new();
        while self.operator(&[")"]).is_none() {
            if !arguments.is_empty() {
                self.expect(",")?;
            }
            arguments.push(self.binary(0)?);
        }
        if name == "if" {
            return match arguments[..] {
                [Outcome::Truth(condition), then, otherwise] => {
                    Ok(if condition { then } else { otherwise })
                }
                _ => error("`if` wants a condition and two values: if(a < b, a, b)"),
            };
        }
        let Some((_, least, most, compute)) = FUNCTIONS.iter().find(|f| f.0 == name) else {
            return Err(ExpressionError {
                message: format!("there is no function `{name}`"),
                help: nearest(name, FUNCTIONS.iter().map(|f| f.0).chain(["if"])),
                unknown: None,
            });
        };
        if !(*least..=*most).contains(&arguments.len()) {
            return error(format!("`{name}` does not take {} arguments", arguments.len()));
        }
        let numbers: Result<Vec<f64>, _> =
            arguments.into_iter().map(|argument| number(argument, name)).collect();
        Ok(Outcome::Number(compute(&numbers?)))
    }
}

fn number(outcome: Outcome, user: &str) -> Result<f64, ExpressionError> {
    match outcome {
        Outcome::Number(x) => Ok(x),
        Outcome::Truth(_) => error(format!("`{user}` wants a number, not a condition")),
    }
}

fn combine(operator: &str, left: Outcome, right: Outcome) -> Result<Outcome, ExpressionError> {
    if let (Outcome::Truth(a), Outcome::Truth(b)) = (left, right) {
        return match operator {
            "and" => Ok(Outcome::Truth(a && b)),
            "or" => Ok(Outcome::Truth(a || b)),
            "==" => Ok(Outcome::Truth(a == b)),
            "!=" => Ok(Outcome::Truth(a != b)),
            _ => error(format!("`{operator}` wants numbers, not conditions")),
        };
    }
    let (a, b) = (number(left, operator)?, number(right, operator)?);
    Ok(match operator {
        "+" => Outcome::Number(a + b),
        "-" => Outcome::Number(a - b),
        "*" => Outcome::Number(a * b),
        "/" => Outcome::Number(a / b),
        "%" => Outcome::Number(a % b),
        "<" => Outcome::Truth(a < b),
        "<=" => Outcome::Truth(a <= b),
        ">" => Outcome::Truth(a > b),
        ">=" => Outcome::Truth(a >= b),
        "==" => Outcome::Truth(a == b),
        "!=" => Outcome::Truth(a != b),
        _ => return error(format!("`{operator}` wants conditions, not numbers")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(text: &str) -> Result<Outcome, String> {
        let parameters = BTreeMap::from([
            ("growth".to_owned(), Outcome::Number(12.0)),
            ("eye-step".to_owned(), Outcome::Number(3.0)),
            ("eye".to_owned(), Outcome::Number(5.0)),
            ("flat".to_owned(), Outcome::Truth(true)),
        ]);
        evaluate(text, &parameters).map_err(|error| format!("{error}; {}", error.help(&parameters)))
    }

    fn check(text: &str, expected: f64) {
        assert_eq!(value(text), Ok(Outcome::Number(expected)), "{text}");
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
    fn mistakes_are_explained() {
        let wrong = |text: &str| value(text).unwrap_err();
        assert_eq!(wrong("growth * "), "the expression ends where a number or a name should be; ");
        assert_eq!(wrong("grwth"), "the graph has no parameter `grwth`; did you mean `growth`?");
        assert_eq!(wrong("flor(1)"), "there is no function `flor`; did you mean `floor`?");
        assert_eq!(wrong("1 / 0"), "the expression gives inf, which is not a finite number; ");
        assert_eq!(wrong("1 + flat"), "`+` wants a number, not a condition; ");
        assert_eq!(wrong("(1"), "the expression ends where `)` should be; ");
        assert_eq!(wrong("1 2"), "the expression has `2` where it should end; ");
        assert_eq!(wrong("1 $ 2"), "`$` has no meaning in an expression; ");
        assert!(wrong(&"(".repeat(9999)).contains("nested too deeply"));
    }
}
