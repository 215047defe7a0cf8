//! Results that machines share, through a server or a bucket that keeps files by name: `URL/BUILD/NAME`.
//!
//! What it gives is believed exactly as what is on disk: if its checksum, which is one of its name, too, fits. It is a help, never a
//! need: after the first request that fails or is not answered in time, or when it has cost more time than it has saved, it is left
//! alone; and what it is sent nobody waits for, see `uploads`.
//!
//! Begin reading in `remote.rs`. This crate knows names and bytes, and nothing of values or graphs.

#![allow(missing_docs, reason = "what others may use is documented where `maquette` hands it on")]

mod address;
// Tests have buckets in any build.
#[cfg_attr(not(any(test, feature = "s3")), path = "no_bucket.rs")]
mod bucket;
mod client;
mod remote;
#[cfg(any(test, feature = "s3"))]
mod signature;
mod uploads;

/// Whether this build speaks https.
pub const HTTPS: bool = cfg!(feature = "tls");

/// Whether it speaks to buckets.
pub const BUCKETS: bool = cfg!(feature = "s3");

pub use address::Address;
pub use remote::{Exchange, Remote, reach};
