//! Depth maps in OpenEXR files, as renderers write them: one channel of floats.
//!
//! Uses the crate `exr`, on which `image` depends anyway.

use std::io::Cursor;

use ::exr::error::Error as Broken;
use ::exr::meta::MetaData;
use ::exr::prelude::{ReadChannels as _, ReadLayers as _, read};
use maquette_syntax::bail;
use maquette_syntax::error::Error;

use super::decoder::unreadable;
use super::tiff::Depths;
use super::{depth, max_memory};

fn broken_file(error: Broken) -> Error {
    unreadable("OpenEXR", error)
}

/// Depths of at least this value are background: renderers write 1e10 for the background, and half floats end at 65504.
const FARTHEST: f32 = 65_000.0;

/// Reads the depths: the channel `Z`, `V`, `Y` or `depth` of any layer, or else the only channel. Depths that are not finite, or are at
/// least [`FARTHEST`], are holes.
///
/// Returns an error if the bytes are not an OpenEXR file, no channel has depths, or the depths take too much memory.
pub(super) fn read_depth(bytes: &[u8]) -> Result<Depths, Error> {
    check_size(bytes, depth::BYTES_PER_PIXEL)?;
    let image = read().no_deep_data().largest_resolution_level().all_channels().all_layers();
    let image = image.all_attributes().non_parallel().from_buffered(Cursor::new(bytes));
    let image = image.map_err(broken_file)?;
    let channels = image
        .layer_data
        .iter()
        .flat_map(|layer| layer.channel_data.list.iter().map(|channel| (layer.size, channel)));
    let channels: Vec<_> = channels.collect();
    fn is_called(word: &str, found: &str) -> bool {
        found.rsplit('.').next().is_some_and(|last| last.eq_ignore_ascii_case(word))
    }
    let named = ["Z", "V", "Y", "depth"].iter().find_map(|word| {
        channels.iter().find(|(_, channel)| is_called(word, &channel.name.to_string()))
    });
    let only = (channels.len() == 1).then(|| channels.first()).flatten();
    let Some((size, channel)) = named.or(only) else {
        let channels: Vec<_> =
            channels.iter().map(|(_, channel)| channel.name.to_string()).collect();
        bail!(
            "expected a channel Z, V, Y or depth, or a single channel; found the channels {}",
            channels.join(", ")
        );
    };
    let depths = channel
        .sample_data
        .values_as_f32()
        .map(|z: f32| if z < FARTHEST { f64::from(z) } else { f64::NAN })
        .collect();
    Ok(Depths { width: size.width(), height: size.height(), depths, is_integer: false })
}

/// Checks that all layers fit in memory: unpacked, where each value of a channel takes at least four bytes, and as `per_pixel` bytes for each
/// pixel of the result.
pub(super) fn check_size(bytes: &[u8], per_pixel: usize) -> Result<(), Error> {
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(broken_file)?;
    let limit = max_memory(bytes.len());
    for header in &meta.headers {
        let (width, height) = (header.layer_size.width(), header.layer_size.height());
        let per_pixel = per_pixel + 4 * header.channels.list.len();
        if limit / per_pixel < width.saturating_mul(height) {
            bail!(
                "{width} x {height} pixels would take more than {limit} bytes of memory: make the picture smaller"
            );
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use ::exr::prelude::{
        AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, SmallVec,
        WritableImage as _,
    };

    use super::*;
    use crate::hostile;

    /// Creates a file with these channels, each of 3 x 2 numbers.
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
            assert_eq!((read.width, read.height, read.is_integer), (3, 2, false));
            let finite: Vec<_> = read.depths.iter().map(|z| z.is_finite().then_some(*z)).collect();
            assert_eq!(finite, [Some(1.5), Some(2.0), None, None, Some(0.25), Some(-1.0)]);
        }
    }

    #[test]
    fn files_without_depths_give_errors() {
        let colors = file(&[("R", [0.0; 6]), ("G", [0.0; 6]), ("B", [0.0; 6])]);
        assert_eq!(
            read_depth(&colors).unwrap_err().to_string(),
            "expected a channel Z, V, Y or depth, or a single channel; found the channels B, G, R"
        );
        let bytes = file(&[("Z", DEPTHS)]);
        for file in [&bytes[..bytes.len() / 2], b"v 0 0 0"] {
            let error = read_depth(file).unwrap_err().to_string();
            assert!(error.starts_with("this is not a readable OpenEXR file: "), "{error}");
        }
    }

    #[test]
    fn hostile_files_give_errors() {
        hostile::check_no_panic(&file(&[("Z", DEPTHS)]), read_depth);
    }
}
