# SPDX-License-Identifier: Apache-2.0
import os
import shutil
import subprocess
import unittest
from pathlib import Path

import orbbuf
from orbbuf.export import parse_camera
from support import FolderTest, write_session

CAMERAS = {
    "pinhole": "Pinhole 500.5 501 319.5 239.5 0\n640 480\ncrop\n640 480\n",
    "relative": "FOV 0.535719308086809 0.669566858850269 0.493248545285398 0.500408664348414 0.897966326944875\n"
                "1280 1024\nfull\n640 480\n",
    "radtan": "458.654 457.296 367.215 248.375 -0.28340811 0.07395907 0.00019359 1.76187114e-05\n752 480\ncrop\n640 480\n",
    "fisheye": "KannalaBrandt 190.97 190.97 254.93 256.89 0.0034 0.0007 -0.0020 0.0002\n512 512\nnone\n512 512\n",
    "baseline": "Pinhole 707.0912 707.0912 601.8873 183.1104 0\n1226 370\nnone\n1226 370\n0.537150653\n",
}


class ExportTest(FolderTest):
    def export(self, layout, camera, stereo=False):
        session = self.folder / f"session-{camera}-{stereo}"
        if not session.exists():
            write_session(session, [0, 1, 2, 5, 6, 7], stereo, CAMERAS.get(camera, ""))
        out = self.folder / f"{layout}-{camera}-{stereo}"
        notes = {"tum": orbbuf.to_tum, "kitti": orbbuf.to_kitti, "euroc": orbbuf.to_euroc}[layout](
            orbbuf.Session(session), out)
        return session, out, notes

    def test_images_are_hard_links(self):
        session, out, _ = self.export("kitti", "none")
        self.assertTrue(os.path.samefile(session / "images/000005.jpg", out / "image_0/000003.jpg"))

    def test_folder_with_files_and_session_without_frames_are_refused(self):
        session, out, _ = self.export("tum", "none")
        with self.assertRaises(FileExistsError):
            orbbuf.to_tum(orbbuf.Session(session), out)
        write_session(self.folder / "empty", [])
        with self.assertRaisesRegex(ValueError, "no frames"):
            orbbuf.to_euroc(orbbuf.Session(self.folder / "empty"), self.folder / "new")
        self.assertFalse((self.folder / "new").exists())

    def test_times_have_what_the_robots_clock_was_set_by(self):
        session, _, _ = self.export("tum", "none")
        (session / "session.txt").write_text("ended\nclock_offset_ns -40000000\n")
        for layout, name, first in (("kitti", "times.txt", "-0.040000000"),
                                    ("euroc", "mav0/cam0/data.csv", "-000000000040000000,"),
                                    ("tum", "rgb.txt", "-0.040000000 rgb/-0.040000000.jpg")):
            shutil.rmtree(self.folder / f"{layout}-none-False", ignore_errors=True)
            _, out, notes = self.export(layout, "none")
            lines = [line for line in (out / name).read_text().splitlines() if not line.startswith("#")]
            self.assertTrue(lines[0].startswith(first), lines[0])
            self.assertIn("the robot's clock was set: all times have -0.040 s added", notes)

    def test_samples_go_along_to_euroc(self):
        session, _, _ = self.export("kitti", "none")
        (session / "session.txt").write_text("clock_offset_ns 5\n")
        (session / "imu0").mkdir()
        (session / "imu0/data.csv").write_text("#timestamp,w\n10,1,2\n20,0.5,2\n")
        _, out, _ = self.export("euroc", "none")
        self.assertEqual((out / "mav0/imu0/data.csv").read_text(), "#timestamp,w\n15,1,2\n25,0.5,2\n")

    def test_kalibrs_file_goes_along(self):
        session, _, _ = self.export("kitti", "radtan")
        (session / "camchain-imucam.yaml").write_text("cam0:\n")
        _, out, notes = self.export("euroc", "radtan")
        self.assertEqual((out / "camchain-imucam.yaml").read_text(), "cam0:\n")
        self.assertRegex(notes[0], "camchain-imucam.yaml is copied")

    def test_calibration_that_is_none_is_refused(self):
        for text in ("", "Pinhole 1 2 3 4\n640 480\ncrop\n640 480\n", "Pinhole 1 2 3 4 x\n640 480\ncrop\n640 480\n",
                     "1 2 3\n640 480\ncrop\n640 480\n", "Pinhole 1 2 3 4 0\n640\ncrop\n640 480\n",
                     "Pinhole 0 2 3 4 0\n640 480\ncrop\n640 480\n"):
            with self.assertRaises(ValueError):
                parse_camera(text)

    def test_command_line_prints_a_session_and_makes_a_data_set(self):
        session, _, _ = self.export("tum", "radtan")
        (session / "quality.csv").write_text("sequence,quality,whole_bytes,whole_crc\n0,80,0,0\n1,30,40123,0A1B2C3D\n")
        run = lambda *words: subprocess.run(["/usr/bin/python3", "-m", "orbbuf", *words], capture_output=True, text=True)
        said = run(session, "--frames")
        self.assertEqual((said.returncode, said.stderr), (0, ""))
        for line in ("6 frames in 0.3 s, 25.0 frames/s", "missed: 2; longest gap: 2 frames", "drop record: 2 policy",
                     "JPEG quality: 30 to 80, median 30; 1 frames reduced", "camera: RadTan, 752x480",
                     "5 0.200000 quality - missed 2, "):
            self.assertIn(line, said.stdout)
        self.assertEqual(run(session, "--to", "kitti", self.folder / "out").returncode, 0)
        self.assertEqual(len(list((self.folder / "out/image_0").iterdir())), 6)
        for words in ((self.folder / "nowhere",), (session, "--to", "kitti", self.folder / "out"), (session, "--to", "x", "y")):
            said = run(*words)
            self.assertNotEqual(said.returncode, 0)
            self.assertNotIn("Traceback", said.stderr)


if __name__ == "__main__":
    unittest.main()
