//! What the last evaluation of a graph found, without values: so that the next process knows at once what changed, and why.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::Value as Json;

use super::super::cache::Outcome;
use super::super::files::KnownFile;
use super::super::key::{Parts, Recipe};
use super::super::snapshot::{Done, Fate, Snapshot};
use super::Store;
use crate::graph::Shape;
use crate::value::Hash;

#[derive(Serialize, Deserialize)]
struct Record {
    version: u32,
    nodes: Vec<Node>,
    files: Vec<KnownFile>,
}

const VERSION: u32 = 1;

#[derive(Serialize, Deserialize)]
struct Node {
    name: String,
    mark: Hash,
    /// Whether the result is of the last evaluation; none if there is no result.
    current: Option<bool>,
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
}

pub(super) fn write(snapshot: &Snapshot, files: &[KnownFile]) -> Vec<u8> {
    let shape = &snapshot.shape;
    let node = |((name, mark), fate): ((&String, &Hash), &Fate)| {
        let (current, done) = match fate {
            Fate::Unknown => (None, None),
            Fate::Stale(done) => (Some(false), Some(done)),
            Fate::Current(done) => (Some(true), Some(done)),
        };
        let result = done.map(|done| result(done));
        Node { name: name.clone(), mark: *mark, current, result }
    };
    let nodes = shape.names.iter().zip(&shape.marks).zip(&snapshot.fates).map(node).collect();
    let record = Record { version: VERSION, nodes, files: files.to_vec() };
    serde_json::to_vec(&record).unwrap_or_default()
}

fn result(done: &Done) -> NodeResult {
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
    }
}

/// The snapshot in a record, with the files that were read; none if it is of another version, or names an unknown type.
pub(super) fn read(bytes: &[u8], store: &Store) -> Option<(Snapshot, Vec<KnownFile>)> {
    let record: Record = serde_json::from_slice(bytes).ok()?;
    if record.version != VERSION {
        return None;
    }
    let mut shape = Shape::default();
    let mut fates = Vec::new();
    for node in record.nodes {
        shape.names.push(node.name);
        shape.marks.push(node.mark);
        let done = match node.result {
            Some(result) => Some(Arc::new(done(result, store)?)),
            None => None,
        };
        fates.push(match (done, node.current) {
            (Some(done), Some(true)) => Fate::Current(done),
            (Some(done), _) => Fate::Stale(done),
            (None, _) => Fate::Unknown,
        });
    }
    Some((Snapshot::new(Arc::new(shape), fates), record.files))
}

fn done(result: NodeResult, store: &Store) -> Option<Done> {
    let NodeResult { kind, parameters, identity, .. } = result;
    let outputs = result.outputs.iter();
    let outputs = outputs.map(|(kind, hash)| Some((store.types.get(&kind[..])?.name, *hash)));
    let outputs = outputs.collect::<Option<_>>()?;
    let parts = Parts {
        recipe: Arc::new(Recipe { kind, parameters, identity }),
        inputs: result.inputs.into(),
        files: result.files.into(),
    };
    let outcome = Outcome::known(outputs, result.warnings, result.bytes, result.seconds);
    Some(Done { key: parts.key(), parts, outcome: Arc::new(outcome) })
}
