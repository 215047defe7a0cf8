//! The text of a graph file as a tree of values with their places.
//!
//! `ronin-core` parses it without losing a byte and recovers from mistakes; this module and [`TreeReader`] alone know it. What
//! comes out is [`Tree`], small enough to be substituted into, checked against a schema and read by serde.

use std::sync::Arc;

use ronin_core::{SyntaxKind, SyntaxNode, SyntaxToken, TextRange};

use super::sheet::Sheet;
use super::tree_reader::{TreeReader, is_value};
use crate::error::{Place, Span};

/// One value of the file, and where it stands.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Tree {
    pub(crate) span: Span,
    pub(crate) kind: Kind,
    /// Where a value that stands in for a `Param` comes from.
    pub(crate) origin: Option<Origin>,
}

/// Where a parameter's value comes from.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Origin {
    /// The default in the file.
    Default(Span),
    /// `--set` with this text.
    Set(String),
    /// Another file than the one that it is used in.
    Given(Given),
}

/// A value that comes from another file: through a use of a graph, or by a patch.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Given {
    pub(crate) sheet: Arc<Sheet>,
    /// Where it stands there.
    pub(crate) span: Span,
    /// With which `--set` it was given there, if it was.
    pub(crate) set: Option<String>,
}

impl Given {
    /// In words: `graphs/face.ron:9:30`.
    pub(crate) fn place(&self) -> String {
        match &self.set {
            Some(set) => format!("`--set {set}`"),
            None => self.sheet.place_in_words(self.span),
        }
    }
}

/// What kind of value it is.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Kind {
    /// A finite number, and whether it was written as a whole one.
    Number { value: f64, whole: bool },
    /// `true` or `false`.
    Bool(bool),
    /// A string without its quotes and escapes.
    Text(String),
    /// A bare word.
    Word(String),
    /// `Name(..)` or `(..)`.
    Call { name: Option<Name>, body: Body },
    /// `[..]`.
    List(Vec<Tree>),
    /// `{..}`: keys and values.
    Map(Vec<(Tree, Tree)>),
    /// Something that has been reported already.
    Broken,
}

/// What stands between parentheses.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Body {
    Empty,
    Fields(Vec<Field>),
    Items(Vec<Tree>),
}

/// A word with its place.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Name {
    pub(crate) text: String,
    pub(crate) span: Span,
}

/// `name: value`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Field {
    pub(crate) name: Name,
    pub(crate) value: Tree,
}

/// A mistake in the text itself: where, what, and what to do.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Mistake {
    pub(crate) span: Span,
    pub(crate) message: String,
    pub(crate) help: String,
}

impl Tree {
    pub(crate) fn new(span: Span, kind: Kind) -> Self {
        Self { span, kind, origin: None }
    }

    pub(crate) fn is_broken(&self) -> bool {
        self.kind == Kind::Broken
    }

    /// Whether nothing in it is broken.
    pub(crate) fn is_whole(&self) -> bool {
        match &self.kind {
            Kind::Broken => false,
            Kind::Call { body: Body::Fields(fields), .. } => {
                fields.iter().all(|field| field.value.is_whole())
            }
            Kind::Call { body: Body::Items(items), .. } | Kind::List(items) => {
                items.iter().all(Self::is_whole)
            }
            Kind::Map(entries) => entries.iter().all(|(_, value)| value.is_whole()),
            _ => true,
        }
    }

    pub(crate) fn text(&self) -> Option<&str> {
        match &self.kind {
            Kind::Text(text) => Some(text),
            _ => None,
        }
    }

    /// The name before the parentheses, or the bare word.
    pub(crate) fn name(&self) -> Option<Name> {
        match &self.kind {
            Kind::Call { name, .. } => name.clone(),
            Kind::Word(text) => Some(Name { text: text.clone(), span: self.span }),
            _ => None,
        }
    }

    /// The fields between the parentheses; none if there are no parentheses, or items in them.
    pub(crate) fn fields(&self) -> Option<&[Field]> {
        match &self.kind {
            Kind::Call { body: Body::Fields(fields), .. } => Some(fields),
            Kind::Call { body: Body::Empty, .. } => Some(&[]),
            _ => None,
        }
    }

    /// The only item between the parentheses of `name(..)`.
    pub(crate) fn call_of(&self, wanted: &str) -> Option<&Self> {
        match &self.kind {
            Kind::Call { name: Some(name), body: Body::Items(items) } if name.text == wanted => {
                match &items[..] {
                    [item] => Some(item),
                    _ => None,
                }
            }
            _ => None,
        }
    }

    /// What stands at the end of this way through fields, items and entries, or as far along it as the file goes. The name of a
    /// choice, `Near` of `Near(..)`, is a step of the way.
    pub(crate) fn at(&self, path: &[String]) -> &Self {
        let Some((step, rest)) = path.split_first() else { return self };
        let item =
            |items: &'_ [Self]| step.parse().ok().filter(|&index: &usize| index < items.len());
        let inside = match &self.kind {
            Kind::Call { name: Some(name), .. } if name.text == *step => {
                return self.at_inside(rest);
            }
            Kind::List(items) => item(items).map(|index| &items[index]),
            Kind::Map(entries) => {
                let entry = entries.iter().find(|(key, _)| key.text() == Some(step));
                entry.map(|(_, value)| value)
            }
            _ => return self.at_inside(path),
        };
        inside.map_or(self, |inside| inside.at(rest))
    }

    /// The same, without the name before the parentheses.
    fn at_inside(&self, path: &[String]) -> &Self {
        let Some((step, rest)) = path.split_first() else { return self };
        let inside = match &self.kind {
            Kind::Call { body: Body::Fields(fields), .. } => {
                let field = fields.iter().find(|field| field.name.text == *step);
                field.map(|field| (&field.value, rest))
            }
            // `Near(..)` with one item has the path of the item itself.
            Kind::Call { body: Body::Items(items), .. } => match step.parse::<usize>() {
                Ok(index) => items.get(index).map(|item| (item, rest)),
                Err(_) => items.first().map(|item| (item, path)),
            },
            _ => None,
        };
        inside.map_or(self, |(inside, rest)| inside.at(rest))
    }

    /// What kind of value it is, in words, with its text where that is short.
    pub(crate) fn in_words(&self) -> String {
        match &self.kind {
            Kind::Number { value, .. } => format!("the number {value}"),
            Kind::Bool(value) => value.to_string(),
            Kind::Text(text) => format!("the text \"{text}\""),
            Kind::Word(word) => format!("`{word}`"),
            Kind::Call { name: Some(name), .. } => format!("`{}(..)`", name.text),
            Kind::Call { body: Body::Fields(_), .. } => "a group of fields".into(),
            Kind::Call { .. } => "a tuple".into(),
            Kind::List(_) => "a list".into(),
            Kind::Map(_) => "a map".into(),
            Kind::Broken => "something unreadable".into(),
        }
    }
}

/// The value of a whole text, as far as it can be read, and the mistakes in it.
pub(crate) fn parse(text: &str) -> (Tree, Vec<Mistake>) {
    let document = ronin_core::parse(text);
    let mut mistakes: Vec<Mistake> = document
        .diagnostics()
        .iter()
        .map(|found| explain(text, span(found.range), &found.message))
        .collect();
    if let Some(deep) = mistakes.iter().position(|mistake| mistake.message.contains("nesting")) {
        let place = Span { end: mistakes[deep].span.start + 1, ..mistakes[deep].span };
        let message = "values are nested more than 128 deep here".to_owned();
        return (
            Tree::new(Span::default(), Kind::Broken),
            vec![Mistake { span: place, message, help: "no node needs that".into() }],
        );
    }
    if let Some(unclosed) = unclosed(text, &document.root()) {
        // Whatever the parser finds behind it follows from it.
        mistakes.retain(|mistake| mistake.span.end <= unclosed.span.start);
        mistakes.push(unclosed);
    }
    if mistakes.is_empty() {
        mistakes.extend(wrong_separators(&document.root()));
    }
    let mut reader = TreeReader::default();
    for node in document.root().children() {
        if node.kind() == SyntaxKind::ExtensionAttr && !node.text().starts_with("#![") {
            let message = "`#` begins no value";
            reader.mistake(span(node.text_range()), message, "colors are texts: \"#c33923\"");
        }
    }
    let value = document.root().children().find(|node| is_value(node.kind()));
    let tree = match value {
        Some(node) => reader.value(&node),
        None => {
            if mistakes.is_empty() {
                mistakes.push(Mistake {
                    span: Span { start: 0, end: text.len().min(1) },
                    message: "the file is empty".into(),
                    help: "a graph begins with `Graph(format: 1, ..)`".into(),
                });
            }
            Tree::new(Span::default(), Kind::Broken)
        }
    };
    mistakes.extend(reader.mistakes);
    mistakes.sort_by_key(|mistake| mistake.span);
    (tree, mistakes)
}

/// What a piece of the text is, as far as its layout goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    Space,
    LineComment,
    BlockComment,
    Open,
    Close,
    Comma,
    Colon,
    /// A name, a literal, or anything else.
    Word,
}

/// The pieces of the text in order, none left out.
pub(crate) fn parts(text: &str) -> Vec<(Part, Span)> {
    let root = ronin_core::parse(text).root();
    let part = |token: SyntaxToken| {
        use SyntaxKind::{LBrace, LBracket, LParen, RBrace, RBracket, RParen};
        let part = match token.kind() {
            SyntaxKind::Whitespace | SyntaxKind::Bom => Part::Space,
            SyntaxKind::LineComment => Part::LineComment,
            SyntaxKind::BlockComment => Part::BlockComment,
            LParen | LBracket | LBrace => Part::Open,
            RParen | RBracket | RBrace => Part::Close,
            SyntaxKind::Comma => Part::Comma,
            SyntaxKind::Colon => Part::Colon,
            _ => Part::Word,
        };
        (part, span(token.text_range()))
    };
    root.descendant_tokens().map(part).collect()
}

/// The text as its syntax tree prints it: the same bytes, however broken the text is.
pub(crate) fn printed(text: &str) -> String {
    ronin_core::print(&ronin_core::parse(text))
}

/// Says of a parser's finding what was found, not only what was missed.
fn explain(text: &str, found: Span, message: &str) -> Mistake {
    let found_text = text.get(found.start..found.end).unwrap_or_default();
    let (message, help) = if message.contains("trailing") {
        let end = found_text.find('\n').map_or(found.end, |line| found.start + line);
        return Mistake {
            span: Span { end, ..found },
            message: "there is something behind the end of the graph".into(),
            help: "a file holds one `Graph(..)` and nothing behind it".into(),
        };
    } else if found_text.chars().count() <= 24 && !found_text.is_empty() {
        (
            format!("{message}, but here is `{found_text}`"),
            "is a comma, colon or parenthesis missing before it?",
        )
    } else {
        (message.to_owned(), "is a comma, colon or parenthesis missing before it?")
    };
    Mistake { span: found, message, help: help.into() }
}

/// Commas and colons that are missing or have nothing before or behind them, as far as the parser lets them pass.
fn wrong_separators(root: &SyntaxNode) -> Vec<Mistake> {
    use SyntaxKind::{Colon, Comma, Ident, LBrace, LBracket, LParen, RBrace, RBracket, RParen};
    let mut before = None;
    let mut mistakes = Vec::new();
    for token in root.descendant_tokens().filter(|token| !token.is_trivia()) {
        if token.parent().is_some_and(|node| node.kind() == SyntaxKind::ExtensionAttr) {
            continue;
        }
        let begins = matches!(before, None | Some(Comma | Colon | LParen | LBracket | LBrace));
        let mistake = match token.kind() {
            Comma if begins => Some(("there is nothing before this `,`", "is it one too many?")),
            Colon if begins => Some(("there is nothing before this `:`", "is it one too many?")),
            RParen | RBracket | RBrace if before == Some(Colon) => {
                Some(("there is no value behind the `:` before this", "write one"))
            }
            Comma | Colon | RParen | RBracket | RBrace => None,
            LParen if before == Some(Ident) => None,
            _ if begins => None,
            _ => Some(("something is missing before this", "put a comma or a colon between them")),
        };
        mistakes.extend(mistake.map(|(message, help)| Mistake {
            span: span(token.text_range()),
            message: message.into(),
            help: help.into(),
        }));
        before = Some(token.kind());
    }
    mistakes
}

/// The parenthesis, bracket or brace that is not closed, or closed by another one.
fn unclosed(text: &str, root: &SyntaxNode) -> Option<Mistake> {
    use SyntaxKind::{LBrace, LBracket, LParen, RBrace, RBracket, RParen};
    let closer = |open| match open {
        LParen => (RParen, ')'),
        LBracket => (RBracket, ']'),
        _ => (RBrace, '}'),
    };
    let mut open: Vec<(SyntaxKind, Span)> = Vec::new();
    for token in root.descendant_tokens() {
        let (kind, at) = (token.kind(), span(token.text_range()));
        if matches!(kind, LParen | LBracket | LBrace) {
            open.push((kind, at));
        } else if matches!(kind, RParen | RBracket | RBrace) {
            let Some((opener, opened)) = open.pop() else {
                let message = format!("this `{}` closes nothing", token.text());
                return Some(Mistake { span: at, message, help: "is it one too many?".into() });
            };
            if closer(opener).0 != kind {
                let Place { line, column } = Place::of(text, at.start);
                let (found, opener_text) = (token.text(), &text[opened.start..opened.end]);
                let message = format!(
                    "this `{opener_text}` is not closed before the `{found}` at {line}:{column}"
                );
                let help = format!("put a `{}` where it ends", closer(opener).1);
                return Some(Mistake { span: opened, message, help });
            }
        }
    }
    let (opener, opened) = open.pop()?;
    let message = format!("this `{}` is never closed", &text[opened.start..opened.end]);
    Some(Mistake {
        span: opened,
        message,
        help: format!("put a `{}` where it ends", closer(opener).1),
    })
}

pub(super) fn span(range: TextRange) -> Span {
    Span { start: range.start(), end: range.end() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_those_of_the_values_without_the_space_around_them() {
        let (tree, _) = parse("( a : Near( b: 1 ) , )");
        let field = &tree.fields().unwrap()[0];
        assert_eq!(
            (field.name.span, field.value.span),
            (Span { start: 2, end: 3 }, Span { start: 6, end: 18 })
        );
    }

    #[test]
    fn deep_nesting_is_one_mistake() {
        let (_, mistakes) = parse(&format!("(a: {}{})", "[".repeat(9999), "]".repeat(9999)));
        assert_eq!(mistakes.len(), 1);
        assert_eq!(mistakes[0].message, "values are nested more than 128 deep here");
    }

    #[test]
    fn an_empty_file_is_a_mistake() {
        assert_eq!(parse("// nothing\n").1[0].message, "the file is empty");
    }
}
