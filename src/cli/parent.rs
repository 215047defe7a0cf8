//! Ends this process when its parent ends, even if the parent is killed. The parent is the language server of an editor.

#[cfg(unix)]
use std::time::Duration;

/// Ends this process soon after its parent has ended, if the parent has requested that by an environment variable.
#[cfg(unix)]
pub(crate) fn end_with_parent() {
    const CHECK_INTERVAL: Duration = Duration::from_millis(250);
    let parent = std::env::var(maquette_lsp::PARENT).ok();
    let Some(parent) = parent.and_then(|id| id.parse::<i32>().ok()) else { return };
    // End like after a second Ctrl-C. No output file is left incomplete, because each file is written whole or not at all.
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
    // Two cases are possible. This process may be a grandchild, which inherits the variable but has another parent. Or the parent ended
    // before this process began; only then this process ends, too.
    if maquette_lsp::has_ended(parent.unsigned_abs()) {
        end();
    }
}

/// Does nothing. On this system the language server stops its processes when it ends.
#[cfg(not(unix))]
pub(crate) fn end_with_parent() {}
