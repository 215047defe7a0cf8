//! Numbers that a mesh has, to be shown as colors.

use maquette_value::{Attribute, Mesh, On};
use nalgebra::Vector3;

use super::Shape;

/// Numbers that a mesh has, to be shown as colors.
#[derive(Clone)]
pub struct Field {
    pub name: String,
    /// Vertices, or corners or faces.
    pub on: On,
    /// The least and the greatest of them.
    pub range: [f64; 2],
    /// What most of them are between: a few that are far off leave colors for the rest.
    pub usual: [f64; 2],
}

impl Shape {
    /// The numbers of a field: for each vertex here if it is one of vertices, else for each corner of each triangle.
    pub fn field(&self, field: &Field) -> Vec<f32> {
        let attributes = match field.on {
            On::Vertex => self.mesh.vertex(),
            On::Corner => self.mesh.corner(),
            _ => self.mesh.face(),
        };
        let numbers = attributes.get(&field.name).and_then(numbers_of);
        let numbers: Vec<_> = numbers.into_iter().flatten().map(|x| x as f32).collect();
        if field.on == On::Vertex {
            return self.origins.iter().map(|&vertex| numbers[vertex as usize]).collect();
        }
        let mut first = 0;
        let mut all = Vec::with_capacity(3 * self.triangles.len());
        for (face, corners) in self.mesh.faces().iter().enumerate() {
            for k in 1..corners.len() - 1 {
                match field.on {
                    On::Corner => all.extend([0, k, k + 1].map(|k: usize| numbers[first + k])),
                    _ => all.extend([numbers[face]; 3]),
                }
            }
            first += corners.len();
        }
        all
    }
}

/// The numbers that a mesh has beside those which are seen anyway.
pub(super) fn fields_of(mesh: &Mesh) -> Vec<Field> {
    let all = [(On::Vertex, mesh.vertex()), (On::Corner, mesh.corner()), (On::Face, mesh.face())];
    let named = all.into_iter().flat_map(|(on, attributes)| {
        attributes.iter().map(move |(name, attribute)| (on, name, attribute))
    });
    fn field((on, name, attribute): (On, &str, &Attribute)) -> Option<Field> {
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
        Some(Field { name, on, range, usual })
    }
    named.filter_map(field).collect()
}

/// The numbers of an attribute, lengths of vectors among them; none of colors and pairs.
fn numbers_of(attribute: &Attribute) -> Option<Box<dyn Iterator<Item = f64> + '_>> {
    Some(match attribute {
        Attribute::Number(column) => Box::new(column.iter().copied()),
        Attribute::Index(column) => Box::new(column.iter().map(|&x| f64::from(x))),
        Attribute::Flag(column) => Box::new(column.iter().map(|&x| f64::from(x))),
        Attribute::Vector(column) => Box::new(column.iter().map(|&x| Vector3::from(x).norm())),
        Attribute::Pair(_) | Attribute::Color(_) => return None,
    })
}
