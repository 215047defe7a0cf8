//! The tree of values in a graph file. It has the positions of all values, but no formatting and no comments.

use std::borrow::Cow;
use std::sync::Arc;

use super::source_map::SourceMap;
use crate::error::Span;

/// A value in a graph file, with its position.
#[derive(Clone, Debug, PartialEq)]
pub struct Tree {
    pub span: Span,
    pub kind: Kind,
    /// The origin of the value, if it has replaced a `Param`. Otherwise `None`.
    pub origin: Option<Origin>,
}

/// The origin of a value that has replaced a `Param`.
#[derive(Clone, Debug, PartialEq)]
pub enum Origin {
    /// The default of the parameter, at this span of the same file.
    Default(Span),
    /// The command-line option `--set` with this text as its argument.
    Set(String),
    /// Another file, from which the value was passed on to the file that uses it.
    External(ExternalOrigin),
}

/// The origin of a value in another file, which uses or patches the graph.
#[derive(Clone, Debug, PartialEq)]
pub struct ExternalOrigin {
    pub source_map: Arc<SourceMap>,
    /// The position of the value, as a span in `source_map`.
    pub span: Span,
    /// The text of the option `--set`. `None` if the value does not come from such an option.
    pub set: Option<String>,
}

impl ExternalOrigin {
    /// Formats the origin for messages: the position `graphs/face.ron:9:30`, or the option `--set` from which the value comes.
    pub fn location(&self) -> String {
        match &self.set {
            Some(set) => format!("`--set {set}`"),
            None => self.source_map.describe_location(self.span),
        }
    }
}

/// The kind and content of a value.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// A finite number. `whole` is true if the number was written without a fraction and an exponent.
    Number { value: f64, whole: bool },
    /// A truth value, `true` or `false`.
    Bool(bool),
    /// A string, without its quotes and with its escapes resolved.
    Text(String),
    /// A bare word, without quotes and parentheses.
    Word(String),
    /// A call, `Name(..)`, or parentheses without a name, `(..)`.
    Call { name: Option<Name>, body: Body },
    /// A list `[..]`, as its items.
    List(Vec<Tree>),
    /// A map `{..}`, as its keys and values.
    Map(Vec<(Tree, Tree)>),
    /// A value with a syntax error, which has already been reported.
    Broken,
}

/// The content of the parentheses of a call.
#[derive(Clone, Debug, PartialEq)]
pub enum Body {
    Empty,
    Fields(Vec<Field>),
    Items(Vec<Tree>),
}

/// A word with its position, such as the name of a field or of a call.
#[derive(Clone, Debug, PartialEq)]
pub struct Name {
    pub text: String,
    pub span: Span,
}

/// A field of a call, `name: value`.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    pub name: Name,
    pub value: Tree,
}

impl Tree {
    pub fn new(span: Span, kind: Kind) -> Self {
        Self { span, kind, origin: None }
    }

    pub fn is_broken(&self) -> bool {
        self.kind == Kind::Broken
    }

    /// Returns true if the value and all its parts are free of syntax errors.
    pub fn is_complete(&self) -> bool {
        match &self.kind {
            Kind::Broken => false,
            Kind::Call { body: Body::Fields(fields), .. } => {
                fields.iter().all(|field| field.value.is_complete())
            }
            Kind::Call { body: Body::Items(items), .. } | Kind::List(items) => {
                items.iter().all(Self::is_complete)
            }
            Kind::Map(entries) => entries.iter().all(|(_, value)| value.is_complete()),
            _ => true,
        }
    }

    pub fn text(&self) -> Option<&str> {
        match &self.kind {
            Kind::Text(text) => Some(text),
            _ => None,
        }
    }

    /// Returns the name of a call, or the bare word. `None` for other values.
    pub fn name(&self) -> Option<Name> {
        match &self.kind {
            Kind::Call { name, .. } => name.clone(),
            Kind::Word(text) => Some(Name { text: text.clone(), span: self.span }),
            _ => None,
        }
    }

    /// Returns the fields of a call. `None` if the value is not a call, or if the values in its parentheses have no names.
    pub fn fields(&self) -> Option<&[Field]> {
        match &self.kind {
            Kind::Call { body: Body::Fields(fields), .. } => Some(fields),
            Kind::Call { body: Body::Empty, .. } => Some(&[]),
            _ => None,
        }
    }

    /// Returns `item` if the value is the call `wanted(item)`, which has exactly one item without a name. Otherwise `None`.
    pub fn call_of(&self, wanted: &str) -> Option<&Self> {
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

    /// Follows a path through fields, items and entries. Stops at the last step that the file contains. The name of an enum variant, such
    /// as `Near` in `Near(..)`, is a step of the path.
    pub fn descend(&self, path: &[String]) -> &Self {
        let Some((step, rest)) = path.split_first() else { return self };
        let inside = match &self.kind {
            Kind::Call { name: Some(name), .. } if name.text == *step => {
                return self.descend_body(rest);
            }
            Kind::List(items) => step.parse().ok().and_then(|index: usize| items.get(index)),
            Kind::Map(entries) => {
                let entry = entries.iter().find(|(key, _)| key.text() == Some(step));
                entry.map(|(_, value)| value)
            }
            _ => return self.descend_body(path),
        };
        inside.map_or(self, |inside| inside.descend(rest))
    }

    /// Like [`descend`](Self::descend), but begins inside of the parentheses of a call.
    fn descend_body(&self, path: &[String]) -> &Self {
        let Some((step, rest)) = path.split_first() else { return self };
        let inside = match &self.kind {
            Kind::Call { body: Body::Fields(fields), .. } => {
                let field = fields.iter().find(|field| field.name.text == *step);
                field.map(|field| (&field.value, rest))
            }
            // The only item of `Near(..)` has no step of its own: its path is that of `Near`.
            Kind::Call { body: Body::Items(items), .. } => match step.parse::<usize>() {
                Ok(index) => items.get(index).map(|item| (item, rest)),
                Err(_) => items.first().map(|item| (item, path)),
            },
            _ => None,
        };
        inside.map_or(self, |(inside, rest)| inside.descend(rest))
    }

    /// Describes the value for messages. Includes the text of a short value.
    pub fn describe(&self) -> String {
        match &self.kind {
            Kind::Number { value, .. } => format!("the number {value}"),
            Kind::Bool(value) => value.to_string(),
            Kind::Text(text) => format!("the text \"{}\"", truncate(text)),
            Kind::Word(word) => format!("`{}`", truncate(word)),
            Kind::Call { name: Some(name), .. } => format!("`{}(..)`", truncate(&name.text)),
            Kind::Call { body: Body::Fields(_), .. } => "a group of fields".into(),
            Kind::Call { .. } => "a tuple".into(),
            Kind::List(_) => "a list".into(),
            Kind::Map(_) => "a map".into(),
            Kind::Broken => "an invalid value".into(),
        }
    }
}

/// Truncates a text to at most 60 characters for messages.
pub fn truncate(text: &str) -> Cow<'_, str> {
    const MAX_CHARS: usize = 60;
    match text.char_indices().nth(MAX_CHARS) {
        Some((end, _)) => format!("{}..", &text[..end]).into(),
        None => text.into(),
    }
}
