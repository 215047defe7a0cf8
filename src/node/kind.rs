//! What the engine knows of a type of nodes, and of a node of a graph, whatever its type is.

use std::borrow::Cow;

use maquette_syntax::Reader;
use maquette_syntax::error::Error;
use maquette_value::{AnyValue, ValueType};
use schemars::Schema;

use super::{
    Carry, Context, Exactness, FieldError, FilePath, Node, Outputs, Previous, Source, Term,
};
use crate::limit::Estimate;

/// What the engine knows of a node. Made by [`node`].
#[derive(Clone, Copy)]
pub struct NodeType {
    #[doc(hidden)]
    pub name: fn() -> Cow<'static, str>,
    #[doc(hidden)]
    pub schema: fn() -> Schema,
    #[doc(hidden)]
    pub outputs: fn() -> Vec<Output>,
    #[doc(hidden)]
    pub terms: fn() -> Vec<Term>,
    #[doc(hidden)]
    pub carries: fn() -> &'static [Carry],
    #[doc(hidden)]
    pub exactness: Exactness,
    #[doc(hidden)]
    pub read: fn(&Reader<'_>) -> Result<Box<dyn AnyNode>, maquette_syntax::ReadError>,
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
        exactness: T::EXACTNESS,
        read: |reader| Ok(Box::new(reader.read::<T>()?)),
    }
}

/// A node of a graph, of whatever type.
#[doc(hidden)]
pub trait AnyNode: Send + Sync {
    fn estimate(&self, _: &Context<'_>) -> Option<Estimate> {
        None
    }
    fn eval(&self, cx: &Context<'_>) -> Result<Vec<AnyValue>, Error>;
    fn update(&self, _: &Context<'_>, _: &Previous<'_>) -> Result<Option<Vec<AnyValue>>, Error> {
        Ok(None)
    }
    fn parameters(&self) -> Result<serde_json::Value, serde_json::Error>;
    fn files(&self) -> Vec<FilePath>;

    /// As [`Node::check`].
    fn check(&self) -> Result<(), FieldError> {
        Ok(())
    }

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

    fn check(&self) -> Result<(), FieldError> {
        Node::check(self)
    }

    fn wants(&self) -> Vec<(&'static str, &'static str)> {
        T::WANTS.iter().filter_map(|want| want.of(self)).collect()
    }

    fn promises(&self) -> Vec<(&'static str, &'static str, Source)> {
        T::PROMISES.iter().filter_map(|promise| promise.of(self)).collect()
    }
}
