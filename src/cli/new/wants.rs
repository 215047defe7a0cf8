//! The files that a recipe wants, and those of a project in their place.

use std::path::Path;

use maquette_graph::catalog::Catalog;
use maquette_node::pack::Recipe;
use maquette_syntax::paths::path_between;
use maquette_syntax::{Kind, Tree, parse, quoted};
use maquette_value::plain::ending;
use maquette_value::{Image, Value as _};

use super::scans::{KINDS, Scan, in_words};

/// The files that the nodes of a recipe read.
#[derive(Clone)]
pub(super) struct Wants {
    /// The node that reads them: `scan`.
    node: String,
    /// Whether it is a `ForEach` over several scans.
    pub(super) many: bool,
    /// The field of the scan itself, and the type of its value.
    scan: (String, String),
    /// The field of its picture, if it has one.
    picture: Option<String>,
    /// Whether the node has the fields `unit` and `axes`.
    has: [bool; 2],
}

impl Wants {
    /// What the first node wants that reads a file as a scan, if there is one.
    pub(super) fn of(recipe: &Recipe, catalog: &Catalog) -> Option<Self> {
        let (tree, _) = parse(recipe.text);
        let nodes = match field(&tree, "nodes").map(|nodes| &nodes.kind) {
            Some(Kind::Map(nodes)) => &nodes[..],
            _ => &[],
        };
        nodes.iter().find_map(|(key, node)| Self::of_node(key.text()?, node, catalog))
    }

    fn of_node(name: &str, node: &Tree, catalog: &Catalog) -> Option<Self> {
        let kind = node.name()?.text;
        let many = kind == "ForEach";
        let (kind, call) = match (many, field(node, "over").map(|over| &over.kind)) {
            (true, Some(Kind::List(elements))) => {
                (field(node, "graph")?.text()?.to_owned(), elements.first()?)
            }
            _ => (kind, node),
        };
        let schema = catalog.find(&kind)?.schema();
        let reads = |field: &str| schema["properties"][field]["reads"].as_str();
        let fields = call.fields()?;
        let scan = fields.iter().find_map(|field| {
            let kind = reads(&field.name.text).filter(|kind| KINDS.contains(kind))?;
            Some((field.name.text.clone(), kind.to_owned()))
        })?;
        let pictures = catalog.readers().endings(Some(Image::NAME));
        let picture = fields
            .iter()
            .find(|field| {
                let file = field.value.text().map(|text| ending(text.as_ref()));
                field.name.text != scan.0 && file.is_some_and(|file| pictures.contains(&&file[..]))
            })
            .map(|field| field.name.text.clone());
        let has = ["unit", "axes"].map(|field| schema["properties"].get(field).is_some());
        Some(Self { node: name.to_owned(), many, scan, picture, has })
    }

    /// Those of the scans that it can read.
    pub(super) fn used<'s>(&self, scans: &'s [Scan]) -> Vec<&'s Scan> {
        let most = if self.many { usize::MAX } else { 1 };
        scans
            .iter()
            .filter(|scan| {
                scan.kind == self.scan.1 && (self.picture.is_none() || scan.picture.is_some())
            })
            .take(most)
            .collect()
    }

    pub(super) fn fit(&self, scans: &[Scan]) -> bool {
        self.used(scans).len() > usize::from(self.many)
    }

    pub(super) fn in_words(&self) -> String {
        let (many, picture) = (self.many, self.picture.is_some());
        let what = in_words(&self.scan.1, if many { 2 } else { 1 });
        let count = if many { "several " } else { "" };
        format!("{count}{what}{}", if picture { " with a picture" } else { "" })
    }

    /// The values of the recipe's fields, relative to the folder of its graph.
    pub(super) fn values(&self, scans: &[Scan], base: &Path) -> Vec<(String, String)> {
        fn path(file: &Path, base: &Path) -> String {
            let file = std::fs::canonicalize(file).unwrap_or_else(|_| file.to_owned());
            quoted(&path_between(base, &file))
        }
        let fields = |scan: &Scan| {
            let mut fields = vec![(self.scan.0.clone(), path(&scan.file, base))];
            let picture = self.picture.iter().zip(&scan.picture);
            fields.extend(picture.map(|(field, picture)| (field.clone(), path(picture, base))));
            let [unit, axes] = self.has;
            fields.extend((unit && scan.in_meters).then(|| ("unit".to_owned(), "M".to_owned())));
            fields.extend((axes && scan.y_up).then(|| ("axes".to_owned(), "YUp".to_owned())));
            fields
        };
        let used = self.used(scans);
        if self.many {
            let elements: Vec<_> = used
                .iter()
                .map(|scan| {
                    let fields =
                        fields(scan).into_iter().map(|(field, value)| format!("{field}: {value}"));
                    format!("({})", Vec::from_iter(fields).join(", "))
                })
                .collect();
            return vec![(format!("{}.over", self.node), format!("[{}]", elements.join(", ")))];
        }
        used.first()
            .map(|scan| fields(scan))
            .unwrap_or_default()
            .into_iter()
            .map(|(field, value)| (format!("{}.{field}", self.node), value))
            .collect()
    }
}

/// The value of a field.
fn field<'t>(tree: &'t Tree, name: &str) -> Option<&'t Tree> {
    Some(&tree.fields()?.iter().find(|field| field.name.text == name)?.value)
}
