//! Ends this process when its parent ends, even if the parent is killed. The parent is the language server of an editor.

#[cfg(unix)]
use std::time::Duration;

/// Ends this process soon after its parent has ended, if the parent requested that by an environment variable.
#[cfg(unix)]
pub(crate) fn end_with_parent() {
    const CHECK_INTERVAL: Duration = Duration::from_millis(250);
    let parent = std::env::var(maquette_lsp::PARENT).ok();
    let Some(parent) = parent.and_then(|id| id.parse::<i32>().ok()) else { return };
    // Ends the process as a second interrupt does. No output file is incomplete, because each file is written completely or not at all.
    fn end() -> ! {
        std::process::exit(130)
    }
    let is_there =
        move || rustix::process::getppid().is_some_and(|id| id.as_raw_nonzero().get() == parent);
    if is_there() {
        std::thread::spawn(move || {
            while is_there() {
                std::thread::sleep(CHECK_INTERVAL);
            }
            end();
        });
        return;
    }
    // Either this process is a grandchild, which inherits the variable but has another parent, or the parent ended before this process
    // began.
    if maquette_lsp::has_ended(parent.unsigned_abs()) {
        end();
    }
}

/// Does nothing on this system: the server stops its processes when it ends.
#[cfg(not(unix))]
pub(crate) fn end_with_it() {}
