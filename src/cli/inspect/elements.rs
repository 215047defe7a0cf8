//! The elements of a value as rows: what their columns are called, and the numbers in them.

use std::borrow::Cow;

use maquette_value::{AnyValue, Meaning, Mesh, On, Part};
use nalgebra::{Point3, center};

/// Elements of more numbers than this are no columns of a table.
const WIDEST: usize = 16;

/// A number for each element.
pub(super) struct Numbers {
    pub(super) name: String,
    pub(super) numbers: Vec<f64>,
}

/// All elements of one kind of a value.
pub(super) struct Elements {
    pub(super) on: On,
    pub(super) count: usize,
    pub(super) columns: Vec<Numbers>,
}

impl Elements {
    /// The elements of this kind; none if the value has no such.
    pub(super) fn of(value: &AnyValue, on: On) -> Option<Self> {
        let parts = value.parts();
        let mesh = value.get::<Mesh>();
        // The edges of a mesh are more than those with a crease.
        let parts_of: Vec<_> = parts
            .columns
            .iter()
            .filter(|part| part.on == on && !(on == On::Edge && mesh.is_some()))
            .collect();
        let derived = mesh.map_or_else(Vec::new, |mesh| derived(mesh, on));
        let count = parts_of.first().map(|part| part.count());
        let count = count.or_else(|| derived.first().map(|column| column.numbers.len()))?;
        let mut elements = Self { on, count, columns: Vec::new() };
        elements.push("index", (0..count).map(|index| index as f64).collect());
        if let (On::Pixel | On::Texel, Some(row)) = (on, parts.row.filter(|row| *row > 0)) {
            elements.push("column", (0..count).map(|index| (index % row) as f64).collect());
            elements.push("row", (0..count).map(|index| (index / row) as f64).collect());
        }
        for part in parts_of.iter().filter(|part| part.width <= WIDEST && part.count() == count) {
            let numbers = part.items.numbers();
            let names = names(part, elements.columns.iter().all(|column| column.name != "x"));
            for (component, name) in names.into_iter().enumerate() {
                let numbers = numbers.iter().skip(component).step_by(part.width).copied();
                elements.push(name, numbers.collect());
            }
        }
        derived.into_iter().for_each(|column| elements.push(column.name, column.numbers));
        Some(elements)
    }

    /// Adds a column, unless there is one of this name already.
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

/// The kinds of elements that a value has.
pub(super) fn kinds(value: &AnyValue) -> Vec<On> {
    let mut kinds = Vec::new();
    let of_parts: Vec<_> = value.parts().columns.iter().map(|part| part.on).collect();
    let of_mesh = [On::Vertex, On::Face, On::Edge, On::Corner];
    let of_mesh = of_mesh.into_iter().filter(|_| value.get::<Mesh>().is_some());
    for on in of_mesh.chain(of_parts) {
        if !kinds.contains(&on) {
            kinds.push(on);
        }
    }
    kinds
}

/// The word for several elements.
pub(super) fn plural(on: On) -> &'static str {
    match on {
        On::Vertex => "vertices",
        On::Corner => "corners",
        On::Face => "faces",
        On::Edge => "edges",
        On::Pixel => "pixels",
        On::Texel => "texels",
        On::Point => "points",
        On::Step => "steps",
        On::Entry => "entries",
        On::Whole => "whole",
    }
}

/// What the numbers of a column's elements are called: `x`, `y`, `z` those of the first places, `NAME_x` of others.
fn names(part: &Part<'_>, is_first: bool) -> Vec<String> {
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

/// What follows from the shape of a mesh.
fn derived(mesh: &Mesh, on: On) -> Vec<Numbers> {
    match on {
        On::Face => of_faces(mesh),
        On::Edge => of_edges(mesh),
        On::Corner => of_corners(mesh),
        _ => Vec::new(),
    }
}

fn column(name: &str, numbers: impl Iterator<Item = f64>) -> Numbers {
    Numbers { name: name.to_owned(), numbers: numbers.collect() }
}

fn places(places: &[Point3<f64>]) -> [Numbers; 3] {
    ["x", "y", "z"].map(|name| {
        let axis = usize::from(name.as_bytes()[0] - b'x');
        column(name, places.iter().map(|place| place[axis]))
    })
}

/// The middle, the area in mm^2, the unit normal and the number of corners.
fn of_faces(mesh: &Mesh) -> Vec<Numbers> {
    let faces = || mesh.faces().iter();
    let mut columns = Vec::from(places(
        &faces()
            .map(|face| {
                let sum: nalgebra::Vector3<f64> =
                    face.iter().map(|vertex| mesh.positions()[*vertex as usize].coords).sum();
                Point3::from(sum / face.len() as f64)
            })
            .collect::<Vec<_>>(),
    ));
    let areas: Vec<_> = faces().map(|face| mesh.area_vector(face)).collect();
    columns.push(column("area", areas.iter().map(nalgebra::Vector3::norm)));
    for (axis, name) in ["normal_x", "normal_y", "normal_z"].into_iter().enumerate() {
        columns.push(column(
            name,
            areas.iter().map(|area| area.try_normalize(0.0).map_or(0.0, |n| n[axis])),
        ));
    }
    columns.push(column("sides", faces().map(|face| face.len() as f64)));
    columns
}

/// The ends, the middle, the length in mm, how many faces meet there, and the sharpness of a crease.
fn of_edges(mesh: &Mesh) -> Vec<Numbers> {
    let edges = mesh.edges();
    fn at(vertex: u32, mesh: &Mesh) -> Point3<f64> {
        mesh.positions()[vertex as usize]
    }
    let ends = || edges.vertices.iter();
    let end = |which: usize| ends().map(move |edge| f64::from(edge[which]));
    let mut columns = vec![column("from", end(0)), column("to", end(1))];
    let middles: Vec<_> = ends().map(|&[a, b]| center(&at(a, mesh), &at(b, mesh))).collect();
    columns.extend(places(&middles));
    columns.push(column("length", ends().map(|&[a, b]| (at(b, mesh) - at(a, mesh)).norm())));
    columns.push(column("faces", edges.faces.iter().map(|count| f64::from(*count))));
    if mesh.creases().len() > 0 {
        let creases = std::collections::HashMap::<_, _>::from_iter(mesh.creases());
        columns.push(column(
            "sharpness",
            ends().map(|edge| creases.get(edge).copied().unwrap_or(0.0)),
        ));
    }
    columns
}

/// The face, the vertex and its place.
fn of_corners(mesh: &Mesh) -> Vec<Numbers> {
    let faces = mesh.faces().iter().enumerate();
    let face = faces.flat_map(|(index, face)| face.iter().map(move |_| index as f64));
    let corners = mesh.faces().corners();
    let mut columns = vec![column("face", face)];
    columns.push(column("vertex", corners.iter().map(|vertex| f64::from(*vertex))));
    columns.extend(places(
        &corners.iter().map(|vertex| mesh.positions()[*vertex as usize]).collect::<Vec<_>>(),
    ));
    columns
}
