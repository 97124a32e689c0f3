"""Models linked with the compiled master loop into one WebAssembly module that imports nothing."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from build_fmus.build import BuildJob
from build_fmus.cache import cache_folder, key_of, store
from build_fmus.compiler import WASM, Compiler, call, find_compiler
from build_fmus.errors import BuildError
from build_fmus.homes import is_path, source_root
from build_fmus.scratch import workspace
from build_fmus.sources import home_of, model_table

EXPORTS = ("-mexec-model=reactor", "-Wl,--export-memory", "-Wl,-z,stack-size=262144", "-Wl,--strip-all")


def wasm_module(models: Mapping[str, Mapping[str, bytes]], scenario: str) -> bytes:
    """The module of fmu_src/live/live.c with models in it, from the cache or compiled now.

    models: {prefix of the names of its FMI functions: sources of a model for FMI 3, see `source_files`}; scenario: text
    of the header scenario.h, what is wired and scheduled. Raises BuildError.
    """
    compiler, folder = find_compiler(), cache_folder()
    if not compiler.cross:
        raise BuildError("CC compiles for this machine only, not to WebAssembly; unset CC to compile with zig")
    objects = [_model_object(prefix, files, compiler, folder) for prefix, files in models.items()]
    root = source_root()
    sources = [path for name in ("live", "executor", "shared") for path in sorted((root / name).glob("*.[ch]"))]
    parts = [path.read_bytes() for path in sources]
    key = key_of(compiler.identity, *WASM, *EXPORTS, scenario, *parts, *(path.parent.name for path in objects))[:24]
    module = folder / "wasm" / key / "live.wasm"
    if not module.is_file():
        with workspace() as work:
            (work / "scenario.h").write_text(scenario)
            fresh = work / module.name
            named = map(str, objects)
            arguments = (*WASM, *EXPORTS, f"-I{work}", "live/live.c", *named, "-o", str(fresh))
            call(compiler, arguments, root, folder, "live.c")
            store(module, fresh.read_bytes())
    return module.read_bytes()


def model_job(model: str) -> BuildJob:
    """How a model is built for a module: one of ours by its name, one of the user's own by the path of its folder."""
    return BuildJob(model_table(model), 3, (), own=home_of(model) if is_path(model) else None)


def _model_object(prefix: str, sources: Mapping[str, bytes], compiler: Compiler, folder: Path) -> Path:
    """The compiled FMI 3 functions of a model, their names with a prefix."""
    flags: Sequence[str] = (*WASM, f"-DFMI3_FUNCTION_PREFIX={prefix}", "-I.", "-c", "fmi3.c")
    key = key_of(compiler.identity, *flags, *(x for name in sorted(sources) for x in (name, sources[name])))[:24]
    kept = folder / "wasm" / key / "model.o"
    if not kept.is_file():
        with workspace() as work:
            for name, data in sources.items():
                store(work / name, data)
            call(compiler, (*flags, "-o", str(work / kept.name)), work, folder, "fmi3.c")
            store(kept, (work / kept.name).read_bytes())
    return kept
