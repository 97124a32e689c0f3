"""Several FMUs at once, copied to where they were asked for."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from build_fmus.build import check_platforms, fmu_path
from build_fmus.cache import store
from build_fmus.homes import is_path
from build_fmus.python_class import exporter_of, version_of
from build_fmus.running import RUNNING
from build_fmus.sources import models


def built(
    wanted: Sequence[str],
    versions: Sequence[int],
    platforms: Sequence[str],
    out: Path | None,
    progress: Callable[[str], None] | None = None,
) -> list[Path]:
    """FMUs of models by name or path (all of ours where none is wanted), as out/fmi2/NAME.fmu and out/fmi3/NAME.fmu.

    out: None leaves them in the cache. A Python class has the FMI version of its package, whatever is asked for.
    Raises BuildError.
    """
    names, chosen = [located(name) for name in wanted] or models(), check_platforms(platforms)
    pairs = dict.fromkeys(
        (name, version_of(Path(name)) if name.endswith(".py") else version) for version in versions for name in names
    )

    def one(pair: tuple[str, int]) -> Path:
        name, version = pair
        file = fmu_path(name, version, chosen, progress)
        if out is None:
            return file
        target = out / f"fmi{version}" / file.name
        store(target, file.read_bytes())
        return target

    pool = ThreadPoolExecutor(min(4, os.cpu_count() or 1))
    try:
        return list(pool.map(one, pairs))
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        RUNNING.stop()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        RUNNING.resume()


def located(name: str) -> str:
    """`MyController` as a path, where none of our models is called so and a folder is; of a folder that holds a class
    for pythonfmu and no model.toml, the Python file.
    """
    path = Path(name)
    if not is_path(name):
        if name in models() or not path.is_dir():
            return name
        name = f"./{name}"
    if (path / "model.toml").is_file() or not path.is_dir():
        return name
    classes = [file for file in sorted(path.glob("*.py")) if exporter_of(file.read_text(encoding="utf-8"))]
    return f"{name.rstrip('/')}/{classes[0].name}" if len(classes) == 1 else name
