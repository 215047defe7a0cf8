//! Test nodes that compute with whole numbers. Some are cheap, one often returns equal results, and others read a file, fail or panic.

use maquette_node::pack::Pack;
use maquette_node::{Context, FilePath, In, Node, Previous, node};
use maquette_syntax::error::Error;
use maquette_value::{DecodeError, Decoder, Encoder, Parts, Summary, Value, value_type};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A whole number that claims to need a kilobyte of memory, so that a few numbers exceed a small memory limit.
#[derive(Clone, Debug)]
struct Amount(u64);

impl Value for Amount {
    const NAME: &'static str = "Amount";

    fn encode(&self, to: &mut Encoder) {
        to.plain(&self.0);
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        Ok(Self(from.plain()?))
    }

    fn size(&self) -> usize {
        1024
    }

    fn describe(&self) -> Summary {
        Summary::default().with_fact("amount", self.0)
    }

    fn parts(&self) -> Parts<'_> {
        Parts::default()
    }
}

/// Adds a number and some amounts. Each amount is multiplied by its position, so the order of the amounts matters.
#[derive(Serialize, Deserialize, JsonSchema)]
struct Add {
    /// Amounts to add.
    #[serde(default)]
    of: Vec<In<Amount>>,
    /// Number to add.
    plus: u64,
}

impl Node for Add {
    type Outputs = (Amount,);
    const OUTPUTS: [&'static str; 1] = ["sum"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let amounts = (1..).zip(&self.of).map(|(times, of)| times * cx.get(of).0);
        Ok((Amount(amounts.sum::<u64>() + self.plus),))
    }

    /// Adds only the change of the amounts. The result is wrong if anything else has changed.
    fn update(
        &self,
        cx: &Context<'_>,
        previous: &Previous<'_>,
    ) -> Result<Option<Self::Outputs>, Error> {
        let Some(Amount(before)) = previous.output(0) else { return Ok(None) };
        let growth = (1..).zip(&self.of).map(|(times, of): (u64, _)| {
            let [now, then] = [cx.get(of).0, previous.get(of).0];
            now.wrapping_sub(then).wrapping_mul(times)
        });
        Ok(Some((Amount(growth.fold(*before, u64::wrapping_add)),)))
    }
}

/// Divides an amount by four, so different amounts often have equal results.
#[derive(Serialize, Deserialize, JsonSchema)]
struct Split {
    /// The amount to divide.
    of: In<Amount>,
}

impl Node for Split {
    type Outputs = (Amount, Amount);
    const OUTPUTS: [&'static str; 2] = ["quotient", "remainder"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let Amount(of) = *cx.get(&self.of);
        if of % 4 == 3 {
            cx.warn("the remainder is large");
        }
        Ok((Amount(of / 4), Amount(of % 4)))
    }
}

/// Returns the first byte of a file. If a file `extra` is in the same folder, adds the first byte of that file.
#[derive(Serialize, Deserialize, JsonSchema)]
struct Read {
    /// The file to read.
    path: FilePath,
}

impl Node for Read {
    type Outputs = (Amount,);
    const OUTPUTS: [&'static str; 1] = ["byte"];

    fn files(&self) -> Vec<FilePath> {
        vec![self.path.sibling("extra")]
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        fn first_byte(bytes: &[u8]) -> u64 {
            bytes.first().map_or(0, |byte| u64::from(*byte))
        }
        let extra =
            cx.file_if_any(&self.path.sibling("extra")).map_or(0, |file| first_byte(file.bytes()));
        Ok((Amount(first_byte(cx.file(&self.path)?.bytes()) + extra),))
    }
}

/// Returns its input, but fails for some amounts and panics for others.
#[derive(Serialize, Deserialize, JsonSchema)]
struct Fragile {
    /// The amount to return.
    of: In<Amount>,
}

/// The message of the panics that [`Fragile`] causes.
pub(super) const PANIC: &str = "an amount of this kind is too much";

impl Node for Fragile {
    type Outputs = (Amount,);
    const OUTPUTS: [&'static str; 1] = ["amount"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let Amount(of) = *cx.get(&self.of);
        match of % 5 {
            3 => Err(std::io::Error::other(format!("{of} is an amount that fails")).into()),
            4 => panic!("{PANIC}"),
            _ => Ok((Amount(of),)),
        }
    }
}

/// A pack that contains all test nodes.
pub(super) const PACK: Pack = Pack {
    name: "amounts",
    nodes: &[node::<Add>(), node::<Split>(), node::<Read>(), node::<Fragile>()],
    values: &[value_type::<Amount>()],
    ..Pack::EMPTY
};
