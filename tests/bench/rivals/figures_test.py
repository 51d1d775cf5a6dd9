#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""The figures of ./dev bench rivals, of arrivals made by hand: figures_test.py FOLDER_OF_BENCH_RIVALS"""
import math
import sys
import unittest

sys.path.insert(0, sys.argv.pop(1))
sys.dont_write_bytecode = True
from figures import Stream, agreement, over_repeats  # noqa: E402


def captured(number):
    return number / 25 if number >= 0 else None


def late(numbers, by):
    return [(n, captured(n) + by) for n in numbers]


# Ten seconds of calm, 10 ms late; a cut from just before frame 250 until frame 300; the end at 16 s.
CALM = late(range(250), 0.01)
CUT, MENDED, END = 9.99, 12, 16
NUMBERS = range(400)


def outage(arrivals, kept=()):
    return Stream(CALM + arrivals, captured).outage(CUT, MENDED, END, NUMBERS, 0.01, kept)


class Figures(unittest.TestCase):
    def test_the_calm_has_its_median_and_percentile(self):
        stream = Stream(late(range(99), 0.01) + late([99], 0.5), captured)
        median, p99 = stream.calm(0, 10)
        self.assertAlmostEqual(median, 0.01)
        self.assertAlmostEqual(p99, 0.01)
        self.assertAlmostEqual(Stream(late(range(98), 0.01) + late([98, 99], 0.5), captured).calm(0, 10)[1], 0.5)

    def test_what_forgets_the_outage_has_a_gap_as_long(self):
        figures = outage(late(range(300, 395), 0.01))
        self.assertEqual(figures["delivered_share"], 0)
        self.assertEqual(figures["longest_gap"], 50)
        self.assertAlmostEqual(figures["first_frame_s"], 0.01)
        self.assertAlmostEqual(figures["live_again_s"], 0.01)
        self.assertAlmostEqual(figures["late_worst_s"], 0.01)

    def test_what_keeps_all_is_live_when_it_has_caught_up(self):
        # 50 frames a second from the return on: the 50 of the outage, and as many that come meanwhile.
        backlog = [(250 + i, MENDED + 0.1 + i / 50) for i in range(100)]
        figures = outage(backlog + late(range(350, 395), 0.01))
        self.assertEqual(figures["delivered_share"], 1)
        self.assertEqual(figures["longest_gap"], 0)
        self.assertAlmostEqual(figures["first_frame_s"], 0.1)
        self.assertAlmostEqual(figures["live_again_s"], 0.1 + 95 / 50)  # the first that is at most 0.2 s later than in calm
        self.assertAlmostEqual(figures["late_worst_s"], 2.1)

    def test_every_third_frame(self):
        figures = outage([(n, MENDED + 0.1) for n in range(252, 300, 3)] + late(range(300, 395), 0.01))
        self.assertAlmostEqual(figures["delivered_share"], 16 / 50)
        self.assertEqual(figures["longest_gap"], 2)

    def test_what_comes_another_way_is_delivered_but_not_live(self):
        figures = outage(late(range(300, 395), 0.01), kept={260, 261})
        self.assertAlmostEqual(figures["delivered_share"], 2 / 50)
        self.assertEqual(figures["longest_gap"], 50)

    def test_what_never_comes_back(self):
        figures = outage([])
        self.assertEqual(figures["longest_gap"], 150)
        self.assertTrue(math.isinf(figures["first_frame_s"]) and math.isinf(figures["live_again_s"]))

    def test_disorder_is_counted(self):
        figures = outage([(300, 12.1), (299, 12.2), (300, 12.3), (249, 12.4)])
        self.assertEqual((figures["repeated"], figures["out_of_order"]), (2, 1))

    def test_of_repeats_it_is_the_larger_median(self):
        self.assertEqual(over_repeats([{"a": 1}, {"a": 9}, {"a": math.inf}, {"a": 2}]), {"a": 9})

    def test_agreement_counts_the_pairs_that_differ_clearly(self):
        first = {"a": 1, "b": 5, "c": 5.1, "d": math.inf}
        second = {"a": 6, "b": 1, "c": 5, "d": math.inf}
        share, against = agreement(first, second, lambda larger: 0.3)
        # a-b and a-c have changed places; a-d, b-d, c-d have not; b-c were equal.
        self.assertEqual(against, [("a", "b"), ("a", "c")])
        self.assertAlmostEqual(share, 3 / 5)
        self.assertEqual(agreement({"a": 1}, {"a": 2}, lambda larger: 0)[0], 1)


unittest.main()
