//! The range of colors, which most files leave to the reader to guess.

pub(super) use maquette_node::reading::ColorRange;

/// The range of the channels of a whole file: the one that the user says, or else a guess by all of them, with a note if it is not the usual one.
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
            notes.push(format!("colors are read as from 0 to {to}, as their largest number says; `colors: To255` or another range says otherwise"));
        }
        range
    })
}

/// Fractions are at most 1, and whole numbers at most 255 or 65535. Colors a little brighter than white (below 2) are fractions, too.
fn guess(channels: impl Iterator<Item = f64>, are_whole: bool) -> ColorRange {
    let (mut most, mut is_whole) = (0.0_f64, true);
    for channel in channels.filter(|channel| channel.is_finite()) {
        most = most.max(channel);
        is_whole &= channel.fract() == 0.0;
    }
    match most {
        ..=1.0 if !are_whole => ColorRange::To1,
        ..2.0 if !is_whole => ColorRange::To1,
        ..=255.0 => ColorRange::To255,
        _ => ColorRange::To65535,
    }
}

/// A channel as a byte.
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
