# SPDX-License-Identifier: Apache-2.0
import io
import os
import random
import subprocess
import threading
import unittest

import orbbuf
from support import FOLLOW, FolderTest, jpeg, mjpeg, needs, notes, pgm


class Trickle(io.RawIOBase):
    """A stream that gives a few bytes at a time, as a slow pipe does."""

    def __init__(self, data, size):
        self._data, self._size = io.BytesIO(data), size

    def read(self, size=-1):
        return self._data.read(min(size, self._size))


def read_all(stream, size=1 << 20):
    return list(orbbuf.Pipe(Trickle(stream, size)))


class PipeTest(unittest.TestCase):
    def test_jpegs_are_read_whatever_the_pieces_they_come_in(self):
        images = [mjpeg(jpeg(seed, 200 * seed + 3), notes(seed, more="quality=30 whole=40123 missed=2 age=0.061"))
                  for seed in range(1, 5)]
        for size in (1, 2, 7, 1 << 20):
            frames = read_all(b"".join(images), size)
            self.assertEqual([frame.image for frame in frames], images)
        frame = frames[1]
        self.assertEqual((frame.session, frame.sequence, frame.time_ns), ("s", 2, 80_000_000))
        self.assertEqual((frame.quality, frame.whole_bytes, frame.age), (30, 40123, 0.061))
        self.assertEqual([frame.missed for frame in frames], [2, 0, 0, 0])
        self.assertIsNone(frame.image_right)

    def test_samples_are_those_of_the_frame(self):
        lines = [f"imu0={1000 + i},{i},-0.5,1e-3,0,0,9.81" for i in range(3)]
        more = b"\xff\xfe" + (2 + len(lines[2])).to_bytes(2, "big") + lines[2].encode()
        left = mjpeg(jpeg(1), notes(1, more=" ".join(lines[:2])))
        at = 4 + int.from_bytes(left[4:6], "big")
        images = [left[:at] + more + left[at:], pgm(bytes(16), 4, notes(2, more=" ".join(lines))), mjpeg(jpeg(3), notes(3))]
        for size in (1, 1 << 20):
            first, second, third = read_all(b"".join(images), size)
            self.assertEqual(first.samples, second.samples)
            self.assertEqual(first.samples[2], orbbuf.Sample("imu0", 1002, (2.0, -0.5, 1e-3), (0.0, 0.0, 9.81)))
            self.assertEqual((len(first.samples), third.samples), (3, ()))
        with self.assertRaisesRegex(orbbuf.PipeError, "seven numbers"):
            read_all(mjpeg(jpeg(1), notes(1, more="imu0=1,2,3")))

    def test_pgms_are_read_whatever_the_pieces_they_come_in(self):
        pixels = bytes(range(256)) + b"P5\n" * 4
        images = [pgm(pixels, 4, notes(sequence)) for sequence in range(3)]
        for size in (1, 5, 1 << 20):
            frames = read_all(b"".join(images), size)
            self.assertEqual([frame.image for frame in frames], images)
        self.assertEqual((frames[0].quality, frames[0].whole_bytes, frames[0].missed, frames[0].age), (None, None, 0, None))

    def test_stereo_images_are_one_frame(self):
        left, right = (mjpeg(jpeg(seed), notes(7, more=f"camera={side}")) for seed, side in ((1, "left"), (2, "right")))
        frames = read_all(left + right)
        self.assertEqual([(frame.image, frame.image_right) for frame in frames], [(left, right)])
        for wrong in (left + left, left + mjpeg(jpeg(2), notes(8, more="camera=right")), left + mjpeg(jpeg(2), notes(7))):
            with self.assertRaisesRegex(orbbuf.PipeError, "right"):
                read_all(wrong)

    def test_no_frame_of_a_session_is_given_twice(self):
        stream = b"".join(mjpeg(jpeg(), notes(*which)) for which in ((0, "a"), (1, "a"), (1, "a"), (0, "a"), (2, "a"), (0, "b"), (0, "b")))
        self.assertEqual([(frame.session, frame.sequence) for frame in read_all(stream)],
                         [("a", 0), ("a", 1), ("a", 2), ("b", 0)])

    def test_missed_frames_are_counted_also_where_the_stream_does_not_say_so(self):
        stream = b"".join(mjpeg(jpeg(), notes(*which)) for which in ((4, "a"), (7, "a"), (8, "a"), (3, "b", "missed=3")))
        self.assertEqual([frame.missed for frame in read_all(stream)], [0, 2, 0, 3])

    def test_stream_that_is_none_says_why(self):
        good = mjpeg(jpeg(), notes(1))
        for stream, why in (
            (b"hello world", "not where an image begins"),
            (b"P6\n", "not where an image begins"),
            (good + jpeg(), "not where an image begins"),
            (good[:-1], "ends in an image"),
            (good[:3], "ends in an image"),
            (mjpeg(jpeg(), ["seq=1", "t=0.000000000"]), "no session"),
            (mjpeg(jpeg(), ["seq=1", "t=1.5", "session=s"]), "not a time"),
            (mjpeg(jpeg(), ["seq=x", "t=1.500000000", "session=s"]), "head"),
            (good[:2] + b"\xff\xfe\x00\x01", "no length"),
            (pgm(b"1234", 2, notes(1)).replace(b"255", b"65535"), "8 bits"),
            (b"P5\n99999 99999\n255\n", "more than"),
            (b"P5\n# " + b"x" * 400, "too long"),
        ):
            with self.assertRaisesRegex(orbbuf.PipeError, why):
                read_all(stream)
        self.assertEqual(read_all(b""), [])

    @needs(FOLLOW)
    def test_agrees_with_the_reader_in_c_on_any_stream(self):
        chance = random.Random(1)
        whole = b"".join(
            mjpeg(jpeg(seed), notes(seed, more="quality=70")) + pgm(b"0123456789", 5, notes(seed + 1, "t")) for seed in range(0, 8, 2))
        for trial in range(300):
            stream = bytearray(whole)
            if trial:
                for _ in range(chance.randrange(1, 4)):
                    at = chance.randrange(len(stream))
                    stream[at : at + chance.randrange(3)] = chance.choice([b"", b"\xff", b"\xff\xd9", b"\n", b"7"])
            said = subprocess.run([FOLLOW], input=bytes(stream), capture_output=True, check=False)
            lines, failed = [], 0
            try:
                for frame in orbbuf.Pipe(io.BytesIO(stream)):
                    size = len(frame.image) if frame.image[:1] == b"\xff" else len(frame.image) - frame.image.index(b"255\n") - 4
                    quality = f", quality {frame.quality}" if frame.quality else ""
                    lines.append(f"{frame.session} {frame.sequence} {frame.time:.6f} camera 0: {size} bytes{quality}")
            except orbbuf.PipeError:
                failed = 1
            self.assertEqual((said.stdout.decode(errors="replace").splitlines(), said.returncode), (lines, failed), bytes(stream))


class FifoTest(FolderTest):
    def setUp(self):
        super().setUp()
        self.fifo = self.folder / "robot.fifo"
        os.mkfifo(self.fifo)

    def follow(self, *streams):
        """A pipe with one writer after the other, each after the reader has seen the end of the one before."""
        ended = threading.Semaphore(0)

        class Followed(orbbuf.Pipe):
            def close(self):
                super().close()
                ended.release()

        def run():
            for stream in streams:
                with open(self.fifo, "wb") as fifo:
                    fifo.write(stream)
                ended.acquire()

        thread = threading.Thread(target=run)
        pipe = Followed(self.fifo)
        self.addCleanup(thread.join)
        self.addCleanup(pipe.close)
        thread.start()
        return pipe

    def test_goes_on_when_a_writer_ends_in_the_middle_of_an_image(self):
        images = [mjpeg(jpeg(seed, 3000), notes(seed)) for seed in range(4)]
        pipe = self.follow(images[0] + images[1] + images[2][:1000], images[1] + images[2] + images[3])
        self.assertEqual([next(pipe).image for _ in range(4)], images)

    def test_half_a_stereo_pair_is_read_again_whole(self):
        left, right = (mjpeg(jpeg(seed), notes(7, more=f"camera={side}")) for seed, side in ((1, "left"), (2, "right")))
        for streams in ((left, left + right), (left + left + right,)):  # with and without an end that the reader sees
            with self.follow(*streams) as pipe:
                frame = next(pipe)
            self.assertEqual((frame.image, frame.image_right), (left, right))

    def test_path_that_is_no_fifo_is_refused(self):
        (self.folder / "file").write_bytes(b"")
        with self.assertRaisesRegex(orbbuf.PipeError, "no FIFO"):
            orbbuf.Pipe(self.folder / "file")


if __name__ == "__main__":
    unittest.main()
