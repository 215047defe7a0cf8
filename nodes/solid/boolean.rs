//! Unites solids, cuts them out of each other, or takes what they have in common.

use maquette_node::{Carry, Context, Error, Fate, In, Node, Promise, Want};
use maquette_value::{Material, Mesh};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::combine::boolean;
use crate::operation::Operation;

/// Unites solids, cuts solids out of another one, or takes what all have in common.
///
/// Faces away from where skins meet stay as they are, polygons too; those that are cut become triangles. The result is closed and manifold,
/// also where walls lie in one plane. What lies on one of the solids alone, such as its picture, lies on the other as at the nearest
/// place; it is mixed where edges are cut. Of two pictures vertex colors are made, as by `Merge`, and normals are dropped. A solid of no
/// capture, such as a `Primitive`, is taken as it lies: the result is seen by the camera of `mesh`, and has its axes.
///
/// In other programs: CSG, union, difference, subtract.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Boolean {
    /// The solid.
    pub mesh: In<Mesh>,
    /// The others, one after the other.
    pub with: Vec<In<Mesh>>,
    /// What becomes of them.
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
        Carry::each(
            "mesh",
            "mesh",
            [Fate::Interpolated, Fate::Interpolated, Fate::Kept, Fate::Kept],
        ),
        Carry::each(
            "with",
            "mesh",
            [Fate::Interpolated, Fate::Interpolated, Fate::Kept, Fate::Kept],
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
            cx.warn("nothing is left: the mesh is empty");
        }
        Ok((made,))
    }
}

/// What is not seen of what lies on solids once they are one.
fn doubt(solids: &[&Mesh]) -> Option<&'static str> {
    // Materials of files are all kept.
    if solids.iter().any(|solid| !solid.materials().iter().all(Material::is_plain)) {
        return None;
    }
    let pictures: Vec<_> = solids.iter().filter_map(|solid| solid.texture()).collect();
    fn is_painted(solid: &&Mesh) -> bool {
        solid.vertex().colors("color").is_some()
    }
    if pictures.windows(2).any(|pair| pair[0] != pair[1]) {
        return Some(
            "the solids have different pictures, which become colors of the vertices, as fine as these lie",
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
    fn what_is_not_seen_any_more_is_told() {
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
        assert!(doubt(&[&dark, &light]).unwrap().contains("different pictures"));
        assert!(doubt(&[&painted, &dark]).unwrap().contains("not the vertex colors"));
    }
}
