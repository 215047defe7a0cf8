//! Allocation of large results.
//!
//! The first write to a page of newly allocated memory costs more than the computation of most results. With pages of 4 KiB one thread
//! fills about 3 GB/s, with pages of 2 MiB several times as much. Linux provides large pages on request.

#![allow(
    unsafe_code,
    reason = "advice to the system goes through a pointer; each use has its proof"
)]

mod available;

pub use available::available_memory;

/// The minimum size in bytes of a list for which large pages are requested. A smaller list hardly contains a whole large page, so the
/// request would cost more than it saves.
#[cfg(any(target_os = "linux", test))]
const MIN_ADVISED_BYTES: usize = 4 << 20;

/// Allocates a list of zeros (all bits 0), on large pages where the system has them.
///
/// This function does not write to the list's memory. The caller should write every item once, from the threads that compute the items, so
/// that the pages are filled in parallel.
pub fn huge_vec<T: bytemuck::Zeroable>(len: usize) -> Vec<T> {
    let mut items = bytemuck::zeroed_vec(len);
    advise(&mut items);
    items
}

/// Reserves room for `count` more items at the end of a list, on large pages where the system has them.
pub(crate) fn reserve_huge<T>(list: &mut Vec<T>, count: usize) {
    list.reserve_exact(count);
    advise(list.spare_capacity_mut());
}

/// Allocates a list of zeros of which few will be overwritten. Pages that are never written take no memory.
pub fn sparse_vec<T: bytemuck::Zeroable>(len: usize) -> Vec<T> {
    bytemuck::zeroed_vec(len)
}

/// Configures the allocator to keep freed memory for later lists, and to request each large list from the system and return it there.
///
/// By default glibc returns memory to the system as soon as 128 KiB at the end of its heap are free, and the system then clears new pages
/// for the next list: half of the time of an interpolation of 20 000 vertices. After some large lists have been freed, glibc also begins to
/// keep their memory. It then fills that memory with zeros in one thread, on small pages.
///
/// The setting applies to the whole process, so only a program calls this function, as `cli::main` does. A library in a host process must
/// not change the host's allocator.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub fn keep_freed() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(|| {
        let large = MIN_ADVISED_BYTES as libc::c_int;
        for (setting, bytes) in [
            (libc::M_MMAP_THRESHOLD, large),
            (libc::M_TOP_PAD, 4 * large),
            (libc::M_TRIM_THRESHOLD, 16 * large),
        ] {
            // SAFETY: `mallopt` sets a number under the allocator's own lock; existing lists are freed as they were allocated.
            let set = unsafe { libc::mallopt(setting, bytes) };
            // Ignore a failure of the call, which only makes the program slower.
            let _ = set;
        }
    });
}

/// Does nothing on this system.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn keep_freed() {}

/// Requests large pages for a large list: from the page in which the items start to the page in which they end. The range includes the
/// allocator's own bytes before the items. The ranges of neighboring lists therefore touch, and one large page may contain the end of one
/// list and the start of the next.
#[cfg(target_os = "linux")]
fn advise<T>(items: &mut [T]) {
    use std::ffi::c_void;

    if size_of_val(items) < MIN_ADVISED_BYTES {
        return;
    }
    let page = rustix::param::page_size();
    let start: *mut c_void = items.as_mut_ptr().cast();
    let before = start.addr() % page;
    let bytes = (before + size_of_val(items)).next_multiple_of(page);
    // SAFETY: all of these pages hold items, or reserved room for items, so they are mapped. The advice changes which kind of page the
    // system uses, but never the content of a page. An error changes nothing.
    let advised = unsafe {
        rustix::mm::madvise(
            start.wrapping_byte_sub(before),
            bytes,
            rustix::mm::Advice::LinuxHugepage,
        )
    };
    // Ignore the error that a system without large pages reports: ordinary pages are used then.
    let _ = advised;
}

#[cfg(not(target_os = "linux"))]
fn advise<T>(_: &mut [T]) {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_large_list_is_zero_and_can_be_written_grown_and_dropped() {
        for len in [0, 1, 1000, MIN_ADVISED_BYTES / 8 - 1, MIN_ADVISED_BYTES / 8, 3_000_001] {
            let mut items: Vec<f64> = huge_vec(len);
            assert_eq!(items.len(), len);
            assert!(items.iter().all(|&item| item == 0.0));
            items.iter_mut().enumerate().for_each(|(k, item)| *item = k as f64);
            items.push(-1.0);
            assert!(items[..len].iter().enumerate().all(|(k, &item)| item == k as f64));
        }
    }
}
