# SPDX-License-Identifier: Apache-2.0
"""Sessions that orbbuf-server has recorded, or records now: docs/datasets.md describes the folder."""

from __future__ import annotations

import bisect
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Optional, Union, overload

from .frame import Frame
from .watch import Watch

PathLike = Union[str, "os.PathLike[str]"]


@dataclass(frozen=True)
class Drop:
    """A captured frame that is not in the session."""

    sequence: int
    reason: str  #: policy, busy, failed, shutdown, refused, unknown, lost: docs/datasets.md
    time_ns: int


class _Taken(NamedTuple):
    """A line of times.txt."""

    sequence: int
    time_ns: int
    exposure_ms: Optional[float]


def parse_seconds(text: str) -> int:
    """Nanoseconds of SECONDS.NANOSECONDS, an optional minus and nine decimals."""
    seconds, _, nanoseconds = text.removeprefix("-").partition(".")
    if len(nanoseconds) != 9 or not (seconds + nanoseconds).isdecimal():
        raise ValueError(f"not a time: {text}")
    magnitude = int(seconds) * 1_000_000_000 + int(nanoseconds)
    return -magnitude if text.startswith("-") else magnitude


def format_seconds(time_ns: int) -> str:
    """What parse_seconds() reads."""
    seconds, nanoseconds = divmod(abs(time_ns), 1_000_000_000)
    return f"{'-' if time_ns < 0 else ''}{seconds}.{nanoseconds:09}"


class _Tail:
    """The whole lines of a file that grows, and that may be replaced or cut."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._offset, self._inode = 0, 0

    def read(self) -> tuple[list[str], bool]:
        """The lines since the last call; and whether they are all lines, since the file is another one."""
        try:
            with open(self._path, "rb") as file:
                status = os.fstat(file.fileno())
                is_new = status.st_ino != self._inode or status.st_size < self._offset
                if is_new:
                    self._offset, self._inode = 0, status.st_ino
                file.seek(self._offset)
                data = file.read()
        except FileNotFoundError:
            return [], False
        end = data.rfind(b"\n") + 1
        self._offset += end
        return data[:end].decode().splitlines(), is_new


class Session(Sequence[Frame]):
    """The frames of a session's folder, in the order of their capture, as they are now."""

    def __init__(self, folder: PathLike) -> None:
        self.folder = Path(folder)
        if not self.folder.is_dir():
            raise FileNotFoundError(f"{self.folder}: no such folder")
        self.id = self.folder.resolve().name
        self.robot = self.folder.resolve().parent.name
        self._taken: list[_Taken] = []
        self._qualities: dict[int, tuple[int, int]] = {}
        self._times_tail = _Tail(self.folder / "times.txt")
        self._qualities_tail = _Tail(self.folder / "quality.csv")
        self.refresh()

    def refresh(self) -> None:
        """Reads what has come since, while the server records the session."""
        lines, is_new = self._times_tail.read()
        if is_new:
            self._taken.clear()
        for line in lines:
            sequence, seconds, exposure = line.split()
            self._taken.append(_Taken(int(sequence), parse_seconds(seconds), float(exposure) or None))
        lines, is_new = self._qualities_tail.read()
        for line in lines[1:] if is_new else lines:
            sequence, quality, whole_bytes, _ = line.split(",")
            self._qualities[int(sequence)] = int(quality), int(whole_bytes)
        self._has_right = (self.folder / "images_right").is_dir()

    @property
    def is_stereo(self) -> bool:
        """Whether each frame has two images."""
        return self._has_right

    @property
    def camera(self) -> Optional[str]:
        """The calibration in DSO's format, camera.txt; None if the robot sent none."""
        path = self.folder / "camera.txt"
        return path.read_text() if path.exists() else None

    @property
    def clock_offset_ns(self) -> int:
        """What the robot's clock was set by since the session began: to be added to all times. 0 while it is not known."""
        for line in _Tail(self.folder / "session.txt").read()[0]:
            if line.startswith("clock_offset_ns "):
                return int(line.split()[1])
        return 0

    @property
    def drops(self) -> list[Drop]:
        """The captured frames that are not in the session, with the reason. The list is complete when the session
        has ended."""
        drops = {}
        for line in _Tail(self.folder / "drops.csv").read()[0][1:]:
            sequence, reason, seconds = line.split(",")
            drops[int(sequence)] = Drop(int(sequence), reason, parse_seconds(seconds))
        there = {taken.sequence for taken in self._taken}
        return [drop for sequence, drop in sorted(drops.items()) if sequence not in there]

    @property
    def rate_hz(self) -> float:
        """Frames per second of the camera, by the step that is between most frames, whatever was dropped; 0: unknown."""
        steps = sorted(after.time_ns - before.time_ns for before, after in zip(self._taken, self._taken[1:]))
        return 1e9 / steps[len(steps) // 2] if steps and steps[len(steps) // 2] > 0 else 0.0

    def __len__(self) -> int:
        return len(self._taken)

    @overload
    def __getitem__(self, index: int) -> Frame: ...
    @overload
    def __getitem__(self, index: slice) -> list[Frame]: ...
    def __getitem__(self, index: Union[int, slice]) -> Union[Frame, list[Frame]]:
        if isinstance(index, slice):
            return [self._frame(i) for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        return self._frame(index % len(self))

    def _frame(self, index: int) -> Frame:
        return self._make(self._taken[index], self._taken[index - 1].sequence if index else -1)

    def _make(self, taken: _Taken, before: int) -> Frame:
        quality, whole_bytes = self._qualities.get(taken.sequence, (0, 0))
        name = f"{taken.sequence:06}.jpg"
        return Frame(self.id, taken.sequence, taken.time_ns, taken.sequence - before - 1, quality or None,
                     whole_bytes or None, taken.exposure_ms, left=self.folder / "images" / name,
                     right=self.folder / "images_right" / name if self._has_right else None)


def follow(folder: PathLike, idle: Optional[float] = None) -> Iterator[Frame]:
    """The frames of a session, those that are there and then each as the server accepts it, without repeats.

    Continues across outages and restarts of the server. It ends after `idle` seconds without a frame (None: never).
    Frames that the robot's spool delivers late are left out, since newer ones have been given.
    """
    session = Session(folder)
    last = -1
    with Watch(session.folder) as watch:
        newest = time.monotonic()
        while True:
            session.refresh()
            new = session._taken[bisect.bisect_left(session._taken, (last + 1,)) :]
            for taken in new:
                yield session._make(taken, last)
                last = taken.sequence
                newest = time.monotonic()
            left = None if idle is None else newest + idle - time.monotonic()
            if left is not None and left <= 0:
                return
            if not new:
                watch.wait(left)


def sessions(folder: PathLike) -> list[Path]:
    """The folders of the sessions in `folder`, which may be a session, a robot's folder or the server's files.path."""
    root = Path(folder)
    found = {path.parent for pattern in ("times.txt", "*/times.txt", "*/*/times.txt") for path in root.glob(pattern)}
    return sorted(found)
