//! Law 11: of attributes becomes what a node declares. Meshes and points with marks of every kind on all domains go through its example.
//!
//! All marks of an element follow from one number, so that an element whose marks do not fit together is found: one that got its
//! color from here and its vector from there.

use maquette_node::{DOMAINS, Fate, Progress};
use maquette_value::{AnyValue, Attribute, Attributes, Mesh, Points};

use super::extremes::Case;
use super::{inputs, made};

/// The mark that all others of an element follow from.
const MARK: &str = "mark-of-the-law";

/// Of an edge that is marked, by a sharpness that stays.
const SHARP: f64 = 10.0;

/// Where marks stand that have a name which nodes know: a mesh has each at its vertices or at its corners.
const NAMED: [usize; 2] = [0, 1];

/// Checks what the node of an example declares, and that it declares something for each way that attributes may go.
pub(super) fn check(case: &Case<'_>, broken: &mut Vec<String>) {
    let (entry, node) = (case.entry, &case.graph.nodes()[case.index]);
    let declared = entry.carries();
    for port in &entry.ports() {
        for output in entry.outputs() {
            fn takes(kind: &str, port_types: &[String]) -> bool {
                port_types.iter().any(|it| it == kind)
            }
            let gives = |kind: &str| output.types.iter().any(|it| it.name == kind);
            let has_elements = (takes("Mesh", &port.types) || takes("Points", &port.types))
                && (gives("Mesh") || gives("Points"));
            let has_cells = takes("RangeImage", &port.types)
                && ["RangeImage", "Mesh", "Points"].into_iter().any(gives);
            let said: Vec<_> = declared
                .iter()
                .filter(|it| (it.port, it.output) == (&port.name[..], output.name))
                .collect();
            let is_right = match &said[..] {
                [] => !has_elements && !has_cells,
                [it] => (it.fates.is_some(), it.cells.is_some()) == (has_elements, has_cells),
                _ => false,
            };
            if !is_right {
                let (name, port, output) = (&entry.name, &port.name, output.name);
                broken.push(format!("{name} does not say once what becomes of attributes from `{port}` to `{output}`"));
            }
        }
    }
    let Some(good) = inputs(node, case.values) else { return };
    // What reads files cannot be run by itself.
    if !matches!(made(node, &good, Progress::none()), Ok(Some(_))) {
        return;
    }
    for carry in declared {
        let Some(fates) = carry.fates else { continue };
        for named in NAMED {
            let mut given = good.clone();
            let mut marks = Marks::default();
            let slots = node.links.iter().enumerate().filter(|(_, link)| link.port == carry.port);
            for (slot, _) in slots {
                if let Some(marked) = marks.put(&given[slot], named) {
                    given[slot] = marked;
                }
            }
            // Points have no corners.
            if marks.counts[named] == 0 {
                break;
            }
            let made = made(node, &given, Progress::none());
            let at = node.outputs.iter().position(|name| *name == carry.output);
            let (Ok(Some(made)), Some(at)) = (made, at) else {
                broken.push(format!("{} fails on marked values at `{}`", entry.name, carry.port));
                break;
            };
            for (domain, word) in DOMAINS.iter().enumerate() {
                let fate = fates[domain];
                for why in marks.wrong(domain, fate, carry.own, &made[at]) {
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

/// A kind of marks: its name, the attribute of some numbers, and how the entries of such an attribute are judged.
struct Kind {
    name: &'static str,
    make: fn(&[f64]) -> Attribute,
    /// Whether a mixed entry is still what follows from the mixed number.
    is_linear: bool,
}

/// All kinds, MARK first. Those without the name of the mark have a meaning for nodes.
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

/// What has been marked.
#[derive(Default)]
struct Marks {
    /// How many elements of each domain: their numbers are 1, 2 and so on.
    counts: [usize; 4],
}

impl Marks {
    /// A value with marks at each element; none if it has no attributes. `named` is the domain of those with a name that nodes know.
    fn put(&mut self, value: &AnyValue, named: usize) -> Option<AnyValue> {
        fn numbers(domain: usize, count: usize, counts: &mut [usize; 4]) -> Vec<f64> {
            // Each port's links have numbers of their own.
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
        let mut marked = mesh.clone().without("uv").without("color");
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
        // Those that turn along must be true.
        let normals = mesh.vertex_normals();
        let all = Vec::from_iter(0..counts[0] as u32);
        let at = [&all[..], mesh.faces().corners()][named]
            .iter()
            .map(|vertex| normals[*vertex as usize].into())
            .collect();
        marked = marked.without("normal");
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

    /// What speaks against a fate of the marks of a domain; `own` are attributes that the node makes itself.
    fn wrong(&self, domain: usize, fate: Fate, own: &[&str], made: &AnyValue) -> Vec<String> {
        let mut wrong = Vec::new();
        if self.counts[domain] == 0 {
            return wrong;
        }
        if DOMAINS[domain] == "edge" {
            let mesh = made.get::<Mesh>();
            let is_there = mesh.is_some_and(|mesh| mesh.creases().any(|(_, sharp)| sharp == SHARP));
            // Others may come beside it.
            wrong.extend((is_there == (fate == Fate::Dropped)).then(|| "a crease".to_owned()));
            return wrong;
        }
        let Some(found) = attributes(made, domain) else { return wrong };
        let mut say = |is_wrong: bool, name: &str, why: &str| {
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
            say(!all, "normal", "has vectors that are no directions");
        }
        let marks = match found.get(MARK) {
            Some(Attribute::Number(marks)) => &marks[..],
            _ => {
                say(fate != Fate::Dropped, MARK, "is gone");
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
            Fate::Dropped => say(true, MARK, "is there"),
            Fate::Kept => say(!marks.iter().all(|x| is_given(*x, slack, most)), MARK, "is mixed"),
            Fate::Interpolated => {
                say(!marks.iter().all(|x| is_between(*x, slack, most)), MARK, "is outside")
            }
        }
        for kind in KINDS[1..].iter().filter(|kind| !own.contains(&kind.name)) {
            let is_own = kind.name.starts_with(MARK);
            let Some(attribute) = found.get(kind.name) else {
                say(is_own && fate != Fate::Dropped, kind.name, "is gone");
                continue;
            };
            if fate == Fate::Dropped {
                say(is_own, kind.name, "is there");
                continue;
            }
            let follows = (kind.make)(marks);
            let is_exact = fate == Fate::Kept;
            if is_exact || kind.is_linear {
                let slack = if is_exact { 0.0 } else { 8.0 * slack };
                say(!is_near(attribute, &follows, slack), kind.name, "is of another element");
            } else {
                let given: Vec<_> = (1..=self.counts[domain]).map(|mark| mark as f64).collect();
                say(!is_among(attribute, &(kind.make)(&given)), kind.name, "is new");
            }
        }
        wrong
    }
}

/// The attributes of a domain.
fn attributes(value: &AnyValue, domain: usize) -> Option<&Attributes> {
    if let Some(points) = value.get::<Points>() {
        return (domain == 0).then(|| points.attributes());
    }
    let mesh = value.get::<Mesh>()?;
    Some([mesh.vertex(), mesh.corner(), mesh.face(), mesh.face()][domain])
}

/// Whether all numbers of two attributes of the same kind are that near.
fn is_near(a: &Attribute, b: &Attribute, slack: f64) -> bool {
    fn near(a: &[f64], b: &[f64], slack: f64) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() <= slack)
    }
    match (a, b) {
        (Attribute::Number(a), Attribute::Number(b)) => near(a, b, slack),
        (Attribute::Pair(a), Attribute::Pair(b)) => near(a.as_flattened(), b.as_flattened(), slack),
        (Attribute::Vector(a), Attribute::Vector(b)) => {
            near(a.as_flattened(), b.as_flattened(), slack)
        }
        _ => a == b,
    }
}

/// Whether entries of what cannot be mixed are some of those that were given; colors, which can, are between them.
fn is_among(found: &Attribute, given: &Attribute) -> bool {
    match (found, given) {
        (Attribute::Index(found), Attribute::Index(given)) => {
            found.iter().all(|index| given.binary_search(index).is_ok())
        }
        (Attribute::Flag(found), Attribute::Flag(_)) => found.iter().all(|flag| *flag <= 1),
        (Attribute::Color(found), Attribute::Color(given)) => (0..3).all(|k| {
            let all = || given.iter().map(|color| color[k]);
            let (low, high) = (all().min().unwrap_or(0), all().max().unwrap_or(255));
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

    /// What the law says of two triangles that are given marks and then changed.
    fn said(domain: usize, fate: Fate, change: impl FnOnce(Mesh) -> Mesh) -> Vec<String> {
        let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let faces = Faces::triangles(vec![[0, 1, 2], [0, 2, 3]]);
        let mesh = Mesh::new(Vec::from(points.map(Point3::from)), faces).unwrap();
        let mut marks = Marks::default();
        let marked = marks.put(&AnyValue::new(mesh), 0).unwrap();
        let changed = AnyValue::new(change(marked.get::<Mesh>().unwrap().clone()));
        marks.wrong(domain, fate, &[], &changed)
    }

    #[test]
    fn what_is_as_it_was_is_kept_and_not_dropped_on_every_domain() {
        for domain in 0..DOMAINS.len() {
            assert_eq!(said(domain, Fate::Kept, |mesh| mesh), [""; 0]);
            assert_eq!(said(domain, Fate::Interpolated, |mesh| mesh), [""; 0]);
            assert_ne!(said(domain, Fate::Dropped, |mesh| mesh), [""; 0]);
        }
    }

    #[test]
    fn one_kind_that_goes_another_way_is_found() {
        let with = |name: &'static str, attribute: Attribute| {
            move |mesh: Mesh| mesh.with_vertex(name, attribute).unwrap()
        };
        let other = [4.0, 1.0, 2.0, 3.0];
        for kind in &KINDS[1..] {
            let said = said(0, Fate::Kept, with(kind.name, (kind.make)(&other)));
            assert_eq!(said, [format!("`{}` is of another element", kind.name)]);
        }
        let mixed = pair(&[1.5, 2.5, 2.5, 3.5]);
        assert_eq!(said(0, Fate::Interpolated, with("uv", mixed)).len(), 1);
        let new = Attribute::Index(vec![1, 2, 9, 4].into());
        let said_of_new = said(0, Fate::Interpolated, with("mark-of-the-law-index", new));
        assert_eq!(said_of_new, ["`mark-of-the-law-index` is new"]);
        let long = Attribute::Vector(vec![[0.0, 0.0, 2.0]; 4].into());
        let said_of_long = said(0, Fate::Kept, with("normal", long));
        assert_eq!(said_of_long, ["`normal` has vectors that are no directions"]);
        let gone = said(0, Fate::Kept, |mesh| mesh.without("mark-of-the-law-pair"));
        assert_eq!(gone, ["`mark-of-the-law-pair` is gone"]);
    }
}
