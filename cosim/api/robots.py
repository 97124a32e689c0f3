"""Robots from their URDF."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import final

from attrs import evolve, frozen

from cosim.analysis.equal_arms import looked_at_poses, standing_at, with_arm
from cosim.analysis.survival import Survival, survival, survival_document
from cosim.api.card import card
from cosim.api.runs import loaded
from cosim.api.two_sided import TWO_SIDED, two_sided_files
from cosim.arm.reduction import ReducedArm
from cosim.arm.robot import Robot, read_robot, robot_document
from cosim.arm.serial import SerialModel
from cosim.arm.serial_table import arm_values
from cosim.errors import InputError, Problem, RunError
from cosim.fmu import open_system
from cosim.identification.excitation import Excitation
from cosim.identification.robot_excitation import robot_excitation
from cosim.results.provenance import command_line, versions
from cosim.results.saving import save_files, write_json
from cosim.scenario import Scenario


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
    """An arm: `model` has its numbers for `cosim.arm.serial_dynamics`, `doubts` what is missing or unphysical.

    survival: what two of it bear under a scenario, where that was asked (see `survives`).
    """

    found: Robot
    survival: Survival | None = None

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
        borne = {} if self.survival is None else {"survives": survival_document(self.survival)}
        return {**robot_document(self.found), **borne, "versions": versions()}

    def survives(
        self,
        scenario: Scenario | str | Path,
        *,
        values: Mapping[str, object] | None = None,
        poses: int | Sequence[Sequence[float]] = 5,
        any_delay: bool = False,
        say: Callable[[str], None] | None = None,
    ) -> RobotResult:
        """The result with the delays that two of these arms bear under a scenario, which supplies gains and delays.

        Both arms of the scenario become this one; of theirs only gravity compensation, an impedance inside the device
        and internal steps are kept. values: changes of the scenario after that, as `--set` makes them; poses: how many
        (the scenario's start or the arm's own, then random ones inside the limits), or the poses themselves (n,)
        [rad]; any_delay: also, at the pose that bears least, how far it is proven for every delay law, and a law that
        destroys (minutes); say: is told what is being done. Raises InputError where the scenario does not fit the arm,
        RunError where an FMU fails.
        """
        given = loaded(scenario)
        chosen = with_arm(given, self.model).with_values(values or {})
        if isinstance(poses, int) and poses < 1:
            raise InputError(Problem("poses", "1 or more", str(poses)))
        places = looked_at_poses(given, self.model, poses).tolist() if isinstance(poses, int) else poses
        posed = [standing_at(chosen, self.model, pose) for pose in places]
        with open_system(posed[0], say) as system:
            return evolve(self, survival=survival(posed, system, say or (lambda text: None), any_delay))

    def excitation(self, duration: float = 60.0, *, seed: int = 0, rounds: int = 100) -> Excitation:
        """A motion [rad] of so many seconds that identifies the arm, inside its limits: see `robot_excitation`.

        Its `motion(time)` gives q, dq, ddq. Raises InputError where the motors cannot make one.
        """
        return robot_excitation(self.model, duration, seed, rounds)

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
        """Write NAME.fmu, robot.json and report.html, and what there is of certificate.json, destroying.csv and
        destroying.toml (see `StabilityResult.save`); returns the path of the FMU.

        fmi: version of the FMU, 2 or 3; platforms: FMI 3 names of those of its binaries (default: this machine).
        """
        from cosim.report.html import write_report
        from cosim.report.robot import robot_report

        folder = Path(folder)
        built = self.fmu(fmi, platforms, progress).read_bytes()
        folder.mkdir(parents=True, exist_ok=True)
        name = f"{self.found.name}.fmu"
        content = {**self.to_dict(), "fmu": name, "fmi": fmi}
        files: dict[str, Callable[[Path], object]] = {
            name: lambda path: path.write_bytes(built),
            "robot.json": lambda path: write_json(content, path),
            "report.html": lambda path: write_report(robot_report(self.found, command_line(), self.survival), path),
        }
        files |= two_sided_files(self.survival and self.survival.any_delay)
        save_files(folder, files, TWO_SIDED)
        return folder / name

    def __str__(self) -> str:
        from cosim.report.robot import robot_sentences
        from cosim.report.robot_survival import survival_sentences

        borne = [] if self.survival is None else survival_sentences(self.survival)
        return "\n".join([*robot_sentences(self.found), *borne])

    def _repr_html_(self) -> str:
        model = self.model
        return card(str(self), {"joints": ", ".join(model.joints), "mass": f"{model.mass.sum():.4g} kg"})
