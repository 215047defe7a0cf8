//! Remote caches: machines share results through an HTTP server or a bucket that stores files by name: `URL/BUILD/NAME`.
//!
//! Files are verified like those on disk: by a checksum that also covers the name. The cache is optional. It is not used any more after the
//! first request that fails or times out, or when it has cost more time than it has saved. Uploads run in the background, see `uploads`.
//!
//! Read `remote.rs` first. This crate handles names and bytes, and does not depend on values or graphs.

#![allow(missing_docs, reason = "what others may use is documented where `maquette` hands it on")]

mod address;
// Tests of buckets run in any build.
#[cfg_attr(not(any(test, feature = "s3")), path = "no_bucket.rs")]
mod bucket;
mod client;
mod remote;
#[cfg(any(test, feature = "s3"))]
mod signature;
mod uploads;

/// True if this build supports https addresses.
pub const HTTPS: bool = cfg!(feature = "tls");

/// True if this build supports addresses of S3 buckets.
pub const BUCKETS: bool = cfg!(feature = "s3");

pub use address::Address;
pub use remote::{Remote, RequestCounts, check_server};
