"""Installs yawid as users do and replays a flight with it; tools/check.py --long runs this.

    python -m checks.check_install [built] [oldest] [platforms]

The steps, all of which run if none is named, are
built: the sdist and the wheel have the right files and no others, and the installed wheel replays a
flight outside of the clone, without git, compiler and display; sizes and times are printed. The
newest numba and llvmlite that pyproject.toml allows compile the estimators, whose tests pass.
oldest: the cases of replay_logs/ and some tests pass with the oldest libraries that it allows.
platforms: every library, those of the extras as well, has a wheel for aarch64, Windows and macOS.
They need the package registry and some minutes; uv, which pip installs, builds and installs all.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from contextlib import chdir
from functools import partial
from itertools import product
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LOG = ROOT / "replay_logs" / "c172p_reversed" / "log.tlog"
OF_SDIST = {"LICENSE", "PKG-INFO", "README.md", "pyproject.toml", "setup.cfg"}
TESTS = (
    "tests/test_replay_logs.py",
    "tests/estimation",
    "tests/sinks/mcap",
    "tests/cli/test_completion.py",
    "tests/report/test_report.py",
)
VERSIONS = ("3.11", "3.12", "3.13")
PLATFORMS = ("aarch64-manylinux_2_28", "x86_64-pc-windows-msvc", "aarch64-apple-darwin")
"""The platforms without a machine to try them on, by the names that uv has for them."""
run = partial(subprocess.run, check=True)
said_by = partial(subprocess.check_output, text=True)


def main(names: list[str]) -> None:
    """Run the steps that are named, or all, in a folder of their own."""
    steps = {"built": built, "oldest": oldest, "platforms": platforms}
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        path = os.pathsep.join([f"{folder}/uv/bin", os.environ["PATH"]])
        os.environ |= {"PATH": path, "PYTHONPATH": "", "UV_CACHE_DIR": f"{folder}/cache"}
        left_out = shutil.ignore_patterns(".*", "build", "dist", "*.egg-info", "__pycache__")
        shutil.copytree(ROOT, "clone", ignore=left_out)
        run([sys.executable, "-m", "pip", "install", "--quiet", "--target", "uv", "uv"])
        run(["uv", "build", "--quiet", "--out-dir", "dist", "clone"])
        for name in names or steps:
            print(f"{name}: {steps[name]()}", flush=True)


def built() -> str:
    """Compare the packed files with the tree, then install the wheel and replay a flight."""
    (wheel,), (sdist,) = (Path("dist").glob(f"*{suffix}") for suffix in (".whl", ".tar.gz"))
    shutil.unpack_archive(wheel, "wheel", "zip")
    shutil.unpack_archive(sdist, "sdist", filter="data")
    (whole,) = Path("sdist").iterdir()
    run(["diff", "-r", "clone/src/yawid", "wheel/yawid"])
    run(["diff", "-r", "clone/src/yawid", whole / "src/yawid"])
    files = {path.relative_to(whole) for path in whole.rglob("*") if path.is_file()}
    names = {path.as_posix() for path in files if path.parts[0] != "src"}
    # setuptools always packs the tests in the root of tests/, too.
    assert names == OF_SDIST | {f"tests/{path.name}" for path in ROOT.glob("tests/test*.py")}, names
    # By number: an older pair that matches would be installed without a word.
    bounds = re.findall(
        r'^    "(\w+)>=[\d.]+,<0\.(\d+)"',
        (ROOT / "pyproject.toml").read_text("utf-8"),
        re.MULTILINE,
    )
    newest = [f"{name}==0.{int(bound) - 1}.*" for name, bound in bounds]
    began_s = time.monotonic()
    run(["uv", "venv", "--quiet", "--python", sys.executable, "bare"])
    run(["uv", "pip", "install", "--quiet", "--python", "bare", "--no-build", *newest, wheel])
    took_s = time.monotonic() - began_s
    runner = "from yawid.estimation.machine.runner import RUNNER"
    run(["bare/bin/python", "-c", f"{runner}; RUNNER.compile(); assert RUNNER.is_compiled()"])
    tested(*(f"--with={each}" for each in newest))
    viewer = mb(
        *(path for each in ("rerun*", "pyarrow*") for path in Path("bare").glob(f"lib/*/*/{each}"))
    )
    sizes = f"wheel {mb(wheel)}, sdist {mb(sdist)}, installed {mb('bare')} in {took_s:.0f} s"
    return f"{sizes}, {viewer} of them for rerun and pyarrow; {answers()}; {', '.join(newest)}"


def mb(*paths: str | Path) -> str:
    """Return the size of files and folders in MB."""
    return f"{int(said_by(['du', '-cb', *paths]).split()[-2]) / 1e6:.2f} MB"


def answers() -> str:
    """Check that script and module report one version; return it with one flight's answer."""
    bare = os.environ | {"PATH": "", "HOME": str(Path.cwd()), "DISPLAY": ""}
    version = said_by(["bare/bin/yawid", "--version"], env=bare)
    assert version == said_by(["bare/bin/python", "-m", "yawid", "--version"], env=bare)
    began_s = time.monotonic()
    said = json.loads(said_by(["bare/bin/yawid", "replay", LOG, "--json"], env=bare))
    took_s, roll = time.monotonic() - began_s, said["flight"]["dutch_roll"]
    answer = f"wn {roll['wn_rad_s']:.4f}, zeta {roll['zeta']:.4f}"
    return f"{version.strip()} answers a log of {mb(LOG)} in {took_s:.1f} s, {answer}"


def oldest() -> str:
    """Run the cases of replay_logs/ and some tests with the oldest libraries allowed."""
    if f"3.{sys.version_info.minor}" != VERSIONS[0]:
        return "not tried: the oldest libraries have wheels for the oldest Python only"
    tested("--resolution=lowest-direct")
    return "the tests pass"


def platforms() -> str:
    """Check that there are wheels of all libraries for each of PLATFORMS and VERSIONS."""
    asked = ["uv", "pip", "compile", "--no-build", "clone/pyproject.toml", "--output-file=locked"]
    asked += ["--extra=ulog", "--extra=serial", "--extra=fleet", "--quiet"]
    for platform, version in product(PLATFORMS, VERSIONS):
        run([*asked, f"--python-platform={platform}", f"--python-version={version}"])
    return f"wheels for {', '.join(PLATFORMS)}, each with Python {', '.join(VERSIONS)}"


def tested(*options: str) -> None:
    """Run TESTS of the clone with the wheel, in an environment of their own."""
    packages = (
        next(Path("dist").glob("*.whl")).resolve(),
        "pytest>=9",
        "hypothesis>=6.100",
        "jsonschema>=4.18",
    )
    own = ["--isolated", "--no-project", "--no-build", f"--python={sys.executable}", *options]
    # Old libraries warn when they use newer ones.
    words = ["-q", "-p", "no:cacheprovider", "-m", "not slow and not long", "-o", "filterwarnings="]
    given = [f"--with={each}" for each in packages]
    run(
        ["uv", "run", "--quiet", *own, *given, "python", "-m", "pytest", *words, *TESTS],
        cwd="clone",
    )


if __name__ == "__main__":
    main(sys.argv[1:])
