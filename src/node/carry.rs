//! What becomes of the attributes of values that pass through a node.

use serde_json::{Value as Json, json};

/// What becomes of the attributes of one domain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// An element that goes on keeps its value; a new one has that of the one that it was made of.
    Kept,
    /// Values are mixed: each lies between those that it is made of.
    Interpolated,
    /// They are not there any more.
    Dropped,
}

/// What becomes of the attributes of a mesh, of points or of a range image, from a port to an output, for each domain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Carry {
    #[doc(hidden)]
    pub port: &'static str,
    #[doc(hidden)]
    pub output: &'static str,
    /// Of meshes and points, by domain, in the order of [`DOMAINS`]; none if the port takes no such values.
    #[doc(hidden)]
    pub fates: Option<[Fate; 4]>,
    /// Of the cells of range images; none if the port takes none.
    #[doc(hidden)]
    pub cells: Option<Fate>,
    /// Attributes that the node makes itself.
    #[doc(hidden)]
    pub own: &'static [&'static str],
}

/// The domains: of points, all is at `vertex`; an edge's attribute is its crease.
#[doc(hidden)]
pub const DOMAINS: [&str; 4] = ["vertex", "corner", "edge", "face"];

impl Carry {
    /// All domains have the same fate.
    pub const fn all(port: &'static str, output: &'static str, fate: Fate) -> Self {
        Self::each(port, output, [fate; 4])
    }

    /// Those of vertices, corners, edges (their creases) and faces.
    pub const fn each(port: &'static str, output: &'static str, fates: [Fate; 4]) -> Self {
        Self { port, output, fates: Some(fates), cells: None, own: &[] }
    }

    /// Those of the cells of a range image, which become those of cells, or of the vertices that are made of them.
    pub const fn cells(port: &'static str, output: &'static str, fate: Fate) -> Self {
        Self { port, output, fates: None, cells: Some(fate), own: &[] }
    }

    /// The same for a port that takes range images, too.
    #[must_use]
    pub const fn and_cells(self, fate: Fate) -> Self {
        Self { cells: Some(fate), ..self }
    }

    /// But for attributes of these names, which the node makes itself, whatever came in.
    #[must_use]
    pub const fn but(self, own: &'static [&'static str]) -> Self {
        Self { own, ..self }
    }

    /// What there is to say, with the names of domains.
    #[doc(hidden)]
    pub fn by_domain(self) -> impl Iterator<Item = (&'static str, Fate)> {
        let fates = self.fates.into_iter().flat_map(|fates| DOMAINS.into_iter().zip(fates));
        fates.chain(self.cells.map(|fate| ("cell", fate)))
    }

    /// As programs are told.
    #[doc(hidden)]
    pub fn to_json(self) -> Json {
        let mut json = json!({ "port": self.port, "output": self.output });
        for (domain, fate) in self.by_domain() {
            json[domain] = json!(fate.word());
        }
        if !self.own.is_empty() {
            json["own"] = json!(self.own);
        }
        json
    }
}

impl Fate {
    /// The word for people.
    #[doc(hidden)]
    pub fn word(self) -> &'static str {
        match self {
            Self::Kept => "kept",
            Self::Interpolated => "interpolated",
            Self::Dropped => "dropped",
        }
    }
}
