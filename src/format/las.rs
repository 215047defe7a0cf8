//! LAS, the points of surveys and laser scanners. Coordinates are stored as integers with a scale and an offset.

use std::io::{Read, SeekFrom};
use std::ops::ControlFlow;

use las::point::Format;
use las::{PointData, PointDataBuilder, Transform, Vector, raw};
use maquette_node::importers::{BlockFile, FileReader, InputFile, NotInBlocks, ReadBlocks};
use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::{Attribute, Points};
use nalgebra::Point3;

use super::excerpt;

/// Reads the points in a LAS file.
///
/// Further data become attributes: `color`, `intensity`, and `class`, the number of the classification (2 is ground). A column of zeros
/// counts as missing, as the format defines. From the 16 bits of a color channel the upper 8 are used; if all channels are below 256, as
/// some writers store them, the lower 8 are used. Points marked as withheld or synthetic are read like all others.
///
/// Returns an error if the bytes are not a LAS file, or the file is compressed or truncated.
pub fn read(bytes: &[u8]) -> Result<Points, Error> {
    let layout = Layout::read(bytes, bytes.len())?;
    if layout.count == 0 {
        bail!("the file has no points");
    }
    let body = &bytes[layout.start..][..layout.count * layout.record];
    // The crate `las` copies the records; blocks keep the copies small.
    let blocks = body.chunks(BLOCK_LEN * layout.record).map(|it| layout.decode(it.to_vec()));
    let mut summary = Summary::new(&layout);
    let _ = blocks.clone().try_for_each(|block| summary.add(&block));
    summary.points(blocks, layout.count)
}

/// The number of points that are decoded at a time.
const BLOCK_LEN: usize = 1 << 16;

/// Reads the points in blocks. A first pass ends at the block from which it is known which columns the points have.
fn read_blocks(
    file: &mut BlockFile<'_>,
    sink: &mut dyn FnMut(Points) -> Result<(), Error>,
) -> Result<(), Error> {
    /// More bytes than a header has.
    const HEAD: u64 = 1 << 12;
    let mut head = Vec::new();
    file.content.take(HEAD).read_to_end(&mut head)?;
    let layout = Layout::read(&head, usize::try_from(file.size)?)?;
    if layout.count == 0 {
        return Err(NotInBlocks.into());
    }
    let mut summary = Summary::new(&layout);
    layout.for_each_block(file, &mut |block| Ok(summary.add(&block)))?;
    layout.for_each_block(file, &mut |block| {
        let count = block.len();
        sink(summary.points([block].into_iter(), count)?)?;
        Ok(ControlFlow::Continue(()))
    })
}

/// The columns that the points of a file have. A column of zeros counts as missing.
struct Summary {
    has_colors: bool,
    /// The maximum of all channels of all colors.
    max_channel: u16,
    has_intensities: bool,
    has_classes: bool,
}

impl Summary {
    fn new(layout: &Layout) -> Self {
        let has_colors = layout.kind.has_color;
        Self { has_colors, max_channel: 0, has_intensities: false, has_classes: false }
    }

    /// Adds the points of a block. Breaks if further points cannot change the summary.
    fn add(&mut self, data: &PointData) -> ControlFlow<()> {
        let channels = data.rgb().into_iter().flatten().flat_map(<[u16; 3]>::from);
        self.max_channel = self.max_channel.max(channels.max().unwrap_or(0));
        self.has_intensities |= data.intensity().any(|intensity| intensity > 0);
        self.has_classes |= data.classification().any(|class| class > 0);
        let knows_colors = !self.has_colors || self.max_channel > u8::MAX.into();
        match knows_colors && self.has_intensities && self.has_classes {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }

    /// Decodes `count` points in blocks of records.
    fn points(
        &self,
        blocks: impl Iterator<Item = PointData>,
        count: usize,
    ) -> Result<Points, Error> {
        let has_colors = self.max_channel > 0;
        let mut positions = Vec::with_capacity(count);
        let mut colors = Vec::with_capacity(count * usize::from(has_colors));
        let mut intensities = Vec::with_capacity(count * usize::from(self.has_intensities));
        let mut classes = Vec::with_capacity(count * usize::from(self.has_classes));
        let shift = if self.max_channel < 256 { 0 } else { 8 };
        for data in blocks {
            let xyz = data.x().zip(data.y()).zip(data.z());
            positions.extend(xyz.map(|((x, y), z)| Point3::new(x, y, z)));
            if has_colors {
                let rgb = data.rgb().into_iter().flatten().map(<[u16; 3]>::from);
                colors.extend(rgb.map(|color| color.map(|channel| (channel >> shift) as u8)));
            }
            if self.has_intensities {
                intensities.extend(data.intensity().map(f64::from));
            }
            if self.has_classes {
                classes.extend(data.classification().map(u32::from));
            }
        }
        let mut points = Points::new(positions)?;
        if has_colors {
            points = points.with_attribute("color", Attribute::Color(colors.into()))?;
        }
        if self.has_intensities {
            points = points.with_attribute("intensity", Attribute::Number(intensities.into()))?;
        }
        if self.has_classes {
            points = points.with_attribute("class", Attribute::Index(classes.into()))?;
        }
        Ok(points)
    }
}

/// The place and the format of the records in a file.
struct Layout {
    kind: Format,
    transforms: Vector<Transform>,
    /// The position in the file at which the records begin, in bytes.
    start: usize,
    /// The number of points.
    count: usize,
    /// The size of a record in bytes.
    record: usize,
}

impl Layout {
    /// Reads the header of a file of `size` bytes, and checks that it has as many points as the header states. `head` is the start of the
    /// file.
    ///
    /// The crate `las` is used only for the header. It trusts the sizes of the data between the header and the points and after the points,
    /// and these data are not needed.
    fn read(head: &[u8], size: usize) -> Result<Self, Error> {
        let signature = &head[..head.len().min(raw::LASF.len())];
        if signature != raw::LASF {
            bail!("expected `LASF` at the start of the file, found `{}`", excerpt(signature));
        }
        let Ok(header) = raw::Header::read_from(head) else {
            bail!(
                "the file ends within its header, after {size} bytes: it is truncated, copy it again"
            );
        };
        let format = header.point_data_record_format;
        let Ok(mut kind) = Format::new(format) else {
            bail!("expected a point format from 0 to 10 (LAS 1.0 to 1.4), found {format}");
        };
        if kind.is_compressed {
            bail!(
                "the points are compressed (LAZ), which is not supported: unpack the file with `laszip -i in.laz -o out.las` or \
                 `pdal translate in.laz out.las`"
            );
        }
        let (record, expected) = (header.point_data_record_length, kind.len());
        let Some(extra_bytes) = record.checked_sub(expected) else {
            bail!(
                "the header gives each point {record} bytes, but points of format {format} have {expected}"
            );
        };
        kind.extra_bytes = extra_bytes;
        // The count in `header` itself is 0 if the number of points does not fit in it. Then `large_file` has the count.
        let expected = match (header.number_of_point_records, header.large_file) {
            (0, Some(large)) => large.number_of_point_records,
            (count, _) => count.into(),
        };
        let start = header.offset_to_point_data as usize;
        let record = usize::from(record);
        let found = size.saturating_sub(start) / record;
        let count = usize::try_from(expected).ok().filter(|&count| count <= found);
        let Some(count) = count else {
            bail!(
                "expected {expected} points of {record} bytes each, found {found}: the file is truncated, copy it again"
            );
        };
        let transforms = Vector {
            x: Transform { scale: header.x_scale_factor, offset: header.x_offset },
            y: Transform { scale: header.y_scale_factor, offset: header.y_offset },
            z: Transform { scale: header.z_scale_factor, offset: header.z_offset },
        };
        // A file without points may end before the records would begin.
        Ok(Self { kind, transforms, start: start.min(size), count, record })
    }

    fn decode(&self, records: Vec<u8>) -> PointData {
        let data = PointDataBuilder::new().with_format(self.kind).with_transforms(self.transforms);
        data.build_from_bytes(records).expect("whole records")
    }

    /// Reads the records in blocks, until `see` breaks.
    fn for_each_block(
        &self,
        file: &mut BlockFile<'_>,
        see: &mut dyn FnMut(PointData) -> Result<ControlFlow<()>, Error>,
    ) -> Result<(), Error> {
        file.content.seek(SeekFrom::Start(self.start as u64))?;
        let mut left = self.count;
        while left > 0 {
            let count = left.min(file.block_len);
            let mut records = vec![0; count * self.record];
            file.content.read_exact(&mut records)?;
            if see(self.decode(records))?.is_break() {
                return Ok(());
            }
            left -= count;
        }
        Ok(())
    }
}

/// Reads LAS files. The error for compressed files names tools that unpack them.
pub(super) struct PointsLas;

impl FileReader for PointsLas {
    type Value = Points;
    const EXTENSIONS: &'static [&'static str] = &["las", "laz"];
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::POINTS_READ;
    const BLOCKS: Option<ReadBlocks> = Some(read_blocks);
    const SIZE: crate::SizeReader = Some(crate::size::las);

    fn read(file: &InputFile<'_>) -> Result<Points, Error> {
        read(file.bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hostile;

    // A file of LAS 1.4 with points of format 7, with 16-bit colors, some 5000 km from the origin.
    const SURVEY: &[u8] = include_bytes!("../../tests/data/formats/survey.las");

    // A file of LAS 1.2 with points of format 2 with extra bytes and 8-bit colors; the first point is synthetic, the second withheld.
    const BYTES: &[u8] = include_bytes!("../../tests/data/formats/bytes.las");

    fn assert_near(points: &Points, expected: &[[f64; 3]]) {
        assert_eq!(points.positions().len(), expected.len());
        for (point, &position) in points.positions().iter().zip(expected) {
            assert!((point - Point3::from(position)).amax() < 2e-9, "{point} is not {position:?}");
        }
    }

    #[test]
    fn a_survey_keeps_its_coordinates_to_the_last_digit() {
        let points = read(SURVEY).unwrap();
        let positions = [
            [500000.123, 5400000.25, 431.5],
            [500001.5, 5400002.0, -0.001],
            [499999.001, 5399999.999, 0.0],
            [512345.678, 5412345.678, 12.25],
        ];
        assert_near(&points, &positions);
        let attributes = points.attributes();
        let colors = [[255, 0, 0], [1, 255, 0], [0, 1, 255], [128, 0, 0]];
        assert_eq!(attributes.colors("color").unwrap()[..], colors);
        let intensities = Attribute::Number(vec![0.0, 65535.0, 7.0, 1000.0].into());
        assert_eq!(attributes.get("intensity"), Some(&intensities));
        assert_eq!(attributes.get("class"), Some(&Attribute::Index(vec![2, 6, 200, 0].into())));
    }

    #[test]
    fn colors_of_8_bits_and_empty_columns_are_recognized() {
        let points = read(BYTES).unwrap();
        assert_near(&points, &[[1.25, 3.0, 0.5], [-2.5, 4.0, 1.0], [0.01, 5.0, -7.5]]);
        let attributes = points.attributes();
        let colors = [[255, 1, 0], [0, 128, 0], [10, 20, 30]];
        assert_eq!(attributes.colors("color").unwrap()[..], colors);
        assert_eq!(attributes.get("intensity"), None);
        assert_eq!(attributes.get("class"), Some(&Attribute::Index(vec![2, 3, 31].into())));
    }

    #[test]
    fn invalid_files_are_rejected() {
        fn error(at: usize, bytes: &[u8]) -> String {
            let mut file = BYTES.to_vec();
            file[at..at + bytes.len()].copy_from_slice(bytes);
            read(&file).unwrap_err().to_string()
        }
        assert_eq!(error(0, b"LAZF"), "expected `LASF` at the start of the file, found `LAZF`");
        assert!(error(104, &[0x82]).contains("the points are compressed (LAZ)"));
        assert_eq!(
            error(104, &[11]),
            "expected a point format from 0 to 10 (LAS 1.0 to 1.4), found 11"
        );
        assert_eq!(
            error(105, &[25, 0]),
            "the header gives each point 25 bytes, but points of format 2 have 26"
        );
        assert_eq!(
            error(107, &[255; 4]),
            "expected 4294967295 points of 30 bytes each, found 3: the file is truncated, copy it again"
        );
        assert_eq!(error(107, &[0; 4]), "the file has no points");
        assert_eq!(error(131, &f64::NAN.to_le_bytes()), "the position of point 0 is not finite");
        let cut = read(&BYTES[..100]).unwrap_err().to_string();
        assert_eq!(
            cut,
            "the file ends within its header, after 100 bytes: it is truncated, copy it again"
        );
    }

    #[test]
    fn hostile_files_give_errors() {
        hostile::check_no_panic(SURVEY, read);
        hostile::check_no_panic(BYTES, read);
    }
}
