# SPDX-License-Identifier: Apache-2.0
"""One frame, and its pixels."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Optional, Union

_PGM_HEAD = re.compile(rb"P5\n(?:#[^\n]*\n)*(\d+) (\d+)\n255\n")


class Sample(NamedTuple):
    """One reading of an inertial sensor."""

    sensor: str  #: its name, for example imu0
    time_ns: int  #: nanoseconds since the epoch, on the clock of the frames
    angular_velocity: tuple[float, float, float]  #: rad/s
    linear_acceleration: tuple[float, float, float]  #: m/s^2, gravity included


@dataclass(frozen=True)
class Frame:
    """A frame of one camera, or the two images of a stereo pair.

    The images of a recorded frame are read from their files at each access, those of a live one are in memory.
    """

    session: str  #: the id of the session: one run of the robot's daemon
    sequence: int  #: counts the captured frames of the session from 0
    time_ns: int  #: capture time in nanoseconds since the epoch
    missed: int = 0  #: frames of the session that are not here, since the one before; of a recorded first one, since 0
    quality: Optional[int] = None  #: of the JPEG that the robot sent, 1 to 100; None: not known
    whole_bytes: Optional[int] = None  #: size of the JPEG that the robot reduced it from; None: not reduced
    exposure_ms: Optional[float] = None  #: None: not known
    age: Optional[float] = None  #: of a live frame, seconds from its capture to the server's write
    samples: tuple[Sample, ...] = field(default=(), repr=False)  #: of a live frame: all since the one before
    left: Union[bytes, Path] = field(default=b"", repr=False)
    right: Union[bytes, Path, None] = field(default=None, repr=False)

    @property
    def time(self) -> float:
        """Capture time in seconds since the epoch, rounded: good to about 0.2 us."""
        return self.time_ns * 1e-9

    @property
    def image(self) -> bytes:
        """The image file, JPEG or (from a pipe with format "pgm") PGM; of a stereo pair the left one."""
        return _bytes_of(self.left)

    @property
    def image_right(self) -> Optional[bytes]:
        """The right image of a stereo pair, else None."""
        return None if self.right is None else _bytes_of(self.right)

    def pixels(self, color: bool = False) -> Any:
        """The image as a NumPy array of uint8: height x width, or with color height x width x 3 in the order BGR."""
        return decode(self.image, color)

    def pixels_right(self, color: bool = False) -> Any:
        """As pixels(), of the right image; None without one."""
        return None if self.right is None else decode(_bytes_of(self.right), color)


def _bytes_of(image: Union[bytes, Path]) -> bytes:
    return image if isinstance(image, bytes) else image.read_bytes()


def decode(image: bytes, color: bool = False) -> Any:
    """The pixels of a JPEG or PGM file, as Frame.pixels() has them. Needs NumPy; for JPEG also OpenCV or Pillow."""
    import numpy

    head = _PGM_HEAD.match(image)
    if head:
        gray = numpy.frombuffer(image, numpy.uint8, offset=head.end()).reshape(int(head[2]), int(head[1]))
        return numpy.repeat(gray[:, :, None], 3, 2) if color else gray
    try:
        import cv2
    except ImportError:
        return _decode_with_pillow(image, color)
    pixels = cv2.imdecode(numpy.frombuffer(image, numpy.uint8), cv2.IMREAD_COLOR if color else cv2.IMREAD_GRAYSCALE)
    if pixels is None:
        raise ValueError("the image cannot be decoded")
    return pixels


def _decode_with_pillow(image: bytes, color: bool) -> Any:
    import io

    import numpy
    from PIL import Image

    with Image.open(io.BytesIO(image)) as opened:
        pixels = numpy.asarray(opened.convert("RGB" if color else "L"))
    return numpy.ascontiguousarray(pixels[:, :, ::-1]) if color else pixels
