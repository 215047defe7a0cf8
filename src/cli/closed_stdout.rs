//! Standard output that was closed before the program began, as by `>&-` in a shell.
//!
//! Rust's runtime opens `/dev/null` in place of a closed stream, for reading and writing, as other programs do for a child whose output nobody
//! wants. So the difference can only be seen before the runtime begins.
//!
//! The function that looks is in the section `.init_array` (Linux): the system calls it before the runtime begins.

#![allow(unsafe_code, reason = "the system calls a function before the runtime begins")]

use std::sync::atomic::{AtomicBool, Ordering};

static WAS_CLOSED: AtomicBool = AtomicBool::new(false);

/// Returns true if standard output was closed when the program began.
pub(crate) fn was_closed() -> bool {
    WAS_CLOSED.load(Ordering::Relaxed)
}

extern "C" fn look() {
    // SAFETY: `fcntl` takes any number; that of a closed file is an error of it. Nothing here needs the runtime.
    let flags = unsafe { libc::fcntl(libc::STDOUT_FILENO, libc::F_GETFD) };
    WAS_CLOSED.store(flags < 0, Ordering::Relaxed);
}

// SAFETY: the section holds pointers to functions without results, each of which the system calls once, before `main`.
#[used]
#[unsafe(link_section = ".init_array")]
static LOOK: extern "C" fn() = look;
