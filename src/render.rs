//! One picture of a value, in software: for goldens, `inspect`, `render` and documents.
//!
//! What a value shows is either a picture of its own, which may lie on another one (`flat`), or lies in space, where a camera sees its
//! faces, lines, points and arrows together.
//!
//! Guaranteed: the same bytes on every machine and for any number of threads; no cracks between faces that share an edge.
//! The picture is made in bands of rows that know nothing of each other. In each band every face is first drawn into a
//! buffer that remembers the nearest face of each *sample*, of which a pixel has 3 x 3; then each pixel is shaded once for
//! every face that it shows.
//!
//! Polygons are drawn as fans of triangles from their first corner.

use maquette_value::parallel::*;
use maquette_value::{Image, Layer, Mesh, Rgb};
use nalgebra::Point3;

mod camera;
mod flat;
mod light;
mod raster;
mod scene;
#[cfg(feature = "cli")]
mod shapes;
mod solid;

use camera::Camera;
#[cfg(feature = "cli")]
pub(crate) use flat::Ground;
pub use flat::{Below, fitted, picture_of};
use raster::{Band, Bins};
use scene::Scene;
#[cfg(feature = "cli")]
pub(crate) use shapes::{Field, Ruler, Shape, Shapes};
pub use solid::render_layers;

/// Samples along each side of a pixel.
const SAMPLES: usize = 3;

/// Rows of pixels in a band: few enough that a band's samples fit in a core's cache at usual widths.
const BAND: usize = 8;

/// From where a picture is taken. All that is seen is framed by itself, unless the view aims at a part of it.
///
/// Seen from the front, a mesh with a [`CaptureFrame`](maquette_value::CaptureFrame) looks as its sensor saw it; one without
/// has x to the right, y up, and z towards the viewer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// How far the viewer walks around the mesh to the right, in degrees.
    pub yaw: f64,
    /// How far the viewer rises above it, in degrees.
    pub pitch: f64,
    /// How much larger than what just fits, 0.001 to 1000.
    pub zoom: f64,
    /// Whether far things look smaller.
    pub projection: Projection,
    /// What is in the middle; all there is without it.
    pub aim: Option<Aim>,
}

/// What is in the middle of a picture, in mm, in the axes of what is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Aim {
    /// A place. It changes nothing else.
    Place(Point3<f64>),
    /// The least and the greatest corner of a box, which just fits into the picture.
    Box(Point3<f64>, Point3<f64>),
}

impl Aim {
    /// Aims at the box around some places, those that are not finite left out; none if there is no other.
    pub fn around(places: impl IntoIterator<Item = Point3<f64>>) -> Option<Self> {
        let is_finite = |place: &Point3<f64>| place.coords.iter().all(|x| x.is_finite());
        let places = Vec::from_iter(places.into_iter().filter(is_finite));
        maquette_value::bounds(places.iter()).map(|(low, high)| Self::Box(low, high))
    }
}

/// Whether far things look smaller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Projection {
    /// They do: a lens of 26 degrees.
    #[default]
    Perspective,
    /// They do not.
    Orthographic,
}

impl View {
    /// From the front, 800 x 600 pixels, in perspective.
    pub fn front() -> Self {
        Self {
            size: [800, 600],
            yaw: 0.0,
            pitch: 0.0,
            zoom: 1.0,
            projection: Projection::Perspective,
            aim: None,
        }
    }
}

/// How a value is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look<'a> {
    /// From where what lies in space is seen.
    pub view: View,
    /// Which of the two is drawn.
    pub kind: Kind,
    /// What a flat picture lies on.
    pub below: Option<Below<'a>>,
}

/// What of a value is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// The picture that it shows, with the pixels that it has; without one, what lies in space.
    #[default]
    Own,
    /// The same, but a picture fits into the size of the view.
    Fitted,
    /// What lies in space.
    Space,
}

impl Look<'_> {
    /// At the picture of a value if it shows one, else from the front.
    pub fn own() -> Self {
        Self { view: View::front(), kind: Kind::Own, below: None }
    }
}

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
fn render_all(meshes: &[&Mesh], view: &View) -> Image {
    let [width, height] = view.size;
    let mut pixels: Vec<Rgb> = vec![[0; 3]; width.saturating_mul(height)];
    if !pixels.is_empty() {
        let scene = Scene::new(meshes, &Camera::new(meshes, view));
        let bins = Bins::new(&scene, height);
        pixels.par_chunks_mut(BAND * width).enumerate().for_each(|(band, pixels)| {
            let samples = Band::draw(&scene, &bins, band, [width, pixels.len() / width]);
            let background = |row| light::background((band * BAND + row) as f64 / height as f64);
            samples.resolve(&scene, background, pixels);
        });
    }
    Image::new(width, height, pixels).expect("a pixel for each place")
}

/// Three things, made one by one: the compiler keeps them in registers, which it does not for those of `array::map`.
#[inline(always)]
fn each<T>(make: impl Fn(usize) -> T) -> [T; 3] {
    [make(0), make(1), make(2)]
}

/// Four things: as many numbers as one instruction computes. The last is 0 where only three are meant.
#[inline(always)]
fn four<T>(make: impl Fn(usize) -> T) -> [T; 4] {
    [make(0), make(1), make(2), make(3)]
}

/// Three numbers and a zero.
#[inline(always)]
fn padded<T: Copy + Default>([a, b, c]: [T; 3]) -> [T; 4] {
    [a, b, c, T::default()]
}

#[cfg(test)]
mod tests;
