//! The key of a node's result: a hash of everything from which the result is computed.
//!
//! The key contains the hashes of the input *values*, not the keys of the inputs. If an input is computed again and its value is equal to
//! the old one, the node's key does not change, and the node need not run. The cost is that each new value must be hashed once.

use std::sync::Arc;

use maquette_graph::{Recipe, parameter_difference};
use maquette_value::Hash;
use serde_json::Value as Json;

/// Everything from which a result is computed: the node's recipe (its type and parameters), its inputs and its files.
#[derive(Clone, Debug)]
pub(super) struct Parts {
    pub(super) recipe: Arc<Recipe>,
    /// The hashes of the values at the node's input links, in the order of the links.
    pub(super) inputs: Box<[Hash]>,
    /// The hash of the content of each file; `None` for a missing file.
    pub(super) files: Box<[Option<Hash>]>,
}

/// The first difference between two computations of one node.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Change {
    /// The node has another type; `before` is the previous one.
    Kind { before: String },
    /// A parameter of the node has another value. `path` leads to the parameter through the fields of the node.
    Parameter { path: Vec<String>, before: Json, now: Json },
    /// The input value at the link with this index is different.
    Input(usize),
    /// The content of the file with this index is different.
    File(usize),
}

impl Parts {
    pub(super) fn key(&self) -> Hash {
        let mut content = Vec::with_capacity(32 * (1 + self.inputs.len()) + 33 * self.files.len());
        content.extend_from_slice(&self.recipe.identity.0);
        for input in &self.inputs {
            content.extend_from_slice(&input.0);
        }
        for file in &self.files {
            content.push(u8::from(file.is_some()));
            content.extend_from_slice(&file.map_or([0; 32], |hash| hash.0));
        }
        Hash::compute(&content)
    }

    /// Returns the first difference between these parts and `before`, the parts of an earlier computation; `None` if all parts are equal.
    pub(super) fn change(&self, before: &Self) -> Option<Change> {
        if self.recipe.identity != before.recipe.identity {
            if self.recipe.kind != before.recipe.kind {
                return Some(Change::Kind { before: before.recipe.kind.clone() });
            }
            let found = parameter_difference(&before.recipe.parameters, &self.recipe.parameters);
            if let Some((path, before, now)) = found {
                return Some(Change::Parameter { path, before, now });
            }
        }
        let input = first_difference(&self.inputs, &before.inputs).map(Change::Input);
        input.or_else(|| first_difference(&self.files, &before.files).map(Change::File))
    }
}

fn first_difference<T: PartialEq>(now: &[T], before: &[T]) -> Option<usize> {
    let same = now.iter().zip(before).take_while(|(a, b)| a == b).count();
    (same < now.len()).then_some(same)
}

#[cfg(test)]
mod tests {
    use maquette_syntax::LINK;
    use serde_json::json;

    use super::*;

    fn recipe(parameters: Json) -> Recipe {
        Recipe::new("Threshold", parameters, &[])
    }

    #[test]
    fn the_first_parameter_that_differs_is_found_with_its_values() {
        fn parts(distance: f64) -> Parts {
            Parts {
                recipe: Arc::new(recipe(json!({
                    "image": { LINK: 0 },
                    "select": { "Near": { "color": "#ff0000", "distance": distance } },
                }))),
                inputs: [Hash::compute(b"image")].into(),
                files: [].into(),
            }
        }
        let path = ["select", "Near", "distance"].map(str::to_owned).to_vec();
        let expected = Change::Parameter { path, before: json!(30.0), now: json!(25.5) };
        assert_eq!(parts(25.5).change(&parts(30.0)), Some(expected));
        assert_eq!(parts(25.5).change(&parts(25.5)), None);
    }
}
