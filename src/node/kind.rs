//! What the engine knows of a type of nodes, and of a node of a graph, whatever its type is.

use std::borrow::Cow;

use maquette_syntax::Reader;
use maquette_syntax::error::Error;
use maquette_value::{AnyValue, ValueType};
use schemars::Schema;

use super::{Carry, Context, FilePath, Node, Outputs, Previous, Source, Term};
use crate::limit::Estimate;

/// What the engine knows of a node. Made by [`node`].
#[derive(Clone, Copy)]
pub struct NodeType {
    pub(crate) name: fn() -> Cow<'static, str>,
    pub(crate) schema: fn() -> Schema,
    pub(crate) outputs: fn() -> Vec<Output>,
    pub(crate) terms: fn() -> Vec<Term>,
    pub(crate) carries: fn() -> &'static [Carry],
    pub(crate) read: fn(&Reader<'_>) -> Result<Box<dyn AnyNode>, maquette_syntax::ReadError>,
    /// The id of the build that its code is of; empty if that is not known.
    pub(crate) build: fn() -> &'static str,
    /// The version of its pack; empty if that is not known.
    pub(crate) version: &'static str,
}

impl NodeType {
    /// The same node, with the id of the build that its code is of, which the engine's `build.rs` makes; empty if it is not known.
    /// Programs whose packs are of the same builds share the results that are kept on disk. A node without an id is known by the
    /// file that its code was loaded from.
    #[must_use]
    pub const fn of_build(self, id: fn() -> &'static str) -> Self {
        Self { build: id, ..self }
    }

    /// The same node, with the version of its pack, which files tell that were made by it.
    #[must_use]
    pub const fn of_version(self, version: &'static str) -> Self {
        Self { version, ..self }
    }
}

/// Declares `node` for a crate that is built with the engine's `build.rs`: as [`node`](crate::node()), [of the crate's
/// build](NodeType::of_build).
#[macro_export]
macro_rules! nodes_of_this_build {
    () => {
        // Apart from the list of nodes, which need not be compiled again for each new id.
        mod build_id {
            pub(super) fn build_id() -> &'static str {
                env!("MAQUETTE_BUILD", "the build script of this package must be the engine's")
            }
        }

        const fn node<T: $crate::Node>() -> $crate::NodeType {
            $crate::node::<T>().of_build(build_id::build_id).of_version(env!("CARGO_PKG_VERSION"))
        }
    };
}

/// One output of a node.
#[derive(Clone, Debug)]
pub struct Output {
    /// Its name.
    pub name: &'static str,
    /// The name of its type: a value, or a union.
    pub kind: &'static str,
    /// The values that it may be.
    pub types: Vec<&'static ValueType>,
}

/// The description of the node `T` for the engine.
pub const fn node<T: Node>() -> NodeType {
    NodeType {
        name: T::schema_name,
        schema: || {
            schemars::generate::SchemaSettings::draft2020_12()
                .into_generator()
                .into_root_schema_for::<T>()
        },
        outputs: || {
            let types = <T::Outputs as Outputs>::types();
            let names = T::OUTPUTS;
            let pairs = names.as_ref().iter().zip(types);
            pairs.map(|(name, (kind, types))| Output { name, kind, types }).collect()
        },
        terms: || Term::all(T::WANTS, T::PROMISES),
        carries: || T::CARRIES,
        read: |reader| Ok(Box::new(reader.read::<T>()?)),
        build: || "",
        version: "",
    }
}

/// A node of a graph, of whatever type.
pub(crate) trait AnyNode: Send + Sync {
    fn estimate(&self, _: &Context<'_>) -> Option<Estimate> {
        None
    }
    fn eval(&self, cx: &Context<'_>) -> Result<Vec<AnyValue>, Error>;
    fn update(&self, _: &Context<'_>, _: &Previous<'_>) -> Result<Option<Vec<AnyValue>>, Error> {
        Ok(None)
    }
    fn parameters(&self) -> Result<serde_json::Value, serde_json::Error>;
    fn files(&self) -> Vec<FilePath>;

    /// Why it cannot run, whatever comes in.
    fn lacks(&self) -> Option<String> {
        None
    }

    /// Properties of the values at ports.
    fn wants(&self) -> Vec<(&'static str, &'static str)> {
        Vec::new()
    }

    /// Properties of the values at outputs.
    fn promises(&self) -> Vec<(&'static str, &'static str, Source)> {
        Vec::new()
    }
}

impl<T: Node> AnyNode for T {
    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        Node::estimate(self, cx)
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Vec<AnyValue>, Error> {
        Node::eval(self, cx).map(Outputs::into_any)
    }

    fn update(
        &self,
        cx: &Context<'_>,
        previous: &Previous<'_>,
    ) -> Result<Option<Vec<AnyValue>>, Error> {
        Ok(Node::update(self, cx, previous)?.map(Outputs::into_any))
    }

    fn parameters(&self) -> Result<serde_json::Value, serde_json::Error> {
        serde_json::to_value(self)
    }

    fn files(&self) -> Vec<FilePath> {
        Node::files(self)
    }

    fn wants(&self) -> Vec<(&'static str, &'static str)> {
        T::WANTS.iter().filter_map(|want| want.of(self)).collect()
    }

    fn promises(&self) -> Vec<(&'static str, &'static str, Source)> {
        T::PROMISES.iter().filter_map(|promise| promise.of(self)).collect()
    }
}
