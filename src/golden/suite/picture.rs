//! Draws pictures for the HTML report: of old values, new values and their differences.

use maquette_engine::digits::six_digits;
use maquette_engine::distances::distances;
use maquette_format::png;
use maquette_render::{View, render};
use maquette_value::{AnyValue, Attribute, Image, Mesh, Rgb};
use nalgebra::Point3;

use super::OutputComparison;
use crate::parts::{Class, GoldenColumn, GoldenParts};
use crate::store::{Golden, picture_of, sample_picture};

/// One or two pictures with a caption. The page shows two pictures alternately at the same place.
pub(crate) struct Figure {
    pub(crate) caption: String,
    pub(crate) pictures: Vec<Vec<u8>>,
}

/// The cameras for pictures of meshes: yaw and pitch in degrees, and a description.
const CAMERAS: [(f64, f64, &str); 3] = [
    (0.0, 0.0, "from the front"),
    (50.0, 20.0, "from the right"),
    (-50.0, 35.0, "from the left above"),
];

const SIZE: [usize; 2] = [300, 225];

impl Figure {
    fn new(caption: impl Into<String>, pictures: &[&Image]) -> Option<Self> {
        let pictures = pictures.iter().map(|picture| png::encode_rgb(picture).ok());
        Some(Self { caption: caption.into(), pictures: pictures.collect::<Option<_>>()? })
    }
}

/// Returns the pictures that show how an output has changed.
pub(crate) fn figures(output: &OutputComparison) -> Vec<Figure> {
    let golden = output.golden.as_ref().ok();
    if let Some(mesh) = output.value.as_mesh() {
        return mesh_figures(&mesh, golden);
    }
    let (old, new) = old_and_new_picture(&output.value, golden);
    let Some(new) = new else { return Vec::new() };
    let Some(old) = old else {
        return Figure::new("new", &[&new]).into_iter().collect();
    };
    let mut figures = vec![Figure::new("old", &[&old]), Figure::new("new", &[&new])];
    if (old.width(), old.height()) == (new.width(), new.height()) {
        let (picture, fraction) = difference(&old, &new);
        let caption = format!("difference: {} % of the pixels", six_digits(100.0 * fraction));
        figures.push(Figure::new(caption, &[&picture]));
        figures.push(Figure::new("old and new in turn", &[&old, &new]));
    }
    figures.into_iter().flatten().collect()
}

/// Returns the golden and the new value as pictures. Both contain only the elements that are stored in the golden.
fn old_and_new_picture(
    value: &AnyValue,
    golden: Option<&Golden>,
) -> (Option<Image>, Option<Image>) {
    if let Some(new) = picture_of(value) {
        let old = golden.and_then(Golden::picture);
        let size = old.map_or([0, 0], |old| [old.width(), old.height()]);
        let new = if old.is_some() { shrink(&new, size) } else { new };
        return (old.cloned(), Some(new));
    }
    let Some(parts) = GoldenParts::from_value(value) else { return (None, None) };
    let Some(part) = grid_part(&parts) else { return (None, None) };
    let stored = golden.and_then(Golden::numbers).and_then(|stored| stored.column(&part.name));
    let Some(stored) = stored
        .map(|stored| &stored.part)
        .filter(|stored| stored.count == part.count && stored.width == part.width)
    else {
        return (None, column_picture(part, parts.row, part));
    };
    (
        column_picture(stored, parts.row, stored),
        column_picture(&part.sample(stored.stride), parts.row, stored),
    )
}

fn mesh_figures(new: &Mesh, golden: Option<&Golden>) -> Vec<Figure> {
    // Give the old mesh the capture frame of the new one, so that both are seen from the same side.
    let old = golden.and_then(Golden::mesh).map(|old| old.with_frame(new.frame().copied()));
    let distances_to_old = match (&old, golden) {
        (Some(old), _) => Some(distances(new, old)),
        (None, Some(golden)) => golden.differences(new),
        (None, None) => None,
    };
    let mut figures = Vec::new();
    for (yaw, pitch, words) in CAMERAS {
        let view = View { size: SIZE, yaw, pitch, ..View::front() };
        let now = render(new, &view);
        if let Some(old) = &old {
            let was = render(old, &view);
            figures.push(Figure::new(format!("old and new in turn, {words}"), &[&was, &now]));
        } else {
            figures.push(Figure::new(format!("new, {words}"), &[&now]));
        }
        if let Some(distances_to_old) = &distances_to_old {
            let largest =
                distances_to_old.iter().copied().filter(|x| x.is_finite()).fold(0.0, f64::max);
            let colors = distances_to_old
                .iter()
                .map(|&x| heat(if largest > 0.0 { x / largest } else { 0.0 }));
            let picture = color_vertices(new, colors.collect()).map(|mesh| render(&mesh, &view));
            let caption =
                format!("distance to the old one, {words}: gray 0, red {} mm", six_digits(largest));
            figures.extend(picture.map(|picture| Figure::new(caption, &[&picture])));
        }
    }
    if let (None, Some(view)) = (&old, golden.and_then(Golden::picture)) {
        figures.insert(0, Figure::new("old, from the front", &[view]));
    }
    figures.into_iter().flatten().collect()
}

/// Returns pictures of a mesh or surface in which vertices near the positions `places` are red.
pub(crate) fn violation_figures(value: &AnyValue, places: &[Point3<f64>]) -> Option<Vec<Figure>> {
    let mesh = value.as_mesh()?;
    let (low, high) = mesh.bounds()?;
    let near_sq = (high - low).norm_squared() * 1e-4;
    fn is_near(vertex: &Point3<f64>, near_sq: f64, places: &[Point3<f64>]) -> bool {
        places.iter().any(|place| (place - vertex).norm_squared() <= near_sq)
    }
    let colors = mesh
        .positions()
        .iter()
        .map(|vertex| heat(f64::from(u8::from(is_near(vertex, near_sq, places)))));
    let mesh = color_vertices(&mesh, colors.collect())?;
    Some(
        CAMERAS
            .into_iter()
            .filter_map(|(yaw, pitch, words): (f64, f64, &str)| {
                let view = View { size: SIZE, yaw, pitch, ..View::front() };
                Figure::new(
                    format!("where it does not hold, in red, {words}"),
                    &[&render(&mesh, &view)],
                )
            })
            .collect(),
    )
}

fn color_vertices(mesh: &Mesh, colors: Vec<Rgb>) -> Option<Mesh> {
    let plain = mesh.clone().with_texture(None).without_attribute("color");
    plain.with_vertex("color", Attribute::Color(colors.into())).ok()
}

/// Returns a color for a number from 0 to 1: gray for 0, then yellow, and red for 1.
fn heat(x: f64) -> Rgb {
    const RAMP: [[f64; 3]; 4] =
        [[205.0, 208.0, 212.0], [247.0, 214.0, 92.0], [235.0, 110.0, 40.0], [170.0, 15.0, 30.0]];
    let x = if x.is_nan() { 1.0 } else { x.clamp(0.0, 1.0) } * 3.0;
    let before = (x as usize).min(2);
    let t = x - before as f64;
    [0, 1, 2].map(|k| (RAMP[before][k] * (1.0 - t) + RAMP[before + 1][k] * t).round() as u8)
}

/// Returns a picture that shows the differences of two pictures and is black where they are equal. Also returns the fraction of pixels that
/// differ.
fn difference(old: &Image, new: &Image) -> (Image, f64) {
    let mut count = 0;
    let pixels = old.pixels().iter().zip(new.pixels()).map(|(a, b)| {
        let largest = (0..3).map(|k| a[k].abs_diff(b[k])).max().unwrap_or(0);
        count += usize::from(largest > 0);
        // Begin at 0.3 of the color scale, so that even the smallest difference is visible.
        if largest == 0 { [0; 3] } else { heat(0.3 + 0.7 * f64::from(largest) / 255.0) }
    });
    let pixels: Vec<Rgb> = pixels.collect();
    let fraction = count as f64 / pixels.len().max(1) as f64;
    (Image::new(old.width(), old.height(), pixels).expect("one pixel per position"), fraction)
}

/// Reduces a picture to the given size of a stored picture, which contains only every n-th pixel.
fn shrink(picture: &Image, size: [usize; 2]) -> Image {
    let stride = picture.width().div_ceil(size[0].max(1)).max(1);
    if stride == 1 { picture.clone() } else { sample_picture(picture, stride) }
}

/// Returns the first column with one element for each cell of the value's grid, if the value has a grid.
fn grid_part(parts: &GoldenParts) -> Option<&GoldenColumn> {
    let row = parts.row.filter(|row| *row > 1)?;
    parts.columns.iter().find(|part| part.count.is_multiple_of(row) && part.count >= 2 * row)
}

/// Returns a column as a picture. Positions and numbers become shades of gray, scaled to the range of the column `scale`; labels become
/// colors. An element that was not stored gets the color of the last stored element before it.
fn column_picture(part: &GoldenColumn, row: Option<usize>, scale: &GoldenColumn) -> Option<Image> {
    let row = row?;
    let component = if part.class == Class::Position { part.width - 1 } else { 0 };
    let range = *scale.ranges().get(component)?;
    let (low, high) = range.map_or((0.0, 1.0), |range| (range.min, range.max));
    Image::new(
        row,
        part.count / row,
        (0..part.count)
            .map(|k: usize| match (part.element(k / part.stride)[component], part.class) {
                (0.0, Class::Exact) => [0; 3],
                (x, Class::Exact) => {
                    [97.0, 57.0, 149.0].map(|step| (64.0 + (x * step) % 192.0) as u8)
                }
                (x, _) if x.is_finite() => {
                    [(255.0 * (x - low) / (high - low).max(1e-300)).clamp(0.0, 255.0) as u8; 3]
                }
                _ => [60, 0, 60],
            })
            .collect::<Vec<_>>(),
    )
    .ok()
}
