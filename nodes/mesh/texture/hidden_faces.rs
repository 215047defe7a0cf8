//! Colors of faces that a capture does not see and whose place in its picture shows something else.

use maquette_base::light::{color_of, light_of};
use maquette_base::linear::membrane::Membrane;
use maquette_node::{Error, Progress};
use maquette_value::{Attribute, Image, Mesh, Rgb};

/// The side of a face's block of texels. Bilinear interpolation between the centers of its texels is linear in a triangle.
const BLOCK: usize = 2;

/// Gives faces of a textured mesh colors of their own. `uv` has the texture coordinates of the vertices, `None` where the picture does not
/// show the vertex; `is_hidden` marks the faces. The colors of these vertices are those of a membrane in linear light between the others.
/// They are appended to the picture, below a copy of its last row, and texture coordinates become those of corners.
///
/// # Errors
/// Returns an error if the evaluation is cancelled.
pub(super) fn paint_hidden_faces(
    mesh: &Mesh,
    image: &Image,
    uv: &[Option<[f64; 2]>],
    is_hidden: &[bool],
    progress: &Progress<'_>,
) -> Result<Mesh, Error> {
    let colors = vertex_colors(mesh, image, uv, progress)?;
    let [width, height] = [image.width().max(BLOCK), image.height()];
    let per_row = width / BLOCK;
    let first = height + 1;
    let count = is_hidden.iter().filter(|is_hidden| **is_hidden).count();
    let size = [width, first + BLOCK * count.div_ceil(per_row)];
    let mut pixels = vec![[0; 3]; size[0] * size[1]];
    for row in 0..first {
        for column in 0..width {
            let from = [column.min(image.width() - 1), row.min(height - 1)];
            pixels[row * width + column] = image.pixel(from);
        }
    }
    let scale = [image.width() as f64, height as f64];
    let mut corners = Vec::with_capacity(mesh.faces().corners().len());
    let mut blocks = 0..;
    for (face, is_hidden) in mesh.faces().iter().zip(is_hidden) {
        if !is_hidden {
            let seen = face.iter().map(|&vertex| uv[vertex as usize].unwrap_or_default());
            corners.extend(seen.map(|[u, v]| {
                coordinates([u * scale[0], ((1.0 - v) * scale[1]).min(scale[1])], size)
            }));
            continue;
        }
        let block: usize = blocks.next().unwrap_or_default();
        let corner = [block % per_row * BLOCK, first + block / per_row * BLOCK];
        let (texels, places) = block_texels(face, &colors);
        for (k, texel) in texels.into_iter().enumerate() {
            pixels[(corner[1] + k / BLOCK) * width + corner[0] + k % BLOCK] = texel;
        }
        corners.extend((0..face.len()).map(|k| {
            let [x, y] = places[k % places.len()];
            coordinates([corner[0] as f64 + x, corner[1] as f64 + y], size)
        }));
    }
    let image = Image::new(size[0], size[1], pixels)?;
    let mesh = mesh.clone().without_attribute("uv");
    let mesh = mesh.with_corner("uv", Attribute::Pair(corners.into()))?;
    Ok(mesh.with_texture(Some(image)))
}

/// Returns the texture coordinates of a position in a picture, in texels from its upper left corner.
fn coordinates([column, row]: [f64; 2], size: [usize; 2]) -> [f64; 2] {
    [column / size[0] as f64, 1.0 - row / size[1] as f64]
}

/// Returns the texels of a face's block, row by row, and the places of its corners in the block, in texels. Faces with more than four
/// corners have one color.
fn block_texels(face: &[u32], colors: &[Rgb]) -> ([Rgb; 4], Vec<[f64; 2]>) {
    let colors: Vec<Rgb> = face.iter().map(|&vertex| colors[vertex as usize]).collect();
    match colors[..] {
        [a, b, c] => {
            let opposite = [0, 1, 2].map(|k| {
                let sum = i32::from(b[k]) + i32::from(c[k]) - i32::from(a[k]);
                sum.clamp(0, 255) as u8
            });
            ([a, b, c, opposite], vec![[0.5, 0.5], [1.5, 0.5], [0.5, 1.5]])
        }
        [a, b, c, d] => ([a, b, d, c], vec![[0.5, 0.5], [1.5, 0.5], [1.5, 1.5], [0.5, 1.5]]),
        _ => {
            let lights = colors.iter().map(|&color| light_of(color));
            ([color_of(mean(lights)); 4], vec![[1.0, 1.0]])
        }
    }
}

/// Returns the colors of the vertices: those of the picture, or of a membrane between them.
fn vertex_colors(
    mesh: &Mesh,
    image: &Image,
    uv: &[Option<[f64; 2]>],
    progress: &Progress<'_>,
) -> Result<Vec<Rgb>, Error> {
    let mut lights: Vec<Option<[f64; 3]>> = uv
        .iter()
        .map(|uv| uv.map(|uv| light_of(image.sample(uv).map(|channel| channel.round() as u8))))
        .collect();
    let is_unknown: Vec<bool> = lights.iter().map(Option::is_none).collect();
    let known = mean(lights.iter().flatten().copied());
    Membrane::around(mesh, |vertex| is_unknown[vertex as usize]).fill(&mut lights, progress)?;
    // Only parts without any seen vertex have no color yet.
    Ok(lights.into_iter().map(|light| color_of(light.unwrap_or(known))).collect())
}

fn mean(lights: impl Iterator<Item = [f64; 3]>) -> [f64; 3] {
    let (mut sum, mut count) = ([0.0; 3], 0.0_f64);
    for light in lights {
        (0..3).for_each(|k| sum[k] += light[k]);
        count += 1.0;
    }
    sum.map(|sum| sum / count.max(1.0))
}
