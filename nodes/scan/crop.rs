//! Takes away what lies elsewhere.

use maquette::value::Mesh;
use maquette::{Carry, Context, Error, Fate, In, Node};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::keep_error::KeepError;
use super::plane::Plane;
use super::scan::Scan;
use super::within::{Within, kept};

/// Takes away what lies outside of a part of space, or inside of it.
///
/// A face of a mesh goes if one of its corners does: nothing is cut through. Vertices that no face needs any more go along. Of a range image
/// the cells have no point any more, and `Triangulate` joins nothing there.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Crop {
    /// What is cropped: a mesh, points or a range image.
    pub mesh: In<Scan>,
    /// What stays.
    #[serde(default)]
    pub within: Option<Within>,
    /// Of what is within, only what lies above this plane stays, such as the one that `DominantPlane` gives: where its faces look.
    pub plane: Option<In<Mesh>>,
    /// Keeps what would go, and takes away the rest.
    #[serde(default)]
    pub invert: bool,
}

impl Node for Crop {
    type Outputs = (Scan,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const CARRIES: &'static [Carry] = &[
        Carry::all("mesh", "mesh", Fate::Kept).and_cells(Fate::Kept),
        Carry::all("plane", "mesh", Fate::Dropped),
    ];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let scan = cx.get(&self.mesh);
        let plane = self.plane.as_ref().map(|plane| cx.get(plane));
        let cropped = crop(&scan, self.within.as_ref(), plane, self.invert)?;
        if cropped.count() == 0 && scan.count() > 0 {
            cx.warn(scan.nothing_left());
        }
        Ok((cropped,))
    }
}

/// What is `within`, and above the plane on which a flat mesh lies, of a scan; with `invert` what is not.
///
/// # Errors
/// The part of space or the plane is none.
pub fn crop(
    scan: &Scan,
    within: Option<&Within>,
    plane: Option<&Mesh>,
    invert: bool,
) -> Result<Scan, KeepError> {
    let above = plane.map(|mesh| {
        let plane = Plane::of_mesh(mesh).ok_or(KeepError::NoPlane)?;
        Ok(scan.places().iter().map(|place| plane.height(place) >= 0.0).collect())
    });
    kept(scan, within, above.transpose()?, invert)
}
