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
mod otsu;
mod outline;
mod percentile;
mod picture_error;
mod read_image;
mod select;
mod thin;
mod threshold;

pub use combine_masks::{CombineMasks, CombineMasksError, CombineMode, combine_masks};
pub use edges::{Edges, EdgesError, High, Operator, Picture, edges};
pub use fill_contour::{FillContour, fill_contour};
pub use grow_region::{GrowRegion, grow_region};
pub use label::{Connectivity, Label, label};
pub use morphology::{close, dilate, open};
pub use otsu::otsu;
pub use outline::{Outline, outline};
pub use picture_error::PictureError;
pub use read_image::ReadImage;
pub(crate) use select::level;
pub use select::{Channel, Select, Space};
pub use thin::{Thin, ThinError, ThinMethod, thin};
pub use threshold::{Threshold, threshold};

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
    readers: &[],
};
