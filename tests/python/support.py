# SPDX-License-Identifier: Apache-2.0
"""What the tests share: sessions on disk, streams as the server writes them, and the real programs."""

from __future__ import annotations

import os
import random
import subprocess
import tempfile
import unittest
import zlib
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[2]
BUILD = Path(os.environ.get("ORBBUF_BUILD", SOURCE / "build/dev"))
SERVER = BUILD / "server/orbbuf-server"
ROBOT = BUILD / "daemon/orbbufd"
FOLLOW = BUILD / "tests/e2e/orbbuf-follow"


class FolderTest(unittest.TestCase):
    """A test with a folder of its own."""

    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory(prefix="orbbuf-python.")
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)


def needs(*paths: Path):
    """Skips where a program is not built."""
    return unittest.skipUnless(all(path.exists() for path in paths), f"not built: {', '.join(map(str, paths))}")


def jpeg(seed: int = 1, size: int = 300) -> bytes:
    """Bytes with a JPEG's structure, with all that a reader may trip over: a thumbnail with an end of its own, fill bytes,
    two scans, restart markers and stuffed bytes. No decoder reads it."""
    noise = random.Random(seed).randbytes(size).replace(b"\xff", b"\xff\x00")
    return (
        b"\xff\xd8"
        + b"\xff\xe5\x00\x08\xff\xd8..\xff\xd9"
        + b"\xff\xff\xff\xc4\x00\x05abc"
        + b"\xff\xda\x00\x03!" + noise + b"\xff\xd0" + noise[: size // 3] + b"\xff\xff\x00"
        + b"\xff\xda\x00\x02" + noise[: size // 2] + b"\xff\xd9"
    )


def notes(sequence: int, session: str = "s", more: str = "") -> list[str]:
    return [f"seq={sequence}", f"t={sequence // 25}.{sequence % 25 * 40_000_000:09}", *more.split(), f"session={session}"]


def mjpeg(image: bytes, lines: list[str]) -> bytes:
    """As server/sink/pipe/pipe_format.hpp has it."""
    text = "".join(line + "\n" for line in lines).encode()
    return image[:2] + b"\xff\xfe" + (len(text) + 2).to_bytes(2, "big") + text + image[2:]


def pgm(pixels: bytes, width: int, lines: list[str]) -> bytes:
    head = "".join(f"# {line}\n" for line in lines)
    return f"P5\n{head}{width} {len(pixels) // width}\n255\n".encode() + pixels


def write_session(folder: Path, sequences: list[int], stereo: bool = False, camera: str = "") -> None:
    """A session of 25 frames/s; its qualities and its drop record as well."""
    for images in ["images", "images_right"][: 1 + stereo]:
        (folder / images).mkdir(parents=True)
    sums = ""
    for sequence in sequences:
        for number, images in enumerate(["images", "images_right"][: 1 + stereo]):
            name = f"{images}/{sequence:06}.jpg"
            (folder / name).write_bytes(jpeg(2 * sequence + number))
            sums += f"{name} {zlib.crc32(jpeg(2 * sequence + number)):08X}\n"
    (folder / "checksums.sfv").write_text(sums)
    (folder / "times.txt").write_text("".join(times_line(sequence) for sequence in sequences))
    gone = sorted(set(range(max(sequences, default=0))) - set(sequences))
    (folder / "drops.csv").write_text("sequence,reason,capture_time_s\n" + "".join(
        f"{sequence},policy,{notes(sequence)[1][2:]}\n" for sequence in gone))
    if camera:
        (folder / "camera.txt").write_text(camera)


def times_line(sequence: int) -> str:
    return f"{sequence} {notes(sequence)[1][2:]} {sequence % 2 * 8.5:.6f}\n"


class Program:
    """One of the programs, whose output goes to a file."""

    def __init__(self, command: list[str], log: Path) -> None:
        self.log = log
        with open(log, "ab") as output:
            self.process = subprocess.Popen(command, stdout=output, stderr=output)

    def kill(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()


def set_keys(**keys: object) -> list[str]:
    """--set for each, TABLE__KEY=VALUE."""
    return [word for key, value in keys.items() for word in ("--set", f"{key.replace('__', '.')}={value}")]
