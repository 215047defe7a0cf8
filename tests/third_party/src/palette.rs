//! A few colors.

use maquette::value::{Color, Column, Image, Layer, Meaning, On, Parts, PartsError, Picture, Rgb};
use maquette::{
    DecodeError, Decoder, Encoder, Error, FileFormat, FileReader, NewFile, Reading, Summary, Value,
};

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
        image
            .into_iter()
            .map(|image| Layer::Picture(Picture { image, registration: None, drawn: true }))
            .collect()
    }

    fn hostile() -> Vec<Self> {
        [vec![], vec![[0; 3]], vec![[255; 3]; 3]].map(|colors| Self(colors.into())).into()
    }
}

/// The palette files of GIMP and Inkscape. With a line `#Include: NAME`, a comment to these, one has the colors of another file beside it,
/// too, before its own.
pub struct GimpPalette;

/// Bytes are no palette file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GimpPaletteError {
    /// Another kind of file.
    #[error("line 1: a palette file begins with `GIMP Palette`")]
    Start,
    /// A line that holds no color.
    #[error("line {line}: a color is three numbers from 0 to 255")]
    Color {
        /// The line, from 1.
        line: usize,
    },
}

impl FileReader for GimpPalette {
    type Value = Palette;
    const ENDINGS: &'static [&'static str] = &["gpl"];

    fn read(file: &Reading<'_>) -> Result<Palette, Error> {
        let mut colors = Vec::new();
        for name in included(file.bytes()) {
            match file.companion(&name) {
                Ok(bytes) => colors.extend(colors_of(&bytes)?),
                Err(why) => file.doubt(format!("{why}: its colors are left out")),
            }
        }
        colors.extend(colors_of(file.bytes())?);
        Ok(Palette(colors.into()))
    }

    const COMPANIONS: Option<fn(&Reading<'_>)> =
        Some(|file| included(file.bytes()).iter().for_each(|name| drop(file.companion(name))));
}

/// The names of the files that a palette file includes.
fn included(bytes: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(bytes);
    let names = text.lines().filter_map(|line| line.strip_prefix("#Include:"));
    names.map(|name| name.trim().to_owned()).collect()
}

/// The colors that stand in a palette file itself.
fn colors_of(bytes: &[u8]) -> Result<Vec<Rgb>, GimpPaletteError> {
    let text = String::from_utf8_lossy(bytes);
    let mut lines = text.lines().enumerate();
    if lines.next().is_none_or(|(_, line)| line.trim() != "GIMP Palette") {
        return Err(GimpPaletteError::Start);
    }
    fn is_color(line: &str) -> bool {
        line.trim_start().starts_with(|c: char| c.is_ascii_digit())
    }
    let colors = lines.filter(|(_, line)| is_color(line)).map(|(index, line)| {
        let mut numbers = line.split_whitespace().map_while(|word| word.parse::<u8>().ok());
        let color = [numbers.next(), numbers.next(), numbers.next()];
        let [Some(r), Some(g), Some(b)] = color else {
            return Err(GimpPaletteError::Color { line: index + 1 });
        };
        Ok([r, g, b])
    });
    colors.collect()
}

impl FileFormat for GimpPalette {
    type Value = Palette;
    const ENDING: &'static str = "gpl";

    fn write(palette: &Palette, name: &str) -> Result<Vec<NewFile>, Error> {
        let colors = palette.0.iter().map(|[r, g, b]| format!("{r:3} {g:3} {b:3}\n"));
        let text = format!("GIMP Palette\nName: {name}\n#\n{}", String::from_iter(colors));
        Ok(NewFile::only(name, text.into_bytes()))
    }
}
