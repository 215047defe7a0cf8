//! The values of a graph file with their places: what a text says, without how it is written.

use std::borrow::Cow;
use std::sync::Arc;

use super::sheet::Sheet;
use crate::error::Span;

/// One value of the file, and where it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Tree {
    pub span: Span,
    pub kind: Kind,
    /// Where a value that stands in for a `Param` comes from.
    pub origin: Option<Origin>,
}

/// Where a parameter's value comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum Origin {
    /// The default in the file.
    Default(Span),
    /// `--set` with this text.
    Set(String),
    /// Another file than the one that it is used in.
    Given(Given),
}

/// A value that comes from another file: through a use of a graph, or by a patch.
#[derive(Clone, Debug, PartialEq)]
pub struct Given {
    pub sheet: Arc<Sheet>,
    /// Where it stands there.
    pub span: Span,
    /// With which `--set` it was given there, if it was.
    pub set: Option<String>,
}

impl Given {
    /// In words: `graphs/face.ron:9:30`.
    pub fn place(&self) -> String {
        match &self.set {
            Some(set) => format!("`--set {set}`"),
            None => self.sheet.place_in_words(self.span),
        }
    }
}

/// What kind of value it is.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
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
pub enum Body {
    Empty,
    Fields(Vec<Field>),
    Items(Vec<Tree>),
}

/// A word with its place.
#[derive(Clone, Debug, PartialEq)]
pub struct Name {
    pub text: String,
    pub span: Span,
}

/// `name: value`.
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

    /// Whether nothing in it is broken.
    pub fn is_whole(&self) -> bool {
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

    pub fn text(&self) -> Option<&str> {
        match &self.kind {
            Kind::Text(text) => Some(text),
            _ => None,
        }
    }

    /// The name before the parentheses, or the bare word.
    pub fn name(&self) -> Option<Name> {
        match &self.kind {
            Kind::Call { name, .. } => name.clone(),
            Kind::Word(text) => Some(Name { text: text.clone(), span: self.span }),
            _ => None,
        }
    }

    /// The fields between the parentheses; none if there are no parentheses, or items in them.
    pub fn fields(&self) -> Option<&[Field]> {
        match &self.kind {
            Kind::Call { body: Body::Fields(fields), .. } => Some(fields),
            Kind::Call { body: Body::Empty, .. } => Some(&[]),
            _ => None,
        }
    }

    /// The only item between the parentheses of `name(..)`.
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

    /// What stands at the end of this way through fields, items and entries, or as far along it as the file goes. The name of a
    /// choice, `Near` of `Near(..)`, is a step of the way.
    pub fn at(&self, path: &[String]) -> &Self {
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
    pub fn in_words(&self) -> String {
        match &self.kind {
            Kind::Number { value, .. } => format!("the number {value}"),
            Kind::Bool(value) => value.to_string(),
            Kind::Text(text) => format!("the text \"{}\"", cut(text)),
            Kind::Word(word) => format!("`{}`", cut(word)),
            Kind::Call { name: Some(name), .. } => format!("`{}(..)`", cut(&name.text)),
            Kind::Call { body: Body::Fields(_), .. } => "a group of fields".into(),
            Kind::Call { .. } => "a tuple".into(),
            Kind::List(_) => "a list".into(),
            Kind::Map(_) => "a map".into(),
            Kind::Broken => "something unreadable".into(),
        }
    }
}

/// The beginning of a text that is too long for a message.
pub fn cut(text: &str) -> Cow<'_, str> {
    const MOST: usize = 60;
    match text.char_indices().nth(MOST) {
        Some((end, _)) => format!("{}..", &text[..end]).into(),
        None => text.into(),
    }
}
