//! LAS, the points of surveys and laser scanners: whole numbers that a scale and an offset make places of.

use las::point::Format;
use las::{PointData, PointDataBuilder, Transform, Vector, raw};
use maquette_node::reading::{FileReader, Reading};
use maquette_syntax::error;
use maquette_value::{Attribute, Points, PointsError};
use nalgebra::Point3;
use thiserror::Error;

use super::excerpt;

/// Why bytes are not points in a LAS file.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum LasError {
    /// Other bytes at the start.
    #[error("the file begins with `{found}`, where a LAS file has `LASF`")]
    Signature {
        /// What it begins with.
        found: String,
    },
    /// The end comes before the points.
    #[error("the file ends within its header, after {found} bytes: it was cut off, copy it again")]
    Header {
        /// Bytes of the file.
        found: usize,
    },
    /// Compressed points.
    #[error(
        "its points are compressed (LAZ), which is not read: unpack it first, by `laszip -i in.laz -o out.las` or \
         `pdal translate in.laz out.las`"
    )]
    Compressed,
    /// Points of a kind that is not known.
    #[error("its points have the format {format}, but known are 0 to 10 (LAS 1.0 to 1.4)")]
    Format {
        /// What the header says.
        format: u8,
    },
    /// Too few bytes for each point.
    #[error(
        "its header gives each point {found} bytes, but points of format {format} have {expected}"
    )]
    Record {
        /// What the header says.
        found: u16,
        /// The format of the points.
        format: u8,
        /// Bytes of such a point.
        expected: u16,
    },
    /// Fewer points than promised.
    #[error(
        "its header promises {expected} points of {record} bytes each, but {found} are there: it was cut off, copy it again"
    )]
    CutOff {
        /// What the header says.
        expected: u64,
        /// Bytes of each.
        record: u16,
        /// Points that are there.
        found: u64,
    },
    /// Nothing at all.
    #[error("there is no point in the file")]
    Empty,
    /// Points that cannot be.
    #[error(transparent)]
    Points(#[from] PointsError),
}

/// The points in a LAS file.
///
/// What they have beside a place becomes attributes: `color`, `intensity`, and `class`, the number of their classification (2 is ground). A
/// column that is 0 everywhere is none, as the format has it. Colors have 16 bits, of which the upper 8 are taken, but all of them have only 8
/// in the files of some writers. Points that are marked as withheld or synthetic are points like others.
///
/// # Errors
/// If the bytes are not a LAS file, it is compressed, or ends too early.
pub fn read(bytes: &[u8]) -> Result<Points, LasError> {
    let data = records(bytes)?;
    if data.is_empty() {
        return Err(LasError::Empty);
    }
    let places = data.x().zip(data.y()).zip(data.z());
    let mut points =
        Points::new(places.map(|((x, y), z)| Point3::new(x, y, z)).collect::<Vec<_>>())?;
    let most = data.rgb().into_iter().flatten().flat_map(<[u16; 3]>::from).max().unwrap_or(0);
    if let Some(colors) = data.rgb().filter(|_| most > 0) {
        let shift = if most < 256 { 0 } else { 8 };
        let colors = colors
            .map(|(red, green, blue)| {
                [red, green, blue].map(|channel: u16| (channel >> shift) as u8)
            })
            .collect();
        points = points.with_attribute("color", Attribute::Color(colors))?;
    }
    if data.intensity().any(|intensity| intensity > 0) {
        let intensities = data.intensity().map(f64::from).collect();
        points = points.with_attribute("intensity", Attribute::Number(intensities))?;
    }
    if data.classification().any(|class| class > 0) {
        let classes = data.classification().map(u32::from).collect();
        points = points.with_attribute("class", Attribute::Index(classes))?;
    }
    Ok(points)
}

/// The records of the points, as many as the header promises.
///
/// Only the header itself is read by the crate: what stands between it and the points (and behind them) has sizes of its own, which the crate
/// trusts, and none of it is needed.
fn records(bytes: &[u8]) -> Result<PointData, LasError> {
    let signature = &bytes[..bytes.len().min(raw::LASF.len())];
    if signature != raw::LASF {
        return Err(LasError::Signature { found: excerpt(signature) });
    }
    let header =
        raw::Header::read_from(bytes).map_err(|_| LasError::Header { found: bytes.len() })?;
    let format = header.point_data_record_format;
    let mut kind = Format::new(format).map_err(|_| LasError::Format { format })?;
    if kind.is_compressed {
        return Err(LasError::Compressed);
    }
    let (record, expected) = (header.point_data_record_length, kind.len());
    kind.extra_bytes =
        record.checked_sub(expected).ok_or(LasError::Record { found: record, format, expected })?;
    // The first of the two counts is 0 where there are more points than it can tell.
    let expected = match (header.number_of_point_records, header.large_file) {
        (0, Some(large)) => large.number_of_point_records,
        (count, _) => count.into(),
    };
    let start = header.offset_to_point_data as usize;
    let body = bytes.get(start..).unwrap_or_default();
    let found = body.len() / usize::from(record);
    let count = usize::try_from(expected).ok().filter(|&count| count <= found);
    let cut_off = LasError::CutOff { expected, record, found: found as u64 };
    let body = &body[..count.ok_or(cut_off)? * usize::from(record)];
    let transforms = Vector {
        x: Transform { scale: header.x_scale_factor, offset: header.x_offset },
        y: Transform { scale: header.y_scale_factor, offset: header.y_offset },
        z: Transform { scale: header.z_scale_factor, offset: header.z_offset },
    };
    let data = PointDataBuilder::new().with_format(kind).with_transforms(transforms);
    Ok(data.build_from_bytes(body.to_vec()).expect("whole records"))
}

/// Reads LAS files, and says what to do with compressed ones.
pub(super) struct PointsLas;

impl FileReader for PointsLas {
    type Value = Points;
    const ENDINGS: &'static [&'static str] = &["las", "laz"];
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::POINTS_READ;

    fn read(file: &Reading<'_>) -> Result<Points, error::Error> {
        Ok(read(file.bytes())?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hostile;

    // LAS 1.4, points of format 7, with 16-bit colors, some 5000 km from the origin.
    const SURVEY: &[u8] = include_bytes!("../../tests/data/formats/survey.las");

    // LAS 1.2, points of format 2 with extra bytes, colors of 8 bits, the first point synthetic and the second withheld.
    const BYTES: &[u8] = include_bytes!("../../tests/data/formats/bytes.las");

    fn near(points: &Points, expected: &[[f64; 3]]) {
        assert_eq!(points.positions().len(), expected.len());
        for (point, &place) in points.positions().iter().zip(expected) {
            assert!((point - Point3::from(place)).amax() < 2e-9, "{point} is not {place:?}");
        }
    }

    #[test]
    fn a_survey_keeps_its_places_to_the_last_digit() {
        let points = read(SURVEY).unwrap();
        let places = [
            [500000.123, 5400000.25, 431.5],
            [500001.5, 5400002.0, -0.001],
            [499999.001, 5399999.999, 0.0],
            [512345.678, 5412345.678, 12.25],
        ];
        near(&points, &places);
        let attributes = points.attributes();
        let colors = [[255, 0, 0], [1, 255, 0], [0, 1, 255], [128, 0, 0]];
        assert_eq!(attributes.colors("color").unwrap()[..], colors);
        let intensities = Attribute::Number(vec![0.0, 65535.0, 7.0, 1000.0].into());
        assert_eq!(attributes.get("intensity"), Some(&intensities));
        assert_eq!(attributes.get("class"), Some(&Attribute::Index(vec![2, 6, 200, 0].into())));
    }

    #[test]
    fn colors_of_8_bits_and_columns_of_nothing_are_told() {
        let points = read(BYTES).unwrap();
        near(&points, &[[1.25, 3.0, 0.5], [-2.5, 4.0, 1.0], [0.01, 5.0, -7.5]]);
        let attributes = points.attributes();
        let colors = [[255, 1, 0], [0, 128, 0], [10, 20, 30]];
        assert_eq!(attributes.colors("color").unwrap()[..], colors);
        assert_eq!(attributes.get("intensity"), None);
        assert_eq!(attributes.get("class"), Some(&Attribute::Index(vec![2, 3, 31].into())));
    }

    #[test]
    fn files_that_lie_are_refused_with_numbers() {
        fn error(at: usize, bytes: &[u8]) -> String {
            let mut file = BYTES.to_vec();
            file[at..at + bytes.len()].copy_from_slice(bytes);
            read(&file).unwrap_err().to_string()
        }
        assert_eq!(error(0, b"LAZF"), "the file begins with `LAZF`, where a LAS file has `LASF`");
        assert!(error(104, &[0x82]).contains("its points are compressed (LAZ)"));
        assert_eq!(
            error(104, &[11]),
            "its points have the format 11, but known are 0 to 10 (LAS 1.0 to 1.4)"
        );
        assert_eq!(
            error(105, &[25, 0]),
            "its header gives each point 25 bytes, but points of format 2 have 26"
        );
        assert_eq!(
            error(107, &[255; 4]),
            "its header promises 4294967295 points of 30 bytes each, but 3 are there: it was cut off, copy it again"
        );
        assert_eq!(error(107, &[0; 4]), "there is no point in the file");
        assert_eq!(error(131, &f64::NAN.to_le_bytes()), "point 0 is not at a finite place");
        let cut = read(&BYTES[..100]).unwrap_err().to_string();
        assert_eq!(
            cut,
            "the file ends within its header, after 100 bytes: it was cut off, copy it again"
        );
    }

    #[test]
    fn hostile_files_give_errors() {
        hostile::survive(SURVEY, read);
        hostile::survive(BYTES, read);
    }
}
