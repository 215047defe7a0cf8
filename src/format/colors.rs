//! The range of color channels: 0 to 1, 255 or 65535. Most text formats do not state this range.

pub(super) use maquette_node::importers::ColorRange;

/// Returns the common range of all color channels in a file: `wanted` if given, else a guess from the values. Also returns a note if the
/// guess differs from `usual`.
pub(super) fn decide(
    wanted: Option<ColorRange>,
    channels: impl Iterator<Item = f64>,
    are_whole: bool,
    usual: ColorRange,
    notes: &mut Vec<String>,
) -> ColorRange {
    wanted.unwrap_or_else(|| {
        let range = guess(channels, are_whole);
        let to = match range {
            ColorRange::To1 => 1,
            ColorRange::To255 => 255,
            ColorRange::To65535 => 65535,
        };
        if range != usual {
            notes.push(format!("colors are read as 0 to {to}, guessed from their largest value; set `colors: To255` or another range if that is wrong"));
        }
        range
    })
}

/// Guesses the range from the maximum of all channels: 1 (except for channels that are stored as integers), 255 or 65535. If some channels
/// are not integers, a maximum of up to 2 also gives the range 1: colors may be slightly brighter than white.
fn guess(channels: impl Iterator<Item = f64>, are_whole: bool) -> ColorRange {
    let (mut max, mut is_integer) = (0.0_f64, true);
    for channel in channels.filter(|channel| channel.is_finite()) {
        max = max.max(channel);
        is_integer &= channel.fract() == 0.0;
    }
    match max {
        ..=1.0 if !are_whole => ColorRange::To1,
        ..2.0 if !is_integer => ColorRange::To1,
        ..=255.0 => ColorRange::To255,
        _ => ColorRange::To65535,
    }
}

/// Converts a channel to a byte.
pub(super) fn byte(range: ColorRange, channel: f64) -> u8 {
    let scale = match range {
        ColorRange::To1 => 255.0,
        ColorRange::To255 => 1.0,
        ColorRange::To65535 => 1.0 / 257.0,
    };
    (channel * scale).round() as u8
}

#[cfg(test)]
mod tests {
    use ColorRange::{To1, To255, To65535};

    use super::*;

    #[test]
    fn the_range_is_that_of_all_colors() {
        fn range(channels: &[f64], are_whole: bool) -> ColorRange {
            guess(channels.iter().copied(), are_whole)
        }
        assert_eq!(range(&[0.0, 0.5, 1.0], false), To1);
        assert_eq!(range(&[0.0, 1.03, 0.2], false), To1);
        assert_eq!(range(&[0.0, 1.0], false), To1);
        assert_eq!(range(&[0.0, 1.0], true), To255);
        assert_eq!(range(&[12.5, 255.0, f64::NAN], false), To255);
        assert_eq!(range(&[0.0, 256.0], true), To65535);
        assert_eq!([byte(To1, 0.5), byte(To255, 32.0), byte(To65535, 65535.0)], [128, 32, 255]);
        assert_eq!(byte(To65535, 8224.0), 32);
        assert_eq!([byte(To1, 1.7), byte(To1, f64::NAN)], [255, 0]);
    }
}
