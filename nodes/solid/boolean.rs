//! Union, difference and intersection of solids.

use maquette_node::{Carry, Context, Error, In, Node, Promise, Transfer, Want};
use maquette_value::{Material, Mesh};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::combine::boolean;
use crate::operation::Operation;

/// Unites solids, cuts solids out of another one, or takes what all have in common.
///
/// Faces away from the intersection stay as they are, polygons too; faces that are cut become triangles. The result is closed and manifold,
/// also where walls are coplanar. Attributes that only one of the solids has, such as its texture, are taken from the nearest point of that
/// solid for the others, and interpolated where edges are cut. Two different textures become vertex colors, as in `Merge`, and normals are
/// dropped. A solid without a capture, such as a `Primitive`, is used in its own coordinates: the result has the camera and the axes of
/// `mesh`.
///
/// Parts of one solid that overlap or lie in each other, both facing outward, are united first; this needs no other solid, so `with` may be
/// empty. A part that is inside out is an error. Where faces of two solids coincide, as those of a half and its mirror image do, a slower
/// exact method decides (Zhou, Grinspun, Zorin and Jacobson, "Mesh arrangements for solid geometry", 2016).
///
/// In other programs: CSG, union, difference, subtract.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Boolean {
    /// The first solid.
    pub mesh: In<Mesh>,
    /// The other solids, applied in order. If there are none, what `mesh` encloses more than once is united.
    pub with: Vec<In<Mesh>>,
    /// The operation: union, difference or intersection.
    #[serde(default)]
    pub operation: Operation,
}

impl Node for Boolean {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const WANTS: &'static [Want<Self>] = &[
        Want::new("mesh", "Closed"),
        Want::new("mesh", "Manifold"),
        Want::new("mesh", "Oriented"),
        Want::new("with", "Closed"),
        Want::new("with", "Manifold"),
        Want::new("with", "Oriented"),
    ];

    const PROMISES: &'static [Promise<Self>] = &[
        Promise::always("mesh", "Closed"),
        Promise::always("mesh", "Manifold"),
        Promise::always("mesh", "Oriented"),
    ];

    const CARRIES: &'static [Carry] = &[
        Carry::per_domain(
            "mesh",
            "mesh",
            [Transfer::Interpolated, Transfer::Interpolated, Transfer::Kept, Transfer::Kept],
        ),
        Carry::per_domain(
            "with",
            "mesh",
            [Transfer::Interpolated, Transfer::Interpolated, Transfer::Kept, Transfer::Kept],
        ),
    ];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let others: Vec<_> = self.with.iter().map(|mesh| cx.get(mesh)).collect();
        let mesh = cx.get(&self.mesh);
        doubt(&[&[mesh], &others[..]].concat()).into_iter().for_each(|doubt| cx.warn(doubt));
        if mesh.frame().is_none() && others.iter().any(|other| other.frame().is_some()) {
            cx.warn("`mesh` has y up, and some of `with` have y down, as captures do");
        }
        let made = boolean(mesh, &others, self.operation, cx.progress())?;
        if made.faces().is_empty() {
            cx.warn("the result is empty");
        }
        Ok((made,))
    }
}

/// Returns a warning if the result cannot keep some attributes of the solids; `None` if it can keep all.
fn doubt(solids: &[&Mesh]) -> Option<&'static str> {
    // If a solid has materials from a file, the result keeps the materials of all solids.
    if solids.iter().any(|solid| !solid.materials().iter().all(Material::is_plain)) {
        return None;
    }
    let pictures: Vec<_> = solids.iter().filter_map(|solid| solid.texture()).collect();
    fn is_painted(solid: &&Mesh) -> bool {
        solid.vertex().colors("color").is_some()
    }
    if pictures.windows(2).any(|pair| pair[0] != pair[1]) {
        return Some(
            "the solids have different textures, which become vertex colors, with the resolution of the vertices",
        );
    }
    let hides = !pictures.is_empty()
        && solids.iter().any(|solid| solid.texture().is_none() && is_painted(solid));
    hides.then_some("the picture of one solid is seen on all, and not the vertex colors of others: `TextureToColors` makes colors of it, or `ColorsToTexture` a picture of them")
}

#[cfg(test)]
mod tests {
    use maquette_value::{Attribute, Faces, Image};
    use nalgebra::Point3;

    use super::*;

    #[test]
    fn lost_colors_and_textures_are_reported() {
        let places = vec![Point3::origin(), Point3::new(1., 0., 0.), Point3::new(0., 1., 0.)];
        let bare = Mesh::new(places, Faces::triangles(vec![[0, 1, 2]])).unwrap();
        fn picture(gray: u8) -> Image {
            Image::new(1, 1, vec![[gray; 3]]).unwrap()
        }
        let [dark, light] = [0, 255].map(|gray| bare.clone().with_texture(Some(picture(gray))));
        let colors = Attribute::Color(vec![[9; 3]; 3].into());
        let painted = bare.clone().with_vertex("color", colors).unwrap();
        for silent in [[&bare, &painted], [&dark, &bare], [&dark, &dark], [&painted, &painted]] {
            assert_eq!(doubt(&silent), None);
        }
        assert!(doubt(&[&dark, &light]).unwrap().contains("different textures"));
        assert!(doubt(&[&painted, &dark]).unwrap().contains("not the vertex colors"));
    }
}
