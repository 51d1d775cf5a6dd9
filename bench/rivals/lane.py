#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Measures one rival over the link that lane.sh has laid: lane.py BUILD NAME IMAGES INDEX OUTAGE,... CALM_S REPORT.

INDEX has the checksums of IMAGES (run.py). The report is JSON. When the stream is not live again within a limit, or
ends, the rival is started again for the next outage."""
import datetime
import json
import os
import pathlib
import random
import re
import signal
import subprocess
import sys
import time

from camera import FPS
from figures import LATE_S, Stream, over_repeats
from rivals import RIVALS

HERE = pathlib.Path(__file__).resolve().parent
ARRIVAL = re.compile(r"(?:\d+|image) \d+\.\d+ (?:\d+|-)|\d+\.\d+ \d+ \d+\.\S+")
CHOSEN = re.compile(r"^(\S+) .* frame (\d+) is the kernel's", re.M)
SETTLED_S = 2  # a stream is calm again when everything has been on time for so long
ADDRESSES = {"server": "10.78.0.2", "robot": "10.78.0.1"}


def limit_s(outage):
    """How long the return of an outage is waited for."""
    return 12 + 1.9 * outage


def in_namespace(side, *command):
    return ["ip", "netns", "exec", os.environ[f"RIVAL_{side.upper()}_NS"], *command]


class Load:
    """What the processes of one host use, but for those that were there before."""

    def __init__(self, side):
        self.side = side
        self.before = self.pids()
        self.peak_kib = 0

    def pids(self):
        out = subprocess.run(["ip", "netns", "pids", os.environ[f"RIVAL_{self.side.upper()}_NS"]],
                             capture_output=True, text=True, check=True).stdout
        return set(out.split())

    def cpu_s(self):
        total = 0
        for pid in self.pids() - self.before:
            for stat in pathlib.Path("/proc", pid, "task").glob("*/schedstat"):
                try:
                    total += int(stat.read_text().split()[0])
                except OSError:  # it ended
                    pass
        return total / 1e9

    def note_memory(self):
        total = 0
        for pid in self.pids() - self.before:
            try:
                lines = pathlib.Path("/proc", pid, "smaps_rollup").read_text().splitlines()
            except OSError:
                continue
            total += sum(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
        self.peak_kib = max(self.peak_kib, total)


class Life:
    """A rival from its start to its end."""

    def __init__(self, rival, values, count, number):
        self.rival, self.count, self.number = rival, count, number
        self.work = pathlib.Path(os.environ["RIVAL_WORK"], str(number))
        self.work.mkdir()
        self.begin = time.time()
        values = {**values, "work": self.work, "camera": f"{values['images']} {self.begin}"}
        for name, content in rival.files.items():
            (self.work / name).write_text(content)
        self.processes = [self.start(side, i, command.format(**values))
                          for side in ("server", "robot") for i, command in enumerate(getattr(rival, side))]
        self.out = open(self.work / f"server-{len(rival.server) - 1}.out", encoding="ascii")
        self.rest, self.arrivals, self.corrupt = "", [], 0
        self.offset = None  # the capture time of frame 0

    def start(self, side, index, command):
        files = [open(self.work / f"{side}-{index}.{kind}", "w") for kind in ("out", "err")]
        return subprocess.Popen(in_namespace(side, "sh", "-c", command), stdin=subprocess.DEVNULL, stdout=files[0],
                                stderr=files[1], start_new_session=True)

    def read(self, sums, by_pixels):
        """Takes what has arrived since."""
        *lines, self.rest = (self.rest + self.out.read()).split("\n")
        for line in lines:
            words = line.split()
            if not ARRIVAL.fullmatch(line):  # a library's own word
                continue
            if self.rival.is_orbbuf:  # TIME BYTES NAME
                number = int(words[2].split(".")[0])
                # The live stream is in order; the spool's frames come beside it, whole ones in place of reduced ones.
                if not self.rival.drain_s or not self.arrivals or number > self.arrivals[-1][0]:
                    self.arrivals.append((number, float(words[0])))
                continue
            at = float(words[1])
            if words[0] == "image":  # which of the equal ones: the newest that there is by now
                image = by_pixels.get(int(words[2]))
                newest = int((at - self.begin) * FPS + 0.5)
                number = None if image is None else newest - (newest - image) % self.count
            else:
                number = int(words[0])
                if words[2] != "-" and sums[number % self.count] != int(words[2]):
                    number = None
            if number is None:
                self.corrupt += 1
            else:
                self.arrivals.append((number, at))

    def learn_offset(self):
        if not self.rival.is_orbbuf:
            self.offset = self.begin
            return
        # A replay's capture times begin at 0. In calm a frame is written as soon as it is captured, and the log says when.
        written = CHOSEN.findall((self.work / "robot-0.err").read_text())
        self.offset = min(datetime.datetime.fromisoformat(at).timestamp() - int(n) / FPS for at, n in written)

    def captured(self, number):
        return self.offset + number / FPS if number >= 0 else None

    def stream(self):
        return Stream(self.arrivals, self.captured)

    def numbers(self, end):
        return range(int((end - self.offset) * FPS))

    def stop(self):
        """The robot first, as a user would."""
        for process in reversed(self.processes):
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGTERM)
                try:
                    process.wait(5)
                except subprocess.TimeoutExpired:
                    pass
            try:
                os.killpg(process.pid, signal.SIGKILL)
            except ProcessLookupError:
                pass
            process.wait()

    def kept(self):
        """The frames that the server has in the end, of ORBBuf with a spool."""
        return {int(path.stem) for path in self.work.glob("frames/*/*/images/*.jpg")} if self.rival.drain_s else set()

    def said(self):
        """The last words of each process."""
        return {path.name: path.read_text(errors="replace")[-400:] for path in sorted(self.work.glob("*.err"))
                if path.stat().st_size}


class Lane:
    def __init__(self, build, name, images, index, outages, calm_s):
        self.rival = next(r for r in RIVALS if r.name == name)
        self.outages = [float(s) for s in outages.split(",")]
        self.calm_s = float(calm_s)
        index = json.loads(pathlib.Path(index).read_text())
        self.sums, self.by_pixels = index["whole"], {crc: i for i, crc in enumerate(index["pixels"])}
        self.values = {**ADDRESSES, "build": build, "bin": f"{build}/bench", "peers": HERE / "peers", "images": images,
                       "tls_server": os.environ["RIVAL_TLS_SERVER"], "tls_robot": os.environ["RIVAL_TLS_ROBOT"]}
        self.random = random.Random(name)
        self.loads = {side: Load(side) for side in ("robot", "server")}
        self.lives, self.restarts = 0, 0
        self.figures = {}
        self.calm = None  # the first life's

    def begin_life(self):
        life = Life(self.rival, self.values, len(self.sums), self.lives)
        self.lives += 1
        tries = 0
        while len(life.arrivals) < 3 * FPS:
            time.sleep(0.2)
            life.read(self.sums, self.by_pixels)
            if (tries := tries + 1) > 200:
                life.stop()
                raise RuntimeError(f"nothing arrives: {life.said()}")
        time.sleep(1)
        life.learn_offset()
        life.calm = None
        self.settle(life, time.time(), time.time() + 30)
        return life

    def measure_calm(self, life):
        begin, before = time.time(), {side: load.cpu_s() for side, load in self.loads.items()}
        time.sleep(self.calm_s)
        end = time.time()
        used = {side: load.cpu_s() - before[side] for side, load in self.loads.items()}
        life.read(self.sums, self.by_pixels)
        stream = life.stream()
        life.calm = stream.calm(begin, end)
        frames = len(stream.between(begin, end))
        if self.calm is None:
            self.calm = {"median_ms": 1e3 * life.calm[0], "p99_ms": 1e3 * life.calm[1],
                         **{f"cpu_{side}_ms": 1e3 * s / frames for side, s in used.items()}}

    def settle(self, life, since, until):
        """True once the newest SETTLED_S of arrivals are all on time, after `since`."""
        while time.time() < until:
            time.sleep(0.25)
            life.read(self.sums, self.by_pixels)
            for load in self.loads.values():
                load.note_memory()
            now = time.time()
            if now - since < SETTLED_S:
                continue
            last = life.stream().between(now - SETTLED_S, now)
            least = life.calm[0] if life.calm else min((late for _, _, late in last), default=0)
            if len(last) >= 0.8 * SETTLED_S * FPS and all(late <= least + LATE_S for _, _, late in last):
                return True
        return False

    def cut(self, seconds):
        """Nothing passes either way; what is in the queue goes into nothing."""
        begun = time.time()
        table = "add table inet cut; add chain inet cut in { type filter hook prerouting priority -300; }; " \
                "add rule inet cut in iifname { near, far } drop"
        for side in self.loads:
            subprocess.run(in_namespace(side, "nft", table), check=True)
        while (left := begun + seconds - time.time()) > 0:
            time.sleep(min(1, left))
            for load in self.loads.values():
                if left > 1:
                    load.note_memory()
        mended = time.time()
        for side in self.loads:
            subprocess.run(in_namespace(side, "nft", "delete table inet cut"), check=True)
        return begun, mended

    def outage(self, life, seconds):
        """Whether the stream is live again; the times of cut, return and end."""
        cut, mended = self.cut(seconds)
        is_live = self.settle(life, mended, mended + limit_s(seconds))
        if is_live:
            time.sleep(0.5 + 2 * self.random.random())  # to any moment of any timer
        life.read(self.sums, self.by_pixels)
        return is_live, (cut, mended, time.time())

    def end_life(self, life, outages):
        if self.rival.drain_s and outages:
            time.sleep(self.rival.drain_s)
        life.read(self.sums, self.by_pixels)
        life.stop()
        stream, kept = life.stream(), life.kept()
        for seconds, times, restarted in outages:
            figures = stream.outage(*times, life.numbers(times[2]), life.calm[0], kept)
            self.figures.setdefault(f"{seconds:g}", []).append({**figures, "restart": int(restarted)})
        return life.corrupt

    def run(self):
        corrupt, life, outages = 0, self.begin_life(), []
        self.measure_calm(life)
        for i, seconds in enumerate(self.outages):
            is_live, times = self.outage(life, seconds)
            newest = max((t for _, t in life.arrivals), default=0)
            has_ended = not is_live and newest < times[2] - 5
            outages.append((seconds, times, has_ended))
            self.restarts += has_ended
            if not is_live and i + 1 < len(self.outages):
                corrupt += self.end_life(life, outages)
                life, outages = self.begin_life(), []
                self.measure_calm(life)
        corrupt += self.end_life(life, outages)
        return {
            "name": self.rival.name, "setting": self.rival.setting, "tells": self.rival.tells,
            "calm": self.calm, "corrupt": corrupt, "restarts": self.restarts,
            "memory_kib": {side: load.peak_kib for side, load in self.loads.items()},
            "outages": {length: over_repeats(figures) for length, figures in self.figures.items()},
            "each": self.figures,
        }


def main():
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    *arguments, report = sys.argv[1:]
    lane = Lane(*arguments)
    pathlib.Path(report).write_text(json.dumps(lane.run()))


if __name__ == "__main__":
    main()
