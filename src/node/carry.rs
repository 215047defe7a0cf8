//! Declares how a node transfers the attributes of its inputs to its outputs.

use serde_json::{Value as Json, json};

/// How a node transfers the attributes of one domain, such as vertices, from an input to an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transfer {
    /// Elements (such as vertices) that the node keeps have their old attribute values. A new element gets the values of one old element,
    /// from which it was made.
    Kept,
    /// Each new value is interpolated between the values of the old elements from which the new element was made.
    Interpolated,
    /// The output does not have the attributes of the input.
    Dropped,
}

/// The transfer of the attributes of a mesh, of points or of a range image from a port to an output. Each domain has its own transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Carry {
    #[doc(hidden)]
    pub port: &'static str,
    #[doc(hidden)]
    pub output: &'static str,
    /// The transfers for meshes and points, one per domain in the order of [`DOMAINS`]. `None` if the port takes only range images.
    #[doc(hidden)]
    pub transfers: Option<[Transfer; 4]>,
    /// The transfer for the cells of range images. `None` if the port does not take range images.
    #[doc(hidden)]
    pub cells: Option<Transfer>,
    /// The names of attributes of the output that the node computes itself, instead of transferring them.
    #[doc(hidden)]
    pub own: &'static [&'static str],
}

/// The names of the domains. Attributes of points belong to the domain `vertex`. The only attribute of an edge is its crease.
#[doc(hidden)]
pub const DOMAINS: [&str; 4] = ["vertex", "corner", "edge", "face"];

impl Carry {
    /// Declares the same transfer for vertices, corners, edges and faces.
    pub const fn uniform(port: &'static str, output: &'static str, fate: Transfer) -> Self {
        Self::per_domain(port, output, [fate; 4])
    }

    /// Declares the transfers of vertices, corners, edges (their creases) and faces.
    pub const fn per_domain(
        port: &'static str,
        output: &'static str,
        fates: [Transfer; 4],
    ) -> Self {
        Self { port, output, transfers: Some(fates), cells: None, own: &[] }
    }

    /// Declares the transfer of the cells of a range image. The output has cells, or vertices that are made from the cells.
    pub const fn cells(port: &'static str, output: &'static str, fate: Transfer) -> Self {
        Self { port, output, transfers: None, cells: Some(fate), own: &[] }
    }

    /// Adds the transfer of cells, for a port that takes range images as well as meshes or points.
    #[must_use]
    pub const fn and_cells(self, fate: Transfer) -> Self {
        Self { cells: Some(fate), ..self }
    }

    /// Excludes attributes from the transfer, because the node computes them itself.
    #[must_use]
    pub const fn excluding(self, own: &'static [&'static str]) -> Self {
        Self { own, ..self }
    }

    /// Returns the declared transfers, each with the name of its domain.
    #[doc(hidden)]
    pub fn by_domain(self) -> impl Iterator<Item = (&'static str, Transfer)> {
        let fates = self.transfers.into_iter().flat_map(|fates| DOMAINS.into_iter().zip(fates));
        fates.chain(self.cells.map(|fate| ("cell", fate)))
    }

    /// Returns the declaration in the form that `maquette nodes --json` prints.
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

impl Transfer {
    /// Returns the word for the transfer in the manual.
    #[doc(hidden)]
    pub fn word(self) -> &'static str {
        match self {
            Self::Kept => "kept",
            Self::Interpolated => "interpolated",
            Self::Dropped => "dropped",
        }
    }
}
