//! Detection of picture formats.

/// A picture format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Portable Network Graphics: lossless compression.
    Png,
    /// The format of the Joint Photographic Experts Group: lossy compression.
    Jpeg,
    /// Tag Image File Format, including BigTIFF (with 64-bit offsets).
    Tiff,
    /// WebP, which is stored in a RIFF container.
    WebP,
    /// The bitmap format of Windows.
    Bmp,
    /// OpenEXR, with channels of floating-point numbers.
    Exr,
    /// Radiance HDR, with pixels of linear light.
    Hdr,
}

impl Kind {
    /// Detects the format of a file from its first bytes; returns `None` if it is unknown.
    pub fn detect(bytes: &[u8]) -> Option<Self> {
        const STARTS: [(&[u8], Kind); 10] = [
            (b"\x89PNG\r\n\x1a\n", Kind::Png),
            (b"\xff\xd8\xff", Kind::Jpeg),
            (b"II*\0", Kind::Tiff),
            (b"MM\0*", Kind::Tiff),
            // The next two entries are the first bytes of TIFF files with 64-bit offsets.
            (b"II+\0", Kind::Tiff),
            (b"MM\0+", Kind::Tiff),
            (b"RIFF", Kind::WebP),
            (b"BM", Kind::Bmp),
            (b"v/1\x01", Kind::Exr),
            (b"#?RADIANCE", Kind::Hdr),
        ];
        let mut starts = STARTS.iter().filter(|(start, _)| bytes.starts_with(start));
        // A RIFF file can also contain audio or video, so its type is checked.
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
