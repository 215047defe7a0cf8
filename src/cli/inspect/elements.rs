//! Represents the elements of a value, such as the faces of a mesh, as a table: one row per element, and named columns.

use std::borrow::Cow;

use maquette_value::{AnyValue, ElementKind, Meaning, Mesh, Part};
use nalgebra::{Point3, center};

/// The maximum number of components of a data column that the table shows. Each component becomes a column of the table.
const MAX_WIDTH: usize = 16;

/// A column of the table: one number for each element.
pub(super) struct Numbers {
    pub(super) name: String,
    pub(super) numbers: Vec<f64>,
}

/// All elements of one kind in a value.
pub(super) struct Elements {
    pub(super) on: ElementKind,
    pub(super) count: usize,
    pub(super) columns: Vec<Numbers>,
}

impl Elements {
    /// Returns the elements of the kind `on`, or `None` if the value has none.
    pub(super) fn from_value(value: &AnyValue, on: ElementKind) -> Option<Self> {
        let parts = value.parts();
        let mesh = value.get::<Mesh>();
        // Leave out the edge data of a mesh, which exists only for creases. The table lists all edges of the topology.
        let parts_of: Vec<_> = parts
            .columns
            .iter()
            .filter(|part| part.element_kind == on && !(on == ElementKind::Edge && mesh.is_some()))
            .collect();
        let derived = mesh.map_or_else(Vec::new, |mesh| derived_columns(mesh, on));
        let count = parts_of.first().map(|part| part.count());
        let count = count.or_else(|| derived.first().map(|column| column.numbers.len()))?;
        let mut elements = Self { on, count, columns: Vec::new() };
        elements.push("index", (0..count).map(|index| index as f64).collect());
        if let (ElementKind::Pixel | ElementKind::Texel, Some(row)) =
            (on, parts.row.filter(|row| *row > 0))
        {
            elements.push("column", (0..count).map(|index| (index % row) as f64).collect());
            elements.push("row", (0..count).map(|index| (index / row) as f64).collect());
        }
        for part in parts_of.iter().filter(|part| part.width <= MAX_WIDTH && part.count() == count)
        {
            let numbers = part.items.numbers();
            let names =
                column_names(part, elements.columns.iter().all(|column| column.name != "x"));
            for (component, name) in names.into_iter().enumerate() {
                let numbers = numbers.iter().skip(component).step_by(part.width).copied();
                elements.push(name, numbers.collect());
            }
        }
        derived.into_iter().for_each(|column| elements.push(column.name, column.numbers));
        Some(elements)
    }

    /// Adds a column, unless a column with this name exists.
    fn push(&mut self, name: impl Into<String>, numbers: Vec<f64>) {
        let name = name.into();
        if self.columns.iter().all(|column| column.name != name) {
            self.columns.push(Numbers { name, numbers });
        }
    }

    pub(super) fn column(&self, name: &str) -> Option<&Numbers> {
        self.columns.iter().find(|column| column.name == name)
    }

    pub(super) fn names(&self) -> Vec<&str> {
        self.columns.iter().map(|column| &column.name[..]).collect()
    }
}

/// Returns the kinds of elements that a value has.
pub(super) fn kinds(value: &AnyValue) -> Vec<ElementKind> {
    let mut kinds = Vec::new();
    let of_parts: Vec<_> = value.parts().columns.iter().map(|part| part.element_kind).collect();
    let of_mesh = [ElementKind::Vertex, ElementKind::Face, ElementKind::Edge, ElementKind::Corner];
    let of_mesh = of_mesh.into_iter().filter(|_| value.get::<Mesh>().is_some());
    for on in of_mesh.chain(of_parts) {
        if !kinds.contains(&on) {
            kinds.push(on);
        }
    }
    kinds
}

/// Returns the plural of an element kind.
pub(super) fn plural(on: ElementKind) -> &'static str {
    match on {
        ElementKind::Vertex => "vertices",
        ElementKind::Corner => "corners",
        ElementKind::Face => "faces",
        ElementKind::Edge => "edges",
        ElementKind::Pixel => "pixels",
        ElementKind::Texel => "texels",
        ElementKind::Point => "points",
        ElementKind::Step => "steps",
        ElementKind::Entry => "entries",
        ElementKind::Whole => "whole",
    }
}

/// Returns the names of the table columns for a data column. The first column of positions becomes `x`, `y`, `z`; any other column becomes
/// `NAME_x` and so on.
fn column_names(part: &Part<'_>, is_first: bool) -> Vec<String> {
    let own = ["face ", "corner "].iter().find_map(|of| part.name.strip_prefix(of));
    let own = own.map_or_else(|| part.name.clone(), Cow::Borrowed);
    let name = String::from_iter(
        own.chars().map(|c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' }),
    );
    let suffixes: &[&str] = match (part.width, part.meaning) {
        (1, _) => return vec![name],
        (2, _) => &["u", "v"],
        (3, Meaning::Position) if is_first => return ["x", "y", "z"].map(str::to_owned).to_vec(),
        (3, Meaning::Position | Meaning::Direction | Meaning::Number) => &["x", "y", "z"],
        (3, Meaning::Level) => &["red", "green", "blue"],
        (width, _) => return (1..=width).map(|k| format!("{name}_{k}")).collect(),
    };
    suffixes.iter().map(|suffix| format!("{name}_{suffix}")).collect()
}

/// Returns the columns that are computed from the topology and positions of a mesh.
fn derived_columns(mesh: &Mesh, on: ElementKind) -> Vec<Numbers> {
    match on {
        ElementKind::Face => face_columns(mesh),
        ElementKind::Edge => edge_columns(mesh),
        ElementKind::Corner => corner_columns(mesh),
        _ => Vec::new(),
    }
}

fn column(name: &str, numbers: impl Iterator<Item = f64>) -> Numbers {
    Numbers { name: name.to_owned(), numbers: numbers.collect() }
}

fn position_columns(places: &[Point3<f64>]) -> [Numbers; 3] {
    ["x", "y", "z"].map(|name| {
        let axis = usize::from(name.as_bytes()[0] - b'x');
        column(name, places.iter().map(|place| place[axis]))
    })
}

/// Returns the columns of the table of faces: center, area in mm^2, unit normal, and number of corners.
fn face_columns(mesh: &Mesh) -> Vec<Numbers> {
    let mut columns = Vec::from(position_columns(
        &mesh
            .faces()
            .iter()
            .map(|face| {
                let sum: nalgebra::Vector3<f64> =
                    face.iter().map(|vertex| mesh.positions()[*vertex as usize].coords).sum();
                Point3::from(sum / face.len() as f64)
            })
            .collect::<Vec<_>>(),
    ));
    let areas: Vec<_> = mesh.faces().iter().map(|face| mesh.area_vector(face)).collect();
    columns.push(column("area", areas.iter().map(nalgebra::Vector3::norm)));
    for (axis, name) in ["normal_x", "normal_y", "normal_z"].into_iter().enumerate() {
        columns.push(column(
            name,
            areas.iter().map(|area| area.try_normalize(0.0).map_or(0.0, |n| n[axis])),
        ));
    }
    columns.push(column("sides", mesh.faces().iter().map(|face| face.len() as f64)));
    columns
}

/// Returns the columns of the table of edges: end vertices, midpoint, length in mm, number of adjacent faces, and crease sharpness.
fn edge_columns(mesh: &Mesh) -> Vec<Numbers> {
    let edges = mesh.edges();
    fn position(vertex: u32, mesh: &Mesh) -> Point3<f64> {
        mesh.positions()[vertex as usize]
    }
    let ends = &edges.vertices;
    let mut columns = vec![
        column("from", ends.iter().map(|edge| f64::from(edge[0]))),
        column("to", ends.iter().map(|edge| f64::from(edge[1]))),
    ];
    let middles: Vec<_> =
        ends.iter().map(|&[a, b]| center(&position(a, mesh), &position(b, mesh))).collect();
    columns.extend(position_columns(&middles));
    columns.push(column(
        "length",
        ends.iter().map(|&[a, b]| (position(b, mesh) - position(a, mesh)).norm()),
    ));
    columns.push(column("faces", edges.faces.iter().map(|count| f64::from(*count))));
    if mesh.creases().len() > 0 {
        let creases = std::collections::HashMap::<_, _>::from_iter(mesh.creases());
        columns.push(column(
            "sharpness",
            ends.iter().map(|edge| creases.get(edge).copied().unwrap_or(0.0)),
        ));
    }
    columns
}

/// Returns the columns of the table of corners: face, vertex and position.
fn corner_columns(mesh: &Mesh) -> Vec<Numbers> {
    let faces = mesh.faces().iter().enumerate();
    let face = faces.flat_map(|(index, face)| face.iter().map(move |_| index as f64));
    let corners = mesh.faces().corners();
    let mut columns = vec![column("face", face)];
    columns.push(column("vertex", corners.iter().map(|vertex| f64::from(*vertex))));
    columns.extend(position_columns(
        &corners.iter().map(|vertex| mesh.positions()[*vertex as usize]).collect::<Vec<_>>(),
    ));
    columns
}
