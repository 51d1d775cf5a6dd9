# SPDX-License-Identifier: Apache-2.0
"""Prints sessions, and makes data sets of them: python3 -m orbbuf --help."""

from __future__ import annotations

import argparse
import collections
import statistics
import sys
from collections.abc import Callable
from pathlib import Path

from .export import parse_camera, to_euroc, to_kitti, to_tum
from .frame import Frame
from .session import PathLike, Session, follow, sessions

_LAYOUTS: dict[str, Callable[[Session, PathLike], list[str]]] = {"tum": to_tum, "kitti": to_kitti, "euroc": to_euroc}


def describe(session: Session) -> str:
    """A session in a few lines."""
    lines = [f"{session.folder}: robot {session.robot}, session {session.id}"]
    if not len(session):
        return lines[0] + "\n  no frames"
    frames = list(session)
    seconds = frames[-1].time - frames[0].time
    size = sum(path.stat().st_size for frame in frames for path in (frame.left, frame.right) if isinstance(path, Path))
    kind = "stereo frames" if session.is_stereo else "frames"
    lines.append(f"  {len(frames)} {kind} in {seconds:.1f} s, {session.rate_hz:.1f} frames/s, {size / 2**20:.1f} MiB")
    lines.append(f"  missed: {sum(frame.missed for frame in frames)}; "
                 f"longest gap: {max(frame.missed for frame in frames)} frames")
    drops = collections.Counter(drop.reason for drop in session.drops)
    if drops:
        lines.append("  drop record: " + ", ".join(f"{count} {reason}" for reason, count in sorted(drops.items())))
    known = [frame.quality for frame in frames if frame.quality is not None]
    if known:
        reduced = sum(frame.whole_bytes is not None for frame in frames)
        lines.append(f"  JPEG quality: {min(known)} to {max(known)}, median {statistics.median_low(known)}; "
                     f"{reduced} frames reduced")
    lines.append(f"  camera: {_camera(session)}")
    return "\n".join(lines)


def _camera(session: Session) -> str:
    if session.camera is None:
        return "no calibration"
    try:
        camera = parse_camera(session.camera)
    except ValueError as error:
        return str(error)
    return f"{camera.model}, {camera.width}x{camera.height}"


def _line(frame: Frame) -> str:
    quality = "-" if frame.quality is None else frame.quality
    return f"{frame.sequence} {frame.time_ns / 1e9:.6f} quality {quality} missed {frame.missed}, {len(frame.image)} bytes"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python3 -m orbbuf", description="Prints sessions that orbbuf-server recorded.")
    parser.add_argument("folder", type=Path, help="a session, the folder of a robot, or files.path of the server")
    parser.add_argument("--frames", action="store_true", help="print a line for each frame")
    parser.add_argument("--follow", action="store_true", help="print a line for each frame as it comes, until Ctrl-C")
    parser.add_argument("--to", nargs=2, metavar=("LAYOUT", "OUT"), help="make a data set: tum, kitti or euroc")
    options = parser.parse_args()
    if options.to and options.to[0] not in _LAYOUTS:
        parser.error("--to: tum, kitti or euroc")
    if options.follow:
        for frame in follow(options.folder):
            print(_line(frame), flush=True)
    if options.to:
        for note in _LAYOUTS[options.to[0]](Session(options.folder), options.to[1]):
            print(note, file=sys.stderr)
        return 0
    found = sessions(options.folder)
    if not found:
        raise FileNotFoundError(f"{options.folder}: no session in it")
    for folder in found:
        session = Session(folder)
        print(describe(session))
        for frame in session if options.frames else ():
            print(_line(frame))
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (OSError, ValueError) as failed:
        sys.exit(f"orbbuf: {failed}")
    except KeyboardInterrupt:
        sys.exit(130)
