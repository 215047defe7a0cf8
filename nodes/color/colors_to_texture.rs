//! Bakes vertex colors into a texture.

use maquette_node::{
    Carry, Context, Error, Estimate, FieldError, In, Node, Progress, Promise, Transfer, bail,
};
use maquette_value::parallel::*;
use maquette_value::{Image, Mesh, Rgb};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::atlas::{Coordinates, Texels, with_atlas};
use super::layout::{Layout, SIZE};

/// Bakes the vertex colors of a mesh into a texture, for programs that need one.
///
/// Between vertices colors are interpolated in sRGB, as pictures are sampled. The attribute `color` is removed, because the texture
/// replaces it.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ColorsToTexture {
    /// The mesh, with the attribute `color` at its vertices, or at the corners of its faces.
    pub mesh: In<Mesh>,
    /// Layout of new texture coordinates, if the mesh gets them; size of the texture.
    #[serde(flatten)]
    pub layout: Layout,
    /// Source of the texture coordinates.
    #[serde(default)]
    pub coordinates: Coordinates,
}

impl Node for ColorsToTexture {
    type Outputs = (Mesh, Image);
    const OUTPUTS: [&'static str; 2] = ["mesh", "picture"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] =
        &[Carry::uniform("mesh", "mesh", Transfer::Kept).excluding(&["uv", "color"])];

    fn check(&self) -> Result<(), FieldError> {
        self.layout.check_fields()
    }

    fn estimate(&self, _: &Context<'_>) -> Option<Estimate> {
        let pixels = self.layout.size.min(SIZE.max) as f64 * self.layout.size as f64;
        Some(Estimate { bytes: 40.0 * pixels, help: SIZE.help })
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        corner_colors(mesh)?;
        let Self { layout, coordinates, .. } = self;
        let mesh = cx.progress().part(0.0..0.6, |progress| {
            with_atlas(mesh, *coordinates, layout, &|text| cx.warn(text), progress)
        })?;
        let mesh = cx
            .progress()
            .part(0.6..1.0, |progress| colors_to_texture(&mesh, layout.size, progress))?;
        let picture = mesh.texture().expect("a picture that was just drawn").clone();
        Ok((mesh, picture))
    }
}

/// Bakes the colors of a mesh into a texture of `size` x `size` texels. The mesh has `uv` at its corners, in which each face has its own
/// part of the square.
///
/// # Errors
/// Returns an error if the mesh has no colors, or the evaluation is cancelled.
///
/// # Panics
/// Panics if the mesh has no `uv` at its corners.
pub fn colors_to_texture(mesh: &Mesh, size: usize, progress: &Progress<'_>) -> Result<Mesh, Error> {
    let colors = corner_colors(mesh)?;
    let texels = Texels::new(mesh, [size, size], progress)?;
    let drawn: Vec<Rgb> = texels
        .texels
        .par_iter()
        .with_min_len(4096)
        .map(|texel| {
            let corners = texels.triangles[texel.triangle as usize].map(|it| colors[it as usize]);
            let shares = texel.shares();
            [0, 1, 2].map(|k| {
                let mixed: f64 = (0..3).map(|it| shares[it] * f64::from(corners[it][k])).sum();
                mixed.round() as u8
            })
        })
        .collect();
    Ok(mesh
        .clone()
        .without_attribute("color")
        .with_texture(Some(texels.picture(&drawn, progress)?)))
}

/// Returns the color of each corner.
fn corner_colors(mesh: &Mesh) -> Result<Vec<Rgb>, Error> {
    let corners = mesh.faces().corners();
    if let Some(colors) = mesh.corner().colors("color") {
        return Ok(colors.to_vec());
    }
    match mesh.vertex().colors("color") {
        Some(colors) => Ok(corners.iter().map(|&vertex| colors[vertex as usize]).collect()),
        None => {
            let (vertices, corners) = (mesh.positions().len(), corners.len());
            bail!(
                "the mesh has no colors: neither its {vertices} vertices nor its {corners} corners have the attribute `color`; add colors with `TextureToColors` or `Bake`"
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::{Attribute, Faces};
    use nalgebra::Point3;

    use super::*;

    fn square() -> Mesh {
        let corners = [[0., 0.], [1., 0.], [1., 1.], [0., 1.]];
        let places = corners.map(|[x, y]| Point3::new(x, y, 0.0)).to_vec();
        let mesh = Mesh::new(places, Faces::uniform(4, vec![0, 1, 2, 3]).unwrap()).unwrap();
        mesh.with_corner("uv", Attribute::Pair(corners.to_vec().into())).unwrap()
    }

    #[test]
    fn texels_mix_the_colors_of_their_corners() {
        let ramp = Attribute::Color(vec![[0, 0, 7], [160, 0, 7], [160, 80, 7], [0, 80, 7]].into());
        let mesh = square().with_vertex("color", ramp.clone()).unwrap();
        let of_corners = square().with_corner("color", ramp).unwrap();
        for mesh in [mesh, of_corners] {
            let found = colors_to_texture(&mesh, 16, &Progress::silent()).unwrap();
            let picture = found.texture().unwrap();
            for column in 0..16 {
                for row in 0..16 {
                    let expected = [10 * column + 5, 5 * (15 - row) + 2, 7].map(|x| x as u8);
                    let texel = picture.pixel([column, row]);
                    assert!((0..3).all(|k| texel[k].abs_diff(expected[k]) <= 1), "{texel:?}");
                }
            }
            assert!(found.vertex().get("color").is_none() && found.corner().get("color").is_none());
        }
    }

    #[test]
    fn a_mesh_without_colors_is_an_error() {
        let text = colors_to_texture(&square(), 16, &Progress::silent()).unwrap_err().to_string();
        let expected = "the mesh has no colors: neither its 4 vertices nor its 4 corners have the attribute `color`; add colors with `TextureToColors` or `Bake`";
        assert_eq!(text, expected);
    }
}
