//! Damages files a million times (or as often as the first argument says) and reads them. Reports panics, the longest time and the peak
//! memory. The damage is deterministic. The exit code is 1 if a reader panicked, took longer than a second, or allocated more than 200 MB.

use std::alloc::{GlobalAlloc, Layout, System};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::time::{Duration, Instant};

#[path = "../../tests/engine/hostile_files/readers.rs"]
mod readers;

use readers::{READERS, spoil};

/// An allocator that counts the allocated bytes.
struct Counting;

static NOW: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is forwarded to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let now = NOW.fetch_add(layout.size(), Relaxed) + layout.size();
        PEAK.fetch_max(now, Relaxed);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        NOW.fetch_sub(layout.size(), Relaxed);
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

const MOST_TIME: Duration = Duration::from_secs(1);
const MOST_BYTES: usize = 200 << 20;

/// The number of the file that is being read; the watchdog thread reports it if it does not change.
static CASE: AtomicU64 = AtomicU64::new(0);

fn main() -> ExitCode {
    let cases =
        std::env::args().nth(1).and_then(|cases| cases.parse().ok()).unwrap_or(1_000_000u64);
    std::thread::spawn(|| {
        let mut before = u64::MAX;
        loop {
            std::thread::sleep(Duration::from_secs(20));
            let case = CASE.load(Relaxed);
            if case == before {
                eprintln!("case {case} hangs");
                std::process::exit(1);
            }
            before = case;
        }
    });
    std::panic::set_hook(Box::new(|_| {}));
    let (mut failed, start) = (false, Instant::now());
    let each = cases.div_ceil(READERS.len() as u64);
    for reader in READERS {
        let (mut panics, mut slowest, mut largest) = (Vec::new(), (Duration::ZERO, 0), (0, 0));
        let begin = Instant::now();
        for case in 0..each {
            CASE.fetch_add(1, Relaxed);
            let file = spoil(reader, case);
            PEAK.store(NOW.load(Relaxed), Relaxed);
            let (before, clock) = (NOW.load(Relaxed), Instant::now());
            if catch_unwind(AssertUnwindSafe(|| (reader.read)(&file))).is_err() {
                panics.push(case);
            }
            slowest = slowest.max((clock.elapsed(), case));
            largest = largest.max((PEAK.load(Relaxed) - before, case));
        }
        println!(
            "{:10} {each} files in {:.1?}; longest {:.2?} (case {}), largest {:.1} MB (case {}), panics {panics:?}",
            reader.name,
            begin.elapsed(),
            slowest.0,
            slowest.1,
            largest.0 as f64 / 1e6,
            largest.1,
        );
        failed |= !panics.is_empty() || MOST_TIME < slowest.0 || MOST_BYTES < largest.0;
    }
    println!("all in {:.1?}", start.elapsed());
    ExitCode::from(u8::from(failed))
}
