//! Checks the laws that every pack (plug-in) must obey. The tests of a pack call [`check`].

use std::collections::BTreeSet;
use std::path::Path;

use maquette_engine::eval::Evaluator;
use maquette_graph::catalog::{Catalog, Entry};
use maquette_graph::{Graph, Options, is_name};
use maquette_node::pack::Pack;
use maquette_node::{CancelToken, Progress};
use maquette_syntax::{check_default, variants};
use maquette_value::AnyValue;
use serde_json::Value as Json;

mod attributes;
mod cells;
mod evaluation;
mod extremes;
mod files;
mod formats;
mod migrations;
mod promises;
mod scalars;
mod shapes;
mod updates;
mod values;

use self::evaluation::{EdgeCases, MEMORY, Values, call_with_context, inputs, run_all};
use self::scalars::Scalars;

/// Checks that `pack` obeys these laws:
///
/// 1. Names of nodes, values, ports and outputs are unique and well formed.
/// 2. Every node, port, parameter and choice is documented.
/// 3. Every default is valid. If a node states a tolerance between machines, the tolerance is valid, too.
/// 4. The node's example `<examples>/<Node>.ron` exists and runs.
/// 5. Changing any parameter of a node changes the key of its result.
/// 6. Equal inputs give equal bytes for 1, 2 and 8 threads.
/// 7. Edge cases of the input types cause errors, not panics. From meshes of moderate size, such as those with faces without area, a node
///    computes no numbers that are not finite.
/// 8. A node finishes, fails with an error, or stops soon after cancellation, even if its numbers are at the ends of their ranges. They are
///    tested one by one and together, with the values of its example and with edge cases.
/// 9. A reader of files returns a value or an error for any bytes. It is tested with files that the pack writes, intact and damaged.
/// 10. The outputs of a node have the properties that it promises, for its example and for edge cases that it accepts.
/// 11. A node handles the attributes of meshes, points and range images as it declares, from each port to each output.
/// 12. The old name in a migration does not exist, and the new name exists.
/// 13. Updating the result of a node gives the same result and warnings as computing it from the inputs alone. A node that can
///     update its result for unchanged inputs can also update it for changed ones.
/// 14. If a format can encode a file in pieces, the pieces equal the corresponding parts of the whole file, wherever they begin
///     and end. Pieces with the same source are equal.
/// 15. A node gives the same result for a shape wherever it is, whatever its size is, and whatever faces without area it has. What it makes
///     of meshes without such faces has none.
///
/// `others` are further packs, whose nodes the examples use.
///
/// # Errors
/// A message for each broken law.
pub fn check(pack: &Pack, others: &[&Pack], examples: &Path) -> Result<(), Vec<String>> {
    let mut broken = Vec::new();
    check_names(pack, others, &mut broken);
    let packs: Vec<&Pack> = std::iter::once(pack).chain(others.iter().copied()).collect();
    let catalog = Catalog::new(&packs);
    pack.values.iter().for_each(|kind| values::check(kind, &mut broken));
    pack.readers.iter().for_each(|reader| files::check(reader, &catalog, &mut broken));
    pack.formats.iter().for_each(|format| formats::check(format, &mut broken));
    migrations::check(pack, &catalog, &mut broken);
    for node in pack.nodes {
        let name = (node.name)();
        let Some(entry) = catalog.find(&name) else { continue };
        check_documentation(entry, &mut broken);
        check_defaults(entry, &mut broken);
        promises::check_names(entry, &catalog, &mut broken);
        check_example(entry, &catalog, examples, &mut broken);
    }
    if broken.is_empty() { Ok(()) } else { Err(broken) }
}

fn is_camel_case(name: &str) -> bool {
    name.starts_with(|c: char| c.is_ascii_uppercase())
        && name.chars().all(|c| c.is_ascii_alphanumeric())
}

fn check_names(pack: &Pack, others: &[&Pack], broken: &mut Vec<String>) {
    let mut seen = BTreeSet::new();
    let strangers = others.iter().filter(|other| other.name != pack.name);
    for (pack, is_own) in strangers.map(|other| (*other, false)).chain([(pack, true)]) {
        let nodes = pack.nodes.iter().map(|node| (node.name)().into_owned());
        let values = pack.values.iter().map(|value| value.name.to_owned());
        // A node and a value type may have the same name, such as `ControlNet`. So the kind (`node` or `value`) belongs to the key.
        let names = nodes.map(|name| ("node", name)).chain(values.map(|name| ("value", name)));
        for (what, name) in names {
            if is_own && !is_camel_case(&name) {
                broken.push(format!("{what} `{name}` is not in CamelCase"));
            }
            if !seen.insert((what, name.clone())) && is_own {
                broken.push(format!("there are two {what}s `{name}`"));
            }
        }
    }
    for node in pack.nodes {
        let name = (node.name)();
        let outputs = (node.outputs)();
        let distinct: BTreeSet<_> = outputs.iter().map(|output| output.name).collect();
        if distinct.len() != outputs.len() {
            broken.push(format!("{name} has two outputs of the same name"));
        }
        for output in outputs.iter().filter(|output| !is_name(output.name)) {
            broken.push(format!("output `{}` of {name} is not in lower case", output.name));
        }
    }
}

fn is_sentence(schema: &Json) -> bool {
    let doc = schema.get("description").and_then(Json::as_str).unwrap_or_default().trim();
    doc.ends_with(['.', ':', ')', '?', '`', '|'])
}

fn check_documentation(entry: &Entry, broken: &mut Vec<String>) {
    let schema = entry.schema();
    let mut undocumented = Vec::new();
    if !is_sentence(schema) {
        undocumented.push("the node itself".to_owned());
    }
    let definitions = schema.get("$defs").and_then(Json::as_object).into_iter().flatten();
    for (owner, content) in
        definitions.map(|(name, content)| (&name[..], content)).chain([("", schema)])
    {
        for (name, field) in
            content.get("properties").and_then(Json::as_object).into_iter().flatten()
        {
            if !is_sentence(field) {
                undocumented.push(format!("field {owner} {name}"));
            }
        }
        for choice in content.get("oneOf").and_then(Json::as_array).into_iter().flatten() {
            if !is_sentence(choice) {
                undocumented.push(format!(
                    "choice {} of {owner}",
                    variants(&serde_json::json!({"oneOf": [choice]}))
                        .into_iter()
                        .map(|(name, _)| name)
                        .collect::<String>()
                ));
            }
            for content in choice.get("properties").and_then(Json::as_object).into_iter().flatten()
            {
                for (name, field) in
                    content.1.get("properties").and_then(Json::as_object).into_iter().flatten()
                {
                    if !is_sentence(field) {
                        undocumented.push(format!("field {name} of {}", content.0));
                    }
                }
            }
        }
        // A JSON schema lists the enum variants that have no documentation together under `enum`.
        if content.get("enum").is_some() {
            undocumented.push(format!("the choices of {owner}"));
        }
    }
    let name = &entry.name;
    broken.extend(undocumented.iter().map(|what| format!("{name} has no documentation: {what}")));
}

fn check_defaults(entry: &Entry, broken: &mut Vec<String>) {
    if !entry.exactness().is_sound() {
        let (name, exactness) = (&entry.name, entry.exactness());
        broken.push(format!("{name} is {exactness:?}: expected a fraction between 0 and 1"));
    }
    let schema = entry.schema();
    for (name, field) in schema.get("properties").and_then(Json::as_object).into_iter().flatten() {
        if let Some(default) = field.get("default") {
            for message in check_default(default, field, schema) {
                broken
                    .push(format!("the default of `{name}` of {} is wrong: {message}", entry.name));
            }
        }
    }
}

/// Checks the laws that need a graph which contains the node: the node's example.
fn check_example(entry: &Entry, catalog: &Catalog, examples: &Path, broken: &mut Vec<String>) {
    let example = examples.join(format!("{}.ron", entry.name));
    fn load(
        set: Vec<(String, String)>,
        path: &Path,
        catalog: &Catalog,
    ) -> maquette_graph::CheckedGraph {
        Graph::load(path, catalog, &Options { set, ..Options::default() })
    }
    let checked = load(Vec::new(), &example, catalog);
    let Some(graph) = checked.graph else {
        let why = checked.diagnostics.into_iter().map(|diagnostic| diagnostic.message);
        broken.push(format!(
            "the example {} does not check: {}",
            example.display(),
            Vec::from_iter(why).join("; ")
        ));
        return;
    };
    let Some(index) = graph.nodes().iter().position(|node| node.kind() == entry.name) else {
        broken.push(format!("the example {} has no {}", example.display(), entry.name));
        return;
    };
    let mut hashes = Vec::new();
    for threads in [1, 2, 8] {
        match run(&graph, threads) {
            Ok(values) => hashes.push(
                values.iter().map(|value| value.as_ref().map(AnyValue::hash)).collect::<Vec<_>>(),
            ),
            Err(why) => {
                broken.push(format!("the example {} does not run: {why}", example.display()));
            }
        }
    }
    if hashes.windows(2).any(|pair| pair[0] != pair[1]) {
        broken.push(format!("{} gives other bytes for another number of threads", entry.name));
    }
    for path in changes(&graph.nodes()[index].recipe.parameters, entry.schema()) {
        let set = vec![(format!("{}.{}", graph.nodes()[index].name, path.0), path.1.clone())];
        let Some(changed) = load(set, &example, catalog).graph else { continue };
        let changed_node =
            changed.find(&graph.nodes()[index].name).map(|index| &changed.nodes()[index]);
        if changed_node
            .is_some_and(|node| node.recipe.parameters == graph.nodes()[index].recipe.parameters)
        {
            broken.push(format!(
                "{}: setting `{}` to {} does not change the key",
                entry.name, path.0, path.1
            ));
        }
    }
    let Ok(values) = run_all(&graph) else { return };
    let hostile = EdgeCases(catalog.value_types());
    check_edge_cases(entry, &graph, index, &values, &hostile, broken);
    let load = |set| load(set, &example, catalog).graph;
    let case =
        extremes::Case { entry, graph: &graph, index, values: &values, edge_cases: &hostile };
    promises::check(&case, broken);
    attributes::check(&case, broken);
    cells::check(&case, broken);
    let changes = changes(&graph.nodes()[index].recipe.parameters, entry.schema());
    let others = changes
        .into_iter()
        .filter_map(|(path, to)| load(vec![(format!("{}.{path}", graph.nodes()[index].name), to)]));
    updates::check(&case, others, broken);
    extremes::check(&case, &load, broken);
    shapes::check(&case, &load, broken);
}

/// Evaluates a graph with this number of threads, and returns the first output of every node.
fn run(graph: &Graph, threads: usize) -> Result<Vec<Option<AnyValue>>, String> {
    let mut evaluator = Evaluator::new(threads, MEMORY).map_err(|error| error.to_string())?;
    let evaluation = evaluator.evaluate_all_nodes(graph, &(), &CancelToken::default());
    let errors = evaluation
        .diagnostics()
        .into_iter()
        .filter(|diagnostic| diagnostic.severity == maquette_syntax::error::Severity::Error);
    let errors: Vec<String> = errors.map(|diagnostic| diagnostic.message).collect();
    if errors.is_empty() {
        Ok((0..graph.nodes().len()).map(|node| evaluation.value(node, 0).cloned()).collect())
    } else {
        Err(errors.join("; "))
    }
}

/// Returns changes of parameters to try. Each is the path of a parameter and another value for it, as RON.
fn changes(parameters: &Json, schema: &Json) -> Vec<(String, String)> {
    let mut changes = Vec::new();
    // Change only the first four items of a list, because lists may be long and their items are similar.
    let scalars = Scalars { schema, max_items: 4 };
    scalars.visit(parameters, &mut |path, value, schema| match value {
        Json::Bool(value) => changes.push((path.into(), (!value).to_string())),
        Json::Number(number) => {
            let x = number.as_f64().unwrap_or_default();
            let is_whole = schema.get("type").and_then(Json::as_str) == Some("integer");
            let step = if is_whole { 1.0 } else { 0.125 };
            let others = [x + step, x - step, -x].into_iter().filter(|other| *other != x);
            changes.extend(others.map(|x| (path.to_owned(), x.to_string())));
        }
        Json::String(word) => {
            let others = variants(schema).into_iter().filter(|(name, _)| *name != word);
            // Write the variant without fields, because all of them may have defaults.
            changes.extend(others.map(|(name, content): (&str, Option<&Json>)| match content {
                Some(_) => (path.to_owned(), format!("{name}()")),
                None => (path.to_owned(), name.to_owned()),
            }));
        }
        _ => {}
    });
    changes
}

/// Runs the node with edge cases of its input types, replacing one input of the example at a time.
fn check_edge_cases(
    entry: &Entry,
    graph: &Graph,
    index: usize,
    values: &Values,
    hostile: &EdgeCases,
    broken: &mut Vec<String>,
) {
    let outputs = values.iter().filter(|((node, _), _)| *node == index);
    for value in outputs.map(|(_, value)| value).filter(|value| !value.can_be_read_back()) {
        broken.push(format!("{}: what `Value::decode` gives is not {value:?}", entry.name));
    }
    let node = &graph.nodes()[index];
    let Some(good) = inputs(node, values) else { return };
    let ports = entry.ports();
    for (slot, link) in node.links.iter().enumerate() {
        let Some(port) = ports.iter().find(|port| port.name == link.port) else { continue };
        for value in port.types.iter().flat_map(|kind| hostile.values(kind)) {
            let mut inputs = good.clone();
            let what = format!("{value:?}");
            let is_moderate = is_moderate(&value);
            inputs[slot] = value;
            match call_with_context(&inputs, Progress::silent(), |cx| node.node.eval(cx)) {
                Err(panic) => broken.push(format!(
                    "{} panics on a hostile {what} at `{}`: {panic}",
                    entry.name, link.port
                )),
                Ok((Err(error), _)) if is_moderate && error.to_string().contains(NOT_FINITE) => {
                    broken.push(format!(
                        "{} computes numbers that are not finite from {what} at `{}`: {error}",
                        entry.name, link.port
                    ));
                }
                Ok(_) => {}
            }
        }
    }
}

/// The end of the message of a value that cannot be made because a number is NaN or infinite.
const NOT_FINITE: &str = "is not finite";

/// The magnitude below which coordinates cannot cause an overflow in any sound computation, in mm.
const MODERATE: f64 = 1e9;

/// Returns true for a mesh whose coordinates are not so large that computations with them may overflow.
fn is_moderate(value: &AnyValue) -> bool {
    let bounds = value.get::<maquette_value::Mesh>().and_then(maquette_value::Mesh::bounds);
    bounds.is_some_and(|(low, high)| low.coords.amax().max(high.coords.amax()) < MODERATE)
}

#[cfg(test)]
mod tests {
    use schemars::JsonSchema;
    use serde::Serialize;

    use super::*;

    #[derive(Serialize, JsonSchema)]
    struct Heal {
        holes: Holes,
        method: Option<Method>,
        #[serde(flatten)]
        limits: Limits,
    }

    #[derive(Serialize, JsonSchema)]
    enum Holes {
        #[expect(dead_code, reason = "only its name is needed")]
        All,
        Region(Region),
    }

    #[derive(Serialize, JsonSchema)]
    enum Region {
        Ball { radius: f64, hard: bool },
    }

    #[derive(Serialize, JsonSchema)]
    enum Method {
        Exemplar(Exemplar),
    }

    #[derive(Serialize, JsonSchema)]
    struct Exemplar {
        levels: u32,
        start: Start,
    }

    #[derive(Serialize, JsonSchema)]
    enum Start {
        Plate,
        #[expect(dead_code, reason = "only its name is needed")]
        Cone,
    }

    #[derive(Serialize, JsonSchema)]
    struct Limits {
        count: u32,
        at: [f64; 2],
    }

    #[test]
    fn nested_parameters_are_changed() {
        let node = Heal {
            holes: Holes::Region(Region::Ball { radius: 2.0, hard: false }),
            method: Some(Method::Exemplar(Exemplar { levels: 3, start: Start::Plate })),
            limits: Limits { count: 5, at: [1.0, 0.0] },
        };
        let schema = Json::from(schemars::schema_for!(Heal));
        let changes = changes(&serde_json::to_value(&node).unwrap(), &schema);
        let changes: Vec<_> = changes.iter().map(|(path, to)| format!("{path} {to}")).collect();
        assert_eq!(
            changes,
            [
                "holes.0.radius 2.125",
                "holes.0.radius 1.875",
                "holes.0.radius -2",
                "holes.0.hard true",
                "method.levels 4",
                "method.levels 2",
                "method.levels -3",
                "method.start Cone",
                "count 6",
                "count 4",
                "count -5",
                "at.0 1.125",
                "at.0 0.875",
                "at.0 -1",
                "at.1 0.125",
                "at.1 -0.125",
            ]
        );
    }
}
