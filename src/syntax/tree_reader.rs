//! Converts the syntax tree of the parser library to a [`Tree`]: calls, lists, maps and literals.

use ronin_core::{SyntaxElement, SyntaxKind, SyntaxNode, SyntaxToken};

use super::parser::{SyntaxError, UNTERMINATED_STRING, span};
use super::tree::{Body, Field, Kind, Name, Tree};
use crate::error::Span;

/// Returns true if a syntax node is a value, or an error where a value is expected.
pub(crate) fn is_value(kind: SyntaxKind) -> bool {
    use SyntaxKind::{EnumVariant, Error, List, Literal, Map, Struct, Tuple, Unit};
    matches!(kind, Struct | Tuple | List | Map | EnumVariant | Unit | Literal | Error)
}

/// Converts syntax nodes to values, and collects the errors in them.
#[derive(Default)]
pub(crate) struct TreeReader {
    pub(crate) errors: Vec<SyntaxError>,
    /// Errors about misplaced values. One missing comma or parenthesis causes many of them, so they are ignored if there are other errors.
    pub(crate) misplaced: Vec<SyntaxError>,
    /// True while the inside of a `Sweep(..)` is read.
    in_sweep: bool,
}

impl TreeReader {
    pub(crate) fn value(&mut self, node: &SyntaxNode) -> Tree {
        let at = span(node.text_range());
        let kind = match node.kind() {
            SyntaxKind::Struct => {
                for value in node.children().filter(|child| is_value(child.kind())) {
                    self.report_mixed_names(&value);
                }
                let fields =
                    node.children().filter(|child| child.kind() == SyntaxKind::StructField);
                let name = word(node);
                self.in_sweep |= name.as_ref().is_some_and(|name| name.text == "Sweep");
                let implicit_field = self.implicit_field(name.as_ref());
                let fields = fields
                    .enumerate()
                    .filter_map(|(nth, field): (usize, SyntaxNode)| match implicit_field {
                        Some(name) if nth == 0 => {
                            self.read_implicit_text(name, &field).or_else(|| self.field(&field))
                        }
                        _ => self.field(&field),
                    })
                    .collect();
                Kind::Call { name, body: Body::Fields(fields) }
            }
            SyntaxKind::Tuple => {
                if let Some(field) =
                    node.children().find(|child| child.kind() == SyntaxKind::StructField)
                {
                    self.report_mixed_names(&field);
                }
                Kind::Call { name: word(node), body: Body::Items(self.values(node)) }
            }
            SyntaxKind::Unit => Kind::Call { name: word(node), body: Body::Empty },
            SyntaxKind::List => Kind::List(self.values(node)),
            SyntaxKind::Map => {
                let entries = node.children().filter(|child| child.kind() == SyntaxKind::MapEntry);
                Kind::Map(entries.filter_map(|entry| self.entry(&entry)).collect())
            }
            SyntaxKind::EnumVariant => match word(node) {
                Some(name) if name.span == at => Kind::Word(name.text),
                _ => self.report(at, "expected `(` after a name, found `{`", "write `Name(..)`"),
            },
            SyntaxKind::Literal => match first_token(node) {
                Some(token) => self.literal(&token),
                None => Kind::Broken,
            },
            _ => Kind::Broken,
        };
        let kind = match keyword_misuse(&kind) {
            Some((message, help)) => self.report(at, message, help),
            None => kind,
        };
        Tree::new(at, kind)
    }

    /// Reports parentheses that contain both values with names and values without names.
    fn report_mixed_names(&mut self, node: &SyntaxNode) {
        let message = "named and unnamed values cannot be mixed";
        let help = "name all of them, `name: value`, or none";
        self.misplaced.push(syntax_error(span(node.text_range()), message, help));
    }

    fn values(&mut self, node: &SyntaxNode) -> Vec<Tree> {
        node.children()
            .filter(|child| is_value(child.kind()))
            .map(|child| self.value(&child))
            .collect()
    }

    fn field(&mut self, node: &SyntaxNode) -> Option<Field> {
        fn has_token(wanted: SyntaxKind, node: &SyntaxNode) -> bool {
            let mut tokens = node.children_with_tokens();
            tokens.any(|part| matches!(part, SyntaxElement::Token(token) if token.kind() == wanted))
        }
        let value = node.children().find(|child| is_value(child.kind()));
        let is_named = has_token(SyntaxKind::Ident, node)
            && (has_token(SyntaxKind::Colon, node) || value.is_none());
        let Some(name) = word(node).filter(|_| is_named) else {
            self.report_mixed_names(node);
            return None;
        };
        let value = match value {
            Some(value) => self.value(&value),
            None => {
                let message = format!("field `{}` has no value", name.text);
                let kind = self.report(name.span, &message, "add a value after the colon");
                Tree::new(name.span, kind)
            }
        };
        Some(Field { name, value })
    }

    /// Returns the name of the field whose name may be omitted if it comes first. For `Graph("lib/skirt.ron", version: "2.1")` it is the
    /// path. In a sweep, these are the first items of `Files("scans/*", set: "scan.range")` and `picture: ("model.glb", camera: (30, 15))`.
    fn implicit_field(&self, call: Option<&Name>) -> Option<&'static str> {
        match call.map(|name| &name.text[..]) {
            Some("Graph") => Some("path"),
            Some("Files") if self.in_sweep => Some("pattern"),
            None if self.in_sweep => Some("output"),
            _ => None,
        }
    }

    /// Reads a string as the value of the field `name`, which the file omits.
    fn read_implicit_text(&mut self, name: &str, node: &SyntaxNode) -> Option<Field> {
        let value = node.children().find(|child| child.kind() == SyntaxKind::Literal)?;
        let text = first_token(&value)?;
        let is_text = matches!(text.kind(), SyntaxKind::String | SyntaxKind::RawString);
        if word(node).is_some() || !is_text {
            return None;
        }
        let value = self.value(&value);
        let start = value.span.start;
        Some(Field { name: Name { text: name.into(), span: Span { start, end: start } }, value })
    }

    fn entry(&mut self, node: &SyntaxNode) -> Option<(Tree, Tree)> {
        let mut values = self.values(node).into_iter();
        let (key, value) = (values.next()?, values.next());
        if value.is_none() {
            let message = "this key of a map has no value";
            self.misplaced.push(syntax_error(key.span, message, "write `key: value`"));
        }
        Some((key, value?))
    }

    fn literal(&mut self, token: &SyntaxToken) -> Kind {
        let (at, text) = (span(token.text_range()), token.text());
        match token.kind() {
            SyntaxKind::TrueKw => Kind::Bool(true),
            SyntaxKind::FalseKw => Kind::Bool(false),
            SyntaxKind::Integer | SyntaxKind::Float => match number(text) {
                Some(value) if value.is_finite() => {
                    Kind::Number { value, whole: token.kind() == SyntaxKind::Integer }
                }
                Some(_) => self.report(at, &format!("`{text}` is too large for a number"), ""),
                None => self.report(at, &format!("`{text}` is not a number"), ""),
            },
            SyntaxKind::String => match unescape(text) {
                Some(text) => Kind::Text(text),
                None => self.report(
                    at,
                    UNTERMINATED_STRING,
                    r#"known escapes: \" \\ \n \r \t \0 \u{..}"#,
                ),
            },
            SyntaxKind::RawString => match raw_string_content(text) {
                Some(text) => Kind::Text(text.to_owned()),
                None => self.report(at, "unterminated raw text", "add the missing `\"#`"),
            },
            _ => self.report(at, &format!("`{text}` is not a valid value"), ""),
        }
    }

    pub(crate) fn report(&mut self, span: Span, message: &str, help: &str) -> Kind {
        self.errors.push(syntax_error(span, message, help));
        Kind::Broken
    }
}

fn syntax_error(span: Span, message: &str, help: &str) -> SyntaxError {
    SyntaxError { span, message: message.into(), help: help.into() }
}

/// Returns the message and the help for a misused keyword of RON. `Some` must contain one value, and the other keywords must stand alone.
fn keyword_misuse(kind: &Kind) -> Option<(&'static str, &'static str)> {
    const ALONE: [&str; 7] = ["None", "NaN", "NaNf32", "NaNf64", "inf", "inff32", "inff64"];
    match kind {
        Kind::Call { name: Some(name), .. } if ALONE.contains(&&name.text[..]) => {
            Some(("unexpected parentheses after this word", "remove the parentheses"))
        }
        Kind::Call { name: Some(name), body } if name.text == "Some" => match body {
            Body::Items(items) if items.len() == 1 => None,
            _ => Some(("`Some` holds one value", "write `Some(value)`")),
        },
        Kind::Word(word) if word == "Some" => {
            Some(("`Some` holds one value", "write `Some(value)`"))
        }
        _ => None,
    }
}

/// Returns the identifier directly inside of a syntax node: the name of a struct, field or variant.
fn word(node: &SyntaxNode) -> Option<Name> {
    let token = node.first_token_of(SyntaxKind::Ident)?;
    Some(Name { text: token.text().to_string(), span: span(token.text_range()) })
}

fn first_token(node: &SyntaxNode) -> Option<SyntaxToken> {
    node.children_with_tokens().find_map(|element| match element {
        SyntaxElement::Token(token) if !token.is_trivia() => Some(token),
        _ => None,
    })
}

fn number(text: &str) -> Option<f64> {
    if ["0x_", "0b_", "0o_"].iter().any(|start| text.contains(start)) {
        return None;
    }
    let digits = text.replace('_', "");
    let (negative, magnitude) = match digits.strip_prefix(['-', '+']) {
        Some(rest) => (digits.starts_with('-'), rest),
        None => (false, &digits[..]),
    };
    let based = [("0x", 16), ("0b", 2), ("0o", 8)].into_iter().find_map(|(prefix, base)| {
        let digits = magnitude.strip_prefix(prefix)?;
        u64::from_str_radix(digits, base).ok().map(|value| value as f64)
    });
    let value = match based {
        Some(value) => value,
        None if magnitude.starts_with(|c: char| c.is_ascii_digit() || c == '.') => {
            magnitude.parse().ok()?
        }
        None => return None,
    };
    Some(if negative { -value } else { value })
}

/// Returns the content of a raw string `r"..."` or `r#"..."#`. The number of `#` signs must be equal on both sides.
fn raw_string_content(text: &str) -> Option<&str> {
    let marked = text.strip_prefix('r')?;
    let marks = marked.len() - marked.trim_start_matches('#').len();
    let (begin, end) = (&marked[..marks], marked.len().checked_sub(marks)?);
    let quoted = marked.get(marks..end).filter(|_| marked.get(end..) == Some(begin))?;
    quoted.strip_prefix('"')?.strip_suffix('"')
}

fn unescape(quoted: &str) -> Option<String> {
    let inner = quoted.strip_prefix('"')?.strip_suffix('"')?;
    let mut text = String::with_capacity(inner.len());
    let mut rest = inner.chars();
    while let Some(c) = rest.next() {
        if c != '\\' {
            text.push(c);
            continue;
        }
        text.push(match rest.next()? {
            'n' => '\n',
            'r' => '\r',
            't' => '\t',
            '0' => '\0',
            'u' => {
                let code = rest.as_str().strip_prefix('{')?.split_once('}')?;
                rest = code.1.chars();
                // `from_str_radix` would accept a sign, which RON does not allow here.
                code.0.starts_with(|digit: char| digit.is_ascii_hexdigit()).then_some(())?;
                char::from_u32(u32::from_str_radix(code.0, 16).ok()?)?
            }
            c @ ('"' | '\\' | '\'') => c,
            _ => return None,
        });
    }
    Some(text)
}

#[cfg(test)]
mod tests {
    use super::super::parser::parse;
    use super::*;

    fn kind(text: &str) -> Kind {
        let (tree, errors) = parse(text);
        assert!(errors.is_empty(), "{errors:?}");
        tree.kind
    }

    #[test]
    fn numbers_texts_and_words_are_read() {
        assert_eq!(kind("-12"), Kind::Number { value: -12.0, whole: true });
        assert_eq!(kind("1_000.5e1"), Kind::Number { value: 10_005.0, whole: false });
        assert_eq!(kind("0x1F"), Kind::Number { value: 31.0, whole: true });
        assert_eq!(kind(r#""a\"\u{e4}\n""#), Kind::Text("a\"ä\n".into()));
        assert_eq!(kind(r##"r#"a"b"#"##), Kind::Text("a\"b".into()));
        assert_eq!(kind("Largest"), Kind::Word("Largest".into()));
        assert_eq!(kind("true"), Kind::Bool(true));
    }

    #[test]
    fn the_path_of_a_use_may_be_unnamed() {
        fn fields(text: &str) -> Vec<(String, Kind)> {
            match kind(text) {
                Kind::Call { body: Body::Fields(fields), .. } => fields
                    .into_iter()
                    .map(|field: Field| (field.name.text, field.value.kind))
                    .collect::<Vec<_>>(),
                other => panic!("{other:?}"),
            }
        }
        let short = fields("Graph(\"a.ron\", version: \"2.1\")");
        assert_eq!(short, fields("Graph(path: \"a.ron\", version: \"2.1\")"));
        for wrong in ["Near(\"a\", b: 1)", "Graph(1, b: 1)", "Graph(b: 1, \"a\")"] {
            assert!(!parse(wrong).1.is_empty(), "{wrong}");
        }
    }

    #[test]
    fn numbers_that_are_not_finite_are_errors() {
        assert_eq!(parse("1e999").1[0].message, "`1e999` is too large for a number");
        // RON has words for infinity and NaN. In graph files they are bare words, which no port or parameter accepts.
        assert_eq!(kind("NaN"), Kind::Word("NaN".into()));
    }
}
