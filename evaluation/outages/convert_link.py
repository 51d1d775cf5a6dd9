#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Makes links for `orbbuf-outages make --links` from public data sets, and from models. README.md has the sources.

    convert_link.py FORMAT FILE OUT.json [--direction down]
    convert_link.py model handover|roaming OUT.json [--seed N] [--seconds S]
    convert_link.py measure FILE      what the model `handover` takes from Starlink on the Road
"""
import argparse
import csv
import json
import math
import random
import statistics
import sys
from datetime import datetime
from pathlib import Path

MAHIMAHI_STEP_MS, MAHIMAHI_BITS = 500, 1500 * 8  # as bench/sim/mobile_link.cpp has it
NUWINS_STEP_MS = 500  # "interval reporting every 0.50 seconds"; the column `time` is when the line was printed


class Refused(Exception):
    pass


def read_csv(file, names):
    """The values of these columns, line by line, with the line's number."""
    with open(file, encoding='utf-8-sig', newline='') as lines:
        reader = csv.DictReader(lines)
        missing = [name for name in names if name not in (reader.fieldnames or [])]
        if missing:
            raise Refused(f'{file}:1: no column {missing[0]}')
        for row in reader:
            yield reader.line_num, [row[name] or '' for name in names]


def seconds_of_iperf(file, direction):
    """WetLinks and Starlink on the Road: (begin, end, bit/s) of each line; None where nothing was measured."""
    for line, (begin, end, rate) in read_csv(file, ['timestamp_start', 'timestamp_end', direction + 'load']):
        try:
            yield line, datetime.fromisoformat(begin), datetime.fromisoformat(end), float(rate) if rate else None
        except ValueError as error:
            raise Refused(f'{file}:{line}: {error}') from None


def iperf(file, direction):
    for line, begin, end, rate in seconds_of_iperf(file, direction):
        if rate is not None:
            yield line, round((end - begin).total_seconds() * 1000), rate


def nuwins(file, _):
    for line, (rate,) in read_csv(file, ['throughput_mbps']):
        try:
            yield line, NUWINS_STEP_MS, float(rate) * 1e6
        except ValueError as error:
            raise Refused(f'{file}:{line}: {error}') from None


def mahimahi(file, _):
    packets = []
    for line, text in enumerate(Path(file).read_text(encoding='utf-8').split('\n'), 1):
        if text.strip():
            if not text.strip().isdecimal():
                raise Refused(f'{file}:{line}: not a number of milliseconds: {text}')
            step = int(text) // MAHIMAHI_STEP_MS
            packets += [0] * (step + 1 - len(packets))
            packets[step] += 1
    for count in packets:
        yield 0, MAHIMAHI_STEP_MS, count * MAHIMAHI_BITS * 1000 / MAHIMAHI_STEP_MS


FORMATS = {'wetlinks': iperf, 'starlink-road': iperf, 'nuwins': nuwins, 'mahimahi': mahimahi}


def convert(form, file, direction):
    steps = []
    for line, duration_ms, rate in FORMATS[form](file, direction):
        if duration_ms <= 0 or not 0 <= rate < math.inf:
            raise Refused(f'{file}:{line}: {duration_ms} ms at {rate} bit/s')
        steps.append((duration_ms, rate))
    if not any(rate for _, rate in steps):
        raise Refused(f'{file}: no link in it')
    return steps


# Starlink in a car: each number but the first is what `measure` prints for Starlink on the Road's iperf.csv.
HANDOVER_S = 15
MEDIAN_BITS, SLOT_SPREAD = 16.9e6, 0.38  # of a slot; the spread is that of the natural logarithm
OUTAGE_SHARE, OUTAGE_S = 0.18, (0.6, 2.7)  # of the hand-overs; uniform: deciles 0.8 and 2.5, mean 1.65


def handover(chance, seconds):
    steps = []
    for _ in range(math.ceil(seconds / HANDOVER_S)):
        out_ms = round(1000 * chance.uniform(*OUTAGE_S)) if chance.random() < OUTAGE_SHARE else 0
        rate = MEDIAN_BITS * math.exp(chance.gauss(0, SLOT_SPREAD))
        steps += [(out_ms, 0)] * (out_ms > 0) + [(HANDOVER_S * 1000 - out_ms, rate)]
    return steps


# A robot that drives past access points, 28 m apart, at 2 m/s.
CELL_S = 28 / 2
RATES = (65e6, 58.5e6, 52e6, 39e6, 26e6, 19.5e6, 13e6, 6.5e6)  # 802.11n, one stream of 20 MHz, MCS 7 to 0
SLOW_SHARE, SLOW_S, FAST_S = 0.25, (1.2, 4.7), (0.30, 0.35)


def roaming(chance, seconds):
    steps = []
    for _ in range(math.ceil(seconds / CELL_S)):
        steps += [(round(CELL_S * 1000 / len(RATES)), rate) for rate in RATES]
        steps.append((round(1000 * chance.uniform(*SLOW_S if chance.random() < SLOW_SHARE else FAST_S)), 0))
    return steps


def measure(file):
    """The uplink around the hand-overs, at 12 s, 27 s, 42 s and 57 s of each minute, in the runs of iperf of 15 s."""
    runs, last = [], None
    for _, begin, end, rate in seconds_of_iperf(file, 'up'):
        if begin != last:
            runs.append([])
        runs[-1].append((begin.second % HANDOVER_S, rate))
        last = end
    # Without the ends, which are not as fast as the rest.
    runs = [run[3:14] for run in runs if len(run) == 15 and all(rate is not None for _, rate in run)]
    medians = [statistics.median(rate for _, rate in run) for run in runs]
    found = {12: [], 4: []}  # a hand-over, and a time as far from one as can be: seconds lost
    changes = []
    for run, median in zip(runs, medians):
        for i, (second, _) in enumerate(run):
            if second in found and 2 <= i < len(run) - 2 and median > 1e6:
                shares = [rate / median for _, rate in run[i - 2:i + 3]]
                found[second].append(sum(max(0, 1 - share) for share in shares) if min(shares) < 0.5 else 0)
            if second == 12 and 4 <= i < len(run) - 4:
                before, after = (statistics.median(rate for _, rate in part) for part in (run[:i - 1], run[i + 2:]))
                if min(before, after) > 1e6:
                    changes.append(math.log(after / before))
    lost = [seconds for seconds in found[12] if seconds > 0]
    if min(len(lost), len(changes), len(found[4])) < 2:
        raise Refused(f'{file}: too few runs of 15 s')
    deciles, quarters = statistics.quantiles(lost, n=10), statistics.quantiles(changes, n=4)
    print(f'median of {len(runs)} runs: {statistics.median(medians) / 1e6:.1f} Mbit/s')
    for second, name in ((12, 'hand-overs'), (4, 'times between')):
        some = sum(seconds > 0 for seconds in found[second])
        print(f'{name} with a second below half: {some} of {len(found[second])}, {some / len(found[second]):.3f}')
    print(f'seconds lost then: mean {statistics.mean(lost):.2f}, deciles {deciles[0]:.2f} and {deciles[-1]:.2f}')
    print(f'spread of a slot: {(quarters[2] - quarters[0]) / 1.349 / math.sqrt(2):.2f}')  # as of a normal distribution


def write(file, origin, steps):
    rows = [json.dumps(origin)]
    rows += [f'{{"duration_ms": {duration_ms}, "bandwidth_kbps": {rate / 1000:.3f}}}' for duration_ms, rate in steps]
    Path(file).write_text('[\n' + ',\n'.join(rows) + '\n]\n', encoding='utf-8')


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest='format', required=True)
    for form in FORMATS:
        command = commands.add_parser(form)
        command.add_argument('file')
        command.add_argument('out')
        if FORMATS[form] is iperf:  # a file of the others has one direction
            command.add_argument('--direction', choices=('up', 'down'), default='up')
    command = commands.add_parser('model')
    command.add_argument('name', choices=('handover', 'roaming'))
    command.add_argument('out')
    command.add_argument('--seed', type=int, default=1)
    command.add_argument('--seconds', type=float, default=600)
    commands.add_parser('measure').add_argument('file')
    options = parser.parse_args()
    try:
        if options.format == 'measure':
            measure(options.file)
        elif options.format == 'model':
            model = {'handover': handover, 'roaming': roaming}[options.name]
            steps = model(random.Random(options.seed), options.seconds)
            write(options.out, {'model': options.name, 'seed': options.seed}, steps)
        else:
            direction = getattr(options, 'direction', '')
            origin = {'format': options.format, 'file': Path(options.file).name, 'direction': direction}
            write(options.out, origin, convert(options.format, options.file, direction))
    except (Refused, OSError, UnicodeDecodeError) as error:
        sys.exit(f'convert_link.py: {error}')


if __name__ == '__main__':
    main()
