//! Places in files that pages may have opened in an editor.

use std::path::PathBuf;

use serde::Deserialize;
use serde_json::Value as Json;

use super::{Shared, unpoisoned};

/// A place in a file, as people count: from 1.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
pub struct Location {
    pub file: PathBuf,
    pub line: usize,
    pub column: usize,
}

impl Shared {
    /// Where the box of this name stands, if pages were told.
    pub(super) fn place_of_box(&self, name: &str) -> Option<Location> {
        let text = unpoisoned(&self.feed).graph.clone()?;
        let graph: Json = serde_json::from_str(&text).ok()?;
        let mut boxes = graph["boxes"].as_array()?.iter();
        Location::deserialize(boxes.find(|told| told["name"] == name)?).ok()
    }

    /// Whether pages were told of a problem, of its other end, or of a use that leads to one, at this place now.
    pub(super) fn has_problem_at(&self, place: &Location) -> bool {
        let text = unpoisoned(&self.feed).problems.clone();
        let told = text.and_then(|text| serde_json::from_str::<Json>(&text).ok());
        let problems = told.iter().flat_map(|told| told["problems"].as_array()).flatten();
        let is_it = |told: &Json| Location::deserialize(told).is_ok_and(|told| told == *place);
        problems.into_iter().any(|problem| {
            let is_end = is_it(problem) || is_it(&problem["note"]);
            is_end || problem["uses"].as_array().is_some_and(|uses| uses.iter().any(is_it))
        })
    }
}
