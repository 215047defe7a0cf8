//! A few colors.

use maquette::value::{Color, Column, Image, Layer, Meaning, On, Parts, PartsError, Picture, Rgb};
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

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.fact("colors", self.0.len());
        parts.push("color", On::Entry, Meaning::Level, 3, &self.0[..]);
        parts
    }

    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        Ok(Self(parts.need("color", 3)?.colors()?.into()))
    }

    /// A square of each color, side by side.
    fn show(&self) -> Vec<Layer> {
        const SIDE: usize = 16;
        let row: Vec<Rgb> = self.0.iter().flat_map(|&color| [color; SIDE]).collect();
        let image = Image::new(row.len(), SIDE, row.repeat(SIDE));
        let layer = |image| Layer::Picture(Picture { image, registration: None, drawn: true });
        image.into_iter().map(layer).collect()
    }

    fn hostile() -> Vec<Self> {
        [vec![], vec![[0; 3]], vec![[255; 3]; 3]].map(|colors| Self(colors.into())).into()
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
