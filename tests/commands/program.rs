//! Runs of the program in a folder.

use std::path::Path;
use std::process::{Command, Output};

/// Returns a command of the program, with the user's cache and without colors.
pub(crate) fn command(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_maquette"));
    command.args(arguments).current_dir(folder).env("NO_COLOR", "1");
    command
}

/// Runs the program with a cache in `folder`, as on a machine without CI.
pub(crate) fn maquette(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = command(folder, arguments);
    command.env_remove("CI").env("MAQUETTE_CACHE", folder.join("cache")).output().unwrap()
}
