//! The state of checking one file, which each part of the check adds to.

use std::collections::HashSet;
use std::sync::Arc;

use maquette_syntax::error::{MOST_TOLD, Span, Use, code};
use maquette_syntax::{Doubts, Finding, Help, Sheet};

use crate::world::World;

/// Checks one file.
pub struct Check<'w, 'a> {
    pub(super) world: &'w mut World<'a>,
    pub(super) sheet: Arc<Sheet>,
    /// The uses that lead to the file.
    pub(super) uses: Vec<Use>,
    pub(super) findings: Vec<Finding>,
    /// How many links that lead to other links have been followed.
    pub(super) depth: usize,
    /// The packs that the file says it needs and the program does not have, with their versions.
    pub(super) missing_packs: Vec<String>,
    /// What stands as a name and cannot be one, of which nothing more is said.
    pub(super) misnamed: HashSet<String>,
    /// Of texts with syntax errors, the parts that may say something else than was meant.
    pub(super) doubts: Option<Doubts>,
}

impl<'w, 'a> Check<'w, 'a> {
    pub fn new(world: &'w mut World<'a>, sheet: Arc<Sheet>, uses: Vec<Use>) -> Self {
        let (findings, missing_packs, misnamed) = (Vec::new(), Vec::new(), HashSet::new());
        let doubts = None;
        Self { world, sheet, uses, findings, depth: 0, missing_packs, misnamed, doubts }
    }

    /// Whether the file is that of the graph itself, and not of one that it uses.
    pub(super) fn is_first(&self) -> bool {
        self.uses.is_empty()
    }

    pub(super) fn find(
        &mut self,
        code: &'static str,
        span: Span,
        message: String,
        help: impl Into<Help>,
    ) {
        self.findings.push(Finding { code, span, message, help: help.into(), note: None });
    }

    /// Reports a name that stands in the way of another one, which is noted.
    pub(super) fn find_beside(
        &mut self,
        span: Span,
        message: String,
        help: &str,
        note: (Span, String),
    ) {
        let (code, help, note) = (code::BAD_NAME, help.into(), Some(note));
        self.findings.push(Finding { code, span, message, help, note });
    }

    /// What may have been meant, as long as problems are few enough to be told: a guess looks at all that there is.
    pub(super) fn guess(&self, make: impl FnOnce() -> Help) -> Help {
        let known = self.world.problems.len() + self.findings.len();
        if known < MOST_TOLD { make() } else { Help::default() }
    }
}

#[cfg(test)]
mod tests;
