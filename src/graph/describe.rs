//! Descriptions of graphs that are used as nodes, in the form in which built-in nodes are described.

use maquette_node::Exactness;
use serde_json::{Map, Value as Json};

use super::definition::Definition;
use crate::catalog::Description;

/// The description of a graph that another graph uses as a node.
#[derive(Clone)]
pub struct Subgraph {
    /// The node type under which the other graph uses this one.
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
            file: definition.source_map.source.name.display().to_string(),
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

    /// Returns the schema of the graph's fields.
    pub fn schema(&self) -> &Json {
        &self.schema
    }

    /// Makes the used graphs of an old and a new file comparable. If the defaults of a parameter differ, both are removed, because an
    /// omitted field has a different value on each side. A graph that only one side could read is copied to the other side.
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
        let (from_old, from_new) = (Self::missing_in(new, old), Self::missing_in(old, new));
        old.extend(from_new);
        new.extend(from_old);
    }

    /// Returns the graphs in `from` whose names do not occur in `to`.
    fn missing_in(to: &[Self], from: &[Self]) -> Vec<Self> {
        from.iter()
            .filter(|graph| to.iter().all(|other| other.name != graph.name))
            .cloned()
            .collect()
    }

    /// Returns the name of the first output of the graph.
    pub(super) fn first_output(&self) -> Option<&str> {
        self.outputs.first().map(|(name, _)| &name[..])
    }
}
