"""The C compiler: `CC` when it is set, else zig from PyPI, which compiles for every platform on any machine."""

import hashlib
import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from attrs import frozen

from build_fmus.errors import BuildError, SourceError
from build_fmus.running import RUNNING

STRICT = (
    "-std=c99",
    "-O2",
    "-ffp-contract=off",
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Werror",
    "-fvisibility=hidden",
    "-g0",
)
FLAGS = (*STRICT, "-shared", "-fPIC")
WASM = ("-target", "wasm32-wasi", "-fno-sanitize=undefined", *STRICT)
"""Flags for WebAssembly: the same rules of arithmetic."""


_MOST_TEXT = 4000  # signs of a compiler's messages, which begin with the first error


@frozen
class Platform:
    """A platform by its FMI 3 name: FMI 2 name (None: FMI 2 has none), file suffix, zig target."""

    name: str
    fmi2: str | None
    suffix: str
    target: str

    def folder(self, fmi: int) -> str | None:
        return self.fmi2 if fmi == 2 else self.name


PLATFORMS = {
    p.name: p
    for p in (
        Platform("x86_64-linux", "linux64", ".so", "x86_64-linux-gnu.2.17"),
        Platform("aarch64-linux", None, ".so", "aarch64-linux-gnu.2.17"),
        Platform("x86_64-windows", "win64", ".dll", "x86_64-windows-gnu"),
        Platform("x86_64-darwin", "darwin64", ".dylib", "x86_64-macos"),
        Platform("aarch64-darwin", None, ".dylib", "aarch64-macos"),
    )
}


def this_platform() -> str:
    """FMI 3 name of the machine that runs this. Raises BuildError for one that is not in PLATFORMS."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    system = {"win32": "windows", "cygwin": "windows"}.get(sys.platform, sys.platform)
    name = f"{machine}-{system}"
    if name not in PLATFORMS:
        raise BuildError(f"no FMU binaries for this machine ({name}); known are {', '.join(PLATFORMS)}")
    return name


@frozen
class Compiler:
    """A command, what it is (for the cache key), and whether it takes zig's -target."""

    command: tuple[str, ...]
    identity: str
    cross: bool

    def flags(self, chosen: Platform) -> tuple[str, ...]:
        extra = ("-target", chosen.target, "-fno-sanitize=undefined", "-s") if self.cross else ()
        return (*extra, *FLAGS)


def find_compiler() -> Compiler:
    """`CC` when set, else zig. Raises BuildError where neither is there."""
    if os.environ.get("CC"):
        return _from_environment(os.environ["CC"])
    spec = importlib.util.find_spec("ziglang")
    if spec is None or not spec.origin:
        raise BuildError(
            "no C compiler: the Python package ziglang is missing (pip install ziglang), and CC is not set"
        )
    zig = Path(spec.origin).with_name("zig.exe" if sys.platform == "win32" else "zig")
    if not zig.is_file():
        raise BuildError(f"no C compiler: {zig} is missing; pip install --force-reinstall ziglang, or set CC")
    size = zig.stat().st_size
    version = next(Path(spec.origin).parent.parent.glob("ziglang-*.dist-info"), Path("ziglang")).name
    return Compiler((str(zig), "cc"), f"{version} {size}", cross=True)


def _from_environment(value: str) -> Compiler:
    command = tuple(shlex.split(value))
    if not shutil.which(command[0]):
        raise BuildError(f"CC is {value!r}, which is no program here; unset CC to compile with zig")
    version = subprocess.run([*command, "--version"], capture_output=True, text=True, check=False).stdout
    cross = "zig" in Path(command[0]).name or "ziglang" in value
    return Compiler(command, f"{value} {hashlib.sha256(version.encode()).hexdigest()}", cross=cross)


def _environment(cache: Path) -> dict[str, str]:
    """Zig keeps what it makes of libc and of sources in our cache, unless the user has named another place."""
    folders = {"ZIG_GLOBAL_CACHE_DIR": str(cache / "zig"), "ZIG_LOCAL_CACHE_DIR": str(cache / "zig-local")}
    return folders | dict(os.environ)


def compile_library(
    compiler: Compiler,
    chosen: Platform,
    sources: Path,
    main: str,
    library: Path,
    cache: Path,
    extra: Sequence[str] = (),
) -> None:
    """Compile the file `main` of the folder `sources` into a shared library. Raises SourceError with the messages."""
    if not compiler.cross and chosen.name != this_platform():
        raise BuildError(f"CC compiles for this machine only, not for {chosen.name}; unset CC to compile with zig")
    call(
        compiler, (*compiler.flags(chosen), *extra, "-I.", main, "-o", str(library)), sources, cache, main, chosen.name
    )


def call(
    compiler: Compiler, arguments: Sequence[str], sources: Path, cache: Path, main: str = "", place: str = "wasm32"
) -> None:
    """Run the compiler in the folder `sources`. Raises SourceError with its messages about the file `main`."""
    command = [*compiler.command, *arguments]
    try:
        done = RUNNING.run(command, sources, _environment(cache))
    except OSError as error:
        raise BuildError(f"the compiler {compiler.command[0]} does not start: {error}") from error
    if done.returncode and ("NoSpaceLeft" in done.stderr or "No space left" in done.stderr):
        raise BuildError(f"no space left to compile, in {cache} or {sources}; free space, or set COSIM_CACHE or TMPDIR")
    if done.returncode:
        text = done.stderr.strip()[:_MOST_TEXT] or f"exit status {done.returncode}"
        raise SourceError(f"{main} does not compile for {place}:\n{text}\n({shlex.join(command)} in {sources})")
