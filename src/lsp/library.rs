//! What a file may name that stands elsewhere: types of nodes, graphs that it uses or is about, words of the language.

use std::cell::RefCell;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::OnceLock;

use maquette_golden as golden;
use maquette_graph::catalog::Catalog;
use maquette_graph::{Expectation, Graph, Options, Word, words};
use maquette_syntax::inside;
use maquette_syntax::paths::without_dots;
use serde_json::{Value as Json, json};

use super::scope::Scope;
use super::slot::{FieldOf, Keys, Slot, fields_of, slot_of};
use crate::language::TOPICS;

/// A type of nodes: built in, or a graph.
pub(super) struct NodeKind {
    /// Inputs and parameters.
    pub(super) schema: Rc<Json>,
    /// Names, and the types of values that each may give.
    pub(super) outputs: Vec<(String, Vec<&'static str>)>,
    pub(super) promises: Vec<(String, String)>,
    /// How equal its results are on all machines, in words.
    pub(super) exactness: String,
    /// The pack that has it, or the file of the graph as it is written.
    pub(super) from: String,
    /// The file of the graph.
    pub(super) file: Option<PathBuf>,
}

/// A graph that a patch or a test is about.
pub(super) struct About {
    path: PathBuf,
    pub(super) scope: Scope,
    /// Inputs and parameters; none if the graph has problems.
    schema: Option<Rc<Json>>,
}

/// What one file may name.
pub(super) struct Library<'a> {
    pub(super) catalog: &'a Catalog,
    /// The file.
    pub(super) path: &'a Path,
    pub(super) options: &'a Options,
    kinds: RefCell<HashMap<String, Option<Rc<NodeKind>>>>,
    about: RefCell<Option<Option<Rc<About>>>>,
}

impl<'a> Library<'a> {
    pub(super) fn new(catalog: &'a Catalog, path: &'a Path, options: &'a Options) -> Self {
        Self { catalog, path, options, kinds: RefCell::default(), about: RefCell::default() }
    }

    /// The path of a file that is named in this one.
    pub(super) fn resolved(&self, given: &str) -> PathBuf {
        beside(self.path, given)
    }

    /// The type of nodes of this name.
    pub(super) fn kind(&self, scope: &Scope, name: &str) -> Option<Rc<NodeKind>> {
        if let Some(known) = self.kinds.borrow().get(name) {
            return known.clone();
        }
        let found = self.built_in(name).or_else(|| self.used(scope, name)).map(Rc::new);
        self.kinds.borrow_mut().insert(name.to_owned(), found.clone());
        found
    }

    fn built_in(&self, name: &str) -> Option<NodeKind> {
        let described = self.catalog.find(name)?.description();
        Some(NodeKind {
            schema: Rc::new(described.schema.clone()),
            outputs: described.outputs,
            promises: described.promises,
            exactness: described.exactness.in_words(),
            from: described.pack.to_owned(),
            file: None,
        })
    }

    fn used(&self, scope: &Scope, name: &str) -> Option<NodeKind> {
        let used = scope.uses.iter().find(|used| used.name.text == name)?;
        let file = self.resolved(&used.kind);
        let (graphs, _) = Graph::subgraphs(&file, self.catalog, self.options);
        // The graph itself is the first one, if it is one that can be used.
        let graph = graphs.into_iter().next().filter(|graph| Path::new(&graph.file) == file)?;
        let described = graph.description();
        Some(NodeKind {
            schema: Rc::new(described.schema.clone()),
            outputs: described.outputs,
            promises: described.promises,
            exactness: described.exactness.in_words(),
            from: used.kind.clone(),
            file: Some(file),
        })
    }

    /// The graph that a patch or a test is about; that of a patch of a patch is the first graph.
    pub(super) fn about(&self, scope: &Scope) -> Option<Rc<About>> {
        if let Some(known) = &*self.about.borrow() {
            return known.clone();
        }
        let found = self.find_about(scope).map(Rc::new);
        *self.about.borrow_mut() = Some(found.clone());
        found
    }

    fn find_about(&self, scope: &Scope) -> Option<About> {
        let mut path = self.resolved(&scope.about.as_ref()?.text);
        let schema = Graph::load(&path, self.catalog, self.options).graph;
        let schema = schema.map(|graph| Rc::new(graph.schema().clone()));
        // Patches of patches, but not in a circle.
        for _ in 0..16 {
            let scope = Scope::of(&self.options.text(&path).ok()?);
            match &scope.about {
                Some(next) if scope.file == "Patch" => {
                    path = beside(&path, &next.text);
                }
                _ => return Some(About { path, scope, schema }),
            }
        }
        None
    }

    /// What the language's documentation says of a word, in a sentence or two.
    pub(super) fn word(within: &str, name: &str) -> String {
        let topic = language().iter().filter(|word| word.name == name);
        let topic = topic.max_by_key(|word| word.within == within).map(|word| word.topic);
        let text = TOPICS.iter().find(|known| Some(known.name) == topic).map(|topic| topic.text);
        let Some(text) = text else { return String::new() };
        let starts = format!("- `{name}`");
        let told = text.lines().position(|line| line.starts_with(&starts));
        let told = told.map(|first| {
            let mut lines = text.lines().skip(first);
            let head = lines.next().unwrap_or_default().trim_start_matches("- ").to_owned();
            let rest = lines.take_while(|line| line.starts_with("  "));
            rest.fold(head, |told, line| format!("{told} {}", line.trim()))
        });
        let more = topic.map(|topic| format!("`maquette help {topic}` tells more."));
        told.into_iter().chain(more).collect::<Vec<_>>().join("\n\n")
    }

    /// The words that the language has in a call or field.
    pub(super) fn words_in(within: &str) -> Vec<String> {
        let words = language().iter().filter(|word| word.within == within);
        words.map(|word| word.name.clone()).collect()
    }

    fn fields(within: &str, slot: impl Fn(&str) -> (Slot, &'static str)) -> Rc<Vec<FieldOf>> {
        let field = |name: String| {
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
            FieldOf { name, slot, required, takes: takes.to_owned(), doc }
        };
        Rc::new(Self::words_in(within).into_iter().map(field).collect())
    }

    /// The fields of a file that begins with this word.
    pub(super) fn file_fields(&self, file: &str) -> Rc<Vec<FieldOf>> {
        const MAP: &str = "a map: {\"name\": .., ..}";
        let map = |keys, slot| (Slot::Map(keys, Rc::new(slot)), MAP);
        let format = || (words_of([("1", "The version of the file format.")]), "1");
        match file {
            "Graph" => Self::fields("Graph", |field| match field {
                "format" => format(),
                "packs" => map(Keys::Packs, Slot::Any),
                "use" => map(Keys::Own, Slot::Use),
                "inputs" => map(Keys::Own, Slot::Input),
                "params" => map(Keys::Own, Slot::Parameter),
                "nodes" => map(Keys::Own, Slot::Node),
                "outputs" => map(Keys::Own, Slot::Link(Vec::new())),
                "promises" => map(Keys::Outputs, Slot::Property(String::new())),
                "expect" => (self.expectations(), "a list: [Closed(\"model.ply\"), ..]"),
                _ => (Slot::Any, "a text"),
            }),
            "Patch" => Self::fields("Patch", |field| match field {
                "format" => format(),
                "of" => (Slot::Path(vec!["ron".into()]), "the path of a graph"),
                "params" => map(Keys::AboutParams, Slot::Any),
                "nodes" => map(Keys::AboutNodes, Slot::Any),
                _ => (Slot::Any, "a text"),
            }),
            "Test" => {
                let root = Rc::new(golden::test_schema());
                let mut fields = fields_of(&root, &root);
                if let Some(fields) = Rc::get_mut(&mut fields) {
                    for field in fields {
                        match &field.name[..] {
                            "graph" => field.slot = Slot::Path(vec!["ron".into()]),
                            "cases" => {
                                field.slot = Slot::Map(Keys::Own, Rc::new(Self::case(&root)));
                            }
                            "expect" => field.slot = self.expectations(),
                            "compare" => {
                                let tolerance =
                                    &root["properties"]["compare"]["additionalProperties"];
                                let tolerance = inside(tolerance, &root);
                                let fields = fields_of(&tolerance, &root);
                                field.slot =
                                    Slot::Map(Keys::AboutOutputs, Rc::new(Slot::Group(fields)));
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
                    field.slot = Slot::Path(vec!["ron".into()]);
                }
                fields
            }
            _ => Rc::default(),
        }
    }

    /// A case of a test.
    fn case(root: &Rc<Json>) -> Slot {
        let case = &root["properties"]["cases"]["additionalProperties"];
        let mut fields = fields_of(&inside(case, root), root);
        for field in Rc::get_mut(&mut fields).into_iter().flatten() {
            match &field.name[..] {
                "set" => field.slot = Slot::Map(Keys::AboutValues, Rc::new(Slot::Any)),
                "inputs" => {
                    field.slot = Slot::Map(Keys::AboutInputs, Rc::new(Slot::Path(Vec::new())));
                }
                _ => {}
            }
        }
        Slot::Group(fields)
    }

    /// A list of expectations. What they speak of is an output or a link.
    fn expectations(&self) -> Slot {
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
        Slot::List(Rc::new(Slot::Value { schema: root.clone(), root }))
    }

    /// The fields of an input's declaration.
    pub(super) fn input_fields(&self, kind: &str) -> Rc<Vec<FieldOf>> {
        Self::fields("inputs", |field| match field {
            "wants" => {
                (Slot::List(Rc::new(Slot::Property(kind.to_owned()))), "properties: [Closed, ..]")
            }
            _ => (Slot::Any, "a text"),
        })
    }

    pub(super) fn declaration_fields(&self, kind: &str) -> Rc<Vec<FieldOf>> {
        fn number() -> Rc<Json> {
            Rc::new(json!({ "type": "number" }))
        }
        Self::fields(kind, |field| match (kind, field) {
            (_, "doc") => (Slot::Any, "a text"),
            (_, "of") => (Slot::Any, "words: [Left, Right]"),
            (_, "unit") => (units(), "the name of a unit"),
            ("Toggle", _) => (words_of([("true", ""), ("false", "")]), "true or false"),
            ("Color", _) => {
                let color = Rc::new(json!({ "type": "string", "format": "color" }));
                (slot_of(&color, &color), "a color: \"#c33923\"")
            }
            ("Number" | "Integer", _) => (slot_of(&number(), &number()), "a number"),
            _ => (Slot::Any, "a value"),
        })
    }

    pub(super) fn use_fields(&self) -> Rc<Vec<FieldOf>> {
        Rc::new(vec![FieldOf {
            name: "version".into(),
            slot: Slot::Any,
            required: false,
            takes: "a text".into(),
            doc: "The version that is wanted, as in \"2.1\".".into(),
        }])
    }

    /// The fields of a `ForEach` whose nodes are of this type.
    pub(super) fn each_fields(&self, kind: Option<Rc<NodeKind>>) -> Rc<Vec<FieldOf>> {
        let own = kind.map_or_else(Rc::default, |kind| fields_of(&kind.schema, &kind.schema));
        fn named(is_wanted: fn(&FieldOf) -> bool, own: &Rc<Vec<FieldOf>>) -> Slot {
            let fields = own.iter().filter(|field| is_wanted(field));
            words_of(fields.map(|field| (&field.name[..], &field.doc[..])))
        }
        Self::fields("ForEach", |field| match field {
            "graph" => (Slot::NodeType, "the name of a node type"),
            "over" => (Slot::Over(own.clone()), "a list `[(rank: 1), ..]`, a link, or a number"),
            "with" | "carry" | "links" => {
                (Slot::Group(own.clone()), "fields: `(field: value, ..)`")
            }
            "each" => (named(is_port, &own), "the name of an input"),
            "number" => (named(|field| !is_port(field), &own), "the name of a parameter"),
            _ => (Slot::Any, "a number of elements"),
        })
    }

    pub(super) fn switch_fields(&self) -> Rc<Vec<FieldOf>> {
        Self::fields("Switch", |field| match field {
            "cases" => (
                Slot::Map(Keys::Own, Rc::new(Slot::Link(Vec::new()))),
                "a map: {\"name\": \"node\", ..}",
            ),
            _ => (Slot::Any, "a word: Param(\"choice\")"),
        })
    }
}

/// The path of a file that another one names.
fn beside(path: &Path, given: &str) -> PathBuf {
    without_dots(&path.with_file_name("").join(given))
}

/// All words of the language.
fn language() -> &'static [Word] {
    static WORDS: OnceLock<Vec<Word>> = OnceLock::new();
    WORDS.get_or_init(|| words().into_iter().chain(golden::words()).collect())
}

fn is_port(field: &FieldOf) -> bool {
    matches!(field.slot, Slot::Link(_) | Slot::List(_))
}

fn words_of<'w>(words: impl IntoIterator<Item = (&'w str, &'w str)>) -> Slot {
    Slot::Words(Rc::new(
        words
            .into_iter()
            .map(|(word, doc): (&str, &str)| (word.to_owned(), doc.to_owned()))
            .collect(),
    ))
}

fn units() -> Slot {
    words_of(maquette_syntax::unit_names().map(|unit| (unit, "")))
}

impl About {
    /// The value of one of its parameters.
    pub(super) fn parameter(&self, name: &str) -> Option<Slot> {
        let schema = self.schema.as_ref()?;
        let field = schema.get("properties")?.get(name)?;
        Some(slot_of(field, schema))
    }

    /// The fields of one of its nodes.
    pub(super) fn node(&self, library: &Library<'_>, name: &str) -> Option<Slot> {
        let node = self.scope.node(name)?;
        let inner = Library::new(library.catalog, &self.path, library.options);
        let kind = match &node.kind[..] {
            "ForEach" => {
                return Some(Slot::Group(inner.each_fields(inner.kind(&self.scope, &node.of))));
            }
            "Switch" => return Some(Slot::Group(inner.switch_fields())),
            kind => inner.kind(&self.scope, kind)?,
        };
        Some(Slot::Group(fields_of(&kind.schema, &kind.schema)))
    }
}
