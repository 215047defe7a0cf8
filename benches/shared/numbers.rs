//! A pack with one trivial node. With it, benches measure the time of the engine and not of the nodes.

use maquette::value::Parts;
use maquette::{
    Context, DecodeError, Decoder, Encoder, Error, In, Node, Pack, Summary, Value, node, value_type,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A number, as the value of an output.
#[derive(Clone, Debug)]
struct Number(f64);

impl Value for Number {
    const NAME: &'static str = "Number";

    fn encode(&self, to: &mut Encoder) {
        to.plain(&self.0);
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        Ok(Self(from.plain()?))
    }

    fn size(&self) -> usize {
        size_of::<Self>()
    }

    fn describe(&self) -> Summary {
        Summary::default().with_fact("number", self.0)
    }

    fn parts(&self) -> Parts<'_> {
        Parts::default()
    }
}

/// Adds a number.
#[derive(Serialize, Deserialize, JsonSchema)]
struct Add {
    /// The first number; 0 if omitted.
    to: Option<In<Number>>,
    /// The second number.
    number: f64,
}

impl Node for Add {
    type Outputs = (Number,);
    const OUTPUTS: [&'static str; 1] = ["sum"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let to = self.to.as_ref().map_or(0.0, |to| cx.get(to).0);
        Ok((Number(to + self.number),))
    }
}

/// The pack that contains the node `Add`.
pub(crate) const PACK: Pack = Pack {
    name: "numbers",
    nodes: &[node::<Add>()],
    values: &[value_type::<Number>()],
    ..Pack::EMPTY
};
