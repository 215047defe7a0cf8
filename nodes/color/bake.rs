//! Puts what several captures show on a mesh, as one picture.

pub use bake_error::BakeError;
pub use baking::{Baking, Level};
use level::Leveled;
use maquette_base::topology::lists::Lists;
use maquette_mesh::Poses;
use maquette_node::{
    Carry, Context, Error, Estimate, Fate, FieldError, In, Limit, Node, Progress, Promise,
};
use maquette_value::{Image, Mask, Mesh, Rgb, Value};
use membrane::Membrane;
use nalgebra::Matrix4;
use sample::{Mixed, Sample, mix};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use spot::Spot;
use view::View;

use super::atlas::{Coordinates, Texels, with_atlas};
use super::layout::{Layout, SIZE};
use super::light::color_of;

mod bake_error;
mod baking;
mod camera;
mod level;
mod membrane;
mod sample;
mod spot;
#[cfg(test)]
mod tests;
mod view;

/// Puts what several captures show on a mesh, as one picture.
///
/// Each texel takes its color from all captures that see its place, mostly from those that see it from the front and from near. Captures
/// that were exposed or lit differently are made equal, so that no seam shows where one ends. What no capture has seen gets the colors
/// around it, and is told and marked. Vertex colors are taken off, because the picture stands for them.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Bake {
    /// The mesh that is colored: a skin of the captures, or a redesign that still lies where they do.
    pub mesh: In<Mesh>,
    /// Meshes of captures, each with its picture, as `Triangulate` and `Texture` make them: also aligned ones. They say where the camera was
    /// and what it saw.
    #[schemars(extend("least" = 1))]
    pub captures: Vec<In<Mesh>>,
    /// How the mesh is laid out, if it gets new texture coordinates; size of the picture.
    #[serde(flatten)]
    pub layout: Layout,
    /// Which texture coordinates it has.
    #[serde(default)]
    pub coordinates: Coordinates,
    /// How colors are taken from the captures.
    #[serde(flatten)]
    pub how: Baking,
}

/// Captures of one picture: pairs of them are compared.
const CAPTURES: Limit = Limit { most: 200, of: "captures", help: "bake fewer at once" };

impl Node for Bake {
    type Outputs = (Mesh, Image, Mask);
    const OUTPUTS: [&'static str; 3] = ["mesh", "picture", "unseen"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] = &[
        Carry::all("mesh", "mesh", Fate::Kept).but(&["uv", "color"]),
        Carry::all("captures", "mesh", Fate::Dropped),
    ];

    fn check(&self) -> Result<(), FieldError> {
        self.layout.check_fields()
    }

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let pixels = (self.layout.size.min(SIZE.most) as f64) * self.layout.size as f64;
        let captures = self.captures.iter().map(|capture| cx.get(capture).size() as f64);
        // Pixels while they are drawn, texels, and what each capture shows of them.
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
            cx.warn(format!(
                "only {known} of {all} captures have a pose, so that all stay as they lie"
            ));
        }
        let doubt = |text| cx.warn(text);
        let mesh = cx
            .progress()
            .part(0.0..0.3, |progress| with_atlas(mesh, *coordinates, layout, &doubt, progress))?;
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

/// A mesh with what captures show on it.
#[derive(Clone, Debug)]
pub struct Baked {
    /// The mesh with its picture.
    pub mesh: Mesh,
    /// The picture.
    pub picture: Image,
    /// The texels that no capture sees.
    pub mask: Mask,
    /// Their share of the surface.
    pub unseen: f64,
    /// How much captures differ where they overlap, as root mean square over channels, in levels of 0 to 255: as they came, and leveled.
    pub steps: [f64; 2],
}

/// What captures show on a mesh with `uv` at its corners, in which each face has a part of the square for itself.
///
/// A capture sees a texel if the line from its camera meets its own mesh first near there. It counts by the cube of the cosine at which
/// it looks, by the square of its pixels per mm, and less near the border of what it saw: Callieri, Cignoni, Corsini and Scopigno, "Masked
/// photo blending: mapping dense photographic data set on high-resolution sampled 3D models" (2008). Colors are mixed as light. How
/// captures are made equal is told in `level.rs`.
///
/// # Errors
/// If there are no captures, one has no picture or camera, or none sees anything.
///
/// # Panics
/// If the mesh has no `uv` at its corners.
pub fn bake(
    mesh: &Mesh,
    captures: &[&Mesh],
    size: usize,
    how: &Baking,
    progress: &Progress<'_>,
) -> Result<Baked, BakeError> {
    how.check()?;
    if captures.is_empty() {
        return Err(BakeError::NoCaptures);
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
        return Err(BakeError::NothingSeen { captures: captures.len(), distance, tolerance });
    }
    let of_texels = Lists::group(spots.len(), || samples.iter().map(|it| it.texel).zip(0..));
    progress.tick(0.6)?;
    let membrane = Membrane::new(mesh);
    let plan = Leveled {
        texels: &texels,
        corners: mesh.faces().corners(),
        membrane: &membrane,
        of_texels: &of_texels,
    };
    let before = plan.difference(&samples);
    progress
        .part(0.6..0.8, |progress| plan.level(&mut samples, captures.len(), how.level, progress))?;
    let steps = [before, plan.difference(&samples)];
    let mixed: Vec<_> = (0..spots.len())
        .map(|texel| mix(of_texels.of(texel).iter().map(|&it| &samples[it as usize])))
        .collect();
    let filled = progress.part(0.8..0.95, |progress| plan.fill(&mixed, progress))?;
    let colors: Vec<_> = mixed
        .iter()
        .zip(&filled)
        .map(|(seen, filled): (&Mixed, &[f64; 3])| -> Rgb {
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
    Ok(Baked {
        mesh: mesh.clone().without("color").with_texture(Some(picture.clone())),
        picture,
        mask: Mask::new(size, size, mask).expect("a flag for each pixel"),
        unseen: unseen / all,
        steps,
    })
}

fn pose(mesh: &Mesh) -> Option<Matrix4<f64>> {
    mesh.frame()?.world_from_camera
}

/// How each capture moves to where the mesh lies. A mesh without a frame lies in the world, one with a frame where its camera says.
fn motions(mesh: &Mesh, captures: &[&Mesh], poses: Poses) -> Result<Vec<Matrix4<f64>>, BakeError> {
    let stay = vec![Matrix4::identity(); captures.len()];
    let known: Vec<_> = captures.iter().map(|capture| pose(capture)).collect();
    let nowhere = known.iter().position(Option::is_none);
    let own = match mesh.frame() {
        None => Some(Matrix4::identity()),
        Some(frame) => frame.world_from_camera.and_then(|pose| pose.try_inverse()),
    };
    Ok(match (poses, nowhere, own) {
        (Poses::Ignore, ..) => stay,
        (Poses::Apply, Some(place), _) => return Err(BakeError::NoPose { capture: place + 1 }),
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
