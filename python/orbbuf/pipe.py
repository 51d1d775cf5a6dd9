# SPDX-License-Identifier: Apache-2.0
"""Frames live from orbbuf-server, over the pipe that [slam] of its configuration describes (docs/slam.md)."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, BinaryIO, Optional, Union

from .frame import Frame, Sample
from .session import PathLike, parse_seconds

_MAX_IMAGE = 1 << 28  # longer images are an error, not a reason to take memory
_MAX_LINE = 319
# After a JPEG's scan: the next marker that has a length, or is the end. 00, 01 and D0 to D7 are in the scan.
_MARKER = re.compile(rb"\xff[^\x00\x01\xd0-\xd7\xff]")


class PipeError(ValueError):
    """The stream is not what orbbuf-server writes."""


class _Ended(Exception):
    """The stream has ended in an image."""


class Pipe(Iterator[Frame]):
    """The frames of a pipe, each as soon as it is whole, without repeats.

    `source` is a binary file, such as sys.stdin.buffer of a program that the server has started, or the path of a
    FIFO. A FIFO is followed through the ends of sessions and of the server itself; for Frame.session says of which
    session a frame is. A file ends with the stream. One Pipe belongs to one thread at a time.
    """

    def __init__(self, source: Union[BinaryIO, PathLike]) -> None:
        self._path: Optional[PathLike] = None
        self._buffer = bytearray()
        self._last = ("", -1)  # session and sequence of the newest frame
        if isinstance(source, (str, os.PathLike)):
            if not stat.S_ISFIFO(os.stat(source).st_mode):
                raise PipeError(f"{source}: no FIFO")
            self._path = source
            self._file: Any = None
        else:
            self._file = source

    def __next__(self) -> Frame:
        while True:
            if self._file is None:
                assert self._path is not None
                self._file = open(self._path, "rb", buffering=0)  # waits for a server
            try:
                frame = self._read_frame()
            except _Ended:
                if self._path is None:
                    raise PipeError("the stream ends in an image") from None
                frame = None
            if frame is None:
                if self._path is None:
                    raise StopIteration
                self.close()
            elif frame.session != self._last[0]:
                self._last = (frame.session, frame.sequence)
                return frame
            elif frame.sequence > self._last[1]:
                missed = frame.sequence - self._last[1] - 1  # a server that has just started does not know it
                self._last = (frame.session, frame.sequence)
                return replace(frame, missed=missed)

    def close(self) -> None:
        """Closes a FIFO; a file stays the caller's."""
        if self._path is not None and self._file is not None:
            self._file.close()
            self._file = None
        self._buffer.clear()

    def __enter__(self) -> Pipe:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _read_frame(self) -> Optional[Frame]:
        first = self._read_image()
        if first is None:
            return None
        image, notes, samples = first
        right = None
        while notes.get("camera") == "left" and right is None:
            second = self._read_image()
            if second is None:
                raise _Ended
            if (second[1].get("camera"), second[1]["seq"]) == ("right", notes["seq"]):
                right = second[0]
            elif self._path is None:
                raise PipeError("a left image is not followed by its right one")
            else:  # the writer has gone between the two, and another one come
                image, notes, samples = second
        try:
            return Frame(
                session=notes["session"],
                sequence=int(notes["seq"]),
                time_ns=parse_seconds(notes["t"]),
                missed=int(notes.get("missed", 0)),
                quality=int(notes.get("quality", 0)) or None,
                whole_bytes=int(notes.get("whole", 0)) or None,
                age=float(notes["age"]) if "age" in notes else None,
                samples=samples,
                left=image,
                right=right,
            )
        except ValueError as error:
            raise PipeError(f"the image's head: {error}") from None

    def _read_image(self) -> Optional[tuple[bytes, dict[str, str], tuple[Sample, ...]]]:
        """The next image and what its head tells; None at the end."""
        if not self._buffer and not self._fill():
            return None
        lines, size = self._read_pgm() if self._buffer[:1] == b"P" else self._read_jpeg()
        notes = dict(line.split("=", 1) for line in lines if "=" in line and not line.startswith("imu"))
        samples = tuple(_sample(line) for line in lines if line.startswith("imu"))
        if not {"seq", "t", "session"} <= notes.keys():
            raise PipeError("the image has no seq, no t or no session")
        image = bytes(self._buffer[:size])
        del self._buffer[:size]
        return image, notes, samples

    def _read_pgm(self) -> tuple[list[str], int]:
        lines: list[str] = []
        line, at = self._line(0)
        if line != "P5":
            raise PipeError("this is not where an image begins")
        line, at = self._line(at)
        while line.startswith("#"):
            lines.append(line[2:])
            line, at = self._line(at)
        size = line.split()
        line, at = self._line(at)
        if len(size) != 2 or not all(number.isdecimal() for number in size) or line != "255":
            raise PipeError("the image has no size, or has not 8 bits a pixel")
        end = at + int(size[0]) * int(size[1])
        self._need(end)
        return lines, end

    def _read_jpeg(self) -> tuple[list[str], int]:
        self._need(4)
        if self._buffer[:4] != b"\xff\xd8\xff\xfe":  # the server's lines are the first segment, a comment
            raise PipeError("this is not where an image begins")
        at = self._segment(4)
        lines = self._buffer[6:at].decode("ascii", "replace").split("\n")
        is_head = True  # comments that follow have more samples
        while True:
            self._need(at + 2)
            if self._buffer[at] != 0xFF:
                raise PipeError("a JPEG marker is missing")
            marker = self._buffer[at + 1]
            at += 1 if marker == 0xFF else 2
            if marker == 0xD9:
                return lines, at
            if marker in (0xFF, 0x00, 0x01) or 0xD0 <= marker <= 0xD7:
                continue
            begin, at = at, self._segment(at)
            if marker == 0xFE and is_head and self._buffer.startswith(b"imu", begin + 2):
                lines += self._buffer[begin + 2 : at].decode("ascii", "replace").split("\n")
            else:
                is_head = False
            if marker == 0xDA:
                at = self._scan(at)

    def _segment(self, at: int) -> int:
        """Where the segment ends whose length is there."""
        self._need(at + 2)
        length = int.from_bytes(self._buffer[at : at + 2], "big")
        if length < 2:
            raise PipeError("a JPEG segment has no length")
        self._need(at + length)
        return at + length

    def _scan(self, at: int) -> int:
        """Where the first marker after the scan is, which begins there."""
        while True:
            found = _MARKER.search(self._buffer, at)
            if found:
                return found.end() - 2
            at = max(at, len(self._buffer) - 1)  # a last FF may be the begin of one
            self._need(len(self._buffer) + 1)

    def _line(self, at: int) -> tuple[str, int]:
        """The line that begins there, and where the next one does."""
        while True:
            end = self._buffer.find(b"\n", at, at + _MAX_LINE + 1)
            if end >= 0:
                return self._buffer[at:end].decode("ascii", "replace"), end + 1
            if len(self._buffer) > at + _MAX_LINE:
                raise PipeError("a line of the head is too long")
            self._need(len(self._buffer) + 1)

    def _need(self, size: int) -> None:
        if size > _MAX_IMAGE:
            raise PipeError(f"an image of more than {_MAX_IMAGE} bytes")
        while len(self._buffer) < size:
            if not self._fill():
                raise _Ended

    def _fill(self) -> bool:
        read = getattr(self._file, "read1", self._file.read)  # what is there, not all that was asked for
        chunk = read(1 << 16)
        self._buffer += chunk
        return bool(chunk)


def _sample(line: str) -> Sample:
    """What `SENSOR=TIME,WX,WY,WZ,AX,AY,AZ` says."""
    sensor, _, fields = line.partition("=")
    try:
        time, *numbers = fields.split(",")
        wx, wy, wz, ax, ay, az = map(float, numbers)
        return Sample(sensor, int(time), (wx, wy, wz), (ax, ay, az))
    except ValueError:
        raise PipeError(f"a sample has not seven numbers: {line}") from None
