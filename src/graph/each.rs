//! `ForEach` and `Switch`: what looks like a node and is resolved when the graph is read, or, over data, when the data are known.

use std::collections::HashSet;

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Body, Field, Help, Kind, Name, Tree, nearest_or_all};

use super::check::Check;
use super::quality::chosen;
use super::top::{field_of, name_of};
use crate::definition::Branches;

/// What `name: ForEach(..)` says.
pub(super) struct Repeated {
    pub(super) kind: Name,
    pub(super) over: Over,
    /// The fields that all elements have.
    pub(super) common: Vec<Field>,
    pub(super) carry: Vec<Field>,
    /// The input that takes the element, if it is named.
    pub(super) each: Option<Name>,
    /// The parameter that gets the element's number, from 1.
    pub(super) number: Option<Name>,
    /// The most elements, if it is not the default.
    pub(super) most: Option<Tree>,
}

/// What a `ForEach` goes over.
pub(super) enum Over {
    /// Groups of fields.
    List(Vec<Tree>),
    /// A number, which parameters may give.
    Count(Tree),
    /// The elements of a value: its link, and which elements if a word says so, as in `Parts("mesh")`.
    Data(Tree, String),
}

impl Repeated {
    /// What it carries: the outputs, and the links of the first element.
    pub(super) fn carried(&self) -> Vec<(String, Tree)> {
        self.carry.iter().map(|field| (name_of(&field.name.text), field.value.clone())).collect()
    }

    /// The elements of a list as calls of their own.
    pub(super) fn calls(&self, name: &str, list: &[Tree]) -> Vec<Tree> {
        let call = |(index, element): (usize, &Tree)| {
            let own = element.fields().unwrap_or_default();
            fn is_own(field: &Field, own: &[Field]) -> bool {
                own.iter().any(|own| own.name.text == field.name.text)
            }
            let mut fields = own.to_vec();
            fields.extend(self.common.iter().filter(|field| !is_own(field, own)).cloned());
            fields.extend(self.number.as_ref().map(|number| numbered(number, index + 1)));
            fields.extend(self.carry.iter().map(|field| match index {
                0 => field.clone(),
                _ => {
                    let output = name_of(&field.name.text);
                    let link = format!("{}.{output}", element_name(name, index - 1));
                    let value = Tree::new(field.value.span, Kind::Text(link));
                    Field { value, ..field.clone() }
                }
            }));
            self.call(fields, element.span)
        };
        list.iter().enumerate().map(call).collect()
    }

    /// An element that has all but its data and its number.
    pub(super) fn example(&self, span: Span) -> Tree {
        self.call(self.common.iter().chain(&self.carry).cloned().collect(), span)
    }

    fn call(&self, fields: Vec<Field>, span: Span) -> Tree {
        Tree::new(span, Kind::Call { name: Some(self.kind.clone()), body: Body::Fields(fields) })
    }
}

/// The field that gets an element's number.
pub(super) fn numbered(name: &Name, number: usize) -> Field {
    let number = Kind::Number { value: number as f64, whole: true };
    Field { name: name.clone(), value: Tree::new(name.span, number) }
}

/// The fields of a `ForEach`.
pub(super) const EACH: [&str; 8] =
    ["graph", "over", "with", "carry", "links", "each", "number", "most"];
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

    /// What a `ForEach(..)` says; none if something is wrong with it.
    pub(super) fn repeated(&mut self, tree: &Tree) -> Option<Repeated> {
        let before = self.findings.len();
        let fields = self.known(tree, "ForEach", &EACH);
        let (mut kind, mut over, mut most) = (None, None, None);
        let (mut each, mut number) = (None, None);
        let (mut with, mut links, mut carry) = (Vec::new(), Vec::new(), Vec::new());
        fn named(text: &str, span: Span) -> Option<Name> {
            Some(Name { text: text.to_owned(), span })
        }
        for field in fields {
            let draft = self.world.options.draft;
            let Some(value) = chosen(&field.value, draft, &mut self.findings) else { continue };
            let group = value.fields().filter(|_| is_group(value));
            match (&field.name.text[..], value.text(), group) {
                ("graph", Some(text), _) => kind = named(text, value.span),
                ("graph", ..) => {
                    self.wants("ForEach", field, "the name of a node type: \"Feature\"");
                }
                ("over", ..) => match gone_over(value) {
                    Some(found) => over = Some(found),
                    None => self.wants("ForEach", field, OVER),
                },
                ("each", Some(text), _) => each = named(&field_of(text), value.span),
                ("each", ..) => self.wants("ForEach", field, "the name of an input: \"spot\""),
                ("number", Some(text), _) => number = named(&field_of(text), value.span),
                ("number", ..) => {
                    self.wants("ForEach", field, "the name of a parameter: \"rank\"");
                }
                ("most", ..) if is_number(value) => most = Some(value.clone()),
                ("most", ..) => self.wants("ForEach", field, "a number of elements"),
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
        let (Some(kind), Some(over)) = (kind, over) else { return None };
        if let Over::List(list) = &over {
            for item in list.iter().filter(|item| !is_group(item) && !item.is_broken()) {
                let message =
                    format!("an element of ForEach is a group of fields, not {}", item.in_words());
                self.find(code::WRONG_VALUE, item.span, message, "write `(field: value, ..)`");
            }
        }
        if let Some(each) = each.as_ref().filter(|_| !matches!(over, Over::Data(..))) {
            let what = if matches!(over, Over::List(_)) { "a list" } else { "a number" };
            let message = format!("field `each` names what takes the data, but `over` is {what}");
            let help = "leave it out; `number` names a parameter that gets 1, 2, ..";
            self.find(code::WRONG_VALUE, each.span, message, help);
        }
        let common = with.into_iter().chain(links).collect();
        let repeated = Repeated { kind, over, common, carry, each, number, most };
        (self.findings.len() == before).then_some(repeated)
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
            // `-0` is no other number.
            Kind::Number { value, .. } => (value + 0.0).to_string(),
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
    pub(super) fn meant(&self, word: &str) -> Help {
        if word.is_empty() {
            return Help::default();
        }
        let names: Vec<_> = self.cases.iter().map(|(name, _)| &name[..]).collect();
        nearest_or_all(word, "its cases", &names)
    }
}

/// `eyes/1` for the first one.
pub(super) fn element_name(each: &str, index: usize) -> String {
    format!("{each}/{}", index + 1)
}

const OVER: &str = "a list `[(rank: 1), ..]`, a link, or a number";

/// What the field `over` says, if it is of a known form.
fn gone_over(tree: &Tree) -> Option<Over> {
    match &tree.kind {
        Kind::List(items) => Some(Over::List(items.clone())),
        Kind::Text(_) => Some(Over::Data(tree.clone(), String::new())),
        _ if is_number(tree) => Some(Over::Count(tree.clone())),
        Kind::Call { name: Some(name), .. } => {
            let link = tree.call_of(&name.text).filter(|link| link.text().is_some())?;
            Some(Over::Data(link.clone(), name.text.clone()))
        }
        _ => None,
    }
}

/// Whether it is a number, or what gives one.
fn is_number(tree: &Tree) -> bool {
    let computed = ["Param", "Expr"].iter().any(|word| tree.call_of(word).is_some());
    computed || matches!(tree.kind, Kind::Number { .. })
}

fn is_group(tree: &Tree) -> bool {
    matches!(&tree.kind, Kind::Call { name: None, body: Body::Fields(_) | Body::Empty })
}
