//! The implementation of `Value` for meshes.

use std::sync::Arc;

use nalgebra::Point3;

use super::properties::PROPERTIES;
use super::{Faces, Mesh, describe_bounds};
use crate::content::{Content, content_of_fields};
use crate::edge_cases::{odd_solids, point_sets};
use crate::frame::counts;
use crate::{
    Attribute, Attributes, CaptureFrame, Decoder, ElementKind, Elements, Encoder, Hash, Image,
    Layer, Material, Meaning, Part, Parts, PartsError, Pinhole, Property, Summary, Value,
};

/// The prefixes of the names of corner and face attributes. Vertex attributes have no prefix.
const OF_CORNER: &str = "corner ";
const OF_FACE: &str = "face ";

/// The name of the part that holds the texture. Tests ignore this part, because a fact has the texture's size and hash.
const TEXTURE: &str = "texture";
const TEXTURE_SIZE: &str = "texture size";
const TEXTURE_CAMERA: &str = "texture camera";

/// The name of the part that holds the encoded materials. The part is missing if there is no material, or only one that is a plain picture.
const MATERIALS: &str = "materials";

impl Value for Mesh {
    const NAME: &'static str = "Mesh";

    content_of_fields! { positions faces vertex corner face creases materials frame derived }

    fn properties() -> &'static [Property<Self>] {
        PROPERTIES
    }

    fn describe(&self) -> Summary {
        let edges = self.edges();
        let (vertices, faces) = (self.positions.len(), self.faces.len());
        let euler = vertices as i64 - edges.vertices.len() as i64 + faces as i64;
        // The sum starts from 0.0 with `fold`, because `sum` of an empty iterator is -0.0.
        let area = self.faces.iter().fold(0.0, |sum, face| sum + self.area_vector(face).norm());
        let attributes: Vec<&str> = [&self.vertex, &self.corner, &self.face]
            .into_iter()
            .flat_map(Attributes::iter)
            .map(|(name, _)| name)
            .collect();
        let summary = Summary::default()
            .with_fact("vertices", vertices)
            .with_fact("faces", faces)
            .with_fact("edges", edges.vertices.len())
            .with_fact("boundary edges", edges.faces.iter().filter(|&&n| n == 1).count())
            .with_fact("non-manifold edges", edges.faces.iter().filter(|&&n| n > 2).count())
            .with_fact("misoriented edges", edges.misoriented)
            .with_fact("Euler characteristic", euler)
            .with_fact("area", area)
            .with_histogram(
                "edge length",
                edges.vertices.iter().map(|&[a, b]| {
                    (self.positions[a as usize] - self.positions[b as usize]).norm()
                }),
            )
            .with_fact("attributes", attributes.join(", "));
        let summary = match self.texture() {
            Some(texture) => {
                summary.with_fact("texture", format!("{} x {}", texture.width(), texture.height()))
            }
            None => summary,
        };
        let summary = match names(&self.materials) {
            Some(names) => summary.with_fact("materials", names),
            None => summary,
        };
        describe_bounds(summary, self.positions.iter())
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        let sides = self.faces.sides();
        parts.fact("vertices", self.positions.len());
        parts.fact("faces", self.faces.len());
        parts.fact(
            "corners of a face",
            sides.map_or_else(|| "mixed".to_owned(), |sides| sides.to_string()),
        );
        parts.fact("texture", self.texture().map_or_else(|| "none".to_owned(), in_words));
        if let Some(names) = names(&self.materials) {
            let hash = Hash::compute(&Encoder::bytes(|to| self.materials.encode(to)));
            parts.fact("materials", format!("{names}, {}", hash.short()));
        }
        if let Some(frame) = &self.frame {
            frame.push(&mut parts);
        }
        parts.push("position", ElementKind::Vertex, Meaning::Position, 3, &self.positions[..]);
        if sides.is_none() {
            let sides: Vec<_> = self.faces.iter().map(|face| face.len() as u32).collect();
            parts.push("sides", ElementKind::Face, Meaning::Exact, 1, sides);
        }
        let on = if sides.is_some() { ElementKind::Face } else { ElementKind::Corner };
        let corners = &self.faces.corners()[..];
        parts.push("corners", on, Meaning::Index, sides.unwrap_or(1), corners);
        parts.columns.extend(self.vertex.parts("", ElementKind::Vertex));
        parts.columns.extend(self.corner.parts(OF_CORNER, ElementKind::Corner));
        parts.columns.extend(self.face.parts(OF_FACE, ElementKind::Face));
        if !self.creases.is_empty() {
            let creases = self.creases().flat_map(|([a, b], sharp)| [a.into(), b.into(), sharp]);
            parts.push(
                "creases",
                ElementKind::Edge,
                Meaning::Number,
                3,
                Vec::<f64>::from_iter(creases),
            );
        }
        if let Some(texture) = self.texture() {
            parts.push_hidden(TEXTURE, ElementKind::Texel, Meaning::Level, 3, texture.pixels());
            let size = [texture.width(), texture.height()].map(|size| size as f64).to_vec();
            parts.push_hidden(TEXTURE_SIZE, ElementKind::Whole, Meaning::Exact, 2, size);
            if let Some(camera) = texture.camera() {
                let numbers = camera.numbers();
                parts.push_hidden(TEXTURE_CAMERA, ElementKind::Whole, Meaning::Number, 4, numbers);
            }
        }
        if names(&self.materials).is_some() {
            let bytes = Encoder::bytes(|to| self.materials.encode(to));
            parts.push_hidden(MATERIALS, ElementKind::Whole, Meaning::Exact, bytes.len(), bytes);
        }
        parts
    }

    /// Builds a mesh from parts. If all faces have equally many corners, the column `corners` has that many numbers per face. If not, the
    /// column `sides` has the number of corners of each face, and `corners` has one number per corner. All other columns of vertices,
    /// corners and faces are attributes.
    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let position = parts
            .find(ElementKind::Vertex, "position")
            .ok_or_else(|| PartsError::missing("position"))?;
        let corners = parts
            .find(ElementKind::Face, "corners")
            .or_else(|| parts.find(ElementKind::Corner, "corners"))
            .ok_or_else(|| PartsError::missing("corners"))?;
        let sides = parts.find(ElementKind::Face, "sides");
        let faces = faces(corners, sides)?;
        let mut mesh = Self::new(position.to_points()?, faces).map_err(PartsError::from_error)?;
        let own = [Some(position), Some(corners), sides];
        for part in &parts.columns {
            if own.iter().flatten().any(|own| std::ptr::eq(*own, part)) {
                continue;
            }
            let prefix = match part.element_kind {
                ElementKind::Vertex => "",
                ElementKind::Corner => OF_CORNER,
                ElementKind::Face => OF_FACE,
                _ => continue,
            };
            let name = part.name.strip_prefix(prefix).unwrap_or(&part.name);
            let attribute = Attribute::from_part(part)?;
            let with_attribute = match part.element_kind {
                ElementKind::Vertex => mesh.with_vertex(name, attribute),
                ElementKind::Corner => mesh.with_corner(name, attribute),
                _ => mesh.with_face(name, attribute),
            };
            mesh = with_attribute.map_err(PartsError::from_error)?;
        }
        if let Some(part) = parts.find(ElementKind::Edge, "creases") {
            let mut creases = Vec::with_capacity(part.count());
            for (index, [a, b, sharpness]) in part.elements()?.into_iter().enumerate() {
                let ends = counts(part, 3 * index, [a, b])?.map(|end| end as u32);
                creases.push((ends, sharpness));
            }
            mesh = mesh.with_creases(creases).map_err(PartsError::from_error)?;
        }
        let mesh = match parts.find(ElementKind::Whole, MATERIALS) {
            Some(part) => {
                let bytes = part.with_width(part.items.len())?.to_u8(u8::MAX)?;
                let materials = Decoder::of_bytes(&bytes, Arc::decode);
                let mesh = mesh.with_materials(materials.map_err(PartsError::from_error)?);
                if mesh.texture() != texture(parts)?.as_ref() {
                    return Err(PartsError::from_error(OtherTexture));
                }
                mesh
            }
            None => mesh.with_texture(texture(parts)?),
        };
        Ok(mesh.with_frame(CaptureFrame::from_parts(parts)?))
    }

    fn elements() -> Vec<Elements<Self>> {
        super::elements::elements()
    }

    fn show(&self) -> Vec<Layer> {
        vec![Layer::Triangles(Box::new(self.clone()))]
    }

    fn edge_cases() -> Vec<Self> {
        let faces: [&[[u32; 3]]; 5] = [
            &[],
            &[[0, 1, 2]],
            // Three faces at one edge.
            &[[0, 1, 2], [1, 0, 3], [0, 1, 4]],
            // The same face twice, and once reversed.
            &[[0, 1, 2], [0, 1, 2], [2, 1, 0]],
            // Two faces that share only one vertex.
            &[[0, 1, 2], [2, 3, 4]],
        ];
        let meshes = faces.into_iter().flat_map(|faces| {
            point_sets(5)
                .into_iter()
                .map(move |points| Self::new(points, Faces::triangles(faces.to_vec())))
        });
        let polygon = Faces::polygons(&[5], vec![0, 1, 2, 3, 4]);
        let polygon =
            polygon.into_iter().flat_map(|faces| Self::new(vec![Point3::origin(); 5], faces));
        let nothing = Self::new(Vec::new(), Faces::triangles(Vec::new()));
        let solids = odd_solids().into_iter();
        let solids = solids.flat_map(|(points, faces)| Self::new(points, Faces::triangles(faces)));
        meshes.flatten().chain(polygon).chain(nothing).chain(solids).collect()
    }
}

/// Returns the names of the materials. `None` if there is no material, or only a single plain picture.
fn names(materials: &[Material]) -> Option<String> {
    let is_more = materials.len() > 1 || materials.iter().any(|it| !it.is_plain());
    is_more.then(|| {
        let names =
            materials.iter().map(|it| if it.name.is_empty() { "(no name)" } else { &it.name });
        names.collect::<Vec<_>>().join(", ")
    })
}

/// Error of building a mesh from parts: the texture differs from the picture of the first material that has a picture.
#[derive(Debug, thiserror::Error)]
#[error("the part `{TEXTURE}` is not the picture in the part `{MATERIALS}`: remove one of them")]
struct OtherTexture;

/// The size and the hash of a texture.
fn in_words(texture: &Image) -> String {
    let pixels: &[u8] = texture.pixels().as_flattened();
    let (width, height) = (texture.width(), texture.height());
    format!("{width} x {height}, {}", Hash::compute(pixels).short())
}

fn faces(corners: &Part<'_>, sides: Option<&Part<'_>>) -> Result<Faces, PartsError> {
    let faces = match sides {
        Some(sides) => {
            let sides = sides.with_width(1)?.to_u32()?;
            let sides: Vec<_> = sides.into_iter().map(|sides| sides as usize).collect();
            Faces::polygons(&sides, corners.with_width(1)?.to_u32()?)
        }
        None => Faces::uniform(corners.width, corners.to_u32()?),
    };
    faces.map_err(PartsError::from_error)
}

fn texture(parts: &Parts<'_>) -> Result<Option<Image>, PartsError> {
    let Some(part) = parts.find(ElementKind::Texel, TEXTURE) else { return Ok(None) };
    let size = parts
        .find(ElementKind::Whole, TEXTURE_SIZE)
        .ok_or_else(|| PartsError::missing(TEXTURE_SIZE))?;
    let [width, height] = counts(size, 0, size.single()?)?;
    let texture = Image::new(width, height, part.colors()?).map_err(PartsError::from_error)?;
    Ok(Some(texture.with_camera(Pinhole::from_parts(parts, TEXTURE_CAMERA)?)))
}
