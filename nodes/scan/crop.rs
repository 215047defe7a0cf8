//! Removes the parts of a scan outside of a region.

use maquette_node::{Blocks, Carry, Context, Error, In, Node, Transfer};
use maquette_value::Mesh;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::plane::Plane;
use super::scan::Scan;
use super::within::{Region, select_parts};

/// Removes the parts of a scan that are outside of a region of space, or inside of it.
///
/// Faces are not cut: a face of a mesh is removed if any of its corners is. Vertices without faces are removed, too. The removed cells of a
/// range image lose their points, so that `Triangulate` makes no faces there.
///
/// In other programs: clip, slice, bounding box.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Crop {
    /// Scan to crop: a mesh, points or a range image.
    pub mesh: In<Scan>,
    /// Region to keep.
    #[serde(default)]
    pub within: Option<Region>,
    /// Flat mesh, such as `plane` of `DominantPlane`. Keeps only what is above its plane, on the side of its normals.
    pub plane: Option<In<Mesh>>,
    /// Removes what would be kept, and keeps the rest.
    #[serde(default)]
    pub invert: bool,
}

impl Node for Crop {
    type Outputs = (Scan,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];
    const BLOCKS: Blocks = Blocks::Each;

    const CARRIES: &'static [Carry] = &[
        Carry::uniform("mesh", "mesh", Transfer::Kept).and_cells(Transfer::Kept),
        Carry::uniform("plane", "mesh", Transfer::Dropped),
    ];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let scan = cx.get(&self.mesh);
        let plane = self.plane.as_ref().map(|plane| cx.get(plane));
        let cropped = crop(&scan, self.within.as_ref(), plane, self.invert)?;
        if cropped.count() == 0 && scan.count() > 0 {
            cx.warn(scan.empty_result_warning());
        }
        Ok((cropped,))
    }
}

/// Returns the part of a scan that is inside `within` and above the plane of a flat mesh; with `invert` returns the rest.
///
/// # Errors
/// If the region is invalid, or the mesh is not flat.
pub fn crop(
    scan: &Scan,
    within: Option<&Region>,
    plane: Option<&Mesh>,
    invert: bool,
) -> Result<Scan, Error> {
    let plane = plane.map(Plane::from_mesh).transpose()?;
    let above = plane.map(|plane| {
        scan.positions().iter().map(|position| plane.height(position) >= 0.0).collect()
    });
    select_parts(scan, within, above, invert)
}

#[cfg(test)]
mod tests {
    use maquette_value::Faces;
    use nalgebra::Point3;

    use super::*;

    /// Creates a square of two triangles with one corner raised by `bent` mm. If `back` is true, the two triangles face opposite sides.
    fn square(bent: f64, back: bool) -> Mesh {
        let positions =
            [[0., 0., 0.], [1., 0., 0.], [1., 1., bent], [0., 1., 0.]].map(Point3::from);
        let other = if back { [0, 2, 1] } else { [0, 2, 3] };
        Mesh::new(positions.to_vec(), Faces::triangles(vec![[0, 1, 2], other])).unwrap()
    }

    #[test]
    fn a_mesh_that_is_not_flat_is_an_error() {
        let scan = Scan::Mesh(square(0.0, false));
        fn crop_count(plane: &Mesh, scan: &Scan) -> Result<usize, String> {
            let cropped = crop(scan, None, Some(plane), false);
            cropped.map(|it| it.count()).map_err(|error| error.to_string())
        }
        assert_eq!(crop_count(&square(0.0, false), &scan), Ok(2));
        assert!(crop_count(&square(0.05, false), &scan).is_ok());
        let message = "the mesh at the port `plane` has no area, so it has no plane";
        assert_eq!(crop_count(&square(0.0, true), &scan).unwrap_err(), message);
        let bent = crop_count(&square(1.0, false), &scan).unwrap_err();
        assert!(
            bent.starts_with("the mesh at the port `plane` is not flat: its corners are 0."),
            "{bent}"
        );
    }
}
