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
    /// Returns the location in the graph file of the node whose box in the diagram has this name, if pages show such a box.
    pub(super) fn box_location(&self, name: &str) -> Option<Location> {
        let text = lock_ignoring_poison(&self.feed).graph.clone()?;
        let graph: Json = serde_json::from_str(&text).ok()?;
        let mut boxes = graph["boxes"].as_array()?.iter();
        Location::deserialize(boxes.find(|item| item["name"] == name)?).ok()
    }

    /// Returns true if a current diagnostic, its note, or a use of a graph that leads to it is at this location. A page may open only these
    /// locations and those of boxes.
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
