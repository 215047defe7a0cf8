//! Damaged files must cause errors. No reader may panic, hang or use much memory. The fuzz targets in `fuzz/` test the same for longer.

use std::time::{Duration, Instant};

mod readers;
use readers::{READERS, spoil};

/// The number of damaged files per reader. Testing all readers takes a few seconds.
const CASES: u64 = 1500;

/// The maximum allowed time for reading a small file. It is some hundred times the time of the slowest file, because the machine may be
/// busy.
const LONG: Duration = Duration::from_secs(5);

#[test]
fn spoiled_files_give_errors_and_take_no_time() {
    for reader in READERS {
        reader.seeds.iter().for_each(|seed| (reader.read)(seed));
        for case in 0..CASES {
            let file = spoil(reader, case);
            let start = Instant::now();
            (reader.read)(&file);
            let time = start.elapsed();
            assert!(time < LONG, "case {case} of {} took {time:?}", reader.name);
        }
    }
}

#[test]
fn every_ending_of_a_small_file_is_read_to_its_end_or_refused() {
    for reader in READERS {
        for seed in reader.seeds {
            (0..seed.len()).for_each(|length| (reader.read)(&seed[..length]));
        }
    }
}
