//! Test data in a folder beside the project, which only some machines have.

use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Returns the path of a file or folder in `shared` beside the project. If it does not exist, prints a line that the test is skipped; the
/// line is visible although the test passes.
pub(crate) fn shared_folder(what: &str) -> Option<PathBuf> {
    // The manifest is in the project's folder or in that of one of its crates.
    let folders = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().take(3);
    let mut places = folders.map(|folder| folder.join("../shared").join(what));
    if let Some(path) = places.find(|path| path.exists()) {
        return Some(path);
    }
    // Written to stderr directly: the output of print macros is shown only for failed tests.
    let _ = writeln!(std::io::stderr(), "skipped: ../shared/{what} is not there");
    None
}
