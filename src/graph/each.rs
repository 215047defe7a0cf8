//! `ForEach` and `Switch`: what looks like a node and is resolved when the graph is read.

use std::collections::HashSet;

use super::check::Check;
use super::quality::chosen;
use crate::error::{Span, code};
use crate::text::{Body, Field, Kind, Name, Tree, nearest_or_all};

/// A `ForEach`: one node for each element of a list.
pub(super) struct Each {
    pub(super) name: String,
    /// Where its name stands.
    pub(super) span: Span,
    /// The type of its nodes.
    pub(super) kind: String,
    /// Their places among the drafts.
    pub(super) elements: Vec<usize>,
    /// What each element takes from the one before, and what the first one takes instead.
    pub(super) carry: Vec<(String, Tree)>,
    /// The outputs of its nodes, if it has none.
    pub(super) outputs: Option<Vec<String>>,
}

impl Each {
    /// Whether a link begins with its name.
    pub(super) fn is_named(&self, link: &str) -> bool {
        link.split('.').next() == Some(&self.name)
    }
}

/// The elements of a `ForEach` as calls of their own, and what they carry.
pub(super) struct Repeated {
    pub(super) kind: String,
    pub(super) calls: Vec<Tree>,
    pub(super) carry: Vec<(String, Tree)>,
}

/// The branches of a `Switch`.
pub(super) struct Branches {
    /// Names, and links to what each gives.
    pub(super) cases: Vec<(String, Tree)>,
    pub(super) choose: Tree,
}

/// The fields of a `ForEach`.
pub(super) const EACH: [&str; 5] = ["graph", "over", "with", "carry", "links"];
/// The fields of a `Switch`.
pub(super) const SWITCH: [&str; 2] = ["cases", "choose"];

impl Check<'_, '_> {
    /// The fields of a call, as far as they are known.
    fn known<'t>(&mut self, tree: &'t Tree, kind: &str, known: &[&str]) -> Vec<&'t Field> {
        let Some(fields) = tree.fields() else {
            let message = format!("{kind} wants named fields");
            self.find(
                code::WRONG_VALUE,
                tree.span,
                message,
                nearest_or_all("", "its fields", known),
            );
            return Vec::new();
        };
        let mut found: Vec<&Field> = Vec::new();
        for field in fields {
            let name = &field.name;
            if !known.contains(&&name.text[..]) {
                let message = format!("{kind} has no field `{}`", name.text);
                let help = self.guess(|| nearest_or_all(&name.text, "its fields", known));
                self.find(code::UNKNOWN_FIELD, name.span, message, help);
            } else if found.iter().any(|before| before.name.text == name.text) {
                let message = format!("field `{}` is given twice", name.text);
                self.find(code::BAD_NAME, name.span, message, "keep one of them");
            } else {
                found.push(field);
            }
        }
        found
    }

    fn wants(&mut self, kind: &str, field: &Field, wanted: &str) {
        if field.value.is_broken() {
            return;
        }
        let (name, found) = (&field.name.text, field.value.in_words());
        let message = format!("field `{name}` of {kind} wants {wanted}, not {found}");
        self.find(code::WRONG_VALUE, field.value.span, message, "");
    }

    fn lacks(&mut self, kind: &str, field: &str, span: Span) {
        let message = format!("{kind} needs a field `{field}`");
        self.find(code::MISSING_FIELD, span, message, format!("write `{field}: ..`"));
    }

    /// The nodes that `name: ForEach(..)` stands for.
    pub(super) fn repeated(&mut self, name: &str, tree: &Tree) -> Option<Repeated> {
        let before = self.findings.len();
        let fields = self.known(tree, "ForEach", &EACH);
        let (mut kind, mut over) = (None, None);
        let (mut with, mut links, mut carry) = (Vec::new(), Vec::new(), Vec::new());
        for field in fields {
            let draft = self.world.options.draft;
            let Some(value) = chosen(&field.value, draft, &mut self.findings) else { continue };
            let group = value.fields().filter(|_| is_group(value));
            match (&field.name.text[..], &value.kind, group) {
                ("graph", Kind::Text(text), _) => kind = Some((text.clone(), field.value.span)),
                ("graph", ..) => {
                    self.wants("ForEach", field, "the name of a node type: \"Feature\"");
                }
                ("over", Kind::List(items), _) => over = Some(&items[..]),
                ("over", ..) => self.wants("ForEach", field, "a list: `[(rank: 1), ..]`"),
                ("with", _, Some(fields)) => with = fields.to_vec(),
                ("links", _, Some(fields)) => links = fields.to_vec(),
                ("carry", _, Some(fields)) => carry = fields.to_vec(),
                _ => self.wants("ForEach", field, "a group of fields: `(field: value, ..)`"),
            }
        }
        for (field, given) in [("graph", kind.is_some()), ("over", over.is_some())] {
            let is_there = tree.fields().is_none_or(|f| f.iter().any(|f| f.name.text == field));
            if !given && !is_there {
                self.lacks("ForEach", field, tree.span);
            }
        }
        let (Some((kind, kind_span)), Some(over)) = (kind, over) else { return None };
        for item in over.iter().filter(|item| !is_group(item) && !item.is_broken()) {
            let message =
                format!("an element of ForEach is a group of fields, not {}", item.in_words());
            self.find(code::WRONG_VALUE, item.span, message, "write `(field: value, ..)`");
        }
        if self.findings.len() > before {
            return None;
        }
        let common = Vec::from_iter(with.into_iter().chain(links));
        let call_name = Name { text: kind.clone(), span: kind_span };
        let calls = over.iter().enumerate().map(|(index, element)| {
            let own = element.fields().unwrap_or_default();
            let is_own = |field: &Field| own.iter().any(|own| own.name.text == field.name.text);
            let mut fields = own.to_vec();
            fields.extend(common.iter().filter(|field| !is_own(field)).cloned());
            fields.extend(carry.iter().map(|field| match index {
                0 => field.clone(),
                _ => {
                    let link = format!("{}.{}", element_name(name, index - 1), field.name.text);
                    let value = Tree::new(field.value.span, Kind::Text(link));
                    Field { value, ..field.clone() }
                }
            }));
            let (name, body) = (Some(call_name.clone()), Body::Fields(fields));
            Tree::new(element.span, Kind::Call { name, body })
        });
        let calls = calls.collect();
        let carry = carry.into_iter().map(|field| (field.name.text, field.value)).collect();
        Some(Repeated { kind, calls, carry })
    }

    /// The branches of a `Switch(..)`, in the order of the file.
    pub(super) fn branches(&mut self, tree: &Tree) -> Option<Branches> {
        let fields = self.known(tree, "Switch", &SWITCH);
        let (mut cases, mut choose) = (None, None);
        for field in fields {
            match (&field.name.text[..], &field.value.kind) {
                ("cases", Kind::Map(entries)) if entries.is_empty() => {
                    let message = "Switch has no cases".to_owned();
                    let help = "write `{\"name\": \"node\", ..}`";
                    self.find(code::MISSING_FIELD, field.value.span, message, help);
                }
                ("cases", Kind::Map(entries)) => cases = self.cases(entries),
                ("cases", _) => self.wants("Switch", field, "a map: `{\"name\": \"node\", ..}`"),
                _ => choose = Some(field.value.clone()),
            }
        }
        for field in SWITCH {
            if tree.fields().is_some_and(|f| f.iter().all(|f| f.name.text != field)) {
                self.lacks("Switch", field, tree.span);
            }
        }
        Some(Branches { cases: cases?, choose: choose? })
    }

    fn cases(&mut self, entries: &[(Tree, Tree)]) -> Option<Vec<(String, Tree)>> {
        let before = self.findings.len();
        let mut cases: Vec<(String, Tree)> = Vec::with_capacity(entries.len());
        let mut taken = HashSet::new();
        for (key, value) in entries {
            let (Some(name), Some(_)) = (key.text(), value.text()) else {
                let message = "a case of Switch is a name and a link".to_owned();
                self.find(code::WRONG_VALUE, key.span, message, "write `\"name\": \"node\"`");
                continue;
            };
            if !taken.insert(name) {
                let message = format!("there is already a case `{name}`");
                self.find(code::BAD_NAME, key.span, message, "keep one of them");
            }
            cases.push((name.to_owned(), value.clone()));
        }
        (self.findings.len() == before).then_some(cases)
    }
}

impl Branches {
    /// The case that a value names; if there is none, why, and the word that names no case.
    pub(super) fn chosen(&self, value: &Tree) -> Result<usize, (String, String)> {
        let word = match &value.kind {
            Kind::Word(word) | Kind::Text(word) => word.clone(),
            Kind::Bool(truth) => truth.to_string(),
            Kind::Number { value, .. } => value.to_string(),
            _ => {
                return Err((
                    format!("Switch cannot choose by {}", value.in_words()),
                    String::new(),
                ));
            }
        };
        let found = self.cases.iter().position(|(name, _)| *name == word);
        found.ok_or_else(|| (format!("Switch has no case `{word}`"), word))
    }

    /// The case that may have been meant by a word.
    pub(super) fn meant(&self, word: &str) -> String {
        if word.is_empty() {
            return String::new();
        }
        let names = Vec::from_iter(self.cases.iter().map(|(name, _)| &name[..]));
        nearest_or_all(word, "its cases", &names)
    }
}

/// `eyes/1` for the first one.
pub(super) fn element_name(each: &str, index: usize) -> String {
    format!("{each}/{}", index + 1)
}

fn is_group(tree: &Tree) -> bool {
    matches!(&tree.kind, Kind::Call { name: None, body: Body::Fields(_) | Body::Empty })
}
