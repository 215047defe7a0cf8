//! What of a value is not as it is asked to be, in words.

use std::fmt::Write;

use maquette_graph::Broken;

use super::in_words;

/// So many elements are listed for people; programs get all that are known.
const LISTED: usize = 20;

/// A sentence for each property, and the elements that offend, each with the middle of it in mm.
pub(super) fn table(broken: &[Broken]) -> String {
    let mut text = String::new();
    for broken in broken {
        let _ = writeln!(text, "  {}", broken.in_words());
        let listed = || broken.offence.elements.iter().take(LISTED);
        let longest = listed().map(|element| element.name.len()).max().unwrap_or(0);
        for element in listed() {
            let place = in_words(&element.place().coords.as_slice().into());
            let _ = writeln!(text, "    {:<longest$}  {place}", element.name);
        }
        let more = broken.offence.count.saturating_sub(listed().count());
        if 0 < more {
            let _ = writeln!(text, "    and {more} more");
        }
    }
    text
}
