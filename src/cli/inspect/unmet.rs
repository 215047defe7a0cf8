//! Formats the required properties that a value does not have.

use std::fmt::Write;

use maquette_graph::UnmetRequirement;

use super::format_fact;

/// The maximum number of violating elements that are listed for each property. The option `--json` lists all.
const MAX_LISTED: usize = 20;

/// Formats each unmet requirement, with the violating elements and their centers in mm.
pub(super) fn format_unmet(broken: &[UnmetRequirement]) -> String {
    let mut text = String::new();
    for broken in broken {
        let _ = writeln!(text, "  {}", broken.in_words());
        let listed = &broken.violation.elements[..broken.violation.elements.len().min(MAX_LISTED)];
        let longest = listed.iter().map(|element| element.name.len()).max().unwrap_or(0);
        for element in listed {
            let place = format_fact(&element.center().coords.as_slice().into());
            let _ = writeln!(text, "    {:<longest$}  {place}", element.name);
        }
        let more = broken.violation.count.saturating_sub(listed.len());
        if 0 < more {
            let _ = writeln!(text, "    and {more} more");
        }
    }
    text
}
