//! An outsider's pack: palettes. A value, two nodes and a file format of its own, by maquette's public API alone.

use maquette::{Pack, format, node, reader, value_type};

mod apply_palette;
mod extract_palette;
mod palette;

pub use apply_palette::{ApplyPalette, apply_palette};
pub use extract_palette::{ExtractPalette, extract_palette};
pub use palette::{GimpPalette, GimpPaletteError, Palette};

/// Pictures in few colors.
pub const PACK: Pack = Pack {
    name: "palette",
    nodes: &[node::<ExtractPalette>(), node::<ApplyPalette>()],
    values: &[value_type::<Palette>()],
    formats: &[format::<GimpPalette>()],
    readers: &[reader::<GimpPalette>()],
};
