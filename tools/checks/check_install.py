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
import tarfile
import tempfile
import time
import zipfile
from itertools import product
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LOG = ROOT / "replay_logs" / "c172p_reversed" / "log.tlog"
LEFT_OUT = (".git", "build", "dist", "*.egg-info", "__pycache__", ".*_cache", ".venv")
OF_SDIST = {"LICENSE", "PKG-INFO", "README.md", "pyproject.toml", "setup.cfg"}
OF_VIEWER = ("rerun", "pyarrow")
"""The libraries without which yawid replays, too, by how their names begin."""
OF_COMPILED = ("tests/estimation",)
TESTS = (
    "tests/test_replay_logs.py",
    *OF_COMPILED,
    "tests/sinks/mcap",
    "tests/cli/test_completion.py",
    "tests/report/test_report.py",
)
VERSIONS = ("3.11", "3.12", "3.13")
WHEELS_ONLY = "--only-binary=:all:"
PLATFORMS = ("aarch64-manylinux_2_28", "x86_64-pc-windows-msvc", "aarch64-apple-darwin")
"""The platforms without a machine to try them on, by the names that uv has for them."""
EXTRAS = ("--extra=ulog", "--extra=serial", "--extra=fleet")


def main(names: list[str]) -> None:
    """Run the steps that are named, or all."""
    steps = {"built": built, "oldest": oldest, "platforms": platforms}
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        shutil.copytree(ROOT, scratch / "clone", ignore=shutil.ignore_patterns(*LEFT_OUT))
        run(sys.executable, "-m", "venv", scratch / "uv")
        run(scratch / "uv/bin/python", "-m", "pip", "install", "--quiet", "uv")
        uv(scratch, "build", "--out-dir", scratch / "dist", scratch / "clone")
        for name in names or steps:
            print(f"{name}: {steps[name](scratch)}", flush=True)


def built(scratch: Path) -> str:
    """Compare the packed files with the tree, then install the wheel and replay a flight."""
    (wheel,), (sdist,) = (scratch.glob(f"dist/*{suffix}") for suffix in (".whl", ".tar.gz"))
    files = [path for path in scratch.glob("clone/src/yawid/**/*") if path.is_file()]
    tree = {path.relative_to(scratch / "clone").as_posix() for path in files}
    packed = {f"src/{x}" for x in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in x}
    assert packed == tree, f"the wheel: {sorted(packed ^ tree)}"
    with tarfile.open(sdist) as archive:
        names = {member.name.partition("/")[2] for member in archive if member.isfile()}
    # setuptools always packs the tests in the root of tests/, too.
    wanted = tree | OF_SDIST | {f"tests/{path.name}" for path in ROOT.glob("tests/test*.py")}
    other = {name for name in names ^ wanted if "src/yawid.egg-info/" not in name}
    assert not other, f"the sdist: {sorted(other)}"
    began_s, pair = time.monotonic(), newest_allowed()
    python = installed(scratch, "bare", *pair)
    took_s = time.monotonic() - began_s
    sizes = f"wheel {wheel.stat().st_size / 1e3:.0f} kB, sdist {sdist.stat().st_size / 1e3:.0f} kB"
    said = f"{sizes}; {installed_size(scratch / 'bare')} in {took_s:.0f} s; {answers(scratch)}"
    runner = "from yawid.estimation.machine.runner import RUNNER"
    run(python, "-c", f"{runner}; RUNNER.compile(); assert RUNNER.is_compiled()")
    return f"{said}; {', '.join(pair)}: {tested(scratch, python, OF_COMPILED)}"


def installed_size(environment: Path) -> str:
    """Return the size of an environment, and the part of the libraries for the viewer alone."""
    (site,) = environment.glob("lib/*/site-packages")
    sizes = {path.relative_to(site): path.lstat().st_size / 1e6 for path in site.rglob("*")}
    of_viewer = sum(mb for path, mb in sizes.items() if path.parts[0].startswith(OF_VIEWER))
    return f"{sum(sizes.values()):.0f} MB, {of_viewer:.0f} of them {' and '.join(OF_VIEWER)},"


def answers(scratch: Path) -> str:
    """Check that script and module report one version; return it with one flight's answer."""
    script, module = [scratch / "bare/bin/yawid"], [scratch / "bare/bin/python", "-m", "yawid"]
    first, other = (run(*each, "--version", cwd=scratch, bare=True) for each in (script, module))
    assert first == other, f"{first!r}, but as a module {other!r}"
    began_s = time.monotonic()
    said = json.loads(run(*script, "replay", LOG, "--json", cwd=scratch, bare=True))
    took_s, roll = time.monotonic() - began_s, said["flight"]["dutch_roll"]
    answer = f"wn {roll['wn_rad_s']:.4f}, zeta {roll['zeta']:.4f}"
    size = f"{LOG.stat().st_size / 1e3:.0f} kB"
    return f"{first.strip()} answers a log of {size} in {took_s:.1f} s, {answer}"


def oldest(scratch: Path) -> str:
    """Install the oldest libraries allowed; run the cases of replay_logs/ and some tests."""
    if f"3.{sys.version_info.minor}" != VERSIONS[0]:
        return "not tried: the oldest libraries have wheels for the oldest Python only"
    return tested(scratch, installed(scratch, "oldest", "--resolution=lowest-direct"), TESTS)


def newest_allowed() -> list[str]:
    """Return the requirements with an upper bound of 0.N, each as version 0.(N - 1).

    They are required by number: an older pair that matches would be installed without a word.
    """
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    bounds = re.findall(r'^    "(\w+)>=[\d.]+,<0\.(\d+)"', project, re.MULTILINE)
    return [f"{name}==0.{int(bound) - 1}.*" for name, bound in bounds]


def platforms(scratch: Path) -> str:
    """Check that there are wheels of all libraries for each of PLATFORMS and VERSIONS."""
    asked = ("pip", "compile", WHEELS_ONLY, *EXTRAS, ROOT / "pyproject.toml")
    found = {}
    for platform, version in product(PLATFORMS, VERSIONS):
        where = f"--python-platform={platform}", f"--python-version={version}"
        found[platform] = uv(scratch, *asked, *where).count("==")
    wheels = ", ".join(f"{platform}: {count} wheels" for platform, count in found.items())
    return f"{wheels}, for each of Python {', '.join(VERSIONS)}"


def installed(scratch: Path, name: str, *options: str) -> Path:
    """Install the wheel, and libraries from wheels only, by themselves; return their Python."""
    uv(scratch, "venv", "--python", sys.executable, scratch / name)
    python, (wheel,) = scratch / name / "bin" / "python", scratch.glob("dist/*.whl")
    uv(scratch, "pip", "install", "--python", python, WHEELS_ONLY, *options, wheel)
    return python


def tested(scratch: Path, python: Path, tests: tuple[str, ...]) -> str:
    """Run tests of the clone with the libraries of an environment; return pytest's last line."""
    uv(scratch, "pip", "install", "--python", python, "pytest", "hypothesis", "jsonschema")
    options = ["-q", "-p", "no:cacheprovider", "-m", "not slow and not long"]
    options += ["-o", "filterwarnings="]  # old libraries warn when they use newer ones
    return run(python, "-m", "pytest", *options, *tests, cwd=scratch / "clone").splitlines()[-1]


def uv(scratch: Path, *arguments: object) -> str:
    """Run uv, which keeps what it downloads in the scratch folder; return its stdout."""
    return run(scratch / "uv/bin/uv", "--quiet", "--cache-dir", scratch / "cache", *arguments)


def run(*command: object, cwd: Path | None = None, bare: bool = False) -> str:
    """Run a command and return its stdout; ``bare``: with an empty PATH and without a display.

    Raises:
        SystemExit: it failed.
    """
    given = os.environ | ({"PATH": "", "HOME": str(cwd), "DISPLAY": ""} if bare else {})
    given.pop("PYTHONPATH", None)
    done = subprocess.run(
        [*map(str, command)], cwd=cwd, env=given, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"{command} ended with {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


if __name__ == "__main__":
    main(sys.argv[1:])
