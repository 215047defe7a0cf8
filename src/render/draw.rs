//! Draws what a value shows, in bands of rows.

use maquette_value::parallel::*;
use maquette_value::{Image, Layer, Mesh, Rgb};

use super::camera::Camera;
use super::flat::{fitted, picture_of};
use super::light;
use super::raster::{Band, Bins};
use super::sampling::BAND;
use super::scene::Scene;
use super::solid::render_layers;
use super::view::{Kind, Look, View};

/// A picture of what a value shows; none if it shows nothing, or nothing of what is asked for.
pub fn picture(layers: &[Layer], look: &Look<'_>) -> Option<Image> {
    let flat = || {
        let picture = picture_of(layers)?;
        Some(look.below.as_ref().map_or_else(|| picture.image.clone(), |it| it.under(picture)))
    };
    match look.kind {
        Kind::Own => flat().or_else(|| render_layers(layers, &look.view)),
        Kind::Fitted => flat()
            .map(|picture| fitted(&picture, look.view.size))
            .or_else(|| render_layers(layers, &look.view)),
        Kind::Space => render_layers(layers, &look.view),
    }
}

/// A picture of `mesh`: lit from the left above, with its texture, else its vertex colors, else as clay.
///
/// The inner side of faces is red. The attribute `normal` shades the surface if there is one; otherwise faces that meet at
/// less than some 100 degrees look smooth.
pub fn render(mesh: &Mesh, view: &View) -> Image {
    render_all(&[mesh], view)
}

/// A picture of meshes that share their axes.
pub(crate) fn render_all(meshes: &[&Mesh], view: &View) -> Image {
    let [width, height] = view.size;
    let mut pixels: Vec<Rgb> = vec![[0; 3]; width.saturating_mul(height)];
    if !pixels.is_empty() {
        let scene = Scene::new(meshes, &Camera::new(meshes, view));
        let bins = Bins::new(&scene, height);
        pixels.par_chunks_mut(BAND * width).enumerate().for_each(|(band, pixels)| {
            let samples = Band::draw(&scene, &bins, band, [width, pixels.len() / width]);
            samples.resolve(
                &scene,
                |row| light::background((band * BAND + row) as f64 / height as f64),
                pixels,
            );
        });
    }
    Image::new(width, height, pixels).expect("a pixel for each place")
}
