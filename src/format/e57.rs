//! E57, the files of laser scanners: several scans, each with its pose.
//!
//! The crate `e57` trusts the sizes that a file states, so they are checked here before the crate reads the file.

use std::io::{Cursor, SeekFrom};

use e57::{
    CartesianCoordinate, E57Reader, Point, PointCloud, RecordDataType, SphericalCoordinate,
    Transform,
};
use maquette_node::importers::{
    BlockFile, FileReader, InputFile, NotInBlocks, ReadBlocks, ReadSeek,
};
use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::{Attribute, Points, Rgb};
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion};

use super::{MAX_NAMESPACES, finite, has_many_namespaces, max_memory};

/// The maximum number of fields of a point; the standard defines 20 fields.
const MAX_FIELDS: usize = 64;

/// The range of bytes in the file that contains the length of the XML description.
const DESCRIPTION: std::ops::Range<usize> = 32..40;

/// Reads the valid points of all scans, transformed by the poses of their scans.
///
/// Colors become the attribute `color`, which is black for scans without colors. Intensities become the attribute `intensity` in the file's
/// own units, which is 0 for scans without intensities. Points with NaN or infinite coordinates are left out.
///
/// Returns an error if the bytes are not an E57 file, a checksum is wrong, or the file is too short for its points.
pub fn read(bytes: &[u8]) -> Result<Points, Error> {
    Ok(read_finite(bytes)?.0)
}

/// Reads the points. Also returns the number of points that are left out because a coordinate is NaN or infinite.
fn read_finite(bytes: &[u8]) -> Result<(Points, usize), Error> {
    let mut all = None;
    let mut content = Cursor::new(bytes);
    let mut file = BlockFile {
        content: &mut content,
        size: bytes.len() as u64,
        color_range: None,
        block_len: usize::MAX,
    };
    let left_out = read_scans(&mut file, &mut |points| {
        all = Some(points);
        Ok(())
    })?;
    Ok((all.expect("there is an error if there are no points"), left_out))
}

/// Reads the points in blocks.
fn read_blocks(
    file: &mut BlockFile<'_>,
    sink: &mut dyn FnMut(Points) -> Result<(), Error>,
) -> Result<(), Error> {
    match read_scans(file, sink)? {
        0 => Ok(()),
        _ => Err(NotInBlocks.into()),
    }
}

/// Returns an error if the stated length of the description exceeds the size of the file: the crate reserves this much memory before it
/// reads the description.
fn check_description(content: &mut dyn ReadSeek, found: u64) -> Result<(), Error> {
    if found < DESCRIPTION.end as u64 {
        return Ok(());
    }
    let mut length = [0; size_of::<u64>()];
    content.seek(SeekFrom::Start(DESCRIPTION.start as u64))?;
    content.read_exact(&mut length)?;
    content.rewind()?;
    let expected = u64::from_le_bytes(length);
    if expected > found {
        bail!(
            "the description should have {expected} bytes, but the file has {found}: it is truncated, copy it again"
        );
    }
    Ok(())
}

/// The points of a block.
#[derive(Default)]
struct Block {
    positions: Vec<Point3<f64>>,
    /// Empty if no scan has colors.
    colors: Vec<Rgb>,
    /// Empty if no scan has intensities.
    intensities: Vec<f64>,
}

impl Block {
    fn into_points(self) -> Result<Points, Error> {
        let mut points = Points::new(self.positions)?;
        if !self.colors.is_empty() {
            points = points.with_attribute("color", Attribute::Color(self.colors.into()))?;
        }
        if !self.intensities.is_empty() {
            let intensities = Attribute::Number(self.intensities.into());
            points = points.with_attribute("intensity", intensities)?;
        }
        Ok(points)
    }
}

/// Reads the points of all scans in blocks. Returns the number of points that are left out because a coordinate is NaN or infinite.
fn read_scans(
    file: &mut BlockFile<'_>,
    sink: &mut dyn FnMut(Points) -> Result<(), Error>,
) -> Result<usize, Error> {
    check_description(file.content, file.size)?;
    if has_many_namespaces(&E57Reader::raw_xml(&mut *file.content).map_err(broken_file)?) {
        bail!("the description declares more than {MAX_NAMESPACES} namespaces");
    }
    file.content.rewind()?;
    let block_len = file.block_len;
    let size = usize::try_from(file.size)?;
    let mut file = E57Reader::new(&mut *file.content).map_err(broken_file)?;
    let scans = file.pointclouds();
    check(&scans, size)?;
    let has_colors = scans.iter().any(PointCloud::has_color);
    let has_intensities = scans.iter().any(PointCloud::has_intensity);
    let mut block = Block::default();
    let (mut is_empty, mut left_out) = (true, 0);
    for (index, scan) in scans.iter().enumerate().filter(|(_, scan)| scan.records > 0) {
        let pose = pose(index, scan.transform.clone().unwrap_or_default())?;
        let mut points = file.pointcloud_simple(scan).map_err(broken_file)?;
        // Spherical coordinates are converted here, because the crate would use the system's sine function, which differs between machines.
        points.spherical_to_cartesian(false);
        points.apply_pose(false);
        points.intensity_to_color(false);
        points.normalize_intensity(false);
        for point in points {
            let point = match point {
                Ok(point) => point,
                // The crate reports a packet that completes no point as an internal error. Either the next packet completes the point, or
                // the file ends, which is reported as another error.
                Err(e57::Error::Internal { .. }) => continue,
                Err(error) => return Err(broken_file(error)),
            };
            let Some(position) = cartesian_position(&point) else { continue };
            if !position.iter().all(|x| x.is_finite()) {
                left_out += 1;
                continue;
            }
            if block.positions.len() == block_len {
                sink(std::mem::take(&mut block).into_points()?)?;
            }
            is_empty = false;
            block.positions.push(pose * position);
            if has_colors {
                let color = point.color.map(|color| {
                    [color.red, color.green, color.blue]
                        .map(|channel: f32| (channel * 255.0).round() as u8)
                });
                block.colors.push(color.unwrap_or_default());
            }
            if has_intensities {
                block.intensities.push(point.intensity.map_or(0.0, f64::from));
            }
        }
    }
    if is_empty {
        bail!("the {} scans have no valid points", scans.len());
    }
    sink(block.into_points()?)?;
    Ok(left_out)
}

/// Converts an error of the crate `e57`.
fn broken_file(error: e57::Error) -> Error {
    Error::new(format!("{error}: if another program can read the file, export it again from there"))
}

/// Checks that the file is long enough for its points, and that they fit in memory. The crate would trust the stated counts.
fn check(scans: &[PointCloud], found: usize) -> Result<(), Error> {
    let (mut points, mut bits) = (0, 0);
    for (scan, cloud) in scans.iter().enumerate().filter(|(_, cloud)| cloud.records > 0) {
        let fields = cloud.prototype.len();
        let sizes = cloud.prototype.iter().map(|field| field_bits(&field.data_type));
        let varying = sizes.clone().filter(|&size| size > 0).count();
        // If no field could vary, points would take no bytes, and the crate would return points forever.
        if varying == 0 || fields > MAX_FIELDS {
            bail!(
                "the points of scan {scan} have {fields} fields, of which {varying} can vary: \
                 expected at most {MAX_FIELDS} fields, and at least one that can vary"
            );
        }
        points += u128::from(cloud.records);
        bits += u128::from(cloud.records) * u128::from(sizes.sum::<u32>());
    }
    let expected = bits.div_ceil(8);
    if expected > found as u128 {
        bail!(
            "the {} scans should have {points} points in {expected} bytes, but the file has {found} bytes: it is truncated, copy it again",
            scans.len()
        );
    }
    let limit = max_memory(found);
    let each = size_of::<Point3<f64>>() + size_of::<f64>() + size_of::<Rgb>();
    if points * each as u128 > limit as u128 {
        bail!(
            "{points} points would take more than {limit} bytes of memory: thin them before the export"
        );
    }
    Ok(())
}

/// Returns the number of bits that a field takes in the file. The bits of an integer follow from its range.
fn field_bits(field: &RecordDataType) -> u32 {
    match *field {
        RecordDataType::Single { .. } => 32,
        RecordDataType::Double { .. } => 64,
        RecordDataType::ScaledInteger { min, max, .. } | RecordDataType::Integer { min, max } => {
            u64::BITS - max.abs_diff(min).leading_zeros()
        }
    }
}

/// Returns the transformation from a scan's coordinates to those of the file.
fn pose(scan: usize, pose: Transform) -> Result<Isometry3<f64>, Error> {
    let e57::Quaternion { w, x, y, z } = pose.rotation;
    let quaternion = Quaternion::new(w, x, y, z);
    if !(0.999..1.001).contains(&quaternion.norm()) {
        let rotation = [w, x, y, z];
        bail!("the pose of scan {scan} has the quaternion {rotation:?}, whose length is not 1");
    }
    let e57::Translation { x, y, z } = pose.translation;
    let rotation = UnitQuaternion::from_quaternion(quaternion);
    Ok(Isometry3::from_parts(Translation3::new(x, y, z), rotation))
}

/// Returns the position of a point in the coordinates of its scan, or `None` if the point is invalid.
fn cartesian_position(point: &Point) -> Option<Point3<f64>> {
    match (&point.cartesian, &point.spherical) {
        (&CartesianCoordinate::Valid { x, y, z }, _) => Some(Point3::new(x, y, z)),
        (_, &SphericalCoordinate::Valid { range, azimuth, elevation }) => {
            let ((sin, cos), (up, out)) = (libm::sincos(azimuth), libm::sincos(elevation));
            Some(Point3::new(out * cos, out * sin, up) * range)
        }
        _ => None,
    }
}

/// Reads E57 files.
pub(super) struct PointsE57;

impl FileReader for PointsE57 {
    type Value = Points;
    const EXTENSIONS: &'static [&'static str] = &["e57"];
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::POINTS_READ;
    const BLOCKS: Option<ReadBlocks> = Some(read_blocks);
    const SIZE: crate::SizeReader = Some(crate::size::e57);

    fn read(file: &InputFile<'_>) -> Result<Points, Error> {
        let (points, left_out) = read_finite(file.bytes())?;
        finite::warn_left_out(file, left_out, "point");
        Ok(points)
    }
}

#[cfg(test)]
mod tests {
    use e57::E57Writer;

    use super::*;
    use crate::hostile;

    // The file has two scans. The first has colors, is rotated by a quarter turn about z and moved, and its second point is invalid; the
    // second has neither colors nor a pose.
    const SCANS: &[u8] = include_bytes!("../../tests/data/formats/two_scans.e57");

    // The file has one scan in spherical coordinates, raised by 1, whose last point is invalid.
    const SPHERICAL: &[u8] = include_bytes!("../../tests/data/formats/spherical.e57");

    fn assert_near(points: &Points, expected: &[[f64; 3]]) {
        assert_eq!(points.positions().len(), expected.len());
        for (point, &position) in points.positions().iter().zip(expected) {
            assert!((point - Point3::from(position)).amax() < 1e-12, "{point} is not {position:?}");
        }
    }

    #[test]
    fn every_scan_is_moved_by_its_pose() {
        let points = read(SCANS).unwrap();
        assert_near(&points, &[[10.0, 21.0, 30.0], [9.0, 23.0, 30.0], [0.5, 0.25, -0.125]]);
        let attributes = points.attributes();
        let colors = [[255, 0, 0], [1, 2, 3], [0, 0, 0]];
        assert_eq!(attributes.colors("color").unwrap()[..], colors);
        let intensities = Attribute::Number(vec![0.25, 1.0, 0.75].into());
        assert_eq!(attributes.get("intensity"), Some(&intensities));
    }

    #[test]
    fn spherical_coordinates_are_converted() {
        let points = read(SPHERICAL).unwrap();
        // The second point has the distance 3, the azimuth 0.5 and the elevation -0.25, in radians.
        let second = [2.5509019358766984, 1.3935640789167856, 0.2577881222364312];
        assert_near(&points, &[[2.0, 0.0, 1.0], second]);
        assert_eq!(points.attributes().iter().count(), 0);
    }

    #[test]
    fn counts_are_checked_against_the_file_size() {
        let scans = E57Reader::new(Cursor::new(SCANS)).unwrap().pointclouds();
        fn error(change: fn(&mut PointCloud), scans: &[PointCloud]) -> String {
            let mut scans = scans.to_vec();
            change(&mut scans[0]);
            check(&scans, SCANS.len()).unwrap_err().to_string()
        }
        let message = error(|scan| scan.records = u64::MAX, &scans);
        assert!(message.contains("2 scans should have 18446744073709551616 points"), "{message}");
        let message = error(|scan| scan.prototype.clear(), &scans);
        assert!(
            message.starts_with("the points of scan 0 have 0 fields, of which 0 can vary"),
            "{message}"
        );
        let mut scans = scans.clone();
        scans[0].prototype.truncate(1);
        scans[0].prototype[0].data_type = RecordDataType::Integer { min: -1, max: 0 };
        scans[0].records = 1 << 29;
        let bytes = (1 << 26) + 64;
        assert_eq!(
            check(&scans, bytes).unwrap_err().to_string(),
            "536870913 points would take more than 2147485696 bytes of memory: thin them before the export"
        );
    }

    #[test]
    fn invalid_files_are_rejected() {
        let message = read(&SCANS[..7000]).unwrap_err().to_string();
        assert!(
            message.contains("file size 7000 is not a multiple of the page size 1024"),
            "{message}"
        );
        let mut file = SCANS.to_vec();
        file[DESCRIPTION].fill(255);
        assert_eq!(
            read(&file).unwrap_err().to_string(),
            "the description should have 18446744073709551615 bytes, but the file has 7168: it is truncated, copy it again"
        );
        let mut file = SCANS.to_vec();
        file[5000] ^= 1;
        let message = read(&file).unwrap_err().to_string();
        assert!(message.contains("Detected invalid checksum"), "{message}");
        let turn = e57::Quaternion { w: 0.0, x: 0.0, y: 0.5, z: 0.0 };
        let message = pose(3, Transform { rotation: turn, ..Transform::default() }).unwrap_err();
        assert_eq!(
            message.to_string(),
            "the pose of scan 3 has the quaternion [0.0, 0.0, 0.5, 0.0], whose length is not 1"
        );
    }

    #[test]
    fn thousands_of_nested_namespaces_are_refused() {
        let mut file = Cursor::new(Vec::new());
        let mut writer = E57Writer::new(&mut file, "a guid").unwrap();
        let nested = (0..5000).fold(String::new(), |text, k| format!("{text}<a xmlns:n{k}='b'>"));
        writer
            .finalize_customized_xml(|xml: String| {
                Ok(xml
                    .replace("</e57Root>", &(nested.clone() + &"</a>".repeat(5000) + "</e57Root>")))
            })
            .unwrap();
        drop(writer);
        let error = read(&file.into_inner()).unwrap_err().to_string();
        assert_eq!(error, "the description declares more than 256 namespaces");
    }

    #[test]
    fn hostile_files_give_errors() {
        hostile::check_no_panic(SPHERICAL, read);
    }
}
