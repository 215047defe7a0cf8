//! Handlers for Ctrl-C and termination signals.

use std::sync::Mutex;

use maquette_node::CancelToken;

/// Cancels `token` at the first Ctrl-C or termination signal. A second signal ends the program at once, because a node may ignore the
/// token.
pub(super) fn cancel_on_interrupt(token: &CancelToken) {
    let token = token.clone();
    on_interrupt(move || {
        if token.is_cancelled() {
            std::process::exit(130);
        }
        token.cancel();
    });
}

/// Calls `action` at each Ctrl-C or termination signal.
pub(super) fn on_interrupt(action: impl Fn() + Send + 'static) {
    let action = Mutex::new(action);
    // Ignore an error: without a handler, a signal simply ends the program.
    let _ =
        ctrlc::set_handler(move || action.lock().unwrap_or_else(|broken| broken.into_inner())());
}
