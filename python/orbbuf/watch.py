# SPDX-License-Identifier: Apache-2.0
"""Waits for a change in a folder."""

from __future__ import annotations

import ctypes
import os
import select
from pathlib import Path
from typing import Optional

_MODIFY, _MOVED_TO, _CREATE = 0x2, 0x80, 0x100  # of Linux's inotify


class Watch:
    """Learns of changes from when it is made; also on a network file system, where it looks once a second."""

    def __init__(self, folder: Path) -> None:
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._fd = self._libc.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
        if self._fd < 0 or self._libc.inotify_add_watch(self._fd, os.fsencode(folder), _MODIFY | _MOVED_TO | _CREATE) < 0:
            error = ctypes.get_errno()
            self.close()
            raise OSError(error, os.strerror(error), str(folder))
        self._poll = select.poll()
        self._poll.register(self._fd, select.POLLIN)

    def wait(self, seconds: Optional[float] = None) -> None:
        """Returns after a change since the last call, after `seconds`, or after a second."""
        self._poll.poll(min(1.0 if seconds is None else seconds, 1.0) * 1000)
        try:
            while os.read(self._fd, 65536):
                pass
        except BlockingIOError:
            pass

    def close(self) -> None:
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def __enter__(self) -> Watch:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
