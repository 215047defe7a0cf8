//! Test nodes, and a value type whose elements a `ForEach` can iterate over.

use maquette::value::{Curve, Mesh, Parts, Points};
use maquette::{
    AnyValue, Context, DecodeError, Decoder, Elements, Encoder, Error, In, NoElements, Node,
    Summary, Value, value_type,
};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Appends points to the points collected so far.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub(super) struct Add {
    /// The points collected so far.
    sum: In<Points>,
    /// The points to append.
    point: In<Points>,
}

impl Node for Add {
    type Outputs = (Points,);
    const OUTPUTS: [&'static str; 1] = ["sum"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let all =
            cx.get(&self.sum).positions().iter().chain(cx.get(&self.point).positions().iter());
        Ok((Points::new(all.copied().collect::<Vec<_>>())?,))
    }
}

/// One point on the x axis.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub(super) struct Along {
    /// The x coordinate.
    at: u32,
}

impl Node for Along {
    type Outputs = (Points,);
    const OUTPUTS: [&'static str; 1] = ["points"];

    fn eval(&self, _: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((Points::new(vec![Point3::new(f64::from(self.at), 0.0, 0.0)])?,))
    }
}

/// The first vertex of a mesh.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub(super) struct Corner {
    /// The mesh.
    mesh: In<Mesh>,
}

impl Node for Corner {
    type Outputs = (Points,);
    const OUTPUTS: [&'static str; 1] = ["points"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((Points::new(vec![cx.get(&self.mesh).positions()[0]])?,))
    }
}

/// The points of a curve.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub(super) struct Rim {
    /// The curve.
    curve: In<Curve>,
}

impl Node for Rim {
    type Outputs = (Points,);
    const OUTPUTS: [&'static str; 1] = ["points"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((Points::new(cx.get(&self.curve).points().clone())?,))
    }
}

/// A third-party value type: a string of numbered beads. Its elements are the beads, each as a string of one bead.
#[derive(Clone, Debug)]
pub(super) struct Beads(pub(super) Vec<u8>);

impl Value for Beads {
    const NAME: &'static str = "Beads";

    fn encode(&self, to: &mut Encoder) {
        to.counts(&self.0.iter().map(|&bead| usize::from(bead)).collect::<Vec<_>>());
    }

    fn decode(_: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        Err(DecodeError)
    }

    fn size(&self) -> usize {
        self.0.len()
    }

    fn describe(&self) -> Summary {
        Summary::default()
    }

    fn parts(&self) -> Parts<'_> {
        Parts::default()
    }

    fn elements() -> Vec<Elements<Self>> {
        fn one_by_one(
            beads: &Beads,
            most: usize,
            _: &[AnyValue],
        ) -> Result<Vec<AnyValue>, NoElements> {
            match beads.0.len() {
                count if count > most => Err(NoElements::TooMany { count }),
                _ => Ok(beads.0.iter().map(|&bead| AnyValue::new(Beads(vec![bead]))).collect()),
            }
        }
        let kind = value_type::<Self>();
        vec![Elements { word: "One", name: "beads", kind, cut: one_by_one }]
    }
}

/// Makes points from the numbers of beads.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub(super) struct Count {
    /// The beads.
    beads: In<Beads>,
}

impl Node for Count {
    type Outputs = (Points,);
    const OUTPUTS: [&'static str; 1] = ["points"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((Points::new(
            cx.get(&self.beads)
                .0
                .iter()
                .map(|&bead| Point3::new(f64::from(bead), 0.0, 0.0))
                .collect::<Vec<_>>(),
        )?,))
    }
}
