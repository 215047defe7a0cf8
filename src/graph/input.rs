//! What stands for an input of a graph that is looked at by itself.

use std::sync::Arc;

use serde_json::json;

use super::node::Built;
use super::recipe::Recipe;
use crate::error::Error;
use crate::node::{AnyNode, Context, FilePath};
use crate::text::Tree;
use crate::value::AnyValue;

/// A node that has no value: only a graph that uses this one gives it one.
struct Input(String);

/// A graph was evaluated that only makes sense in another one.
#[derive(Debug, thiserror::Error)]
#[error("`{0}` is an input: only a graph that uses this one gives it a value")]
struct NoValue(String);

impl AnyNode for Input {
    fn eval(&self, _: &Context<'_>) -> Result<Vec<AnyValue>, Error> {
        Err(NoValue(self.0.clone()).into())
    }

    fn parameters(&self) -> Result<serde_json::Value, serde_json::Error> {
        Ok(json!({ "name": self.0 }))
    }

    fn files(&self) -> Vec<FilePath> {
        Vec::new()
    }
}

pub(super) fn input_node(name: &str, tree: &Tree) -> Built {
    let recipe = Arc::new(Recipe::new("Input", json!({ "name": name }), &[]));
    let (node, files) = (Arc::new(Input(name.to_owned())), Vec::new());
    Built { node, recipe, files, tree: Arc::new(tree.clone()) }
}
