//! Law 15: a node treats a shape alike wherever it is, whatever its size is and however it is divided into faces.
//!
//! The inputs of a node's example are moved, scaled, and given faces without area. Not every node follows its inputs: a box in a parameter
//! stays where it is. So a node that follows its inputs over a few lengths must do so over a million of them, and a node whose result
//! doubles with its inputs and its lengths must do so for any factor.

use maquette_graph::{Graph, GraphNode};
use maquette_node::Progress;
use maquette_value::{AnyValue, Faces, Items, Meaning, Mesh, RangeImage, bounds};
use nalgebra::{Point3, Vector3, distance};
use serde_json::Value as Json;

use super::evaluation::{call_with_context, inputs};
use super::extremes::Case;
use super::scalars::Scalars;

/// The distance to which shapes are moved, in lengths of the shape: a power of two, so that the move is exact.
const FAR: f64 = 1_048_576.0;

/// The length of a shape, divided by the step between the coordinates that the moved shapes have. At the distance [`FAR`], such
/// coordinates are exact.
const STEPS: f64 = 268_435_456.0;

/// Factors by which shapes are scaled: powers of two, so that scaling is exact.
const SCALES: [f64; 2] = [1.0 / 1_048_576.0, 1_048_576.0];

/// A distance that is far for nothing, in lengths of the shape.
const NEAR: f64 = 4.0;

/// Maximum deviation of the result for a shape that is changed little, as a fraction of its size, if the node follows its inputs.
const FOLLOWS: f64 = 1e-2;

/// Maximum deviation of the result for a shape that is far away, tiny or huge, as a fraction of its size, if that for a shape that is
/// changed little deviates less. A node that chooses between nearly equal faces may choose others.
const ALIKE: f64 = 1e-4;

/// Maximum deviation of the result for a shape with faces without area, as a fraction of its size.
const NEARLY_ALIKE: f64 = 1e-2;

/// Checks law 15 for a node. `load` loads the example of the node with the given parameters.
pub(super) fn check(
    case: &Case<'_>,
    load: &dyn Fn(Vec<(String, String)>) -> Option<Graph>,
    broken: &mut Vec<String>,
) {
    let node = &case.graph.nodes()[case.index];
    let Some(given) = inputs(node, case.values) else { return };
    let points: Vec<_> = given.iter().flat_map(positions).collect();
    let Some((low, high)) = bounds(points.iter()) else { return };
    let size = distance(&low, &high);
    if !(size > 0.0 && size < FAR) {
        return;
    }
    let size = libm::exp2(libm::log2(size).ceil());
    let Some(given) = map_all(&given, |x, _| (x / size * STEPS).round() / STEPS * size) else {
        return;
    };
    let Ok(made) = run(node, &given) else { return };
    let mut report = |why: String| broken.push(format!("{}: {why}", case.entry.name));
    check_faces(node, &given, &made, &mut report);
    check_moved(node, &given, &made, size, &mut report);
    check_scaled(case, load, &given, &made, &mut report);
    check_divided(node, &given, &mut report);
}

/// Checks that the meshes that a node makes of meshes without faces that have no area have none, either.
fn check_faces(
    node: &GraphNode,
    given: &[AnyValue],
    made: &[AnyValue],
    report: &mut dyn FnMut(String),
) {
    fn is_clean(value: &AnyValue) -> bool {
        value.get::<Mesh>().is_none_or(|mesh| mesh.flat_faces().is_empty())
    }
    if !given.iter().all(is_clean) {
        return;
    }
    for (name, value) in node.outputs.iter().zip(made).filter(|(_, value)| !is_clean(value)) {
        let faces = value.get::<Mesh>().map(Mesh::flat_faces).unwrap_or_default();
        report(format!(
            "`{name}` has {} faces without area, such as face {}",
            faces.len(),
            faces[0]
        ));
    }
}

/// Checks that the result follows the inputs of a node when they are moved far away.
fn check_moved(
    node: &GraphNode,
    given: &[AnyValue],
    made: &[AnyValue],
    size: f64,
    report: &mut dyn FnMut(String),
) {
    // The points of a range image are relative to its sensor.
    if given.iter().any(|value| value.get::<RangeImage>().is_some()) {
        return;
    }
    let run_moved = |lengths: f64| {
        let step = [size, -size, size].map(|it| it * lengths);
        let moved = map_all(given, |x, axis| x + step[axis])?;
        Some(run(node, &moved).and_then(|found| {
            let back = map_all(&found, |x, axis| x - step[axis]).unwrap_or(found);
            deviation(made, &back)
        }))
    };
    if let Some(why) = unlike(run_moved(FAR), || run_moved(NEAR)) {
        report(format!("{FAR} lengths from the origin {why}"));
    }
}

/// Checks that the result scales with the inputs and lengths of a node.
fn check_scaled(
    case: &Case<'_>,
    load: &dyn Fn(Vec<(String, String)>) -> Option<Graph>,
    given: &[AnyValue],
    made: &[AnyValue],
    report: &mut dyn FnMut(String),
) {
    let node = &case.graph.nodes()[case.index];
    let lengths = lengths(&node.recipe.parameters, case.entry.schema());
    let run_scaled = |factor: f64| {
        let path = |path: &str| format!("{}.{path}", node.name);
        let set = lengths.iter().map(|(name, x)| (path(name), format!("{:e}", x * factor)));
        let graph = load(set.collect())?;
        let node = &graph.nodes()[graph.find(&node.name)?];
        let scaled = map_all(given, |x, _| x * factor)?;
        Some(run(node, &scaled).and_then(|found| {
            let back = map_all(&found, |x, _| x / factor).unwrap_or(found);
            deviation(made, &back)
        }))
    };
    for factor in SCALES {
        if let Some(why) = unlike(run_scaled(factor), || run_scaled(2.0)) {
            report(format!("{factor:.1e} times as large {why}"));
        }
    }
}

/// Checks that the result changes little if a few faces of the meshes that a node gets are divided such that some parts have no area.
fn check_divided(node: &GraphNode, given: &[AnyValue], report: &mut dyn FnMut(String)) {
    for (slot, value) in given.iter().enumerate() {
        let Some(plain) = value.get::<Mesh>().and_then(without_attributes) else { continue };
        let Some(divided) = divide_faces(&plain) else { continue };
        let run_with = |mesh: Mesh| {
            let mut given = given.to_vec();
            given[slot] = AnyValue::new(mesh);
            run(node, &given)
        };
        let Ok(made) = run_with(plain) else { continue };
        let result = run_with(divided).and_then(|found| {
            let shape = deviation(&made, &found)?;
            Ok(exploded_numbers(&made, &found).unwrap_or(shape))
        });
        if let Some(why) = describe(&result, NEARLY_ALIKE) {
            report(format!("with faces without area at `{}` {why}", node.links[slot].port));
        }
    }
}

/// Returns the triangles of a mesh without attributes.
fn without_attributes(mesh: &Mesh) -> Option<Mesh> {
    let faces = Faces::triangles(mesh.triangles().into_owned());
    Mesh::new(mesh.positions().clone(), faces).ok()
}

/// Returns what is wrong with the result for a shape that is far away, tiny or huge. `ordinary` gives the result for a shape that is
/// changed little; if that deviates, too, the node does not follow its inputs, and nothing is wrong.
fn unlike(
    result: Option<Result<Deviation, String>>,
    ordinary: impl FnOnce() -> Option<Result<Deviation, String>>,
) -> Option<String> {
    let result = result?;
    describe(&result, ALIKE)?;
    let ordinary = ordinary()?.ok().filter(|it| it.size <= FOLLOWS)?;
    describe(&result, ALIKE.max(3.0 * ordinary.size))
}

/// Returns the text of a result that fails or deviates by more than `limit`.
fn describe(result: &Result<Deviation, String>, limit: f64) -> Option<String> {
    match result {
        Err(why) => Some(format!("it fails: {why}")),
        Ok(found) if found.size <= limit => None,
        Ok(Deviation { what, size }) => {
            Some(format!("{what} deviates by {size:.1e} of the size of the result"))
        }
    }
}

/// Runs a node. The error is that of the node, or the message of a panic.
fn run(node: &GraphNode, given: &[AnyValue]) -> Result<Vec<AnyValue>, String> {
    let (result, _) = call_with_context(given, Progress::silent(), |cx| node.node.eval(cx))?;
    result.map_err(|error| error.to_string())
}

/// Returns the finite positions of a value.
fn positions(value: &AnyValue) -> Vec<Point3<f64>> {
    let parts = value.parts();
    let columns = parts.columns.iter().filter(|part| part.meaning == Meaning::Position);
    let points = columns.flat_map(|part| part.to_points().unwrap_or_default());
    points.filter(|point| point.coords.iter().all(|x| x.is_finite())).collect()
}

/// Returns copies of values with coordinates mapped by `map`, which is given each coordinate and its axis. `None` if a value cannot be
/// built from its parts.
fn map_all(values: &[AnyValue], map: impl Fn(f64, usize) -> f64) -> Option<Vec<AnyValue>> {
    values.iter().map(|value| map_positions(value, &map)).collect()
}

fn map_positions(value: &AnyValue, map: impl Fn(f64, usize) -> f64) -> Option<AnyValue> {
    let mut parts = value.parts();
    let mut is_changed = false;
    for part in parts.columns.iter_mut().filter(|part| part.meaning == Meaning::Position) {
        let Items::F64(numbers) = &part.items else { return None };
        let mapped = numbers.iter().enumerate().map(|(k, &x)| map(x, k % part.width));
        let mapped: Vec<f64> = mapped.collect();
        part.items = mapped.into();
        is_changed = true;
    }
    if is_changed { value.kind().from_parts(&parts).ok() } else { Some(value.clone()) }
}

/// Returns all numbers in mm among the parameters of a node, with their paths.
fn lengths(parameters: &Json, schema: &Json) -> Vec<(String, f64)> {
    let mut lengths = Vec::new();
    let scalars = Scalars { schema, max_items: usize::MAX };
    scalars.visit(parameters, &mut |path, value, schema| {
        if let (Some("mm"), Some(x)) = (schema["unit"].as_str(), value.as_f64()) {
            lengths.push((path.to_owned(), x));
        }
    });
    lengths
}

/// The largest difference between two results.
#[derive(Debug)]
struct Deviation {
    what: String,
    /// The difference as a fraction of the size of the expected result.
    size: f64,
}

/// Returns the largest deviation between the measures of values, which are independent of the number and order of their elements.
///
/// # Errors
/// If only one of two values has positions.
fn deviation(expected: &[AnyValue], found: &[AnyValue]) -> Result<Deviation, String> {
    let mut largest = Deviation { what: "nothing".into(), size: 0.0 };
    for (expected, found) in expected.iter().zip(found) {
        let kind = expected.kind().name;
        let [a, b] = [expected, found].map(|value| bounds(positions(value).iter()));
        let (Some(a), Some(b)) = (a, b) else {
            match (a, b) {
                (Some(_), None) => return Err(format!("the {kind} is empty")),
                (None, Some(_)) => return Err(format!("the {kind} is not empty")),
                _ => continue,
            }
        };
        let size = distance(&a.0, &a.1).max(f64::MIN_POSITIVE);
        let difference = distance(&a.0, &b.0).max(distance(&a.1, &b.1));
        let mut measures = vec![("extent", difference / size)];
        if let (Some(one), Some(other)) = (expected.get::<Mesh>(), found.get::<Mesh>()) {
            let [one, other] = [one, other].map(|mesh| area_and_volume(mesh, a.0));
            let area = one[0].max(size * size);
            measures.push(("area", (one[0] - other[0]).abs() / area));
            measures.push(("volume", (one[1] - other[1]).abs() / (size * area)));
        }
        for (name, size) in measures {
            if largest.size < size || size.is_nan() {
                largest = Deviation { what: format!("the {name} of the {kind}"), size };
            }
        }
    }
    Ok(largest)
}

/// Returns the attribute whose numbers have grown by an order of magnitude, if there is one.
fn exploded_numbers(expected: &[AnyValue], found: &[AnyValue]) -> Option<Deviation> {
    expected.iter().zip(found).find_map(|(expected, found)| {
        let [expected, found] = [expected.parts(), found.parts()];
        expected.columns.iter().find_map(|part| {
            let [a, b] = [part, found.find(part.element_kind, &part.name)?]
                .map(|part| magnitude(&part.items));
            let is_exploded = part.meaning == Meaning::Number && a > 0.0 && b > 10.0 * a;
            is_exploded.then(|| Deviation { what: format!("`{}`", part.name), size: b / a })
        })
    })
}

/// Returns the largest magnitude of the numbers.
fn magnitude(items: &Items<'_>) -> f64 {
    items.numbers().iter().filter(|x| x.is_finite()).fold(0.0, |most, x| x.abs().max(most))
}

/// Returns the area of a mesh and the volume that it encloses together with the cone to `tip`.
fn area_and_volume(mesh: &Mesh, tip: Point3<f64>) -> [f64; 2] {
    let mut sums = [0.0; 2];
    for face in mesh.faces().iter() {
        let area = mesh.area_vector(face);
        sums[0] += area.norm();
        sums[1] += area.dot(&(mesh.positions()[face[0] as usize] - tip)) / 3.0;
    }
    sums
}

/// Divides a few pairs of triangles of a mesh. A new vertex is on the common edge or at its start, but belongs to one of the triangles
/// only: a third triangle without area is between them. Returns `None` if there is no such pair.
fn divide_faces(mesh: &Mesh) -> Option<Mesh> {
    let mut points = mesh.positions().to_vec();
    let mut faces = mesh.faces().as_triangles()?.to_vec();
    let mut is_taken = vec![false; points.len()];
    let count = faces.len();
    for (step, (fraction, height)) in
        [(0.4, 0.0), (0.0, 0.0), (0.6, 1e-12), (0.3, 1e-9)].into_iter().enumerate()
    {
        // Take the first free pair after the given part of the faces.
        let pair = (step * count / 4..count).find_map(|face| {
            let [a, b, _] = faces[face];
            let beyond = faces[..count].iter().position(|&face| third(face, b, a).is_some())?;
            let corners = faces[face].into_iter().chain(faces[beyond]);
            corners.clone().all(|it| !is_taken[it as usize]).then_some((face, beyond))
        });
        let Some((face, beyond)) = pair else { continue };
        let [a, b, _] = faces[face];
        let d = third(faces[beyond], b, a)?;
        faces[face].into_iter().chain([d]).for_each(|it| is_taken[it as usize] = true);
        let [start, end] = [a, b].map(|it| points[it as usize]);
        let off = Vector3::repeat(height * distance(&start, &end));
        let new = points.len() as u32;
        points.push(start + (end - start) * fraction + off);
        is_taken.push(true);
        faces[beyond] = [b, new, d];
        faces.extend([[new, a, d], [b, a, new]]);
    }
    if faces.len() == count { None } else { Mesh::new(points, Faces::triangles(faces)).ok() }
}

/// Returns the third corner of a triangle with the half-edge from `a` to `b`.
fn third(face: [u32; 3], a: u32, b: u32) -> Option<u32> {
    (0..3).find(|&k| face[k] == a && face[(k + 1) % 3] == b).map(|k| face[(k + 2) % 3])
}

#[cfg(test)]
mod tests {
    use maquette_value::Value as _;

    use super::*;

    #[test]
    fn divided_faces_have_parts_without_area_and_the_same_shape() {
        let solids = Mesh::edge_cases();
        let solid = solids.iter().find(|mesh| mesh.faces().len() == 16).unwrap();
        let divided = divide_faces(solid).unwrap();
        assert!(divided.flat_faces().len() >= 2, "{:?}", divided.flat_faces());
        let [before, after] = [solid, &divided].map(|mesh| vec![AnyValue::new(mesh.clone())]);
        let same = deviation(&before, &after).unwrap();
        assert!(same.size < 1e-9, "{same:?}");
        let edges = divided.edges();
        assert!(edges.faces.iter().all(|&faces| faces == 2) && edges.misoriented == 0);
    }

    #[test]
    fn results_are_compared_by_extent_area_and_volume() {
        let mesh = |x: f64, faces: Vec<[u32; 3]>| {
            let points = [[0.0; 3], [x, 0.0, 0.0], [0.0, 1.0, 0.0]];
            let mesh = Mesh::new(points.map(Point3::from).to_vec(), Faces::triangles(faces));
            vec![AnyValue::new(mesh.unwrap())]
        };
        let one = mesh(1.0, vec![[0, 1, 2]]);
        let check = |other: Vec<AnyValue>| describe(&deviation(&one, &other), 1e-3);
        assert_eq!(check(one.clone()), None);
        let moved = "the extent of the Mesh deviates by 7.1e-1 of the size of the result";
        assert_eq!(check(mesh(2.0, vec![[0, 1, 2]])).as_deref(), Some(moved));
        let twice = "the area of the Mesh deviates by 2.5e-1 of the size of the result";
        assert_eq!(check(mesh(1.0, vec![[0, 1, 2]; 2])).as_deref(), Some(twice));
    }
}
