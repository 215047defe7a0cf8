//! A step of a graph.

use maquette_syntax::error::Error;
use schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::budget::Estimate;
use crate::carry::Carry;
use crate::context::Context;
use crate::exactness::Exactness;
use crate::field_error::FieldError;
use crate::file::FilePath;
use crate::port::Outputs;
use crate::previous::Previous;
use crate::terms::{Promise, Want};

/// A step of a graph with its complete description.
///
/// A field of type [`In<T>`](crate::In), `Option<In<T>>` or `Vec<In<T>>` is a port. A field of type [`FilePath`] names a file to read.
/// Every other field is a parameter. The doc comments of the type and of its fields are the user's manual. `#[schemars(range(..))]` states
/// the numbers that a parameter accepts, and `#[schemars(extend("unit" = "mm"))]` states the unit that the manual and messages print beside
/// them.
pub trait Node: Serialize + DeserializeOwned + JsonSchema + Send + Sync + 'static {
    /// The outputs: a tuple of the types of their values.
    type Outputs: Outputs;

    /// The names of the outputs. A link without an output name refers to the first output.
    const OUTPUTS: <Self::Outputs as Outputs>::Names;

    /// The properties that the node requires of its inputs.
    const WANTS: &'static [Want<Self>] = &[];

    /// The properties that the node guarantees for its outputs. They must hold for all accepted inputs.
    const PROMISES: &'static [Promise<Self>] = &[];

    /// The transfer of attributes. It has one entry for each pair of a port and an output that both carry meshes, points or range images.
    const CARRIES: &'static [Carry] = &[];

    /// The degree to which the results are reproducible on other machines and with other builds. By default the results have the same
    /// bytes.
    const EXACTNESS: Exactness = Exactness::Exact;

    /// Returns optional files that are read in addition to those that the fields name.
    fn files(&self) -> Vec<FilePath> {
        Vec::new()
    }

    /// Checks conditions on parameters and links that the types of the fields cannot express, so that errors are reported before the graph
    /// runs.
    ///
    /// # Errors
    /// If every run of the node would fail.
    fn check(&self) -> Result<(), FieldError> {
        Ok(())
    }

    /// Returns an upper bound of the memory that [`eval`](Self::eval) needs. `None` if it is not known. A node whose result may be much
    /// larger than its inputs should return a bound: the node is then rejected with a message instead of exhausting the memory.
    ///
    /// The context gives access to the inputs. The method must be fast, must not allocate much, and must be deterministic.
    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let _ = cx;
        None
    }

    /// Computes the outputs. This must be a pure function of the parameters, the inputs and the files, and the outputs must have the same
    /// bytes for any number of threads. [`EXACTNESS`](Self::EXACTNESS) says if the bytes are also the same on other machines.
    ///
    /// # Errors
    /// If the inputs are invalid. The message must not contain a position; the engine adds it.
    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error>;

    /// Updates the previous outputs for new inputs. The result must have the same bytes and warnings as that of [`eval`](Self::eval).
    /// `maquette::conformance` checks this for nodes that return `Some` when the inputs are unchanged. If an update is not faster than
    /// `eval`, the method returns `None`, and `eval` is called.
    ///
    /// # Errors
    /// The errors of `eval`.
    fn update(
        &self,
        cx: &Context<'_>,
        previous: &Previous<'_>,
    ) -> Result<Option<Self::Outputs>, Error> {
        let _ = (cx, previous);
        Ok(None)
    }
}
