"""Robots from their URDF."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import final

from attrs import frozen

from cosim.api.card import card
from cosim.arm.reduction import ReducedArm
from cosim.arm.robot import Robot, read_robot, robot_document
from cosim.arm.serial import SerialModel
from cosim.arm.serial_table import arm_values
from cosim.errors import InputError, Problem, RunError
from cosim.results.provenance import command_line, versions
from cosim.results.saving import save_files, write_json


def robot(urdf: str | Path, *, base: str | None = None, tip: str | None = None) -> RobotResult:
    """The arm of a URDF as equations and as an FMU.

    base, tip: links (default: the root, and where the chains with most moving joints end or part). Joints off the
    chain are locked. Raises InputError with every problem: of the file, of the chain, of an arm that no inertia makes
    whole.
    """
    return RobotResult(read_robot(urdf, base, tip))


@final
@frozen(eq=False)
class RobotResult:
    """An arm: `model` has its numbers for `cosim.arm.serial_dynamics`, `doubts` what is missing or unphysical."""

    found: Robot

    @property
    def arm(self) -> ReducedArm:
        """Model, chain, locked joints."""
        return self.found.arm

    @property
    def model(self) -> SerialModel:
        """The table of its joints."""
        return self.found.arm.model

    @property
    def doubts(self) -> tuple[str, ...]:
        """What is missing or what no body can have, in words."""
        return self.found.arm.doubts

    def to_dict(self) -> dict[str, object]:
        """The content of robot.json."""
        return {**robot_document(self.found), "versions": versions()}

    def fmu(
        self,
        fmi: int = 3,
        platforms: Iterable[str] | None = None,
        progress: Callable[[str], None] | None = None,
    ) -> Path:
        """A SerialArm FMU that holds the arm, in the cache. Raises InputError, or RunError where it cannot be built."""
        from build_fmus import BuildError, arm_fmu
        from build_fmus.errors import BadRequestError

        chosen = None if platforms is None else list(platforms)
        try:
            return arm_fmu(self.model.count, arm_values(self.model), fmi, chosen, progress)
        except BadRequestError as error:
            raise InputError(Problem("--fmi, --platform", "what can be built", str(error))) from None
        except BuildError as error:
            raise RunError("SerialArm", None, str(error)) from None

    def save(
        self,
        folder: str | Path,
        *,
        fmi: int = 3,
        platforms: Iterable[str] | None = None,
        progress: Callable[[str], None] | None = None,
    ) -> Path:
        """Write NAME.fmu, robot.json and report.html; returns the path of the FMU.

        fmi: version of the FMU, 2 or 3; platforms: FMI 3 names of those of its binaries (default: this machine).
        """
        from cosim.report.html import write_report
        from cosim.report.robot import robot_report

        folder = Path(folder)
        built = self.fmu(fmi, platforms, progress).read_bytes()
        folder.mkdir(parents=True, exist_ok=True)
        name = f"{self.found.name}.fmu"
        content = {**self.to_dict(), "fmu": name, "fmi": fmi}
        files = {
            name: lambda path: path.write_bytes(built),
            "robot.json": lambda path: write_json(content, path),
            "report.html": lambda path: write_report(robot_report(self.found, command_line()), path),
        }
        save_files(folder, files)
        return folder / name

    def __str__(self) -> str:
        from cosim.report.robot import robot_sentences

        return "\n".join(robot_sentences(self.found))

    def _repr_html_(self) -> str:
        model = self.model
        return card(str(self), {"joints": ", ".join(model.joints), "mass": f"{model.mass.sum():.4g} kg"})
