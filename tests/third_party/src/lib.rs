//! An outsider's pack: palettes. A value, three nodes and a file format of its own, by maquette's public API alone.

use maquette::{Pack, format, node, reader, value_type};

mod apply_palette;
mod extract_palette;
mod palette;
mod read_palette;

pub use apply_palette::{ApplyPalette, apply_palette};
pub use extract_palette::{ExtractPalette, extract_palette};
pub use palette::{GimpPalette, GimpPaletteError, Palette};
pub use read_palette::ReadPalette;

/// Pictures in few colors.
pub const PACK: Pack = Pack {
    name: "palette",
    nodes: &[node::<ReadPalette>(), node::<ExtractPalette>(), node::<ApplyPalette>()],
    values: &[value_type::<Palette>()],
    formats: &[format::<GimpPalette>()],
    readers: &[reader::<GimpPalette>()],
};
