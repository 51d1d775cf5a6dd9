#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""What products deliver through the same cuts: run.py BUILD FOLDER [--quick] [--only NAME,...] [--lanes N]
[--outages S,...]. Several rivals run at a time, each over a link of its own. Reports go to FOLDER; if it has those of
an earlier run of the same cuts, the two are compared."""
import argparse
import importlib.util
import json
import math
import pathlib
import shutil
import subprocess
import sys
import time
import zlib

from camera import crc_of_pixels
from figures import agreement
from rivals import ABSENT, RIVALS

HERE = pathlib.Path(__file__).resolve().parent
IMAGES = 5000  # 200 s: no frame that RTP carries is later
FIGURES = ("delivered_share", "longest_gap", "first_frame_s", "live_again_s", "late_worst_s")
# A pair of rivals has an order in a figure if its values differ by more than these; noise of one run.
SLACK = {"live_again_s": lambda larger: 0.3 + 0.3 * larger, "longest_gap": lambda larger: 2 + 0.3 * larger}


def missing(need, build):
    kind, _, name = need.partition(":")
    if kind == "program":
        return None if shutil.which(name, path="/usr/sbin:/usr/bin:/sbin:/bin") else f"no program {name}"
    if kind == "python":
        try:
            return None if importlib.util.find_spec(name) else f"no Python module {name}"
        except ModuleNotFoundError:
            return f"no Python module {name}"
    if kind == "gst":
        has = shutil.which("gst-inspect-1.0") and subprocess.run(["gst-inspect-1.0", name], capture_output=True).returncode == 0
        return None if has else f"no GStreamer element {name}"
    return None if (build / "bench" / f"orbbuf-rival-{name}").exists() else f"the library of peer {name} is not installed"


def make_images(build, folder):
    """The camera's images and their checksums: of the file, and of the coded pixels."""
    images, index = folder / "images", folder / "images.json"
    if not index.exists():
        shutil.rmtree(images, ignore_errors=True)
        subprocess.run(["bash", HERE / "lane.sh", build, "images", images, str(IMAGES)], check=True)
        whole, pixels = [], []
        for path in sorted(images.iterdir()):
            data = path.read_bytes()
            whole.append(zlib.crc32(data))
            pixels.append(crc_of_pixels(data))
        if len(whole) != IMAGES or len(set(pixels)) != IMAGES:
            sys.exit(f"bench rivals: {len(whole)} images, {len(set(pixels))} different ones, instead of {IMAGES}")
        index.write_text(json.dumps({"whole": whole, "pixels": pixels}))
    return images, index


def busy_s():
    """Seconds of CPU used so far, all processors, and all there were."""
    user, nice, system, idle, iowait, *rest = map(int, pathlib.Path("/proc/stat").read_text().split("\n")[0].split()[1:9])
    return (user + nice + system + sum(rest)) / 100, (user + nice + system + idle + iowait + sum(rest)) / 100


class Lanes:
    def __init__(self, options, folder, images, index):
        self.options, self.folder, self.images, self.index = options, folder, images, index
        self.running = []
        self.failed = {}

    def start(self, rival):
        report = self.folder / f"{rival.name}.json"
        report.unlink(missing_ok=True)
        with open(self.folder / f"{rival.name}.log", "w") as log:
            self.running.append((rival, report, time.time(), subprocess.Popen(
                ["bash", HERE / "lane.sh", self.options.build, rival.name, self.images, self.index, self.options.outages,
                 self.options.calm, report], stdout=log, stderr=log)))

    def reap(self):
        for lane in list(self.running):
            rival, report, begun, process = lane
            if process.poll() is None:
                continue
            self.running.remove(lane)
            took = f"{time.time() - begun:.0f} s"
            if process.returncode == 0 and report.exists():
                print(f"  {rival.name}: done in {took}", flush=True)
            else:
                last = (self.folder / f"{rival.name}.log").read_text().strip().split("\n")[-1]
                self.failed[rival.name] = last
                print(f"  {rival.name}: FAILED after {took}: {last}", flush=True)

    def run(self, rivals):
        waiting = list(rivals)
        while waiting or self.running:
            while waiting and len(self.running) < self.options.lanes:
                self.start(waiting.pop(0))
                time.sleep(1)
            time.sleep(0.5)
            self.reap()


def number(value, digits=2):
    return "never" if math.isinf(value) else f"{value:.{digits}f}"


def cell(figures):
    text = (f"{100 * figures['delivered_share']:.0f} %, {figures['longest_gap']}, {number(figures['first_frame_s'])}, "
            f"{number(figures['live_again_s'], 1)}, {number(figures['late_worst_s'], 1)}")
    for key, word in (("repeated", "repeated"), ("out_of_order", "out of order"), ("restart", "restart")):
        if figures[key]:
            text += f"; **{word}**" if key == "restart" else f"; {figures[key]} {word}"
    return text


def tables(reports):
    lengths = sorted({length for r in reports for length in r["outages"]}, key=float)
    yield "| product, setting | " + " | ".join(f"{length} s" for length in lengths) + " |"
    yield "|---" * (len(lengths) + 1) + "|"
    for r in reports:
        cells = [cell(r["outages"][length]) if length in r["outages"] else "" for length in lengths]
        yield f"| {r['setting']} | " + " | ".join(cells) + " |"
    yield ""
    yield "| product, setting | delay in calm: median, p99, ms | CPU a frame: robot, server, ms | memory: robot, server, MiB " \
        "| says what is missing |"
    yield "|---" * 5 + "|"
    for r in reports:
        calm, memory = r["calm"], r["memory_kib"]
        yield (f"| {r['setting']} | {calm['median_ms']:.1f}, {calm['p99_ms']:.1f} | {calm['cpu_robot_ms']:.2f}, "
               f"{calm['cpu_server_ms']:.2f} | {memory['robot'] / 1024:.0f}, {memory['server'] / 1024:.0f} | {r['tells']} |")


def results(report):
    name = f"RESULT rivals.{report['name']}"
    for length, figures in report["outages"].items():
        for key in FIGURES:
            yield f"{name}.{length}.{key} {number(figures[key], 3) if key != 'longest_gap' else figures[key]}"
    yield f"{name}.calm_median_ms {report['calm']['median_ms']:.2f}"
    yield f"{name}.calm_p99_ms {report['calm']['p99_ms']:.2f}"
    yield f"{name}.cpu_ms_per_frame {report['calm']['cpu_robot_ms'] + report['calm']['cpu_server_ms']:.3f}"


def compare(before, now):
    """RESULT lines: how the order of the rows agrees with that of the run before."""
    for figure, slack in SLACK.items():
        for length in sorted({length for r in now for length in r["outages"]}, key=float):
            values = [{r["name"]: r["outages"][length][figure] for r in reports if length in r["outages"]}
                      for reports in (before, now)]
            share, against = agreement(*values, slack)
            yield f"RESULT rivals.same_order.{figure}.{length} {share:.4f}"
            for pair in against[:10]:
                print(f"  {figure} after {length} s: {pair[0]} and {pair[1]} have changed places")


def main():
    parser = argparse.ArgumentParser(prog="./dev bench rivals", allow_abbrev=False)
    parser.add_argument("build", type=lambda p: pathlib.Path(p).resolve())
    parser.add_argument("folder", type=lambda p: pathlib.Path(p).resolve())
    parser.add_argument("--quick", action="store_true", help="without the outage of 60 s")
    parser.add_argument("--only", default="", help="names, with commas")
    parser.add_argument("--lanes", type=int, help="how many at a time")
    parser.add_argument("--outages", help="seconds, with commas; those of a length are repeats")
    options = parser.parse_args()
    options.outages = options.outages or ("2,5,20" if options.quick else "2,5,20,60")
    options.calm = "6" if options.quick else "10"
    options.lanes = options.lanes or (12 if options.quick else 8)
    options.folder.mkdir(parents=True, exist_ok=True)
    for name, why in ABSENT.items():
        print(f"skipped: {name}: {why}")
    wanted, rivals = {n for n in options.only.split(",") if n}, []
    for rival in RIVALS:
        if wanted and rival.name not in wanted:
            continue
        if why := next((m for m in (missing(need, options.build) for need in rival.needs) if m), None):
            print(f"skipped: {rival.name}: {why}")
        else:
            rivals.append(rival)
    images, index = make_images(options.build, options.folder)
    print(f"bench rivals: 25 frames of 40 kB a second; 20 Mbit/s, 10 ms, a queue of 100 ms; cuts of {options.outages} s; "
          f"{len(rivals)} rivals, {options.lanes} at a time, each over its own link", flush=True)
    reports_file = options.folder / f"reports-{options.outages}.json"
    before = json.loads(reports_file.read_text()) if reports_file.exists() else None
    begun, (busy, total) = time.time(), busy_s()
    lanes = Lanes(options, options.folder, images, index)
    lanes.run(rivals)
    busy, total = (b - a for a, b in zip((busy, total), busy_s()))
    reports = [json.loads((options.folder / f"{r.name}.json").read_text()) for r in rivals if r.name not in lanes.failed]
    text = "\n".join(tables(reports))
    (options.folder / "tables.md").write_text(text + "\n")
    print(text)
    for report in reports:
        print("\n".join(results(report)))
    if before and not wanted:
        print("\n".join(compare(before, reports)))
    if not wanted:
        reports_file.write_text(json.dumps(reports))
    print(f"RESULT rivals.seconds {time.time() - begun:.0f}")
    print(f"RESULT rivals.busy_share {busy / total:.2f}")
    for name, why in lanes.failed.items():
        print(f"bench rivals: {name} failed: {why}", file=sys.stderr)
    sys.exit(1 if lanes.failed else 0)


if __name__ == "__main__":
    main()
