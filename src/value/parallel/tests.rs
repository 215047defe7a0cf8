//! Compares parallel loops with the iterators of the standard library.

use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use super::*;

const LENGTHS: [usize; 8] = [0, 1, 2, 127, 128, 129, 1000, 4099];

/// Returns the result of `f` for each length, and asserts that the results do not depend on the number of threads.
fn on_any_threads<T: PartialEq + std::fmt::Debug + Send>(f: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let results = [1, 2, 7].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| LENGTHS.iter().map(|&length| f(length)).collect::<Vec<_>>())
    });
    let [one, two, seven] = results;
    assert_eq!(one, two);
    assert_eq!(one, seven);
    one
}

fn random(length: usize) -> Vec<u32> {
    let mut random = crate::rng::Random(length as u64);
    (0..length).map(|_| random.next_below(1000) as u32).collect()
}

#[test]
fn parallel_lists_equal_sequential_ones() {
    on_any_threads(|length| {
        let list = random(length);
        fn odd(x: &&u32) -> bool {
            **x % 2 == 1
        }
        let halves = |&x: &u32| (0..x % 5).map(move |k| x + k);
        let whole: Vec<u64> = list.par_iter().map(|&x| u64::from(x) + 1).collect();
        assert_eq!(whole, list.iter().map(|&x| u64::from(x) + 1).collect::<Vec<_>>());
        let some: Vec<&u32> = list.par_iter().filter(odd).collect();
        assert_eq!(some, list.iter().filter(odd).collect::<Vec<_>>());
        let more: Vec<u32> = list.par_iter().with_min_len(16).flat_map_iter(halves).collect();
        assert_eq!(more, list.iter().flat_map(halves).collect::<Vec<_>>());
        let text: Vec<String> =
            list.clone().into_par_iter().filter_map(|x| (x > 500).then(|| x.to_string())).collect();
        let expected = list.iter().filter(|&&x| x > 500).map(u32::to_string);
        assert_eq!(text, Vec::from_iter(expected));
        let (indices, copies): (Vec<usize>, Vec<u32>) =
            list.par_iter().copied().enumerate().unzip();
        assert_eq!((indices, &copies), ((0..length).collect(), &list));
        let longer = list.len() + 3;
        let pairs: Vec<(usize, u32)> =
            (0..longer).into_par_iter().zip(&list).map(|(a, b)| (a, *b)).collect();
        assert_eq!(pairs, (0..longer).zip(list.iter().copied()).collect::<Vec<_>>());
        let mut all = vec![7];
        list.par_iter().copied().collect_into(&mut all);
        list.par_iter().filter(odd).copied().collect_into(&mut all);
        assert_eq!(all.len(), 1 + length + some.len());
        assert_eq!((all[0], &all[1..=length]), (7, &list[..]));
    });
}

#[test]
fn parallel_chunks_and_windows_equal_sequential_ones() {
    on_any_threads(|length| {
        let list = random(length);
        for size in [1, 3, 100, 5000] {
            let chunks: Vec<&[u32]> = list.par_chunks(size).collect();
            assert_eq!(chunks, list.chunks(size).collect::<Vec<_>>());
            let exact: Vec<&[u32]> = list.par_chunks_exact(size).collect();
            assert_eq!(exact, list.chunks_exact(size).collect::<Vec<_>>());
            let windows: Vec<&[u32]> = list.par_windows(size).collect();
            assert_eq!(windows, list.windows(size).collect::<Vec<_>>());
            let mut marked = list.clone();
            let strips = marked.par_chunks_mut(size).enumerate();
            strips.for_each(|(strip, strip_of)| strip_of.fill(strip as u32));
            assert!(marked.iter().enumerate().all(|(index, &mark)| mark == (index / size) as u32));
        }
        let mut sorted = list.clone();
        sorted.par_sort_unstable();
        sorted.par_sort_unstable_by_key(|&x| std::cmp::Reverse(x));
        assert!(sorted.is_sorted_by(|a, b| a >= b));
        sorted
    });
}

#[test]
fn only_the_given_rows_are_written() {
    on_any_threads(|length| {
        let [third, half] = [length as u32 / 3, length as u32 / 2];
        for rows in
            [vec![], vec![0..third, third..third, third..half, half + half / 2..length as u32]]
        {
            let mut written = random(length);
            let mut expected = written.clone();
            rows.iter().cloned().flatten().for_each(|k| expected[k as usize] = k);
            written.par_rows_mut(&rows, 7).for_each(|(indices, items)| {
                assert!(indices.len() == items.len() && items.len() <= 7);
                indices.zip(items).for_each(|(index, item)| *item = index);
            });
            assert_eq!(written, expected);
        }
    });
}

#[test]
fn results_of_loops_do_not_depend_on_threads() {
    let all = on_any_threads(|length| {
        let list = random(length);
        let numbers = || list.par_iter().map(|&x| 0.1 * f64::from(x));
        let sum: f64 = numbers().sum();
        let folded = numbers().reduce(|| 0.0, |a, b| a + b);
        let first = list.par_iter().position_first(|&x| x > 900);
        assert_eq!(first, list.iter().position(|&x| x > 900));
        assert_eq!(list.par_iter().any(|&x| x > 990), list.iter().any(|&x| x > 990));
        assert_eq!(list.par_iter().all(|&x| x < 990), list.iter().all(|&x| x < 990));
        assert_eq!(
            list.par_iter().filter(|x| **x < 9).count(),
            list.iter().filter(|x| **x < 9).count()
        );
        fn fails(&x: &u32) -> Result<u32, u32> {
            if x > 900 { Err(x) } else { Ok(x) }
        }
        let gathered: Result<Vec<u32>, u32> = list.par_iter().map(fails).collect();
        assert_eq!(gathered, list.iter().map(fails).collect());
        [sum, folded].map(f64::to_bits)
    });
    assert_eq!(all.len(), LENGTHS.len());
}

#[test]
fn state_is_initialized_once_per_part() {
    let made = AtomicUsize::new(0);
    let list: Vec<usize> = (0..1000_usize)
        .into_par_iter()
        .map_init(|| made.fetch_add(1, Ordering::Relaxed), |_, x| x)
        .collect();
    assert!(list.into_iter().eq(0..1000));
    assert_eq!(made.into_inner(), MAX_INIT_PARTS);
}

#[test]
fn unreached_items_are_dropped_once() {
    let item = Arc::new(());
    for length in LENGTHS {
        let list = vec![item.clone(); length];
        let kept: Vec<Arc<()>> = list.into_par_iter().collect();
        assert_eq!(Arc::strong_count(&item), length + 1);
        let found = kept.into_par_iter().find_map_first(Some);
        assert_eq!(
            (found.is_some(), Arc::strong_count(&item)),
            (length > 0, 1 + usize::from(length > 0))
        );
    }
}

#[test]
fn a_panic_reaches_the_caller() {
    let item = Arc::new(());
    let caught = std::panic::catch_unwind(|| {
        (0..1000_usize)
            .into_par_iter()
            .map(|x: usize| {
                assert!(x != 700, "seven hundred");
                item.clone()
            })
            .collect::<Vec<_>>()
    });
    assert_eq!(caught.unwrap_err().downcast_ref(), Some(&"seven hundred"));
}

#[test]
fn a_computation_stops_at_its_flag_on_all_threads() {
    let [flag, other] = [(); 2].map(|()| Arc::new(AtomicBool::new(false)));
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        flag.store(false, Ordering::Relaxed);
        let done = AtomicUsize::new(0);
        let result = pool.install(|| {
            stoppable(&flag, || {
                (0..1000_usize).into_par_iter().for_each(|_| {
                    // A nested loop belongs to the computation, too.
                    (0..1000_usize).into_par_iter().for_each(|_| {
                        flag.store(true, Ordering::Relaxed);
                        done.fetch_add(1, Ordering::Relaxed);
                    });
                });
            })
        });
        assert_eq!(result, None);
        assert!(done.into_inner() <= threads * 8);
        // Others go on, and what follows on the same threads.
        let sum = pool.install(|| {
            stoppable(&other, || (0..1000_usize).into_par_iter().map(|x| x).sum::<usize>())
        });
        assert_eq!(sum, Some(499_500));
    }
}

thread_local! {
    /// A clock that advances only when a test says so.
    static NOW: Cell<u64> = const { Cell::new(0) };
}

fn pass(seconds: u64) {
    NOW.set(NOW.get() + seconds);
}

#[test]
fn a_span_has_the_serial_code_and_the_longest_part_of_each_loop() {
    start_span(|| Duration::from_secs(NOW.get()));
    pass(5);
    (1..5_u64).into_par_iter().for_each(pass);
    (0..3_u64).into_par_iter().for_each(|_| {
        pass(1);
        (0..10_u64).into_par_iter().for_each(|_| pass(2));
    });
    join(|| pass(7), || pass(9));
    let measured = finish_span().unwrap();
    let [work, span] = [5 + 10 + 63 + 16, 5 + 4 + 3 + 9].map(Duration::from_secs);
    assert_eq!(measured, WorkSpan { work, span });
    assert_eq!(measured.on(1), work);
    assert_eq!(finish_span(), None);
    let sum = (1..5_u64).into_par_iter().map(|x| x).sum::<u64>();
    assert_eq!(sum, 10);
}

#[test]
fn serial_loops_and_sorts_stop_and_others_go_on() {
    fn stops(work: impl Fn(&AtomicBool)) {
        let flag = Arc::new(AtomicBool::new(false));
        assert_eq!(stoppable(&flag, || work(&flag)), None);
    }
    let set = |flag: &AtomicBool| flag.store(true, Ordering::Relaxed);
    let done = AtomicUsize::new(0);
    stops(|flag| {
        for _ in (0..1000).until_stopped() {
            done.fetch_add(1, Ordering::Relaxed);
            set(flag);
        }
    });
    stops(|flag| {
        (0..1000).until_stopped().for_each(|_| {
            done.fetch_add(1, Ordering::Relaxed);
            set(flag);
        });
    });
    stops(|flag| {
        set(flag);
        check_stop();
        done.fetch_add(1, Ordering::Relaxed);
    });
    stops(|flag| {
        let mut list = random(100_000);
        set(flag);
        list.par_sort_unstable();
        done.fetch_add(1, Ordering::Relaxed);
    });
    stops(|flag| {
        (0..1_usize).into_par_iter().map_init(|| set(flag), |(), x| x).for_each(|_| {
            done.fetch_add(1, Ordering::Relaxed);
        });
    });
    assert_eq!(done.into_inner(), 2);
    // Without a flag, and in a detached task of a computation, nothing stops.
    check_stop();
    let flag = Arc::new(AtomicBool::new(false));
    let sum = stoppable(&flag, || {
        set(&flag);
        detached(|| (0..10).until_stopped().sum::<i32>())
    });
    assert_eq!(sum, Some(45));
}

#[test]
fn a_caught_stop_is_passed_on() {
    let flag = Arc::new(AtomicBool::new(false));
    let result = stoppable(&flag, || {
        flag.store(true, Ordering::Relaxed);
        std::panic::catch_unwind(check_stop).map_err(caught).is_err()
    });
    assert_eq!(result, None);
    let panic = std::panic::catch_unwind(|| std::panic::resume_unwind(Box::new("other")));
    let payload = panic.map_err(caught).unwrap_err();
    assert_eq!(payload.downcast_ref(), Some(&"other"));
}

#[test]
fn a_meter_counts_the_items_of_loops_once() {
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let meter = Arc::new(Meter::default());
        let count = 1_usize << 17;
        pool.install(|| {
            meter.measure(|| {
                // Loops inside of a parallel loop are not counted.
                (0..count)
                    .into_par_iter()
                    .for_each(|_| (0..9_usize).into_par_iter().for_each(drop));
                assert_eq!(meter.items(), count as u64);
                let list = vec![1_u8; count];
                list.par_chunks(1000).for_each(|_| ());
                let [of_chunks, counted] = [meter.items() - count as u64, count as u64];
                assert!((counted * 98 / 100..=counted).contains(&of_chunks), "{of_chunks}");
                let before = meter.items();
                join(
                    || list.iter().until_stopped().count(),
                    || list.iter().until_stopped().count(),
                );
                assert_eq!(meter.items() - before, 2 * count as u64);
            });
        });
        let before = meter.items();
        (0..count).into_par_iter().for_each(drop);
        assert_eq!(meter.items(), before);
    }
}
