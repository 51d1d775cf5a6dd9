# SPDX-License-Identifier: Apache-2.0
"""What is said of one rival's arrivals. Times are seconds of the system's clock; a frame is its number."""
import math
import statistics

LATE_S = 0.2  # a stream is live while its newest frame is at most so much later than in calm


class Stream:
    """The frames that arrived, in the order of arrival, and when each was captured."""

    def __init__(self, arrivals, captured):
        """arrivals: (number, time) each; captured(number): its capture time, None if there was no such frame."""
        self.arrivals = [(n, t, t - captured(n)) for n, t in arrivals if captured(n) is not None]
        self.captured = captured

    def between(self, begin, end):
        return [a for a in self.arrivals if begin <= a[1] < end]

    def calm(self, begin, end):
        """Median and 99th percentile of the delay."""
        delays = sorted(late for _, _, late in self.between(begin, end))
        return statistics.median(delays), delays[min(len(delays) - 1, math.ceil(0.99 * len(delays)) - 1)]

    def live_again(self, cut, mended, end, calm_median):
        """Seconds from the return until a frame of after the cut is as late as in calm; infinite if none was."""
        for n, t, late in self.between(mended, end):
            if late <= calm_median + LATE_S and self.captured(n) > cut:
                return t - mended
        return math.inf

    def outage(self, cut, mended, end, numbers, calm_median, kept=()):
        """The figures of one outage; `end` is when the next one begins, or the run ends.

        numbers: all numbers captured up to `end`, ascending. kept: those that came in a way that is not the live
        stream's, which count as delivered."""
        window = self.between(cut, end)
        seen = {n for n, t, _ in self.arrivals if t < end}
        down = [n for n in numbers if cut <= self.captured(n) < mended]
        first = [t for n, t, _ in window if t >= mended and self.captured(n) > cut]
        live = self.live_again(cut, mended, end, calm_median)
        # What is still on its way at the end is not missing.
        last = max((n for n, _, _ in window), default=-1) if math.isfinite(live) else numbers[-1]
        gap = longest = 0
        for n in numbers:
            if self.captured(n) < cut - 1 or n > last:
                continue
            gap = 0 if n in seen else gap + 1
            longest = max(longest, gap)
        return {
            "delivered_share": sum(n in seen or n in kept for n in down) / max(1, len(down)),
            "longest_gap": longest,
            "first_frame_s": min(first) - mended if first else math.inf,
            "live_again_s": live,
            "late_worst_s": max((late for _, _, late in window), default=math.inf),
            **self.disorder(cut, end),
        }

    def disorder(self, begin, end):
        """How many frames arrived again, and how many after a newer one."""
        seen, newest, repeated, behind = set(), -1, 0, 0
        for n, t, _ in self.arrivals:
            if begin <= t < end:
                repeated += n in seen
                behind += n not in seen and n < newest
            seen.add(n)
            newest = max(newest, n)
        return {"repeated": repeated, "out_of_order": behind}


def over_repeats(figures):
    """The median of each figure over outages of one length; of an even number the larger one in the middle."""
    return {key: statistics.median_high([f[key] for f in figures]) for key in figures[0]}


def agreement(first, second, slack):
    """Of the pairs of names that are ordered in both, the share that is ordered alike, and the pairs that are not.

    A pair is ordered where its values differ by more than slack(larger)."""
    names = sorted(first.keys() & second.keys())
    alike, against = 0, []

    def sign(values, a, b):
        low, high = sorted((values[a], values[b]))
        # Two that never came back are equal.
        return 0 if low == high or high - low <= slack(high if math.isfinite(high) else low) else (
            1 if values[a] < values[b] else -1)

    for i, a in enumerate(names):
        for b in names[i + 1:]:
            one, two = sign(first, a, b), sign(second, a, b)
            if one and two:
                alike += one == two
                if one != two:
                    against.append((a, b))
    total = alike + len(against)
    return (alike / total if total else 1.0), against
