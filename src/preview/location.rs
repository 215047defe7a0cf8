//! Locations in source files. A page may ask the watch to open some of them in an editor.

use std::path::PathBuf;

use serde::Deserialize;
use serde_json::Value as Json;

use super::{PageState, lock_ignoring_poison};

/// A line and column of a file, both counted from 1.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
pub struct Location {
    pub file: PathBuf,
    pub line: usize,
    pub column: usize,
}

impl PageState {
    /// Returns the location of a node in the graph file, given the name of the node's box in the diagram. Returns `None` if pages show no
    /// box with this name.
    pub(super) fn box_location(&self, name: &str) -> Option<Location> {
        let text = lock_ignoring_poison(&self.feed).graph.clone()?;
        let graph: Json = serde_json::from_str(&text).ok()?;
        let mut boxes = graph["boxes"].as_array()?.iter();
        Location::deserialize(boxes.find(|item| item["name"] == name)?).ok()
    }

    /// Returns true if this is the location of a current diagnostic, of its note, or of a use of a graph that leads to the diagnostic.
    /// Apart from the locations of boxes, a page may open only these locations.
    pub(super) fn has_problem_at(&self, place: &Location) -> bool {
        let text = lock_ignoring_poison(&self.feed).problems.clone();
        let event = text.and_then(|text| serde_json::from_str::<Json>(&text).ok());
        let problems = event.iter().flat_map(|event| event["problems"].as_array()).flatten();
        let is_it = |item: &Json| Location::deserialize(item).is_ok_and(|found| found == *place);
        problems.into_iter().any(|problem| {
            let is_end = is_it(problem) || is_it(&problem["note"]);
            is_end || problem["uses"].as_array().is_some_and(|uses| uses.iter().any(is_it))
        })
    }
}
