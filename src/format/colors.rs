//! The range of colors, which most files leave to the reader to guess.

/// From 0 to what the channels of a file go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Range {
    One,
    Byte,
    Word,
}

impl Range {
    /// The range of these channels of a whole file: fractions are at most 1, and whole numbers at most 255 or 65535. Colors a little brighter
    /// than white (below 2) are fractions too.
    pub(super) fn of(channels: impl Iterator<Item = f64>, are_whole: bool) -> Self {
        let (mut most, mut is_whole) = (0.0_f64, true);
        for channel in channels.filter(|channel| channel.is_finite()) {
            most = most.max(channel);
            is_whole &= channel.fract() == 0.0;
        }
        match most {
            ..=1.0 if !are_whole => Self::One,
            ..2.0 if !is_whole => Self::One,
            ..=255.0 => Self::Byte,
            _ => Self::Word,
        }
    }

    /// A channel as a byte.
    pub(super) fn byte(self, channel: f64) -> u8 {
        let scale = match self {
            Self::One => 255.0,
            Self::Byte => 1.0,
            Self::Word => 1.0 / 257.0,
        };
        (channel * scale).round() as u8
    }

    /// What is told of colors that are not as the format or most programs have them.
    pub(super) fn note(self, usual: Self) -> Option<String> {
        let to = match self {
            Self::One => 1,
            Self::Byte => 255,
            Self::Word => 65535,
        };
        (self != usual).then(|| {
            format!("colors are read as from 0 to {to}, since the largest number in them says so")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_range_is_that_of_all_colors() {
        let range = |channels: &[f64], are_whole| Range::of(channels.iter().copied(), are_whole);
        assert_eq!(range(&[0.0, 0.5, 1.0], false), Range::One);
        assert_eq!(range(&[0.0, 1.03, 0.2], false), Range::One);
        assert_eq!(range(&[0.0, 1.0], false), Range::One);
        assert_eq!(range(&[0.0, 1.0], true), Range::Byte);
        assert_eq!(range(&[12.5, 255.0, f64::NAN], false), Range::Byte);
        assert_eq!(range(&[0.0, 256.0], true), Range::Word);
        assert_eq!(
            [Range::One.byte(0.5), Range::Byte.byte(32.0), Range::Word.byte(65535.0)],
            [128, 32, 255]
        );
        assert_eq!(Range::Word.byte(8224.0), 32);
        assert_eq!([Range::One.byte(1.7), Range::One.byte(f64::NAN)], [255, 0]);
    }
}
