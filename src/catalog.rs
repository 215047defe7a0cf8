//! All that the packs of a program offer: nodes, values and file formats, by name.

use std::collections::{BTreeSet, HashMap};
use std::path::Path;
use std::sync::{Arc, OnceLock};

use indexmap::IndexMap;
use serde_json::{Value as Json, json};

use crate::error::Error;
use crate::format::{FORMATS, READERS};
use crate::node::{Carry, NodeType, Output, Term};
use crate::pack::{Format, Migration, NewFile, Pack, Recipe};
use crate::plain::ending;
use crate::reading::{AnyReader, Readers};
use crate::text::ron;
use crate::text::{inside_option, resolve, variants};
use crate::value::{AnyValue, TYPES, ValueType};

/// What the packs of a program offer, by name.
///
/// Where two packs have a node of the same name, the first one has it; [`conformance`](crate::conformance) reports that.
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
pub(crate) struct Code {
    /// The pack.
    pub(crate) pack: &'static str,
    /// The ids of the builds that its nodes are of.
    pub(crate) builds: BTreeSet<&'static str>,
    /// Addresses of all code that has no id: of nodes without one, and of values, formats and readers, which need not be from
    /// the same crate as the nodes.
    pub(crate) others: Vec<usize>,
}

impl Code {
    fn of(pack: &Pack) -> Self {
        let has_id = |node: &&NodeType| !(node.build)().is_empty();
        let nodes = pack.nodes.iter().filter(|node| !has_id(node)).map(|node| node.read as usize);
        let (known, values): (Vec<&ValueType>, Vec<&ValueType>) =
            pack.values.iter().partition(|kind| !(kind.build)().is_empty());
        let values = values.into_iter().map(ValueType::code);
        let known = known.into_iter().map(|kind| (kind.build)());
        let formats = pack.formats.iter().map(Format::code);
        let readers = pack.readers.iter().map(AnyReader::code);
        Self {
            pack: pack.name,
            builds: pack
                .nodes
                .iter()
                .filter(has_id)
                .map(|node| (node.build)())
                .chain(known)
                .collect(),
            others: nodes.chain(values).chain(formats).chain(readers).collect(),
        }
    }
}

/// One node of a catalog.
pub(crate) struct Entry {
    pub(crate) name: String,
    pub(crate) pack: &'static str,
    pub(crate) node: NodeType,
    readers: Arc<Readers>,
    schema: OnceLock<Json>,
    outputs: OnceLock<Vec<Output>>,
}

impl Entry {
    /// The JSON schema of the node's fields, ports included.
    pub(crate) fn schema(&self) -> &Json {
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

    /// What becomes of attributes.
    pub(crate) fn carries(&self) -> &'static [Carry] {
        (self.node.carries)()
    }

    /// What it wants of its ports and promises of its outputs.
    pub(crate) fn terms(&self) -> Vec<Term> {
        (self.node.terms)()
    }

    pub(crate) fn outputs(&self) -> &[Output] {
        self.outputs.get_or_init(|| (self.node.outputs)())
    }

    /// Its ports, in order.
    pub(crate) fn ports(&self) -> Vec<PortDescription> {
        ports(self.schema())
    }

    /// The node's description as `maquette nodes --json` prints it.
    pub(crate) fn to_json(&self) -> Json {
        self.description().to_json()
    }

    /// What people and programs are told of it.
    pub(crate) fn description(&self) -> Description<'_> {
        let output = |output: &Output| {
            (output.name.to_owned(), output.types.iter().map(|kind| kind.name).collect())
        };
        Description {
            name: &self.name,
            pack: self.pack,
            version: None,
            schema: self.schema(),
            outputs: self.outputs().iter().map(output).collect(),
            promises: self
                .terms()
                .iter()
                .filter(|term| term.source.is_some())
                .map(|term| (term.at.to_owned(), term.in_words()))
                .collect(),
            carries: self.carries(),
        }
    }
}

/// The documentation of a type of nodes: a built-in one, or a graph that others use.
pub(crate) struct Description<'a> {
    pub(crate) name: &'a str,
    /// The pack, or the file.
    pub(crate) pack: &'a str,
    /// That of a graph which says one.
    pub(crate) version: Option<&'a str>,
    pub(crate) schema: &'a Json,
    /// Names and types.
    pub(crate) outputs: Vec<(String, Vec<&'static str>)>,
    /// Outputs and what is promised of them, in words.
    pub(crate) promises: Vec<(String, String)>,
    /// What becomes of attributes, where that is said.
    pub(crate) carries: &'static [Carry],
}

impl Description<'_> {
    /// Its ports, in order.
    pub(crate) fn ports(&self) -> Vec<PortDescription> {
        ports(self.schema)
    }

    /// What is promised of an output, in words.
    pub(crate) fn promised<'d>(&'d self, output: &str) -> impl Iterator<Item = &'d str> {
        let of_it = self.promises.iter().filter(move |(name, _)| name == output);
        of_it.map(|(_, words)| &words[..])
    }

    pub(crate) fn to_json(&self) -> Json {
        let ports = self.ports();
        let mut parameters = self.schema.clone();
        if let Some(properties) = parameters.get_mut("properties").and_then(Json::as_object_mut) {
            properties.retain(|name, _| ports.iter().all(|port| port.name != *name));
        }
        if let Some(required) = parameters.get_mut("required").and_then(Json::as_array_mut) {
            required.retain(|name| ports.iter().all(|port| name.as_str() != Some(&port.name)));
        }
        let outputs = self.outputs.iter().map(|(name, types)| {
            let mut output = json!({ "name": name, "types": types });
            let promises = Vec::from_iter(self.promised(name));
            if !promises.is_empty() {
                output["promises"] = json!(promises);
            }
            output
        });
        let mut told = json!({
            "name": self.name,
            "pack": self.pack,
            "doc": self.schema.get("description").cloned().unwrap_or_default(),
            "inputs": ports.iter().map(PortDescription::to_json).collect::<Vec<_>>(),
            "outputs": outputs.collect::<Vec<_>>(),
            "parameters": parameters,
        });
        if !self.carries.is_empty() {
            told["attributes"] = self.carries.iter().map(|carry| carry.to_json()).collect();
        }
        if let Some(version) = self.version {
            told["version"] = version.into();
        }
        told
    }
}

/// A port, as it is described to people and programs.
pub(crate) struct PortDescription {
    pub(crate) name: String,
    pub(crate) types: Vec<String>,
    pub(crate) optional: bool,
    pub(crate) many: bool,
    /// Properties of the values, in words.
    pub(crate) wants: Vec<String>,
    pub(crate) doc: String,
}

impl PortDescription {
    fn to_json(&self) -> Json {
        let mut port = json!({
            "name": self.name,
            "types": self.types,
            "optional": self.optional,
            "many": self.many,
            "doc": self.doc,
        });
        if !self.wants.is_empty() {
            port["wants"] = json!(self.wants);
        }
        port
    }
}

/// The ports among the fields of a schema, in order.
pub(crate) fn ports(schema: &Json) -> Vec<PortDescription> {
    let properties = schema.get("properties").and_then(Json::as_object);
    let required = schema.get("required").and_then(Json::as_array);
    let is_optional = |name: &str| {
        !required.is_some_and(|required| required.iter().any(|field| field.as_str() == Some(name)))
    };
    let port = |(name, field): (&String, &Json)| port(name, field, is_optional(name));
    properties.into_iter().flatten().filter_map(port).collect()
}

fn words(list: &Json) -> Vec<String> {
    let words = list.as_array().into_iter().flatten();
    words.filter_map(Json::as_str).map(str::to_owned).collect()
}

fn port(name: &str, field: &Json, optional: bool) -> Option<PortDescription> {
    let items = field.get("items").filter(|items| items.get("port").is_some());
    let types = items.unwrap_or(field).get("types")?.as_array()?;
    Some(PortDescription {
        name: name.to_owned(),
        types: types.iter().filter_map(Json::as_str).map(str::to_owned).collect(),
        optional,
        many: items.is_some(),
        wants: words(&field["wants"]),
        doc: field["description"].as_str().unwrap_or_default().to_owned(),
    })
}

/// No format holds such a value.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no `.{ending}` file holds a value of the type {kind}; it can be written to: {}", known.join(", "))]
struct NoFormat {
    kind: &'static str,
    ending: String,
    known: Vec<&'static str>,
}

impl Catalog {
    /// What these packs offer, beside the engine's own file formats.
    pub fn new(packs: &[&Pack]) -> Self {
        let brought = packs.iter().flat_map(|pack| pack.readers);
        let readers = Arc::new(Readers::new(READERS.iter().chain(brought).copied()));
        let mut entries = IndexMap::new();
        for pack in packs {
            for node in pack.nodes {
                let name = (node.name)().into_owned();
                let entry = || Entry {
                    name: name.clone(),
                    pack: pack.name,
                    node: *node,
                    readers: readers.clone(),
                    schema: OnceLock::new(),
                    outputs: OnceLock::new(),
                };
                entries.entry(name.clone()).or_insert_with(|| Arc::new(entry()));
            }
        }
        let brought = packs.iter().flat_map(|pack| pack.formats);
        let values = packs.iter().flat_map(|pack| pack.values).copied().collect();
        let formats = FORMATS.iter().chain(brought).copied().collect();
        let code = packs.iter().map(|pack| Code::of(pack)).collect();
        let migrations = packs.iter().flat_map(|pack| pack.migrations).copied().collect();
        let recipes = packs.iter().flat_map(|pack| pack.recipes).copied().collect();
        Self { entries, values, formats, readers, code, migrations, recipes }
    }

    /// By what the code of its packs is known, in their order.
    pub(crate) fn code(&self) -> &[Code] {
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
    pub(crate) fn readers(&self) -> &Arc<Readers> {
        &self.readers
    }

    /// All nodes, with their ports, parameters and words, as `maquette nodes --json` prints them; and for each type of values the endings
    /// of the files that it is read from and written to.
    pub fn to_json(&self) -> Json {
        let mut kinds = Vec::from_iter(self.value_types().into_values());
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

    pub(crate) fn find(&self, name: &str) -> Option<&Entry> {
        self.entries.get(name).map(|entry| &**entry)
    }

    /// The same for who keeps it.
    pub(crate) fn shared(&self, name: &str) -> Option<Arc<Entry>> {
        self.entries.get(name).cloned()
    }

    pub(crate) fn entries(&self) -> impl Iterator<Item = &Entry> {
        self.entries.values().map(|entry| &**entry)
    }

    pub(crate) fn names(&self) -> Vec<&str> {
        self.entries.keys().map(String::as_str).collect()
    }

    /// Every type of values that the engine has, a node gives or a pack brings, by name.
    pub(crate) fn value_types(&self) -> HashMap<&'static str, &'static ValueType> {
        let outputs = self.entries().flat_map(Entry::outputs).flat_map(|output| &output.types);
        let types = TYPES.iter().chain(outputs).chain(&self.values);
        types.map(|kind| (kind.name, *kind)).collect()
    }

    /// The format that writes a value of this type to a file with this ending.
    pub(crate) fn format(&self, kind: &ValueType, ending: &str) -> Option<&Format> {
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
    pub(crate) fn endings(&self, kind: Option<&ValueType>) -> Vec<&'static str> {
        let fitting =
            self.formats.iter().filter(|format| kind.is_none_or(|kind| (format.kind)() == kind));
        let mut endings: Vec<&str> = fitting.map(|format| format.ending).collect();
        endings.sort_unstable();
        endings.dedup();
        endings
    }

    /// Nodes that take a value of the first type and give one of the second.
    pub(crate) fn converters(&self, from: &str, to: &str) -> Vec<&str> {
        let converts = |entry: &&Entry| {
            entry
                .outputs()
                .first()
                // An output of several types has the one that came in.
                .is_some_and(|output| output.types.len() == 1 && output.types[0].name == to)
                && entry
                    .ports()
                    .first()
                    .is_some_and(|port| port.types.iter().any(|kind| kind == from))
        };
        self.entries().filter(converts).map(|entry| entry.name.as_str()).collect()
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

/// The schema of what a field takes, without the reference to it and without what says that it may be left out.
pub(crate) fn inside(schema: &Json, root: &Json) -> Json {
    let resolved = resolve(root, schema);
    inside_option(&resolved).map_or(resolved, |inner| resolve(root, &inner))
}

/// What a parameter takes, on one line.
pub(crate) fn describe_parameter(schema: &Json, root: &Json) -> String {
    described(schema, root, &[])
}

/// The same within some types, by what refers to them: one that holds itself is not described for ever.
fn described(schema: &Json, root: &Json, within: &[&str]) -> String {
    let refers = schema.get("$ref").and_then(Json::as_str);
    if refers.is_some_and(|refers| within.contains(&refers)) {
        return "..".into();
    }
    let within = &Vec::from_iter(within.iter().copied().chain(refers))[..];
    let schema = &inside(schema, root);
    let variants = variants(schema);
    if !variants.is_empty() {
        return variants
            .iter()
            .map(|(name, content)| match content {
                None => name.clone(),
                Some(content) => format!("{name}{}", describe_content(content, root, within)),
            })
            .collect::<Vec<_>>()
            .join(" | ");
    }
    let unit = schema.get("unit").and_then(Json::as_str);
    let unit = unit.map_or_else(String::new, |unit| format!(" {unit}"));
    match schema.get("type").and_then(Json::as_str) {
        Some("array") => {
            let fixed = schema.get("prefixItems").and_then(Json::as_array);
            let count = fixed.map(Vec::len).or_else(|| {
                let bound = |name: &str| schema.get(name).and_then(Json::as_u64);
                bound("minItems")
                    .filter(|least| bound("maxItems") == Some(*least))
                    .map(|n| n as usize)
            });
            let item =
                |k: usize| fixed.and_then(|fixed| fixed.get(k)).or_else(|| schema.get("items"));
            let words = |k| item(k).map_or_else(String::new, |item| described(item, root, within));
            match count {
                Some(count) => {
                    let words = Vec::from_iter((0..count).map(words)).join(", ");
                    format!("({words}){unit}")
                }
                None => format!("[{}, ..]{unit}", words(0)),
            }
        }
        Some("object") if schema.get("properties").is_none() => "{\"name\": .., ..}".into(),
        Some("object") => describe_content(schema, root, within),
        Some("string") => schema.get("format").and_then(Json::as_str).unwrap_or("text").to_owned(),
        Some("boolean") => "true | false".into(),
        Some(kind @ ("number" | "integer")) => {
            let limit =
                |names: [&str; 2]| names.into_iter().find_map(|name| schema.get(name)?.as_f64());
            let (least, most) =
                (limit(["minimum", "exclusiveMinimum"]), limit(["maximum", "exclusiveMaximum"]));
            match (least, most) {
                (Some(least), Some(most)) => format!("{kind} {least} to {most}{unit}"),
                (Some(least), None) => format!("{kind} from {least}{unit}"),
                (None, Some(most)) => format!("{kind} up to {most}{unit}"),
                (None, None) => format!("{kind}{unit}"),
            }
        }
        _ => "value".into(),
    }
}

fn describe_content(content: &Json, root: &Json, within: &[&str]) -> String {
    let content = resolve(root, content);
    match content.get("properties").and_then(Json::as_object) {
        Some(fields) => {
            let fields = fields.iter().map(|(name, field)| {
                let (kind, default) =
                    (described(field, root, within), describe_default(field, root));
                format!("{name}: {kind}{default}")
            });
            format!("({})", fields.collect::<Vec<_>>().join(", "))
        }
        None => {
            let inner = described(&content, root, within);
            if inner.starts_with('(') { inner } else { format!("({inner})") }
        }
    }
}

/// ` = default`, as a graph file would have it, if the schema has one.
pub(crate) fn describe_default(schema: &Json, root: &Json) -> String {
    let default = schema.get("default");
    default.map_or_else(String::new, |default| format!(" = {}", ron(default, schema, root)))
}

#[cfg(test)]
mod tests {
    use schemars::JsonSchema;
    use serde::{Deserialize, Serialize};

    use super::*;
    use crate::node::{Context, Node, node};
    use crate::value::{Mesh, value_type};

    #[derive(Serialize, Deserialize, JsonSchema)]
    struct Nothing {}

    impl Node for Nothing {
        type Outputs = (Mesh,);
        const OUTPUTS: [&'static str; 1] = ["mesh"];

        fn eval(&self, _: &Context<'_>) -> Result<Self::Outputs, Error> {
            unreachable!("no test evaluates it")
        }
    }

    const EMPTY: Pack = Pack {
        name: "",
        nodes: &[],
        values: &[],
        formats: &[],
        readers: &[],
        migrations: &[],
        recipes: &[],
    };

    #[test]
    fn what_a_pack_brings_is_known_by_its_build_or_by_where_its_code_is() {
        const PLAIN: NodeType = node::<Nothing>();
        const ONE: NodeType = PLAIN.of_build(|| "1");
        const TWO: NodeType = PLAIN.of_build(|| "2");
        let check = |pack: Pack, builds: &[&'static str], others: usize| {
            let code = Catalog::new(&[&EMPTY, &pack]).code()[1].clone();
            assert_eq!(Vec::from_iter(&code.builds), Vec::from_iter(builds));
            assert_eq!(code.others.len(), others, "{code:?}");
        };
        check(EMPTY, &[], 0);
        check(Pack { nodes: &[ONE, TWO, ONE], ..EMPTY }, &["1", "2"], 0);
        check(Pack { nodes: &[ONE, PLAIN], ..EMPTY }, &["1"], 1);
        check(Pack { nodes: const { &[PLAIN.of_build(|| "")] }, ..EMPTY }, &[], 1);
        // Who gathers the nodes of others may bring a reader of his own.
        check(Pack { nodes: &[ONE], readers: &READERS[..1], ..EMPTY }, &["1"], 1);
        check(Pack { nodes: &[ONE], formats: &FORMATS[..1], ..EMPTY }, &["1"], 1);
        static VALUES: [&ValueType; 1] = [value_type::<Mesh>()];
        check(Pack { nodes: &[ONE], values: &VALUES, ..EMPTY }, &["1"], 1);
    }
}
