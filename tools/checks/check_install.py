"""Installs yawid as users do and replays a flight with it; tools/check.py --long runs this.

    python -m checks.check_install [built] [oldest] [platforms]

The steps, all of which run if none is named, are
built: the sdist and the wheel have the right files and no others, and the installed wheel replays a
flight outside of the clone, without git, compiler and display; sizes and the time to an answer are
printed. The newest numba and llvmlite that pyproject.toml allows compile the estimators, and the
cases of replay_logs/ and some tests pass with them.
oldest: so they do with the oldest libraries that it allows.
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
LEFT_OUT = (".*", "build", "dist", "*.egg-info", "__pycache__")
OF_SDIST = {"LICENSE", "PKG-INFO", "README.md", "pyproject.toml", "setup.cfg"}
TESTS = (
    "tests/test_replay_logs.py",
    "tests/estimation",
    "tests/sinks/mcap",
    "tests/cli/test_completion.py",
    "tests/report/test_report.py",
    "tests/serve",
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
        os.environ |= {
            "PATH": f"{folder}/uv/bin:{os.environ['PATH']}",
            "PYTHONPATH": "",
            "UV_CACHE_DIR": f"{folder}/cache",
        }
        shutil.copytree(ROOT, "clone", ignore=shutil.ignore_patterns(*LEFT_OUT))
        run([sys.executable, "-m", "pip", "install", "--quiet", "--target", "uv", "uv"])
        run(["uv", "build", "--quiet", "--out-dir", "dist", "clone"])
        for name in names or steps:
            print(f"{name}: {steps[name]()}", flush=True)


def built() -> str:
    """Compare the packed files with the tree, then install the wheel and replay a flight.

    Script and module report one version.
    """
    (wheel,), (sdist,) = (Path("dist").glob(f"*{suffix}") for suffix in (".whl", ".tar.gz"))
    shutil.unpack_archive(wheel, "wheel", "zip")
    shutil.unpack_archive(sdist, "sdist", filter="data")
    (whole,) = Path("sdist").iterdir()
    run(["diff", "-r", "clone/src/yawid", "wheel/yawid"])
    run(["diff", "-r", "clone/src/yawid", whole / "src/yawid"])
    names = {
        path.relative_to(whole).as_posix()
        for path in whole.rglob("*")
        if path.is_file() and "src" not in path.parts
    }
    # setuptools always packs the tests in the root of tests/, too.
    assert names == OF_SDIST | {f"tests/{path.name}" for path in ROOT.glob("tests/test*.py")}, names
    # By number: an older pair that matches would be installed without a word.
    bounds = re.findall(
        r'"(\w+)>=[\d.]+,<0\.(\d+)"', (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    )
    newest = [f"{name}==0.{int(bound) - 1}.*" for name, bound in bounds]
    run(["uv", "venv", "--quiet", "--python", sys.executable, "bare"])
    run(["uv", "pip", "install", "--quiet", "--python", "bare", "--no-build", *newest, wheel])
    run([
        "bare/bin/python", "-c", "from yawid.estimation.machine.runner import RUNNER; "
        "RUNNER.compile(); assert RUNNER.is_compiled()",
    ])  # fmt: skip
    bare = os.environ | {"PATH": "", "HOME": str(Path.cwd()), "DISPLAY": ""}
    version = said_by(["bare/bin/yawid", "--version"], env=bare)
    assert version == said_by(["bare/bin/python", "-m", "yawid", "--version"], env=bare)
    began_s = time.monotonic()
    said = json.loads(said_by(["bare/bin/yawid", "replay", LOG, "--json"], env=bare))
    took_s, roll = time.monotonic() - began_s, said["flight"]["dutch_roll"]
    viewer = [*Path("bare").glob("lib/*/*/rerun*"), *Path("bare").glob("lib/*/*/pyarrow*")]
    return (
        f"wheel {mb(wheel)}, sdist {mb(sdist)}, installed {mb('bare')}, {mb(*viewer)} of them "
        f"rerun and pyarrow; {version.strip()} answers a log of {mb(LOG)} in {took_s:.1f} s, "
        f"wn {roll['wn_rad_s']:.4f}, zeta {roll['zeta']:.4f}; "
        + tested(f"--python={sys.executable}", *(f"--with={each}" for each in newest))
    )


def mb(*paths: str | Path) -> str:
    """Return the size of files and folders in MB."""
    return f"{int(said_by(['du', '-cb', *paths]).split()[-2]) / 1e6:.2f} MB"


def oldest() -> str:
    """Run the tests with the oldest libraries allowed; those have wheels for the oldest Python."""
    compiled("--resolution=lowest-direct", f"--python-version={VERSIONS[0]}", "--extra=serve")
    return tested(f"--python={VERSIONS[0]}", "--with-requirements=locked.txt")


def platforms() -> str:
    """Check that there are wheels of all libraries for each of PLATFORMS and VERSIONS."""
    for platform, version in product(PLATFORMS, VERSIONS):
        compiled(
            f"--python-platform={platform}", f"--python-version={version}",
            "--extra=ulog", "--extra=serial", "--extra=fleet", "--extra=serve",
        )  # fmt: skip
    return f"wheels for {', '.join(PLATFORMS)}, each with Python {', '.join(VERSIONS)}"


def compiled(*options: str) -> None:
    """Write the version of each library that has a wheel into the clone's locked.txt."""
    run([
        "uv", "pip", "compile", "--quiet", "--no-build", "--upgrade", *options,
        "--output-file=clone/locked.txt", "clone/pyproject.toml",
    ], stdout=subprocess.DEVNULL)  # fmt: skip


def tested(*options: str) -> str:
    """Run the cases of replay_logs/ and some tests with the wheel, in an environment of uv's."""
    run([
        "uv", "run", "--quiet", "--isolated", "--no-project", "--no-build", *options,
        f"--with=yawid[serve] @ {next(Path('dist').glob('*.whl')).resolve().as_uri()}",
        "--with=pytest>=9", "--with=hypothesis>=6.100", "--with=jsonschema>=4.18",
        "--with=playwright>=1.50", "--with=httpx==0.27.*",
        "python", "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not slow and not long",
        "-o", "filterwarnings=",  # old libraries warn when they use newer ones
        *TESTS,
    ], cwd="clone")  # fmt: skip
    return f"tests pass with {', '.join(options)}"


if __name__ == "__main__":
    main(sys.argv[1:])
