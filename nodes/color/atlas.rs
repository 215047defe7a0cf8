//! Texture atlases: pictures in which each point of a mesh has its own texel.

use std::ops::Range;

use maquette_base::topology::lists::Lists;
use maquette_node::{CancelledError, Error, Progress};
use maquette_value::parallel::*;
use maquette_value::{Attribute, Image, KeyChunks, Mesh, Rgb};
use nalgebra::Vector2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::layout::{Layout, lay_out, overlap};

/// The source of an atlas's texture coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Coordinates {
    /// The mesh's own coordinates, if each face has its own part of the square from (0, 0) to (1, 1); otherwise new ones, as `Unwrap` makes
    /// them.
    #[default]
    Own,
    /// New coordinates, as `Unwrap` makes them.
    New,
}

/// Returns the mesh with texture coordinates `uv` at its corners that form an atlas: each face has its own part of the square from (0, 0)
/// to (1, 1). If `coordinates` asks for the mesh's own coordinates but they are unusable, calls `doubt` with the reason.
///
/// # Errors
/// Returns the errors of [`lay_out`].
pub(crate) fn with_atlas(
    mesh: &Mesh,
    coordinates: Coordinates,
    layout: &Layout,
    doubt: &dyn Fn(String),
    progress: &Progress<'_>,
) -> Result<Mesh, Error> {
    layout.check()?;
    let own = (coordinates == Coordinates::Own).then(|| corner_uv(mesh)).flatten();
    let Some(uv) = own else { return Ok(lay_out(mesh, layout, progress)?.mesh) };
    match unusable_reason(mesh, &uv) {
        None => Ok(mesh
            .clone()
            .without_attribute("uv")
            .with_corner("uv", Attribute::Pair(uv.into()))?),
        Some(why) => {
            doubt(format!("the mesh gets new texture coordinates: in its own ones {why}"));
            Ok(lay_out(mesh, layout, progress)?.mesh)
        }
    }
}

/// Returns the texture coordinates of each corner; `None` if the mesh has no texture coordinates.
pub(crate) fn corner_uv(mesh: &Mesh) -> Option<Vec<[f64; 2]>> {
    match mesh.corner().pairs("uv") {
        Some(uv) => Some(uv.to_vec()),
        None => {
            let uv = mesh.vertex().pairs("uv")?;
            Some(mesh.faces().corners().iter().map(|&vertex| uv[vertex as usize]).collect())
        }
    }
}

/// Returns the corners of all triangles of a mesh, each triangle with its face.
fn triangles_of_faces(mesh: &Mesh) -> Vec<(u32, [u32; 3])> {
    let faces = (0..mesh.faces().len()).flat_map(|face| {
        let first = mesh.faces().first_corner(face) as u32;
        let triangles = mesh.face_triangles(face);
        triangles.map(move |it| (face as u32, it.map(|corner| first + corner)))
    });
    faces.collect()
}

/// Fraction by which triangles are shrunk toward their centroids before the test for overlaps. Rounding of texture coordinates in files may
/// make adjacent triangles overlap slightly.
const ROUNDED: f64 = 1e-3;

/// Returns the reason why texture coordinates cannot be used as an atlas; `None` if they can.
fn unusable_reason(mesh: &Mesh, uv: &[[f64; 2]]) -> Option<String> {
    let slack = -1e-6..=1.0 + 1e-6;
    if let Some(out) = uv.iter().find(|uv| !uv.iter().all(|x| slack.contains(x))) {
        return Some(format!(
            "({}, {}) is not in the square from (0, 0) to (1, 1)",
            out[0], out[1]
        ));
    }
    let mut triangles = Vec::new();
    let mut faces = Vec::new();
    for (face, corners) in triangles_of_faces(mesh) {
        let [a, b, c] = corners.map(|it| Vector2::from(uv[it as usize]));
        let twice = (b - a).perp(&(c - a));
        let [p, q, r] =
            corners.map(|it: u32| mesh.positions()[mesh.faces().corners()[it as usize] as usize]);
        if twice == 0.0 {
            if (q - p).cross(&(r - p)).norm() > 0.0 {
                return Some(format!("face {face} has no area"));
            }
            continue;
        }
        let middle = (a + b + c) / 3.0;
        let [a, b, c] = [a, b, c].map(|it| it + (middle - it) * ROUNDED);
        triangles.push(if twice > 0.0 { [a, b, c] } else { [a, c, b] });
        faces.push(face);
    }
    let [a, b] = overlap(&triangles)?.map(|it| faces[it as usize]);
    Some(format!("the faces {a} and {b} overlap"))
}

/// A pixel of a texture that shows the surface.
#[derive(Clone, Copy)]
pub(crate) struct Texel {
    /// The index of the pixel in the picture, row by row from the top.
    pub(crate) pixel: u32,
    /// The triangle that the texel shows, as an index into [`Texels::triangles`].
    pub(crate) triangle: u32,
    /// The barycentric weights of the triangle's second and third corner at the point that the texel shows.
    shares: [f32; 2],
    /// True if the center of the texel is inside a triangle; false if the texel is only needed for interpolation.
    pub(crate) is_inside: bool,
}

impl Texel {
    /// Returns the weights of the three corners of the texel's triangle.
    pub(crate) fn shares(&self) -> [f64; 3] {
        let [b, c] = self.shares.map(f64::from);
        [1.0 - b - c, b, c]
    }
}

/// All texels that show the surface.
pub(crate) struct Texels {
    /// Width and height of the picture.
    pub(crate) size: usize,
    /// The indices of each triangle's three corners, among the corners of all faces.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// The texels, row by row from the top. They include texels beside the surface that interpolation needs; these show the nearest point
    /// of the surface.
    pub(crate) texels: Vec<Texel>,
}

/// Maximum distance from a triangle, in texels, of the texels that interpolation needs.
const MAX_TEXEL_DISTANCE: f64 = 1.5;

/// Index of a triangle that does not exist.
const NONE: u32 = u32::MAX;

impl Texels {
    /// Finds the texels of a mesh with `uv` at its corners.
    ///
    /// # Errors
    /// Returns an error if the evaluation is cancelled.
    pub(crate) fn new(
        mesh: &Mesh,
        [width, height]: [usize; 2],
        progress: &Progress<'_>,
    ) -> Result<Self, CancelledError> {
        let uv = mesh.corner().pairs("uv").expect("texture coordinates");
        let size = [width as f64, height as f64];
        let triangles = mesh.triangle_corners();
        let corners: Vec<Triangle> = triangles
            .par_iter()
            .map(|triangle: &[u32; 3]| {
                triangle
                    .map(|it| uv[it as usize])
                    .map(|[u, v]| Vector2::new(u * size[0], (1.0 - v) * size[1]))
            })
            .collect();
        // Each band of rows looks at its triangles in order.
        let bands = Lists::group(height.div_ceil(BAND), || {
            (0u32..).zip(&corners).flat_map(|(number, corners)| {
                let rows = near_pixels(corners, 1, height);
                let bands = rows.start / BAND..rows.end.max(rows.start).div_ceil(BAND);
                bands.map(move |band| (band as u32, number))
            })
        });
        let mut nearest = vec![(NONE, f32::INFINITY); width * height];
        let (corners, bands) = (&corners, &bands);
        let drawn = nearest.par_chunks_mut(BAND * width).enumerate().map(|(band, pixels)| {
            for (count, &number) in bands.list(band).iter().enumerate() {
                if count.is_multiple_of(1000) {
                    progress.check()?;
                }
                draw(number, &corners[number as usize], pixels, width, band * BAND);
            }
            Ok(())
        });
        let _: Vec<()> = drawn.collect::<Result<_, CancelledError>>()?;
        let pixels = nearest.par_iter().enumerate().with_min_len(4096);
        let texels = pixels
            .filter(|(_, nearest): &(usize, &(u32, f32))| nearest.0 != NONE)
            .map(|(pixel, &(triangle, distance))| {
                let center =
                    Vector2::new((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
                let shares = foot(corners[triangle as usize], center).1;
                Texel {
                    pixel: pixel as u32,
                    triangle,
                    shares: shares.map(|x| x as f32),
                    is_inside: distance == 0.0,
                }
            })
            .collect();
        Ok(Self { size: width, triangles, texels })
    }

    /// Distributes the texels to chunks of the mesh's vertices: those of the texels' triangles.
    pub(crate) fn chunks(&self, mesh: &Mesh) -> KeyChunks {
        let corners = mesh.faces().corners();
        KeyChunks::new(mesh.positions().len(), self.texels.len(), |texel| {
            let triangle = self.triangles[self.texels[texel].triangle as usize];
            triangle.map(|corner| corners[corner as usize])
        })
    }

    /// Makes a picture from the given colors, one for each texel. The space between charts gets the nearest colors, so that downscaled
    /// versions of the picture contain no other colors.
    ///
    /// # Errors
    /// Returns an error if the evaluation is cancelled.
    pub(crate) fn picture(
        &self,
        colors: &[Rgb],
        progress: &Progress<'_>,
    ) -> Result<Image, CancelledError> {
        let size = self.size;
        let mut pixels = vec![[0; 3]; size * size];
        let mut is_known = vec![false; size * size];
        for (texel, color) in self.texels.iter().zip(colors) {
            pixels[texel.pixel as usize] = *color;
            is_known[texel.pixel as usize] = true;
        }
        /// Returns the indices of a pixel and of its neighbors (up to eight) in a square picture of `size` x `size` pixels.
        fn neighborhood(pixel: usize, size: usize) -> impl Iterator<Item = usize> {
            let (column, row) = (pixel % size, pixel / size);
            let columns = column.saturating_sub(1)..(column + 2).min(size);
            let rows = row.saturating_sub(1)..(row + 2).min(size);
            rows.flat_map(move |row| columns.clone().map(move |column| row * size + column))
        }
        let mut is_listed = is_known.clone();
        let mut layer: Vec<_> = self.texels.iter().map(|texel| texel.pixel as usize).collect();
        while !layer.is_empty() {
            progress.check()?;
            let listed = &is_listed;
            let mut next: Vec<usize> = layer
                .par_iter()
                .with_min_len(4096)
                .flat_map_iter(|&pixel| neighborhood(pixel, size).filter(|&pixel| !listed[pixel]))
                .collect();
            next.retain(|&pixel| !std::mem::replace(&mut is_listed[pixel], true));
            let (known, known_pixels) = (&is_known, &pixels);
            let colors: Vec<Rgb> = next
                .par_iter()
                .with_min_len(4096)
                .map(|&pixel| {
                    let (mut sum, mut count) = ([0u32; 3], 0);
                    for other in neighborhood(pixel, size).filter(|&other| known[other]) {
                        (0..3).for_each(|k| sum[k] += u32::from(known_pixels[other][k]));
                        count += 1;
                    }
                    sum.map(|sum| ((sum + count / 2) / count) as u8)
                })
                .collect();
            for (&pixel, color) in next.iter().zip(colors) {
                pixels[pixel] = color;
                is_known[pixel] = true;
            }
            layer = next;
        }
        Ok(Image::new(size, size, pixels).expect("a color for each pixel"))
    }
}

/// The corners of a triangle in the picture, in pixels.
type Triangle = [Vector2<f64>; 3];

/// The number of rows of the picture that one parallel task fills.
const BAND: usize = 16;

/// Returns the pixels along an axis, below `end`, whose centers may be near a triangle.
fn near_pixels(triangle: &Triangle, axis: usize, end: usize) -> Range<usize> {
    let [a, b, c] = triangle;
    let low = a[axis].min(b[axis]).min(c[axis]) - MAX_TEXEL_DISTANCE - 0.5;
    let high = a[axis].max(b[axis]).max(c[axis]) + MAX_TEXEL_DISTANCE - 0.5;
    low.ceil().clamp(0.0, end as f64) as usize
        ..((high + 1.0).floor().clamp(0.0, end as f64) as usize)
}

/// Enters a triangle in those pixels of some rows to which it is nearer than all earlier triangles. `pixels` has the nearest triangle of
/// each pixel, and its distance, from the row `first` on.
fn draw(number: u32, triangle: &Triangle, pixels: &mut [(u32, f32)], width: usize, first: usize) {
    let rows = near_pixels(triangle, 1, first + pixels.len() / width);
    let columns = near_pixels(triangle, 0, width);
    let sides = Sides::new(triangle);
    for row in rows.start.max(first)..rows.end {
        for column in columns.clone() {
            let center = Vector2::new(column as f64 + 0.5, row as f64 + 0.5);
            if sides.are_far_from(center) {
                continue;
            }
            let distance = (foot(*triangle, center).0 - center).norm();
            let pixel = &mut pixels[(row - first) * width + column];
            if distance <= MAX_TEXEL_DISTANCE && (distance as f32) < pixel.1 {
                *pixel = (number, distance as f32);
            }
        }
    }
}

/// Twice the area of a triangle, in pixels, above which rounding does not change its orientation.
const MIN_CERTAIN_AREA: f64 = 1e-3;

/// The lines through the sides of a triangle: for each side a point, and the outward unit normal; 0 if the triangle has hardly any area.
struct Sides([(Vector2<f64>, Vector2<f64>); 3]);

impl Sides {
    fn new([a, b, c]: &Triangle) -> Self {
        let twice = (b - a).perp(&(c - a));
        Self([(a, b), (b, c), (c, a)].map(|(from, to)| {
            let side = if twice > 0.0 { to - from } else { from - to };
            let outward = if twice.abs() < MIN_CERTAIN_AREA {
                Vector2::zeros()
            } else {
                Vector2::new(side.y, -side.x)
            };
            (*from, outward.try_normalize(0.0).unwrap_or_default())
        }))
    }

    /// Returns true if a point is so far beyond one of the lines that the triangle cannot be near it; the tolerance exceeds all rounding.
    fn are_far_from(&self, at: Vector2<f64>) -> bool {
        self.0.iter().any(|(from, outward)| (at - from).dot(outward) > MAX_TEXEL_DISTANCE + 0.01)
    }
}

/// Returns the point of a triangle that is nearest to `at`, and the weights of the triangle's second and third corner at that point.
fn foot([a, b, c]: [Vector2<f64>; 3], at: Vector2<f64>) -> (Vector2<f64>, [f64; 2]) {
    let twice = (b - a).perp(&(c - a));
    let (s, t) = ((at - a).perp(&(c - a)) / twice, (b - a).perp(&(at - a)) / twice);
    if 0.0 <= s && 0.0 <= t && s + t <= 1.0 {
        return (at, [s, t]);
    }
    // `at` is outside of the triangle, so the nearest point is on one of the sides.
    let sides = [
        (a, b, [0.0, 0.0], [1.0, 0.0]),
        (b, c, [1.0, 0.0], [0.0, 1.0]),
        (c, a, [0.0, 1.0], [0.0, 0.0]),
    ];
    let feet = sides.map(|(from, to, start, end)| {
        let side: Vector2<f64> = to - from;
        let along = ((at - from).dot(&side) / side.norm_squared()).clamp(0.0, 1.0);
        let along = if along.is_nan() { 0.0 } else { along };
        (from + side * along, [0, 1].map(|k| start[k] + (end[k] - start[k]) * along))
    });
    fn distance(foot: &(Vector2<f64>, [f64; 2]), at: Vector2<f64>) -> f64 {
        (foot.0 - at).norm_squared()
    }
    feet.into_iter()
        .min_by(|a, b| distance(a, at).total_cmp(&distance(b, at)))
        .expect("three sides")
}

#[cfg(test)]
mod tests {
    use maquette_value::Faces;
    use nalgebra::Point3;

    use super::*;

    /// Returns a mesh of one square from (`low`, `low`) to (`high`, `high`) of the picture.
    fn square(low: f64, high: f64) -> Mesh {
        let corners = [[low, low], [high, low], [high, high], [low, high]];
        let places = corners.map(|[x, y]| Point3::new(x, y, 0.0)).to_vec();
        let mesh = Mesh::new(places, Faces::uniform(4, vec![0, 1, 2, 3]).unwrap()).unwrap();
        mesh.with_corner("uv", Attribute::Pair(corners.to_vec().into())).unwrap()
    }

    #[test]
    fn texels_show_their_places() {
        let texels = Texels::new(&square(0.25, 0.75), [8, 8], &Progress::silent()).unwrap();
        assert_eq!(texels.texels.iter().filter(|it| it.is_inside).count(), 16);
        // Interpolation needs two more rings of texels around the square (20 and 16 texels, without the outer corners).
        assert_eq!(texels.texels.len(), 16 + 20 + 16);
        let mesh = square(0.25, 0.75);
        for texel in &texels.texels {
            let (column, row) = (texel.pixel % 8, texel.pixel / 8);
            let corners = texels.triangles[texel.triangle as usize];
            let places = corners
                .map(|it| mesh.positions()[mesh.faces().corners()[it as usize] as usize].coords);
            let shares = texel.shares();
            let place = places[0] * shares[0] + places[1] * shares[1] + places[2] * shares[2];
            fn center(k: u32) -> f64 {
                ((f64::from(k) + 0.5) / 8.0).clamp(0.25, 0.75)
            }
            assert!(
                (place.x - center(column)).abs() < 1e-6 && (place.y - center(7 - row)).abs() < 1e-6
            );
        }
    }

    #[test]
    fn colors_go_on_between_charts() {
        let texels = Texels::new(&square(0.25, 0.75), [32, 32], &Progress::silent()).unwrap();
        let picture =
            texels.picture(&vec![[9, 8, 7]; texels.texels.len()], &Progress::silent()).unwrap();
        assert!(picture.pixels().iter().all(|pixel| *pixel == [9, 8, 7]));
    }

    #[test]
    fn own_coordinates_count_only_if_they_are_an_atlas() {
        fn error(mesh: &Mesh) -> String {
            let doubts = std::cell::RefCell::new(Vec::new());
            let found = with_atlas(
                mesh,
                Coordinates::Own,
                &Layout::default(),
                &|text| doubts.borrow_mut().push(text),
                &Progress::silent(),
            )
            .unwrap();
            assert_eq!(
                doubts.borrow().is_empty(),
                corner_uv(mesh).is_none_or(|own| Some(own) == corner_uv(&found))
            );
            doubts.borrow().join("; ")
        }
        assert_eq!(error(&square(0.25, 0.75)), "");
        assert_eq!(error(&square(0.25, 0.75).without_attribute("uv")), "");
        let text = "the mesh gets new texture coordinates: in its own ones";
        assert_eq!(
            error(&square(0.25, 1.5)),
            format!("{text} (1.5, 0.25) is not in the square from (0, 0) to (1, 1)")
        );
        fn square_with(uv: [[f64; 2]; 4]) -> Mesh {
            square(0.0, 1.0).with_corner("uv", Attribute::Pair(uv.to_vec().into())).unwrap()
        }
        assert_eq!(error(&square_with([[0.5; 2]; 4])), format!("{text} face 0 has no area"));
        assert_eq!(
            error(&square_with([[0., 0.], [1., 0.], [1., 1.], [0.9, 0.1]])),
            format!("{text} the faces 0 and 0 overlap")
        );
        // Mirrored texture coordinates are valid.
        assert_eq!(error(&square_with([[0., 0.], [0., 1.], [1., 1.], [1., 0.]])), "");
    }
}
