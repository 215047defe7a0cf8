"""Tests of `bars.py`: parsing of figures, and verdicts:  python3 -m unittest discover benches/bars"""
import unittest

import bars
from bars import BARS, PROJECT, Bar, BarResult, Row, figure, measure_command, verdict

DIVAN = """
compare                      fastest       │ slowest       │ median        │ mean          │ samples │ iters
├─ alone                     0.27 ns       │ 0.273 ns      │ 0.27 ns       │ 0.272 ns      │ 100     │ 409600
├─ check                                   │               │               │               │         │
│  ├─ 50                     545.7 µs      │ 667.7 µs      │ 575.5 µs      │ 577.7 µs      │ 100     │ 100
│  ╰─ 500                    5.061 ms      │ 5.111 ms      │ 5.097 ms      │ 5.097 ms      │ 100     │ 100
├─ million_faces                           │               │               │               │         │
│  ├─ other order and moved  1.31 s        │ 1.4 s         │ 1.36 s        │ 1.35 s        │ 5       │ 5
│  ╰─ same order             31.2 ms       │ 38.1 ms       │ 33.4 ms       │ 34.1 ms       │ 5       │ 5
╰─ sec                       1.1 s         │ 1.1 s         │ 1.1 s         │ 1.1 s         │ 3       │ 3
"""


def bar(line, **more):
    return Bar("", "", (), 0, line=line, **more)


class Figures(unittest.TestCase):
    def test_medians_of_divan_in_milliseconds(self):
        for line, expected in [("check/500: # ms", 5.097), ("check/50: # ms", 0.5755), ("sec: # ms", 1100), ("alone: # ms", 2.7e-7)]:
            self.assertAlmostEqual(figure(bar(line), DIVAN), expected)

    def test_of_several_lines_the_greatest_counts(self):
        self.assertEqual(figure(bar("million_faces/*: # ms"), DIVAN), 1360)

    def test_any_number_of_spaces_is_one(self):
        text = "save to outputs written                p50   42.0 ms  p95   97.5 ms  most  103.1 ms\n"
        self.assertEqual(figure(bar("save to outputs written p50 # ms"), text), 42)
        self.assertEqual(figure(bar("save to outputs written * p95 # ms"), text), 97.5)

    def test_a_column_by_its_place(self):
        text = "100000 points alone, noise 0.01                  279.6     237.0     41234     0.412\n"
        self.assertEqual(figure(bar("noise 0.01 * * * #"), text), 0.412)

    def test_several_figures_with_commas(self):
        text = "ℹ #: open after 512, 440, 505, 470 ms; keys 16, 48, 24 ms\nℹ #rows=scan: open after 480, 460, 470, 490 ms; keys 16, 40 ms\n"
        self.assertEqual(figure(bar("open after # ms"), text), 512)
        self.assertEqual(figure(bar("keys # ms"), text), 48)

    def test_a_comma_behind_a_figure_ends_it(self):
        text = "scan to surface: 50 % within 0.021 mm, 95 % 0.091, 99 % 0.213, all 1.2\nA, smooth   5122/1094    1304; holes/smooth_blob  5158/1094   0.53, rms 0.762, max 3.1\n"
        self.assertEqual(figure(bar("scan to surface: * 95 % #, 99 %"), text), 0.091)
        self.assertEqual(figure(bar("A, smooth *; * #, rms"), text), 0.53)

    def test_growth(self):
        text = "memory before and after 500 edits: page 10.1 and 10.4 MB of objects, 3.0 and 3.0 MB of buffers, program 60 and 61 MB\n"
        self.assertAlmostEqual(figure(bar("page # and # MB of objects", take=bars.growth), text), 0.3)

    def test_a_line_that_is_not_there(self):
        self.assertIsNone(figure(bar("check/5000: # ms"), DIVAN))


class Verdicts(unittest.TestCase):
    def test_the_median_holds_a_bar_on_any_machine(self):
        self.assertEqual(verdict([9, 10, 30], 10, 2.0, False), "holds")

    def test_a_busy_machine_misses_nothing(self):
        self.assertEqual(verdict([20, 21, 22], 10, 2.0, False), "not judged")

    def test_a_quarter_of_the_samples_below_the_bar_is_noise(self):
        self.assertEqual(verdict([9, 9, 9, 11, 11, 11, 11, 11], 10, 1.0, True), "within noise")

    def test_most_samples_above_the_bar_miss_it(self):
        self.assertEqual(verdict([9, 11, 11, 11, 11, 11, 11, 11], 10, 1.0, True), "MISSED")

    def test_a_slower_machine_is_noise(self):
        self.assertEqual(verdict([10.5, 10.6, 10.7], 10, 1.1, True), "within noise")
        self.assertEqual(verdict([10.5, 10.6, 10.7], 10, 1.01, True), "MISSED")

    def test_one_sample(self):
        self.assertEqual(verdict([151.0], 150, 1.0, True), "MISSED")


class Quiet(bars.Machine):
    """A machine without noise, quiet or busy."""

    def __init__(self, quiet=True):
        self.quiet = quiet

    def observe(self, measure):
        return measure()

    def slower(self):
        return 1.0

    def is_quiet(self):
        return self.quiet


class Measures(unittest.TestCase):
    def test_a_ratio_is_judged_and_milliseconds_where_there_is_no_peer(self):
        row = Bar("", "", (), 40, times=1.0)
        self.assertEqual(BarResult(row, [50.0], "plain C", 60.0, [0.83]).judge(Quiet()), "holds")
        self.assertEqual(BarResult(row, [50.0], why="no peer").judge(Quiet()), "MISSED")
        self.assertEqual(BarResult(Bar("", "", (), None, times=1.0), [50.0], why="no peer").judge(Quiet()), "no peer")

    def test_milliseconds_are_judged_whatever_the_peer_took_where_the_bar_was_set(self):
        row = Bar("", "", (), 40, reference=("SciPy", 400.0))
        missed = BarResult(row, [80.0], "SciPy 1.17.1", 900.0, [80 / 900]).judge(Quiet())
        self.assertEqual(missed, "MISSED; 0.089 of the peer, the bar was 0.1 of it")
        self.assertEqual(BarResult(row, [40.0], "SciPy 1.17.1", 300.0, [40 / 300]).judge(Quiet()), "holds")
        self.assertEqual(BarResult(row, [80.0], "splinepy", 900.0, [80 / 900]).judge(Quiet()), "MISSED")

    def test_a_bench_is_run_again_where_it_misses_a_bar_on_a_quiet_machine(self):
        printed = [Bar("", "", ("echo", "a: 5 ms, b: 7 ms"), most, line=line) for most, line in [(6, "a: # ms"), (6, "b: # ms"), (6, "c: # ms")]]
        runs = lambda group, quiet: [found.samples for found in measure_command(group, Quiet(quiet))]
        self.assertEqual(runs(printed[:1], True), [[5]])
        self.assertEqual(runs(printed, False), [[5], [7], []])
        self.assertEqual(runs(printed, True), [[5] * 3, [7] * 3, []])
        self.assertEqual([found.judge(Quiet()) for found in measure_command(printed, Quiet())], ["holds", "MISSED", "no figure: no such line"])

    def test_what_a_bench_prints_before_it_fails_is_no_figure(self):
        failing = Bar("", "", ("sh", "-c", "echo a: 5 ms; echo other bytes >&2; exit 1"), 6, line="a: # ms")
        [found] = measure_command([failing], Quiet())
        self.assertEqual((found.samples, found.judge(Quiet())), ([], "no figure: other bytes"))


class Table(unittest.TestCase):
    def test_each_bar_of_the_peers_is_judged(self):
        judged = [bar.by.name for bar in BARS if isinstance(bar.by, Row)]
        self.assertEqual([row.name for row in bars.peers.ROWS if row.bar and row.name not in judged], [])

    def test_each_bar_says_how_it_is_measured(self):
        for it in BARS:
            with self.subTest(it.name):
                self.assertTrue(it.limit is not None or it.times)
                self.assertEqual("#" in it.line, not isinstance(it.by, Row))

    def test_each_bench_is_there(self):
        for it in BARS:
            if not isinstance(it.by, Row) and it.by[0] == "cargo":
                self.assertTrue((PROJECT / "benches" / f"{it.by[it.by.index('--bench') + 1]}.rs").exists(), it.name)

    def test_bars_of_one_bench_stand_together(self):
        """Bars of one benchmark must be adjacent, so that it is run once."""
        runs = [by for by, _ in bars.itertools.groupby(it.by for it in BARS)]
        self.assertEqual([by for k, by in enumerate(runs) if by in runs[:k]], [])


if __name__ == "__main__":
    unittest.main()
