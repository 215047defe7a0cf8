//! Remote caches: machines share results through an HTTP server or an S3 bucket, which stores each file under the URL `URL/BUILD/NAME`.
//!
//! Files are verified, like those in the cache on disk, by a checksum that also covers the file name. The remote cache is optional. After
//! the first request that fails or times out, or when it has cost more time than it has saved, it is not used again. Uploads run in the
//! background, see `uploads`.
//!
//! Start reading in `remote.rs`. This crate handles names and bytes, and does not depend on values or graphs.

#![allow(missing_docs, reason = "what others may use is documented where `maquette` hands it on")]

mod address;
// The tests of buckets run even if the feature `s3` is disabled.
#[cfg_attr(not(any(test, feature = "s3")), path = "no_bucket.rs")]
mod bucket;
mod client;
mod remote;
#[cfg(any(test, feature = "s3"))]
mod signature;
mod uploads;

/// True if this build of the program supports https addresses.
pub const HTTPS: bool = cfg!(feature = "tls");

/// True if this build of the program supports addresses of S3 buckets.
pub const BUCKETS: bool = cfg!(feature = "s3");

pub use address::Address;
pub use remote::{Remote, RequestCounts, check_server};
