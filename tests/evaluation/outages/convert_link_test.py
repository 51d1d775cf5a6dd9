#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Links of small made files, and of the models: convert_link_test.py FOLDER_OF_EVALUATION_OUTAGES"""
import json
import math
import statistics
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

PROGRAM = Path(sys.argv.pop(1)) / 'convert_link.py'

ROAD = '''timestamp_start,timestamp_end,server,ip_protocol,transport_protocol,download,upload,priority,average_speed
2024-01-11 10:06:39,2024-01-11 10:06:40,192.0.2.1,v4,UDP,101856000,7448001,1,0
2024-01-11 10:06:40,2024-01-11 10:06:42,192.0.2.1,v4,UDP,67160000,0,1,
2024-01-11 10:08:00,2024-01-11 10:08:01,192.0.2.1,v4,UDP,67160000,,1,
'''
WETLINKS = '''site_name,timestamp_start,timestamp_end,server,ip_protocol,transport_protocol,download,upload
uos,2023-09-12T08:00:00+00:00,2023-09-12T08:00:01.002000+00:00,192.0.2.1,v4,UDP,2.5e8,12345678.9
'''
NUWINS = '''time,throughput_mbps,retrans,cwnd_kb
2024-05-27T10:57:12.565318,18.8718,0,1660
2024-05-27T10:57:12.565355,0.0000,0,1660
'''
MAHIMAHI = '0\n0\n499\n500\n1600\n'


def seconds_down(steps):
    return [duration_ms / 1000 for duration_ms, rate in steps if rate == 0]


class Links(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def run_program(self, *words):
        return subprocess.run([sys.executable, '-B', PROGRAM, *map(str, words)], capture_output=True, text=True,
                              check=False)

    def steps(self, text, form, *options, name='in.csv'):
        (self.folder / name).write_text(text)
        self.made(form, self.folder / name, self.folder / 'out.json', *options)
        return self.read('out.json')

    def made(self, *words):
        done = self.run_program(*words)
        self.assertEqual((done.returncode, done.stderr), (0, ''))

    def read(self, name):
        origin, *steps = json.loads((self.folder / name).read_text())
        self.assertIn('format' if 'format' in origin else 'model', origin)
        return [(step['duration_ms'], step['bandwidth_kbps']) for step in steps]

    def refused(self, said, text, form):
        (self.folder / 'bad.csv').write_text(text)
        done = self.run_program(form, self.folder / 'bad.csv', self.folder / 'bad.json')
        self.assertEqual(done.returncode, 1)
        self.assertIn(f'{self.folder}/bad.csv{said}', done.stderr)
        self.assertFalse((self.folder / 'bad.json').exists())

    def test_each_format_is_right_to_the_digit(self):
        self.assertEqual(self.steps(ROAD, 'starlink-road'), [(1000, 7448.001), (2000, 0)])
        self.assertEqual(self.steps(ROAD, 'starlink-road', '--direction', 'down'),
                         [(1000, 101856), (2000, 67160), (1000, 67160)])
        self.assertEqual(self.steps(WETLINKS, 'wetlinks'), [(1002, 12345.679)])
        self.assertEqual(self.steps(NUWINS, 'nuwins'), [(500, 18871.8), (500, 0)])
        self.assertEqual(self.steps(MAHIMAHI, 'mahimahi'), [(500, 72), (500, 24), (500, 0), (500, 24)])

    def test_errors_name_the_file_and_the_line(self):
        self.refused(':1: no column upload', ROAD.replace('upload', 'up'), 'starlink-road')
        self.refused(":3: could not convert string to float: 'fast'", ROAD.replace(',0,1,\n', ',fast,1,\n', 1),
                     'starlink-road')
        self.refused(':2: Invalid isoformat', WETLINKS.replace('2023-09-12T08:00:00', 'noon'), 'wetlinks')
        self.refused(':2: -1000 ms', ROAD.replace('10:06:40,192', '10:06:38,192', 1), 'starlink-road')
        self.refused(':3: 500 ms at -1000000.0 bit/s', NUWINS.replace('0.0000', '-1'), 'nuwins')
        self.refused(':3: 500 ms at nan', NUWINS.replace('0.0000', 'nan'), 'nuwins')
        self.refused(':4: not a number of milliseconds: x', MAHIMAHI.replace('500', 'x'), 'mahimahi')
        self.refused(': no link in it', NUWINS.replace('18.8718', '0'), 'nuwins')
        self.assertIn('No such file', self.run_program('nuwins', self.folder / 'none', self.folder / 'out').stderr)

    def model(self, name, seconds):
        self.made('model', name, self.folder / 'out.json', '--seconds', seconds)
        return self.read('out.json')

    def test_a_model_has_the_same_bytes_for_the_same_seed(self):
        for name in ('handover', 'roaming'):
            written = []
            for seed in (1, 1, 2):
                self.made('model', name, self.folder / 'out.json', '--seed', seed)
                written.append((self.folder / 'out.json').read_bytes())
            self.assertEqual(written[0], written[1])
            self.assertNotEqual(written[0], written[2].replace(b'"seed": 2', b'"seed": 1'))
            self.assertGreaterEqual(sum(duration_ms for duration_ms, _ in self.read('out.json')), 600_000)

    def test_a_hand_over_is_as_measured(self):
        slots = 20_000
        steps = self.model('handover', 15 * slots)
        at_ms, begins = 0, []
        for duration_ms, rate in steps:
            begins += [at_ms] * (at_ms % 15_000 == 0)
            at_ms += duration_ms
        self.assertEqual(begins, list(range(0, 15_000 * slots, 15_000)))
        down = seconds_down(steps)
        self.assertAlmostEqual(len(down) / slots, 0.18, delta=0.01)
        self.assertAlmostEqual(statistics.mean(down), 1.65, delta=0.03)
        deciles = statistics.quantiles(down, n=10)
        self.assertAlmostEqual(deciles[0], 0.80, delta=0.05)
        self.assertAlmostEqual(deciles[-1], 2.62, delta=0.16)
        rates = [rate for _, rate in steps if rate]
        self.assertAlmostEqual(statistics.median(rates), 16_900, delta=200)
        changes = statistics.quantiles([math.log(b / a) for a, b in zip(rates, rates[1:])], n=4)
        self.assertAlmostEqual(changes[2] - changes[0], 0.72, delta=0.03)

    def test_roaming_is_as_stated(self):
        steps = self.model('roaming', 200_000)
        down = seconds_down(steps)
        self.assertTrue(all(0.30 <= s <= 0.35 or 1.2 <= s <= 4.7 for s in down))
        self.assertAlmostEqual(sum(s > 1 for s in down) / len(down), 0.25, delta=0.02)
        self.assertEqual(sum(duration_ms for duration_ms, rate in steps if rate), 14_000 * len(down))
        self.assertEqual((max(rate for _, rate in steps), min(rate for _, rate in steps if rate)), (65_000, 6_500))

    def test_what_is_measured_is_right(self):
        lines = [ROAD.split('\n', 1)[0]]
        for minute in range(60):  # each fourth has no link at :12; twice as fast after it; nothing happens from :27 on
            for second in (*range(5, 20), *range(27, 42)):
                rate = 0 if second == 12 and minute % 4 == 0 else 10_000_000 if second < 12 else 20_000_000
                lines.append(f'2024-01-11 10:{minute:02}:{second:02},2024-01-11 10:{minute:02}:{second + 1:02},'
                             f'192.0.2.1,v4,UDP,1,{rate},1,')
        (self.folder / 'in.csv').write_text('\n'.join(lines) + '\n')
        said = self.run_program('measure', self.folder / 'in.csv').stdout.split('\n')
        self.assertEqual(said[:3], ['median of 120 runs: 20.0 Mbit/s',
                                    'hand-overs with a second below half: 15 of 60, 0.250',
                                    'times between with a second below half: 0 of 60, 0.000'])
        self.assertEqual(said[3], 'seconds lost then: mean 2.00, deciles 2.00 and 2.00')  # 1 + two at half the median
        (self.folder / 'in.csv').write_text(ROAD)
        self.assertIn('in.csv: too few runs', self.run_program('measure', self.folder / 'in.csv').stderr)


if __name__ == '__main__':
    unittest.main()
