//! The nodes, values and file formats of all packs of a program, by name.

use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use indexmap::IndexMap;
use maquette_node::importers::{AnyReader, Readers};
use maquette_node::pack::{Format, Migration, NewFile, Pack, Recipe};
use maquette_node::{Carry, Exactness, Fidelities, NodeType, Output, Term, bail};
use maquette_syntax::error::Error;
use maquette_syntax::merge_references;
use maquette_value::fs::extension;
use maquette_value::{AnyValue, TYPES, ValueType};
use serde_json::{Value as Json, json};

mod description;

pub use description::{Description, PortDescription, describe_default, describe_parameter, ports};

/// The nodes, values and file formats of all packs of a program, by name.
///
/// If two packs have a node of the same name, the node of the first pack is used, and `conformance` reports the conflict.
#[derive(Clone)]
pub struct Catalog {
    entries: IndexMap<String, Arc<Entry>>,
    values: Vec<&'static ValueType>,
    formats: Vec<Format>,
    readers: Arc<Readers>,
    code: Vec<Code>,
    migrations: Vec<Migration>,
    recipes: Vec<Recipe>,
}

/// The identity of the code of a pack.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Code {
    /// The name of the pack.
    pub pack: &'static str,
    /// The id of the pack's build; empty if the id is unknown.
    pub build: &'static str,
    /// The addresses of the pack's functions. They identify the code if the build has no id.
    pub others: Vec<usize>,
}

impl Code {
    fn from_pack(pack: &Pack) -> Self {
        let build = (pack.build)();
        let nodes = pack.nodes.iter().map(|node| node.read as usize);
        let values = pack.values.iter().map(|kind| kind.code());
        let formats = pack.formats.iter().map(Format::code);
        let readers = pack.readers.iter().map(AnyReader::code);
        let all = nodes.chain(values).chain(formats).chain(readers);
        let others = if build.is_empty() { all.collect() } else { Vec::new() };
        Self { pack: pack.name, build, others }
    }
}

/// A node type of a catalog, with the pack that defines it.
pub struct Entry {
    pub name: String,
    pub pack: &'static str,
    /// The version of the pack that defines the node type.
    pub version: &'static str,
    pub(crate) node: NodeType,
    readers: Arc<Readers>,
    schema: OnceLock<Json>,
    merged_schema: OnceLock<Json>,
    outputs: OnceLock<Vec<Output>>,
}

impl Entry {
    /// Returns the JSON schema of the node's fields, including its ports.
    pub fn schema(&self) -> &Json {
        self.schema.get_or_init(|| {
            let mut schema = Json::from((self.node.schema)());
            add_extensions(&mut schema, &self.readers);
            for term in self.terms().iter().filter(|term| term.source.is_none()) {
                let wants = &mut schema["properties"][term.at]["wants"];
                if wants.is_null() {
                    *wants = json!([]);
                }
                wants.as_array_mut().into_iter().for_each(|all| all.push(json!(term.describe())));
            }
            schema
        })
    }

    /// Returns the schema with its references resolved by [`merge_references`], which is faster for repeated look-ups.
    pub(crate) fn merged_schema(&self) -> &Json {
        self.merged_schema.get_or_init(|| merge_references(self.schema()))
    }

    /// Returns the documented effect of the node on attributes.
    pub fn carries(&self) -> &'static [Carry] {
        (self.node.carries)()
    }

    /// Returns how closely the results of the node agree between machines and builds.
    pub fn exactness(&self) -> Exactness {
        self.node.exactness
    }

    /// Returns the properties that the node requires of its ports, and those that it promises of its outputs.
    pub fn terms(&self) -> Vec<Term> {
        (self.node.terms)()
    }

    pub fn outputs(&self) -> &[Output] {
        self.outputs.get_or_init(|| (self.node.outputs)())
    }

    /// Returns the descriptions of the node's ports, in order.
    pub fn ports(&self) -> Vec<PortDescription> {
        ports(self.schema())
    }

    /// Returns the description of the node as `maquette nodes --json` prints it.
    pub fn to_json(&self) -> Json {
        self.description().to_json()
    }

    /// Returns the description of the node for people and programs.
    pub fn description(&self) -> Description<'_> {
        Description {
            name: &self.name,
            pack: self.pack,
            version: None,
            schema: self.schema(),
            outputs: self
                .outputs()
                .iter()
                .map(|output| {
                    (output.name.to_owned(), output.types.iter().map(|kind| kind.name).collect())
                })
                .collect(),
            promises: self
                .terms()
                .iter()
                .filter(|term| term.source.is_some())
                .map(|term| (term.at.to_owned(), term.describe()))
                .collect(),
            carries: self.carries(),
            exactness: self.exactness(),
        }
    }
}

/// Returns true if `fits` accepts a property name or a description in a JSON schema.
fn has_text(schema: &Json, fits: &impl Fn(&str) -> bool) -> bool {
    let is_text = |value: &Json| value.as_str().is_some_and(fits);
    match schema {
        Json::Object(entries) => {
            entries.iter().any(|(key, value): (&String, &Json)| match (&key[..], value) {
                ("description" | "const", text) => is_text(text),
                ("enum", Json::Array(choices)) => choices.iter().any(is_text),
                ("properties", Json::Object(fields)) => {
                    fields.iter().any(|(name, field)| fits(name) || has_text(field, fits))
                }
                (_, inner) => has_text(inner, fits),
            })
        }
        Json::Array(items) => items.iter().any(|item| has_text(item, fits)),
        _ => false,
    }
}

impl Catalog {
    /// Creates the catalog of the given packs.
    pub fn new(packs: &[&Pack]) -> Self {
        let readers = packs.iter().flat_map(|pack| pack.readers).copied();
        let readers = Arc::new(Readers::new(readers));
        let mut entries = IndexMap::new();
        for pack in packs {
            for node in pack.nodes {
                let name = (node.name)().into_owned();
                entries.entry(name.clone()).or_insert_with(|| {
                    Arc::new(Entry {
                        name,
                        pack: pack.name,
                        version: pack.version,
                        node: *node,
                        readers: readers.clone(),
                        schema: OnceLock::new(),
                        merged_schema: OnceLock::new(),
                        outputs: OnceLock::new(),
                    })
                });
            }
        }
        let values = packs.iter().flat_map(|pack| pack.values).copied().collect();
        let formats = packs.iter().flat_map(|pack| pack.formats).copied().collect();
        let code = packs.iter().map(|pack| Code::from_pack(pack)).collect();
        let migrations = packs.iter().flat_map(|pack| pack.migrations).copied().collect();
        let recipes = packs.iter().flat_map(|pack| pack.recipes).copied().collect();
        Self { entries, values, formats, readers, code, migrations, recipes }
    }

    /// Returns the identity of each pack's code, in the order of the packs.
    pub fn code(&self) -> &[Code] {
        &self.code
    }

    /// Returns true if the program has a pack of this name.
    pub(crate) fn has_pack(&self, name: &str) -> bool {
        self.code.iter().any(|code| code.pack == name)
    }

    /// Returns the migrations of nodes and fields, in the order of the packs and of their lists.
    pub(crate) fn migrations(&self) -> impl Iterator<Item = &Migration> {
        self.migrations.iter()
    }

    /// Returns the example graphs from which a new project may start.
    pub fn recipes(&self) -> &[Recipe] {
        &self.recipes
    }

    /// Returns the file readers of all packs.
    pub fn readers(&self) -> &Arc<Readers> {
        &self.readers
    }

    /// Returns all nodes with their ports, parameters and descriptions, as `maquette nodes --json` prints them. Also returns, for each type
    /// of value, the extensions of the files from which it can be read and to which it can be written.
    pub fn to_json(&self) -> Json {
        let mut kinds: Vec<_> = self.value_types().into_values().collect();
        kinds.sort_by_key(|kind| kind.name);
        json!({
            "nodes": self.entries().map(Entry::to_json).collect::<Vec<_>>(),
            "values": kinds.into_iter().map(|kind| self.type_to_json(kind)).collect::<Vec<_>>(),
        })
    }

    fn type_to_json(&self, kind: &ValueType) -> Json {
        let (read, written) =
            (self.readers.extensions(Some(kind.name)), self.extensions(Some(kind)));
        let mut value = json!({ "name": kind.name, "read": read, "written": written });
        let properties = kind.properties().into_iter();
        let properties: Vec<_> =
            properties.map(|(name, doc)| json!({ "name": name, "doc": doc })).collect();
        if !properties.is_empty() {
            value["properties"] = json!(properties);
        }
        value
    }

    /// Writes a value in the format that belongs to the extension of `name`. Returns the file `name` first, then its companion files.
    ///
    /// # Errors
    /// No format with this extension can store the value.
    pub fn write(&self, value: &AnyValue, name: &str) -> Result<Vec<NewFile>, Error> {
        let (kind, ending) = (value.kind(), extension(name.as_ref()));
        match self.format(kind, &ending) {
            Some(format) => format.write(value, name),
            None => bail!(
                "no `.{ending}` file holds a value of the type {}; it can be written to: {}",
                kind.name,
                self.extensions(Some(kind)).join(", ")
            ),
        }
    }

    /// Returns warnings about data that a file of this name cannot store, or that other programs may misread.
    pub fn doubts(&self, value: &AnyValue, name: &str) -> Vec<String> {
        let format = self.format(value.kind(), &extension(name.as_ref()));
        format.map_or_else(Vec::new, |format| format.warnings(value))
    }

    /// Reads a file as a value, and returns the value with the warnings of the reader. The value has the given type, or else the type that
    /// the file's extension and content suggest. Files to which the file refers, such as the materials of an OBJ file, are read too if they
    /// are in the same project.
    ///
    /// # Errors
    /// No reader can read the file. The error is the message.
    pub fn read(
        &self,
        path: &Path,
        kind: Option<&ValueType>,
    ) -> Result<(AnyValue, Vec<String>), String> {
        self.readers.open(path, kind)
    }

    /// Returns the type of values that has this name.
    pub fn value_type(&self, name: &str) -> Option<&'static ValueType> {
        self.value_types().get(name).copied()
    }

    /// Returns true if a pack has a node of this name.
    pub fn has(&self, node: &str) -> bool {
        self.entries.contains_key(node)
    }

    pub fn find(&self, name: &str) -> Option<&Entry> {
        self.entries.get(name).map(|entry| &**entry)
    }

    /// Returns the entry of a node type as a shared reference. `None` if no pack defines the type.
    pub(crate) fn find_shared(&self, name: &str) -> Option<Arc<Entry>> {
        self.entries.get(name).cloned()
    }

    pub fn entries(&self) -> impl Iterator<Item = &Entry> {
        self.entries.values().map(|entry| &**entry)
    }

    pub fn names(&self) -> Vec<&str> {
        self.entries.keys().map(String::as_str).collect()
    }

    /// Returns a sentence that lists the nodes whose descriptions contain the word. If there are none, it lists the nodes whose fields or
    /// choices contain the word. Returns an empty string if there are no such nodes or too many of them, or if the word is too short.
    pub fn described_with(&self, word: &str) -> String {
        const MAX_LISTED: usize = 8;
        let word = word.to_lowercase();
        let says = |text: &str| {
            let text = text.to_lowercase();
            text.split(|c: char| !c.is_alphanumeric()).any(|own| own.starts_with(&word))
        };
        let (mut of_themselves, mut of_fields) = (Vec::new(), Vec::new());
        for entry in self.entries() {
            let schema = entry.schema();
            if schema["description"].as_str().is_some_and(says) {
                of_themselves.push(&entry.name[..]);
            } else if has_text(schema, &says) {
                of_fields.push(&entry.name[..]);
            }
        }
        let found = if of_themselves.is_empty() { of_fields } else { of_themselves };
        let is_meant = 3 <= word.chars().count() && (1..=MAX_LISTED).contains(&found.len());
        let found = found.into_iter().filter(|_| is_meant).map(|name| format!("`{name}`"));
        match &Vec::from_iter(found)[..] {
            [] => String::new(),
            [only] => format!("{only} is described with this word"),
            [first @ .., last] => {
                format!("{} and {last} are described with this word", first.join(", "))
            }
        }
    }

    /// Returns all types of values by name: those of the engine, of the nodes' outputs and of the packs.
    pub fn value_types(&self) -> HashMap<&'static str, &'static ValueType> {
        let outputs = self.entries().flat_map(Entry::outputs).flat_map(|output| &output.types);
        let types = TYPES.iter().chain(outputs).chain(&self.values);
        types.map(|kind| (kind.name, *kind)).collect()
    }

    /// Returns the format that writes a value of this type to a file with this extension.
    pub fn format(&self, kind: &ValueType, ending: &str) -> Option<&Format> {
        self.formats.iter().find(|format| (format.kind)() == kind && format.extension == ending)
    }

    /// Returns a format that writes files with this extension, for any type of value.
    pub(crate) fn any_format(&self, ending: &str) -> Option<&Format> {
        self.formats.iter().find(|format| format.extension == ending)
    }

    /// Returns the default format of a type of value, which is the first format listed for the type.
    pub(crate) fn preferred_format(&self, kind: &ValueType) -> Option<&Format> {
        self.formats.iter().find(|format| (format.kind)() == kind)
    }

    /// Returns the extensions of the files to which this type of value can be written. If `kind` is `None`, returns the extensions for all
    /// types.
    pub fn extensions(&self, kind: Option<&ValueType>) -> Vec<&'static str> {
        let fitting =
            self.formats.iter().filter(|format| kind.is_none_or(|kind| (format.kind)() == kind));
        let mut endings: Vec<&str> = fitting.map(|format| format.extension).collect();
        endings.sort_unstable();
        endings.dedup();
        endings
    }

    /// Returns the fidelity of each file format for a type of value, when reading if `is_read` is true and otherwise when writing. Each
    /// entry consists of the extensions of the format and a list of fidelities.
    pub fn fidelities(&self, kind: &ValueType, is_read: bool) -> Vec<(String, Fidelities)> {
        let written = self.formats.iter().filter(|it| !is_read && (it.kind)() == kind);
        let written = written.map(|it| (it.extension.to_owned(), it.fidelity));
        let read = self.readers.as_slice().iter().filter(|it| is_read && it.kind() == kind);
        let read = read.map(|it| (it.extensions.join(" "), it.fidelity));
        written.chain(read).filter(|(_, list)| !list.is_empty()).collect()
    }

    /// Returns the nodes that convert a value of the first type to the second.
    pub(crate) fn converters(&self, from: &str, to: &str) -> Vec<&str> {
        self.entries()
            .filter(|entry| {
                entry
                    .outputs()
                    .first()
                    // A node whose output has several possible types returns the type of its input, so it does not convert.
                    .is_some_and(|output| output.types.len() == 1 && output.types[0].name == to)
                    && entry
                        .ports()
                        .first()
                        .is_some_and(|port| port.types.iter().any(|kind| kind == from))
            })
            .map(|entry| entry.name.as_str())
            .collect()
    }
}

/// Adds the key `"endings"` to each file field of a schema: the extensions of the files that can be read as the type in `"reads"`.
fn add_extensions(schema: &mut Json, readers: &Readers) {
    let fields = schema.get_mut("properties").and_then(Json::as_object_mut);
    for field in fields.into_iter().flat_map(|fields| fields.values_mut()) {
        if let Some(kind) = field.get("reads").and_then(Json::as_str) {
            field["endings"] = json!(readers.extensions(Some(kind)));
        }
    }
}

#[cfg(test)]
mod tests {
    use maquette_format::{FORMATS, READERS};
    use maquette_node::{Context, Node, node};
    use maquette_value::{Mesh, value_type};
    use schemars::JsonSchema;
    use serde::{Deserialize, Serialize};

    use super::*;

    #[derive(Serialize, Deserialize, JsonSchema)]
    struct ExactNode {}

    impl Node for ExactNode {
        type Outputs = (Mesh,);
        const OUTPUTS: [&'static str; 1] = ["mesh"];

        fn eval(&self, _: &Context<'_>) -> Result<Self::Outputs, Error> {
            unreachable!("no test evaluates it")
        }
    }

    #[derive(Serialize, Deserialize, JsonSchema)]
    struct Rough {}

    impl Node for Rough {
        type Outputs = (Mesh,);
        const OUTPUTS: [&'static str; 1] = ["mesh"];
        const EXACTNESS: Exactness = Exactness::Tolerant(1e-6);

        fn eval(&self, _: &Context<'_>) -> Result<Self::Outputs, Error> {
            unreachable!("no test evaluates it")
        }
    }

    #[test]
    fn a_node_says_how_exact_it_is_and_is_exact_if_it_does_not() {
        const NODES: &[NodeType] = &[node::<ExactNode>(), node::<Rough>()];
        let catalog = Catalog::new(&[&Pack { nodes: NODES, ..Pack::EMPTY }]);
        fn exactness_of(name: &str, catalog: &Catalog) -> Json {
            catalog.find(name).unwrap().to_json()["exactness"].take()
        }
        assert_eq!(
            [exactness_of("ExactNode", &catalog), exactness_of("Rough", &catalog)],
            [json!("exact"), json!({ "tolerant": 1e-6 })]
        );
    }

    #[test]
    fn a_pack_is_known_by_its_build_or_by_where_its_code_is() {
        const NODES: &[NodeType] = &[node::<ExactNode>(), node::<ExactNode>()];
        static VALUES: [&ValueType; 1] = [value_type::<Mesh>()];
        fn check(pack: Pack, build: &str, others: usize) {
            let code = Catalog::new(&[&Pack::EMPTY, &pack]).code()[1].clone();
            assert_eq!((code.build, code.others.len()), (build, others), "{code:?}");
        }
        check(Pack::EMPTY, "", 0);
        let all = Pack {
            nodes: NODES,
            values: &VALUES,
            readers: &READERS[..1],
            formats: &FORMATS[..1],
            ..Pack::EMPTY
        };
        check(all, "", 5);
        check(Pack { build: || "1", ..all }, "1", 0);
    }
}
