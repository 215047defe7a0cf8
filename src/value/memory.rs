//! Memory for large results.
//!
//! The first write to a page of fresh memory costs more than the computation of most results: with pages of 4 KiB one thread
//! fills some 3 GB/s, with pages of 2 MiB several times as much. Linux gives large pages where it is asked for them.

#![allow(
    unsafe_code,
    reason = "advice to the system goes through a pointer; each use has its proof"
)]

mod left;

pub use left::left;

/// Below this many bytes the advice costs more than it saves: there is hardly a whole large page inside.
const LEAST: usize = 4 << 20;

/// A list of zeros (of whatever all bits 0 mean), on large pages where the system has them.
///
/// Nothing is written here: write every item once, from the threads that compute them, so that the pages are filled in parallel.
pub fn huge_vec<T: bytemuck::Zeroable>(len: usize) -> Vec<T> {
    let mut items = bytemuck::zeroed_vec(len);
    advise(&mut items);
    items
}

/// Room for so many more items at the end of a list, on large pages where the system has them.
pub(crate) fn reserve_huge<T>(list: &mut Vec<T>, count: usize) {
    list.reserve_exact(count);
    advise(list.spare_capacity_mut());
}

/// A list of zeros of which few will be written: where nothing is, a large one takes no memory.
pub fn sparse_vec<T: bytemuck::Zeroable>(len: usize) -> Vec<T> {
    bytemuck::zeroed_vec(len)
}

/// Has the allocator keep what is freed for what is made next, but get each large list from the system and give it back there.
///
/// By itself it returns memory as soon as 128 KiB at its end are free, and has the system clear new pages for the next list: half of the
/// time of an interpolation of 20 000 vertices. Of large lists it begins, once some have been freed, to keep the memory, which it must
/// fill with zeros first, in one thread and on small pages.
///
/// It is the matter of the whole process: only a program of its own does it, as `cli::main` does; a library in a host
/// leaves the host's allocator alone.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub fn keep_freed() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(|| {
        let large = LEAST as libc::c_int;
        for (setting, bytes) in [
            (libc::M_MMAP_THRESHOLD, large),
            (libc::M_TOP_PAD, 4 * large),
            (libc::M_TRIM_THRESHOLD, 16 * large),
        ] {
            // SAFETY: a number is set, under the allocator's own lock; lists that exist are freed as they were made.
            let set = unsafe { libc::mallopt(setting, bytes) };
            // Nothing depends on it but time.
            let _ = set;
        }
    });
}

/// Here the allocator is left as it is.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn keep_freed() {}

/// Asks for large pages under the items, if they are large: from the page in which they start to the one in which they end. With the
/// allocator's own bytes before them included, neighboring lists are one stretch for the system, and large pages may lie across their
/// borders.
#[cfg(target_os = "linux")]
fn advise<T>(items: &mut [T]) {
    use std::ffi::c_void;

    if size_of_val(items) < LEAST {
        return;
    }
    let page = rustix::param::page_size();
    let start: *mut c_void = items.as_mut_ptr().cast();
    let before = start.addr() % page;
    let bytes = (before + size_of_val(items)).next_multiple_of(page);
    // SAFETY: all of these pages hold items, or room for them, so that they are mapped. The advice changes how the system backs them,
    // never what is read from them, and an error changes nothing.
    let advised = unsafe {
        rustix::mm::madvise(
            start.wrapping_byte_sub(before),
            bytes,
            rustix::mm::Advice::LinuxHugepage,
        )
    };
    // A system without large pages says so; ordinary ones do, too.
    let _ = advised;
}

#[cfg(not(target_os = "linux"))]
fn advise<T>(_: &mut [T]) {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_large_list_is_zero_and_can_be_written_grown_and_dropped() {
        for len in [0, 1, 1000, LEAST / 8 - 1, LEAST / 8, 3_000_001] {
            let mut items: Vec<f64> = huge_vec(len);
            assert_eq!(items.len(), len);
            assert!(items.iter().all(|&item| item == 0.0));
            items.iter_mut().enumerate().for_each(|(k, item)| *item = k as f64);
            items.push(-1.0);
            assert!(items[..len].iter().enumerate().all(|(k, &item)| item == k as f64));
        }
    }
}
