//! Registers one scan onto another.

use maquette_mesh::Poses;
use maquette_node::{Carry, Context, Error, In, Node, Progress, Promise, Transfer};
use maquette_scan::Scan;
use nalgebra::Isometry3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::alignment::{Alignment, PairFit};
use super::cloud::Cloud;
use super::fit::fit;
use super::motion::{frame_of, move_scan};
use super::pairs::fit_picked_pairs;
use super::registration::{Start, align_from, min_sampling_edge};

/// Registers a scan onto another scan of the same object by a rigid motion.
///
/// Each may be a range image, points or a mesh. The result is in the axes of the other scan and has its pose, if there is one, so that
/// `Merge` and `Reconstruct` accept both together. (A moved range image loses the position of its sensor: triangulate it first if it is for
/// `Reconstruct`.) The output `alignment` has the quality of the fit, and lets `MoveAligned` move other data the same way.
///
/// In other programs: register, ICP.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Align {
    /// Scan to move: a range image, points or a mesh.
    pub mesh: In<Scan>,
    /// Scan that stays.
    pub to: In<Scan>,
    /// Method of finding the motion.
    #[serde(default)]
    pub by: AlignMethod,
}

/// A method of finding the motion of a scan.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename = "By")]
pub enum AlignMethod {
    /// Compares local features of the surfaces, without any hint; then refines as `Nearest`.
    #[default]
    Features,
    /// Starts at the current positions and matches nearest points.
    Nearest {
        /// Maximum distance of corresponding points at the start; 0 stands for a twentieth of the larger scan.
        #[schemars(range(min = 0.0), extend("unit" = "mm"))]
        #[serde(default)]
        reach: f64,
        /// Use of the captures' poses as start.
        #[serde(default)]
        poses: Poses,
    },
    /// Uses only points that were picked on both scans.
    Pairs {
        /// At least three pairs, not on a line: a point of the moved scan and its target.
        #[schemars(length(min = 3), extend("unit" = "mm"))]
        pairs: Vec<[[f64; 3]; 2]>,
    },
}

impl Node for Align {
    type Outputs = (Scan, Alignment);
    const OUTPUTS: [&'static str; 2] = ["mesh", "alignment"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] = &[
        Carry::uniform("mesh", "mesh", Transfer::Kept).and_cells(Transfer::Kept),
        Carry::uniform("to", "mesh", Transfer::Dropped).and_cells(Transfer::Dropped),
    ];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let (scan, to) = (cx.get(&self.mesh), cx.get(&self.to));
        let alignment = align(&scan, &to, &self.by, &|warning| cx.warn(warning), cx.progress())?;
        let motion = alignment.motion(2).expect("there are two scans");
        let moved = move_scan(&scan, &motion, alignment.frame().as_ref())?;
        Ok((moved, alignment))
    }
}

/// Computes the motion of a scan onto the scan `to`, which becomes the first scan of the alignment. Calls `warn` if the result is doubtful.
///
/// # Errors
/// If a scan has too few points, the scans do not fit, or the pairs do not determine a motion or contradict each other.
pub fn align(
    scan: &Scan,
    to: &Scan,
    by: &AlignMethod,
    warn: &dyn Fn(String),
    progress: &Progress<'_>,
) -> Result<Alignment, Error> {
    let scans = [to, scan];
    let (clouds, origin) = Cloud::from_scans(&scans)?;
    let frame = frame_of(to);
    let start = match by {
        AlignMethod::Features => Start::by_features(&clouds, &[[0, 1]], &|_, _| true, progress)?,
        AlignMethod::Nearest { reach, poses } => {
            Start::from_positions(&scans, (&clouds, origin), *poses, *reach)?
        }
        AlignMethod::Pairs { pairs } => {
            let pairs: Vec<_> =
                pairs.iter().map(|pair| pair.map(|it| origin.localize(&it.into()))).collect();
            let (motion, off) = fit_picked_pairs(&pairs)?;
            let [to, scan] = [0, 1].map(|k| clouds[k].sample(min_sampling_edge(&clouds[k])));
            let fit = fit([&to, &scan], &motion.inverse());
            let pair_fit = PairFit {
                scans: [1, 2],
                overlap: [0, 1].map(|side| fit.overlap(side)),
                matches: pairs.len() as u32,
                plane: off,
                point: off,
            };
            let motions = [Isometry3::identity(), origin.globalize_motion(&motion)]
                .map(|motion| motion.to_homogeneous());
            return Alignment::new(&motions, vec![pair_fit], frame.as_ref());
        }
    };
    align_from((&clouds, origin), start, frame.as_ref(), warn, progress)
}
