//! What an editor's server runs ends with that server, even if it is killed.

#[cfg(unix)]
use std::time::Duration;

/// Ends this process soon after its parent has ended, if the parent asks for that.
#[cfg(unix)]
pub(crate) fn end_with_it() {
    const PERIOD: Duration = Duration::from_millis(250);
    let parent = std::env::var(maquette_lsp::PARENT).ok();
    let Some(parent) = parent.and_then(|id| id.parse::<i32>().ok()) else { return };
    // As if interrupted twice: files appear whole or not at all.
    fn end() -> ! {
        std::process::exit(130)
    }
    let is_there =
        move || rustix::process::getppid().is_some_and(|id| id.as_raw_nonzero().get() == parent);
    if is_there() {
        std::thread::spawn(move || {
            while is_there() {
                std::thread::sleep(PERIOD);
            }
            end();
        });
        return;
    }
    // A process further down inherits the variable and has another parent; or the parent has ended before this one began.
    if maquette_lsp::has_ended(parent.unsigned_abs()) {
        end();
    }
}

/// Not known here: the server stops what it runs when it ends.
#[cfg(not(unix))]
pub(crate) fn end_with_it() {}
