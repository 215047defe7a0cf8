//! An outsider's pack: palettes. A value, three nodes and a file format of its own, by maquette's public API alone.

use maquette::{Migration, NewValue, Pack, format, node, reader, value_type};

mod extract_palette;
mod palette;
mod posterize;
mod read_palette;

pub use extract_palette::{ExtractPalette, extract_palette};
pub use palette::{GimpPalette, GimpPaletteError, Palette};
pub use posterize::{Posterize, posterize};
pub use read_palette::ReadPalette;

/// Pictures in few colors.
pub const PACK: Pack = Pack {
    name: "palette",
    nodes: &[node::<ReadPalette>(), node::<ExtractPalette>(), node::<Posterize>()],
    values: &[value_type::<Palette>()],
    formats: &[format::<GimpPalette>()],
    readers: &[reader::<GimpPalette>()],
    migrations: &[
        // 0.2: it uses a palette.
        Migration::Node { old: "PaintPalette", new: "ApplyPalette" },
        // 0.3: what comes of it has a name, and how many colors there are is a count.
        Migration::Node { old: "ApplyPalette", new: "Posterize" },
        Migration::Field {
            node: "ExtractPalette",
            old: "colors",
            new: "count",
            value: NewValue::Same,
        },
    ],
    ..Pack::EMPTY
};
