//! The scans that a recipe needs, and which of the found scans it can use.

use std::path::Path;

use maquette_graph::catalog::Catalog;
use maquette_node::pack::Recipe;
use maquette_syntax::paths::path_between;
use maquette_syntax::{Kind, Tree, parse, quote};
use maquette_value::fs::extension;
use maquette_value::{Image, Value as _};

use super::scans::{KINDS, Scan, in_words};

/// The scans that a recipe needs: those that are read by its first node with a field for a scan file.
#[derive(Clone)]
pub(super) struct ScanRequirements {
    /// The name of the node that reads the scans, such as `scan`.
    node: String,
    /// True if the node is a `ForEach` over several scans, false if it reads one scan.
    pub(super) is_list: bool,
    /// The name of the field for the scan file, and the value type of the scan.
    scan: (String, String),
    /// The name of the field for the picture, if the node has one.
    picture: Option<String>,
    /// Two flags: if the node has a field `unit`, and if it has a field `axes`.
    has_unit_and_axes: [bool; 2],
}

impl ScanRequirements {
    /// Returns the scans that a recipe needs, or `None` if none of its nodes reads a scan.
    pub(super) fn for_recipe(recipe: &Recipe, catalog: &Catalog) -> Option<Self> {
        let (tree, _) = parse(recipe.text);
        let nodes = match field(&tree, "nodes").map(|nodes| &nodes.kind) {
            Some(Kind::Map(nodes)) => &nodes[..],
            _ => &[],
        };
        nodes.iter().find_map(|(key, node)| Self::for_node(key.text()?, node, catalog))
    }

    fn for_node(name: &str, node: &Tree, catalog: &Catalog) -> Option<Self> {
        let kind = node.name()?.text;
        let many = kind == "ForEach";
        let (kind, call) = match (many, field(node, "over").map(|over| &over.kind)) {
            (true, Some(Kind::List(elements))) => {
                (field(node, "graph")?.text()?.to_owned(), elements.first()?)
            }
            _ => (kind, node),
        };
        let schema = catalog.find(&kind)?.schema();
        let fields = call.fields()?;
        let scan = fields.iter().find_map(|field| {
            let kind = schema["properties"][&field.name.text[..]]["reads"].as_str();
            let kind = kind.filter(|kind| KINDS.contains(kind))?;
            Some((field.name.text.clone(), kind.to_owned()))
        })?;
        let pictures = catalog.readers().extensions(Some(Image::NAME));
        let picture = fields
            .iter()
            .find(|field| {
                let file = field.value.text().map(|text| extension(text.as_ref()));
                field.name.text != scan.0 && file.is_some_and(|file| pictures.contains(&&file[..]))
            })
            .map(|field| field.name.text.clone());
        let has = ["unit", "axes"].map(|field| schema["properties"].get(field).is_some());
        Some(Self { node: name.to_owned(), is_list: many, scan, picture, has_unit_and_axes: has })
    }

    /// Returns the scans that the recipe can use.
    pub(super) fn usable_scans<'s>(&self, scans: &'s [Scan]) -> Vec<&'s Scan> {
        let most = if self.is_list { usize::MAX } else { 1 };
        scans
            .iter()
            .filter(|scan| {
                scan.kind == self.scan.1 && (self.picture.is_none() || scan.picture.is_some())
            })
            .take(most)
            .collect()
    }

    pub(super) fn is_satisfied(&self, scans: &[Scan]) -> bool {
        self.usable_scans(scans).len() > usize::from(self.is_list)
    }

    pub(super) fn in_words(&self) -> String {
        let (many, picture) = (self.is_list, self.picture.is_some());
        let what = in_words(&self.scan.1, if many { 2 } else { 1 });
        let count = if many { "several " } else { "" };
        format!("{count}{what}{}", if picture { " with a picture" } else { "" })
    }

    /// Returns the fields of the recipe that name the scan files, as pairs of name and value. Paths are relative to `base`, the folder of
    /// the graph.
    pub(super) fn values(&self, scans: &[Scan], base: &Path) -> Vec<(String, String)> {
        let used = self.usable_scans(scans);
        if self.is_list {
            let elements: Vec<_> = used
                .iter()
                .map(|scan| {
                    let fields = self.scan_fields(scan, base).into_iter();
                    let fields = fields.map(|(field, value)| format!("{field}: {value}"));
                    format!("({})", Vec::from_iter(fields).join(", "))
                })
                .collect();
            return vec![(format!("{}.over", self.node), format!("[{}]", elements.join(", ")))];
        }
        used.first()
            .map(|scan| self.scan_fields(scan, base))
            .unwrap_or_default()
            .into_iter()
            .map(|(field, value)| (format!("{}.{field}", self.node), value))
            .collect()
    }

    /// Returns the fields that name the files of one scan, as pairs of name and value.
    fn scan_fields(&self, scan: &Scan, base: &Path) -> Vec<(String, String)> {
        fn path(file: &Path, base: &Path) -> String {
            let file = std::fs::canonicalize(file).unwrap_or_else(|_| file.to_owned());
            quote(&path_between(base, &file))
        }
        let mut fields = vec![(self.scan.0.clone(), path(&scan.file, base))];
        let picture = self.picture.iter().zip(&scan.picture);
        fields.extend(picture.map(|(field, picture)| (field.clone(), path(picture, base))));
        let [unit, axes] = self.has_unit_and_axes;
        fields.extend((unit && scan.in_meters).then(|| ("unit".to_owned(), "M".to_owned())));
        fields.extend((axes && scan.y_up).then(|| ("axes".to_owned(), "YUp".to_owned())));
        fields
    }
}

/// Returns the value of the field `name` of a call, if the call has it.
fn field<'t>(tree: &'t Tree, name: &str) -> Option<&'t Tree> {
    Some(&tree.fields()?.iter().find(|field| field.name.text == name)?.value)
}
