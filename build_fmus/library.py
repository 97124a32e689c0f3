"""Shared libraries of fmu_src that are no FMUs (compiled master loop, batch kernel), compiled once per content."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from build_fmus.cache import builder_code, cache_folder, key_of, store
from build_fmus.compiler import PLATFORMS, compile_library, find_compiler, this_platform
from build_fmus.homes import source_root
from build_fmus.scratch import workspace
from build_fmus.unchanged import unchanged_file

_STRUCT = '_model.h"'
_DECIDE = (".c", ".h", ".toml")
"""Endings of the files that decide what is compiled: sources, and the tables that structs are written from."""


def library_path(name: str, flags: Sequence[str] = ()) -> Path:
    """The library of fmu_src/NAME/NAME.c for this machine, from the cache or compiled now.

    flags: further compiler flags, part of the cache key. Raises BuildError.
    """
    return unchanged_file(" ".join((name, *flags)), lambda: _compiled(name, flags))


def _compiled(name: str, flags: Sequence[str]) -> Path:
    """The library, from the cache by the content of the sources, or compiled."""
    compiler, folder, chosen = find_compiler(), cache_folder(), PLATFORMS[this_platform()]
    if not compiler.cross:  # zig alone writes levels of x86-64 with underscores
        flags = [flag.replace("-march=x86_64_v", "-march=x86-64-v") for flag in flags]
    root = source_root()
    files = sorted(p for sub in root.iterdir() if sub.is_dir() for p in sub.iterdir() if p.suffix in _DECIDE)
    sources = _digest(root, tuple((p, p.stat().st_mtime_ns) for p in files))
    key = key_of(compiler.identity, *compiler.flags(chosen), *flags, name, sources, builder_code())[:24]
    library = folder / "libraries" / key / f"{name}{chosen.suffix}"
    if not library.is_file():
        with workspace() as work:
            fresh = work / library.name
            for header, text in structs(name).items():
                (work / header).write_text(text)
            compile_library(
                compiler, chosen, root, f"{name}/{name}.c", fresh, folder, ("-Ishared", f"-I{work}", *flags)
            )
            store(library, fresh.read_bytes())
    return library


@lru_cache(maxsize=4)
def _digest(root: Path, files: tuple[tuple[Path, int], ...]) -> str:
    """A hash of names and contents of files, which are as they were at these times [ns]."""
    return key_of(*(x for path, _ in files for x in (str(path.relative_to(root)), path.read_bytes())))


def structs(name: str) -> dict[str, str]:
    """{file name: text} of the generated headers that the sources in fmu_src/NAME include: structs of models whose laws
    they run.
    """
    from build_fmus.header import batch_header
    from build_fmus.sources import model_table

    code = [
        line for path in sorted((source_root() / name).glob("*.[ch]")) for line in path.read_text("utf-8").splitlines()
    ]
    included = [line.split('"')[1] for line in code if line.startswith('#include "') and line.endswith(_STRUCT)]
    return {header: batch_header(model_table(header.removesuffix("_model.h"))) for header in included}


def vectors() -> tuple[int, tuple[str, ...]]:
    """How many lanes (REAL_LANES of fmu_src/shared/real.h) suit this machine best, and the compiler flags for them.

    The bits of a lane do not depend on either. Two registers of AVX2: one is computed while the other waits.
    """
    from numpy._core._multiarray_umath import __cpu_features__ as has

    lanes, level = 4, ()
    if this_platform().startswith("x86_64") and has.get("AVX2") and has.get("FMA3"):
        wide = has.get("AVX512F") and has.get("AVX512_SKX")
        lanes, level = 8, ("-march=x86_64_v4" if wide else "-march=x86_64_v3", "-mtune=native")
    return lanes, (f"-DREAL_LANES={lanes}", "-Wno-psabi", *level)  # vectors are passed within one library alone
