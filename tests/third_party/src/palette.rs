//! A few colors.

use maquette::value::{Color, Column, Rgb};
use maquette::{DecodeError, Decoder, Encoder, Error, FileFormat, NewFile, Summary, Value};

/// A few colors, the most frequent first.
#[derive(Clone, Debug, PartialEq)]
pub struct Palette(pub Column<Rgb>);

impl Value for Palette {
    const NAME: &'static str = "Palette";

    fn encode(&self, to: &mut Encoder) {
        to.column(&self.0);
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        Ok(Self(from.column()?))
    }

    fn size(&self) -> usize {
        self.0.size()
    }

    fn describe(&self) -> Summary {
        let colors: Vec<String> = self.0.iter().map(|&color| Color(color).to_string()).collect();
        Summary::default().with("colors", colors)
    }
}

/// The palette files of GIMP and Inkscape.
pub struct GimpPalette;

impl FileFormat for GimpPalette {
    type Value = Palette;
    const ENDING: &'static str = "gpl";

    fn write(palette: &Palette, name: &str) -> Result<Vec<NewFile>, Error> {
        let colors = palette.0.iter().map(|[r, g, b]| format!("{r:3} {g:3} {b:3}\n"));
        let text = format!("GIMP Palette\nName: {name}\n#\n{}", String::from_iter(colors));
        Ok(NewFile::only(name, text.into_bytes()))
    }
}
