//! E57, the scans of laser scanners, each with the place from which it was made.
//!
//! The crate `e57` trusts the sizes that a file states. A reader here must not, so that sizes are checked before the crate reads them.

use std::io::Cursor;

use e57::{
    CartesianCoordinate, E57Reader, Point, PointCloud, RecordDataType, SphericalCoordinate,
    Transform,
};
use maquette_node::reading::{FileReader, Reading};
use maquette_syntax::error;
use maquette_value::{Attribute, Points, PointsError, Rgb};
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion};
use thiserror::Error;

use super::{MOST_NAMESPACES, finite, has_many_namespaces, most_memory};

/// Why bytes are not points in an E57 file.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum E57Error {
    /// What the crate that unpacks it found.
    #[error("{what}: if other programs read the file, export it once more from one of them")]
    Broken {
        /// What is wrong, and where.
        what: String,
    },
    /// A description that is longer than the file.
    #[error(
        "its description has {expected} bytes, but the file {found}: it was cut off, copy it again"
    )]
    Description {
        /// What the header says.
        expected: u64,
        /// Bytes of the file.
        found: usize,
    },
    /// A description that would take too much memory.
    #[error(
        "its description declares more than {MOST_NAMESPACES} namespaces: no scanner's file does"
    )]
    Namespaces,
    /// More points than fit.
    #[error(
        "its {scans} scans promise {points} points, which need {expected} bytes, but the file has {found}: it was cut off, copy it again"
    )]
    CutOff {
        /// Scans of the file.
        scans: usize,
        /// Points of all.
        points: u128,
        /// Bytes that they need at least.
        expected: u128,
        /// Bytes of the file.
        found: usize,
    },
    /// Points that take too much memory.
    #[error(
        "its {points} points would take more than {most} bytes of memory: thin them where they come from"
    )]
    TooMuch {
        /// Points of all scans.
        points: u128,
        /// Bytes that reading them may take.
        most: usize,
    },
    /// Points with no or too many fields.
    #[error(
        "the points of scan {scan} have {fields} fields, of which {told} may differ from point to point: \
         read are points of at most {MOST_FIELDS} fields, of which one or more may differ"
    )]
    Fields {
        /// Which, from 0.
        scan: usize,
        /// Fields of a point.
        fields: usize,
        /// Those with more than one possible value.
        told: usize,
    },
    /// A pose that is more than a turn.
    #[error("the pose of scan {scan} turns by the quaternion {turn:?}, whose length is not 1")]
    Pose {
        /// Which, from 0.
        scan: usize,
        /// Its real part, and the others.
        turn: [f64; 4],
    },
    /// Nothing at all.
    #[error("there is no valid point in its {scans} scans")]
    Empty {
        /// Scans of the file.
        scans: usize,
    },
    /// Points that cannot be.
    #[error(transparent)]
    Points(#[from] PointsError),
}

impl From<e57::Error> for E57Error {
    fn from(error: e57::Error) -> Self {
        Self::Broken { what: error.to_string() }
    }
}

/// Fields of a point that are unpacked at the same time; the standard has 20.
const MOST_FIELDS: usize = 64;

/// Where the file says how many bytes its description has.
const DESCRIPTION: std::ops::Range<usize> = 32..40;

/// The valid points of all scans in an E57 file, each scan moved by its pose.
///
/// If a scan has colors, they are the attribute `color`, black where there is none; if one has intensities, `intensity`, in the file's own
/// measure and 0 where there is none. Points at places that are NaN or infinite are left out.
///
/// # Errors
/// If the bytes are not an E57 file, a checksum is wrong, or the points are more than it can hold.
pub fn read(bytes: &[u8]) -> Result<Points, E57Error> {
    Ok(read_finite(bytes)?.0)
}

/// The same, and how many points that should be valid are NaN or infinite.
fn read_finite(bytes: &[u8]) -> Result<(Points, usize), E57Error> {
    // The crate reserves these before it reads them.
    if let Some(length) = bytes.get(DESCRIPTION).and_then(<[u8]>::first_chunk) {
        let expected = u64::from_le_bytes(*length);
        if expected > bytes.len() as u64 {
            return Err(E57Error::Description { expected, found: bytes.len() });
        }
    }
    if has_many_namespaces(&E57Reader::raw_xml(Cursor::new(bytes))?) {
        return Err(E57Error::Namespaces);
    }
    let mut file = E57Reader::new(Cursor::new(bytes))?;
    let scans = file.pointclouds();
    check(&scans, bytes.len())?;
    let has_colors = scans.iter().any(PointCloud::has_color);
    let has_intensities = scans.iter().any(PointCloud::has_intensity);
    let mut places = Vec::new();
    let mut colors: Vec<Rgb> = Vec::new();
    let mut intensities = Vec::new();
    let mut left_out = 0;
    for (index, scan) in scans.iter().enumerate().filter(|(_, scan)| scan.records > 0) {
        let pose = pose(index, scan.transform.clone().unwrap_or_default())?;
        let mut points = file.pointcloud_simple(scan)?;
        // Sines of the system, which the crate would take, are not the same on every machine.
        points.spherical_to_cartesian(false);
        points.apply_pose(false);
        points.intensity_to_color(false);
        points.normalize_intensity(false);
        for point in points {
            let point = match point {
                Ok(point) => point,
                // So the crate calls a packet that completes no point: the next one does, or the file ends, which is another error.
                Err(e57::Error::Internal { .. }) => continue,
                Err(error) => return Err(error.into()),
            };
            let Some(at) = place(&point) else { continue };
            if !at.iter().all(|x| x.is_finite()) {
                left_out += 1;
                continue;
            }
            places.push(pose * at);
            if has_colors {
                let color = point.color.map(|color| {
                    [color.red, color.green, color.blue]
                        .map(|channel: f32| (channel * 255.0).round() as u8)
                });
                colors.push(color.unwrap_or_default());
            }
            if has_intensities {
                intensities.push(point.intensity.map_or(0.0, f64::from));
            }
        }
    }
    if places.is_empty() {
        return Err(E57Error::Empty { scans: scans.len() });
    }
    let mut points = Points::new(places)?;
    if has_colors {
        points = points.with_attribute("color", Attribute::Color(colors.into()))?;
    }
    if has_intensities {
        points = points.with_attribute("intensity", Attribute::Number(intensities.into()))?;
    }
    Ok((points, left_out))
}

/// Checks that the file can hold the points that it promises, and memory, too: the crate takes counts as they are.
fn check(scans: &[PointCloud], found: usize) -> Result<(), E57Error> {
    let (mut points, mut bits) = (0, 0);
    for (scan, cloud) in scans.iter().enumerate().filter(|(_, cloud)| cloud.records > 0) {
        let fields = cloud.prototype.len();
        let sizes = cloud.prototype.iter().map(|field| size(&field.data_type));
        let told = sizes.clone().filter(|&size| size > 0).count();
        // Without any, points would take no bytes, and the crate would make them for ever.
        if told == 0 || fields > MOST_FIELDS {
            return Err(E57Error::Fields { scan, fields, told });
        }
        points += u128::from(cloud.records);
        bits += u128::from(cloud.records) * u128::from(sizes.sum::<u32>());
    }
    let expected = bits.div_ceil(8);
    if expected > found as u128 {
        return Err(E57Error::CutOff { scans: scans.len(), points, expected, found });
    }
    let most = most_memory(found);
    let each = size_of::<Point3<f64>>() + size_of::<f64>() + size_of::<Rgb>();
    if points * each as u128 > most as u128 {
        return Err(E57Error::TooMuch { points, most });
    }
    Ok(())
}

/// Bits of a field in the file: whole numbers have as many as their range needs.
fn size(field: &RecordDataType) -> u32 {
    match *field {
        RecordDataType::Single { .. } => 32,
        RecordDataType::Double { .. } => 64,
        RecordDataType::ScaledInteger { min, max, .. } | RecordDataType::Integer { min, max } => {
            u64::BITS - max.abs_diff(min).leading_zeros()
        }
    }
}

/// From a scan to the file's space.
fn pose(scan: usize, pose: Transform) -> Result<Isometry3<f64>, E57Error> {
    let e57::Quaternion { w, x, y, z } = pose.rotation;
    let turn = Quaternion::new(w, x, y, z);
    if !(0.999..1.001).contains(&turn.norm()) {
        return Err(E57Error::Pose { scan, turn: [w, x, y, z] });
    }
    let e57::Translation { x, y, z } = pose.translation;
    let turn = UnitQuaternion::from_quaternion(turn);
    Ok(Isometry3::from_parts(Translation3::new(x, y, z), turn))
}

/// Where a point is in its scan, if it is anywhere.
fn place(point: &Point) -> Option<Point3<f64>> {
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
    const ENDINGS: &'static [&'static str] = &["e57"];
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::POINTS_READ;

    fn read(file: &Reading<'_>) -> Result<Points, error::Error> {
        let (points, left_out) = read_finite(file.bytes())?;
        finite::tell(file, left_out, "point");
        Ok(points)
    }
}

#[cfg(test)]
mod tests {
    use e57::E57Writer;

    use super::*;
    use crate::hostile;

    // A scan with colors, turned by a quarter about z and moved, whose second point is invalid; and one without colors and pose.
    const SCANS: &[u8] = include_bytes!("../../tests/data/formats/two_scans.e57");

    // A scan in spherical coordinates, raised by 1, whose last point is invalid.
    const SPHERICAL: &[u8] = include_bytes!("../../tests/data/formats/spherical.e57");

    fn near(points: &Points, expected: &[[f64; 3]]) {
        assert_eq!(points.positions().len(), expected.len());
        for (point, &place) in points.positions().iter().zip(expected) {
            assert!((point - Point3::from(place)).amax() < 1e-12, "{point} is not {place:?}");
        }
    }

    #[test]
    fn every_scan_is_moved_by_its_pose() {
        let points = read(SCANS).unwrap();
        near(&points, &[[10.0, 21.0, 30.0], [9.0, 23.0, 30.0], [0.5, 0.25, -0.125]]);
        let attributes = points.attributes();
        let colors = [[255, 0, 0], [1, 2, 3], [0, 0, 0]];
        assert_eq!(attributes.colors("color").unwrap()[..], colors);
        let intensities = Attribute::Number(vec![0.25, 1.0, 0.75].into());
        assert_eq!(attributes.get("intensity"), Some(&intensities));
    }

    #[test]
    fn spherical_coordinates_are_places() {
        let points = read(SPHERICAL).unwrap();
        // 3 away, 0.5 about z and 0.25 down.
        let second = [2.5509019358766984, 1.3935640789167856, 0.2577881222364312];
        near(&points, &[[2.0, 0.0, 1.0], second]);
        assert_eq!(points.attributes().iter().count(), 0);
    }

    #[test]
    fn counts_are_checked_against_the_file() {
        let scans = E57Reader::new(Cursor::new(SCANS)).unwrap().pointclouds();
        fn error(change: fn(&mut PointCloud), scans: &[PointCloud]) -> String {
            let mut scans = scans.to_vec();
            change(&mut scans[0]);
            check(&scans, SCANS.len()).unwrap_err().to_string()
        }
        let told = error(|scan| scan.records = u64::MAX, &scans);
        assert!(told.contains("2 scans promise 18446744073709551616 points"), "{told}");
        let told = error(|scan| scan.prototype.clear(), &scans);
        assert!(
            told.starts_with("the points of scan 0 have 0 fields, of which 0 may differ"),
            "{told}"
        );
        let mut scans = scans.clone();
        scans[0].prototype.truncate(1);
        scans[0].prototype[0].data_type = RecordDataType::Integer { min: -1, max: 0 };
        scans[0].records = 1 << 29;
        let bytes = (1 << 26) + 64;
        let told = check(&scans, bytes).unwrap_err();
        assert_eq!(told, E57Error::TooMuch { points: (1 << 29) + 1, most: 32 * bytes });
    }

    #[test]
    fn files_that_lie_are_refused() {
        let told = read(&SCANS[..7000]).unwrap_err().to_string();
        assert!(told.contains("file size 7000 is not a multiple of the page size 1024"), "{told}");
        let mut file = SCANS.to_vec();
        file[DESCRIPTION].fill(255);
        assert!(matches!(read(&file), Err(E57Error::Description { found: 7168, .. })));
        let mut file = SCANS.to_vec();
        file[5000] ^= 1;
        let told = read(&file).unwrap_err().to_string();
        assert!(told.contains("Detected invalid checksum"), "{told}");
        let turn = e57::Quaternion { w: 0.0, x: 0.0, y: 0.5, z: 0.0 };
        let told = pose(3, Transform { rotation: turn, ..Transform::default() }).unwrap_err();
        assert_eq!(
            told.to_string(),
            "the pose of scan 3 turns by the quaternion [0.0, 0.0, 0.5, 0.0], whose length is not 1"
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
        assert_eq!(read(&file.into_inner()), Err(E57Error::Namespaces));
    }

    #[test]
    fn hostile_files_give_errors() {
        hostile::survive(SPHERICAL, read);
    }
}
