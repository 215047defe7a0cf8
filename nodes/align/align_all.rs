//! Brings several scans together.

use maquette_mesh::{Poses, merge};
use maquette_node::{Carry, Context, Error, Fate, In, Limit, Node, Progress};
use maquette_range::{GRAZING, JUMP, triangulate};
use maquette_scan::Scan;
use maquette_value::{Faces, Mesh};
use nalgebra::{Isometry3, Point3, Unit, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::align_error::AlignError;
use super::alignment::Alignment;
use super::cloud::Cloud;
use super::moved::{frame_of, moved_scan};
use super::place::{Start, all_pairs, together};

/// Brings several scans of one object together, all at once: the first one stays.
///
/// Errors are not handed on from scan to scan: all pairs that overlap pull at the same time, so that a round of scans closes. The result is
/// one mesh with the faces of all, as `Merge` makes it, of which `Reconstruct` makes one skin. `MoveAligned` moves the scans themselves, or
/// what belongs to them, by `alignment`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct AlignAll {
    /// The scans: range images, points or meshes. A scan need not overlap the first one, if others lie between.
    #[schemars(extend("least" = 1))]
    pub scans: Vec<In<Scan>>,
    /// How their places are found.
    #[serde(default)]
    pub by: Search,
}

/// How the places of several scans are found.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Search {
    /// Without any hint, by what the surfaces look like: each is tried on each.
    #[default]
    Features,
    /// The same, but each is tried only on the one before, and the last one on the first: for many scans in the order in which they were
    /// taken.
    Neighbors,
    /// From where they lie: what is nearest belongs together.
    Nearest {
        /// How far apart what belongs together may be; 0 is a twentieth of the largest scan.
        #[schemars(range(min = 0.0), extend("unit" = "mm"))]
        #[serde(default)]
        reach: f64,
        /// Whether the search begins where the captures' poses bring them, if all are known.
        #[serde(default)]
        poses: Poses,
    },
    /// As they come from a turntable, which was turned by the same angle between one scan and the next, in front of a scanner that stood still.
    Turntable(Turntable),
}

/// A turntable.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Turntable {
    /// By which angle each scan must be turned to lie on the one before.
    #[schemars(range(min = -180.0, max = 180.0), extend("unit" = "deg"))]
    pub angle: f64,
    /// The direction of the axis, against which the angle is counter-clockwise; if it is left out, the axis is found by what the surfaces
    /// look like, and the angle counts to either side.
    #[schemars(extend("direction" = true))]
    #[serde(default)]
    pub axis: Option<[f64; 3]>,
    /// A place on the axis.
    #[schemars(extend("unit" = "mm"))]
    #[serde(default)]
    pub through: [f64; 3],
    /// How far off the angle and the axis may be: how far apart what belongs together may be; 0 is a twentieth of the largest scan.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default)]
    pub reach: f64,
}

/// Without an axis a pair may be turned by so much more or less than it should be, in degrees.
const SLACK: f64 = 10.0;

/// Scans of one alignment: all pairs are looked at.
const SCANS: Limit = Limit { most: 100, of: "scans", help: "align fewer at once" };

impl Node for AlignAll {
    type Outputs = (Mesh, Alignment);
    const OUTPUTS: [&'static str; 2] = ["mesh", "alignment"];

    const CARRIES: &'static [Carry] =
        &[Carry::all("scans", "mesh", Fate::Kept).and_cells(Fate::Kept)];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let scans: Vec<_> = self.scans.iter().map(|scan| cx.get(scan)).collect();
        let scans = Vec::from_iter(&scans);
        let alignment = align_all(&scans, &self.by, &|doubt| cx.warn(doubt), cx.progress())?;
        Ok((merged(&scans, &alignment)?, alignment))
    }
}

/// How scans come together; the first one stays. Doubts about it are told to `doubt`.
///
/// # Errors
/// If there are fewer than two, one has too few points, or one fits none of the others.
pub fn align_all(
    scans: &[&Scan],
    by: &Search,
    doubt: &dyn Fn(String),
    progress: &Progress<'_>,
) -> Result<Alignment, AlignError> {
    if scans.len() < 2 {
        return Err(AlignError::TooFewScans { count: scans.len() });
    }
    SCANS.check("the alignment", scans.len() as f64)?;
    let clouds = Cloud::of_all(scans)?;
    let count = scans.len();
    fn neighbors(count: usize) -> Vec<[usize; 2]> {
        let mut pairs: Vec<_> = (1..count).map(|scan| [scan - 1, scan]).collect();
        pairs.extend((2 < count).then_some([0, count - 1]));
        pairs
    }
    let search = |progress: &Progress<'_>| match by {
        Search::Features => Start::by_features(&clouds, &all_pairs(count), &|_, _| true, progress),
        Search::Neighbors => Start::by_features(&clouds, &neighbors(count), &|_, _| true, progress),
        Search::Nearest { reach, poses } => Start::known(scans, &clouds, *poses, *reach),
        Search::Turntable(table) => match table.poses(count)? {
            Some(poses) => {
                let known = Start::known(scans, &clouds, Poses::Ignore, table.reach)?;
                Ok(Start { poses, ..known })
            }
            None => Start::by_features(
                &clouds,
                &neighbors(count),
                &|pair, motion| table.allows(pair, motion),
                progress,
            ),
        },
    };
    let start = progress.part(0.0..0.7, search)?;
    let frame = frame_of(scans[0]);
    progress.part(0.7..1.0, |progress| together(&clouds, start, frame.as_ref(), doubt, progress))
}

impl Turntable {
    /// Where the scans are, if the axis is known.
    fn poses(&self, count: usize) -> Result<Option<Vec<Isometry3<f64>>>, AlignError> {
        fn wrong(
            what: &'static str,
            value: f64,
            must: &'static str,
        ) -> Result<Option<Vec<Isometry3<f64>>>, AlignError> {
            Err(AlignError::Parameter { what, value, must })
        }
        if !(-180.0..=180.0).contains(&self.angle) {
            return wrong("angle", self.angle, "from -180 to 180 degrees");
        }
        let Some(axis) = self.axis else { return Ok(None) };
        let length = Vector3::from(axis).norm();
        let Some(axis) = Unit::try_new(Vector3::from(axis), 1e-9).filter(|_| length.is_finite())
        else {
            return wrong("length of the axis", length, "greater than 0");
        };
        if let Some(value) = self.through.into_iter().find(|x| !x.is_finite()) {
            return wrong("through", value, "finite");
        }
        Ok(Some(
            (0..count)
                .map(|scan: usize| {
                    let turn = UnitQuaternion::from_axis_angle(
                        &axis,
                        (self.angle * scan as f64).to_radians(),
                    );
                    Isometry3::rotation_wrt_point(turn, Point3::from(self.through))
                })
                .collect(),
        ))
    }

    /// Whether a pair is turned as it should be.
    fn allows(&self, [from, to]: [usize; 2], motion: &Isometry3<f64>) -> bool {
        let angle = self.angle * (from as f64 - to as f64);
        // From 0 to 180 degrees, to either side.
        let angle = (angle + 180.0).rem_euclid(360.0) - 180.0;
        (motion.rotation.angle().to_degrees() - angle.abs()).abs() <= SLACK
    }
}

/// One mesh of all scans where they lie now.
fn merged(scans: &[&Scan], alignment: &Alignment) -> Result<Mesh, AlignError> {
    let frame = alignment.frame();
    let meshes = scans.iter().zip(1..).map(|(scan, number)| {
        let motion = alignment.motion(number).expect("a motion for each scan");
        Ok(match moved_scan(&Scan::Mesh(mesh_of(scan)?), &motion, frame.as_ref())? {
            Scan::Mesh(mesh) => mesh,
            other => unreachable!("a mesh became {other:?}"),
        })
    });
    let meshes = meshes.collect::<Result<Vec<_>, AlignError>>()?;
    Ok(merge(&Vec::from_iter(&meshes), Poses::Ignore)?)
}

/// A range image as `Triangulate` makes a mesh of it; points as vertices without faces.
fn mesh_of(scan: &Scan) -> Result<Mesh, AlignError> {
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
