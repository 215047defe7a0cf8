//! The implementation of `Value` for meshes.

use super::super::{Attributes, Elements, Layer, Parts, PartsError, Property, Summary, Value};
use super::properties::PROPERTIES;
use super::{Mesh, describe_bounds, parts};
use crate::content::content_of_fields;

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
        let summary = match parts::names(&self.materials) {
            Some(names) => summary.with_fact("materials", names),
            None => summary,
        };
        describe_bounds(summary, self.positions.iter())
    }

    fn parts(&self) -> Parts<'_> {
        parts::parts(self)
    }

    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        parts::made_of(parts)
    }

    fn elements() -> Vec<Elements<Self>> {
        super::elements::elements()
    }

    fn show(&self) -> Vec<Layer> {
        parts::show(self)
    }

    fn edge_cases() -> Vec<Self> {
        parts::edge_cases()
    }
}
