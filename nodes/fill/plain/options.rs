//! Options for filling holes without exemplars, derived from the node's fill method.

use crate::exemplar::{Start, Update};
use crate::method::FillMethod;

/// The surface that fills a hole without exemplars.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PlainMethod {
    Flat,
    Membrane,
    ThinPlate,
    CreaseAware,
    /// Like `CreaseAware` if the creases are certain, otherwise like `ThinPlate`. Used if the user did not ask for creases, so that no
    /// uncertain creases are added.
    PlateOrCreases,
    /// A triangle fan around the centroid of the rim, as in the publication on exemplars.
    Centroid,
}

/// The options for filling a hole without exemplars. The result may be the initial fill of a method with exemplars.
#[derive(Clone, Copy)]
pub(crate) struct PlainOptions {
    pub(crate) method: PlainMethod,
    /// The target edge length in mm; if `None`, the edge length of the input mesh at the rim.
    pub(crate) edge: Option<f64>,
}

impl PlainOptions {
    pub(crate) fn from_method(fill: &FillMethod) -> Self {
        let method = match fill {
            FillMethod::ThinPlate => PlainMethod::ThinPlate,
            FillMethod::Membrane => PlainMethod::Membrane,
            FillMethod::Flat => PlainMethod::Flat,
            FillMethod::CreaseAware => PlainMethod::CreaseAware,
            FillMethod::Exemplar(options) => match options.start {
                Start::ThinPlate if options.update == Update::Exact => PlainMethod::PlateOrCreases,
                Start::ThinPlate => PlainMethod::ThinPlate,
                Start::Centroid => PlainMethod::Centroid,
                Start::Membrane => PlainMethod::Membrane,
                Start::Flat => PlainMethod::Flat,
            },
        };
        let edge = match fill {
            FillMethod::Exemplar(options) => options.edges.last().copied(),
            _ => None,
        };
        Self { method, edge: edge.filter(|&edge| edge > 0.0) }
    }
}
