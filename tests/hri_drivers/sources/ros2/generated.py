"""Builds packages of ROS 2 messages that the package index lacks, from their .msg text.

ROS's own generators, which the wheels bring, write C and Python; the compiler makes the module that
rclpy loads. So publishers and the node use real types, of Fast DDS alone; that of Jazzy also wants
descriptions of them (introspection).
"""

import fcntl
import hashlib
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Mapping
from pathlib import Path

from hri_predict.protocol.ros.tracked import IDS_LIST_TEXT
from hri_predict.protocol.ros.zed import TEXTS

ROOT = Path(__file__).parents[4]
TF2 = {"TFMessage": "geometry_msgs/TransformStamped[] transforms"}
HRI = {"IdsList": IDS_LIST_TEXT}
ZED = {n.rpartition("/")[2]: text for n, text in TEXTS.items() if not n.endswith("Before")}
PACKAGES: dict[str, Mapping[str, str]] = {"tf2_msgs": TF2, "hri_msgs": HRI, "zed_msgs": ZED}
USED = ("std_msgs", "geometry_msgs", "builtin_interfaces")
CHOSEN = ("typesupport_fastrtps_c", "typesupport_introspection_c")
"""ROS opens a library of this name for each package."""
KINDS = ("generator_c", "generator_py", "typesupport_c", *CHOSEN)
RUNTIME = (
    "rosidl_runtime_c", "rosidl_typesupport_fastrtps_c", "rosidl_typesupport_fastrtps_cpp",
    "rosidl_typesupport_introspection_c", "rosidl_typesupport_c", "rmw", "rcutils", "fastcdr",
)  # fmt: skip


def missing() -> str:
    """Why packages cannot be built here; "" if they can."""
    if shutil.which("g++") is None:
        return "needs g++"
    if not (Path(sysconfig.get_path("include")) / "Python.h").is_file():
        return "needs Python's headers"
    if not (Path(sys.prefix) / "include" / "rosidl_runtime_c").is_dir():
        return "needs the headers of the wheels of ROS 2"
    return ""


def build() -> Path:
    """Build all packages, unless that was done before; the folder belongs on the path of Python."""
    made_by = (PACKAGES, Path(__file__).read_text("utf-8"), sys.prefix, sys.version)
    key = hashlib.sha256(repr(made_by).encode()).hexdigest()[:16]
    done = ROOT / "build" / "ros2-messages" / key
    done.parent.mkdir(parents=True, exist_ok=True)
    with (done.parent / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # tests that run side by side build once
        if not done.is_dir():
            folder = Path(tempfile.mkdtemp(dir=done.parent))
            for package in PACKAGES:
                subprocess.run(
                    [sys.executable, "-m", __name__, package, str(folder)],
                    env=_environment(),
                    check=True,
                    capture_output=True,
                )
            folder.rename(done)
    return done


def _environment() -> dict[str, str]:
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return os.environ | {"AMENT_PREFIX_PATH": sys.prefix, "PYTHONPATH": os.pathsep.join(paths)}


def _generate(package: str, folder: Path) -> None:
    """Write the sources; the generators are called as their commands do."""
    from rosidl_adapter.msg import convert_msg_to_idl
    from rosidl_generator_c.cli import GenerateC
    from rosidl_generator_py.cli import GeneratePython
    from rosidl_typesupport_c.cli import GenerateCTypesupport
    from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
    from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

    source, idl = folder / "source" / package, folder / "idl" / package
    (source / "msg").mkdir(parents=True)
    files = []
    for name, text in PACKAGES[package].items():
        (source / "msg" / f"{name}.msg").write_text(text)
        convert_msg_to_idl(source, package, Path("msg") / f"{name}.msg", idl / "msg")
        files.append(f"{idl}:msg/{name}.idl")
    include, out = [str(Path(sys.prefix) / "share")], folder / package
    out.mkdir()
    only = {"typesupport_implementations": [f"rosidl_{kind}" for kind in CHOSEN]}
    own = {"typesupport_implementations": ["rosidl_typesupport_c"]}
    for generator in (
        GenerateC("c"),
        GenerateFastRTPSCTypesupport("fastrtps_c"),
        GenerateIntrospectionCTypesupport("introspection_c"),
        GenerateCTypesupport("c", **only),
        GeneratePython("py", **own),
    ):
        generator.generate(package, files, include, out)


def _compile(package: str, folder: Path) -> None:
    import numpy as np

    prefix, out = Path(sys.prefix), folder / package
    includes = [folder, prefix / "include", *(prefix / "include").iterdir(),
                sysconfig.get_path("include"), np.get_include()]  # fmt: skip
    libraries = [f"{used}__rosidl_{kind}" for used in USED for kind in KINDS]
    sources = [*out.rglob("*.c"), *out.rglob("*.cpp")]
    objects = []
    for source in sources:
        compiler = "gcc" if source.suffix == ".c" else "g++"
        objects.append(str(source.with_suffix(f"{source.suffix}.o")))
        flags = [f"-I{path}" for path in includes]
        command = [compiler, "-c", "-fPIC", "-O0", "-w", *flags, str(source), "-o", objects[-1]]
        subprocess.run(command, check=True)
    target = out / f"{package}_s__rosidl_typesupport_c.so"
    links = [f"-l{name}" for name in (*libraries, *RUNTIME)]
    subprocess.run(
        ["g++", "-shared", "-o", str(target), *objects, f"-L{prefix / 'lib'}", *links], check=True
    )
    for kind in CHOSEN:  # empty, but for the name by which ROS opens the one above
        name = f"lib{package}__rosidl_{kind}.so"
        options = [f"-Wl,-soname,{name}", "-Wl,--no-as-needed", f"-Wl,-rpath,$ORIGIN/{package}"]
        command = ["g++", "-shared", "-o", str(folder / name), *options, f"-L{out}"]
        subprocess.run([*command, f"-l:{target.name}"], check=True)


if __name__ == "__main__":
    _generate(sys.argv[1], Path(sys.argv[2]).absolute())
    _compile(sys.argv[1], Path(sys.argv[2]).absolute())
