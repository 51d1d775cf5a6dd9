# SPDX-License-Identifier: Apache-2.0
"""What an upgrade finds on the disks and on the wire: the bytes of earlier releases, read by today's programs.

Usage: formats.py BUILD_FOLDER check          every RELEASE.tar.xz beside this file
       formats.py BUILD_FOLDER make RELEASE   makes one, of these programs; docs/release.md says when

A sample has: frames/ended, a session that ended; stream, the bytes that its robot sent; frames/cut and spool, what is
left when a robot with a spool and its server lose their power in an outage; counts.json, what orbbuf-server check of that
release found when both were started again; both configurations as installed.
"""

import contextlib
import json
import re
import shutil
import signal
import socket
import subprocess
import sys
import tarfile
import tempfile
import threading
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
BUILD = Path(sys.argv[1]).resolve()
PATIENCE = 60  # seconds; nothing waits for it to pass


class Program:
    """A program, and a way to wait for what it prints."""

    def __init__(self, name: str, **keys: object) -> None:
        options = [word for key, value in keys.items() for word in ("--set", f"{key.replace('__', '.')}={value}")]
        self.process = subprocess.Popen([BUILD / name, *options], stderr=subprocess.PIPE, text=True)
        self.output = ""

    def line(self, pattern: str) -> re.Match:
        assert self.process.stderr is not None
        patience = threading.Timer(PATIENCE, self.process.kill)
        patience.start()
        for line in self.process.stderr:
            self.output += line
            if found := re.search(pattern, line):
                patience.cancel()
                return found
        raise AssertionError(f"no {pattern} in:\n{self.output}")

    def end(self, by_kill: bool = False) -> None:
        self.process.kill() if by_kill else self.process.terminate()
        self.output += self.process.communicate(timeout=PATIENCE)[1]

    def __enter__(self) -> "Program":
        return self

    def __exit__(self, *_: object) -> None:
        self.end(by_kill=True)


def serve(frames: Path) -> tuple[Program, str]:
    server = Program("server/orbbuf-server", listen__address="127.0.0.1:0", files__path=frames, status__socket="")
    return server, server.line(r"listening on (\S+)")[1]


def robot(name: str, server: str, **keys: object) -> Program:
    small = {"source__width": 64, "source__height": 64, "jpeg__quality": 30, "link__drain_timeout": "30s"}
    return Program("daemon/orbbufd", **{"robot__id": name, "link__server": server, "buffer__drop_log": "", **small, **keys})


def counts(session: Path) -> dict:
    """How many frames and samples orbbuf-server check finds, by their words."""
    done = subprocess.run([BUILD / "server/orbbuf-server", "check", session], capture_output=True, text=True)
    found = re.findall(r"(\d+) (captured|live|late|on the robot|dropped|samples|lost)", done.stdout)
    assert len(found) == 7, done.stdout + done.stderr
    return {word: int(count) for count, word in found}


def only(folder: Path) -> Path:
    [path] = folder.iterdir()
    return path


def images(folder: Path) -> dict:
    return {path.name: path.read_bytes() for path in folder.glob("images/*.jpg")}


def relay(server: str, sent: list) -> str:
    """A port in front of the server, of one connection; keeps what the robot sends."""
    listener = socket.create_server(("127.0.0.1", 0))

    def carry(source: socket.socket, target: socket.socket, kept: list) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                kept.append(data)
                target.sendall(data)
            target.shutdown(socket.SHUT_WR)

    def run() -> None:
        near, _ = listener.accept()
        host, port = server.rsplit(":", 1)
        far = socket.create_connection((host, int(port)))
        threading.Thread(target=carry, args=(far, near, []), daemon=True).start()
        carry(near, far, sent)

    threading.Thread(target=run, daemon=True).start()
    return "127.0.0.1:%d" % listener.getsockname()[1]


def make(folder: Path) -> None:
    samples = folder / "imu.csv"
    begin = time.time_ns()
    samples.write_text("".join(f"{begin + 5_000_000 * i},{i / 100},0,-1e-3,0,0,9.81\n" for i in range(200)))
    sensor = {"stream__imu0__kind": "euroc", "stream__imu0__path": samples}
    server, address = serve(folder / "frames")
    sent: list = []
    with server:
        with robot("ended", relay(address, sent), source__frames=12, **sensor) as done:
            done.line("session ended")
            assert done.process.wait(PATIENCE) == 0, done.output
        (folder / "stream").write_bytes(b"".join(sent))
        with robot("cut", address, source__frames=1000000, buffer__policy="drop-oldest", buffer__capacity=3,
                   spool__path=folder / "spool", **sensor) as cut:
            cut.line("acknowledged [1-9]")
            server.process.send_signal(signal.SIGSTOP)  # an outage
            cut.line(r" dropped ([6-9]|\d\d)")
            cut.end(by_kill=True)
    samples.unlink()
    for name in ("orbbufd.toml", "orbbuf-server.toml"):
        shutil.copy(HERE.parents[1] / "config" / name, folder)
    with tempfile.TemporaryDirectory() as copy:
        shutil.copytree(folder, copy, dirs_exist_ok=True)
        found = {"ended": counts(only(folder / "frames/ended")), "cut": take_over(Path(copy))}
    (folder / "counts.json").write_text(json.dumps(found))
    assert found["ended"] == {**dict.fromkeys(found["ended"], 0), "captured": 12, "live": 12, "samples": found["ended"]["samples"]}, found
    assert found["cut"]["late"] > 0 and found["cut"]["samples"] > 0, found


def take_over(folder: Path) -> dict:
    """The session whose robot and server lost their power, when both have been started again."""
    session = only(folder / "frames/cut")
    server, address = serve(folder / "frames")
    with server, robot("cut", address, source__frames=1000000, spool__path=folder / "spool") as rest:
        rest.line("acknowledged [1-9]")
        patience = time.monotonic() + PATIENCE
        while counts(session)["on the robot"] > 0 and time.monotonic() < patience:  # its late frames
            time.sleep(0.1)
        rest.end()
        server.end()
    return counts(session)


def verify(folder: Path) -> None:
    for name, program in (("orbbufd.toml", "daemon/orbbufd"), ("orbbuf-server.toml", "server/orbbuf-server")):
        subprocess.run([BUILD / program, "--check-config", "--config", folder / name], check=True, stdout=subprocess.DEVNULL)
    expected = json.loads((folder / "counts.json").read_text())
    ended = only(folder / "frames/ended")
    assert counts(ended) == expected["ended"], counts(ended)

    server, address = serve(folder / "again")  # whose robot is of that release
    with server:
        host, port = address.rsplit(":", 1)
        with socket.create_connection((host, int(port)), PATIENCE) as link:
            link.sendall((folder / "stream").read_bytes())
            server.line("ended the session")
            server.end()
    again = only(folder / "again/ended")
    assert counts(again) == expected["ended"], counts(again)
    assert images(again) == images(ended)

    cut = take_over(folder)
    assert cut == expected["cut"], cut


with tempfile.TemporaryDirectory(prefix="orbbuf-formats.") as name:
    work = Path(name)
    if sys.argv[2] == "make":
        make(work)
        made = HERE / f"{sys.argv[3]}.tar.xz"
        with tarfile.open(made, "w:xz") as tar:
            for path in sorted(work.iterdir()):
                tar.add(path, path.name)
        print(f"{made}: {made.stat().st_size} bytes")
    else:
        for sample in sorted(HERE.glob("*.tar.xz")):
            with tarfile.open(sample) as tar:
                tar.extractall(work / sample.name)
            verify(work / sample.name)
            print(f"formats: {sample.name} is read")
