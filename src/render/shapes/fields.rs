//! Fields: numeric attributes of a mesh that viewers show as colors.

use maquette_value::{Attribute, ElementKind, Mesh};
use nalgebra::Vector3;

use super::Shape;

/// A numeric attribute of a mesh, which viewers can show as colors.
#[derive(Clone)]
pub struct Field {
    pub name: String,
    /// The kind of elements to which the attribute belongs: vertices, corners or faces.
    pub element_kind: ElementKind,
    /// The minimum and the maximum of the attribute.
    pub range: [f64; 2],
    /// The range of most of the numbers. Outliers are excluded, because they would use up the color scale.
    pub typical_range: [f64; 2],
}

impl Shape {
    /// Returns the numbers of a field. There is one per display vertex if the attribute belongs to vertices, otherwise one per corner of
    /// each triangle.
    pub fn field(&self, field: &Field) -> Vec<f32> {
        let attributes = match field.element_kind {
            ElementKind::Vertex => self.mesh.vertex(),
            ElementKind::Corner => self.mesh.corner(),
            _ => self.mesh.face(),
        };
        let numbers = attributes.get(&field.name).and_then(numbers_of);
        let numbers: Vec<_> = numbers.into_iter().flatten().map(|x| x as f32).collect();
        if field.element_kind == ElementKind::Vertex {
            return self.origins.iter().map(|&vertex| numbers[vertex as usize]).collect();
        }
        let mut first = 0;
        let mut all = Vec::with_capacity(3 * self.triangles.len());
        for (face, corners) in self.mesh.faces().iter().enumerate() {
            for k in 1..corners.len() - 1 {
                match field.element_kind {
                    ElementKind::Corner => {
                        all.extend([0, k, k + 1].map(|k: usize| numbers[first + k]));
                    }
                    _ => all.extend([numbers[face]; 3]),
                }
            }
            first += corners.len();
        }
        all
    }
}

/// Returns the numeric attributes of a mesh as fields. Normals are left out, because viewers show them as shading.
pub(super) fn fields_of(mesh: &Mesh) -> Vec<Field> {
    let all = [
        (ElementKind::Vertex, mesh.vertex()),
        (ElementKind::Corner, mesh.corner()),
        (ElementKind::Face, mesh.face()),
    ];
    let named = all.into_iter().flat_map(|(on, attributes)| {
        attributes.iter().map(move |(name, attribute)| (on, name, attribute))
    });
    fn field((on, name, attribute): (ElementKind, &str, &Attribute)) -> Option<Field> {
        if name == "normal" {
            return None;
        }
        let mut numbers: Vec<_> = numbers_of(attribute)?.filter(|x| x.is_finite()).collect();
        let range = numbers
            .iter()
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], &x| [a.min(x), b.max(x)]);
        if numbers.is_empty() {
            return None;
        }
        let tenth = (numbers.len() - 1) / 10;
        let last = numbers.len() - 1 - tenth;
        let low = *numbers.select_nth_unstable_by(tenth, f64::total_cmp).1;
        let high = *numbers.select_nth_unstable_by(last, f64::total_cmp).1;
        let more = (high - low) / 2.0;
        let usual = [range[0].max(low - more), range[1].min(high + more)];
        let usual = if low < high { usual } else { range };
        let name = name.to_owned();
        Some(Field { name, element_kind: on, range, typical_range: usual })
    }
    named.filter_map(field).collect()
}

/// Returns the numbers of an attribute. For vectors these are their lengths. Returns `None` for colors and pairs.
fn numbers_of(attribute: &Attribute) -> Option<Box<dyn Iterator<Item = f64> + '_>> {
    Some(match attribute {
        Attribute::Number(column) => Box::new(column.iter().copied()),
        Attribute::Index(column) => Box::new(column.iter().map(|&x| f64::from(x))),
        Attribute::Flag(column) => Box::new(column.iter().map(|&x| f64::from(x))),
        Attribute::Vector(column) => Box::new(column.iter().map(|&x| Vector3::from(x).norm())),
        Attribute::Pair(_) | Attribute::Color(_) => return None,
    })
}
