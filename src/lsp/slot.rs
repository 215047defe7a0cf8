//! What may stand at a place of a file: followed from the outermost bracket inwards, by the schemas of nodes and the words of the language.

use std::borrow::Cow;
use std::rc::Rc;

use maquette_graph::catalog::{describe_default, describe_parameter};
use maquette_syntax::{Frame, inside, resolve, unit_names, variants};
use serde_json::Value as Json;

use super::library::Library;
use super::scope::Scope;

/// What may stand as a value at a place.
#[derive(Clone)]
pub(super) enum Slot {
    /// The whole of a file.
    File,
    /// What a schema describes; `root` has what it refers to.
    Value { schema: Rc<Json>, root: Rc<Json> },
    /// A link to a value of one of these types; of any, if there is none.
    Link(Vec<String>),
    /// A node: `Threshold(..)`.
    Node,
    /// The name of a type of nodes in quotes, as in `ForEach(graph: "Feature")`.
    NodeType,
    /// The type of an input.
    Input,
    /// The declaration of a parameter.
    Parameter,
    /// A used graph: its path, or `Graph("path", version: "..")`.
    Use,
    /// The name of a parameter of the graph.
    ParameterName,
    /// An expression of parameters.
    Expression,
    /// Properties that values of a type may have; of any type, if it is empty.
    Property(String),
    /// A file with one of these endings; with any, if there is none.
    Path(Vec<String>),
    /// The name of an output or a link.
    Expected,
    /// A name of what this file is about.
    Name(Keys),
    /// What a `ForEach` goes over.
    Over(Rc<Vec<FieldOf>>),
    /// One of some words, each with what is said of it.
    Words(Rc<Vec<(String, String)>>),
    /// Some fields in parentheses, with no name or any name before these.
    Group(Rc<Vec<FieldOf>>),
    /// A list of such values.
    List(Rc<Self>),
    /// A map to such values.
    Map(Keys, Rc<Self>),
    /// A value of which nothing is known.
    Any,
}

/// What the keys of a map may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Keys {
    /// The author's own names.
    Own,
    /// Packs of the program.
    Packs,
    /// Outputs of this graph.
    Outputs,
    /// Parameters, nodes, inputs and outputs of the graph that this file is about.
    AboutParams,
    AboutNodes,
    AboutInputs,
    AboutOutputs,
    /// Its parameters, and fields of its nodes as `node.field`.
    AboutValues,
}

/// What stands between two brackets.
pub(super) enum Inside {
    /// Named fields of what has this name.
    Fields(String, Rc<Vec<FieldOf>>),
    /// Keys, each with a value.
    Entries(Keys),
    /// Values one after the other.
    Items,
    /// Whatever it is, nothing is known of it.
    Unknown,
}

/// A field that a call may have.
pub(super) struct FieldOf {
    pub(super) name: String,
    pub(super) slot: Slot,
    pub(super) required: bool,
    /// What it takes and its default, on a line: `number from 0 mm = 2.0`.
    pub(super) takes: String,
    pub(super) doc: String,
}

/// The fields of a schema; ports among them.
pub(super) fn fields_of(schema: &Json, root: &Rc<Json>) -> Rc<Vec<FieldOf>> {
    let required = schema["required"].as_array().into_iter().flatten().filter_map(Json::as_str);
    let required = Vec::from_iter(required);
    let properties = schema["properties"].as_object().into_iter().flatten();
    Rc::new(
        properties
            .map(|(name, field): (&String, &Json)| FieldOf {
                name: name.clone(),
                slot: slot_of(field, root),
                required: required.contains(&&name[..]),
                takes: takes(field, root),
                doc: field["description"].as_str().unwrap_or_default().to_owned(),
            })
            .collect(),
    )
}

/// What a field takes and its default, on a line.
pub(super) fn takes(field: &Json, root: &Json) -> String {
    fn types(port: &Json) -> String {
        let types = port["types"].as_array().into_iter().flatten().filter_map(Json::as_str);
        Vec::from_iter(types).join(" or ")
    }
    match (field.get("port"), field["items"].get("port")) {
        (Some(_), _) => types(field),
        (None, Some(_)) => format!("[{}, ..]", types(&field["items"])),
        _ => describe_parameter(field, root) + &describe_default(field, root),
    }
}

/// What may stand where a schema describes the value.
pub(super) fn slot_of(schema: &Json, root: &Rc<Json>) -> Slot {
    let schema = inside(schema, root);
    fn strings(list: &Json) -> Vec<String> {
        let strings = list.as_array().into_iter().flatten().filter_map(Json::as_str);
        strings.map(str::to_owned).collect::<Vec<_>>()
    }
    if schema["format"] == "expected" {
        return Slot::Expected;
    }
    if let Some(names) = names_of(&schema["format"]) {
        return Slot::Name(names);
    }
    if schema.get("port").is_some() {
        return Slot::Link(strings(&schema["types"]));
    }
    if schema["items"].get("port").is_some() {
        return Slot::List(Rc::new(Slot::Link(strings(&schema["items"]["types"]))));
    }
    if schema["format"] == "file" || schema.get("endings").is_some() {
        return Slot::Path(strings(&schema["endings"]));
    }
    Slot::Value { schema: Rc::new(schema.into_owned()), root: root.clone() }
}

/// The names that a text of this format is one of.
fn names_of(format: &Json) -> Option<Keys> {
    match format.as_str()? {
        "target" => Some(Keys::AboutValues),
        "input" => Some(Keys::AboutInputs),
        "output" => Some(Keys::AboutOutputs),
        _ => None,
    }
}

/// Follows brackets inwards.
pub(super) struct Slots<'a> {
    pub(super) library: &'a Library<'a>,
    pub(super) scope: &'a Scope,
}

impl Slots<'_> {
    /// What stands inside of the innermost bracket, and the value that is due there, as far as its field is known.
    pub(super) fn at(&self, frames: &[Frame]) -> (Inside, Slot) {
        let (mut slot, mut within) = (Slot::File, Inside::Unknown);
        for (depth, frame) in frames.iter().enumerate() {
            (within, slot) = self.inside(&slot, frame, &frames[..depth]);
        }
        (within, slot)
    }

    /// What a bracket holds that opens the value of a slot, and the slot of the value that is due in it.
    fn inside(&self, slot: &Slot, frame: &Frame, around: &[Frame]) -> (Inside, Slot) {
        let name = frame.name.as_ref().map_or("", |name| &name.text[..]);
        fn items(slot: Slot) -> (Inside, Slot) {
            (Inside::Items, slot)
        }
        let fields = |owner: &str, fields: Rc<Vec<FieldOf>>| {
            let named = frame.field.as_ref();
            let found = named.and_then(|name| fields.iter().find(|it| it.name == name.text));
            let slot = found.map_or(Slot::Any, |field| field.slot.clone());
            (Inside::Fields(owner.to_owned(), fields), slot)
        };
        if frame.bracket == '(' && !matches!(slot, Slot::File | Slot::Node | Slot::Map(..)) {
            match name {
                "Param" => return items(Slot::ParameterName),
                "Expr" => return items(Slot::Expression),
                "Some" | "Optional" => return items(slot.clone()),
                "Draft" => return fields(name, Rc::new(draft_fields(slot))),
                _ if unit_names().any(|unit| unit == name) => return items(Slot::Any),
                _ => {}
            }
        }
        match (slot, frame.bracket) {
            (Slot::File, '(') => fields(name, self.library.file_fields(name)),
            (Slot::Node, '(') => fields(name, self.node_fields(name, around)),
            (Slot::Input, '(') => fields(name, self.library.input_fields(name)),
            (Slot::Parameter, '(') => fields(name, self.library.declaration_fields(name)),
            (Slot::Use, '(') if frame.index == 0 => items(Slot::Path(vec!["ron".into()])),
            (Slot::Use, '(') => fields(name, self.library.use_fields()),
            (Slot::Group(all) | Slot::Over(all), '(')
                if name.is_empty() || !matches!(slot, Slot::Over(_)) =>
            {
                fields(name, all.clone())
            }
            (Slot::Over(_), '[') => items(slot.clone()),
            (Slot::Over(_), _) => items(Slot::Link(Vec::new())),
            (Slot::List(item), '[') => items((**item).clone()),
            (Slot::Property(_), _) => items(slot.clone()),
            (Slot::Map(keys, value), '{') => {
                let key = frame.field.as_ref().map(|key| &key.text[..]);
                let of_key = key.and_then(|key| self.value_of(*keys, key));
                (Inside::Entries(*keys), of_key.unwrap_or_else(|| (**value).clone()))
            }
            (Slot::Value { schema, root }, _) => self.value(schema, root, frame, fields),
            _ => (Inside::Unknown, Slot::Any),
        }
    }

    /// What a schema says of a value that a bracket opens.
    fn value(
        &self,
        schema: &Json,
        root: &Rc<Json>,
        frame: &Frame,
        fields: impl Fn(&str, Rc<Vec<FieldOf>>) -> (Inside, Slot),
    ) -> (Inside, Slot) {
        fn items(schema: &Json, root: &Rc<Json>) -> (Inside, Slot) {
            (Inside::Items, slot_of(schema, root))
        }
        let name = frame.name.as_ref().map_or("", |name| &name.text[..]);
        let content = variants(schema).into_iter().find(|(choice, _)| *choice == name);
        let (schema, is_choice) = match content {
            Some((_, None)) => return (Inside::Unknown, Slot::Any),
            Some((_, Some(content))) => (resolve(root, content), true),
            None => (Cow::Borrowed(schema), false),
        };
        if schema.get("properties").is_some() {
            return fields(name, fields_of(&schema, root));
        }
        if let Some(value) = schema.get("additionalProperties").filter(|it| **it != false) {
            let keys = names_of(&schema["propertyNames"]["format"]).unwrap_or(Keys::Own);
            let key = frame.field.as_ref().map(|key| &key.text[..]);
            let of_key = key.and_then(|key| self.value_of(keys, key));
            return (Inside::Entries(keys), of_key.unwrap_or_else(|| slot_of(value, root)));
        }
        let fixed = schema.get("prefixItems").and_then(|all| all.get(frame.index));
        match (fixed, schema.get("items")) {
            (Some(item), _) => items(item, root),
            // In the parentheses of a choice stands its value, which may be a list.
            (None, _) if is_choice => items(&schema, root),
            (None, Some(item)) => items(item, root),
            (None, None) => (Inside::Unknown, Slot::Any),
        }
    }

    /// The value of a key, where that hangs on the key.
    fn value_of(&self, keys: Keys, key: &str) -> Option<Slot> {
        let about = || self.library.about(self.scope);
        match keys {
            Keys::AboutParams => about()?.parameter(key),
            Keys::AboutNodes => {
                let (node, way) = key.split_once('.').unwrap_or((key, ""));
                self.along(about()?.node(self.library, node)?, way)
            }
            Keys::AboutValues => match key.split_once('.') {
                None => about()?.parameter(key),
                Some((node, way)) => self.along(about()?.node(self.library, node)?, way),
            },
            _ => None,
        }
    }

    /// What stands at the end of a way through fields.
    fn along(&self, slot: Slot, way: &str) -> Option<Slot> {
        way.split('.').filter(|step| !step.is_empty()).try_fold(slot, |slot, step| {
            let fields = match &slot {
                Slot::Group(fields) => fields.clone(),
                Slot::Value { schema, root } => fields_of(schema, root),
                _ => return None,
            };
            fields.iter().find(|field| field.name == step).map(|field| field.slot.clone())
        })
    }

    /// The fields of a node.
    fn node_fields(&self, name: &str, around: &[Frame]) -> Rc<Vec<FieldOf>> {
        let node = around.last().and_then(|nodes| nodes.field.as_ref());
        let declared = node.and_then(|node| self.scope.node(&node.text));
        let of = declared.map(|node| &node.of[..]).filter(|of| !of.is_empty());
        match name {
            "ForEach" => {
                self.library.each_fields(of.and_then(|of| self.library.kind(self.scope, of)))
            }
            "Switch" => self.library.switch_fields(),
            _ => match self.library.kind(self.scope, name) {
                Some(kind) => fields_of(&kind.schema, &kind.schema),
                None => Rc::default(),
            },
        }
    }
}

/// The sides of a `Draft(..)` in the place of such a value.
fn draft_fields(slot: &Slot) -> Vec<FieldOf> {
    fn side(name: &str, doc: &str, slot: &Slot) -> FieldOf {
        FieldOf {
            name: name.into(),
            slot: slot.clone(),
            required: true,
            takes: String::new(),
            doc: doc.into(),
        }
    }
    vec![
        side("final", "The value of final results.", slot),
        side("draft", "The value of drafts.", slot),
    ]
}
