//! Trivial nodes on the regions of a picture. They take little time, so tests and benches measure the engine.

use maquette::value::{Labels, Points};
use maquette::{AnyValue, Context, Error, In, Node};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Returns the center of the first component; its z coordinate is `rank`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub(crate) struct Center {
    /// The labels.
    labels: In<Labels>,
    /// The z coordinate of the point.
    #[serde(default)]
    #[schemars(range(max = 3))]
    rank: u32,
}

impl Node for Center {
    type Outputs = (Points,);
    const OUTPUTS: [&'static str; 1] = ["points"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let [x, y] = cx.get(&self.labels).statistics()[0].centroid;
        Ok((Points::new(vec![Point3::new(x, y, f64::from(self.rank))])?,))
    }
}

/// All points, concatenated.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub(crate) struct Collect {
    /// The lists of points.
    points: Vec<In<Points>>,
}

impl Node for Collect {
    type Outputs = (Points,);
    const OUTPUTS: [&'static str; 1] = ["points"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let lists = self.points.iter().flat_map(|list| cx.get(list).positions().iter().copied());
        Ok((Points::new(lists.collect::<Vec<_>>())?,))
    }
}

/// Returns labels of 100 x 50 spots of 6 x 12 pixels. The spot with the index `changed` is only 5 pixels wide.
pub(crate) fn grid(changed: Option<usize>) -> AnyValue {
    AnyValue::new(
        Labels::new(
            1000,
            1000,
            (0..1_000_000)
                .map(|at: usize| {
                    let [x, y] = [at % 1000, at / 1000];
                    let spot = x / 10 + y / 20 * 100;
                    let wide = if changed == Some(spot) { 5 } else { 6 };
                    if x % 10 < wide && y % 20 < 12 { spot as u32 + 1 } else { 0 }
                })
                .collect(),
        )
        .expect("labels"),
    )
}
