//! Pictures for the report: what was, what is, and how far apart they are.

use maquette_engine::distances::distances;
use maquette_engine::six::six;
use maquette_format::png;
use maquette_render::{View, render};
use maquette_value::{AnyValue, Attribute, Image, Mesh, Rgb};
use nalgebra::Point3;

use super::Compared;
use crate::parts::{Class, GoldenColumn, GoldenParts};
use crate::store::{Golden, every, picture_of};

/// A picture with its caption; two are shown in turn.
pub(crate) struct Figure {
    pub(crate) caption: String,
    pub(crate) pictures: Vec<Vec<u8>>,
}

/// From where meshes are looked at: yaw, pitch, in words.
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

/// The pictures of an output that is not as it was.
pub(crate) fn figures(output: &Compared) -> Vec<Figure> {
    let golden = output.golden.as_ref().ok();
    if let Some(mesh) = output.value.as_mesh() {
        return of_mesh(&mesh, golden);
    }
    let (old, new) = pictures(&output.value, golden);
    let Some(new) = new else { return Vec::new() };
    let Some(old) = old else {
        return Figure::new("new", &[&new]).into_iter().collect();
    };
    let mut figures = vec![Figure::new("old", &[&old]), Figure::new("new", &[&new])];
    if (old.width(), old.height()) == (new.width(), new.height()) {
        let (picture, share) = difference(&old, &new);
        let caption = format!("difference: {} % of the pixels", six(100.0 * share));
        figures.push(Figure::new(caption, &[&picture]));
        figures.push(Figure::new("old and new in turn", &[&old, &new]));
    }
    figures.into_iter().flatten().collect()
}

/// The golden and the new value as pictures, both with only those elements that were kept.
fn pictures(value: &AnyValue, golden: Option<&Golden>) -> (Option<Image>, Option<Image>) {
    if let Some(new) = picture_of(value) {
        let old = golden.and_then(Golden::picture);
        let size = old.map_or([0, 0], |old| [old.width(), old.height()]);
        let new = if old.is_some() { shrunk(&new, size) } else { new };
        return (old.cloned(), Some(new));
    }
    let Some(parts) = GoldenParts::of(value) else { return (None, None) };
    let Some(part) = grid_part(&parts) else { return (None, None) };
    let kept = golden.and_then(Golden::kept).and_then(|kept| kept.column(&part.name));
    let Some(kept) = kept
        .map(|kept| &kept.part)
        .filter(|kept| kept.count == part.count && kept.width == part.width)
    else {
        return (None, gray(part, parts.row, part));
    };
    (gray(kept, parts.row, kept), gray(&part.every(kept.stride), parts.row, kept))
}

fn of_mesh(new: &Mesh, golden: Option<&Golden>) -> Vec<Figure> {
    // Both are seen from the same side.
    let old = golden.and_then(Golden::mesh).map(|old| old.with_frame(new.frame().copied()));
    let far = match (&old, golden) {
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
        if let Some(far) = &far {
            let most = far.iter().copied().filter(|x| x.is_finite()).fold(0.0, f64::max);
            let colors = far.iter().map(|&x| heat(if most > 0.0 { x / most } else { 0.0 }));
            let picture = colored(new, colors.collect()).map(|mesh| render(&mesh, &view));
            let caption = format!("distance to the old one, {words}: gray 0, red {} mm", six(most));
            figures.extend(picture.map(|picture| Figure::new(caption, &[&picture])));
        }
    }
    if let (None, Some(view)) = (&old, golden.and_then(Golden::picture)) {
        figures.insert(0, Figure::new("old, from the front", &[view]));
    }
    figures.into_iter().flatten().collect()
}

/// A mesh or surface with the vertices near some places in red.
pub(crate) fn marked(value: &AnyValue, places: &[Point3<f64>]) -> Option<Vec<Figure>> {
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
    let mesh = colored(&mesh, colors.collect())?;
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

fn colored(mesh: &Mesh, colors: Vec<Rgb>) -> Option<Mesh> {
    let plain = mesh.clone().with_texture(None).without("color");
    plain.with_vertex("color", Attribute::Color(colors.into())).ok()
}

/// From gray (0) over yellow to red (1).
fn heat(x: f64) -> Rgb {
    const RAMP: [[f64; 3]; 4] =
        [[205.0, 208.0, 212.0], [247.0, 214.0, 92.0], [235.0, 110.0, 40.0], [170.0, 15.0, 30.0]];
    let x = if x.is_nan() { 1.0 } else { x.clamp(0.0, 1.0) } * 3.0;
    let before = (x as usize).min(2);
    let t = x - before as f64;
    [0, 1, 2].map(|k| (RAMP[before][k] * (1.0 - t) + RAMP[before + 1][k] * t).round() as u8)
}

/// Where two pictures differ: black where they do not.
fn difference(old: &Image, new: &Image) -> (Image, f64) {
    let mut count = 0;
    let pixels = old.pixels().iter().zip(new.pixels()).map(|(a, b)| {
        let most = (0..3).map(|k| a[k].abs_diff(b[k])).max().unwrap_or(0);
        count += usize::from(most > 0);
        // The least difference is seen, too.
        if most == 0 { [0; 3] } else { heat(0.3 + 0.7 * f64::from(most) / 255.0) }
    });
    let pixels: Vec<Rgb> = pixels.collect();
    let share = count as f64 / pixels.len().max(1) as f64;
    (Image::new(old.width(), old.height(), pixels).expect("a pixel for each place"), share)
}

/// The same picture with as many pixels as one of which only some are known.
fn shrunk(picture: &Image, size: [usize; 2]) -> Image {
    let stride = picture.width().div_ceil(size[0].max(1)).max(1);
    if stride == 1 { picture.clone() } else { every(picture, stride) }
}

/// The first column that fills a grid.
fn grid_part(parts: &GoldenParts) -> Option<&GoldenColumn> {
    let row = parts.row.filter(|row| *row > 1)?;
    parts.columns.iter().find(|part| part.count.is_multiple_of(row) && part.count >= 2 * row)
}

/// A column as a picture: depths and numbers in gray, as far as those of `scale` reach, labels in colors. What was not kept is as
/// what was kept before it.
fn gray(part: &GoldenColumn, row: Option<usize>, scale: &GoldenColumn) -> Option<Image> {
    let row = row?;
    let component = if part.class == Class::Place { part.width - 1 } else { 0 };
    let range = *scale.ranges().get(component)?;
    let (low, high) = range.map_or((0.0, 1.0), |range| (range.least, range.greatest));
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
