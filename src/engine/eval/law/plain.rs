//! A reference evaluation without a cache: every needed node runs, in the graph's order.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use maquette_graph::{Graph, GraphNode};
use maquette_node::{Context, File, Progress};
use maquette_value::{AnyValue, Hash};

use crate::eval::key::Parts;

/// The right result of a node, computed without a cache.
pub(super) enum Truth {
    /// No requested node depends on this node.
    Unwanted,
    Given {
        values: Vec<AnyValue>,
        parts: Parts,
    },
    /// The node fails.
    Fails,
    /// The node depends on a node that fails.
    Skipped,
}

impl Truth {
    pub(super) fn hash(&self, output: usize) -> Option<Hash> {
        match self {
            Self::Given { values, .. } => Some(values[output].hash()),
            _ => None,
        }
    }

    pub(super) fn is_wanted(&self) -> bool {
        !matches!(self, Self::Unwanted)
    }
}

/// Returns the right result of each node when the nodes `roots` are requested.
pub(super) fn evaluate(graph: &Graph, roots: &[usize]) -> Vec<Truth> {
    let mut wanted = vec![false; graph.nodes().len()];
    roots.iter().for_each(|&root| wanted[root] = true);
    for (index, node) in graph.nodes().iter().enumerate().rev() {
        if wanted[index] {
            node.links.iter().for_each(|link| wanted[link.node] = true);
        }
    }
    let mut truths: Vec<Truth> = Vec::new();
    for (index, node) in graph.nodes().iter().enumerate() {
        let truth =
            if wanted[index] { evaluate_node(graph, node, &truths) } else { Truth::Unwanted };
        truths.push(truth);
    }
    truths
}

fn evaluate_node(graph: &Graph, node: &GraphNode, before: &[Truth]) -> Truth {
    let Some(inputs) = node
        .links
        .iter()
        .map(|link| match &before[link.node] {
            Truth::Given { values, .. } => Some(values[link.output].clone()),
            _ => None,
        })
        .collect::<Option<Vec<AnyValue>>>()
    else {
        return Truth::Skipped;
    };
    let mut files: BTreeMap<PathBuf, Option<File>> = BTreeMap::new();
    for file in &node.files {
        let bytes = std::fs::read(&file.path).ok();
        if bytes.is_none() && file.needed {
            return Truth::Fails;
        }
        let found = bytes.map(|bytes| File {
            name: file.given.clone(),
            hash: Hash::compute(&bytes),
            bytes: bytes.into(),
            companions: Arc::default(),
        });
        files.insert(file.path.clone(), found);
    }
    let hashes = node.files.iter().map(|file| files[&file.path].as_ref().map(|file| file.hash));
    let parts = Parts {
        recipe: node.recipe.clone(),
        inputs: inputs.iter().map(AnyValue::hash).collect(),
        files: hashes.collect(),
    };
    let cx = Context {
        inputs: &inputs,
        files: &files,
        progress: Progress::silent(),
        memos: None,
        readers: graph.readers(),
        block: None,
        warnings: Mutex::default(),
    };
    match catch_unwind(AssertUnwindSafe(|| node.node.eval(&cx))) {
        Ok(Ok(values)) => Truth::Given { values, parts },
        _ => Truth::Fails,
    }
}
