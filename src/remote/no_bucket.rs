//! Replaces the module `bucket` in builds without the feature `s3`.

use std::convert::Infallible;

use ureq::http::StatusCode;

/// A type without values: in this build, an address is never that of a bucket.
#[derive(Clone, PartialEq, Eq)]
pub(super) struct Bucket(Infallible);

impl Bucket {
    pub(super) fn parse(_: &str, _: impl Fn(&str) -> Option<String>) -> Result<Self, String> {
        Err("buckets are not supported by this build: build with the feature `s3`".into())
    }

    pub(super) fn url(&self, _: &str) -> String {
        match self.0 {}
    }

    pub(super) fn headers(&self, _: &str, _: &str) -> Vec<(&'static str, String)> {
        match self.0 {}
    }

    pub(super) fn refusal(&self, _: StatusCode, _: Option<&str>, _: &str) -> Option<String> {
        match self.0 {}
    }
}
