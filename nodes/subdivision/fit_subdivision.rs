//! Fitting of a subdivision surface to scattered points.

pub use fit::{FittedSubdivision, fit_subdivision};
use maquette_base::scattered::Scattered;
use maquette_node::{Carry, Context, Error, In, Node, Promise, Transfer, Want, bail};
use maquette_value::{Mesh, Trace};
use moves::NO_SURFACE;
pub use moves::{Prices, fit_by_moves};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

mod concave_corners;
mod equations;
mod feet;
mod fit;
mod folds;
mod local;
mod moves;
mod net;
mod scan;
mod stiffness;
mod surroundings;

/// Fits a Loop subdivision surface to points by moving its control points.
///
/// Start with a dense mesh of the points, reduced by `Simplify` or, with even triangles, by `Remesh`. Smoothing acts across the surface
/// only. Where the surface would fold over, it keeps the shape of its start. Creases and borders stay
/// sharp, so that the surface is piecewise smooth. With `moves: ByEnergy()` the faces change, too: vertices are removed where the surface
/// is simple and added where it is not, edges become sharp or smooth as the scan requires, and a smooth part that would fold at the corner
/// of a hole is divided by a sharp edge. Points farther from the mesh than two edges of the control mesh are ignored: they belong to parts
/// that the mesh does not have.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct FitSubdivision {
    /// Control mesh to start with, of triangles.
    pub mesh: In<Mesh>,
    /// Points to approximate: points, the cells of a range image, or the vertices of a mesh.
    pub points: In<Scattered>,
    /// Weight of smoothness relative to distance. Increase it for noisy points.
    #[schemars(range(min = 0.0, max = 1000.0))]
    #[serde(default = "default_smoothing")]
    pub smoothing: f64,
    /// Number of iterations. Each finds the nearest points of the surface again.
    #[schemars(range(max = 1000))]
    #[serde(default = "default_iterations")]
    pub iterations: u32,
    /// Changes other than positions of control points.
    #[serde(default)]
    pub moves: Moves,
}

/// Changes other than positions of control points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Moves {
    /// None: the control mesh keeps its faces and creases.
    #[default]
    Nothing,
    /// Collapses, splits, swaps, sharpens or smooths edges wherever that lowers the energy. `points` must be a mesh, because the distance
    /// is also measured between its vertices. The result has no attributes.
    ByEnergy(Prices),
}

fn default_smoothing() -> f64 {
    1e-3
}

fn default_iterations() -> u32 {
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
            .only_if("without `moves`", |it| it.moves == Moves::Nothing),
        Promise::from("mesh", "Manifold", "mesh")
            .only_if("without `moves`", |it| it.moves == Moves::Nothing),
        Promise::from("mesh", "Oriented", "mesh")
            .only_if("without `moves`", |it| it.moves == Moves::Nothing),
        Promise::from("mesh", "Unpinched", "mesh")
            .only_if("without `moves`", |it| it.moves == Moves::Nothing),
    ];

    const CARRIES: &'static [Carry] = &[
        Carry::uniform("mesh", "mesh", Transfer::Kept),
        Carry::uniform("points", "mesh", Transfer::Dropped).and_cells(Transfer::Dropped),
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
                    cx.warn(
                        "the attributes of the mesh are dropped, because `moves` changes the faces",
                    );
                }
                fit_by_moves(mesh, scan, smoothing, iterations, prices, cx.progress())?
            }
            (Moves::ByEnergy(_), _) => bail!("{NO_SURFACE}"),
        };
        if let Some(at) = fitted.first_left_out {
            let (count, all) = (fitted.left_out, points.len());
            cx.warn(format!(
                "{count} of {all} points are more than two edges from the mesh and were ignored, first ({:.3}, {:.3}, {:.3})",
                at.x, at.y, at.z
            ));
        }
        if let Some(&first) = fitted.folds.first() {
            let corner = fitted.mesh.faces().face(first as usize)[0];
            let at = fitted.mesh.positions()[corner as usize];
            cx.warn(format!(
                "the surface folds over at {} faces of the control mesh, first near ({:.3}, {:.3}, {:.3}); start with even triangles, by `Remesh`",
                fitted.folds.len(),
                at.x,
                at.y,
                at.z
            ));
        }
        Ok((fitted.mesh, fitted.trace))
    }
}

#[cfg(test)]
mod tests;
