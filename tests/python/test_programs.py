# SPDX-License-Identifier: Apache-2.0
"""The readers behind the real programs."""

import contextlib
import os
import queue
import re
import shutil
import socket
import subprocess
import threading
import unittest
from decimal import Decimal
from pathlib import Path

import orbbuf
from orbbuf.watch import Watch
from support import ROBOT, SERVER, FolderTest, Program, needs, set_keys
from test_export import CAMERAS

PATIENCE = 60  # seconds; nothing waits for it to pass


class Link:
    """A link to a server, which can be cut."""

    def __init__(self) -> None:
        self.server = ("", 0)
        self._ends = []
        self._lock = threading.Lock()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = "127.0.0.1:%d" % self._listener.getsockname()[1]
        self._is_up = True
        self._thread = threading.Thread(target=self._accept)
        self._thread.start()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                near, _ = self._listener.accept()
                with self._lock, contextlib.suppress(OSError):
                    self._ends.append(near)
                    if not self._is_up:
                        near.shutdown(socket.SHUT_RDWR)
                        continue
                    far = socket.create_connection(self.server)
                    self._ends.append(far)
                    for ends in ((near, far), (far, near)):
                        threading.Thread(target=self._carry, args=ends, daemon=True).start()

    def _carry(self, source, target) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                target.sendall(data)
        for end in (source, target):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def cut(self) -> None:
        with self._lock:
            self._is_up = False
            for end in self._ends:
                with contextlib.suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)

    def mend(self) -> None:
        with self._lock:
            self._is_up = True

    def close(self) -> None:
        self.cut()
        self._listener.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._listener.close()
        for end in self._ends:
            end.close()


def without_comment(image: bytes) -> bytes:
    """The JPEG as the robot sent it."""
    return image[:2] + image[4 + int.from_bytes(image[4:6], "big"):]


def tree(folder: Path) -> dict:
    """What each file has, numbers as numbers: their digits are the printer's choice."""

    def content(path):
        if path.suffix in (".jpg", ".png"):
            return path.read_bytes()
        text = path.read_text().replace("orbbuf-server export", "orbbuf")
        return [Decimal(word) if re.fullmatch(r"-?\d+(\.\d+)?(e[+-]?\d+)?", word) else word
                for word in re.split(r"[\s,\[\]]+", text)]

    return {str(path.relative_to(folder)): content(path) for path in sorted(folder.rglob("*")) if path.is_file()}


@needs(SERVER, ROBOT)
class ProgramsTest(FolderTest):
    def wait_for(self, log: Path, pattern: str) -> re.Match:
        with Watch(log.parent) as watch:
            while True:
                if found := re.search(pattern, log.read_text()):
                    return found
                watch.wait()

    def start_server(self, address="127.0.0.1:0") -> Program:
        log = self.folder / "logs" / f"server{len(os.listdir(self.folder / 'logs'))}"
        server = Program([SERVER, *set_keys(
            listen__address=address, files__path=self.folder / "frames", slam__fifo=self.folder / "{robot}.fifo",
            slam__format="mjpeg", slam__resume="backlog", status__socket="")], log)
        self.addCleanup(server.kill)
        self.address = self.wait_for(log, r"listening on (127\.0\.0\.1:\d+)")[1]
        return server

    def start_robot(self, server, **keys) -> Program:
        robot = Program([ROBOT, *set_keys(**{"robot__id": "r", "link__server": server, "buffer__drop_log": "", **keys})],
                        self.folder / "logs/robot")
        self.addCleanup(robot.kill)
        return robot

    def collect(self, frames) -> queue.Queue:
        """What an endless reader gives, by a thread that ends with the test's process."""
        got: queue.Queue = queue.Queue()

        def run():
            for frame in frames():
                got.put(frame)

        threading.Thread(target=run, daemon=True).start()
        return got

    def setUp(self):
        super().setUp()
        (self.folder / "logs").mkdir()
        os.mkfifo(self.folder / "r.fifo")

    def test_readers_survive_an_outage_and_a_restart_of_the_server(self):
        captured = 300
        server = self.start_server()
        link = Link()
        self.addCleanup(link.close)
        host, port = self.address.split(":")
        link.server = (host, int(port))
        live = self.collect(lambda: orbbuf.Pipe(self.folder / "r.fifo"))
        robot = self.start_robot(link.address, source__frames=captured, source__fps=40, source__width=320,
                                 source__height=240, buffer__policy="drop-oldest", buffer__capacity=5)
        frames = [live.get(timeout=PATIENCE) for _ in range(40)]
        [session] = orbbuf.sessions(self.folder / "frames")
        recorded = self.collect(lambda: orbbuf.follow(session))

        link.cut()
        self.wait_for(self.folder / "logs/robot", r" dropped [1-9]")
        link.mend()
        frames += [live.get(timeout=PATIENCE) for _ in range(40)]
        server.kill()
        self.start_server(self.address)
        self.assertEqual(robot.process.wait(PATIENCE), 0, robot.log.read_text())

        whole = orbbuf.Session(session)
        while frames[-1].sequence < whole[-1].sequence:
            frames.append(live.get(timeout=PATIENCE))
        followed = [recorded.get(timeout=PATIENCE) for _ in whole]
        self.assertEqual(len(whole.drops) + len(whole), captured)
        self.assertGreater(len(whole.drops), 0)
        self.assertEqual([(frame.sequence, frame.missed) for frame in followed],
                         [(frame.sequence, frame.missed) for frame in whole])
        self.assertEqual(sum(frame.missed + 1 for frame in frames), frames[-1].sequence + 1)
        by_sequence = {frame.sequence: frame for frame in whole}
        for frame in frames:  # each of them recorded, with the same bytes and time
            twin = by_sequence[frame.sequence]
            self.assertEqual((without_comment(frame.image), frame.time_ns, frame.session),
                             (twin.image, twin.time_ns, twin.session))
        self.assertTrue(live.empty() and recorded.empty())

    def record(self, name, **keys) -> Path:
        """A whole session's folder."""
        robot = self.start_robot(self.address, robot__id=name, **keys)
        self.assertEqual(robot.process.wait(PATIENCE), 0, robot.log.read_text())
        [session] = orbbuf.sessions(self.folder / "frames" / name)
        return session

    def test_python_exports_what_the_server_exports(self):
        layouts = (("tum-rgbd", orbbuf.to_tum), ("kitti", orbbuf.to_kitti), ("euroc", orbbuf.to_euroc))
        self.start_server()
        small = {"source__frames": 5, "source__realtime": "false", "source__width": 64, "source__height": 64}
        images = self.record("images", **small) / "images"
        right_images = self.record("right", **small, source__seed=2) / "images"
        for camera, text in (*CAMERAS.items(), ("none", "")):
            calibration = {"camera__calibration": '"' + text.replace("\n", "\\n") + '"'} if text else {}
            for right in ({}, {"source__path_right": right_images}):
                name = f"{camera}{len(right)}"
                session = self.record(name, source__kind="folder", source__path=images, source__realtime="false",
                                      **right, **calibration)
                for layout, export in layouts:
                    with self.subTest(layout=layout, camera=camera, stereo=bool(right)):
                        ours, other = self.folder / f"{layout}-{name}", self.folder / "other" / f"{layout}-{name}"
                        notes = export(orbbuf.Session(session), ours)
                        said = subprocess.run([SERVER, "export", "--layout", layout, session, other],
                                              capture_output=True, text=True)
                        self.assertEqual(said.returncode, 0, said.stderr)
                        self.assertEqual(tree(ours), tree(other))
                        for note in notes:
                            self.assertIn(note, said.stderr)

    def test_stereo_pairs_come_whole_through_the_pipe_and_the_folder(self):
        left, right = self.folder / "left", self.folder / "right"
        self.start_server()
        first = self.record("maker", source__frames=25, source__realtime="false", source__width=64, source__height=64)
        (first / "images").rename(left)
        right.mkdir()
        for number, image in enumerate(sorted(left.iterdir(), reverse=True)):
            shutil.copy(image, right / f"{number:06}.jpg")
        live = self.collect(lambda: orbbuf.Pipe(self.folder / "r.fifo"))
        robot = self.start_robot(self.address, source__kind="folder", source__path=left, source__path_right=right)
        pairs = [live.get(timeout=PATIENCE) for _ in range(25)]
        self.assertEqual(robot.process.wait(PATIENCE), 0, robot.log.read_text())
        [second] = [folder for folder in orbbuf.sessions(self.folder / "frames") if folder != first]
        self.assertEqual(len(orbbuf.Session(second)), 25)
        for number, (pair, frame) in enumerate(zip(pairs, orbbuf.Session(second))):
            self.assertEqual((without_comment(pair.image), without_comment(pair.image_right)), (frame.image, frame.image_right))
            self.assertEqual(frame.image, (left / f"{number:06}.jpg").read_bytes())
            self.assertEqual(frame.image_right, (right / f"{number:06}.jpg").read_bytes())


if __name__ == "__main__":
    unittest.main()
