//! A step of a graph.

use maquette_syntax::error::Error;
use schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::carry::Carry;
use crate::context::Context;
use crate::exactness::Exactness;
use crate::field_error::FieldError;
use crate::file::FilePath;
use crate::limit::Estimate;
use crate::port::Outputs;
use crate::previous::Previous;
use crate::terms::{Promise, Want};

/// One step of a graph, and its whole description.
///
/// A field of type [`In<T>`](crate::In), `Option<In<T>>` or `Vec<In<T>>` is a port, a field of type [`FilePath`] a file to read, every
/// other field a parameter. The doc comments of the type and its fields are the user's manual; `#[schemars(range(..))]` says which
/// numbers a parameter takes, and `#[schemars(extend("unit" = "mm"))]` the unit that manual and messages print beside them.
pub trait Node: Serialize + DeserializeOwned + JsonSchema + Send + Sync + 'static {
    /// What it gives: a tuple of values.
    type Outputs: Outputs;

    /// The names of its outputs, the first being the one that a link without a name means.
    const OUTPUTS: <Self::Outputs as Outputs>::Names;

    /// What it wants of the values that come in, beyond their types.
    const WANTS: &'static [Want<Self>] = &[];

    /// What it promises of the values that it gives, beyond their types: only what holds for all values that it accepts.
    const PROMISES: &'static [Promise<Self>] = &[];

    /// What becomes of the attributes of meshes, points and range images, for each port that takes and each output that gives some.
    const CARRIES: &'static [Carry] = &[];

    /// How equal its results are on all machines and for all builds: the same bytes, unless it says otherwise.
    const EXACTNESS: Exactness = Exactness::Exact;

    /// Files that it reads if they are there, beside those that its fields name.
    fn files(&self) -> Vec<FilePath> {
        Vec::new()
    }

    /// Finds what is wrong with its parameters and links whatever comes in, beyond what the types of the fields say, so that it is
    /// reported before anything runs.
    ///
    /// # Errors
    /// If every run would fail.
    fn check(&self) -> Result<(), FieldError> {
        Ok(())
    }

    /// How much memory [`eval`](Self::eval) will need at most, told before it runs; none if nobody can say. A node whose result may
    /// be much larger than its inputs says it, so that it is refused with numbers instead of the program being killed.
    ///
    /// It sees the same context, so that it knows how large the inputs are, and must be quick: it counts, and allocates nothing
    /// large. Of two runs on equal inputs it says the same.
    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let _ = cx;
        None
    }

    /// Computes the outputs: a pure function of the parameters, the inputs and the files, the same bytes for any number of
    /// threads; [`EXACTNESS`](Self::EXACTNESS) says whether they are the same on other machines, too.
    ///
    /// # Errors
    /// Whatever is wrong with the inputs; the message says what, not where.
    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error>;

    /// What [`eval`](Self::eval) gives, made of what it gave for other inputs: the very bytes, and the same warnings. For nodes that have
    /// little to do where little has changed; none where nothing is gained, so that `eval` is asked. A node that gives something for
    /// little to do where little has changed; none where nothing is gained, so that `eval` is asked. A node that gives something for
    /// unchanged inputs is held to this by `maquette::conformance`.
    ///
    /// # Errors
    /// Those of `eval`.
    fn update(
        &self,
        cx: &Context<'_>,
        previous: &Previous<'_>,
    ) -> Result<Option<Self::Outputs>, Error> {
        let _ = (cx, previous);
        Ok(None)
    }
}
