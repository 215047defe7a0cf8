//! Descriptions of node types that are independent of their Rust types, and nodes whose Rust type is not known.

use std::borrow::Cow;

use maquette_syntax::Reader;
use maquette_syntax::error::Error;
use maquette_value::{AnyValue, ValueType};
use schemars::Schema;

use super::{
    Carry, Context, Exactness, FieldError, FilePath, Node, Outputs, Previous, Source, Term,
};
use crate::blocks::Blocks;
use crate::budget::Estimate;
use crate::size::{Forecast, Sizes};

/// The description of a node type, independent of its Rust type. [`node`] creates it.
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

/// An output of a node.
#[derive(Clone, Debug)]
pub struct Output {
    /// The name of the output.
    pub name: &'static str,
    /// The name of the output's type: that of a value type or of a union.
    pub kind: &'static str,
    /// The types that the values of the output can have.
    pub types: Vec<&'static ValueType>,
}

/// Returns the description of the node type `T`.
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
        terms: || Term::collect(T::WANTS, T::PROMISES),
        carries: || T::CARRIES,
        exactness: T::EXACTNESS,
        read: |reader| Ok(Box::new(reader.read::<T>()?)),
    }
}

/// A node of any Rust type. The engine uses nodes through this trait.
#[doc(hidden)]
pub trait AnyNode: Send + Sync {
    fn estimate(&self, _: &Context<'_>) -> Option<Estimate> {
        None
    }

    /// Predicts the sizes of the outputs: see [`Node::forecast`].
    fn forecast(&self, _: &Sizes<'_>) -> Option<Forecast> {
        None
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Vec<AnyValue>, Error>;
    fn update(&self, _: &Context<'_>, _: &Previous<'_>) -> Result<Option<Vec<AnyValue>>, Error> {
        Ok(None)
    }
    fn parameters(&self) -> Result<serde_json::Value, serde_json::Error>;
    fn files(&self) -> Vec<FilePath>;

    /// Checks conditions on parameters and links before the node runs: see [`Node::check`].
    fn check(&self) -> Result<(), FieldError> {
        Ok(())
    }

    /// Returns the reason why the node can never run, such as an unknown type. `None` if it can run.
    fn missing_reason(&self) -> Option<String> {
        None
    }

    /// Returns how the node handles a part of the points: see [`Node::BLOCKS`].
    fn blocks(&self) -> Blocks {
        Blocks::Whole
    }

    /// Returns the required properties of inputs, as pairs of a port and a property.
    fn wants(&self) -> Vec<(&'static str, &'static str)> {
        Vec::new()
    }

    /// Returns the guaranteed properties of outputs. Each item is an output, a property, and the condition of the guarantee.
    fn promises(&self) -> Vec<(&'static str, &'static str, Source)> {
        Vec::new()
    }
}

impl<T: Node> AnyNode for T {
    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        Node::estimate(self, cx)
    }

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        Node::forecast(self, sizes)
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

    fn blocks(&self) -> Blocks {
        T::BLOCKS
    }

    fn wants(&self) -> Vec<(&'static str, &'static str)> {
        T::WANTS.iter().filter_map(|want| want.for_node(self)).collect()
    }

    fn promises(&self) -> Vec<(&'static str, &'static str, Source)> {
        T::PROMISES.iter().filter_map(|promise| promise.for_node(self)).collect()
    }
}
