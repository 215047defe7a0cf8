//! Takes away what lies elsewhere.

use maquette_node::{Carry, Context, Error, Fate, In, Node};
use maquette_value::Mesh;
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
///
/// In other programs: clip, slice, bounding box.
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
        let plane = Plane::of_mesh(mesh)?;
        Ok(scan.places().iter().map(|place| plane.height(place) >= 0.0).collect())
    });
    kept(scan, within, above.transpose()?, invert)
}

#[cfg(test)]
mod tests {
    use maquette_value::Faces;
    use nalgebra::Point3;

    use super::*;

    /// A square with its corner `bent` above its plane, and its two faces looking to the same side, or back to back.
    fn square(bent: f64, back: bool) -> Mesh {
        let places = [[0., 0., 0.], [1., 0., 0.], [1., 1., bent], [0., 1., 0.]].map(Point3::from);
        let other = if back { [0, 2, 1] } else { [0, 2, 3] };
        Mesh::new(places.to_vec(), Faces::triangles(vec![[0, 1, 2], other])).unwrap()
    }

    #[test]
    fn what_is_no_plane_is_refused() {
        let scan = Scan::Mesh(square(0.0, false));
        fn told(plane: &Mesh, scan: &Scan) -> Result<usize, KeepError> {
            crop(scan, None, Some(plane), false).map(|it| it.count())
        }
        assert_eq!(told(&square(0.0, false), &scan), Ok(2));
        assert!(told(&square(0.05, false), &scan).is_ok());
        assert_eq!(told(&square(0.0, true), &scan), Err(KeepError::NoPlane));
        let bent = told(&square(1.0, false), &scan).unwrap_err().to_string();
        assert!(
            bent.starts_with("the mesh at the port `plane` is not flat: its corners are 0."),
            "{bent}"
        );
    }
}
