//! All that the packs of a program offer: nodes, values and file formats, by name.

use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use indexmap::IndexMap;
use maquette_node::pack::{Format, Migration, NewFile, Pack, Recipe};
use maquette_node::reading::{AnyReader, Readers};
use maquette_node::{Carry, Exactness, Fidelities, NodeType, Output, Term};
use maquette_syntax::error::Error;
use maquette_syntax::merged;
use maquette_value::plain::ending;
use maquette_value::{AnyValue, TYPES, ValueType};
use serde_json::{Value as Json, json};

mod description;

pub use description::{Description, PortDescription, describe_default, describe_parameter, ports};

/// What the packs of a program offer, by name.
///
/// Where two packs have a node of the same name, the first one has it; `conformance` reports that.
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

/// By what the code of a pack is known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Code {
    /// The pack.
    pub pack: &'static str,
    /// The id of the build that it is of; empty if that is not known.
    pub build: &'static str,
    /// Addresses of the code that it lists, if it has no id.
    pub others: Vec<usize>,
}

impl Code {
    fn of(pack: &Pack) -> Self {
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

/// One node of a catalog.
pub struct Entry {
    pub name: String,
    pub pack: &'static str,
    /// The version of the pack.
    pub version: &'static str,
    pub(crate) node: NodeType,
    readers: Arc<Readers>,
    schema: OnceLock<Json>,
    merged_schema: OnceLock<Json>,
    outputs: OnceLock<Vec<Output>>,
}

impl Entry {
    /// The JSON schema of the node's fields, ports included.
    pub fn schema(&self) -> &Json {
        self.schema.get_or_init(|| {
            let mut schema = Json::from((self.node.schema)());
            name_endings(&mut schema, &self.readers);
            for term in self.terms().iter().filter(|term| term.source.is_none()) {
                let wants = &mut schema["properties"][term.at]["wants"];
                if wants.is_null() {
                    *wants = json!([]);
                }
                wants.as_array_mut().into_iter().for_each(|all| all.push(json!(term.in_words())));
            }
            schema
        })
    }

    /// The same without words beside references, for whom steps through it many times: [`merged`].
    pub(crate) fn merged_schema(&self) -> &Json {
        self.merged_schema.get_or_init(|| merged(self.schema()))
    }

    /// What becomes of attributes.
    pub fn carries(&self) -> &'static [Carry] {
        (self.node.carries)()
    }

    /// How equal its results are on all machines and for all builds.
    pub fn exactness(&self) -> Exactness {
        self.node.exactness
    }

    /// What it wants of its ports and promises of its outputs.
    pub fn terms(&self) -> Vec<Term> {
        (self.node.terms)()
    }

    pub fn outputs(&self) -> &[Output] {
        self.outputs.get_or_init(|| (self.node.outputs)())
    }

    /// Its ports, in order.
    pub fn ports(&self) -> Vec<PortDescription> {
        ports(self.schema())
    }

    /// The node's description as `maquette nodes --json` prints it.
    pub fn to_json(&self) -> Json {
        self.description().to_json()
    }

    /// What people and programs are told of it.
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
                .map(|term| (term.at.to_owned(), term.in_words()))
                .collect(),
            carries: self.carries(),
            exactness: self.exactness(),
        }
    }
}

/// No format holds such a value.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no `.{ending}` file holds a value of the type {kind}; it can be written to: {}", known.join(", "))]
struct NoFormat {
    kind: &'static str,
    ending: String,
    known: Vec<&'static str>,
}

/// Whether some name or description in a schema fits.
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
    /// What these packs offer.
    pub fn new(packs: &[&Pack]) -> Self {
        let readers = packs.iter().flat_map(|pack| pack.readers).copied();
        let readers = Arc::new(Readers::new(readers));
        let mut entries = IndexMap::new();
        for pack in packs {
            for node in pack.nodes {
                let name = (node.name)().into_owned();
                let entry = || Entry {
                    name: name.clone(),
                    pack: pack.name,
                    version: pack.version,
                    node: *node,
                    readers: readers.clone(),
                    schema: OnceLock::new(),
                    merged_schema: OnceLock::new(),
                    outputs: OnceLock::new(),
                };
                entries.entry(name.clone()).or_insert_with(|| Arc::new(entry()));
            }
        }
        let values = packs.iter().flat_map(|pack| pack.values).copied().collect();
        let formats = packs.iter().flat_map(|pack| pack.formats).copied().collect();
        let code = packs.iter().map(|pack| Code::of(pack)).collect();
        let migrations = packs.iter().flat_map(|pack| pack.migrations).copied().collect();
        let recipes = packs.iter().flat_map(|pack| pack.recipes).copied().collect();
        Self { entries, values, formats, readers, code, migrations, recipes }
    }

    /// By what the code of its packs is known, in their order.
    pub fn code(&self) -> &[Code] {
        &self.code
    }

    /// Whether the program has a pack of this name.
    pub(crate) fn has_pack(&self, name: &str) -> bool {
        self.code.iter().any(|code| code.pack == name)
    }

    /// What became of nodes and fields, in the order of the packs and of their lists.
    pub(crate) fn migrations(&self) -> impl Iterator<Item = &Migration> {
        self.migrations.iter()
    }

    /// Graphs that a new project may begin with.
    pub fn recipes(&self) -> &[Recipe] {
        &self.recipes
    }

    /// What reads files.
    pub fn readers(&self) -> &Arc<Readers> {
        &self.readers
    }

    /// All nodes, with their ports, parameters and words, as `maquette nodes --json` prints them; and for each type of values the endings
    /// of the files that it is read from and written to.
    pub fn to_json(&self) -> Json {
        let mut kinds: Vec<_> = self.value_types().into_values().collect();
        kinds.sort_by_key(|kind| kind.name);
        let value = |kind: &ValueType| {
            let (read, written) = (self.readers.endings(Some(kind.name)), self.endings(Some(kind)));
            let mut value = json!({ "name": kind.name, "read": read, "written": written });
            let properties = kind.properties().into_iter();
            let properties = properties.map(|(name, doc)| json!({ "name": name, "doc": doc }));
            let properties = Vec::from_iter(properties);
            if !properties.is_empty() {
                value["properties"] = json!(properties);
            }
            value
        };
        json!({
            "nodes": self.entries().map(Entry::to_json).collect::<Vec<_>>(),
            "values": kinds.into_iter().map(value).collect::<Vec<_>>(),
        })
    }

    /// A value as the files of the format that the ending of `name` means: that file itself first, then those that belong to it.
    ///
    /// # Errors
    /// If no format with this ending takes such a value, or the value does not fit into it.
    pub fn write(&self, value: &AnyValue, name: &str) -> Result<Vec<NewFile>, Error> {
        let (kind, ending) = (value.kind(), ending(name.as_ref()));
        match self.format(kind, &ending) {
            Some(format) => format.write(value, name),
            None => {
                Err(NoFormat { kind: kind.name, ending, known: self.endings(Some(kind)) }.into())
            }
        }
    }

    /// What of a value the file of this name cannot tell, or what its readers will stumble over: a warning for each.
    pub fn doubts(&self, value: &AnyValue, name: &str) -> Vec<String> {
        let format = self.format(value.kind(), &ending(name.as_ref()));
        format.map_or_else(Vec::new, |format| format.doubts(value))
    }

    /// The value in a file, and the doubts of its reader: of this type if one is named, else of that which the file's ending and content
    /// mean. Files that it names, as materials are of an OBJ file, are read with it if they lie in its project.
    ///
    /// # Errors
    /// In words: nothing reads such a file, or it cannot be read.
    pub fn read(
        &self,
        path: &Path,
        kind: Option<&ValueType>,
    ) -> Result<(AnyValue, Vec<String>), String> {
        self.readers.open(path, kind)
    }

    /// The type of values of this name, if there is one.
    pub fn value_type(&self, name: &str) -> Option<&'static ValueType> {
        self.value_types().get(name).copied()
    }

    /// Whether some pack has a node of this name.
    pub fn has(&self, node: &str) -> bool {
        self.entries.contains_key(node)
    }

    pub fn find(&self, name: &str) -> Option<&Entry> {
        self.entries.get(name).map(|entry| &**entry)
    }

    /// The same for who keeps it.
    pub(crate) fn shared(&self, name: &str) -> Option<Arc<Entry>> {
        self.entries.get(name).cloned()
    }

    pub fn entries(&self) -> impl Iterator<Item = &Entry> {
        self.entries.values().map(|entry| &**entry)
    }

    pub fn names(&self) -> Vec<&str> {
        self.entries.keys().map(String::as_str).collect()
    }

    /// Which nodes are described with a word, as a sentence: those that say it of themselves, or else those whose fields and choices do. Empty if
    /// none are, or so many that nothing is meant by it, or nothing by so short a word.
    pub fn described_with(&self, word: &str) -> String {
        const MOST: usize = 8;
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
        let is_meant = 3 <= word.chars().count() && (1..=MOST).contains(&found.len());
        let found = found.into_iter().filter(|_| is_meant).map(|name| format!("`{name}`"));
        match &Vec::from_iter(found)[..] {
            [] => String::new(),
            [only] => format!("{only} is described with this word"),
            [first @ .., last] => {
                format!("{} and {last} are described with this word", first.join(", "))
            }
        }
    }

    /// Every type of values that the engine has, a node gives or a pack brings, by name.
    pub fn value_types(&self) -> HashMap<&'static str, &'static ValueType> {
        let outputs = self.entries().flat_map(Entry::outputs).flat_map(|output| &output.types);
        let types = TYPES.iter().chain(outputs).chain(&self.values);
        types.map(|kind| (kind.name, *kind)).collect()
    }

    /// The format that writes a value of this type to a file with this ending.
    pub fn format(&self, kind: &ValueType, ending: &str) -> Option<&Format> {
        self.formats.iter().find(|format| (format.kind)() == kind && format.ending == ending)
    }

    /// A format that writes files with this ending, of whatever values.
    pub(crate) fn any_format(&self, ending: &str) -> Option<&Format> {
        self.formats.iter().find(|format| format.ending == ending)
    }

    /// The format of a value of this type where nobody asks for another one: the first that is listed for it.
    pub(crate) fn preferred_format(&self, kind: &ValueType) -> Option<&Format> {
        self.formats.iter().find(|format| (format.kind)() == kind)
    }

    /// The endings of the files that this type of value can be written to; of all types without one.
    pub fn endings(&self, kind: Option<&ValueType>) -> Vec<&'static str> {
        let fitting =
            self.formats.iter().filter(|format| kind.is_none_or(|kind| (format.kind)() == kind));
        let mut endings: Vec<&str> = fitting.map(|format| format.ending).collect();
        endings.sort_unstable();
        endings.dedup();
        endings
    }

    /// What the files of each format keep of a type of values, as its writers or its readers say: their extensions, and the list.
    pub fn fidelities(&self, kind: &ValueType, is_read: bool) -> Vec<(String, Fidelities)> {
        let written = self.formats.iter().filter(|it| !is_read && (it.kind)() == kind);
        let written = written.map(|it| (it.ending.to_owned(), it.fidelity));
        let read = self.readers.all().iter().filter(|it| is_read && it.kind() == kind);
        let read = read.map(|it| (it.endings.join(" "), it.fidelity));
        written.chain(read).filter(|(_, list)| !list.is_empty()).collect()
    }

    /// Nodes that take a value of the first type and give one of the second.
    pub(crate) fn converters(&self, from: &str, to: &str) -> Vec<&str> {
        self.entries()
            .filter(|entry| {
                entry
                    .outputs()
                    .first()
                    // An output of several types has the one that came in.
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

/// Says of each file that a node reads as a type of values which endings such files have: `"reads": "Mesh"` gets `"endings"`.
fn name_endings(schema: &mut Json, readers: &Readers) {
    let fields = schema.get_mut("properties").and_then(Json::as_object_mut);
    for field in fields.into_iter().flat_map(|fields| fields.values_mut()) {
        if let Some(kind) = field.get("reads").and_then(Json::as_str) {
            field["endings"] = json!(readers.endings(Some(kind)));
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
    struct Nothing {}

    impl Node for Nothing {
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
        const NODES: &[NodeType] = &[node::<Nothing>(), node::<Rough>()];
        let catalog = Catalog::new(&[&Pack { nodes: NODES, ..Pack::EMPTY }]);
        fn told(name: &str, catalog: &Catalog) -> Json {
            catalog.find(name).unwrap().to_json()["exactness"].take()
        }
        assert_eq!(
            [told("Nothing", &catalog), told("Rough", &catalog)],
            [json!("exact"), json!({ "tolerant": 1e-6 })]
        );
    }

    #[test]
    fn a_pack_is_known_by_its_build_or_by_where_its_code_is() {
        const NODES: &[NodeType] = &[node::<Nothing>(), node::<Nothing>()];
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
