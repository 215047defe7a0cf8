//! The trait of node types, which are the steps of a graph.

use maquette_syntax::error::Error;
use schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::blocks::Blocks;
use crate::budget::Estimate;
use crate::carry::Carry;
use crate::context::Context;
use crate::exactness::Exactness;
use crate::field_error::FieldError;
use crate::file::FilePath;
use crate::port::Outputs;
use crate::previous::Previous;
use crate::size::{Forecast, Sizes, ValueSize};
use crate::terms::{Promise, Want};

/// A node type, which is a kind of step of a graph: its fields, its outputs, its documentation and its computation.
///
/// A field of type [`In<T>`](crate::In), `Option<In<T>>` or `Vec<In<T>>` is a port. A field of type [`FilePath`] is the path of a file to
/// be read. Every other field is a parameter. The doc comments of the type and of its fields are the user's manual. The attribute
/// `#[schemars(range(..))]` states the range of a parameter. The attribute `#[schemars(extend("unit" = "mm"))]` states its unit, which the
/// manual and messages print.
pub trait Node: Serialize + DeserializeOwned + JsonSchema + Send + Sync + 'static {
    /// The types of the outputs, as a tuple.
    type Outputs: Outputs;

    /// The names of the outputs. A link that contains no output name refers to the first output.
    const OUTPUTS: <Self::Outputs as Outputs>::Names;

    /// The properties that the node requires of its inputs.
    const WANTS: &'static [Want<Self>] = &[];

    /// The properties that the node guarantees for its outputs. They must hold for all inputs that the node accepts.
    const PROMISES: &'static [Promise<Self>] = &[];

    /// The transfer of attributes: one entry for each pair of a port and an output that both have meshes, points or range images.
    const CARRIES: &'static [Carry] = &[];

    /// How closely the results agree between machines and builds. By default they have the same bytes.
    const EXACTNESS: Exactness = Exactness::Exact;

    /// How the node handles a part of the points, so that a large file need not be in memory as a whole. Only for nodes with one output,
    /// which take points at one port, or read them from the file of their only [`FilePath`]. A node that reads a file must be
    /// [`Each`](Blocks::Each). The node may only warn if its result is empty: warnings about blocks are dropped.
    const BLOCKS: Blocks = Blocks::Whole;

    /// Returns optional files to be read, in addition to the files in the fields.
    fn files(&self) -> Vec<FilePath> {
        Vec::new()
    }

    /// Checks conditions on parameters and links that the types of the fields cannot express. Errors are then reported before the graph
    /// runs.
    ///
    /// # Errors
    /// The node would fail for all inputs.
    fn check(&self) -> Result<(), FieldError> {
        Ok(())
    }

    /// Returns an upper bound of the memory that [`eval`](Self::eval) needs. `None` if the bound is unknown. Return a bound if the result
    /// can be much larger than the inputs: the node is then rejected with a message instead of exhausting the memory.
    ///
    /// The inputs are in the context. The method must be fast and deterministic, and must not allocate much memory. The default is the
    /// memory in the [`forecast`](Self::forecast), for the sizes of the inputs.
    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let inputs = |slot: usize| cx.inputs.get(slot).map(ValueSize::of_value);
        self.forecast(&Sizes { inputs: &inputs, files: &|_, _| None })?.memory
    }

    /// Predicts the sizes of the outputs and the memory of the node from the sizes of its inputs and files, before any of them is computed
    /// or read. `maquette check --preflight` prints them. `None` if they are unknown: each output is then taken to be as large as the
    /// largest input.
    ///
    /// The method must be fast, and correct within a factor of 2 where it does not return a [guess](crate::Certainty::Guess).
    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        let _ = sizes;
        None
    }

    /// Computes the outputs. This must be a pure function of the parameters, the inputs and the files. The outputs must have the same bytes
    /// for any number of threads. [`EXACTNESS`](Self::EXACTNESS) states if the bytes are also the same on other machines.
    ///
    /// # Errors
    /// The inputs are invalid. The message must not contain a position, because the engine adds it.
    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error>;

    /// Computes the outputs for new inputs from the outputs of the previous run. Bytes and warnings must be the same as those of
    /// [`eval`](Self::eval). `maquette::conformance` checks this for nodes that return `Some` when the inputs are unchanged. Return `None`
    /// if an update would not be faster; `eval` is then called.
    ///
    /// # Errors
    /// The same errors as in `eval`.
    fn update(
        &self,
        cx: &Context<'_>,
        previous: &Previous<'_>,
    ) -> Result<Option<Self::Outputs>, Error> {
        let _ = (cx, previous);
        Ok(None)
    }
}
