//! `ForEach` and `Switch`. They are written like nodes, but other nodes replace them: when the file is read or, for a `ForEach` over data,
//! when the data are known.

use std::collections::HashSet;

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Body, Field, Help, Kind, Name, Tree, nearest_or_all};

use super::check::Check;
use super::draft_value::resolve_side;
use super::header::{field_of, name_of};
use crate::definition::Branches;

/// The fields of a `ForEach(..)`.
pub(super) struct ForEachFields {
    pub(super) kind: Name,
    pub(super) over: ForEachSource,
    /// The fields in `with` and `links`, which all elements share.
    pub(super) common: Vec<Field>,
    pub(super) carry: Vec<Field>,
    /// The input that receives the element, if the file names one.
    pub(super) each: Option<Name>,
    /// The parameter that receives the number of the element, from 1.
    pub(super) number: Option<Name>,
    /// The maximum number of elements, if the file states one.
    pub(super) max_elements: Option<Tree>,
}

/// The source of the elements of a `ForEach`.
pub(super) enum ForEachSource {
    /// A list of groups of fields, one group per element.
    List(Vec<Tree>),
    /// The number of elements, which may be computed from parameters.
    Count(Tree),
    /// A value that is split into elements: its link, and the word that selects the kind of elements, as in `Parts("mesh")`.
    Data(Tree, String),
}

impl ForEachFields {
    /// Returns the outputs that are passed from element to element, each with the link that the first element uses instead.
    pub(super) fn carried_outputs(&self) -> Vec<(String, Tree)> {
        self.carry.iter().map(|field| (name_of(&field.name.text), field.value.clone())).collect()
    }

    /// Returns the node calls for the elements of a list, one call per element.
    pub(super) fn calls(&self, name: &str, list: &[Tree]) -> Vec<Tree> {
        let calls = list.iter().enumerate().map(|(index, element)| {
            let own = element.fields().unwrap_or_default();
            fn is_own(field: &Field, own: &[Field]) -> bool {
                own.iter().any(|own| own.name.text == field.name.text)
            }
            let mut fields = own.to_vec();
            fields.extend(self.common.iter().filter(|field| !is_own(field, own)).cloned());
            fields.extend(self.number.as_ref().map(|number| number_field(number, index + 1)));
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
        });
        calls.collect()
    }

    /// Returns the node call for one element, without the fields that contain the element's data and number.
    pub(super) fn example(&self, span: Span) -> Tree {
        self.call(self.common.iter().chain(&self.carry).cloned().collect(), span)
    }

    fn call(&self, fields: Vec<Field>, span: Span) -> Tree {
        Tree::new(span, Kind::Call { name: Some(self.kind.clone()), body: Body::Fields(fields) })
    }
}

/// Returns the field through which an element receives its number.
pub(super) fn number_field(name: &Name, number: usize) -> Field {
    let number = Kind::Number { value: number as f64, whole: true };
    Field { name: name.clone(), value: Tree::new(name.span, number) }
}

/// The names of the fields of a `ForEach`.
pub(super) const FOR_EACH_FIELDS: [&str; 8] =
    ["graph", "over", "with", "carry", "links", "each", "number", "most"];
/// The names of the fields of a `Switch`.
pub(super) const SWITCH_FIELDS: [&str; 2] = ["cases", "choose"];

impl Check<'_, '_> {
    /// Returns the valid fields of a call, and reports the invalid ones.
    fn known_fields<'t>(&mut self, tree: &'t Tree, kind: &str, known: &[&str]) -> Vec<&'t Field> {
        let Some(fields) = tree.fields() else {
            let message = format!("{kind} needs named fields");
            self.report(
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
                self.report(code::UNKNOWN_FIELD, name.span, message, help);
            } else if found.iter().any(|before| before.name.text == name.text) {
                let message = format!("field `{}` is given twice", name.text);
                self.report(code::BAD_NAME, name.span, message, "keep one of them");
            } else {
                found.push(field);
            }
        }
        found
    }

    fn report_wrong_value(&mut self, kind: &str, field: &Field, wanted: &str) {
        if field.value.is_broken() {
            return;
        }
        let (name, found) = (&field.name.text, field.value.describe());
        let message = format!("field `{name}` of {kind}: expected {wanted}, found {found}");
        self.report(code::WRONG_VALUE, field.value.span, message, "");
    }

    fn report_missing(&mut self, kind: &str, field: &str, span: Span) {
        let message = format!("{kind} needs a field `{field}`");
        self.report(code::MISSING_FIELD, span, message, format!("write `{field}: ..`"));
    }

    /// Reads a `ForEach(..)`; `None` if it has errors.
    pub(super) fn read_for_each(&mut self, tree: &Tree) -> Option<ForEachFields> {
        let before = self.diagnostics.len();
        let fields = self.known_fields(tree, "ForEach", &FOR_EACH_FIELDS);
        let (mut kind, mut over, mut most) = (None, None, None);
        let (mut each, mut number) = (None, None);
        let (mut with, mut links, mut carry) = (Vec::new(), Vec::new(), Vec::new());
        fn name_at(text: &str, span: Span) -> Option<Name> {
            Some(Name { text: text.to_owned(), span })
        }
        for field in fields {
            let draft = self.world.options.draft;
            let Some(value) = resolve_side(&field.value, draft, &mut self.diagnostics) else {
                continue;
            };
            let group = value.fields().filter(|_| is_group(value));
            match (&field.name.text[..], value.text(), group) {
                ("graph", Some(text), _) => kind = name_at(text, value.span),
                ("graph", ..) => {
                    self.report_wrong_value(
                        "ForEach",
                        field,
                        "the name of a node type: \"Feature\"",
                    );
                }
                ("over", ..) => match read_source(value) {
                    Some(found) => over = Some(found),
                    None => self.report_wrong_value("ForEach", field, SOURCE_FORMS),
                },
                ("each", Some(text), _) => each = name_at(&field_of(text), value.span),
                ("each", ..) => {
                    self.report_wrong_value("ForEach", field, "the name of an input: \"spot\"");
                }
                ("number", Some(text), _) => number = name_at(&field_of(text), value.span),
                ("number", ..) => {
                    self.report_wrong_value("ForEach", field, "the name of a parameter: \"rank\"");
                }
                ("most", ..) if is_number(value) => most = Some(value.clone()),
                ("most", ..) => self.report_wrong_value("ForEach", field, "a number of elements"),
                ("with", _, Some(fields)) => with = fields.to_vec(),
                ("links", _, Some(fields)) => links = fields.to_vec(),
                ("carry", _, Some(fields)) => carry = fields.to_vec(),
                _ => self.report_wrong_value(
                    "ForEach",
                    field,
                    "a group of fields: `(field: value, ..)`",
                ),
            }
        }
        for (field, given) in [("graph", kind.is_some()), ("over", over.is_some())] {
            let is_there = tree.fields().is_none_or(|f| f.iter().any(|f| f.name.text == field));
            if !given && !is_there {
                self.report_missing("ForEach", field, tree.span);
            }
        }
        let (Some(kind), Some(over)) = (kind, over) else { return None };
        if let ForEachSource::List(list) = &over {
            for item in list.iter().filter(|item| !is_group(item) && !item.is_broken()) {
                let message =
                    format!("an element of ForEach is a group of fields, not {}", item.describe());
                self.report(code::WRONG_VALUE, item.span, message, "write `(field: value, ..)`");
            }
        }
        if let Some(each) = each.as_ref().filter(|_| !matches!(over, ForEachSource::Data(..))) {
            let what = if matches!(over, ForEachSource::List(_)) { "a list" } else { "a number" };
            let message = format!("field `each` names what takes the data, but `over` is {what}");
            let help = "leave it out; `number` names a parameter that gets 1, 2, ..";
            self.report(code::WRONG_VALUE, each.span, message, help);
        }
        let common = with.into_iter().chain(links).collect();
        let repeated =
            ForEachFields { kind, over, common, carry, each, number, max_elements: most };
        (self.diagnostics.len() == before).then_some(repeated)
    }

    /// Reads the cases of a `Switch(..)`, in the order of the file.
    pub(super) fn read_switch(&mut self, tree: &Tree) -> Option<Branches> {
        let fields = self.known_fields(tree, "Switch", &SWITCH_FIELDS);
        let (mut cases, mut choose) = (None, None);
        for field in fields {
            match (&field.name.text[..], &field.value.kind) {
                ("cases", Kind::Map(entries)) if entries.is_empty() => {
                    let message = "Switch has no cases".to_owned();
                    let help = "write `{\"name\": \"node\", ..}`";
                    self.report(code::MISSING_FIELD, field.value.span, message, help);
                }
                ("cases", Kind::Map(entries)) => cases = self.read_cases(entries),
                ("cases", _) => {
                    self.report_wrong_value("Switch", field, "a map: `{\"name\": \"node\", ..}`");
                }
                _ => choose = Some(field.value.clone()),
            }
        }
        for field in SWITCH_FIELDS {
            if tree.fields().is_some_and(|f| f.iter().all(|f| f.name.text != field)) {
                self.report_missing("Switch", field, tree.span);
            }
        }
        Some(Branches { cases: cases?, choose: choose? })
    }

    fn read_cases(&mut self, entries: &[(Tree, Tree)]) -> Option<Vec<(String, Tree)>> {
        let before = self.diagnostics.len();
        let mut cases: Vec<(String, Tree)> = Vec::with_capacity(entries.len());
        let mut taken = HashSet::new();
        for (key, value) in entries {
            let (Some(name), Some(_)) = (key.text(), value.text()) else {
                let message = "a case of Switch is a name and a link".to_owned();
                self.report(code::WRONG_VALUE, key.span, message, "write `\"name\": \"node\"`");
                continue;
            };
            if !taken.insert(name) {
                let message = format!("there is already a case `{name}`");
                self.report(code::BAD_NAME, key.span, message, "keep one of them");
            }
            cases.push((name.to_owned(), value.clone()));
        }
        (self.diagnostics.len() == before).then_some(cases)
    }
}

impl Branches {
    /// Returns the index of the case whose name is the value `value`.
    ///
    /// # Errors
    /// No case has that name. The error is a message, and the value as a word; the word is empty if the value is not a word, text, number
    /// or truth value.
    pub(super) fn find_case(&self, value: &Tree) -> Result<usize, (String, String)> {
        let word = match &value.kind {
            Kind::Word(word) | Kind::Text(word) => word.clone(),
            Kind::Bool(truth) => truth.to_string(),
            // Adding 0 changes `-0` to `0`.
            Kind::Number { value, .. } => (value + 0.0).to_string(),
            _ => {
                return Err((
                    format!("Switch cannot choose by {}", value.describe()),
                    String::new(),
                ));
            }
        };
        let found = self.cases.iter().position(|(name, _)| *name == word);
        found.ok_or_else(|| (format!("Switch has no case `{word}`"), word))
    }

    /// Returns a suggestion for a word that is not the name of a case.
    pub(super) fn suggest_case(&self, word: &str) -> Help {
        if word.is_empty() {
            return Help::default();
        }
        let names: Vec<_> = self.cases.iter().map(|(name, _)| &name[..]).collect();
        nearest_or_all(word, "its cases", &names)
    }
}

/// Returns the name of an element: `eyes/1` for the index 0 of `eyes`.
pub(super) fn element_name(each: &str, index: usize) -> String {
    format!("{each}/{}", index + 1)
}

const SOURCE_FORMS: &str = "a list `[(rank: 1), ..]`, a link, or a number";

/// Reads the field `over`. `None` if its form is unknown.
fn read_source(tree: &Tree) -> Option<ForEachSource> {
    match &tree.kind {
        Kind::List(items) => Some(ForEachSource::List(items.clone())),
        Kind::Text(_) => Some(ForEachSource::Data(tree.clone(), String::new())),
        _ if is_number(tree) => Some(ForEachSource::Count(tree.clone())),
        Kind::Call { name: Some(name), .. } => {
            let link = tree.call_of(&name.text).filter(|link| link.text().is_some())?;
            Some(ForEachSource::Data(link.clone(), name.text.clone()))
        }
        _ => None,
    }
}

/// Returns true for a number, a `Param` or an `Expr`.
fn is_number(tree: &Tree) -> bool {
    let computed = ["Param", "Expr"].iter().any(|word| tree.call_of(word).is_some());
    computed || matches!(tree.kind, Kind::Number { .. })
}

fn is_group(tree: &Tree) -> bool {
    matches!(&tree.kind, Kind::Call { name: None, body: Body::Fields(_) | Body::Empty })
}
