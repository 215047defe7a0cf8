//! Bakes the colors of several captures into one texture of a mesh.

pub use baking::{Baking, Level};
use level::Leveling;
use maquette_base::light::color_of;
use maquette_base::linear::membrane::Membrane;
use maquette_base::topology::lists::Lists;
use maquette_mesh::Poses;
use maquette_node::{
    Carry, Context, Error, Estimate, FieldError, In, Limit, Node, Progress, Promise, Transfer, bail,
};
use maquette_value::parallel::*;
use maquette_value::{Image, Mask, Mesh, Rgb, Value};
use nalgebra::Matrix4;
use sample::{MeanColor, Sample, weighted_mean};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use spot::Spot;
use view::View;

use super::atlas::{Coordinates, Texels, with_atlas};
use super::layout::{Layout, SIZE};

mod baking;
mod camera;
mod level;
mod sample;
mod spot;
#[cfg(test)]
mod tests;
mod view;

/// Bakes the colors of several captures into one texture of a mesh.
///
/// Each texel is the mean of all captures that see its point, weighted by a frontal view and a small distance. Captures with another
/// exposure or light are equalized, so that no seam shows where one ends. Regions that no capture has seen get the colors around them, with
/// a warning, and are marked. Vertex colors are removed, because the texture replaces them.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Bake {
    /// The mesh to color: a surface made of the captures, or a redesign in the same position.
    pub mesh: In<Mesh>,
    /// Meshes of captures, each with its picture, as `Triangulate` and `Texture` make them, aligned or not. They define the cameras and the
    /// colors.
    #[schemars(extend("least" = 1))]
    pub captures: Vec<In<Mesh>>,
    /// Layout of new texture coordinates, if the mesh gets them; size of the texture.
    #[serde(flatten)]
    pub layout: Layout,
    /// Source of the texture coordinates.
    #[serde(default)]
    pub coordinates: Coordinates,
    /// Parameters of the transfer of colors.
    #[serde(flatten)]
    pub how: Baking,
}

/// Maximum number of captures that are baked into one texture; the limit exists because all pairs of captures are compared.
const CAPTURES: Limit = Limit { max: 200, items: "captures", help: "bake fewer at once" };

impl Node for Bake {
    type Outputs = (Mesh, Image, Mask);
    const OUTPUTS: [&'static str; 3] = ["mesh", "picture", "unseen"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] = &[
        Carry::uniform("mesh", "mesh", Transfer::Kept).excluding(&["uv", "color"]),
        Carry::uniform("captures", "mesh", Transfer::Dropped),
    ];

    fn check(&self) -> Result<(), FieldError> {
        self.layout.check_fields()
    }

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let pixels = (self.layout.size.min(SIZE.max) as f64) * self.layout.size as f64;
        let captures = self.captures.iter().map(|capture| cx.get(capture).size() as f64);
        // Bytes of memory per pixel: for drawing, for texels, and for the samples of each capture.
        let each = 100.0 + 36.0 * self.captures.len() as f64;
        let meshes = 4.0 * captures.sum::<f64>() + 20.0 * cx.get(&self.mesh).size() as f64;
        let bytes = pixels * each + meshes;
        Some(Estimate { bytes, help: SIZE.help })
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let captures: Vec<_> = self.captures.iter().map(|capture| cx.get(capture)).collect();
        let mesh = cx.get(&self.mesh);
        let Self { layout, coordinates, how, .. } = self;
        let known = captures.iter().filter(|it| pose(it).is_some()).count();
        if how.poses == Poses::Auto && 0 < known && known < captures.len() {
            let all = captures.len();
            cx.warn(format!("only {known} of {all} captures have a pose, so that none is moved"));
        }
        let mesh = cx.progress().part(0.0..0.3, |progress| {
            with_atlas(mesh, *coordinates, layout, &|text| cx.warn(text), progress)
        })?;
        let baked = cx
            .progress()
            .part(0.3..1.0, |progress| bake(&mesh, &captures, layout.size, how, progress))?;
        if 0.0 < baked.unseen {
            let share = 100.0 * baked.unseen;
            cx.warn(format!(
                "no capture sees {share:.1} % of the surface, which gets the colors around it"
            ));
        }
        Ok((baked.mesh, baked.picture, baked.mask))
    }
}

/// A mesh with a texture baked from captures.
#[derive(Clone, Debug)]
pub struct BakedMesh {
    /// The mesh with the baked texture and its texture coordinates.
    pub mesh: Mesh,
    /// The baked texture.
    pub picture: Image,
    /// A mask of the picture's size that marks the texels that no capture sees.
    pub mask: Mask,
    /// The fraction, from 0 to 1, of the surface's area that no capture sees.
    pub unseen: f64,
    /// The differences between captures where they overlap, as root mean square over channels, in levels of 0 to 255: before and after
    /// equalization.
    pub steps: [f64; 2],
}

/// Bakes the colors of captures into a texture of a mesh with `uv` at its corners, in which each face has its own part of the texture.
///
/// A capture sees a texel if the ray from the capture's camera first hits the capture's own mesh near the texel's point. The weight of the
/// capture is the cube of the cosine of the viewing angle, times the square of its pixels per mm, reduced near the border of the captured
/// area: Callieri, Cignoni, Corsini and Scopigno, "Masked photo blending: mapping dense photographic data set on high-resolution sampled 3D
/// models" (2008). Colors are mixed as linear light. `level.rs` explains the equalization of captures.
///
/// # Errors
/// Returns an error if there are no captures, a capture has no picture or camera, or no capture sees the mesh.
///
/// # Panics
/// Panics if the mesh has no `uv` at its corners.
pub fn bake(
    mesh: &Mesh,
    captures: &[&Mesh],
    size: usize,
    how: &Baking,
    progress: &Progress<'_>,
) -> Result<BakedMesh, Error> {
    how.check()?;
    if captures.is_empty() {
        bail!("the list `captures` is empty: there is nothing to take colors from");
    }
    CAPTURES.check("the picture", captures.len() as f64)?;
    let motions = motions(mesh, captures, how.poses)?;
    let texels = progress.part(0.0..0.1, |progress| Texels::new(mesh, [size, size], progress))?;
    let spots = Spot::of_all(mesh, &texels);
    let mut samples: Vec<Sample> = Vec::new();
    let (mut nearest, mut tolerance) = (vec![f64::INFINITY; mesh.positions().len()], 0.0_f64);
    for (number, (capture, motion)) in captures.iter().zip(&motions).enumerate() {
        progress.tick(0.1 + 0.5 * number as f64 / captures.len() as f64)?;
        let view = View::new(number, capture, motion, how)?;
        view.sample(&spots, &mut samples, progress)?;
        if samples.is_empty() {
            tolerance = tolerance.max(view.tolerance);
            view.approach(mesh.positions(), &mut nearest);
        }
    }
    if samples.is_empty() {
        nearest.sort_by(f64::total_cmp);
        let distance = nearest[nearest.len() / 2];
        bail!(
            "none of the {} captures sees anything of the mesh: its vertices are {distance:.3} mm from the nearest capture in the middle \
             of all, and {tolerance:.3} mm are tolerated; are `poses` and `tolerance` right?",
            captures.len()
        );
    }
    let of_texels = Lists::group_all(spots.len(), samples.len(), |sample| {
        std::iter::once((samples[sample].texel, sample as u32))
    });
    progress.tick(0.6)?;
    let membrane = Membrane::new(mesh);
    let plan = Leveling {
        texels: &texels,
        corners: mesh.faces().corners(),
        membrane: &membrane,
        of_texels: &of_texels,
        chunks: &texels.chunks(mesh),
    };
    let before = plan.difference(&samples);
    progress
        .part(0.6..0.8, |progress| plan.level(&mut samples, captures.len(), how.level, progress))?;
    let steps = [before, plan.difference(&samples)];
    let mixed: Vec<MeanColor> = (0..spots.len())
        .into_par_iter()
        .with_min_len(4096)
        .map(|texel| weighted_mean(of_texels.list(texel).iter().map(|&it| &samples[it as usize])))
        .collect();
    let filled = progress.part(0.8..0.95, |progress| plan.fill(&mixed, progress))?;
    let colors: Vec<_> = mixed
        .par_iter()
        .zip(&filled)
        .with_min_len(4096)
        .map(|(seen, filled): (&MeanColor, &[f64; 3])| -> Rgb {
            color_of([0, 1, 2].map(|k| seen.sure * seen.light[k] + (1.0 - seen.sure) * filled[k]))
        })
        .collect();
    let picture = texels.picture(&colors, progress)?;
    let mut mask = vec![0; size * size];
    let (mut unseen, mut all) = (0.0, 0.0);
    for ((texel, spot), seen) in texels.texels.iter().zip(&spots).zip(&mixed) {
        all += spot.area;
        if seen.sure == 0.0 {
            mask[texel.pixel as usize] = 1;
            unseen += spot.area;
        }
    }
    Ok(BakedMesh {
        mesh: mesh.clone().without_attribute("color").with_texture(Some(picture.clone())),
        picture,
        mask: Mask::new(size, size, mask).expect("a flag for each pixel"),
        unseen: unseen / all,
        steps,
    })
}

fn pose(mesh: &Mesh) -> Option<Matrix4<f64>> {
    mesh.frame()?.world_from_camera
}

/// Returns the motion of each capture into the coordinates of the baked mesh: those of the mesh's capture frame, or world coordinates if
/// the mesh has no frame.
fn motions(mesh: &Mesh, captures: &[&Mesh], poses: Poses) -> Result<Vec<Matrix4<f64>>, Error> {
    let stay = vec![Matrix4::identity(); captures.len()];
    let known: Vec<_> = captures.iter().map(|capture| pose(capture)).collect();
    let nowhere = known.iter().position(Option::is_none);
    let own = match mesh.frame() {
        None => Some(Matrix4::identity()),
        Some(frame) => frame.world_from_camera.and_then(|pose| pose.try_inverse()),
    };
    Ok(match (poses, nowhere, own) {
        (Poses::Ignore, ..) => stay,
        (Poses::Apply, Some(place), _) => bail!(
            "capture {} has no pose: only captures whose camera file has `world_from_camera_mm` have one, and only until they are moved",
            place + 1
        ),
        (Poses::Apply, None, own) => {
            let own = own.unwrap_or_else(Matrix4::identity);
            known.into_iter().flatten().map(|pose| own * pose).collect()
        }
        (Poses::Auto, None, Some(own)) => {
            known.into_iter().flatten().map(|pose| own * pose).collect()
        }
        (Poses::Auto, ..) => stay,
    })
}
