//! Registers several scans together.

use maquette_mesh::{Poses, merge};
use maquette_node::{Carry, Context, Error, In, Limit, Node, Progress, Transfer, bail};
use maquette_range::{GRAZING, JUMP, triangulate};
use maquette_scan::Scan;
use maquette_value::{Faces, Mesh};
use nalgebra::{Isometry3, Point3, Unit, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::alignment::Alignment;
use super::cloud::Cloud;
use super::motion::{frame_of, move_scan};
use super::registration::{Start, align_from, all_pairs};

/// Registers several scans of one object simultaneously. The first one stays.
///
/// All overlapping pairs count at the same time, so that errors do not accumulate from scan to scan and a loop of scans closes. The result
/// is one mesh with the faces of all scans, as from `Merge`; `Reconstruct` makes one surface of it. `MoveAligned` moves the scans
/// themselves, or data that belongs to them, by `alignment`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct AlignAll {
    /// Scans: range images, points or meshes. Each must overlap the first one, directly or through other scans.
    #[schemars(extend("least" = 1))]
    pub scans: Vec<In<Scan>>,
    /// Method of finding the motions.
    #[serde(default)]
    pub by: Search,
}

/// A method of finding the motions of several scans.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Search {
    /// Compares local features of the surfaces of all pairs, without any hint.
    #[default]
    Features,
    /// As `Features`, but only for consecutive scans, and the last with the first: for many scans in the order of their capture.
    Neighbors,
    /// Starts at the current positions and matches nearest points.
    Nearest {
        /// Maximum distance of corresponding points at the start; 0 stands for a twentieth of the largest scan.
        #[schemars(range(min = 0.0), extend("unit" = "mm"))]
        #[serde(default)]
        reach: f64,
        /// Use of the captures' poses as start.
        #[serde(default)]
        poses: Poses,
    },
    /// Scans of an object on a turntable in front of a fixed scanner, rotated by a constant angle between scans.
    Turntable(Turntable),
}

/// The geometry of a turntable.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Turntable {
    /// Rotation that brings each scan onto the previous one.
    #[schemars(range(min = -180.0, max = 180.0), extend("unit" = "deg"))]
    pub angle: f64,
    /// Direction of the axis; the angle is counter-clockwise as seen against it. If omitted, the axis is found by features of the surfaces,
    /// and the sign of the angle is ignored.
    #[schemars(extend("direction" = true))]
    #[serde(default)]
    pub axis: Option<[f64; 3]>,
    /// Point on the axis.
    #[schemars(extend("unit" = "mm"))]
    #[serde(default)]
    pub through: [f64; 3],
    /// Maximum distance of corresponding points at the start, which depends on the errors of angle and axis; 0 stands for a twentieth of
    /// the largest scan.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default)]
    pub reach: f64,
}

/// If no axis is given: the maximum deviation of the rotation between two scans from the expected angle, in degrees.
const ANGLE_TOLERANCE: f64 = 10.0;

/// The maximum number of scans. It is limited because all pairs are compared.
const SCANS: Limit = Limit { max: 100, items: "scans", help: "align fewer at once" };

impl Node for AlignAll {
    type Outputs = (Mesh, Alignment);
    const OUTPUTS: [&'static str; 2] = ["mesh", "alignment"];

    const CARRIES: &'static [Carry] =
        &[Carry::uniform("scans", "mesh", Transfer::Kept).and_cells(Transfer::Kept)];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let scans: Vec<_> = self.scans.iter().map(|scan| cx.get(scan)).collect();
        let scans = scans.iter().collect::<Vec<_>>();
        let alignment = align_all(&scans, &self.by, &|warning| cx.warn(warning), cx.progress())?;
        Ok((merge_scans(&scans, &alignment)?, alignment))
    }
}

/// Computes the motions of all scans; the first scan does not move. Calls `warn` if the result is doubtful.
///
/// # Errors
/// If there are fewer than two scans, a scan has too few points, or a scan fits none of the others.
pub fn align_all(
    scans: &[&Scan],
    by: &Search,
    warn: &dyn Fn(String),
    progress: &Progress<'_>,
) -> Result<Alignment, Error> {
    if scans.len() < 2 {
        bail!("expected at least 2 scans, found {}", scans.len());
    }
    SCANS.check("the alignment", scans.len() as f64)?;
    let (clouds, origin) = Cloud::from_scans(scans)?;
    let count = scans.len();
    fn neighbors(count: usize) -> Vec<[usize; 2]> {
        let mut pairs: Vec<_> = (1..count).map(|scan| [scan - 1, scan]).collect();
        pairs.extend((2 < count).then_some([0, count - 1]));
        pairs
    }
    let start = progress.part(0.0..0.7, |progress| match by {
        Search::Features => Start::by_features(&clouds, &all_pairs(count), &|_, _| true, progress),
        Search::Neighbors => Start::by_features(&clouds, &neighbors(count), &|_, _| true, progress),
        Search::Nearest { reach, poses } => {
            Start::from_positions(scans, (&clouds, origin), *poses, *reach)
        }
        Search::Turntable(table) => match table.poses(count)? {
            Some(poses) => {
                let known =
                    Start::from_positions(scans, (&clouds, origin), Poses::Ignore, table.reach)?;
                let poses = poses.iter().map(|pose| origin.localize_motion(pose)).collect();
                Ok(Start { poses, ..known })
            }
            None => Start::by_features(
                &clouds,
                &neighbors(count),
                &|pair, motion| table.allows(pair, motion),
                progress,
            ),
        },
    })?;
    let frame = frame_of(scans[0]);
    progress.part(0.7..1.0, |progress| {
        align_from((&clouds, origin), start, frame.as_ref(), warn, progress)
    })
}

impl Turntable {
    /// Returns the start pose of each of `count` scans, computed from the turntable's axis and angle; `None` if no axis is given.
    fn poses(&self, count: usize) -> Result<Option<Vec<Isometry3<f64>>>, Error> {
        if !(-180.0..=180.0).contains(&self.angle) {
            bail!("`angle` is {}, expected from -180 to 180 degrees", self.angle);
        }
        let Some(axis) = self.axis else { return Ok(None) };
        let length = Vector3::from(axis).norm();
        let Some(axis) = Unit::try_new(Vector3::from(axis), 1e-9).filter(|_| length.is_finite())
        else {
            bail!("`length of the axis` is {length}, expected greater than 0");
        };
        if let Some(value) = self.through.into_iter().find(|x| !x.is_finite()) {
            bail!("`through` is {value}, expected finite");
        }
        Ok(Some(
            (0..count)
                .map(|scan: usize| {
                    let rotation = UnitQuaternion::from_axis_angle(
                        &axis,
                        (self.angle * scan as f64).to_radians(),
                    );
                    Isometry3::rotation_wrt_point(rotation, Point3::from(self.through))
                })
                .collect(),
        ))
    }

    /// Returns true if the angle of a motion between two scans is the turntable's rotation between them, within `ANGLE_TOLERANCE` degrees.
    fn allows(&self, [from, to]: [usize; 2], motion: &Isometry3<f64>) -> bool {
        let angle = self.angle * (from as f64 - to as f64);
        // Reduce the expected angle to the range from -180 to 180 degrees; only its absolute value is compared.
        let angle = (angle + 180.0).rem_euclid(360.0) - 180.0;
        (motion.rotation.angle().to_degrees() - angle.abs()).abs() <= ANGLE_TOLERANCE
    }
}

/// Merges all scans at their aligned positions into one mesh.
fn merge_scans(scans: &[&Scan], alignment: &Alignment) -> Result<Mesh, Error> {
    let frame = alignment.frame();
    let meshes = scans.iter().zip(1..).map(|(scan, number)| {
        let motion = alignment.motion(number).expect("a motion for each scan");
        Ok(match move_scan(&Scan::Mesh(to_mesh(scan)?), &motion, frame.as_ref())? {
            Scan::Mesh(mesh) => mesh,
            other => unreachable!("a mesh became {other:?}"),
        })
    });
    let meshes = meshes.collect::<Result<Vec<_>, Error>>()?;
    merge(&meshes.iter().collect::<Vec<_>>(), Poses::Ignore)
}

/// Converts a scan to a mesh: a range image as `Triangulate` does, points to vertices without faces.
fn to_mesh(scan: &Scan) -> Result<Mesh, Error> {
    Ok(match scan {
        Scan::Mesh(mesh) => mesh.clone(),
        Scan::RangeImage(range) => triangulate(range, JUMP, GRAZING, 20)?,
        Scan::Points(points) => {
            let mesh = Mesh::new(points.positions().clone(), Faces::triangles(Vec::new()))?;
            let attributes = points.attributes().iter();
            attributes.into_iter().try_fold(mesh, |mesh, (name, attribute)| {
                mesh.with_vertex(name, attribute.clone())
            })?
        }
    })
}
