//! LAS, the points of surveys and laser scanners. Coordinates are stored as integers with a scale and an offset.

use las::point::Format;
use las::{PointData, PointDataBuilder, Transform, Vector, raw};
use maquette_node::importers::{FileReader, InputFile};
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
    let data = records(bytes)?;
    if data.is_empty() {
        bail!("the file has no points");
    }
    let positions = data.x().zip(data.y()).zip(data.z());
    let mut points =
        Points::new(positions.map(|((x, y), z)| Point3::new(x, y, z)).collect::<Vec<_>>())?;
    let max = data.rgb().into_iter().flatten().flat_map(<[u16; 3]>::from).max().unwrap_or(0);
    if let Some(colors) = data.rgb().filter(|_| max > 0) {
        let shift = if max < 256 { 0 } else { 8 };
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

/// Returns the records of the points, as many as the header states.
///
/// The crate `las` is used only for the header. It trusts the sizes of the data between the header and the points and after the points, and
/// these data are not needed.
fn records(bytes: &[u8]) -> Result<PointData, Error> {
    let signature = &bytes[..bytes.len().min(raw::LASF.len())];
    if signature != raw::LASF {
        bail!("expected `LASF` at the start of the file, found `{}`", excerpt(signature));
    }
    let Ok(header) = raw::Header::read_from(bytes) else {
        let found = bytes.len();
        bail!(
            "the file ends within its header, after {found} bytes: it is truncated, copy it again"
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
    let body = bytes.get(start..).unwrap_or_default();
    let found = body.len() / usize::from(record);
    let count = usize::try_from(expected).ok().filter(|&count| count <= found);
    let Some(count) = count else {
        bail!(
            "expected {expected} points of {record} bytes each, found {found}: the file is truncated, copy it again"
        );
    };
    let body = &body[..count * usize::from(record)];
    let transforms = Vector {
        x: Transform { scale: header.x_scale_factor, offset: header.x_offset },
        y: Transform { scale: header.y_scale_factor, offset: header.y_offset },
        z: Transform { scale: header.z_scale_factor, offset: header.z_offset },
    };
    let data = PointDataBuilder::new().with_format(kind).with_transforms(transforms);
    Ok(data.build_from_bytes(body.to_vec()).expect("whole records"))
}

/// Reads LAS files. The error for compressed files names tools that unpack them.
pub(super) struct PointsLas;

impl FileReader for PointsLas {
    type Value = Points;
    const EXTENSIONS: &'static [&'static str] = &["las", "laz"];
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::POINTS_READ;
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
