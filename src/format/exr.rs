//! Depth maps in OpenEXR files, as renderers write them: one channel of floats.
//!
//! The reader is the crate `exr`, on which `image` depends anyway.

use std::io::Cursor;

use ::exr::error::Error as Broken;
use ::exr::meta::MetaData;
use ::exr::prelude::{ReadChannels as _, ReadLayers as _, read};
use thiserror::Error;

use super::tiff::Depths;
use super::{depth, most_memory};

/// Why bytes are not a depth map in an OpenEXR file.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ExrError {
    /// Something else, or a damaged file.
    #[error("this is not a readable OpenEXR file: {reason}")]
    Broken {
        /// What the decoder says.
        reason: String,
    },
    /// No channel of depths.
    #[error("the file has no channel of depths, Z, V, Y or the only one: its channels are {}", channels.join(", "))]
    NoDepth {
        /// The channels of its first layer.
        channels: Vec<String>,
    },
    /// More pixels than are read.
    #[error(
        "{width} x {height} pixels would take more than {most} bytes of memory: make the map smaller"
    )]
    TooLarge {
        /// The map's width.
        width: usize,
        /// The map's height.
        height: usize,
        /// Bytes that reading it may take.
        most: usize,
    },
}

fn broken(error: Broken) -> ExrError {
    ExrError::Broken { reason: error.to_string() }
}

/// What is farther than this is no surface: renderers give the background 1e10, and halves end at 65504.
const FARTHEST: f32 = 65_000.0;

/// The depths in an OpenEXR file: those of the channel `Z`, `V` or `Y`, whatever its layer, or of the only one. What is not finite, or as
/// far as renderers put a background, is a hole.
///
/// # Errors
/// If the bytes are no such file, no channel has depths, or they take too much memory.
pub(super) fn read_depth(bytes: &[u8]) -> Result<Depths, ExrError> {
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(broken)?;
    let most = most_memory(bytes.len());
    for header in &meta.headers {
        // All channels are unpacked, to four bytes each at least.
        let (width, height) = (header.layer_size.width(), header.layer_size.height());
        let per_pixel = depth::BYTES_PER_PIXEL + 4 * header.channels.list.len();
        if most / per_pixel < width.saturating_mul(height) {
            return Err(ExrError::TooLarge { width, height, most });
        }
    }
    let image = read().no_deep_data().largest_resolution_level().all_channels().all_layers();
    let image = image.all_attributes().non_parallel().from_buffered(Cursor::new(bytes));
    let image = image.map_err(broken)?;
    let channels = image
        .layer_data
        .iter()
        .flat_map(|layer| layer.channel_data.list.iter().map(|channel| (layer.size, channel)));
    let channels = Vec::from_iter(channels);
    let name = |channel: &::exr::image::AnyChannel<_>| channel.name.to_string();
    fn is_called(word: &str, found: &str) -> bool {
        found.rsplit('.').next().is_some_and(|last| last.eq_ignore_ascii_case(word))
    }
    let named = ["Z", "V", "Y", "depth"]
        .iter()
        .find_map(|word| channels.iter().find(|(_, channel)| is_called(word, &name(channel))));
    let only = (channels.len() == 1).then(|| channels.first()).flatten();
    let Some((size, channel)) = named.or(only) else {
        let channels = channels.iter().map(|(_, channel)| name(channel)).collect();
        return Err(ExrError::NoDepth { channels });
    };
    let depths = channel
        .sample_data
        .values_as_f32()
        .map(|z: f32| if z < FARTHEST { f64::from(z) } else { f64::NAN })
        .collect();
    Ok(Depths { width: size.width(), height: size.height(), depths, whole: false })
}

#[cfg(test)]
mod tests {
    use ::exr::prelude::{
        AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, SmallVec,
        WritableImage as _,
    };

    use super::*;
    use crate::hostile;

    /// A file of these channels, each of 3 x 2 numbers.
    fn file(channels: &[(&str, [f32; 6])]) -> Vec<u8> {
        let list = channels
            .iter()
            .map(|(name, values)| AnyChannel::new(*name, FlatSamples::F32(values.to_vec())));
        let channels = AnyChannels::sort(list.collect::<SmallVec<_>>());
        let layer =
            Layer::new((3, 2), LayerAttributes::named("a"), Encoding::FAST_LOSSLESS, channels);
        let mut bytes = Cursor::new(Vec::new());
        Image::from_layer(layer).write().to_buffered(&mut bytes).unwrap();
        bytes.into_inner()
    }

    const DEPTHS: [f32; 6] = [1.5, 2.0, 1e10, f32::INFINITY, 0.25, -1.0];

    #[test]
    fn the_channel_of_depths_is_found_and_the_background_is_no_depth() {
        for channels in [
            &[("R", [0.0; 6]), ("Depth.Z", DEPTHS)][..],
            &[("V", DEPTHS)],
            &[("something", DEPTHS)],
            &[("G", [0.0; 6]), ("View Layer.Depth.V", DEPTHS)],
        ] {
            let read = read_depth(&file(channels)).unwrap();
            assert_eq!((read.width, read.height, read.whole), (3, 2, false));
            let finite: Vec<_> = read.depths.iter().map(|z| z.is_finite().then_some(*z)).collect();
            assert_eq!(finite, [Some(1.5), Some(2.0), None, None, Some(0.25), Some(-1.0)]);
        }
    }

    #[test]
    fn other_files_are_refused_with_what_they_are() {
        let colors = file(&[("R", [0.0; 6]), ("G", [0.0; 6]), ("B", [0.0; 6])]);
        let refused = read_depth(&colors).unwrap_err();
        assert_eq!(
            refused,
            ExrError::NoDepth { channels: ["B", "G", "R"].map(str::to_owned).into() }
        );
        let whole = file(&[("Z", DEPTHS)]);
        assert!(matches!(read_depth(&whole[..whole.len() / 2]), Err(ExrError::Broken { .. })));
        assert!(matches!(read_depth(b"v 0 0 0"), Err(ExrError::Broken { .. })));
    }

    #[test]
    fn hostile_files_give_errors() {
        hostile::survive(&file(&[("Z", DEPTHS)]), read_depth);
    }
}
