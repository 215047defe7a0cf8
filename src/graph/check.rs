//! The state of the check of one graph file. Each step of the check adds diagnostics to the state.

use std::collections::HashSet;
use std::sync::Arc;

use maquette_syntax::error::{MAX_REPORTED, Span, Use, code};
use maquette_syntax::{Help, LocalDiagnostic, SourceMap, UncertainParts};

use crate::world::World;

/// The check of one graph file: its context, and the diagnostics found so far.
pub struct Check<'w, 'a> {
    pub(super) world: &'w mut World<'a>,
    pub(super) source_map: Arc<SourceMap>,
    /// The path from the root graph to this file: each item is a node that uses the next graph. Empty for the root graph.
    pub(super) uses: Vec<Use>,
    pub(super) diagnostics: Vec<LocalDiagnostic>,
    /// The number of links that have been followed one after the other, to detect endless chains.
    pub(super) depth: usize,
    /// The packs that the file requires and this program does not have, with their versions.
    pub(super) missing_packs: Vec<String>,
    /// Names that have been reported as invalid. No further errors about them are reported.
    pub(super) misnamed: HashSet<String>,
    /// The parts of the file that the parser may have misread because of syntax errors. `None` if the file has no syntax errors.
    pub(super) doubts: Option<UncertainParts>,
}

impl<'w, 'a> Check<'w, 'a> {
    pub fn new(world: &'w mut World<'a>, source_map: Arc<SourceMap>, uses: Vec<Use>) -> Self {
        let (diagnostics, missing_packs, misnamed) = (Vec::new(), Vec::new(), HashSet::new());
        let doubts = None;
        Self { world, source_map, uses, diagnostics, depth: 0, missing_packs, misnamed, doubts }
    }

    /// Returns true for the file of the root graph, and false for the files of graphs that it uses.
    pub(super) fn is_root(&self) -> bool {
        self.uses.is_empty()
    }

    pub(super) fn report(
        &mut self,
        code: &'static str,
        span: Span,
        message: String,
        help: impl Into<Help>,
    ) {
        self.diagnostics.push(LocalDiagnostic::new(code, span, message, help));
    }

    /// Reports a name that conflicts with another name. A note shows the position of the other name.
    pub(super) fn report_with_note(
        &mut self,
        span: Span,
        message: String,
        help: &str,
        note: (Span, String),
    ) {
        let (code, help, note) = (code::BAD_NAME, help.into(), Some(note));
        self.diagnostics.push(LocalDiagnostic { code, span, message, help, note });
    }

    /// Returns the suggestion that `make` computes by comparing many names. Skips the work if enough diagnostics are known already.
    pub(super) fn guess(&self, make: impl FnOnce() -> Help) -> Help {
        let known = self.world.diagnostics.len() + self.diagnostics.len();
        if known < MAX_REPORTED { make() } else { Help::default() }
    }
}

#[cfg(test)]
mod tests;
