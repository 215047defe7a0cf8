//! Test data that stands beside the project on some machines only.

use std::io::Write as _;
use std::path::{Path, PathBuf};

/// What is at this place in the folder `shared` beside the project; where it is not there, one line says that a test is skipped, also if
/// the test passes.
pub(crate) fn beside(what: &str) -> Option<PathBuf> {
    // The project's folder, or that of one of its crates.
    let folders = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().take(3);
    let mut places = folders.map(|folder| folder.join("../shared").join(what));
    if let Some(path) = places.find(|path| path.exists()) {
        return Some(path);
    }
    // What the macros print is shown for failed tests alone.
    let _ = writeln!(std::io::stderr(), "skipped: ../shared/{what} is not there");
    None
}
