//! What a hole is filled with.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::exemplar::{ExemplarOptions, Falloff, Start, Update};

/// What a hole is filled with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum FillMethod {
    /// The shapes of other parts of the mesh, from coarse to fine.
    Exemplar {
        /// How many levels, from coarse to fine.
        #[schemars(range(min = 1, max = 8))]
        #[serde(default = "three")]
        levels: u32,
        /// The shape to start with.
        #[serde(default)]
        start: Start,
        /// How patches share in the motion of a vertex.
        #[serde(default)]
        update: Update,
        /// The radius of a patch on each level; chosen from the hole's width and the data's edges where 0 or left out.
        #[schemars(extend("unit" = "mm"))]
        #[serde(default)]
        radii: Vec<f64>,
        /// How far the compared points of a patch are apart on each level, at least an eighth of its radius; chosen from the radii and
        /// the data's edges where 0 or left out. The last one is also the length of the filled edges.
        #[schemars(extend("unit" = "mm"))]
        #[serde(default)]
        edges: Vec<f64>,
        /// How the weight of a patch falls with its distance from the hole's rim.
        #[serde(default)]
        falloff: Falloff,
        /// The direction that is up: patches are compared upright. The length means nothing.
        #[serde(default = "up")]
        up: [f64; 3],
        /// How many rotations about its normal an exemplar is tried in; 1 tries it upright alone.
        #[schemars(range(min = 1, max = 32))]
        #[serde(default = "one")]
        rotations: u32,
        /// Tries each exemplar also mirrored.
        #[serde(default)]
        mirror: bool,
        /// An attribute of the vertices: exemplars come from where it is greater than 0. Empty: from everywhere.
        #[serde(default)]
        exemplars: String,
        /// Iterations of a level, at most; 0 leaves the start as it is.
        #[schemars(range(max = 1000))]
        #[serde(default = "twenty")]
        iterations: u32,
        /// A level ends after so many iterations that made it no better; its best iterate is kept.
        #[schemars(range(min = 1, max = 1000))]
        #[serde(default = "three")]
        patience: u32,
    },
    /// The surface that bends least and goes on as the data ends.
    ThinPlate,
    /// The smallest surface: it meets the data at an angle.
    Membrane,
    /// Flat triangles from rim to rim.
    Flat,
    /// As `ThinPlate`, but the smooth parts of the data that meet in creases at the rim go on until they meet: the creases stay sharp.
    CreaseAware,
}

fn one() -> u32 {
    1
}

fn three() -> u32 {
    3
}

fn twenty() -> u32 {
    20
}

fn up() -> [f64; 3] {
    ExemplarOptions::default().up
}

impl Default for FillMethod {
    fn default() -> Self {
        ExemplarOptions::default().into()
    }
}

impl From<ExemplarOptions> for FillMethod {
    fn from(options: ExemplarOptions) -> Self {
        let ExemplarOptions {
            levels,
            start,
            update,
            radii,
            edges,
            falloff,
            up,
            rotations,
            mirror,
            exemplars,
            iterations,
            patience,
        } = options;
        Self::Exemplar {
            levels,
            start,
            update,
            radii,
            edges,
            falloff,
            up,
            rotations,
            mirror,
            exemplars,
            iterations,
            patience,
        }
    }
}

impl FillMethod {
    /// How exemplars are found and put together, if they are.
    pub fn exemplar(&self) -> Option<ExemplarOptions> {
        let Self::Exemplar {
            levels,
            start,
            update,
            radii,
            edges,
            falloff,
            up,
            rotations,
            mirror,
            exemplars,
            iterations,
            patience,
        } = self.clone()
        else {
            return None;
        };
        Some(ExemplarOptions {
            levels,
            start,
            update,
            radii,
            edges,
            falloff,
            up,
            rotations,
            mirror,
            exemplars,
            iterations,
            patience,
        })
    }
}
