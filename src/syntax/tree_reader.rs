//! Reads the values of a graph file from the parser's syntax tree: calls, lists and maps, and the literals in them.

use ronin_core::{SyntaxElement, SyntaxKind, SyntaxNode, SyntaxToken};

use super::file::{Mistake, NO_END, span};
use super::tree::{Body, Field, Kind, Name, Tree};
use crate::error::Span;

/// Whether a syntax node is a value, or what stands where one should.
pub(crate) fn is_value(kind: SyntaxKind) -> bool {
    use SyntaxKind::{EnumVariant, Error, List, Literal, Map, Struct, Tuple, Unit};
    matches!(kind, Struct | Tuple | List | Map | EnumVariant | Unit | Literal | Error)
}

/// Makes values of syntax nodes, and notes what is wrong with them.
#[derive(Default)]
pub(crate) struct TreeReader {
    pub(crate) mistakes: Vec<Mistake>,
    /// What stands where nothing like it can stand. Behind a forgotten comma or parenthesis that is much, and says nothing more.
    pub(crate) misplaced: Vec<Mistake>,
    /// Whether what is read stands in a `Sweep(..)`.
    in_sweep: bool,
}

impl TreeReader {
    pub(crate) fn value(&mut self, node: &SyntaxNode) -> Tree {
        let at = span(node.text_range());
        let kind = match node.kind() {
            SyntaxKind::Struct => {
                for value in node.children().filter(|child| is_value(child.kind())) {
                    self.mixed(&value);
                }
                let fields =
                    node.children().filter(|child| child.kind() == SyntaxKind::StructField);
                let name = word(node);
                self.in_sweep |= name.as_ref().is_some_and(|name| name.text == "Sweep");
                let unnamed = self.unnamed(name.as_ref());
                let fields = fields
                    .enumerate()
                    .filter_map(|(nth, field): (usize, SyntaxNode)| match unnamed {
                        Some(name) if nth == 0 => {
                            self.text_first(name, &field).or_else(|| self.field(&field))
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
                    self.mixed(&field);
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
                _ => self.mistake(at, "names are followed by `(`, not by `{`", "write `Name(..)`"),
            },
            SyntaxKind::Literal => match first_token(node) {
                Some(token) => self.literal(&token),
                None => Kind::Broken,
            },
            _ => Kind::Broken,
        };
        let kind = match own_word(&kind) {
            Some((message, help)) => self.mistake(at, message, help),
            None => kind,
        };
        Tree::new(at, kind)
    }

    /// A value without a name among fields with names, or the other way round.
    fn mixed(&mut self, node: &SyntaxNode) {
        let message = "values with a name and values without one cannot stand together";
        let help = "give each a name, `name: value`, or none of them";
        self.misplaced.push(mistake(span(node.text_range()), message, help));
    }

    fn values(&mut self, node: &SyntaxNode) -> Vec<Tree> {
        node.children()
            .filter(|child| is_value(child.kind()))
            .map(|child| self.value(&child))
            .collect()
    }

    fn field(&mut self, node: &SyntaxNode) -> Option<Field> {
        fn own(wanted: SyntaxKind, node: &SyntaxNode) -> bool {
            let mut tokens = node.children_with_tokens();
            tokens.any(|part| matches!(part, SyntaxElement::Token(token) if token.kind() == wanted))
        }
        let value = node.children().find(|child| is_value(child.kind()));
        let is_named =
            own(SyntaxKind::Ident, node) && (own(SyntaxKind::Colon, node) || value.is_none());
        let Some(name) = word(node).filter(|_| is_named) else {
            self.mixed(node);
            return None;
        };
        let value = match value {
            Some(value) => self.value(&value),
            None => {
                let message = format!("field `{}` has no value", name.text);
                let kind = self.mistake(name.span, &message, "write a value behind the colon");
                Tree::new(name.span, kind)
            }
        };
        Some(Field { name, value })
    }

    /// The field that needs no name if it comes first: the path of `Graph("lib/skirt.ron", version: "2.1")`, and in a sweep what
    /// `Files("scans/*", set: "scan.range")` and `picture: ("model.glb", camera: (30, 15))` begin with.
    fn unnamed(&self, call: Option<&Name>) -> Option<&'static str> {
        match call.map(|name| &name.text[..]) {
            Some("Graph") => Some("path"),
            Some("Files") if self.in_sweep => Some("pattern"),
            None if self.in_sweep => Some("output"),
            _ => None,
        }
    }

    /// A text without a name, as this field.
    fn text_first(&mut self, name: &str, node: &SyntaxNode) -> Option<Field> {
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
            self.misplaced.push(mistake(key.span, message, "write `key: value`"));
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
                Some(_) => self.mistake(at, &format!("`{text}` is too large for a number"), ""),
                None => self.mistake(at, &format!("`{text}` is not a number"), ""),
            },
            SyntaxKind::String => match unescape(text) {
                Some(text) => Kind::Text(text),
                None => self.mistake(at, NO_END, r#"known escapes: \" \\ \n \r \t \0 \u{..}"#),
            },
            SyntaxKind::RawString => match raw(text) {
                Some(text) => Kind::Text(text.to_owned()),
                None => self.mistake(at, "this text has no end", "it ends as it begins: `\"#`"),
            },
            _ => self.mistake(at, &format!("`{text}` is no value of a graph"), ""),
        }
    }

    pub(crate) fn mistake(&mut self, span: Span, message: &str, help: &str) -> Kind {
        self.mistakes.push(mistake(span, message, help));
        Kind::Broken
    }
}

fn mistake(span: Span, message: &str, help: &str) -> Mistake {
    Mistake { span, message: message.into(), help: help.into() }
}

/// What is wrong with one of RON's own words: `Some` holds one value, the others none.
fn own_word(kind: &Kind) -> Option<(&'static str, &'static str)> {
    const ALONE: [&str; 7] = ["None", "NaN", "NaNf32", "NaNf64", "inf", "inff32", "inff64"];
    match kind {
        Kind::Call { name: Some(name), .. } if ALONE.contains(&&name.text[..]) => {
            Some(("nothing can stand behind this word", "leave the parentheses out"))
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

/// The identifier that stands directly in a node: a struct's, field's or variant's name.
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

/// What stands in `r"..."` or `r#"..."#`, with as many signs as it begins with.
fn raw(text: &str) -> Option<&str> {
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
                // A number may have a sign, a code not.
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
    use super::super::file::parse;
    use super::*;

    fn kind(text: &str) -> Kind {
        let (tree, mistakes) = parse(text);
        assert!(mistakes.is_empty(), "{mistakes:?}");
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
    fn the_path_of_a_use_needs_no_name() {
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
    fn numbers_that_are_not_finite_are_mistakes() {
        assert_eq!(parse("1e999").1[0].message, "`1e999` is too large for a number");
        // RON's own words for them are bare words here, and no port or parameter takes them.
        assert_eq!(kind("NaN"), Kind::Word("NaN".into()));
    }
}
