//! Which plain fill a method asks for.

use crate::exemplar::{Start, Update};
use crate::method::FillMethod;

/// Which surface a plain fill is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PlainMethod {
    Flat,
    Membrane,
    ThinPlate,
    CreaseAware,
    /// As `CreaseAware` where creases are certain, else as `ThinPlate`. Used where the user did not ask for creases, so that none are
    /// invented.
    PlateOrCreases,
    /// A triangle fan around the centroid of the rim, as in the published completion.
    Centroid,
}

/// Which plain fill is wanted; it may be the start of an exemplar fill.
#[derive(Clone, Copy)]
pub(crate) struct PlainOptions {
    pub(crate) method: PlainMethod,
    /// The length of its edges; none for that of the data's edges at the rim.
    pub(crate) edge: Option<f64>,
}

impl PlainOptions {
    pub(crate) fn of(fill: &FillMethod) -> Self {
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
