"""Makes a folder that installs hri-predict on a machine without internet: `make bundle`.

The folder has the wheels of the project and of all that it needs, a requirements file with their
hashes, and a script that installs from them alone. It fits machines like the one that made it: the
same Python, processor and kind of system.
"""

import argparse
import hashlib
import shutil
import subprocess
import sys
from pathlib import Path

from packaging.utils import parse_wheel_filename

HERE = Path(__file__).resolve().parent


def download(wheel: str, extras: str, folder: Path, flags: list[str]) -> None:
    """Let pip collect the wheels that `wheel` needs, itself among them, into `folder`."""
    wanted = f"{wheel}[{extras}]" if extras else wheel
    constraints = ["-c", str(HERE.parent / "constraints.txt")]
    command = [sys.executable, "-m", "pip", "download", "--only-binary=:all:", *constraints]
    subprocess.run([*command, "-d", str(folder), *flags, wanted], check=True)


def complete(bundle: Path) -> int:
    """Write what belongs to the wheels in `bundle/wheels`; return how many there are."""
    wheels = sorted((bundle / "wheels").glob("*.whl"))
    (bundle / "requirements.txt").write_text(requirements(wheels), encoding="utf-8")
    (bundle / "python-version").write_text("{}.{}\n".format(*sys.version_info), encoding="utf-8")
    shutil.copy2(HERE / "install.sh", bundle / "install.sh")
    return len(wheels)


def requirements(wheels: list[Path]) -> str:
    """A line for each wheel: its exact version, and the hash that its file must have."""
    lines = []
    for path in wheels:
        name, version, _, _ = parse_wheel_filename(path.name)
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        lines.append(f"{name}=={version} --hash=sha256:{digest}\n")
    return "".join(lines)


def main() -> None:
    """Make the bundle; further options go to pip."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("dist", type=Path, help="folder with the project's wheel")
    parser.add_argument("bundle", type=Path, help="folder to make")
    parser.add_argument("--extras", default="", help="extras to bring, such as accel,fleet")
    options, flags = parser.parse_known_args()
    (wheel,) = options.dist.glob("hri_predict-*.whl")
    (options.bundle / "wheels").mkdir(parents=True)
    download(str(wheel), options.extras, options.bundle / "wheels", flags)
    print(f"{options.bundle}: {complete(options.bundle)} wheels")


if __name__ == "__main__":
    main()
