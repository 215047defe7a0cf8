//! The value type of palettes, and a file format for them.

use maquette::value::{
    Color, Column, ElementKind, Image, Layer, Meaning, Parts, PartsError, Picture, Rgb,
};
use maquette::{
    DecodeError, Decoder, Encoder, Error, FileFormat, FileReader, InputFile, NewFile, Summary,
    Value,
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
        Summary::default().with_fact("colors", colors)
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.fact("colors", self.0.len());
        parts.push("color", ElementKind::Entry, Meaning::Level, 3, &self.0[..]);
        parts
    }

    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        Ok(Self(parts.require("color", 3)?.colors()?.into()))
    }

    /// Shows a square of each color, side by side.
    fn show(&self) -> Vec<Layer> {
        const SIDE: usize = 16;
        let row: Vec<Rgb> = self.0.iter().flat_map(|&color| [color; SIDE]).collect();
        let image = Image::new(row.len(), SIDE, row.repeat(SIDE));
        image
            .into_iter()
            .map(|image| {
                Layer::Picture(Picture { image, registration: None, has_false_colors: true })
            })
            .collect()
    }

    fn edge_cases() -> Vec<Self> {
        [vec![], vec![[0; 3]], vec![[255; 3]; 3]].map(|colors| Self(colors.into())).into()
    }
}

/// The palette files of GIMP and Inkscape. A line `#Include: NAME` adds the colors of another file before the file's own; GIMP and Inkscape
/// treat the line as a comment.
pub struct GimpPalette;

/// The error if a file is not a valid palette file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GimpPaletteError {
    /// The file does not begin with the line `GIMP Palette`.
    #[error("line 1: a palette file begins with `GIMP Palette`")]
    Start,
    /// A line does not contain a color.
    #[error("line {line}: a color is three numbers from 0 to 255")]
    Color {
        /// The line number, from 1.
        line: usize,
    },
}

impl FileReader for GimpPalette {
    type Value = Palette;
    const EXTENSIONS: &'static [&'static str] = &["gpl"];

    fn read(file: &InputFile<'_>) -> Result<Palette, Error> {
        let mut colors = Vec::new();
        for name in included_files(file.bytes()) {
            match file.companion(&name) {
                Ok(bytes) => colors.extend(colors_of(&bytes)?),
                Err(why) => file.warn(format!("{why}: its colors are left out")),
            }
        }
        colors.extend(colors_of(file.bytes())?);
        Ok(Palette(colors.into()))
    }

    const COMPANIONS: Option<fn(&InputFile<'_>)> = Some(|file| {
        included_files(file.bytes()).iter().for_each(|name| drop(file.companion(name)));
    });
}

/// Returns the names of the files that a palette file includes.
fn included_files(bytes: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(bytes);
    let names = text.lines().filter_map(|line| line.strip_prefix("#Include:"));
    names.map(|name| name.trim().to_owned()).collect()
}

/// Returns the colors in the palette file itself, without those of included files.
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
    const EXTENSION: &'static str = "gpl";

    fn write(palette: &Palette, name: &str) -> Result<Vec<NewFile>, Error> {
        let colors = palette.0.iter().map(|[r, g, b]| format!("{r:3} {g:3} {b:3}\n"));
        let text = format!("GIMP Palette\nName: {name}\n#\n{}", String::from_iter(colors));
        Ok(NewFile::single(name, text.into_bytes()))
    }
}
