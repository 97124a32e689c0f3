"""One FMU: table, sources, libraries, descriptions, zip, checks, cache."""

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from attrs import field, frozen

from build_fmus.archive import zip_bytes
from build_fmus.cache import builder_code, cache_folder, key_of, one_at_a_time, store
from build_fmus.compiler import PLATFORMS, Compiler, compile_library, find_compiler, this_platform
from build_fmus.description import describe
from build_fmus.documentation import index_html
from build_fmus.errors import BadRequestError, BuildError, SourceError
from build_fmus.header import header
from build_fmus.homes import is_path, source_root
from build_fmus.python_class import python_fmu
from build_fmus.scratch import workspace
from build_fmus.sources import GENERATED, home_of, licence, model_files, model_table, readme_of
from build_fmus.table import ModelTable, StartValue, override, suggestion
from build_fmus.terminals import build_description, icon_png, icon_svg, terminals

Progress = Callable[[str], None]


@frozen
class BuildJob:
    """What to build: a table (with its start values), FMI version, platforms; `extra` stands in for files of the
    model; `own`: the folder of a model that is none of ours.
    """

    table: ModelTable
    fmi: int
    platforms: tuple[str, ...]
    extra: dict[str, bytes] = field(factory=dict)
    level: int = 6
    own: Path | None = None

    @property
    def model(self) -> str:
        return self.table.model.name

    @property
    def home(self) -> Path:
        return self.own or source_root() / self.model

    @property
    def readme(self) -> str:
        if "README.md" in self.extra:
            return self.extra["README.md"].decode()
        if self.own and not (self.own / "README.md").is_file():
            return f"# {self.model}\n\n{self.table.model.description}\n"
        return readme_of(self.home)

    @property
    def code(self) -> dict[str, bytes]:
        return {name: data for name, data in self.extra.items() if name != "README.md"}


def fmu_path(
    model: str,
    fmi: int = 3,
    platforms: Sequence[str] | None = None,
    progress: Progress | None = None,
    start: Mapping[str, StartValue] | None = None,
) -> Path:
    """The FMU of a model, from the cache or built now; `start`: other start values, compiled in and in the XML.

    model: the name of one of ours, or the path of a folder with a model.toml or of a Python file with a class for
    pythonfmu, which is built again whenever one of its files has changed. Raises BadRequestError for an unknown model,
    platform or variable and for a mistake in a model that is none of ours, BuildError where it cannot be built.
    """
    if model.endswith(".py"):
        return python_fmu(Path(model), progress)
    own = home_of(model) if is_path(model) else None
    try:
        table = model_table(model)
        if own is None and table.model.name != model:
            raise BuildError(f"{model}/model.toml names the model {table.model.name!r}")
        table = override(table, start) if start else table
        return build(BuildJob(table, fmi, check_platforms(platforms), own=own), progress)
    except SourceError as error:
        if own is None:
            raise
        raise BadRequestError(pointed(problem, own) for problem in error.problems) from error


def pointed(text: str, folder: Path) -> str:
    """A compiler's message with the user's own files by their full names, so that an editor finds line and column."""
    mine = {path.name: str(path) for path in folder.iterdir()}
    first, *lines = text.splitlines()
    if " does not compile for " not in first:
        return text
    told = [line for line in lines if not line.startswith(("In file included", "("))]
    found = _PLACE.sub(lambda m: f"{mine.get(m['name'], m['name'])}:{m['line']}", "\n".join(told))
    return f"{folder.name} does not compile:\n{found}"


_PLACE = re.compile(r"(?<![\w./\\-])(?:\./)?(?P<name>[\w.-]+\.[ch]):(?P<line>\d+)(?=[:,])")
"""`law.h:12:` of a compiler's message."""


def check_platforms(platforms: Sequence[str] | None) -> tuple[str, ...]:
    """The platforms in a fixed order; this machine where none is named."""
    chosen = tuple(platforms) if platforms else (this_platform(),)
    unknown = [p for p in chosen if p not in PLATFORMS]
    if unknown:
        raise BadRequestError(
            f"no platform {p!r}{suggestion(p, PLATFORMS)}; there are {', '.join(PLATFORMS)}" for p in unknown
        )
    return tuple(p for p in PLATFORMS if p in chosen)


def build(job: BuildJob, progress: Progress | None = None) -> Path:
    """The FMU of a job, from the cache or built now."""
    if job.fmi not in (2, 3):
        raise BadRequestError(f"FMI version is 2 or 3, not {job.fmi}")
    compiler, folder = find_compiler(), cache_folder()
    sources = source_files(job)
    path = folder / "fmus" / _key(job, sources, compiler) / f"{job.model}.fmu"
    with one_at_a_time(path):
        if not path.is_file():
            if progress:
                progress(f"building {job.model}.fmu (FMI {job.fmi}, {', '.join(job.platforms)}){_patience(job)}")
            files = _packed(job, sources) | _libraries(job, sources, compiler, folder)
            keep(path, zip_bytes(files, job.level))
    return path


def _patience(job: BuildJob) -> str:
    """Zig makes its C library for Windows once: 75 s of processor time (others 4 s)."""
    return "; the first one for Windows takes minutes" if "x86_64-windows" in job.platforms else ""


def keep(path: Path, data: bytes) -> None:
    """Into the cache, if it is a valid FMU."""
    from build_fmus.validation import problems_of

    with workspace() as folder:
        candidate = folder / path.name
        store(candidate, data)
        problems = problems_of(candidate)
    if problems:
        raise BuildError(f"{path.name} is not valid: {problem}" for problem in problems)
    store(path, data)


def source_files(job: BuildJob) -> dict[str, bytes]:
    """Every file of the sources folder, the generated table included. Its first line is the instantiation token: a hash
    of the sources and of the table with its start values.
    """
    files = model_files(job.home, job.fmi, job.code)
    table = header(job.table, files["model.c"])
    token = key_of(table, *(x for n in sorted(files) for x in (n, files[n])))[:36]
    return files | {GENERATED: f'#define MODEL_TOKEN "{{{token}}}"\n{table}'.encode()}


def token_of(sources: Mapping[str, bytes]) -> str:
    """Instantiation token of the FMU of these source files."""
    return sources[GENERATED].split(b'"', 2)[1].decode()


def _key(job: BuildJob, sources: dict[str, bytes], compiler: Compiler) -> str:
    flags = [" ".join(compiler.flags(PLATFORMS[p])) for p in job.platforms]
    readme = job.readme
    parts = [x for name in sorted(sources) for x in (name, sources[name])]
    return key_of(
        str(job.fmi),
        str(job.level),
        compiler.identity,
        *flags,
        builder_code(),
        readme,
        licence(),
        repr(job.table),
        *parts,
    )[:24]


def _libraries(job: BuildJob, sources: dict[str, bytes], compiler: Compiler, folder: Path) -> dict[str, bytes]:
    """{path in the FMU: bytes} of the shared libraries; a platform that FMI 2 cannot name has its sources only."""
    with workspace() as work:
        for name, data in sources.items():
            store(work / name, data)
        return dict(
            _library(job, name, work, compiler, folder) for name in job.platforms if PLATFORMS[name].folder(job.fmi)
        )


def _library(job: BuildJob, name: str, work: Path, compiler: Compiler, folder: Path) -> tuple[str, bytes]:
    chosen = PLATFORMS[name]
    library = work / name / f"{job.model}{chosen.suffix}"
    library.parent.mkdir()
    compile_library(compiler, chosen, work, f"fmi{job.fmi}.c", library, folder)
    return f"binaries/{chosen.folder(job.fmi)}/{library.name}", library.read_bytes()


def _packed(job: BuildJob, sources: dict[str, bytes]) -> dict[str, bytes]:
    """Everything in the FMU but the libraries."""
    token = token_of(sources)
    files = {
        "modelDescription.xml": describe(job.table, job.fmi, token).encode(),
        "documentation/index.html": index_html(job.table, job.readme).encode(),
        "documentation/licenses/license.txt": licence(),
    }
    files |= {f"sources/{name}": data for name, data in sources.items()}
    return files | (_beside2() if job.fmi == 2 else _beside3(job))


def _beside2() -> dict[str, bytes]:
    """FMI 2 has an icon only."""
    return {"model.png": icon_png()}


def _beside3(job: BuildJob) -> dict[str, bytes]:
    return {
        "sources/buildDescription.xml": build_description(job.model).encode(),
        "terminalsAndIcons/terminalsAndIcons.xml": terminals(job.table).encode(),
        "terminalsAndIcons/icon.svg": icon_svg(job.table).encode(),
        "terminalsAndIcons/icon.png": icon_png(),
    }
