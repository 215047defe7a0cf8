//! The record of the last evaluation of a graph, without values. The next process compares it with the graph to find out what has changed.

use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use maquette_graph::Recipe;
use maquette_graph::files::KnownFile;
use maquette_node::ValueSize;
use maquette_value::Hash;
use serde::{Deserialize, Serialize};
use serde_json::Value as Json;

use super::super::cache::Outcome;
use super::super::key::Parts;
use super::super::snapshot::{NodeRecord, Snapshot};
use super::Store;

#[derive(Serialize, Deserialize)]
struct Record {
    version: u32,
    /// The absolute path of the graph file. `None` if the path is not valid Unicode, or if an old version of the program wrote the record.
    #[serde(default)]
    graph: Option<String>,
    /// The hash of the graph's structure (its nodes and links).
    shape: Hash,
    nodes: Vec<Node>,
    files: Vec<KnownFile>,
}

const VERSION: u32 = 3;

#[derive(Serialize, Deserialize)]
struct Node {
    name: String,
    /// True if the last evaluation produced this result, and false if it is left from an earlier evaluation.
    found: bool,
    result: Option<NodeResult>,
}

#[derive(Serialize, Deserialize)]
struct NodeResult {
    kind: String,
    parameters: Json,
    identity: Hash,
    inputs: Vec<Hash>,
    files: Vec<Option<Hash>>,
    outputs: Vec<(String, Hash)>,
    warnings: Vec<String>,
    bytes: usize,
    seconds: f64,
    shapes: Vec<String>,
    #[serde(default)]
    sizes: Vec<ValueSize>,
}

pub(super) fn write(snapshot: &Snapshot, files: &[KnownFile]) -> Vec<u8> {
    let Snapshot { shape, names, results, is_current: found, .. } = snapshot;
    let nodes = names.iter().zip(results).zip(found).map(|((name, done), &found)| Node {
        name: name.clone(),
        found,
        result: done.as_ref().map(|done| to_result(done)),
    });
    let nodes = nodes.collect();
    let graph = std::path::absolute(&snapshot.graph).ok();
    let graph = graph.and_then(|graph| Some(graph.to_str()?.to_owned()));
    let record = Record { version: VERSION, graph, shape: *shape, nodes, files: files.to_vec() };
    serde_json::to_vec(&record).unwrap_or_default()
}

/// The key of a result, with the name and the type of the node that computed it.
pub(super) type ResultOwner = (Hash, String, String);

/// Returns the path of the graph file (`None` if the record does not contain it), and the owners of the last results of the graph's nodes.
/// Returns `None` if the bytes are not a record.
pub(super) fn read_owners(bytes: &[u8]) -> Option<(Option<PathBuf>, Vec<ResultOwner>)> {
    let record: Record = serde_json::from_slice(bytes).ok()?;
    let nodes = record.nodes.into_iter().filter_map(|node| {
        let NodeResult { kind, parameters, identity, inputs, files, .. } = node.result?;
        let recipe = Arc::new(Recipe { kind: kind.clone(), parameters, identity });
        let parts = Parts { recipe, inputs: inputs.into(), files: files.into() };
        Some((parts.key(), node.name, kind))
    });
    Some((record.graph.map(PathBuf::from), nodes.collect()))
}

fn to_result(done: &NodeRecord) -> NodeResult {
    let (parts, outcome) = (&done.parts, &done.outcome);
    NodeResult {
        kind: parts.recipe.kind.clone(),
        parameters: parts.recipe.parameters.clone(),
        identity: parts.recipe.identity,
        inputs: parts.inputs.to_vec(),
        files: parts.files.to_vec(),
        outputs: outcome.outputs.iter().map(|(kind, hash)| ((*kind).to_owned(), *hash)).collect(),
        warnings: outcome.warnings.to_vec(),
        bytes: outcome.bytes,
        seconds: outcome.seconds,
        shapes: outcome.descriptions.to_vec(),
        sizes: outcome.sizes.to_vec(),
    }
}

/// Returns the snapshot in a record, and the metadata of the files that were read. Returns `None` if the record has another version or
/// contains an unknown type.
pub(super) fn read(
    bytes: &[u8],
    graph: &Path,
    store: &Store,
) -> Option<(Snapshot, Vec<KnownFile>)> {
    let record: Record = serde_json::from_slice(bytes).ok()?;
    if record.version != VERSION {
        return None;
    }
    let (mut names, mut results, mut found) = (Vec::new(), Vec::new(), Vec::new());
    for node in record.nodes {
        let result = match node.result {
            Some(result) => Some(Arc::new(parse_result(result, store)?)),
            None => None,
        };
        names.push(node.name);
        found.push(node.found && result.is_some());
        results.push(result);
    }
    let snapshot = Snapshot {
        graph: graph.to_owned(),
        shape: record.shape,
        identities: Arc::default(),
        names: names.into(),
        results,
        is_current: found,
        positions: OnceLock::new(),
    };
    Some((snapshot, record.files))
}

fn parse_result(result: NodeResult, store: &Store) -> Option<NodeRecord> {
    let NodeResult { kind, parameters, identity, .. } = result;
    let outputs = result.outputs.iter();
    let outputs = outputs.map(|(kind, hash)| Some((store.types.get(&kind[..])?.name, *hash)));
    let outputs = outputs.collect::<Option<_>>()?;
    let parts = Parts {
        recipe: Arc::new(Recipe { kind, parameters, identity }),
        inputs: result.inputs.into(),
        files: result.files.into(),
    };
    let known = Outcome::without_values(outputs, result.warnings, result.bytes, result.seconds);
    let outcome = known.with_descriptions(result.shapes, result.sizes);
    Some(NodeRecord { key: parts.key(), parts, outcome: Arc::new(outcome) })
}
