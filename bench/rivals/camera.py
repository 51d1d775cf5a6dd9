#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""A camera of the bench: image NUMBER mod COUNT of a folder, at BEGIN + NUMBER / 25 by the system's clock.

camera.py FOLDER BEGIN [queue]   writes each frame to standard output: its length in 4 bytes, its number in 8, the
                                 JPEG. While the reader blocks, frames are lost; with `queue` they wait, without a
                                 bound."""
import collections
import fcntl
import os
import struct
import sys
import threading
import time
import zlib

FPS = 25


class Camera:
    def __init__(self, folder, begin):
        self.images = sorted(os.path.join(folder, name) for name in os.listdir(folder))
        self.begin = float(begin)

    def __iter__(self):
        """(number, JPEG) each; what is captured while the user does not ask is lost."""
        number = -1
        while True:
            number = max(number + 1, int((time.time() - self.begin) * FPS))
            time.sleep(max(0.0, self.begin + number / FPS - time.time()))
            with open(self.images[number % len(self.images)], "rb") as image:
                yield number, image.read()

    def messages(self):
        """The same as one message: the number in 8 bytes, and the JPEG."""
        for number, jpeg in self:
            yield struct.pack(">Q", number) + jpeg


class Waiting:
    """Messages of a camera that wait without a bound, captured by a thread."""

    def __init__(self, camera):
        self.queue = collections.deque()
        self.some = threading.Condition()
        threading.Thread(target=self._capture, args=(camera,), daemon=True).start()

    def _capture(self, camera):
        for message in camera.messages():
            with self.some:
                self.queue.append(message)
                self.some.notify()

    def first(self):
        with self.some:
            self.some.wait_for(lambda: self.queue)
            return self.queue[0]

    def drop_first(self):
        with self.some:
            self.queue.popleft()

    def __iter__(self):
        while True:
            yield self.first()
            self.drop_first()


def arrived(message):
    """Prints the line NUMBER TIME CRC of a message that arrived."""
    number, = struct.unpack_from(">Q", message)
    print(number, f"{time.time():.6f}", zlib.crc32(memoryview(message)[8:]), flush=True)


def crc_of_pixels(jpeg):
    """Of the coded pixels, which are what RTP keeps of a JPEG."""
    scan = jpeg.find(b"\xff\xda") + 2
    return zlib.crc32(jpeg[scan + int.from_bytes(jpeg[scan:scan + 2], "big"):].removesuffix(b"\xff\xd9"))


def main():
    fcntl.fcntl(sys.stdout.fileno(), 1031, 4096)  # F_SETPIPE_SZ: the pipe is no queue
    camera = Camera(sys.argv[1], sys.argv[2])
    messages = Waiting(camera) if sys.argv[3:] == ["queue"] else camera.messages()
    for message in messages:
        for part in (struct.pack(">I", len(message)), message):
            view = memoryview(part)
            while view:
                view = view[os.write(1, view):]


if __name__ == "__main__":
    main()
