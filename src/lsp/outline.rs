//! The structure of a text: symbols, folding ranges, colors, links to files and semantic tokens.

use std::path::PathBuf;

use maquette_syntax::error::Span;
use maquette_syntax::{Frame, Token, TypedKind, WalkEvent, for_each_word, tokens, unit_names};
use maquette_value::Color;

use super::expected_syntax::{ExpectedSyntax, SyntaxResolver};
use super::library::Library;
use super::scope::Scope;

/// An entry of a section of the file, such as a node. Its span reaches from the start of its name to the end of its value.
pub(super) struct Symbol {
    pub(super) name: String,
    pub(super) kind: String,
    pub(super) span: Span,
    pub(super) at: Span,
}

/// A section of a file, such as `nodes`, with its entries.
pub(super) struct Section {
    pub(super) name: String,
    pub(super) span: Span,
    pub(super) at: Span,
    pub(super) entries: Vec<Symbol>,
}

/// Returns the sections of a file in the order of the text.
pub(super) fn sections(text: &str) -> Vec<Section> {
    let scope = Scope::parse(text);
    let ends = ends(text);
    fn end_of(start: usize, ends: &[(usize, usize)]) -> Option<usize> {
        ends.iter().find(|(open, _)| *open == start).map(|(_, end)| *end)
    }
    let mut found: Vec<Section> = Vec::new();
    let mut starts = Vec::new();
    for_each_word(text, |frames, passed| match (frames, passed) {
        ([_], WalkEvent::Name(name)) => found.push(Section {
            name: name.text.clone(),
            span: name.span,
            at: name.span,
            entries: Vec::new(),
        }),
        ([_, section, ..], _) => {
            let known = starts.last().map(|(start, _)| *start);
            if known != Some(section.start) {
                starts.push((section.start, found.len()));
            }
        }
        _ => {}
    });
    for (start, count) in starts {
        if let Some(section) = count.checked_sub(1).and_then(|index| found.get_mut(index)) {
            section.span.end = end_of(start, &ends).unwrap_or(section.span.end);
        }
    }
    for section in &mut found {
        let all = match &section.name[..] {
            "use" => &scope.uses,
            "inputs" => &scope.inputs,
            "params" => &scope.params,
            "nodes" => &scope.nodes,
            "outputs" => &scope.outputs,
            _ => continue,
        };
        let entries = all.iter().map(|it| {
            let behind =
                text[it.at.end..].starts_with('(').then(|| end_of(it.at.end, &ends)).flatten();
            let end = behind.unwrap_or(it.at.end).max(it.name.span.end);
            let quotes = Span { start: it.name.span.start.saturating_sub(1), end };
            Symbol {
                name: it.name.text.clone(),
                kind: it.kind.clone(),
                span: quotes,
                at: it.name.span,
            }
        });
        section.entries = entries.collect();
        let last = section.entries.last().map_or(0, |entry| entry.span.end);
        section.span.end = section.span.end.max(last);
    }
    found
}

/// Returns the start and end of each pair of brackets, including the brackets.
pub(super) fn ends(text: &str) -> Vec<(usize, usize)> {
    let (mut open, mut ends) = (Vec::new(), Vec::new());
    for (token, span) in tokens(text) {
        match token {
            Token::Open => open.push(span.start),
            Token::Close => ends.extend(open.pop().map(|start| (start, span.end))),
            _ => {}
        }
    }
    ends.sort_unstable();
    ends
}

/// Returns the spans that an editor can fold: first those of brackets, then those of comments with several lines.
pub(super) fn folds(text: &str) -> (Vec<Span>, Vec<Span>) {
    fn is_long(start: usize, end: usize, text: &str) -> bool {
        text[start..end].contains('\n')
    }
    let brackets = ends(text).into_iter().filter(|&(start, end)| is_long(start, end, text));
    let brackets = brackets.map(|(start, end)| Span { start, end }).collect();
    let mut comments: Vec<Span> = Vec::new();
    let mut is_open = false;
    for (token, span) in tokens(text) {
        match token {
            Token::LineComment if is_open => {
                if let Some(last) = comments.last_mut() {
                    last.end = span.end;
                }
            }
            Token::LineComment | Token::BlockComment => {
                comments.push(span);
                is_open = token == Token::LineComment;
            }
            Token::Space => is_open &= text[span.start..span.end].matches('\n').count() < 2,
            _ => is_open = false,
        }
    }
    comments.retain(|span| is_long(span.start, span.end, text));
    (brackets, comments)
}

/// Returns the strings that are colors. Each has its span and its red, green and blue, from 0 to 255.
pub(super) fn colors(text: &str) -> Vec<(Span, [u8; 3])> {
    let mut found = Vec::new();
    for_each_word(text, |_, passed| {
        if let WalkEvent::Word(word, TypedKind::Text) = passed
            && let Ok(color) = word.text.parse::<Color>()
        {
            found.push((word.span, color.0));
        }
    });
    found
}

/// Returns the existing files that a text names, each with the span of its name.
pub(super) fn files(library: &Library<'_>, text: &str) -> Vec<(Span, PathBuf)> {
    let scope = Scope::parse(text);
    let slots = SyntaxResolver { library, scope: &scope };
    let mut found = Vec::new();
    for_each_word(text, |frames, passed| {
        let WalkEvent::Word(word, TypedKind::Text) = passed else { return };
        let may_be = word.text.contains('.') && !frames.is_empty();
        if may_be
            && matches!(slots.resolve(frames).1, ExpectedSyntax::Path(_) | ExpectedSyntax::Use)
        {
            let path = library.resolve(&word.text);
            if path.is_file() {
                found.push((word.span, path));
            }
        }
    });
    found
}

/// The meaning of a word, for syntax highlighting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Meaning {
    /// A keyword such as `Graph`, `Param` or `ForEach`.
    Keyword,
    /// The name of a node type.
    Node,
    /// The name of a value type, or an enum variant.
    Choice,
    Field,
    /// A name where it is declared.
    Declaration,
    /// A link to a node or an input.
    Link,
    Parameter,
    Unit,
    Number,
}

/// All meanings, each with its token type in the protocol.
pub(super) const MEANINGS: [(Meaning, &str); 9] = [
    (Meaning::Keyword, "keyword"),
    (Meaning::Node, "class"),
    (Meaning::Choice, "enumMember"),
    (Meaning::Field, "property"),
    (Meaning::Declaration, "function"),
    (Meaning::Link, "variable"),
    (Meaning::Parameter, "parameter"),
    (Meaning::Unit, "type"),
    (Meaning::Number, "number"),
];

/// Returns the words of a text with their meanings, from start to end.
pub(super) fn words(text: &str) -> Vec<(Span, Meaning)> {
    const KEYWORDS: [&str; 17] = [
        "Graph", "Patch", "Test", "Sweep", "Product", "Zip", "Values", "Files", "Param", "Expr",
        "Draft", "ForEach", "Switch", "Some", "None", "Optional", "Parts",
    ];
    let scope = Scope::parse(text);
    let is_link =
        |word: &str| scope.node(word.split(['.', '/']).next().unwrap_or_default()).is_some();
    let mut found = Vec::new();
    for_each_word(text, |frames, passed| {
        let (word, meaning) = match passed {
            WalkEvent::Name(name) => {
                let is_key = frames.last().is_some_and(|frame| frame.bracket == '{');
                (name, if is_key { Meaning::Declaration } else { Meaning::Field })
            }
            WalkEvent::Word(word, TypedKind::Text) => {
                match meaning_of(frames, &word.text, &is_link) {
                    Some(meaning) => (word, meaning),
                    None => return,
                }
            }
            WalkEvent::Word(word, _)
                if word.text.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)) =>
            {
                (word, Meaning::Number)
            }
            WalkEvent::Word(word, _) => {
                let is_node = frames.len() == 2
                    && frames[0].field.as_ref().is_some_and(|section| section.text == "nodes");
                let meaning = match &word.text[..] {
                    text if KEYWORDS.contains(&text) => Meaning::Keyword,
                    _ if is_node => Meaning::Node,
                    text if unit_names().any(|unit| unit == text) => Meaning::Unit,
                    _ => Meaning::Choice,
                };
                (word, meaning)
            }
        };
        // Leave out words that contain a line break, because many editors do not support such tokens.
        if !word.text.contains('\n') && !word.text.is_empty() {
            found.push((word.span, meaning));
        }
    });
    found
}

/// Returns the meaning of a string for syntax highlighting, or `None` if it is plain text.
fn meaning_of(frames: &[Frame], word: &str, is_link: &dyn Fn(&str) -> bool) -> Option<Meaning> {
    let last = frames.last()?;
    let within = last.name.as_ref().map_or("", |name| &name.text);
    let section = frames[0].field.as_ref().map_or("", |field| &field.text);
    match within {
        "Param" | "Expr" => Some(Meaning::Parameter),
        _ if last.field.as_ref().is_some_and(|field| field.text == "doc") => None,
        _ if !matches!(section, "nodes" | "outputs" | "expect") => None,
        _ => is_link(word).then_some(Meaning::Link),
    }
}
