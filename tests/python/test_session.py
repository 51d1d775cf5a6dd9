# SPDX-License-Identifier: Apache-2.0
import threading
import unittest

import orbbuf
from support import FolderTest, jpeg, times_line, write_session


class SessionTest(FolderTest):
    def setUp(self):
        super().setUp()
        self.session = self.folder / "robot" / "s1"

    def test_frames_have_their_bytes_times_and_what_was_missed_before(self):
        write_session(self.session, [1, 2, 5])
        (self.session / "quality.csv").write_text(
            "sequence,quality,whole_bytes,whole_crc\n2,80,0,0\n5,80,0,0\n5,30,40123,0A1B2C3D\n1,0,0,0\n")
        session = orbbuf.Session(self.session)
        self.assertEqual((session.robot, session.id, len(session)), ("robot", "s1", 3))
        self.assertEqual([frame.image for frame in session], [jpeg(2), jpeg(4), jpeg(10)])
        self.assertEqual([(frame.sequence, frame.time_ns, frame.missed) for frame in session],
                         [(1, 40_000_000, 1), (2, 80_000_000, 0), (5, 200_000_000, 2)])
        self.assertEqual([(frame.quality, frame.whole_bytes) for frame in session],
                         [(None, None), (80, None), (30, 40123)])
        self.assertEqual([frame.exposure_ms for frame in session], [8.5, None, 8.5])
        self.assertEqual([drop.sequence for drop in session.drops], [0, 3, 4])
        self.assertEqual(session.drops[1], orbbuf.Drop(3, "policy", 120_000_000))
        self.assertAlmostEqual(session.rate_hz, 1 / 0.12, 6)  # of two steps the later

    def test_frames_are_found_by_index_and_slice(self):
        write_session(self.session, list(range(10)))
        session = orbbuf.Session(self.session)
        self.assertEqual(session[-1].sequence, 9)
        self.assertEqual([frame.sequence for frame in session[2:8:3]], [2, 5])
        self.assertEqual([frame.sequence for frame in reversed(session)], list(range(9, -1, -1)))
        for index in (10, -11):
            with self.assertRaises(IndexError):
                session[index]

    def test_stereo_frames_have_two_images(self):
        write_session(self.session, [0, 1], stereo=True)
        session = orbbuf.Session(self.session)
        self.assertTrue(session.is_stereo)
        self.assertEqual((session[1].image, session[1].image_right), (jpeg(2), jpeg(3)))

    def test_line_that_is_still_written_is_no_frame(self):
        write_session(self.session, [0, 1])
        with open(self.session / "times.txt", "a") as times:
            times.write("2 0.08")
        self.assertEqual(len(orbbuf.Session(self.session)), 2)

    def test_times_before_1970_and_before_2001_are_exact(self):
        write_session(self.session, [0])
        for text, ns in (("-0.000000001", -1), ("-1.500000000", -1_500_000_000), ("0.999999999", 999_999_999)):
            (self.session / "times.txt").write_text(f"0 {text} 0.000000\n")
            self.assertEqual(orbbuf.Session(self.session)[0].time_ns, ns)
        (self.session / "times.txt").write_text("0 1.5 0.000000\n")
        with self.assertRaises(ValueError):
            orbbuf.Session(self.session)

    def test_refresh_reads_on_and_from_the_begin_of_a_replaced_list(self):
        write_session(self.session, [0, 1, 3])
        session = orbbuf.Session(self.session)
        with open(self.session / "times.txt", "a") as times:
            times.write(times_line(4))
        session.refresh()
        self.assertEqual([frame.sequence for frame in session], [0, 1, 3, 4])
        (self.session / "new").write_text("".join(times_line(sequence) for sequence in range(5)))  # a late frame merged
        (self.session / "new").rename(self.session / "times.txt")
        session.refresh()
        self.assertEqual([frame.sequence for frame in session], [0, 1, 2, 3, 4])
        self.assertEqual(session.drops, [])

    def test_folder_that_is_not_there_is_an_error(self):
        with self.assertRaises(FileNotFoundError):
            orbbuf.Session(self.session)

    def test_sessions_are_found_below_each_kind_of_folder(self):
        for name in ("a/s1", "a/s2", "b/s1"):
            write_session(self.folder / name, [0])
        self.assertEqual(len(orbbuf.sessions(self.folder)), 3)
        self.assertEqual(orbbuf.sessions(self.folder / "a"), [self.folder / "a/s1", self.folder / "a/s2"])
        self.assertEqual(orbbuf.sessions(self.folder / "a/s1"), [self.folder / "a/s1"])


class FollowTest(FolderTest):
    def setUp(self):
        super().setUp()
        self.times = self.folder / "times.txt"

    def append(self, text):
        with open(self.times, "a") as times:
            times.write(text)

    def test_frames_come_as_the_list_grows(self):
        write_session(self.folder, [0, 1, 4])
        frames = orbbuf.follow(self.folder)
        self.assertEqual([next(frames).sequence for _ in range(3)], [0, 1, 4])
        line = times_line(6)
        threading.Timer(0.05, lambda: (self.append(line[:5]), self.append(line[5:]))).start()
        frame = next(frames)  # waits
        self.assertEqual((frame.sequence, frame.missed), (6, 1))

    def test_session_without_a_list_begins_with_its_first_frame(self):
        frames = orbbuf.follow(self.folder)
        threading.Timer(0.05, self.append, [times_line(0)]).start()
        self.assertEqual(next(frames).sequence, 0)

    def test_no_frame_is_given_twice_when_the_list_is_cut_or_replaced(self):
        write_session(self.folder, [0, 1, 2])
        frames = orbbuf.follow(self.folder)
        self.assertEqual([next(frames).sequence for _ in range(3)], [0, 1, 2])
        self.times.write_text(times_line(0))  # after a power cut; then the robot sends them again
        self.append(times_line(1) + times_line(2) + times_line(3))
        self.assertEqual(next(frames).sequence, 3)
        (self.folder / "new").write_text("".join(times_line(sequence) for sequence in (0, 1, 2, 3, 7)))
        (self.folder / "new").rename(self.times)
        self.assertEqual(next(frames).sequence, 7)

    def test_idle_ends_it(self):
        write_session(self.folder, [0, 1])
        self.assertEqual(len(list(orbbuf.follow(self.folder, idle=0.05))), 2)


if __name__ == "__main__":
    unittest.main()
