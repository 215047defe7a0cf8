//! What a plain fill shall be.

use super::fill_plainly::Plain;
use crate::fill::exemplar::{Start, Update};
use crate::fill::method::FillMethod;

/// What the plain fill shall be, which may be the start of another.
#[derive(Clone, Copy)]
pub(crate) struct Wanted {
    pub(crate) plain: Plain,
    /// How long its edges are, if not as the data's.
    pub(crate) edge: Option<f64>,
}

impl Wanted {
    pub(crate) fn of(method: &FillMethod) -> Self {
        let plain = match method {
            FillMethod::ThinPlate => Plain::ThinPlate,
            FillMethod::Membrane => Plain::Membrane,
            FillMethod::Flat => Plain::Flat,
            FillMethod::CreaseAware => Plain::CreaseAware,
            FillMethod::Exemplar(options) => match options.start {
                Start::ThinPlate if options.update == Update::Exact => Plain::PlateOrCreases,
                Start::ThinPlate => Plain::ThinPlate,
                Start::Centroid => Plain::Centroid,
                Start::Membrane => Plain::Membrane,
                Start::Flat => Plain::Flat,
            },
        };
        let edge = match method {
            FillMethod::Exemplar(options) => options.edges.last().copied(),
            _ => None,
        };
        Self { plain, edge: edge.filter(|&edge| edge > 0.0) }
    }
}
