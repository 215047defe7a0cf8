//! What is told of a graph that others use: the same as of a built-in node.

use maquette_node::Exactness;
use serde_json::{Map, Value as Json};

use super::definition::Definition;
use crate::catalog::Description;

/// A graph that others use, as far as they see it.
#[derive(Clone)]
pub struct Subgraph {
    /// The type of nodes that it is for who uses it.
    pub name: String,
    pub file: String,
    version: Option<String>,
    schema: Json,
    outputs: Vec<(String, Vec<&'static str>)>,
    promises: Vec<(String, String)>,
    exactness: Exactness,
}

impl Subgraph {
    pub fn new(name: &str, definition: &Definition) -> Self {
        Self {
            name: name.to_owned(),
            file: definition.sheet.source.name.display().to_string(),
            version: definition.version.as_ref().map(ToString::to_string),
            schema: definition.fields.clone(),
            outputs: definition
                .ports
                .iter()
                .map(|port| (port.name.clone(), port.kind.iter().map(|kind| kind.name).collect()))
                .collect(),
            promises: definition.promises().map(|(port, it)| (port.into(), it.into())).collect(),
            exactness: definition.exactness(),
        }
    }

    pub fn description(&self) -> Description<'_> {
        let (name, pack, schema) = (&self.name[..], &self.file[..], &self.schema);
        let (outputs, promises) = (self.outputs.clone(), self.promises.clone());
        let (version, exactness) = (self.version.as_deref(), self.exactness);
        Description { name, pack, version, schema, outputs, promises, carries: &[], exactness }
    }

    /// The description of its fields as a built-in node's.
    pub fn schema(&self) -> &Json {
        &self.schema
    }

    /// Makes two graphs' uses speak of the same defaults: of a used graph that both have, those that differ are forgotten, since a value
    /// that is the default of one of them alone says something; one that cannot be read on one side is taken from the other.
    pub(super) fn make_comparable(old: &mut Vec<Self>, new: &mut Vec<Self>) {
        fn properties(graph: &mut Subgraph) -> Option<&mut Map<String, Json>> {
            graph.schema.get_mut("properties").and_then(Json::as_object_mut)
        }
        for old in &mut *old {
            let Some(new) = new.iter_mut().find(|new| new.name == old.name) else { continue };
            let Some((old, new)) = properties(old).zip(properties(new)) else { continue };
            for (name, old) in old {
                let Some(new) = new.get_mut(name) else { continue };
                if ["default", "draft"].iter().any(|side| old.get(side) != new.get(side)) {
                    for field in [old, new].into_iter().filter_map(Json::as_object_mut) {
                        field.remove("default");
                        field.remove("draft");
                    }
                }
            }
        }
        let missing = |from: &[Self], to: &[Self]| {
            from.iter()
                .filter(|graph| to.iter().all(|other| other.name != graph.name))
                .cloned()
                .collect::<Vec<_>>()
        };
        let (from_old, from_new) = (missing(old, new), missing(new, old));
        old.extend(from_new);
        new.extend(from_old);
    }

    /// The name of its first output.
    pub(super) fn first_output(&self) -> Option<&str> {
        self.outputs.first().map(|(name, _)| &name[..])
    }
}
