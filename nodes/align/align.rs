//! Moves one scan onto another.

use maquette_mesh::Poses;
use maquette_node::{Carry, Context, Error, Fate, In, Node, Progress, Promise};
use maquette_scan::Scan;
use nalgebra::{Isometry3, Point3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::align_error::AlignError;
use super::alignment::{Alignment, PairFit};
use super::cloud::Cloud;
use super::fit::fit;
use super::moved::{frame_of, moved_scan};
use super::pairs::motion_of_given;
use super::place::{Start, finest, together};

/// Moves a scan onto another one of the same object, without changing its shape.
///
/// Both may be range images, points or meshes, whichever. What has moved lies in the axes of the other one, and knows its pose, if there is
/// one, so that `Merge` and `Reconstruct` take both together. (A range image that has moved does not know any more from where it was seen:
/// what `Reconstruct` shall have should be triangulated before.) How well they fit is told with `alignment`, by which `MoveAligned` moves other
/// things the same way.
///
/// In other programs: register, ICP.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Align {
    /// The scan that is moved: a range image, points or a mesh.
    pub mesh: In<Scan>,
    /// The scan that it is moved onto, which stays.
    pub to: In<Scan>,
    /// How its place is found.
    #[serde(default)]
    pub by: By,
}

/// How the place of a scan is found.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum By {
    /// Without any hint, by what the surfaces look like; then as by `Nearest`.
    #[default]
    Features,
    /// From where they lie: what is nearest belongs together.
    Nearest {
        /// How far apart what belongs together may be; 0 is a twentieth of the larger scan.
        #[schemars(range(min = 0.0), extend("unit" = "mm"))]
        #[serde(default)]
        reach: f64,
        /// Whether the search begins where the captures' poses bring them, if both are known.
        #[serde(default)]
        poses: Poses,
    },
    /// By points that were picked on both, and nothing else.
    Pairs {
        /// At least three, not on a line: a point of what is moved, and where it goes.
        #[schemars(length(min = 3), extend("unit" = "mm"))]
        pairs: Vec<[[f64; 3]; 2]>,
    },
}

impl Node for Align {
    type Outputs = (Scan, Alignment);
    const OUTPUTS: [&'static str; 2] = ["mesh", "alignment"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] = &[
        Carry::all("mesh", "mesh", Fate::Kept).and_cells(Fate::Kept),
        Carry::all("to", "mesh", Fate::Dropped).and_cells(Fate::Dropped),
    ];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let (scan, to) = (cx.get(&self.mesh), cx.get(&self.to));
        let alignment = align(&scan, &to, &self.by, &|doubt| cx.warn(doubt), cx.progress())?;
        let motion = alignment.motion(2).expect("there are two scans");
        let moved = moved_scan(&scan, &motion, alignment.frame().as_ref());
        Ok((moved.map_err(AlignError::from)?, alignment))
    }
}

/// How a scan comes onto another one, which is the first of the alignment. Doubts about it are told to `doubt`.
///
/// # Errors
/// If one has too few points, they do not fit, or the pairs fix no motion or contradict each other.
pub fn align(
    scan: &Scan,
    to: &Scan,
    by: &By,
    doubt: &dyn Fn(String),
    progress: &Progress<'_>,
) -> Result<Alignment, AlignError> {
    let scans = [to, scan];
    let clouds = Cloud::of_all(&scans)?;
    let frame = frame_of(to);
    let start = match by {
        By::Features => Start::by_features(&clouds, &[[0, 1]], &|_, _| true, progress)?,
        By::Nearest { reach, poses } => Start::known(&scans, &clouds, *poses, *reach)?,
        By::Pairs { pairs } => {
            let pairs: Vec<_> = pairs.iter().map(|pair| pair.map(Point3::from)).collect();
            let (motion, off) = motion_of_given(&pairs)?;
            let [to, scan] = [0, 1].map(|k| clouds[k].sampled(finest(&clouds[k])));
            let fit = fit([&to, &scan], &motion.inverse());
            let told = PairFit {
                scans: [1, 2],
                overlap: [0, 1].map(|side| fit.share(side)),
                matches: pairs.len() as u32,
                plane: off,
                point: off,
            };
            let motions = [Isometry3::identity(), motion].map(|motion| motion.to_homogeneous());
            return Ok(Alignment::new(&motions, vec![told], frame.as_ref())?);
        }
    };
    together(&clouds, start, frame.as_ref(), doubt, progress)
}
