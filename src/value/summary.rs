//! What people are told of a value.

/// Labelled facts in reading order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary(pub Vec<(String, serde_json::Value)>);

impl Summary {
    /// Adds one fact.
    #[must_use]
    pub fn with(mut self, label: &str, fact: impl Into<serde_json::Value>) -> Self {
        self.0.push((label.to_owned(), fact.into()));
        self
    }

    /// Adds how often numbers fall into each of 32 equal parts of their range: `{"from", "to", "counts"}`. Numbers that are not
    /// finite do not count; without any other there is no such fact.
    #[must_use]
    pub fn with_histogram(self, label: &str, numbers: impl Iterator<Item = f64> + Clone) -> Self {
        const PARTS: usize = 32;
        let finite = numbers.filter(|x| x.is_finite());
        let start = (f64::INFINITY, f64::NEG_INFINITY);
        let (from, to) = finite.clone().fold(start, |(lo, hi), x| (lo.min(x), hi.max(x)));
        if to < from {
            return self;
        }
        let mut counts = vec![0u64; PARTS];
        for x in finite {
            let part = (x - from) / (to - from) * PARTS as f64;
            // All numbers equal: NaN, which becomes part 0.
            counts[(part as usize).min(PARTS - 1)] += 1;
        }
        self.with(label, serde_json::json!({ "from": from, "to": to, "counts": counts }))
    }
}
