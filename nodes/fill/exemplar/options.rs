//! The options for filling holes with exemplars: parts of the input surface that are copied.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Options for completing a surface with exemplars: parts of the data similar to the surroundings of the hole.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ExemplarOptions {
    /// Number of levels, from coarse to fine.
    #[schemars(range(min = 1, max = 8))]
    #[serde(default = "default_levels")]
    pub levels: u32,
    /// Initial shape.
    #[serde(default)]
    pub start: Start,
    /// Rule by which patches move the vertices they contain.
    #[serde(default)]
    pub update: Update,
    /// Patch radius on each level. If 0 or omitted, it is chosen from the hole's width and the data's edge length. If the data around the
    /// hole are a relief that repeats regularly, the largest radius is twice its wavelength, and there are as many levels as needed.
    #[schemars(inner(range(min = 0.0)), extend("unit" = "mm"))]
    #[serde(default)]
    pub radii: Vec<f64>,
    /// Distance between the compared points of a patch on each level, at least 1/8 of the patch radius. If 0 or omitted, it is chosen from
    /// the radii and the data's edge length. The last value is also the length of the filled edges.
    #[schemars(inner(range(min = 0.0)), extend("unit" = "mm"))]
    #[serde(default)]
    pub edges: Vec<f64>,
    /// Falloff of a patch's weight with its distance from the hole's rim. If omitted, the weight falls by a factor of 1.3 per distance
    /// between compared points; with `update: Published`, whose start does not estimate the shape, by a factor of 2.
    #[serde(default)]
    pub falloff: Option<Falloff>,
    /// Up direction; patches are compared upright. Its length is ignored.
    #[schemars(extend("direction" = true))]
    #[serde(default = "default_up")]
    pub up: [f64; 3],
    /// Number of rotations about its normal in which an exemplar is tried; 1 tries it upright only. If omitted, 12 if the data have no
    /// upward direction and rotated exemplars are clearly more similar, otherwise 1; with `update: Published`, 1.
    #[schemars(range(min = 1, max = 32))]
    #[serde(default)]
    pub rotations: Option<u32>,
    /// Tries each exemplar also mirrored, left to right if it is upright. Mirroring restores a part of a symmetric object from the other
    /// side: let `exemplars` mark that side and use `start: Flat`, because thin plates are trusted too much if a whole part is missing.
    #[serde(default)]
    pub mirror: bool,
    /// Name of a vertex attribute; exemplars are taken only from where it is greater than 0. If empty, exemplars are taken from everywhere.
    #[serde(default)]
    pub exemplars: String,
    /// Weight of colors relative to shapes when exemplars are chosen: the color difference of black and white (100 in CIE76) counts as much
    /// as a surface distance of this number of the data's edge lengths. With 0, only shapes are compared. Colors are those of the vertices,
    /// or of a picture that is copied.
    #[schemars(range(min = 0.0, max = 100.0))]
    #[serde(default = "default_color")]
    pub color: f64,
    /// Part of a picture that filled faces show if texture coordinates are stored per corner, as in an atlas.
    #[serde(default)]
    pub texture: TextureSource,
    /// Maximum number of iterations per level. With 0, the start is returned and no exemplars are searched. If omitted, 20; with `update:
    /// Published`, whose start may be far from the result, 400.
    #[schemars(range(max = 1000))]
    #[serde(default)]
    pub iterations: Option<u32>,
    /// Number of iterations after which a level ends if each of them improves the best one by less than 3 %; the best is kept. Iterates are
    /// compared by their energy; with `update: Published`, the bends at the seam are added, as far as they exceed those around the hole:
    /// the mean square of the height by which the fill leaves the surface at the rim within an edge length. If omitted, 3; with `update:
    /// Published`, whose energy oscillates, 25.
    #[schemars(range(min = 1, max = 1000))]
    #[serde(default)]
    pub patience: Option<u32>,
}

impl ExemplarOptions {
    /// Returns true if colors are compared. [`Update::Published`] does not compare colors.
    pub(crate) fn counts_colors(&self) -> bool {
        self.color > 0.0 && self.update == Update::Exact
    }

    /// Returns the maximum number of iterations per level.
    pub(crate) fn max_iterations(&self) -> u32 {
        self.iterations.unwrap_or(match self.update {
            Update::Exact => 20,
            Update::Published => 400,
        })
    }

    /// Returns the number of iterations without progress after which a level ends.
    pub(super) fn max_wait(&self) -> u32 {
        let usual = match self.update {
            Update::Exact => 3,
            Update::Published => 25,
        };
        self.patience.unwrap_or(usual).max(1)
    }

    /// Returns the falloff of weights that the user chose, or otherwise the default falloff for the chosen `update`.
    pub(super) fn falloff_or_default(&self) -> Falloff {
        self.falloff.unwrap_or(match self.update {
            Update::Exact => Falloff::default(),
            // With base 1.3 instead of 2, the rims have too little influence against an initial fill that is a cone; with 3, too few
            // patches agree.
            Update::Published => Falloff { base: 2.0, rate: 0.0 },
        })
    }
}

fn default_color() -> f64 {
    3.0
}

fn default_levels() -> u32 {
    3
}

fn default_up() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

impl Default for ExemplarOptions {
    fn default() -> Self {
        Self {
            levels: default_levels(),
            start: Start::default(),
            update: Update::default(),
            radii: Vec::new(),
            edges: Vec::new(),
            falloff: None,
            up: default_up(),
            rotations: None,
            mirror: false,
            exemplars: String::new(),
            color: default_color(),
            texture: TextureSource::default(),
            iterations: None,
            patience: None,
        }
    }
}

/// Initial shape of a completion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Start {
    /// Thin plate that continues the data smoothly. Creases of the data that end at the rim, also curved ones, are extended until they meet
    /// and stay sharp, unless `update` is `Published`.
    #[default]
    ThinPlate,
    /// Cone to the rim's centroid, as published.
    Centroid,
    /// Membrane through the rim.
    Membrane,
    /// Flat triangles between rim vertices.
    Flat,
}

/// Part of a picture that filled faces show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename = "Shown")]
pub enum TextureSource {
    /// The part at the exemplar that the face copies. A picture of a damaged object shows the damage, too.
    #[default]
    Copied,
    /// The part that continues from the rim. It may show features that the filled shape lacks.
    Continued,
}

/// Rule by which patches move the vertices they contain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Update {
    /// Patches count by their weights divided by their numbers of points, which minimizes the energy for fixed normals. Normals are means
    /// over a part of a patch, and only complete exemplars are used.
    #[default]
    Exact,
    /// As published: patches count by their weights, normals are those of vertices, exemplars may reach the rim, and filled edges are on
    /// each level as long as the distance between compared points; this also completes the cone of `start: Centroid`. Unlike in the
    /// publication, an exemplar is aligned with a patch by the best small shift and tilt, normals at the rim are those of the data only,
    /// and where the surroundings of a hole are smooth, the iteration ends with a thin plate: the mean of many exemplars has dimples.
    Published,
}

/// Falloff of a weight with the distance: `base ^ (-rate * distance)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Falloff {
    /// Factor by which the weight falls over a distance of `1 / rate`.
    #[schemars(range(min = 1.0, max = 1000.0))]
    #[serde(default = "default_base")]
    pub base: f64,
    /// Rate of the falloff. If 0, it is one over the distance between compared points.
    #[schemars(range(min = 0.0), extend("unit" = "1/mm"))]
    #[serde(default)]
    pub rate: f64,
}

fn default_base() -> f64 {
    1.3
}

impl Default for Falloff {
    fn default() -> Self {
        Self { base: default_base(), rate: 0.0 }
    }
}
