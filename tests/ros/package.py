# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 package examples/orbbuf_ros: what its launch files start, by the programs' own --check-config, and its build
by ament, where Debian's ament-cmake is installed. There is no ros2 launch in Debian. Usage: package.py BUILD_FOLDER"""

import re
import shlex
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as xml
from pathlib import Path

BUILD = Path(sys.argv[1]).resolve()
SOURCE = Path(__file__).resolve().parents[2]
PACKAGE = SOURCE / "examples/orbbuf_ros"


def run(*command: object) -> str:
    done = subprocess.run([str(word) for word in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert done.returncode == 0, f"{command}: {done.stdout}"
    return done.stdout


def check_launch(path: Path) -> None:
    root = xml.parse(path).getroot()
    values = {"find-pkg-share orbbuf_ros": str(PACKAGE), "env HOME": "/home/user"}

    def filled(text: str) -> str:
        return re.sub(r"\$\(([^)]*)\)", lambda found: values[found[1]], text)

    for argument in root.iter("arg"):
        values[f"var {argument.attrib['name']}"] = filled(argument.attrib["default"])
    [started] = root.iter("executable")
    assert set(started.attrib) <= {"name", "output", "respawn", "respawn_delay", "cmd"}, path
    program, *options = (filled(word) for word in shlex.split(re.sub(r"\$\([^)]*\)", lambda one: shlex.quote(one[0]), started.attrib["cmd"])))
    where = {"orbbufd": BUILD / "daemon/orbbufd", "orbbuf-server": BUILD / "server/orbbuf-server"}[program]
    has_dds = [] if program == "orbbufd" or b"libddsc" in where.read_bytes() else ["--set", "dds.enabled=false"]
    run(where, "--check-config", *options, *has_dds)


for launch in sorted(PACKAGE.glob("launch/*.xml")):
    check_launch(launch)
    print(f"package: {launch.name} starts what is there")
version = re.search(r"project\(orbbuf VERSION ([0-9.]+)", (SOURCE / "CMakeLists.txt").read_text())[1]
assert xml.parse(PACKAGE / "package.xml").getroot().findtext("version") == version
if Path("/usr/share/ament_cmake").exists():
    with tempfile.TemporaryDirectory() as folder:
        run("cmake", "-S", PACKAGE, "-B", f"{folder}/build", f"-DCMAKE_INSTALL_PREFIX={folder}/install", "-DPython3_EXECUTABLE=/usr/bin/python3")
        run("cmake", "--install", f"{folder}/build")
        share = Path(folder, "install/share")
        assert (share / "ament_index/resource_index/packages/orbbuf_ros").exists()
        assert len(list(share.glob("orbbuf_ros/launch/*.xml"))) == len(list(share.glob("orbbuf_ros/config/*.toml"))) == 3
        print("package: built by ament")
