"""Shared libraries of fmu_src that are no FMUs (compiled master loop, batch kernel), compiled once per content."""

from collections.abc import Sequence
from pathlib import Path

from build_fmus.cache import cache_folder, key_of, store, workspace
from build_fmus.compiler import PLATFORMS, compile_library, find_compiler, this_platform
from build_fmus.sources import source_root


def library_path(name: str, flags: Sequence[str] = ()) -> Path:
    """The library of fmu_src/NAME/NAME.c for this machine, from the cache or compiled now.

    flags: further compiler flags, part of the cache key. Raises BuildError.
    """
    compiler, folder, chosen = find_compiler(), cache_folder(), PLATFORMS[this_platform()]
    root = source_root()
    sources = sorted(p for sub in root.iterdir() if sub.is_dir() for p in sub.glob("*.[ch]"))
    parts = [x for path in sources for x in (str(path.relative_to(root)), path.read_bytes())]
    key = key_of(compiler.identity, *compiler.flags(chosen), *flags, name, *parts)[:24]
    library = folder / "libraries" / key / f"{name}{chosen.suffix}"
    if not library.is_file():
        with workspace() as work:
            fresh = work / library.name
            compile_library(compiler, chosen, root, f"{name}/{name}.c", fresh, folder, ("-Ishared", *flags))
            store(library, fresh.read_bytes())
    return library
