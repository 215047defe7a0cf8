//! Determines what may be written at a position of a graph file. The brackets around the position are followed from the outermost one
//! inwards. The schemas of nodes and the keywords define what each bracket may contain.

use std::borrow::Cow;
use std::rc::Rc;

use maquette_graph::catalog::{describe_default, describe_parameter};
use maquette_syntax::{Frame, resolve, resolve_field, unit_names, variants};
use serde_json::Value as Json;

use super::library::Library;
use super::scope::Scope;

/// The kind of value that is expected at a position.
#[derive(Clone)]
pub(super) enum ExpectedSyntax {
    /// The file as a whole, such as `Graph(..)` or `Test(..)`.
    File,
    /// A value that the JSON schema `schema` describes. `root` is the document with the definitions to which the schema refers.
    Value { schema: Rc<Json>, root: Rc<Json> },
    /// A link to a value of one of these types. If the list is empty, the value may have any type.
    Link(Vec<String>),
    /// A node, such as `Threshold(..)`.
    Node,
    /// The name of a node type in quotes, as in `ForEach(graph: "Feature")`.
    NodeType,
    /// The declaration of an input of the graph.
    Input,
    /// The declaration of a parameter of the graph.
    Parameter,
    /// A graph that the file uses, as its path or as `Graph("path", version: "..")`.
    Use,
    /// The name of a parameter of the graph.
    ParameterName,
    /// An expression that uses parameters.
    Expression,
    /// Properties that a value of the named type can have. An empty name stands for any type.
    Property(String),
    /// The path of a file with one of these extensions. If the list is empty, the file may have any extension.
    Path(Vec<String>),
    /// The value that an expectation is about: the name of an output, or a link to a node.
    Expected,
    /// A name that is declared in the graph that this file patches or tests.
    Name(Keys),
    /// The value of the field `over` of a `ForEach`. Its forms in parentheses have these fields.
    Over(Rc<Vec<FieldInfo>>),
    /// One of several keywords. Each has its documentation.
    Words(Rc<Vec<(String, String)>>),
    /// Fields in parentheses. A name may precede the parentheses.
    Group(Rc<Vec<FieldInfo>>),
    /// A list whose items are all of this kind.
    List(Rc<Self>),
    /// A map whose keys and values are of these kinds.
    Map(Keys, Rc<Self>),
    /// A value of unknown kind.
    Any,
}

/// The kind of keys of a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Keys {
    /// Names that the author of the file chooses.
    Own,
    /// Names of the program's packs.
    Packs,
    /// Names of outputs of the graph in this file.
    Outputs,
    /// Names that are declared in the graph that this file patches or tests: its parameters, nodes, inputs or outputs.
    TargetParams,
    TargetNodes,
    TargetInputs,
    TargetOutputs,
    /// Parameters of the graph that this file patches or tests, and fields of its nodes, written as `node.field`.
    TargetValues,
}

/// The content of a pair of brackets.
pub(super) enum BracketContent {
    /// The name of a call, and the fields that it may have.
    Fields(String, Rc<Vec<FieldInfo>>),
    /// Map entries with keys of this kind.
    Entries(Keys),
    /// A sequence of values.
    Items,
    /// Unknown content.
    Unknown,
}

/// A field that a call may have.
pub(super) struct FieldInfo {
    pub(super) name: String,
    pub(super) slot: ExpectedSyntax,
    pub(super) required: bool,
    /// The type and the default of the field on one line, such as `number from 0 mm = 2.0`.
    pub(super) takes: String,
    pub(super) doc: String,
}

/// Returns the fields that a node's JSON schema describes, including its ports.
pub(super) fn fields_of(schema: &Json, root: &Rc<Json>) -> Rc<Vec<FieldInfo>> {
    let required = schema["required"].as_array().into_iter().flatten().filter_map(Json::as_str);
    let required = required.collect::<Vec<_>>();
    let properties = schema["properties"].as_object().into_iter().flatten();
    Rc::new(
        properties
            .map(|(name, field): (&String, &Json)| FieldInfo {
                name: name.clone(),
                slot: slot_of(field, root),
                required: required.contains(&&name[..]),
                takes: takes(field, root),
                doc: field["description"].as_str().unwrap_or_default().to_owned(),
            })
            .collect(),
    )
}

/// Describes the type and the default of a field on one line, such as `number from 0 mm = 2.0`.
pub(super) fn takes(field: &Json, root: &Json) -> String {
    fn types(port: &Json) -> String {
        let types = port["types"].as_array().into_iter().flatten().filter_map(Json::as_str);
        types.collect::<Vec<_>>().join(" or ")
    }
    match (field.get("port"), field["items"].get("port")) {
        (Some(_), _) => types(field),
        (None, Some(_)) => format!("[{}, ..]", types(&field["items"])),
        _ => describe_parameter(field, root) + &describe_default(field, root),
    }
}

/// Returns the kind of value that a JSON schema allows.
pub(super) fn slot_of(schema: &Json, root: &Rc<Json>) -> ExpectedSyntax {
    let schema = resolve_field(schema, root);
    fn strings(list: &Json) -> Vec<String> {
        let strings = list.as_array().into_iter().flatten().filter_map(Json::as_str);
        strings.map(str::to_owned).collect::<Vec<_>>()
    }
    if schema["format"] == "expected" {
        return ExpectedSyntax::Expected;
    }
    if let Some(names) = names_of(&schema["format"]) {
        return ExpectedSyntax::Name(names);
    }
    if schema.get("port").is_some() {
        return ExpectedSyntax::Link(strings(&schema["types"]));
    }
    if schema["items"].get("port").is_some() {
        return ExpectedSyntax::List(Rc::new(ExpectedSyntax::Link(strings(
            &schema["items"]["types"],
        ))));
    }
    if schema["format"] == "file" || schema.get("endings").is_some() {
        return ExpectedSyntax::Path(strings(&schema["endings"]));
    }
    ExpectedSyntax::Value { schema: Rc::new(schema.into_owned()), root: root.clone() }
}

/// Returns the kind of name that a string with this schema format contains, or `None` if the string is not a name.
fn names_of(format: &Json) -> Option<Keys> {
    match format.as_str()? {
        "target" => Some(Keys::TargetValues),
        "input" => Some(Keys::TargetInputs),
        "output" => Some(Keys::TargetOutputs),
        _ => None,
    }
}

/// Determines what may be written at a position, by following the brackets from the outermost one inwards.
pub(super) struct SyntaxResolver<'a> {
    pub(super) library: &'a Library<'a>,
    pub(super) scope: &'a Scope,
}

impl SyntaxResolver<'_> {
    /// Returns the content of the innermost bracket, and the kind of value that is expected at the position.
    pub(super) fn resolve(&self, frames: &[Frame]) -> (BracketContent, ExpectedSyntax) {
        let (mut slot, mut within) = (ExpectedSyntax::File, BracketContent::Unknown);
        for (depth, frame) in frames.iter().enumerate() {
            (within, slot) = self.content_of(&slot, frame, &frames[..depth]);
        }
        (within, slot)
    }

    /// Returns the content of the bracket `frame`, and the kind of value expected at the position in it. `slot` is the kind of value of
    /// which the bracket is a part, and `around` are the outer brackets.
    fn content_of(
        &self,
        slot: &ExpectedSyntax,
        frame: &Frame,
        around: &[Frame],
    ) -> (BracketContent, ExpectedSyntax) {
        let name = frame.name.as_ref().map_or("", |name| &name.text[..]);
        fn items(slot: ExpectedSyntax) -> (BracketContent, ExpectedSyntax) {
            (BracketContent::Items, slot)
        }
        let fields = |owner: &str, fields: Rc<Vec<FieldInfo>>| {
            let named = frame.field.as_ref();
            let found = named.and_then(|name| fields.iter().find(|it| it.name == name.text));
            let slot = found.map_or(ExpectedSyntax::Any, |field| field.slot.clone());
            (BracketContent::Fields(owner.to_owned(), fields), slot)
        };
        if frame.bracket == '('
            && !matches!(
                slot,
                ExpectedSyntax::File | ExpectedSyntax::Node | ExpectedSyntax::Map(..)
            )
        {
            match name {
                "Param" => return items(ExpectedSyntax::ParameterName),
                "Expr" => return items(ExpectedSyntax::Expression),
                "Some" | "Optional" => return items(slot.clone()),
                "Draft" => return fields(name, Rc::new(draft_fields(slot))),
                _ if unit_names().any(|unit| unit == name) => return items(ExpectedSyntax::Any),
                _ => {}
            }
        }
        match (slot, frame.bracket) {
            (ExpectedSyntax::File, '(') => fields(name, self.library.file_fields(name)),
            (ExpectedSyntax::Node, '(') => fields(name, self.node_fields(name, around)),
            (ExpectedSyntax::Input, '(') => fields(name, self.library.input_fields(name)),
            (ExpectedSyntax::Parameter, '(') => fields(name, self.library.declaration_fields(name)),
            (ExpectedSyntax::Use, '(') if frame.index == 0 => {
                items(ExpectedSyntax::Path(vec!["ron".into()]))
            }
            (ExpectedSyntax::Use, '(') => fields(name, self.library.use_fields()),
            (ExpectedSyntax::Group(all) | ExpectedSyntax::Over(all), '(')
                if name.is_empty() || !matches!(slot, ExpectedSyntax::Over(_)) =>
            {
                fields(name, all.clone())
            }
            (ExpectedSyntax::Over(_), '[') => items(slot.clone()),
            (ExpectedSyntax::Over(_), _) => items(ExpectedSyntax::Link(Vec::new())),
            (ExpectedSyntax::List(item), '[') => items((**item).clone()),
            (ExpectedSyntax::Property(_), _) => items(slot.clone()),
            (ExpectedSyntax::Map(keys, value), '{') => {
                let key = frame.field.as_ref().map(|key| &key.text[..]);
                let of_key = key.and_then(|key| self.value_of(*keys, key));
                (BracketContent::Entries(*keys), of_key.unwrap_or_else(|| (**value).clone()))
            }
            (ExpectedSyntax::Value { schema, root }, _) => self.value(schema, root, frame, fields),
            _ => (BracketContent::Unknown, ExpectedSyntax::Any),
        }
    }

    /// Returns the same as `content_of`, for a bracket that is part of a value with a JSON schema.
    fn value(
        &self,
        schema: &Json,
        root: &Rc<Json>,
        frame: &Frame,
        fields: impl Fn(&str, Rc<Vec<FieldInfo>>) -> (BracketContent, ExpectedSyntax),
    ) -> (BracketContent, ExpectedSyntax) {
        fn items(schema: &Json, root: &Rc<Json>) -> (BracketContent, ExpectedSyntax) {
            (BracketContent::Items, slot_of(schema, root))
        }
        let name = frame.name.as_ref().map_or("", |name| &name.text[..]);
        let content = variants(schema).into_iter().find(|(choice, _)| *choice == name);
        let (schema, is_choice) = match content {
            Some((_, None)) => return (BracketContent::Unknown, ExpectedSyntax::Any),
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
            return (BracketContent::Entries(keys), of_key.unwrap_or_else(|| slot_of(value, root)));
        }
        let fixed = schema.get("prefixItems").and_then(|all| all.get(frame.index));
        match (fixed, schema.get("items")) {
            (Some(item), _) => items(item, root),
            // The parentheses of an enum variant contain the value of the variant, which may be a list.
            (None, _) if is_choice => items(&schema, root),
            (None, Some(item)) => items(item, root),
            (None, None) => (BracketContent::Unknown, ExpectedSyntax::Any),
        }
    }

    /// Returns the kind of value that belongs to the map key `key`. Returns `None` if all keys of the map have values of the same kind, or
    /// if the key is unknown.
    fn value_of(&self, keys: Keys, key: &str) -> Option<ExpectedSyntax> {
        if !matches!(keys, Keys::TargetParams | Keys::TargetNodes | Keys::TargetValues) {
            return None;
        }
        let target = self.library.target(self.scope)?;
        match (keys, key.split_once('.')) {
            (Keys::TargetParams, _) | (Keys::TargetValues, None) => target.parameter(key),
            (_, found) => {
                let (node, path) = found.unwrap_or((key, ""));
                self.follow_path(target.node(self.library, node)?, path)
            }
        }
    }

    /// Returns the kind of value to which a path of field names leads. The path starts at a value of the kind `slot`.
    fn follow_path(&self, slot: ExpectedSyntax, way: &str) -> Option<ExpectedSyntax> {
        way.split('.').filter(|step| !step.is_empty()).try_fold(slot, |slot, step| {
            let fields = match &slot {
                ExpectedSyntax::Group(fields) => fields.clone(),
                ExpectedSyntax::Value { schema, root } => fields_of(schema, root),
                _ => return None,
            };
            fields.iter().find(|field| field.name == step).map(|field| field.slot.clone())
        })
    }

    /// Returns the fields that a node of type `name` may have. `around` are the brackets around the node.
    fn node_fields(&self, name: &str, around: &[Frame]) -> Rc<Vec<FieldInfo>> {
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

/// Returns the fields of a `Draft(..)` that is written instead of a value of the kind `slot`.
fn draft_fields(slot: &ExpectedSyntax) -> Vec<FieldInfo> {
    fn side(name: &str, doc: &str, slot: &ExpectedSyntax) -> FieldInfo {
        FieldInfo {
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
