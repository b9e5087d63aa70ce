"""Installs yawid as users do and replays a flight with it; tools/check.py --long runs this.

    python -m checks.check_install [built|oldest|newest|platforms]

The steps, all of which run if none is named, are
built: the sdist and the wheel have the right files and no others, and the installed wheel replays a
flight outside of the clone, without git, compiler and display.
oldest: the cases of replay_logs/ and some tests pass with the oldest libraries that pyproject.toml
allows.
newest: the newest numba and llvmlite that it allows compile the estimators, whose tests pass.
platforms: every library, those of the extras as well, has a wheel for aarch64, Windows and macOS.
They need the package registry and some minutes.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import zipfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SRC = ROOT / "src"
LOG = ROOT / "replay_logs" / "c172p_3211" / "log.tlog"
DATA = {"yawid/py.typed", *(f"yawid/report/{name}" for name in ("report.css", "page.html"))}
DATA |= {f"yawid/layouts/{name}" for name in ("plotjuggler.xml", "foxglove.json")}
DATA |= {f"yawid/manual/{path.name}" for path in (SRC / "yawid" / "manual").iterdir()}
OF_SDIST = {"LICENSE", "PKG-INFO", "README.md", "pyproject.toml", "setup.cfg"}
TESTS = (
    "tests/test_replay_logs.py",
    "tests/estimation",
    "tests/sinks/mcap",
    "tests/cli/test_completion.py",
    "tests/report/test_report.py",
)
COMPILED = ("numba", "llvmlite")
"""The libraries with an upper bound, whose versions must match each other."""
OF_COMPILED = ("tests/estimation",)
VERSIONS = ("3.11", "3.12", "3.13")
WHEELS_ONLY = "--only-binary=:all:"
PLATFORMS = {
    "aarch64": ("manylinux_2_28_aarch64", "manylinux_2_17_aarch64", "manylinux2014_aarch64"),
    "Windows": ("win_amd64",),
    "macOS 12": ("macosx_12_0_arm64",),
}
"""The platforms without a machine to try them on, by the names that pip has for them."""
EXTRAS = "ulog,serial,fleet"


def main() -> int:
    """Run the step that is named, or all; return 1 if one of them fails."""
    steps = {"built": built, "oldest": oldest, "newest": newest, "platforms": platforms}
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("step", choices=["all", *steps], nargs="?", default="all")
    step = parser.parse_args().step
    names = list(steps) if step == "all" else [step]
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        try:
            wheel = build(scratch)
            for name in names:
                print(f"{name}: {steps[name](wheel, scratch)}", flush=True)
        except (AssertionError, subprocess.CalledProcessError) as error:
            said = (getattr(error, "stdout", ""), getattr(error, "stderr", ""))
            print(error, *said, sep="\n", file=sys.stderr)
            return 1
    return 0


def build(scratch: Path) -> Path:
    """Build the sdist, and from it the wheel; return the wheel."""
    source, out = scratch / "clone", scratch / "dist"
    leave = shutil.ignore_patterns(
        ".git", "build", "*.egg-info", "__pycache__", ".*_cache", ".venv"
    )
    shutil.copytree(ROOT, source, ignore=leave)
    python = environment(scratch / "builder", sys.executable)
    run(python, "-m", "pip", "install", "--quiet", "build")
    run(python, "-m", "build", "--outdir", out, source)
    return next(out.glob("*.whl"))


def built(wheel: Path, scratch: Path) -> str:
    """Compare the packed files with the tree, then install the wheel and replay a flight."""
    package = {path.relative_to(SRC).as_posix() for path in (SRC / "yawid").rglob("*.py")} | DATA
    packed = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    assert packed == package, f"the wheel: {sorted(packed ^ package)}"
    with tarfile.open(next(wheel.parent.glob("*.tar.gz"))) as archive:
        files = {member.name.partition("/")[2] for member in archive if member.isfile()}
    files = {name for name in files if "src/yawid.egg-info/" not in name}
    # setuptools always packs the tests in the root of tests/, too.
    tests = {f"tests/{path.name}" for path in (ROOT / "tests").glob("test*.py")}
    wanted = {f"src/{name}" for name in package} | OF_SDIST | tests
    assert files == wanted, f"the sdist: {sorted(files ^ wanted)}"
    python = environment(scratch / "bare", sys.executable)
    install(python, wheel)
    return f"{len(packed)} files in the wheel; {answers(python, scratch)}"


def oldest(wheel: Path, scratch: Path) -> str:
    """Install the oldest libraries allowed; run the cases of replay_logs/ and some tests."""
    if f"3.{sys.version_info.minor}" != VERSIONS[0]:
        return "not tried: the oldest libraries have wheels for the oldest Python only"
    return tested(constrained(wheel, scratch / "oldest", oldest_allowed()), scratch, TESTS)


def newest(wheel: Path, scratch: Path) -> str:
    """Install the newest numba and llvmlite allowed; compile, and test the compiled code.

    The last minor version below each bound is required by its number: pip alone would silently
    install an older pair that matches.
    """
    python = constrained(wheel, scratch / "newest", newest_allowed())
    os.environ["XDG_CACHE_HOME"] = str(scratch / "cache")  # where no code is kept by others
    runner = "from yawid.estimation.machine.runner import RUNNER"
    run(python, "-c", f"{runner}; RUNNER.compile()")
    assert run(python, "-c", f"{runner}; print(RUNNER.is_compiled())").strip() == "True"
    return f"{', '.join(newest_allowed())}; {tested(python, scratch, OF_COMPILED)}"


def constrained(wheel: Path, folder: Path, versions: Sequence[str]) -> Path:
    """Install the wheel with libraries of these versions; return the environment's Python."""
    python = environment(folder, sys.executable)
    constraints = folder / "constraints.txt"
    constraints.write_text("\n".join(versions), encoding="utf-8")
    install(python, wheel, "--constraint", constraints)
    return python


def tested(python: Path, scratch: Path, tests: Sequence[str]) -> str:
    """Run tests of the clone with the libraries of an environment; return pytest's last line."""
    run(python, "-m", "pip", "install", "--quiet", "pytest", "hypothesis", "jsonschema")
    options = ["-q", "-p", "no:cacheprovider", "-m", "not slow and not long"]
    options += ["-o", "filterwarnings="]  # old libraries warn when they use newer ones
    return run(python, "-m", "pytest", *options, *tests, cwd=scratch / "clone").splitlines()[-1]


def required() -> list[str]:
    """Return the requirements of pyproject.toml."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return list(project["dependencies"])


def oldest_allowed() -> list[str]:
    """Return the requirements, each pinned to its lower bound."""
    return [re.sub(r">=([^,]+).*", r"==\1", each) for each in required()]


def newest_allowed() -> list[str]:
    """Return the requirements with an upper bound of 0.N, each pinned to version 0.(N - 1)."""
    found = []
    for each in required():
        if bound := re.fullmatch(r"([\w-]+).*<0\.(\d+)", each):
            found.append(f"{bound[1]}==0.{int(bound[2]) - 1}.*")
    assert [each.partition("=")[0] for each in found] == list(COMPILED), found
    return found


def platforms(wheel: Path, scratch: Path) -> str:
    """Check that pip finds wheels of all libraries for each of ``PLATFORMS`` and VERSIONS.

    pip judges the markers of requirements by the Python that runs it, not by the other platform.
    """
    report, found = scratch / "report.json", []
    target = ("--target", scratch / "nowhere", "--dry-run", "--report", report, "--quiet")
    for platform, names in PLATFORMS.items():
        given = [word for name in names for word in ("--platform", name)]
        for version in VERSIONS:
            options = (*given, "--python-version", version, WHEELS_ONLY, *target)
            run(sys.executable, "-m", "pip", "install", *options, f"{wheel}[{EXTRAS}]")
        wheels = json.loads(report.read_text(encoding="utf-8"))["install"]
        found.append(f"{platform}: {len(wheels)} wheels")
    return f"{'; '.join(found)}, for each of Python {', '.join(VERSIONS)}"


def environment(folder: Path, interpreter: str) -> Path:
    """Make a virtual environment; return its Python."""
    run(interpreter, "-m", "venv", folder)
    return folder / "bin" / "python"


def install(python: Path, wheel: Path, *options: object) -> None:
    """Install the wheel and its libraries from wheels only, in an environment without compiler."""
    run(python, "-m", "pip", "install", "--quiet", WHEELS_ONLY, *options, wheel, bare=True)


def answers(python: Path, scratch: Path) -> str:
    """Check that script and module report one version; return it with one flight's answer."""
    away, script = scratch / "away", python.parent / "yawid"
    away.mkdir(exist_ok=True)
    version = run(script, "--version", cwd=away, bare=True)
    as_module = run(python, "-m", "yawid", "--version", cwd=away, bare=True)
    assert version == as_module, f"{version!r}, but as a module {as_module!r}"
    said = run(script, "replay", LOG, "--json", "--force", cwd=away, bare=True)
    mode = json.loads(said)["flight"]["dutch_roll"]
    return f"{version.strip()} answers wn {mode['wn_rad_s']:.4f}, zeta {mode['zeta']:.4f}"


def run(*command: object, cwd: Path | None = None, bare: bool = False) -> str:
    """Run a command and return its stdout; ``bare``: with an empty PATH and without a display."""
    given = {name: text for name, text in os.environ.items() if name != "PYTHONPATH"}
    kept = {name: text for name, text in given.items() if re.match("PIP_|SSL_|LANG", name)}
    nowhere = {"PATH": "", "HOME": str(cwd or "/")}
    done = subprocess.run(
        [*map(str, command)],
        cwd=cwd,
        env=kept | nowhere if bare else given,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout


if __name__ == "__main__":
    sys.exit(main())
