//! Draws values as pictures. The picture is divided into bands of rows, which are drawn in parallel.

use maquette_value::parallel::*;
use maquette_value::{Image, Layer, Mesh, Rgb};

use super::camera::Camera;
use super::flat::{fit_picture, picture_layer};
use super::light;
use super::raster::{Band, Bins};
use super::sampling::BAND;
use super::scene::Scene;
use super::solid::render_layers;
use super::view::{Look, Representation, View};

/// Draws the layers of a value. Returns `None` if the chosen representation shows none of the layers.
pub fn picture(layers: &[Layer], look: &Look<'_>) -> Option<Image> {
    match look.representation {
        Representation::Native => {
            flat_picture(layers, look).or_else(|| render_layers(layers, &look.view))
        }
        Representation::Fitted => flat_picture(layers, look)
            .map(|picture| fit_picture(&picture, look.view.size))
            .or_else(|| render_layers(layers, &look.view)),
        Representation::Space => render_layers(layers, &look.view),
    }
}

/// Draws the flat picture of some layers, on top of the backdrop if `look` has one.
fn flat_picture(layers: &[Layer], look: &Look<'_>) -> Option<Image> {
    let picture = picture_layer(layers)?;
    Some(look.backdrop.as_ref().map_or_else(|| picture.image.clone(), |it| it.draw_over(picture)))
}

/// Renders a mesh that is lit from the upper left. The color comes from its texture, otherwise from its vertex colors. Without these it is
/// the color of clay.
///
/// The inner side of faces is red, unless the view asks for another color. If the mesh has the attribute `normal`, that is used for
/// shading. Otherwise the edge between two faces looks smooth if their normals differ by less than about 100 degrees.
pub fn render(mesh: &Mesh, view: &View) -> Image {
    render_all(&[mesh], view)
}

/// Renders several meshes, which must have the same coordinate axes, in one picture.
pub(crate) fn render_all(meshes: &[&Mesh], view: &View) -> Image {
    let [width, height] = view.size;
    let mut pixels: Vec<Rgb> = vec![[0; 3]; width.saturating_mul(height)];
    if !pixels.is_empty() {
        let scene = Scene::new(meshes, &Camera::new(meshes, view), view.back_faces);
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
    Image::new(width, height, pixels).expect("one pixel per position")
}
