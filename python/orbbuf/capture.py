# SPDX-License-Identifier: Apache-2.0
"""A reader with the methods of cv2.VideoCapture, so that programs that read a camera take frames from ORBBuf."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, Optional, Union

from .frame import Frame
from .pipe import Pipe
from .session import PathLike, Session, follow

_POS_MSEC, _POS_FRAMES, _WIDTH, _HEIGHT, _FPS, _COUNT = 0, 1, 3, 4, 5, 7  # cv2.CAP_PROP_*


class VideoCapture:
    """Reads a session's folder, a FIFO or a binary file (Pipe), with the names and results of cv2.VideoCapture.

    With `live`, a folder is followed while the server records it, and read() waits for the next frame. `idle` ends
    that after so many seconds without a frame. Images are BGR, as cv2 has them; `frame` has what belongs to the image
    that grab() or read() took last. Needs NumPy, and OpenCV or Pillow.
    """

    def __init__(self, source: Union[BinaryIO, PathLike, None] = None, live: bool = False,
                 idle: Optional[float] = None) -> None:
        self.frame: Optional[Frame] = None
        self._session: Optional[Session] = None
        self._frames: Optional[Iterator[Frame]] = None
        self._next = 0
        if source is not None:
            self.open(source, live, idle)

    def open(self, source: Union[BinaryIO, PathLike], live: bool = False, idle: Optional[float] = None) -> bool:
        """False, not an exception, if there is no such source."""
        self.release()
        try:
            if not isinstance(source, (str, os.PathLike)) or not Path(source).is_dir():
                self._frames = Pipe(source)
            elif live:
                self._frames = follow(source, idle)
            else:
                self._session = Session(source)
        except (OSError, ValueError):
            return False
        return True

    def isOpened(self) -> bool:
        return self._session is not None or self._frames is not None

    def release(self) -> None:
        if isinstance(self._frames, Pipe):
            self._frames.close()
        self.frame, self._session, self._frames, self._next = None, None, None, 0

    def grab(self) -> bool:
        """Takes the next frame, without decoding it. False: there is none."""
        if self._session is not None:
            self.frame = self._session[self._next] if self._next < len(self._session) else None
        elif self._frames is not None:
            self.frame = next(self._frames, None)
        self._next += self.frame is not None
        return self.frame is not None

    def retrieve(self) -> tuple[bool, Any]:
        return (False, None) if self.frame is None else (True, self.frame.pixels(color=True))

    def read(self) -> tuple[bool, Any]:
        return self.retrieve() if self.grab() else (False, None)

    def get(self, prop: int) -> float:
        """CAP_PROP_POS_MSEC (the capture time since the epoch), POS_FRAMES, FRAME_WIDTH, FRAME_HEIGHT, FPS,
        FRAME_COUNT; 0 for others, and for what is not known, such as the count of a live stream."""
        if prop == _POS_MSEC:
            return self.frame.time_ns * 1e-6 if self.frame else 0.0
        if prop == _POS_FRAMES:
            return float(self._next)
        if prop in (_WIDTH, _HEIGHT):
            frame = self.frame or (self._session[0] if self._session else None)
            return float(frame.pixels().shape[prop == _WIDTH]) if frame else 0.0
        if prop == _FPS:
            return self._session.rate_hz if self._session else 0.0
        if prop == _COUNT:
            return float(len(self._session)) if self._session else 0.0
        return 0.0

    def set(self, prop: int, value: float) -> bool:
        """CAP_PROP_POS_FRAMES of a recorded session; False for others."""
        if prop != _POS_FRAMES or self._session is None or not 0 <= value <= len(self._session):
            return False
        self._next = int(value)
        return True
