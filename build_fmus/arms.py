"""A model with room for many joints, cut to the joints of one arm: `tau[1..7]` instead of `tau[1..12]`.

The source is the same; the compiler sees arrays of the arm's own length, and so do importers, who then need not know
which entries of a vector are unused. A table can be cut where it has a parameter `joints`: its greatest value is the
room.
"""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from attrs import evolve

from build_fmus.build import BuildJob, Progress, build, check_platforms, fmu_path
from build_fmus.errors import BadRequestError
from build_fmus.sources import is_model, model_table
from build_fmus.table import ModelTable, ModelVariable, Private, StartValue, override


def arm_fmu(
    joints: int,
    start: Mapping[str, float | list[float]],
    fmi: int = 3,
    platforms: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> Path:
    """The FMU of an arm with so many joints and these start values, from the cache or built now. Raises BuildError."""
    table = cut(model_table("SerialArm"), joints)
    return build(BuildJob(override(table, dict(start)), fmi, check_platforms(platforms)), progress)


def fitted_fmu(
    model: str,
    joints: int | None,
    fmi: int = 3,
    platforms: Sequence[str] | None = None,
    progress: Progress | None = None,
    start: Mapping[str, StartValue] | None = None,
) -> Path:
    """As `fmu_path`; a model with a table of joints is cut to so many (None, or more than it has room for: not cut)."""
    if joints is None or not can_be_cut(model, joints):
        return fmu_path(model, fmi, platforms, progress, start)
    table = cut(model_table(model), joints)
    return build(BuildJob(override(table, start) if start else table, fmi, check_platforms(platforms)), progress)


def can_be_cut(model: str, joints: int) -> bool:
    """Whether a model of ours has a table of joints with room for so many."""
    if not is_model(model):
        return False
    table = model_table(model)
    return _has_joints(table) and 1 <= joints <= _room(table)


def cut(table: ModelTable, joints: int) -> ModelTable:
    """The table for so many joints: rows as long as the room, or a multiple of it, become that much shorter."""
    room = _room(table)
    if not 1 <= joints <= room:
        raise BadRequestError(f"{table.model.name} has room for 1 .. {room} joints, not for {joints}")
    rows = [_cut_row(v, room, joints) for v in table.variable]
    return evolve(table, variable=rows, private=[_cut_memory(p, room, joints) for p in table.private])


def cut_like(table: ModelTable, names: Collection[str]) -> ModelTable:
    """The table cut as in an FMU whose variables have these names; as it is where it has no joints to cut."""
    if not _has_joints(table):
        return table
    return cut(table, sum(name.startswith("q_start[") for name in names) or _room(table))


def _has_joints(table: ModelTable) -> bool:
    return any(v.name == "joints" for v in table.variable)


def _room(table: ModelTable) -> int:
    return int(table.row("joints").max or 0)


def _shorter(size: int | None, room: int, joints: int) -> int | None:
    return size // room * joints if size is not None and size % room == 0 else size


def _cut_row(v: ModelVariable, room: int, joints: int) -> ModelVariable:
    """Counts and numbers of joints end at the joints that are there."""
    if v.name == "joints":
        return evolve(v, start=float(joints), min=float(joints), max=float(joints))
    most = float(joints) if v.type == "Integer" and v.max == room else v.max
    return evolve(v, size=_shorter(v.size, room, joints), max=most)


def _cut_memory(p: Private, room: int, joints: int) -> Private:
    return evolve(p, size=_shorter(p.size, room, joints)) if isinstance(p.size, int) else p
