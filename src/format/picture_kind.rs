//! Which kind of picture file some bytes are.

/// A kind of picture files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// PNG.
    Png,
    /// JPEG.
    Jpeg,
    /// TIFF.
    Tiff,
    /// WebP.
    WebP,
    /// BMP.
    Bmp,
    /// OpenEXR.
    Exr,
    /// Radiance HDR.
    Hdr,
}

impl Kind {
    /// What a file is by its first bytes.
    pub fn of(bytes: &[u8]) -> Option<Self> {
        const STARTS: [(&[u8], Kind); 10] = [
            (b"\x89PNG\r\n\x1a\n", Kind::Png),
            (b"\xff\xd8\xff", Kind::Jpeg),
            (b"II*\0", Kind::Tiff),
            (b"MM\0*", Kind::Tiff),
            // TIFF with 64-bit offsets.
            (b"II+\0", Kind::Tiff),
            (b"MM\0+", Kind::Tiff),
            (b"RIFF", Kind::WebP),
            (b"BM", Kind::Bmp),
            (b"v/1\x01", Kind::Exr),
            (b"#?RADIANCE", Kind::Hdr),
        ];
        let mut starts = STARTS.iter().filter(|(start, _)| bytes.starts_with(start));
        // Sounds and films are RIFF files, too.
        starts
            .next()
            .map(|&(_, kind)| kind)
            .filter(|kind| *kind != Self::WebP || bytes.get(8..12) == Some(b"WEBP"))
    }

    /// Returns the file extension, without the dot.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Jpeg => "jpg",
            Self::Tiff => "tif",
            Self::WebP => "webp",
            Self::Bmp => "bmp",
            Self::Exr => "exr",
            Self::Hdr => "hdr",
        }
    }
}
