//! Summaries of values for people.

use crate::parallel::UntilStopped;

/// Labelled facts in reading order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary(pub Vec<(String, serde_json::Value)>);

impl Summary {
    /// Appends a fact with a label.
    #[must_use]
    pub fn with_fact(mut self, label: &str, fact: impl Into<serde_json::Value>) -> Self {
        self.0.push((label.to_owned(), fact.into()));
        self
    }

    /// Adds a histogram as `{"from", "to", "counts"}`: the range of the numbers is divided into 32 equal parts, and the numbers in each
    /// part are counted. Numbers that are not finite are ignored. If no number is finite, no fact is added.
    #[must_use]
    pub fn with_histogram(self, label: &str, numbers: impl Iterator<Item = f64> + Clone) -> Self {
        const PARTS: usize = 32;
        let finite = numbers.until_stopped().filter(|x| x.is_finite());
        let start = (f64::INFINITY, f64::NEG_INFINITY);
        let (from, to) = finite.clone().fold(start, |(lo, hi), x| (lo.min(x), hi.max(x)));
        if to < from {
            return self;
        }
        let mut counts = vec![0u64; PARTS];
        for x in finite {
            let part = (x - from) / (to - from) * PARTS as f64;
            // If all numbers are equal, `part` is NaN, and the cast of NaN gives 0.
            counts[(part as usize).min(PARTS - 1)] += 1;
        }
        self.with_fact(label, serde_json::json!({ "from": from, "to": to, "counts": counts }))
    }
}
