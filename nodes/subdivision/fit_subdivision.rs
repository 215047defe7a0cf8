//! Fits a subdivision surface to scattered points.

pub use fit::{FittedSubdivision, fit_subdivision};
pub use fit_subdivision_error::FitSubdivisionError;
use maquette_base::scattered::Scattered;
use maquette_node::{Carry, Context, Error, Fate, In, Node, Promise, Want};
use maquette_value::{Mesh, Trace};
pub use moves::{Prices, fit_by_moves};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

mod concave_corners;
mod equations;
mod feet;
mod fit;
mod fit_subdivision_error;
mod folds;
mod local;
mod moves;
mod net;
mod scan;
mod surroundings;

/// Moves the control points of a Loop subdivision surface until it is as near as possible to given points.
///
/// Start with `Simplify` of a dense mesh of the points. Creases and borders stay sharp, so that the surface is smooth piece by piece. With
/// `moves: ByEnergy()` the faces change, too: vertices go where the surface is simple and come where it is not, and edges become
/// sharp or smooth wherever the scan is; what is smooth around the corner of a hole is cut by a sharp edge, as it would fold. Points
/// whose nearest place is farther away than two edges of the control mesh are left out: they belong to parts that the mesh does not have.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct FitSubdivision {
    /// The control mesh to start with: triangles.
    pub mesh: In<Mesh>,
    /// What the surface is to be near: points, the cells of a range image, or the vertices of a mesh.
    pub points: In<Scattered>,
    /// Weight of smoothness beside nearness: more for noisy points.
    #[schemars(range(min = 0.0, max = 1000.0))]
    #[serde(default = "thousandth")]
    pub smoothing: f64,
    /// How often the nearest places are looked for anew.
    #[schemars(range(max = 1000))]
    #[serde(default = "six")]
    pub iterations: u32,
    /// What may change beside the places of control points.
    #[serde(default)]
    pub moves: Moves,
}

/// What may change beside the places of control points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Moves {
    /// Nothing: the control mesh keeps its faces and creases.
    #[default]
    Nothing,
    /// Edges are collapsed, split, swapped, made sharp and made smooth wherever that is worth its price. `points` must be a mesh, because
    /// what lies between points counts, too; the result has no attributes.
    ByEnergy(Prices),
}

fn thousandth() -> f64 {
    1e-3
}

fn six() -> u32 {
    6
}

impl Node for FitSubdivision {
    type Outputs = (Mesh, Trace);
    const OUTPUTS: [&'static str; 2] = ["mesh", "trace"];

    const WANTS: &'static [Want<Self>] = &[
        Want::new("mesh", "Manifold"),
        Want::new("mesh", "Oriented"),
        Want::new("mesh", "Unpinched"),
        Want::new("mesh", "Triangles"),
    ];

    const PROMISES: &'static [Promise<Self>] = &[
        Promise::always("mesh", "Triangles"),
        Promise::from("mesh", "Closed", "mesh")
            .when("without `moves`", |it| it.moves == Moves::Nothing),
        Promise::from("mesh", "Manifold", "mesh")
            .when("without `moves`", |it| it.moves == Moves::Nothing),
        Promise::from("mesh", "Oriented", "mesh")
            .when("without `moves`", |it| it.moves == Moves::Nothing),
        Promise::from("mesh", "Unpinched", "mesh")
            .when("without `moves`", |it| it.moves == Moves::Nothing),
    ];

    const CARRIES: &'static [Carry] = &[
        Carry::all("mesh", "mesh", Fate::Kept),
        Carry::all("points", "mesh", Fate::Dropped).and_cells(Fate::Dropped),
    ];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let (mesh, scattered) = (cx.get(&self.mesh), cx.get(&self.points));
        let points = match &scattered {
            Scattered::Points(points) => points.positions().to_vec(),
            Scattered::Mesh(mesh) => mesh.positions().to_vec(),
            Scattered::RangeImage(range) => {
                (0..range.points().len()).filter_map(|cell| range.point(cell)).collect()
            }
        };
        let Self { smoothing, iterations, .. } = *self;
        let fitted = match (self.moves, &scattered) {
            (Moves::Nothing, _) => {
                fit_subdivision(mesh, &points, smoothing, iterations, cx.progress())?
            }
            (Moves::ByEnergy(prices), Scattered::Mesh(scan)) => {
                if [mesh.vertex(), mesh.corner(), mesh.face()]
                    .iter()
                    .any(|all| all.iter().next().is_some())
                {
                    cx.warn("the attributes of the mesh are dropped: `moves` makes other faces");
                }
                fit_by_moves(mesh, scan, smoothing, iterations, prices, cx.progress())?
            }
            (Moves::ByEnergy(_), _) => return Err(FitSubdivisionError::NoSurface.into()),
        };
        if 0 < fitted.left_out {
            let (count, all) = (fitted.left_out, points.len());
            cx.warn(format!("{count} of {all} points are far from the mesh and were left out"));
        }
        Ok((fitted.mesh, fitted.trace))
    }
}

#[cfg(test)]
mod tests;
