//! Nodes on pictures.

use maquette::{Pack, node};

mod label;
mod morphology;
mod read_image;
mod threshold;

pub use label::{Connectivity, Label, label};
pub use morphology::{close, open};
pub use read_image::ReadImage;
pub(crate) use threshold::level;
pub use threshold::{Channel, Select, Space, Threshold, ThresholdError, otsu, threshold};

/// Nodes on pictures.
pub const PACK: Pack = Pack {
    name: "image",
    nodes: &[node::<ReadImage>(), node::<Threshold>(), node::<Label>()],
    values: &[],
    formats: &[],
};
