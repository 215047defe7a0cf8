//! What a mesh is made of.

use nalgebra::Point3;

use super::{Faces, Mesh};
use crate::Hash;
use crate::frame::counts;
use crate::hostile::clouds;
use crate::{
    Attribute, CaptureFrame, Decoder, Encoder, Image, Layer, Material, Meaning, On, Part, Parts,
    PartsError, Pinhole, material,
};

/// Before the names of attributes of corners and faces; those of vertices are as they are.
const OF_CORNER: &str = "corner ";
const OF_FACE: &str = "face ";

/// The picture on it: tests see its size and its hash in a fact.
const TEXTURE: &str = "texture";
const TEXTURE_SIZE: &str = "texture size";
const TEXTURE_CAMERA: &str = "texture camera";

/// The materials, if more is known than one picture: their bytes.
const MATERIALS: &str = "materials";

pub(super) fn parts(mesh: &Mesh) -> Parts<'_> {
    let mut parts = Parts::default();
    let sides = mesh.faces.sides();
    fn text(text: Option<String>, instead: &str) -> String {
        text.unwrap_or_else(|| instead.to_owned())
    }
    parts.fact("vertices", mesh.positions.len());
    parts.fact("faces", mesh.faces.len());
    parts.fact("corners of a face", text(sides.map(|sides| sides.to_string()), "mixed"));
    parts.fact("texture", text(mesh.texture().map(in_words), "none"));
    if let Some(names) = names(&mesh.materials) {
        let hash = Hash::of(&Encoder::bytes(|to| material::encode(&mesh.materials, to)));
        parts.fact("materials", format!("{names}, {}", hash.short()));
    }
    if let Some(frame) = &mesh.frame {
        frame.push(&mut parts);
    }
    parts.push("position", On::Vertex, Meaning::Position, 3, &mesh.positions[..]);
    if sides.is_none() {
        let sides: Vec<_> = mesh.faces.iter().map(|face| face.len() as u32).collect();
        parts.push("sides", On::Face, Meaning::Exact, 1, sides);
    }
    let on = if sides.is_some() { On::Face } else { On::Corner };
    let corners = &mesh.faces.corners()[..];
    parts.push("corners", on, Meaning::Index, sides.unwrap_or(1), corners);
    parts.columns.extend(mesh.vertex.parts("", On::Vertex));
    parts.columns.extend(mesh.corner.parts(OF_CORNER, On::Corner));
    parts.columns.extend(mesh.face.parts(OF_FACE, On::Face));
    if !mesh.creases.is_empty() {
        let creases = mesh.creases().flat_map(|([a, b], sharp)| [a.into(), b.into(), sharp]);
        parts.push("creases", On::Edge, Meaning::Number, 3, Vec::<f64>::from_iter(creases));
    }
    if let Some(texture) = mesh.texture() {
        parts.push_aside(TEXTURE, On::Texel, Meaning::Level, 3, texture.pixels());
        let size = [texture.width(), texture.height()].map(|size| size as f64).to_vec();
        parts.push_aside(TEXTURE_SIZE, On::Whole, Meaning::Exact, 2, size);
        if let Some(camera) = texture.camera() {
            let numbers = camera.numbers();
            parts.push_aside(TEXTURE_CAMERA, On::Whole, Meaning::Number, 4, numbers);
        }
    }
    if names(&mesh.materials).is_some() {
        let bytes = Encoder::bytes(|to| material::encode(&mesh.materials, to));
        parts.push_aside(MATERIALS, On::Whole, Meaning::Exact, bytes.len(), bytes);
    }
    parts
}

/// The names of materials, if more is known of them than one picture.
pub(super) fn names(materials: &[Material]) -> Option<String> {
    let is_more = materials.len() > 1 || materials.iter().any(|it| !it.is_plain());
    let name =
        |it: &Material| if it.name.is_empty() { "(no name)".into() } else { it.name.clone() };
    is_more.then(|| materials.iter().map(name).collect::<Vec<_>>().join(", "))
}

/// A picture beside materials that is not that of the first one that has one.
#[derive(Debug, thiserror::Error)]
#[error("the part `{TEXTURE}` is not the picture in the part `{MATERIALS}`: leave one of them out")]
struct OtherTexture;

/// The size and the hash of a texture.
fn in_words(texture: &Image) -> String {
    let pixels: &[u8] = texture.pixels().as_flattened();
    let (width, height) = (texture.width(), texture.height());
    format!("{width} x {height}, {}", Hash::of(pixels).short())
}

/// Faces of several sizes have `sides`, a number for each, and `corners` of one number each; others have `corners` of as many numbers as
/// a face has corners. What else lies on vertices, corners and faces is an attribute.
pub(super) fn made_of(parts: &Parts<'_>) -> Result<Mesh, PartsError> {
    fn missing(part: &str) -> PartsError {
        PartsError::Missing { part: part.to_owned() }
    }
    let of = |on, name: &str| parts.on(on, name);
    let position = of(On::Vertex, "position").ok_or_else(|| missing("position"))?;
    let corners = of(On::Face, "corners").or_else(|| of(On::Corner, "corners"));
    let (corners, sides) = (corners.ok_or_else(|| missing("corners"))?, of(On::Face, "sides"));
    let faces = faces(corners, sides)?;
    let mut mesh = Mesh::new(position.places()?, faces).map_err(PartsError::refused)?;
    let own = [Some(position), Some(corners), sides];
    let is_own = |part| own.iter().flatten().any(|own| std::ptr::eq(*own, part));
    for part in parts.columns.iter().filter(|part| !is_own(*part)) {
        let name = |of: &str| part.name.strip_prefix(of).unwrap_or(&part.name);
        let attribute = || Attribute::of(part);
        let with = match part.on {
            On::Vertex => mesh.with_vertex(&part.name, attribute()?),
            On::Corner => mesh.with_corner(name(OF_CORNER), attribute()?),
            On::Face => mesh.with_face(name(OF_FACE), attribute()?),
            _ => Ok(mesh),
        };
        mesh = with.map_err(PartsError::refused)?;
    }
    if let Some(part) = of(On::Edge, "creases") {
        let mut creases = Vec::with_capacity(part.count());
        for (index, [a, b, sharpness]) in part.elements()?.into_iter().enumerate() {
            let ends = counts(part, 3 * index, [a, b])?.map(|end| end as u32);
            creases.push((ends, sharpness));
        }
        mesh = mesh.with_creases(creases).map_err(PartsError::refused)?;
    }
    let mesh = match of(On::Whole, MATERIALS) {
        Some(part) => {
            let bytes = part.with_width(part.items.len())?.small(u8::MAX)?;
            let materials = Decoder::of_bytes(&bytes, material::decode);
            let mesh = mesh.with_materials(materials.map_err(PartsError::refused)?);
            if mesh.texture() != texture(parts)?.as_ref() {
                return Err(PartsError::refused(OtherTexture));
            }
            mesh
        }
        None => mesh.with_texture(texture(parts)?),
    };
    Ok(mesh.with_frame(CaptureFrame::of(parts)?))
}

fn faces(corners: &Part<'_>, sides: Option<&Part<'_>>) -> Result<Faces, PartsError> {
    let faces = match sides {
        Some(sides) => {
            let sides = sides.with_width(1)?.whole()?;
            let sides: Vec<_> = sides.into_iter().map(|sides| sides as usize).collect();
            Faces::polygons(&sides, corners.with_width(1)?.whole()?)
        }
        None => Faces::uniform(corners.width, corners.whole()?),
    };
    faces.map_err(PartsError::refused)
}

fn texture(parts: &Parts<'_>) -> Result<Option<Image>, PartsError> {
    let Some(part) = parts.on(On::Texel, TEXTURE) else { return Ok(None) };
    let size = parts
        .on(On::Whole, TEXTURE_SIZE)
        .ok_or_else(|| PartsError::Missing { part: TEXTURE_SIZE.into() })?;
    let [width, height] = counts(size, 0, size.only()?)?;
    let texture = Image::new(width, height, part.colors()?).map_err(PartsError::refused)?;
    Ok(Some(texture.with_camera(Pinhole::of(parts, TEXTURE_CAMERA)?)))
}

pub(super) fn show(mesh: &Mesh) -> Vec<Layer> {
    vec![Layer::Triangles(Box::new(mesh.clone()))]
}

pub(super) fn hostile() -> Vec<Mesh> {
    let faces: [&[[u32; 3]]; 5] = [
        &[],
        &[[0, 1, 2]],
        // Three faces at an edge.
        &[[0, 1, 2], [1, 0, 3], [0, 1, 4]],
        // The same face twice, and turned round.
        &[[0, 1, 2], [0, 1, 2], [2, 1, 0]],
        // Two faces that share one vertex alone.
        &[[0, 1, 2], [2, 3, 4]],
    ];
    let meshes = faces.into_iter().flat_map(|faces| {
        clouds(5).into_iter().map(move |points| Mesh::new(points, Faces::triangles(faces.to_vec())))
    });
    let polygon = Faces::polygons(&[5], vec![0, 1, 2, 3, 4]);
    let polygon = polygon.into_iter().flat_map(|faces| Mesh::new(vec![Point3::origin(); 5], faces));
    let nothing = Mesh::new(Vec::new(), Faces::triangles(Vec::new()));
    meshes.flatten().chain(polygon).chain(nothing).collect()
}
