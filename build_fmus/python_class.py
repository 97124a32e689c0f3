"""An FMU of a Python class, made by pythonfmu (FMI 2.0) or pythonfmu3 (FMI 3.0): whichever the user's file imports."""

import os
import re
import sys
from collections.abc import Callable
from pathlib import Path

from build_fmus.cache import cache_folder, key_of, one_at_a_time, store
from build_fmus.errors import BadRequestError
from build_fmus.running import RUNNING
from build_fmus.scratch import workspace

_IMPORT = re.compile(r"^\s*(?:from|import)\s+(pythonfmu3?)\b", re.MULTILINE)
_CLASS = re.compile(r"^class\s+(\w+)\s*\(.*Fmi[23]Slave", re.MULTILINE)


def exporter_of(text: str) -> str | None:
    """The package that a file's class is written for; None where it imports neither."""
    found = _IMPORT.search(text)
    return found[1] if found else None


def version_of(path: Path) -> int:
    """The FMI version of the FMU of a Python file; that of pythonfmu where the file says nothing."""
    text = path.read_text(encoding="utf-8") if path.is_file() else ""
    return 3 if exporter_of(text) == "pythonfmu3" else 2


def python_fmu(path: Path, progress: Callable[[str], None] | None = None) -> Path:
    """The FMU of the class in a Python file, from the cache or made now; made again when the file has changed.

    Raises BadRequestError where there is no such file or class, or it cannot be loaded.
    """
    if not path.is_file():
        raise BadRequestError(f"{path}: no such file; `cosim new controller NAME --language python` writes one")
    text = path.read_text(encoding="utf-8")
    exporter, found = exporter_of(text), _CLASS.search(text)
    if exporter is None or found is None:
        expected = "a class derived from Fmi2Slave of pythonfmu, or from Fmi3Slave of pythonfmu3"
        raise BadRequestError(f"{path}: expected {expected}, got none")
    from importlib.metadata import PackageNotFoundError, version

    try:
        key = key_of(exporter, version(exporter), sys.version, str(path.resolve()), text)[:24]
    except PackageNotFoundError:
        raise BadRequestError(f"{path} needs {exporter}: pip install 'haptic-cosim[python]'") from None
    target = cache_folder() / "fmus" / key / f"{found[1]}.fmu"
    with one_at_a_time(target):
        if not target.is_file():
            if progress:
                progress(f"building {target.name} ({exporter})")
            store(target, _made(exporter, path.resolve(), found[1]))
    return target


def _made(exporter: str, path: Path, name: str) -> bytes:
    """The FMU that the exporter writes of the class. Raises BadRequestError with Python's words where it does not."""
    with workspace() as work:
        command = [sys.executable, "-m", exporter, "build", "-f", str(path), "-d", str(work)]
        done = RUNNING.run(command, path.parent, {**os.environ, "PYTHONWARNINGS": "ignore"})
        made = list(work.glob("*.fmu"))
        if done.returncode or not made:
            raise BadRequestError(f"{path}: {exporter} makes no FMU of it: {_why(path, name) or _last(done.stderr)}")
        return made[0].read_bytes()


def _why(path: Path, name: str) -> str:
    """What Python says when the class is made by itself, with its line: the exporters keep that to themselves."""
    code = f"import runpy; runpy.run_path({str(path)!r})[{name!r}](instance_name='try', resources='.')"
    done = RUNNING.run([sys.executable, "-W", "ignore", "-c", code], path.parent, os.environ)
    places = re.findall(rf'File "{re.escape(str(path))}", line (\d+)', done.stderr)
    where = f"\n{path}:{places[-1]}: " if places else ""
    return f"{where}{_last(done.stderr)}" if done.returncode else ""


def _last(text: str) -> str:
    return text.strip().rpartition("\n")[2] or "it says nothing"
