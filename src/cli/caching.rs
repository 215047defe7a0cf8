//! How much is remembered, and where.

use std::path::PathBuf;

use clap::Args;

use super::eprint;
use crate::catalog::Catalog;
use crate::eval::{Disk, DiskError, Evaluator};

/// What shapes the memory of results.
#[derive(Args)]
pub(super) struct CacheOptions {
    /// The folder of results that are kept from one run to the next [default: $MAQUETTE_CACHE, or `maquette` in the system's
    /// folder for caches].
    #[arg(long = "cache", value_name = "DIR")]
    folder: Option<PathBuf>,
    /// Neither use nor keep results on disk.
    #[arg(long, conflicts_with = "folder")]
    no_cache: bool,
    /// How much memory results may hold when no node needs them any more, as 500MB or 2GB. What nodes are working on, the files
    /// that they read and the program itself, some 20 MB, come on top.
    #[arg(long, value_name = "SIZE", default_value = "2GB", value_parser = size)]
    memory: u64,
    /// Compute this percentage of the cached results all the same, and name every node whose result differs.
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0, value_parser = percentage)]
    verify_cache: f64,
}

/// How much the disk cache may hold, unless `MAQUETTE_CACHE_SIZE` says otherwise.
const DISK_SIZE: u64 = 4_000_000_000;

impl CacheOptions {
    /// How many bytes of memory results may hold.
    pub(super) fn memory(&self) -> usize {
        usize::try_from(self.memory).unwrap_or(usize::MAX)
    }

    /// An evaluator that remembers as the user wishes; a cache that cannot be used is a warning.
    pub(super) fn evaluator(&self, threads: usize, catalog: &Catalog) -> Result<Evaluator, String> {
        let evaluator =
            Evaluator::new(threads, self.memory()).map_err(|error| error.to_string())?;
        let evaluator = evaluator.verifying(self.verify_cache / 100.0);
        if self.no_cache {
            return Ok(evaluator);
        }
        let Some(folder) = self.folder.clone().or_else(default_folder) else {
            return Ok(evaluator);
        };
        match Disk::open(&folder, disk_size()?, catalog) {
            Ok(disk) => Ok(evaluator.with_disk(disk)),
            // Who names somebody's folder here does not mean what it says.
            Err(error @ (DiskError::Foreign(_) | DiskError::OtherUser(_)))
                if self.folder.is_some() =>
            {
                Err(format!("{error}; --cache chooses another folder"))
            }
            Err(error) => {
                eprint(&format!(
                    "warning: {error}; results are not kept (--cache chooses another folder)\n"
                ));
                Ok(evaluator)
            }
        }
    }
}

/// Waits until results are on disk, and says so if they cannot be kept.
pub(super) fn finish(evaluator: &Evaluator) {
    let Some(disk) = evaluator.disk() else { return };
    disk.finish();
    if let Some(trouble) = disk.trouble() {
        eprint(&format!("warning: results are not kept for the next run: {trouble}\n"));
    }
}

/// How much the disk cache may hold.
pub(super) fn disk_size() -> Result<u64, String> {
    match std::env::var("MAQUETTE_CACHE_SIZE") {
        Ok(text) => size(&text).map_err(|why| format!("MAQUETTE_CACHE_SIZE: {why}")),
        Err(_) => Ok(DISK_SIZE),
    }
}

/// The folder for results of a user who names none; none where the system has no such place.
pub(super) fn default_folder() -> Option<PathBuf> {
    let named =
        |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    if let Some(folder) = named("MAQUETTE_CACHE") {
        return Some(folder);
    }
    let system = if cfg!(windows) {
        named("LOCALAPPDATA")
    } else if cfg!(target_os = "macos") {
        named("HOME").map(|home| home.join("Library/Caches"))
    } else {
        named("HOME").map(|home| home.join(".cache"))
    };
    // As the specification of these folders says, one that is not absolute is none.
    let common = named("XDG_CACHE_HOME").filter(|folder| folder.is_absolute());
    common.or(system).map(|folder| folder.join("maquette"))
}

/// `2GB`, `500 MB`, `1.5GiB`, or a number of bytes.
pub(super) fn size(text: &str) -> Result<u64, String> {
    let digits = text.trim().trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit = match text.trim()[digits.len()..].to_ascii_lowercase().as_str() {
        "" | "b" => 1.0,
        "k" | "kb" => 1e3,
        "m" | "mb" => 1e6,
        "g" | "gb" => 1e9,
        "t" | "tb" => 1e12,
        "kib" => 1024.0,
        "mib" => 1_048_576.0,
        "gib" => 1_073_741_824.0,
        _ => return Err(format!("`{text}` is no size: write 500MB or 2GB")),
    };
    match digits.trim().parse::<f64>() {
        Ok(number) if number.is_finite() && 0.0 <= number => Ok((number * unit) as u64),
        _ => Err(format!("`{text}` is no size: write 500MB or 2GB")),
    }
}

fn percentage(text: &str) -> Result<f64, String> {
    let number = text.trim().trim_end_matches('%').trim_end().parse::<f64>();
    let inside = number.ok().filter(|number| (0.0..=100.0).contains(number));
    inside.ok_or_else(|| "write a number from 0 to 100".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_with_and_without_a_unit() {
        let sizes = ["1000", "2GB", "1.5 GiB", "500mb", "0"].map(|text| size(text).unwrap());
        assert_eq!(sizes, [1000, 2_000_000_000, 1_610_612_736, 500_000_000, 0]);
        for bad in ["", "GB", "-1MB", "2 flops", "nan", "1e999"] {
            assert!(size(bad).is_err(), "{bad}");
        }
    }
}
