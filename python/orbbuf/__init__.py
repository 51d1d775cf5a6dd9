# SPDX-License-Identifier: Apache-2.0
"""Reads the frames that orbbuf-server records in folders and writes to pipes."""

from .capture import VideoCapture
from .export import to_euroc, to_kitti, to_tum
from .frame import Frame, Sample
from .pipe import Pipe, PipeError
from .session import Drop, Session, follow, sessions

__all__ = ["Drop", "Frame", "Pipe", "PipeError", "Sample", "Session", "VideoCapture", "follow", "sessions", "to_euroc",
           "to_kitti", "to_tum"]
