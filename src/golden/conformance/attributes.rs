//! Law 11: attributes are handled as a node declares. The test gives attributes of every type ("marks") to all kinds of elements
//! ("domains") of meshes and points. Then it runs the node's example on these values.
//!
//! All marks of an element are computed from one number. So the test notices if an element of the result has marks from different elements.

use maquette_node::{DOMAINS, Progress, Transfer};
use maquette_value::{AnyValue, Attribute, Attributes, Mesh, Points};

use super::evaluation::{evaluate_node, inputs};
use super::extremes::Case;

/// The name of the attribute that stores the number of an element. All other marks of the element are computed from this number.
const MARK: &str = "mark-of-the-law";

/// The crease sharpness that marks an edge. A node must not change it.
const SHARP: f64 = 10.0;

/// The indices of the domains that can have attributes with special names such as `uv`: vertices (0) and corners (1). A test run gives
/// special names to only one of the two.
const NAMED_DOMAINS: [usize; 2] = [0, 1];

/// Checks that a node declares how it handles attributes, for each pair of port and output. Also checks, with the node's example, that the
/// node does what it declares.
pub(super) fn check(case: &Case<'_>, broken: &mut Vec<String>) {
    let (entry, node) = (case.entry, &case.graph.nodes()[case.index]);
    let declared = entry.carries();
    for port in &entry.ports() {
        for output in entry.outputs() {
            let accepts_elements = port.types.iter().any(|kind| kind == "Mesh" || kind == "Points");
            let accepts_cells = port.types.iter().any(|kind| kind == "RangeImage");
            let gives_elements =
                output.types.iter().any(|it| ["Mesh", "Points"].contains(&it.name));
            let gives_cells = output.types.iter().any(|it| it.name == "RangeImage");
            let has_elements = accepts_elements && gives_elements;
            let has_cells = accepts_cells && (gives_cells || gives_elements);
            let declarations: Vec<_> = declared
                .iter()
                .filter(|it| (it.port, it.output) == (&port.name[..], output.name))
                .collect();
            let is_right = match &declarations[..] {
                [] => !has_elements && !has_cells,
                [it] => (it.transfers.is_some(), it.cells.is_some()) == (has_elements, has_cells),
                _ => false,
            };
            if !is_right {
                let (name, port, output) = (&entry.name, &port.name, output.name);
                broken.push(format!("{name} does not declare once what becomes of attributes from `{port}` to `{output}`"));
            }
        }
    }
    let Some(good) = inputs(node, case.values) else { return };
    // Skip a node that fails here, for instance because it reads files: it cannot be tested.
    if !matches!(evaluate_node(node, &good, Progress::silent()), Ok(Some(_))) {
        return;
    }
    for carry in declared {
        let Some(fates) = carry.transfers else { continue };
        for named in NAMED_DOMAINS {
            let mut given = good.clone();
            let mut marks = Marks::default();
            let slots = node.links.iter().enumerate().filter(|(_, link)| link.port == carry.port);
            for (slot, _) in slots {
                if let Some(marked) = marks.put(&given[slot], named) {
                    given[slot] = marked;
                }
            }
            // Stop if the values have no elements of this kind to mark. For example, points have no corners.
            if marks.counts[named] == 0 {
                break;
            }
            let made = evaluate_node(node, &given, Progress::silent());
            let at = node.outputs.iter().position(|name| *name == carry.output);
            let (Ok(Some(made)), Some(at)) = (made, at) else {
                broken.push(format!("{} fails on marked values at `{}`", entry.name, carry.port));
                break;
            };
            for (domain, word) in DOMAINS.iter().enumerate() {
                let fate = fates[domain];
                for why in marks.violations(domain, fate, carry.own, &made[at]) {
                    let (name, fate) = (&entry.name, fate.word());
                    let (port, output) = (carry.port, carry.output);
                    let why = format!(
                        "{name}: attributes of each {word} from `{port}` to `{output}` are not {fate}: {why}"
                    );
                    if !broken.contains(&why) {
                        broken.push(why);
                    }
                }
            }
        }
    }
}

/// A kind of mark: the name of an attribute, and the function that computes it from the numbers of elements.
struct Kind {
    name: &'static str,
    make: fn(&[f64]) -> Attribute,
    /// True if the function is linear: interpolating two elements' numbers and then computing the attribute gives the interpolated
    /// attribute.
    is_linear: bool,
}

/// All kinds of marks. The first is `MARK` itself. Names that do not begin with `MARK` have a special meaning for nodes, such as `uv`.
const KINDS: [Kind; 8] = [
    Kind { name: MARK, make: |x| Attribute::Number(x.to_vec().into()), is_linear: true },
    Kind { name: "mark-of-the-law-index", make: index, is_linear: false },
    Kind { name: "mark-of-the-law-flag", make: flag, is_linear: false },
    Kind { name: "mark-of-the-law-pair", make: pair, is_linear: true },
    Kind { name: "mark-of-the-law-vector", make: vector, is_linear: true },
    Kind { name: "mark-of-the-law-color", make: color, is_linear: false },
    Kind { name: "uv", make: pair, is_linear: true },
    Kind { name: "color", make: color, is_linear: false },
];

fn index(x: &[f64]) -> Attribute {
    Attribute::Index(x.iter().map(|x| *x as u32).collect())
}

fn flag(x: &[f64]) -> Attribute {
    Attribute::Flag(x.iter().map(|x| (*x as u32 / 2 % 2) as u8).collect())
}

fn pair(x: &[f64]) -> Attribute {
    Attribute::Pair(x.iter().map(|x| [0.5 * x, -x]).collect())
}

fn vector(x: &[f64]) -> Attribute {
    Attribute::Vector(x.iter().map(|x| [2.0 * x, 0.25 * x, -x]).collect())
}

fn color(x: &[f64]) -> Attribute {
    Attribute::Color(
        x.iter()
            .map(|x| {
                let [a, b, c, _] = (*x as u32).to_le_bytes();
                [a, b, c]
            })
            .collect(),
    )
}

/// The marks that one test run has placed.
#[derive(Default)]
struct Marks {
    /// The number of marked elements of each domain (such as vertices or corners). The elements of each domain are numbered from 1.
    counts: [usize; 4],
}

impl Marks {
    /// Returns a copy of the value whose elements are all marked. Returns `None` if values of this type have no attributes. `named` is the
    /// index of the domain that gets the attributes with special names.
    fn put(&mut self, value: &AnyValue, named: usize) -> Option<AnyValue> {
        fn numbers(domain: usize, count: usize, counts: &mut [usize; 4]) -> Vec<f64> {
            // Continue the numbers of the previous link, so that elements of different links have different numbers.
            let first = counts[domain];
            counts[domain] += count;
            (first + 1..=first + count).map(|number| number as f64).collect::<Vec<_>>()
        }
        if let Some(points) = value.get::<Points>() {
            let numbers = numbers(0, points.positions().len(), &mut self.counts);
            let mut points = points.clone();
            for kind in &KINDS {
                points = points.with_attribute(kind.name, (kind.make)(&numbers)).ok()?;
            }
            return Some(AnyValue::new(points));
        }
        let mesh = value.get::<Mesh>()?;
        let (edges, creases) = (mesh.edges(), mesh.creases().len());
        let counts = [mesh.positions().len(), mesh.faces().corners().len(), mesh.faces().len()];
        let numbers = [
            numbers(0, counts[0], &mut self.counts),
            numbers(1, counts[1], &mut self.counts),
            numbers(3, counts[2], &mut self.counts),
        ];
        let mut marked = mesh.clone().without_attribute("uv").without_attribute("color");
        for kind in &KINDS {
            let is_own = kind.name.starts_with(MARK);
            if is_own || named == 0 {
                marked = marked.with_vertex(kind.name, (kind.make)(&numbers[0])).ok()?;
            }
            if is_own || named == 1 {
                marked = marked.with_corner(kind.name, (kind.make)(&numbers[1])).ok()?;
            }
            if is_own {
                marked = marked.with_face(kind.name, (kind.make)(&numbers[2])).ok()?;
            }
        }
        // Use the real normals instead of arbitrary marks, because nodes rotate normals with the surface.
        let normals = mesh.vertex_normals();
        let all = Vec::from_iter(0..counts[0] as u32);
        let at = [&all[..], mesh.faces().corners()][named]
            .iter()
            .map(|vertex| normals[*vertex as usize].into())
            .collect();
        marked = marked.without_attribute("normal");
        marked = match named {
            0 => marked.with_vertex("normal", Attribute::Vector(at)).ok()?,
            _ => marked.with_corner("normal", Attribute::Vector(at)).ok()?,
        };
        let inner = edges.faces.iter().position(|faces| *faces == 2);
        if let (Some(inner), 0) = (inner, creases) {
            self.counts[2] = 1;
            marked = marked.with_creases([(edges.vertices[inner], SHARP)]).ok()?;
        }
        Some(AnyValue::new(marked))
    }

    /// Returns the contradictions between the marks in the result `made` and the handling `fate` that the node declares for a domain. `own`
    /// are attributes that the node creates itself.
    fn violations(
        &self,
        domain: usize,
        fate: Transfer,
        own: &[&str],
        made: &AnyValue,
    ) -> Vec<String> {
        let mut wrong = Vec::new();
        if self.counts[domain] == 0 {
            return wrong;
        }
        if DOMAINS[domain] == "edge" {
            let mesh = made.get::<Mesh>();
            let is_there = mesh.is_some_and(|mesh| mesh.creases().any(|(_, sharp)| sharp == SHARP));
            // Check only the marked crease, because the node may add others.
            wrong.extend((is_there == (fate == Transfer::Dropped)).then(|| "a crease".to_owned()));
            return wrong;
        }
        let Some(found) = attributes(made, domain) else { return wrong };
        let mut report_if = |is_wrong: bool, name: &str, why: &str| {
            if is_wrong {
                wrong.push(format!("`{name}` {why}"));
            }
        };
        if let Some(normals) = found.vectors("normal") {
            fn is_unit([x, y, z]: &[f64; 3]) -> bool {
                (x * x + y * y + z * z - 1.0).abs() < 1e-6
            }
            fn is_none(normal: &[f64; 3]) -> bool {
                *normal == [0.0; 3]
            }
            let all = normals.iter().all(|normal| is_unit(normal) || is_none(normal));
            report_if(!all, "normal", "has vectors that are no directions");
        }
        let marks = match found.get(MARK) {
            Some(Attribute::Number(marks)) => &marks[..],
            _ => {
                report_if(fate != Transfer::Dropped, MARK, "is gone");
                return wrong;
            }
        };
        let most = self.counts[domain] as f64;
        let slack = 1e-9 * most;
        fn is_between(x: f64, slack: f64, most: f64) -> bool {
            1.0 - slack <= x && x <= most + slack
        }
        fn is_given(x: f64, slack: f64, most: f64) -> bool {
            x.fract() == 0.0 && is_between(x, slack, most)
        }
        match fate {
            Transfer::Dropped => report_if(true, MARK, "is there"),
            Transfer::Kept => {
                report_if(!marks.iter().all(|x| is_given(*x, slack, most)), MARK, "is mixed");
            }
            Transfer::Interpolated => {
                report_if(!marks.iter().all(|x| is_between(*x, slack, most)), MARK, "is outside");
            }
        }
        for kind in KINDS[1..].iter().filter(|kind| !own.contains(&kind.name)) {
            let is_own = kind.name.starts_with(MARK);
            let Some(attribute) = found.get(kind.name) else {
                report_if(is_own && fate != Transfer::Dropped, kind.name, "is gone");
                continue;
            };
            if fate == Transfer::Dropped {
                report_if(is_own, kind.name, "is there");
                continue;
            }
            let follows = (kind.make)(marks);
            let is_exact = fate == Transfer::Kept;
            if is_exact || kind.is_linear {
                let slack = if is_exact { 0.0 } else { 8.0 * slack };
                report_if(!is_near(attribute, &follows, slack), kind.name, "is of another element");
            } else {
                let given: Vec<_> = (1..=self.counts[domain]).map(|mark| mark as f64).collect();
                report_if(!is_among(attribute, &(kind.make)(&given)), kind.name, "is new");
            }
        }
        wrong
    }
}

/// Returns the attributes of a kind of element of a value, or `None` if the value has no such elements.
fn attributes(value: &AnyValue, domain: usize) -> Option<&Attributes> {
    if let Some(points) = value.get::<Points>() {
        return (domain == 0).then(|| points.attributes());
    }
    let mesh = value.get::<Mesh>()?;
    Some([mesh.vertex(), mesh.corner(), mesh.face(), mesh.face()][domain])
}

/// Returns true if the numbers of two attributes differ by at most `slack`. Whole numbers, flags and colors must be equal.
fn is_near(a: &Attribute, b: &Attribute, slack: f64) -> bool {
    fn are_near(a: &[f64], b: &[f64], slack: f64) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() <= slack)
    }
    match (a, b) {
        (Attribute::Number(a), Attribute::Number(b)) => are_near(a, b, slack),
        (Attribute::Pair(a), Attribute::Pair(b)) => {
            are_near(a.as_flattened(), b.as_flattened(), slack)
        }
        (Attribute::Vector(a), Attribute::Vector(b)) => {
            are_near(a.as_flattened(), b.as_flattened(), slack)
        }
        _ => a == b,
    }
}

/// Returns true if the entries of `found` can come from those of `given`. Colors must be between the given colors. Entries that cannot be
/// interpolated must be equal to given ones.
fn is_among(found: &Attribute, given: &Attribute) -> bool {
    match (found, given) {
        (Attribute::Index(found), Attribute::Index(given)) => {
            found.iter().all(|index| given.binary_search(index).is_ok())
        }
        (Attribute::Flag(found), Attribute::Flag(_)) => found.iter().all(|flag| *flag <= 1),
        (Attribute::Color(found), Attribute::Color(given)) => (0..3).all(|k| {
            let levels = given.iter().map(|color| color[k]);
            let (low, high) = (levels.clone().min().unwrap_or(0), levels.max().unwrap_or(255));
            found.iter().all(|color| low <= color[k] && color[k] <= high)
        }),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::Faces;
    use nalgebra::Point3;

    use super::*;

    /// Marks two triangles, changes the marks, and returns the contradictions to the declared handling.
    fn violations_after(
        domain: usize,
        fate: Transfer,
        change: impl FnOnce(Mesh) -> Mesh,
    ) -> Vec<String> {
        let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let faces = Faces::triangles(vec![[0, 1, 2], [0, 2, 3]]);
        let mesh = Mesh::new(Vec::from(points.map(Point3::from)), faces).unwrap();
        let mut marks = Marks::default();
        let marked = marks.put(&AnyValue::new(mesh), 0).unwrap();
        let changed = AnyValue::new(change(marked.get::<Mesh>().unwrap().clone()));
        marks.violations(domain, fate, &[], &changed)
    }

    #[test]
    fn unchanged_attributes_are_kept_on_every_domain() {
        for domain in 0..DOMAINS.len() {
            assert_eq!(violations_after(domain, Transfer::Kept, |mesh| mesh), [""; 0]);
            assert_eq!(violations_after(domain, Transfer::Interpolated, |mesh| mesh), [""; 0]);
            assert_ne!(violations_after(domain, Transfer::Dropped, |mesh| mesh), [""; 0]);
        }
    }

    #[test]
    fn a_changed_attribute_is_found() {
        fn replace_attribute(
            name: &'static str,
            attribute: Attribute,
        ) -> impl FnOnce(Mesh) -> Mesh {
            move |mesh| mesh.with_vertex(name, attribute).unwrap()
        }
        let other = [4.0, 1.0, 2.0, 3.0];
        for kind in &KINDS[1..] {
            let violations = violations_after(
                0,
                Transfer::Kept,
                replace_attribute(kind.name, (kind.make)(&other)),
            );
            assert_eq!(violations, [format!("`{}` is of another element", kind.name)]);
        }
        let mixed = pair(&[1.5, 2.5, 2.5, 3.5]);
        assert_eq!(
            violations_after(0, Transfer::Interpolated, replace_attribute("uv", mixed)).len(),
            1
        );
        let new = Attribute::Index(vec![1, 2, 9, 4].into());
        let violations_of_new = violations_after(
            0,
            Transfer::Interpolated,
            replace_attribute("mark-of-the-law-index", new),
        );
        assert_eq!(violations_of_new, ["`mark-of-the-law-index` is new"]);
        let long = Attribute::Vector(vec![[0.0, 0.0, 2.0]; 4].into());
        let violations_of_long =
            violations_after(0, Transfer::Kept, replace_attribute("normal", long));
        assert_eq!(violations_of_long, ["`normal` has vectors that are no directions"]);
        let violations = violations_after(0, Transfer::Kept, |mesh| {
            mesh.without_attribute("mark-of-the-law-pair")
        });
        assert_eq!(violations, ["`mark-of-the-law-pair` is gone"]);
    }
}
