#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Robots that are killed, start after start, and an account of every number of every session:
run.py BUILD [--quick] [--seed N] [--only ROW,...] [--keep].

Each row is a robot that is started, and killed by kill -9 within 9 s; its last start lives until the server knows
everything. Rows differ in what the robot keeps (nothing, drop records, frames, with little room), in whether the server
is there, and in the clock. Beside that, the server is killed as well. Power cuts of a robot are not among the deaths: what
a kill leaves in the kernel's memory is written, and which bytes a power cut would have taken cannot be known from here;
tests/vm has the machine for that.

How many frames a session captured is known from the kernel, not from the robot: its source is a folder of images, and
inotify says when it opens each. It reads frame k + 1 as soon as frame k is captured. A frame that nothing accounts for is
`too_young` if it was captured less than 3 s before the kill (docs/promises.md), and else `unnamed`. `unexplained` is what
must not be either: a number that was not captured, a frame that is there and named as dropped, bytes that are not the
source's, and what `orbbuf-server check` reports besides that the session has not ended.

Exit status 77: this machine has no network namespaces."""
import argparse
import collections
import ctypes
import os
import pathlib
import random
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
import zlib

YOUNG_S = 3
IMAGES = 250
IN_OPEN = 0x20
MARK = ".mark"

# What a robot keeps; whether its server is there: `never` before the last start, `at_random`; whether its clock steps.
Row = collections.namedtuple("Row", "name settings server clock room_mib", defaults=("at_random", False, 0))
ROWS = (
    Row("record", {"buffer.drop_log": "RECORD"}),
    Row("spool", {"spool.path": "RECORD"}),
    Row("record_alone", {"buffer.drop_log": "RECORD"}, "never"),
    Row("spool_alone", {"spool.path": "RECORD"}, "never"),
    Row("small", {"spool.path": "RECORD", "spool.size": "4 MiB"}),
    Row("small_alone", {"spool.path": "RECORD", "spool.size": "4 MiB"}, "never"),
    Row("full_disk", {"spool.path": "RECORD"}, "at_random", False, 6),
    Row("clock", {"spool.path": "RECORD"}, "at_random", True),
)


class Opens:
    """When each file of some folders was opened, from the kernel."""

    def __init__(self):
        self.libc = ctypes.CDLL(None, use_errno=True)
        self.fd = self.libc.inotify_init1(os.O_CLOEXEC)
        self.changed = threading.Condition()
        self.times = {}  # by watch
        self.marks = collections.Counter()
        threading.Thread(target=self._read, daemon=True).start()

    def watch(self, folder):
        with self.changed:
            watch = self.libc.inotify_add_watch(self.fd, os.fsencode(folder), IN_OPEN)
            if watch < 0:
                raise OSError(ctypes.get_errno(), f"cannot watch {folder}")
            self.times[watch] = []
        return watch

    def take(self, watch, folder):
        """All that was opened up to now, and forgets it."""
        with self.changed:
            wanted = self.marks[watch] + 1
        (folder / MARK).read_bytes()
        with self.changed:
            self.changed.wait_for(lambda: self.marks[watch] >= wanted)
            times, self.times[watch] = self.times[watch], []
        return times

    def _read(self):
        while True:
            data, at = os.read(self.fd, 1 << 16), 0
            now = time.monotonic()
            with self.changed:
                while at < len(data):
                    watch, mask, _, length = struct.unpack_from("iIII", data, at)
                    name = data[at + 16:at + 16 + length].rstrip(b"\0").decode()
                    at += 16 + length
                    if mask & 0x4000:
                        sys.exit("bench deaths: inotify's queue was too short")
                    if name == MARK:
                        self.marks[watch] += 1
                        self.changed.notify_all()
                    elif name.endswith(".jpg"):
                        self.times[watch].append(now)


class Server:
    def __init__(self, bench):
        self.bench, self.process, self.port = bench, None, 0

    def start(self):
        log = self.bench.work / "server.err"
        said = log.stat().st_size if log.exists() else 0
        with open(log, "ab") as err:
            self.process = subprocess.Popen(
                [self.bench.build / "server/orbbuf-server", "--set", f"listen.address=0.0.0.0:{self.port}", "--set",
                 "listen.insecure=true", "--set", f"files.path={self.bench.data}"], stdout=err, stderr=err)
        while not (found := re.search(r"listening on \S*:(\d+)", log.read_text()[said:])):
            if self.process.poll() is not None:
                sys.exit(f"bench deaths: the server ended: {log.read_text()[said:]}")
            time.sleep(0.05)
        self.port = int(found[1])

    def end(self, how):
        self.process.send_signal(how)
        self.process.wait()


class Session:
    """A start of a robot that is over, and what is known of it from outside."""

    def __init__(self, row, start, opens, killed_at, name):
        self.row, self.start, self.name = row, start, name
        self.opened = len(opens)
        self.captured = max(0, len(opens) - 1)  # and perhaps the next one
        self.is_killed = killed_at is not None
        self.old = sum(1 for at in opens[1:] if killed_at is None or killed_at - at >= YOUNG_S)


class Robot(threading.Thread):
    def __init__(self, bench, number, row):
        super().__init__()
        self.bench, self.row, self.random = bench, row, random.Random(f"{bench.options.seed} {row.name}")
        self.address = f"127.0.1.{number + 1}"
        self.folder = bench.work / row.name
        self.images = self.folder / "images"
        self.images.mkdir(parents=True)
        for image in bench.images:
            os.link(image, self.images / image.name)
        (self.images / MARK).touch()
        self.record = self.folder / "record"
        if row.room_mib:
            self.record.mkdir()
            subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={row.room_mib}m", "tmpfs", self.record], check=True)
        self.watch = bench.opens.watch(self.images)
        self.sessions, self.process, self.is_away, self.failure = [], None, False, None

    def set_away(self, is_away):
        if is_away != self.is_away:
            self.bench.nft(f"{'add' if is_away else 'delete'} element inet cut away {{ {self.address} }}")
        self.is_away = is_away

    def begin(self):
        command = [self.bench.build / "daemon/orbbufd", "--set", f"robot.id={self.row.name}", "--set",
                   f"link.server={self.address}:{self.bench.server.port}", "--set", "source.kind=folder", "--set",
                   f"source.path={self.images}", "--set", "source.fps=50", "--set", "source.loop=true"]
        for key, value in self.row.settings.items():
            command += ["--set", f"{key}={value.replace('RECORD', str(self.record))}"]
        environment = dict(os.environ)
        if self.row.clock:
            steps = [self.random.choice((-10**9, -86400, -3600, -2, 0, 5, 7200, 10**8)) for _ in range(2)]
            environment.update(LD_PRELOAD=str(self.bench.clock), ORBBUF_CLOCK_STEPS=f"{steps[0]} {steps[1]}")
        self.log = self.folder / f"robot-{len(self.sessions)}.err"
        with open(self.log, "wb") as err:
            self.process = subprocess.Popen(command, stdout=err, stderr=err, env=environment)

    def over(self, killed_at):
        self.process.wait()
        opens = self.bench.opens.take(self.watch, self.images)
        found = re.search(r", session ([^,]+),", self.log.read_text())
        self.sessions.append(Session(self.row.name, len(self.sessions), opens, killed_at, found and found[1]))

    def has_lived(self):
        """For some seconds, in which it has told the server what became of its sessions."""
        return self.log.read_text().count("] captured ") >= 4

    def live_and_die(self):
        life = self.random.uniform(0.2, self.bench.longest_life)
        kind = "away" if self.row.server == "never" else self.random.choice(("away", "cut", "there"))
        cut_after = self.random.uniform(0, life) if kind == "cut" else 0
        self.set_away(kind == "away")
        begun = time.monotonic()
        self.begin()
        if kind == "cut":
            time.sleep(cut_after)
            self.set_away(True)
        time.sleep(max(0, begun + life - time.monotonic()))
        killed_at = time.monotonic()
        self.process.kill()
        self.over(killed_at)

    def run(self):
        try:
            for _ in range(self.bench.options.starts - 1):
                self.live_and_die()
            self.set_away(False)
            self.begin()
        except Exception as error:  # pylint: disable=broad-except
            self.failure = error


class Account:
    """What the server has of a session, from its files."""

    def __init__(self, bench, session):
        self.folder = bench.data / session.row / str(session.name)
        self.delivered, self.named, self.problems, self.on_robot = set(), set(), [], 0
        for line in self.lines("times.txt"):
            number = int(line.split()[0])
            if number in self.delivered:
                self.problems.append(f"frame {number} twice in times.txt")
            self.delivered.add(number)
        for line in self.lines("drops.csv")[1:]:
            self.named.add(int(line.split(",")[0]))
        for line in self.lines("session.txt"):
            if line.startswith("on_robot "):
                self.on_robot = int(line.split()[1])
        known = self.delivered | self.named
        missing = [number for number in range(session.captured) if number not in known]
        self.unnamed = [number for number in missing if number < session.old]
        self.too_young = len(missing) - len(self.unnamed)
        self.captured = session.opened

    def lines(self, name):
        path = self.folder / name
        return path.read_text().splitlines() if path.exists() else []

    def examine(self, bench, session):
        """What must not be."""
        if self.folder.exists() and not (self.folder / "session.txt").exists():  # killed with the server
            subprocess.run([bench.build / "server/orbbuf-server", "views", self.folder], capture_output=True, check=True)
        for number in sorted((self.delivered | self.named)):
            if number >= session.opened:
                self.problems.append(f"frame {number} was not captured")
        for number in sorted(self.delivered & self.named):
            self.problems.append(f"frame {number} is there and named")
        wholes = {int(row[0]): row[3] for row in (line.split(",") for line in self.lines("quality.csv")[1:])}
        for number in sorted(self.delivered):
            image = self.folder / "images" / f"{number:06}.jpg"
            crc = f"{zlib.crc32(image.read_bytes()):08X}" if image.exists() else "absent"
            if bench.crcs[number % IMAGES] not in (crc, wholes.get(number)):
                self.problems.append(f"the image of frame {number} is {crc}")
        if not self.folder.exists():
            return
        check = subprocess.run([bench.build / "server/orbbuf-server", "check", self.folder], capture_output=True, text=True)
        *problems, verdict = check.stdout.splitlines()
        expected = ["frames have a reduced JPEG"]
        if session.is_killed:
            expected.append("not ended: " + ("" if session.old == 0 else "the robot was killed"))
        self.problems += [line for line in problems if not any(words in line for words in expected)]
        if session.is_killed and check.returncode == 0:
            self.problems.append(f"check has no complaint: {verdict}")


class Bench:
    def __init__(self, options, work):
        self.options, self.work, self.build = options, work, options.build
        self.longest_life = 5 if options.quick else 9
        self.data = work / "data"
        self.clock = self.build / "bench" / "liborbbuf-stepped-clock.so"
        self.opens, self.server = Opens(), Server(self)

    def nft(self, what):
        subprocess.run(["nft", what], check=True)

    def make_images(self):
        robot = self.work / "images.err"
        with open(robot, "wb") as err:
            subprocess.run([self.build / "daemon/orbbufd", "--set", "robot.id=images", "--set",
                            f"link.server=127.0.0.1:{self.server.port}", "--set", "source.realtime=false", "--set",
                            f"source.frames={IMAGES}", "--set", "source.width=160", "--set", "source.height=120"],
                           stdout=err, stderr=err, check=True)
        self.images = sorted(next(iter((self.data / "images").iterdir())).glob("images/*.jpg"))
        self.crcs = [f"{zlib.crc32(image.read_bytes()):08X}" for image in self.images]
        if len(set(self.crcs)) != IMAGES:
            sys.exit(f"bench deaths: {len(set(self.crcs))} different images instead of {IMAGES}")

    def run(self):
        subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
        self.nft("add table inet cut; add set inet cut away { type ipv4_addr; }; add chain inet cut in { type filter hook "
                 "input priority 0; }; add rule inet cut in ip daddr @away drop; add rule inet cut in ip saddr @away drop")
        self.server.start()
        self.make_images()
        rows = [row for row in ROWS if not self.options.only or row.name in self.options.only.split(",")]
        robots = [Robot(self, number, row) for number, row in enumerate(rows)]
        try:
            for robot in robots:
                robot.start()
            chance = random.Random(self.options.seed)
            while any(robot.is_alive() for robot in robots):
                self.live(robots, chance.uniform(3, 20))
                self.server.end(signal.SIGKILL)
                self.live(robots, chance.uniform(0, 4))
                self.server.start()
            for robot in robots:
                if robot.failure:
                    raise robot.failure
            self.await_settled(robots)
        finally:
            for robot in robots:
                if robot.process and robot.process.poll() is None:
                    robot.process.send_signal(signal.SIGTERM)
        for robot in robots:
            robot.over(None)
        self.server.end(signal.SIGTERM)
        return self.account(robots)

    @staticmethod
    def live(robots, seconds):
        until = time.monotonic() + seconds
        for robot in robots:
            robot.join(max(0, until - time.monotonic()))

    def await_settled(self, robots):
        """Until nothing that a robot may still send is missing, or nothing of that has come for 20 s."""
        least, since = None, time.monotonic()
        while time.monotonic() - since < (10 if self.options.quick else 30):
            accounts = [Account(self, session) for robot in robots for session in robot.sessions]
            missing = sum(len(account.unnamed) + account.on_robot for account in accounts)
            if missing == 0 and all(robot.has_lived() for robot in robots):
                return
            if least is None or missing < least:
                least, since = missing, time.monotonic()
            time.sleep(0.5)
        print(f"bench deaths: {least} frames are still missing", flush=True)

    def account(self, robots):
        total = collections.Counter()
        for robot in robots:
            row = collections.Counter(sessions=len(robot.sessions))
            for session in robot.sessions:
                account = Account(self, session)
                account.examine(self, session)
                row["captured"] += session.captured
                row["delivered"] += len(account.delivered)
                row["named"] += len(account.named)
                row["too_young"] += account.too_young
                row["unnamed"] += len(account.unnamed) + account.on_robot
                row["unexplained"] += len(account.problems)
                where = f"  {session.row}, start {session.start}, session {session.name}"
                if account.unnamed:
                    print(f"{where}: of {session.captured} captured, {session.old} 3 s before its end, neither there nor "
                          f"named: {ranges(account.unnamed)}")
                for problem in account.problems[:5]:
                    print(f"{where}: {problem}")
            print(f"{robot.row.name}: " + ", ".join(f"{key} {row[key]}" for key in KEYS), flush=True)
            total += row
        for key in KEYS:
            print(f"RESULT deaths.{key} {total[key]}")
        return total["unnamed"] == total["unexplained"] == 0


KEYS = ("sessions", "captured", "delivered", "named", "too_young", "unnamed", "unexplained")


def ranges(numbers):
    found = []
    for number in numbers:
        if found and found[-1][1] == number - 1:
            found[-1][1] = number
        else:
            found.append([number, number])
    return ", ".join(f"{a} to {b}" if a != b else f"{a}" for a, b in found[:10]) + (", ..." if len(found) > 10 else "")


def main():
    parser = argparse.ArgumentParser(prog="./dev bench deaths", allow_abbrev=False)
    parser.add_argument("build", type=lambda p: pathlib.Path(p).resolve())
    parser.add_argument("--quick", action="store_true", help="few starts, for CI")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--starts", type=int, help="of each robot")
    parser.add_argument("--only", help="rows, with commas")
    parser.add_argument("--keep", action="store_true", help="leave the files, and say where")
    options = parser.parse_args()
    options.starts = options.starts or (4 if options.quick else 30)
    if "ORBBUF_DEATHS" not in os.environ:  # in namespaces of its own: network and mounts
        os.environ["ORBBUF_DEATHS"] = "1"
        unshare = ["unshare", "-mn"] if os.geteuid() == 0 else ["unshare", "-rmn"]
        if subprocess.run([*unshare, "nft", "list", "ruleset"], capture_output=True).returncode != 0:
            print("bench deaths: no network namespaces here", file=sys.stderr)
            sys.exit(77)
        os.execvp(unshare[0], [*unshare, "/usr/bin/python3", "-B", *sys.argv])
    work = pathlib.Path(tempfile.mkdtemp(prefix="orbbuf-deaths."))
    bench = Bench(options, work)
    begun = time.time()
    try:
        is_good = bench.run()
    finally:
        if bench.server.process and bench.server.process.poll() is None:
            bench.server.end(signal.SIGKILL)
        if options.keep:
            print(f"bench deaths: the files are in {work}")
        else:
            for row in ROWS:
                if row.room_mib:
                    subprocess.run(["umount", work / row.name / "record"], stderr=subprocess.DEVNULL, check=False)
            shutil.rmtree(work)
    print(f"RESULT deaths.seconds {time.time() - begun:.0f}")
    sys.exit(0 if is_good else 1)


if __name__ == "__main__":
    main()
