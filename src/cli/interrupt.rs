//! Ctrl-C, and the requests of the system to end.

use std::sync::Mutex;

use maquette_node::CancelToken;

/// Cancels when the user, or the system, asks the program to end. Asked again, the program ends at once: a plugin's node may not
/// listen.
pub(super) fn cancels(token: &CancelToken) {
    let token = token.clone();
    handle(move || {
        if token.is_cancelled() {
            std::process::exit(130);
        }
        token.cancel();
    });
}

/// Calls this whenever the program is asked to end.
pub(super) fn handle(action: impl Fn() + Send + 'static) {
    let action = Mutex::new(action);
    // Where there are no signals the program ends without being asked.
    let _ =
        ctrlc::set_handler(move || action.lock().unwrap_or_else(|broken| broken.into_inner())());
}
