//! The definitions to which a file may refer: node types, keywords, and the graphs that the file uses, patches or tests.

use std::cell::RefCell;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::OnceLock;

use maquette_golden as golden;
use maquette_graph::catalog::Catalog;
use maquette_graph::{Expectation, Graph, Options, Word, words};
use maquette_syntax::paths::without_dots;
use maquette_syntax::resolve_field;
use serde_json::{Value as Json, json};

use super::expected_syntax::{ExpectedSyntax, FieldInfo, Keys, fields_of, slot_of};
use super::scope::Scope;
use crate::manual::TOPICS;

/// A node type: either built in, or a graph that the file uses as a node.
pub(super) struct NodeKind {
    /// The JSON schema of the inputs and parameters.
    pub(super) schema: Rc<Json>,
    /// The names of the outputs, each with the possible types of its value.
    pub(super) outputs: Vec<(String, Vec<&'static str>)>,
    pub(super) promises: Vec<(String, String)>,
    /// A description of how reproducible the results are.
    pub(super) exactness: String,
    /// The name of the pack that defines the node, or the path of the used graph as the file writes it.
    pub(super) from: String,
    /// The path of the used graph; `None` for a built-in node.
    pub(super) file: Option<PathBuf>,
}

/// The graph that a patch file changes, or that a test file tests.
pub(super) struct TargetGraph {
    path: PathBuf,
    pub(super) scope: Scope,
    /// The JSON schema of the graph's inputs and parameters; `None` if the graph has errors.
    schema: Option<Rc<Json>>,
}

/// The definitions to which a single file may refer.
pub(super) struct Library<'a> {
    pub(super) catalog: &'a Catalog,
    /// The path of the file.
    pub(super) path: &'a Path,
    pub(super) options: &'a Options,
    kinds: RefCell<HashMap<String, Option<Rc<NodeKind>>>>,
    about: RefCell<Option<Option<Rc<TargetGraph>>>>,
}

impl<'a> Library<'a> {
    pub(super) fn new(catalog: &'a Catalog, path: &'a Path, options: &'a Options) -> Self {
        Self { catalog, path, options, kinds: RefCell::default(), about: RefCell::default() }
    }

    /// Resolves a path that is given relative to the folder of this file.
    pub(super) fn resolve(&self, given: &str) -> PathBuf {
        sibling_path(self.path, given)
    }

    /// Returns the node type with this name, or `None` if neither a pack nor the file defines it.
    pub(super) fn kind(&self, scope: &Scope, name: &str) -> Option<Rc<NodeKind>> {
        if let Some(known) = self.kinds.borrow().get(name) {
            return known.clone();
        }
        let found = self.built_in(name).or_else(|| self.used_kind(scope, name)).map(Rc::new);
        self.kinds.borrow_mut().insert(name.to_owned(), found.clone());
        found
    }

    fn built_in(&self, name: &str) -> Option<NodeKind> {
        let described = self.catalog.find(name)?.description();
        Some(NodeKind {
            schema: Rc::new(described.schema.clone()),
            outputs: described.outputs,
            promises: described.promises,
            exactness: described.exactness.describe(),
            from: described.pack.to_owned(),
            file: None,
        })
    }

    fn used_kind(&self, scope: &Scope, name: &str) -> Option<NodeKind> {
        let used = scope.uses.iter().find(|used| used.name.text == name)?;
        let file = self.resolve(&used.kind);
        let (graphs, _) = Graph::subgraphs(&file, self.catalog, self.options);
        // If other files can use the file as a graph, the first item is that graph.
        let graph = graphs.into_iter().next().filter(|graph| Path::new(&graph.file) == file)?;
        let described = graph.description();
        Some(NodeKind {
            schema: Rc::new(described.schema.clone()),
            outputs: described.outputs,
            promises: described.promises,
            exactness: described.exactness.describe(),
            from: used.kind.clone(),
            file: Some(file),
        })
    }

    /// Returns the graph that this patch changes or this test tests. If the file names another patch instead of a graph, returns the graph
    /// that this other patch changes.
    pub(super) fn target(&self, scope: &Scope) -> Option<Rc<TargetGraph>> {
        if let Some(known) = &*self.about.borrow() {
            return known.clone();
        }
        let found = self.find_about(scope).map(Rc::new);
        *self.about.borrow_mut() = Some(found.clone());
        found
    }

    fn find_about(&self, scope: &Scope) -> Option<TargetGraph> {
        let mut path = self.resolve(&scope.target.as_ref()?.text);
        let schema = Graph::load(&path, self.catalog, self.options).graph;
        let schema = schema.map(|graph| Rc::new(graph.schema().clone()));
        // Each step goes from a patch to the file that it patches. The limit of 16 steps ends cycles of patches.
        for _ in 0..16 {
            let scope = Scope::parse(&self.options.text(&path).ok()?);
            match &scope.target {
                Some(next) if scope.file == "Patch" => {
                    path = sibling_path(&path, &next.text);
                }
                _ => return Some(TargetGraph { path, scope, schema }),
            }
        }
        None
    }

    /// Returns the short documentation of a keyword. `within` is the name of the call or field that contains it.
    pub(super) fn word(within: &str, name: &str) -> String {
        let topic = language().iter().filter(|word| word.name == name);
        let topic = topic.max_by_key(|word| word.within == within).map(|word| word.topic);
        let text = TOPICS.iter().find(|known| Some(known.name) == topic).map(|topic| topic.text);
        let Some(text) = text else { return String::new() };
        let starts = format!("- `{name}`");
        let doc = text.lines().position(|line| line.starts_with(&starts));
        let doc = doc.map(|first| {
            let mut lines = text.lines().skip(first);
            let head = lines.next().unwrap_or_default().trim_start_matches("- ").to_owned();
            let rest = lines.take_while(|line| line.starts_with("  "));
            rest.fold(head, |doc, line| format!("{doc} {}", line.trim()))
        });
        let more = topic.map(|topic| format!("`maquette help {topic}` explains more."));
        doc.into_iter().chain(more).collect::<Vec<_>>().join("\n\n")
    }

    /// Returns the keywords that are allowed directly in the call or field `within`.
    pub(super) fn words_in(within: &str) -> Vec<String> {
        let words = language().iter().filter(|word| word.within == within);
        words.map(|word| word.name.clone()).collect()
    }

    fn fields(
        within: &str,
        slot: impl Fn(&str) -> (ExpectedSyntax, &'static str),
    ) -> Rc<Vec<FieldInfo>> {
        let fields = Self::words_in(within).into_iter().map(|name| {
            let (slot, takes) = slot(&name);
            let required = matches!(
                (within, &name[..]),
                ("Graph", "format" | "nodes" | "outputs")
                    | ("Patch", "format" | "of")
                    | ("ForEach", "graph" | "over")
                    | ("Switch", _)
                    | (_, "default")
            );
            let doc = Self::word(within, &name);
            FieldInfo { name, slot, required, takes: takes.to_owned(), doc }
        });
        Rc::new(fields.collect())
    }

    /// Returns the fields of a file that begins with the word `file`, such as `Graph`.
    pub(super) fn file_fields(&self, file: &str) -> Rc<Vec<FieldInfo>> {
        const MAP: &str = "a map: {\"name\": .., ..}";
        fn map(keys: Keys, slot: ExpectedSyntax) -> (ExpectedSyntax, &'static str) {
            (ExpectedSyntax::Map(keys, Rc::new(slot)), MAP)
        }
        fn format() -> (ExpectedSyntax, &'static str) {
            (words_of([("1", "The version of the file format.")]), "1")
        }
        match file {
            "Graph" => Self::fields("Graph", |field| match field {
                "format" => format(),
                "packs" => map(Keys::Packs, ExpectedSyntax::Any),
                "use" => map(Keys::Own, ExpectedSyntax::Use),
                "inputs" => map(Keys::Own, ExpectedSyntax::Input),
                "params" => map(Keys::Own, ExpectedSyntax::Parameter),
                "nodes" => map(Keys::Own, ExpectedSyntax::Node),
                "outputs" => map(Keys::Own, ExpectedSyntax::Link(Vec::new())),
                "promises" => map(Keys::Outputs, ExpectedSyntax::Property(String::new())),
                "expect" => (self.expectations(), "a list: [Closed(\"model.ply\"), ..]"),
                _ => (ExpectedSyntax::Any, "a text"),
            }),
            "Patch" => Self::fields("Patch", |field| match field {
                "format" => format(),
                "of" => (ExpectedSyntax::Path(vec!["ron".into()]), "the path of a graph"),
                "params" => map(Keys::TargetParams, ExpectedSyntax::Any),
                "nodes" => map(Keys::TargetNodes, ExpectedSyntax::Any),
                _ => (ExpectedSyntax::Any, "a text"),
            }),
            "Test" => {
                let root = Rc::new(golden::test_schema());
                let mut fields = fields_of(&root, &root);
                if let Some(fields) = Rc::get_mut(&mut fields) {
                    for field in fields {
                        match &field.name[..] {
                            "graph" => field.slot = ExpectedSyntax::Path(vec!["ron".into()]),
                            "cases" => {
                                field.slot =
                                    ExpectedSyntax::Map(Keys::Own, Rc::new(Self::case(&root)));
                            }
                            "expect" => field.slot = self.expectations(),
                            "compare" => {
                                let tolerance =
                                    &root["properties"]["compare"]["additionalProperties"];
                                let tolerance = resolve_field(tolerance, &root);
                                let fields = fields_of(&tolerance, &root);
                                field.slot = ExpectedSyntax::Map(
                                    Keys::TargetOutputs,
                                    Rc::new(ExpectedSyntax::Group(fields)),
                                );
                            }
                            _ => {}
                        }
                    }
                }
                fields
            }
            "Sweep" => {
                let root = Rc::new(maquette_golden::sweep::schema());
                let mut fields = fields_of(&root, &root);
                let graph =
                    Rc::get_mut(&mut fields).into_iter().flat_map(|fields| fields.iter_mut());
                for field in graph.filter(|field| field.name == "graph") {
                    field.slot = ExpectedSyntax::Path(vec!["ron".into()]);
                }
                fields
            }
            _ => Rc::default(),
        }
    }

    /// Returns the syntax of a case in a test file.
    fn case(root: &Rc<Json>) -> ExpectedSyntax {
        let case = &root["properties"]["cases"]["additionalProperties"];
        let mut fields = fields_of(&resolve_field(case, root), root);
        for field in Rc::get_mut(&mut fields).into_iter().flatten() {
            match &field.name[..] {
                "set" => {
                    field.slot =
                        ExpectedSyntax::Map(Keys::TargetValues, Rc::new(ExpectedSyntax::Any));
                }
                "inputs" => {
                    field.slot = ExpectedSyntax::Map(
                        Keys::TargetInputs,
                        Rc::new(ExpectedSyntax::Path(Vec::new())),
                    );
                }
                _ => {}
            }
        }
        ExpectedSyntax::Group(fields)
    }

    /// Returns the syntax of a list of expectations. Each expectation is about an output or a link.
    fn expectations(&self) -> ExpectedSyntax {
        let mut schema =
            serde_json::to_value(schemars::schema_for!(Expectation)).unwrap_or_default();
        let value = json!({ "type": "string", "format": "expected" });
        for choice in schema["oneOf"].as_array_mut().into_iter().flatten() {
            for content in
                choice["properties"].as_object_mut().into_iter().flat_map(|all| all.values_mut())
            {
                if content["type"] == "string" {
                    *content = value.clone();
                } else if let Some(fields) = content.get_mut("properties") {
                    for name in ["of", "to", "around"] {
                        if let Some(field) = fields.get_mut(name) {
                            field["format"] = "expected".into();
                        }
                    }
                }
            }
        }
        let root = Rc::new(schema);
        ExpectedSyntax::List(Rc::new(ExpectedSyntax::Value { schema: root.clone(), root }))
    }

    /// Returns the fields that the declaration of an input of this type may have.
    pub(super) fn input_fields(&self, kind: &str) -> Rc<Vec<FieldInfo>> {
        Self::fields("inputs", |field| match field {
            "wants" => (
                ExpectedSyntax::List(Rc::new(ExpectedSyntax::Property(kind.to_owned()))),
                "properties: [Closed, ..]",
            ),
            _ => (ExpectedSyntax::Any, "a text"),
        })
    }

    pub(super) fn declaration_fields(&self, kind: &str) -> Rc<Vec<FieldInfo>> {
        fn number() -> Rc<Json> {
            Rc::new(json!({ "type": "number" }))
        }
        Self::fields(kind, |field| match (kind, field) {
            (_, "doc") => (ExpectedSyntax::Any, "a text"),
            (_, "of") => (ExpectedSyntax::Any, "words: [Left, Right]"),
            (_, "unit") => (units(), "the name of a unit"),
            ("Toggle", _) => (words_of([("true", ""), ("false", "")]), "true or false"),
            ("Color", _) => {
                let color = Rc::new(json!({ "type": "string", "format": "color" }));
                (slot_of(&color, &color), "a color: \"#c33923\"")
            }
            ("Number" | "Integer", _) => (slot_of(&number(), &number()), "a number"),
            _ => (ExpectedSyntax::Any, "a value"),
        })
    }

    pub(super) fn use_fields(&self) -> Rc<Vec<FieldInfo>> {
        Rc::new(vec![FieldInfo {
            name: "version".into(),
            slot: ExpectedSyntax::Any,
            required: false,
            takes: "a text".into(),
            doc: "The required version, as in \"2.1\".".into(),
        }])
    }

    /// Returns the fields of a `ForEach` that repeats a node of this type.
    pub(super) fn each_fields(&self, kind: Option<Rc<NodeKind>>) -> Rc<Vec<FieldInfo>> {
        let own = kind.map_or_else(Rc::default, |kind| fields_of(&kind.schema, &kind.schema));
        fn field_slot(
            is_wanted: fn(&FieldInfo) -> bool,
            own: &Rc<Vec<FieldInfo>>,
        ) -> ExpectedSyntax {
            let fields = own.iter().filter(|field| is_wanted(field));
            words_of(fields.map(|field| (&field.name[..], &field.doc[..])))
        }
        Self::fields("ForEach", |field| match field {
            "graph" => (ExpectedSyntax::NodeType, "the name of a node type"),
            "over" => {
                (ExpectedSyntax::Over(own.clone()), "a list `[(rank: 1), ..]`, a link, or a number")
            }
            "with" | "carry" | "links" => {
                (ExpectedSyntax::Group(own.clone()), "fields: `(field: value, ..)`")
            }
            "each" => (field_slot(is_port, &own), "the name of an input"),
            "number" => (field_slot(|field| !is_port(field), &own), "the name of a parameter"),
            _ => (ExpectedSyntax::Any, "a number of elements"),
        })
    }

    pub(super) fn switch_fields(&self) -> Rc<Vec<FieldInfo>> {
        Self::fields("Switch", |field| match field {
            "cases" => (
                ExpectedSyntax::Map(Keys::Own, Rc::new(ExpectedSyntax::Link(Vec::new()))),
                "a map: {\"name\": \"node\", ..}",
            ),
            _ => (ExpectedSyntax::Any, "a word: Param(\"choice\")"),
        })
    }
}

/// Resolves a path relative to the folder that contains the file `path`.
fn sibling_path(path: &Path, given: &str) -> PathBuf {
    without_dots(&path.with_file_name("").join(given))
}

/// Returns all keywords.
fn language() -> &'static [Word] {
    static WORDS: OnceLock<Vec<Word>> = OnceLock::new();
    WORDS.get_or_init(|| words().into_iter().chain(golden::words()).collect())
}

fn is_port(field: &FieldInfo) -> bool {
    matches!(field.slot, ExpectedSyntax::Link(_) | ExpectedSyntax::List(_))
}

fn words_of<'w>(words: impl IntoIterator<Item = (&'w str, &'w str)>) -> ExpectedSyntax {
    ExpectedSyntax::Words(Rc::new(
        words
            .into_iter()
            .map(|(word, doc): (&str, &str)| (word.to_owned(), doc.to_owned()))
            .collect(),
    ))
}

fn units() -> ExpectedSyntax {
    words_of(maquette_syntax::unit_names().map(|unit| (unit, "")))
}

impl TargetGraph {
    /// Returns the kind of value of the graph's parameter `name`. Returns `None` if the graph has no such parameter, or if it has errors.
    pub(super) fn parameter(&self, name: &str) -> Option<ExpectedSyntax> {
        let schema = self.schema.as_ref()?;
        let field = schema.get("properties")?.get(name)?;
        Some(slot_of(field, schema))
    }

    /// Returns the syntax of all fields together of the graph's node `name`. Returns `None` if there is no such node, or if its type is
    /// unknown.
    pub(super) fn node(&self, library: &Library<'_>, name: &str) -> Option<ExpectedSyntax> {
        let node = self.scope.node(name)?;
        let inner = Library::new(library.catalog, &self.path, library.options);
        let kind = match &node.kind[..] {
            "ForEach" => {
                return Some(ExpectedSyntax::Group(
                    inner.each_fields(inner.kind(&self.scope, &node.of)),
                ));
            }
            "Switch" => return Some(ExpectedSyntax::Group(inner.switch_fields())),
            kind => inner.kind(&self.scope, kind)?,
        };
        Some(ExpectedSyntax::Group(fields_of(&kind.schema, &kind.schema)))
    }
}
