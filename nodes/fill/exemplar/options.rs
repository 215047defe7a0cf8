//! How a surface is completed by exemplars.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How a surface is completed by exemplars.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ExemplarOptions {
    /// How many levels, from coarse to fine.
    #[schemars(range(min = 1, max = 8))]
    #[serde(default = "three")]
    pub levels: u32,
    /// The shape to start with.
    #[serde(default)]
    pub start: Start,
    /// How patches share in the motion of a vertex.
    #[serde(default)]
    pub update: Update,
    /// The radius of a patch on each level; chosen from the hole's width and the data's edges where 0 or left out.
    #[schemars(inner(range(min = 0.0)), extend("unit" = "mm"))]
    #[serde(default)]
    pub radii: Vec<f64>,
    /// How far the compared points of a patch are apart on each level, at least an eighth of its radius; chosen from the radii and the
    /// data's edges where 0 or left out. The last one is also the length of the filled edges.
    #[schemars(inner(range(min = 0.0)), extend("unit" = "mm"))]
    #[serde(default)]
    pub edges: Vec<f64>,
    /// How the weight of a patch falls with its distance from the hole's rim; if left out, 1.3 times from one compared point to the next, and
    /// with `update: Published`, whose start says nothing of the shape, 2 times.
    #[serde(default)]
    pub falloff: Option<Falloff>,
    /// The direction that is up: patches are compared upright. The length means nothing.
    #[schemars(extend("direction" = true))]
    #[serde(default = "up")]
    pub up: [f64; 3],
    /// How many rotations about its normal an exemplar is tried in; 1 tries it upright alone.
    #[schemars(range(min = 1, max = 32))]
    #[serde(default = "one")]
    pub rotations: u32,
    /// Tries each exemplar also mirrored: from left to right, if it is upright. What a thing has on both sides grows again from the other one
    /// if `exemplars` marks that, with `start: Flat`, as thin plates are trusted too much where a whole part is missing.
    #[serde(default)]
    pub mirror: bool,
    /// An attribute of the vertices: exemplars come from where it is greater than 0. Empty: from everywhere.
    #[serde(default)]
    pub exemplars: String,
    /// How much colors count beside shapes where exemplars are chosen: a color that is as far off as black is from white (100 in CIE76)
    /// counts as much as a surface that is so many edges of the data off; 0 lets shapes alone choose. Colors are those of the vertices, or
    /// of a picture that is copied.
    #[schemars(range(min = 0.0, max = 100.0))]
    #[serde(default = "color")]
    pub color: f64,
    /// What filled faces show of a picture, if texture coordinates are given for corners, as those of an atlas are.
    #[serde(default)]
    pub texture: Shown,
    /// Iterations of a level, at most; 0 leaves the start as it is, and looks for no exemplars. If left out, 20, and with
    /// `update: Published`, whose start may be far off, 400.
    #[schemars(range(max = 1000))]
    #[serde(default)]
    pub iterations: Option<u32>,
    /// A level ends after so many iterations that made it no better; its best iterate is kept. If left out, 3, and with
    /// `update: Published`, whose energy goes up and down on its way, 25.
    #[schemars(range(min = 1, max = 1000))]
    #[serde(default)]
    pub patience: Option<u32>,
}

impl ExemplarOptions {
    /// Whether colors count when exemplars are compared; in the publication they do not.
    pub(crate) fn counts_colors(&self) -> bool {
        self.color > 0.0 && self.update == Update::Exact
    }

    /// Iterations of a level, at most.
    pub(crate) fn most_iterations(&self) -> u32 {
        self.iterations.unwrap_or(match self.update {
            Update::Exact => 20,
            Update::Published => 400,
        })
    }

    /// Iterations without progress after which a level ends.
    pub(super) fn longest_wait(&self) -> u32 {
        let usual = match self.update {
            Update::Exact => 3,
            Update::Published => 25,
        };
        self.patience.unwrap_or(usual).max(1)
    }

    /// How weights fall.
    pub(super) fn fall(&self) -> Falloff {
        self.falloff.unwrap_or(match self.update {
            Update::Exact => Falloff::default(),
            // With 1.3, what the rim says counts too little against a start that is a cone; with 3, too few patches agree.
            Update::Published => Falloff { base: 2.0, rate: 0.0 },
        })
    }
}

fn color() -> f64 {
    3.0
}

fn one() -> u32 {
    1
}

fn three() -> u32 {
    3
}

fn up() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

impl Default for ExemplarOptions {
    fn default() -> Self {
        Self {
            levels: three(),
            start: Start::default(),
            update: Update::default(),
            radii: Vec::new(),
            edges: Vec::new(),
            falloff: None,
            up: up(),
            rotations: one(),
            mirror: false,
            exemplars: String::new(),
            color: color(),
            texture: Shown::default(),
            iterations: None,
            patience: None,
        }
    }
}

/// The shape that a completion starts with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Start {
    /// A thin plate that goes on smoothly from the rim. Creases of the data that end at the rim go on until they meet, and stay sharp, unless
    /// `update` is `Published`.
    #[default]
    ThinPlate,
    /// A cone over the rim's centroid, as published.
    Centroid,
    /// A membrane over the rim.
    Membrane,
    /// Flat triangles between the rim's vertices.
    Flat,
}

/// What filled faces show of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Shown {
    /// What it has where their shape comes from: a picture of a damaged thing shows the damage, too.
    #[default]
    Copied,
    /// What it has where it goes on from the rim: it may know what the shape lacks.
    Continued,
}

/// How patches share in the motion of a vertex.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Update {
    /// By their weights over their numbers of points, which makes the energy least while the normals stay; normals are means over
    /// a part of a patch, and only whole exemplars are used.
    #[default]
    Exact,
    /// By their weights, with the normals of vertices, with exemplars up to the rim, and with edges as long on each level as compared points
    /// are apart, as published; so it completes the cone of `start: Centroid`, too. Other than in the publication, an exemplar is laid against a
    /// patch by the best small shift and tilt, and the normals at the rim are those of the data alone.
    Published,
}

/// How a weight falls with the distance: `base ^ (-rate * distance)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Falloff {
    /// How many times less it is after `1 / rate`.
    #[schemars(range(min = 1.0, max = 1000.0))]
    #[serde(default = "base")]
    pub base: f64,
    /// How fast it falls, per mm; 0 takes one over the distance between compared points.
    #[schemars(range(min = 0.0), extend("unit" = "1/mm"))]
    #[serde(default)]
    pub rate: f64,
}

fn base() -> f64 {
    1.3
}

impl Default for Falloff {
    fn default() -> Self {
        Self { base: base(), rate: 0.0 }
    }
}
