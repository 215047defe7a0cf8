//! Detects that standard output was closed before the program began, for example by `>&-` in a shell.
//!
//! Rust's runtime opens `/dev/null` in place of a closed stream. So after the runtime has started, a closed stream looks like `>
//! /dev/null`.
//!
//! Therefore the check runs before the runtime: it is a function in the section `.init_array`, which Linux calls first.

#![allow(unsafe_code, reason = "the system calls a function before the runtime begins")]

use std::sync::atomic::{AtomicBool, Ordering};

static WAS_CLOSED: AtomicBool = AtomicBool::new(false);

/// Returns true if standard output was closed when the program began.
pub(crate) fn was_closed() -> bool {
    WAS_CLOSED.load(Ordering::Relaxed)
}

extern "C" fn check_stdout() {
    // SAFETY: `fcntl` accepts any file descriptor, and returns an error for a closed one. The function does not need Rust's runtime.
    let flags = unsafe { libc::fcntl(libc::STDOUT_FILENO, libc::F_GETFD) };
    WAS_CLOSED.store(flags < 0, Ordering::Relaxed);
}

// SAFETY: the section contains pointers to functions without arguments and results. The system calls each of them once, before `main`.
#[used]
#[unsafe(link_section = ".init_array")]
static CHECK_STDOUT: extern "C" fn() = check_stdout;
