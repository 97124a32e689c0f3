"""Files of an SSP: its archive unpacked, or its folder; sources found inside it, outside only where that is allowed."""

import hashlib
from pathlib import Path
from urllib.parse import unquote, urlsplit

from attrs import frozen

from cosim.errors import InputError, Problem
from cosim.scenario.ssp_document import Element, Findings
from cosim.scenario.ssp_grammar import STRUCTURE

_MOST = 500_000_000  # bytes of one XML file


@frozen
class SspFiles:
    """Where the files of an SSP lie: `name` is that of the archive or folder, for messages."""

    name: str
    root: Path
    structure: Path
    cache: Path
    allow_outside: bool = False

    def label(self, path: Path) -> str:
        """The name of a file in messages: `loop.ssp: resources/k.ssv`."""
        inside = path.relative_to(self.root) if path.is_relative_to(self.root) else path
        return f"{self.name}: {inside.as_posix()}"

    def find(self, element: Element, source: str, findings: Findings) -> Path | None:
        """The file or folder that a source names; None, and a problem, where it is not there or may not be read."""
        path = self._addressed(source)
        if path is None:
            findings.refuse(element, "a file as source", repr(source[:200]), "put it into the archive")
            return None
        if not self._may_read(path):
            findings.refuse(
                element,
                f"a source inside {self.name}",
                repr(source),
                "--allow-outside, or load(..., allow_outside=True), lets it be read",
            )
            return None
        if not path.exists():
            findings.refuse(element, "a source that is there", f"no file {source!r}")
            return None
        return path

    def _addressed(self, source: str) -> Path | None:
        """The path that a URI names, links followed; None where it names something else than a file."""
        try:
            address = urlsplit(source)
            if address.scheme not in ("", "file") or address.netloc or address.query or address.fragment:
                return None
            path = (self.structure.parent / unquote(address.path)).resolve()
            return path if path.is_file() or path.is_dir() or not path.exists() else None
        except (OSError, ValueError):  # too long, or characters that no path has
            return None

    def _may_read(self, path: Path) -> bool:
        """Whether a file, links followed, lies inside, or outside is allowed."""
        return self.allow_outside or path.resolve().is_relative_to(self.root)

    def read(self, element: Element, source: str, findings: Findings) -> tuple[bytes, str] | None:
        """Contents and name of a text file that a source names; None, and a problem, where it cannot be read."""
        path = self.find(element, source, findings)
        if path is None:
            return None
        try:
            if path.stat().st_size > _MOST:
                raise OSError(f"more than {_MOST:.3g} bytes")
            return path.read_bytes(), self.label(path)
        except OSError as error:
            findings.refuse(element, "a source that can be read", f"{source!r}: {error.strerror or error}")
            return None

    def packed(self, path: Path) -> Path:
        """The FMU itself, or a folder's contents as an FMU in the cache."""
        if path.is_file():
            return path
        from build_fmus.archive import zip_bytes
        from build_fmus.cache import key_of, store

        files = sorted(p for p in path.rglob("*") if p.is_file() and self._may_read(p))
        contents = {p.relative_to(path).as_posix(): p.read_bytes() for p in files}
        target = self.cache / "packed" / key_of(*(part for item in contents.items() for part in item))[:24]
        target = target / f"{path.name}.fmu"
        if not target.is_file():
            store(target, zip_bytes(contents))
        return target


def open_ssp(path: Path, cache: Path, allow_outside: bool = False) -> SspFiles:
    """The files of an SSP: an archive (unpacked below `cache`), a folder, or an .ssd file in one. Raises InputError."""
    if path.is_dir():
        return _in_folder(path.name, path / STRUCTURE, cache, allow_outside)
    if path.suffix == ".ssd":
        return _in_folder(path.name, path, cache, allow_outside)
    root = _unpacked(path, cache / "archives")
    return SspFiles(path.name, root, _there(path, root / STRUCTURE), cache, allow_outside)


def _in_folder(name: str, structure: Path, cache: Path, allow_outside: bool) -> SspFiles:
    structure = structure.resolve()
    return SspFiles(name, structure.parent, _there(structure.parent, structure), cache, allow_outside)


def _there(where: Path, structure: Path) -> Path:
    if not structure.is_file():
        raise InputError(Problem(str(where), f"an SSP with a {structure.name}", "none in it"))
    return structure


def _unpacked(path: Path, folder: Path) -> Path:
    """The archive's contents in a folder named after their hash."""
    from build_fmus.unpacking import UnpackError, unpack

    try:
        target = folder.resolve() / hashlib.sha256(path.read_bytes()).hexdigest()[:24]
        if not target.is_dir():
            unpack(path, target)
        return target
    except UnpackError as error:
        raise InputError([Problem(str(path), "an SSP archive", text) for text in error.problems]) from None
    except OSError as error:
        raise InputError(Problem(str(path), "an SSP archive that can be unpacked", str(error))) from None
