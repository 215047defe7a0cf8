//! Nodes on pictures.

use maquette::{Pack, node};

mod combine_masks;
mod edges;
mod fill_contour;
mod gaussian;
mod gradient;
mod grow_region;
mod hysteresis;
mod label;
mod morphology;
mod outline;
mod percentile;
mod read_image;
mod thin;
mod threshold;

pub use combine_masks::{CombineMasks, CombineMasksError, CombineMode, combine_masks};
pub use edges::{Edges, EdgesError, High, Operator, Picture, edges};
pub use fill_contour::{FillContour, fill_contour};
pub use grow_region::{GrowRegion, GrowRegionError, grow_region};
pub use label::{Connectivity, Label, label};
pub use morphology::{close, open};
pub use outline::{Outline, outline};
pub use read_image::ReadImage;
pub use thin::{Thin, ThinError, ThinMethod, thin};
pub(crate) use threshold::level;
pub use threshold::{Channel, Select, Space, Threshold, ThresholdError, otsu, threshold};

/// Nodes on pictures.
pub const PACK: Pack = Pack {
    name: "image",
    nodes: &[
        node::<ReadImage>(),
        node::<Threshold>(),
        node::<GrowRegion>(),
        node::<Edges>(),
        node::<Outline>(),
        node::<Thin>(),
        node::<FillContour>(),
        node::<CombineMasks>(),
        node::<Label>(),
    ],
    values: &[],
    formats: &[],
};
