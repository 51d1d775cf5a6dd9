# SPDX-License-Identifier: Apache-2.0
"""Frames per second through the Python readers, of 640x480 frames that orbbufd made and orbbuf-server recorded.

Usage: PYTHONPATH=python:tests/python reader.py [FRAMES]
folder: Session. pipe: Pipe behind `cat` of one file. c: the same with examples/follow.c, for comparison.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import orbbuf
from support import FOLLOW, ROBOT, SERVER, mjpeg, notes, set_keys


def record(folder: Path, frames: int) -> orbbuf.Session:
    server = subprocess.Popen([SERVER, *set_keys(listen__address="127.0.0.1:0", files__path=folder, status__socket="")],
                              stderr=subprocess.PIPE, text=True)
    try:
        assert server.stderr is not None
        address = next(line for line in server.stderr if "listening on " in line).split("listening on ")[1].strip()
        robot = [ROBOT, *set_keys(robot__id="r", link__server=address, source__frames=frames, source__realtime="false",
                                  buffer__drop_log="", log__level="warn")]
        subprocess.run(robot, check=True)
    finally:
        server.terminate()
        server.communicate()
    [path] = orbbuf.sessions(folder)
    return orbbuf.Session(path)


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 3000
    with tempfile.TemporaryDirectory(prefix="orbbuf-reader.") as name:
        session = record(Path(name) / "frames", 300)
        times = -(-count // len(session))
        begin = time.perf_counter()
        size = sum(len(frame.image) for _ in range(times) for frame in orbbuf.Session(session.folder))
        folder_s = time.perf_counter() - begin

        stream = Path(name) / "stream"
        with open(stream, "wb") as file:
            for sequence in range(times * len(session)):
                file.write(mjpeg(session[sequence % len(session)].image, notes(sequence)))
        begin = time.perf_counter()
        with subprocess.Popen(["cat", stream], stdout=subprocess.PIPE) as cat:
            assert cat.stdout is not None
            got = sum(1 for _ in orbbuf.Pipe(cat.stdout))
        pipe_s = time.perf_counter() - begin
        begin = time.perf_counter()
        subprocess.run(f"cat '{stream}' | '{FOLLOW}' >'{name}/said'", shell=True, check=True)
        c_s = time.perf_counter() - begin
    frames = times * len(session)
    assert got == frames
    print(f"{frames} frames of {size // frames} bytes")
    print(f"RESULT python.folder_fps {frames / folder_s:.0f}")
    print(f"RESULT python.pipe_fps {frames / pipe_s:.0f}")
    print(f"RESULT python.pipe_to_c {c_s / pipe_s:.2f}")


if __name__ == "__main__":
    main()
