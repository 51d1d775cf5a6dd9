# SPDX-License-Identifier: Apache-2.0
import io
import threading
import unittest

import orbbuf
from support import FolderTest, mjpeg, notes, pgm, times_line, write_session

try:
    import numpy
except ImportError:
    raise unittest.SkipTest("no NumPy")
try:
    from PIL import Image
except ImportError:
    Image = None
try:
    import cv2
except ImportError:
    cv2 = None


def photo(sequence, color=False):
    """A smooth JPEG, which decoders agree on."""
    ramp = numpy.add.outer(numpy.arange(48), numpy.arange(64)).astype(numpy.uint8) + numpy.uint8(sequence)
    pixels = numpy.stack([ramp, ramp // 2, 255 - ramp], 2) if color else ramp
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "JPEG", quality=95)
    return file.getvalue(), pixels


class PgmTest(unittest.TestCase):
    def test_pixels_are_those_of_the_stream(self):
        pixels = numpy.arange(12, dtype=numpy.uint8)
        frame = next(orbbuf.Pipe(io.BytesIO(pgm(pixels.tobytes(), 4, notes(1)))))
        self.assertTrue((frame.pixels() == pixels.reshape(3, 4)).all())
        self.assertTrue((frame.pixels(color=True) == pixels.reshape(3, 4, 1)).all())
        self.assertEqual(frame.pixels(color=True).shape, (3, 4, 3))

    def test_capture_reads_a_pipe_to_its_end(self):
        stream = b"".join(pgm(bytes([sequence]) * 12, 4, notes(sequence)) for sequence in (1, 2, 4))
        capture = orbbuf.VideoCapture(io.BytesIO(stream))
        self.assertTrue(capture.isOpened())
        seen = []
        while True:
            there, image = capture.read()
            if not there:
                break
            seen.append((image[0, 0, 0], capture.get(0), capture.frame.sequence))
        self.assertEqual(seen, [(1, 40.0, 1), (2, 80.0, 2), (4, 160.0, 4)])
        self.assertEqual((capture.get(1), capture.get(7)), (3.0, 0.0))


@unittest.skipIf(Image is None, "no Pillow")
class CaptureTest(FolderTest):
    def setUp(self):
        super().setUp()
        self.session = self.folder / "s"
        write_session(self.session, [0, 1, 4])
        for sequence in (0, 1, 4):
            (self.session / f"images/{sequence:06}.jpg").write_bytes(photo(sequence)[0])

    def test_recorded_session_reads_as_a_video(self):
        capture = orbbuf.VideoCapture(str(self.session))
        self.assertEqual([capture.get(prop) for prop in (3, 4, 7)], [64.0, 48.0, 3.0])
        images = []
        while capture.grab():
            images.append(capture.retrieve()[1])
        self.assertEqual(len(images), 3)
        for image, sequence in zip(images, (0, 1, 4)):
            self.assertEqual((image.shape, image.dtype), ((48, 64, 3), numpy.uint8))
            self.assertLess(abs(image[:, :, 0].astype(int) - photo(sequence)[1]).max(), 8)
        self.assertTrue(capture.set(1, 1))
        self.assertTrue(capture.read()[0])
        self.assertEqual(capture.frame.sequence, 1)
        self.assertFalse(capture.set(1, 4))
        capture.release()
        self.assertFalse(capture.isOpened())
        self.assertEqual(capture.read(), (False, None))

    def test_live_session_waits_for_the_next_frame(self):
        capture = orbbuf.VideoCapture(self.session, live=True, idle=10)
        self.assertTrue(all(capture.read()[0] for _ in range(3)))
        (self.session / "images/000005.jpg").write_bytes(photo(5)[0])

        def append():
            with open(self.session / "times.txt", "a") as times:
                times.write(times_line(5))

        threading.Timer(0.05, append).start()
        self.assertTrue(capture.read()[0])
        self.assertEqual(capture.frame.sequence, 5)

    def test_source_that_is_not_there_is_not_opened(self):
        for source in (self.folder / "none", self.session / "times.txt"):
            self.assertFalse(orbbuf.VideoCapture(source).isOpened())
        self.assertEqual(orbbuf.VideoCapture().read(), (False, None))

    def test_colours_are_in_the_order_of_opencv(self):
        data, pixels = photo(0, color=True)
        frame = next(orbbuf.Pipe(io.BytesIO(mjpeg(data, notes(1)))))
        image = frame.pixels(color=True)
        self.assertLess(abs(image[:, :, ::-1].astype(int) - pixels).max(), 12)
        self.assertTrue(image.flags["C_CONTIGUOUS"])

    @unittest.skipIf(cv2 is None, "no OpenCV")
    def test_opencv_and_pillow_agree(self):
        from orbbuf.frame import _decode_with_pillow, decode

        for color in (False, True):
            data = photo(3, color)[0]
            for as_color in (False, True):
                difference = decode(data, as_color).astype(int) - _decode_with_pillow(data, as_color)
                self.assertLess(abs(difference).max(), 8)
        with self.assertRaises(ValueError):
            decode(b"\xff\xd8\xff\xd9")


if __name__ == "__main__":
    unittest.main()
