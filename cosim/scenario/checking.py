"""What can be wrong with a scenario before any FMU is looked at."""

import math
from pathlib import Path

from attrs import evolve

from cosim.errors import InputError, Problem, did_you_mean
from cosim.opening import file_problem
from cosim.scenario.parts import NANOSECONDS, OF_RECORDING, Component, ScenarioParts

LONGEST = 2**63  # nanoseconds that fit an integer of 64 bits


def check(scenario: ScenarioParts, where: str) -> list[Problem]:
    """What a scenario says that cannot be, before its FMUs are known."""
    problems = _check_experiment(scenario, where)
    for name, component in scenario.components.items():
        place = f"{where}: components.{name}"
        given = [key for key in ("model", "fmu", "recording") if getattr(component, key) is not None]
        if len(given) != 1:
            problems.append(Problem(place, "one of model, fmu, recording", " and ".join(given) or "none"))
        if component.step_multiple < 1:
            problems.append(Problem(f"{place}.step_multiple", "1 or more", str(component.step_multiple)))
        if component.recording is not None and not component.columns:
            problems.append(Problem(f"{place}.columns", "names of columns to play", "nothing"))
        problems += _check_file(component, scenario.folder, place) + _check_set(component, place)
        problems += _check_recording_keys(component, place)
    return problems


def _check_recording_keys(component: Component, where: str) -> list[Problem]:
    """Keys of a recording given to a component that plays none."""
    usual = component if component.recording is not None else Component()
    foreign = [key for key in OF_RECORDING if getattr(component, key) != getattr(usual, key)]
    expected, advice = "a component that plays a recording", "a parameter of an FMU stands among its `parameters`"
    return [Problem(f"{where}.{key}", expected, repr(getattr(component, key)), advice) for key in foreign]


def _check_experiment(scenario: ScenarioParts, where: str) -> list[Problem]:
    e, where, problems = scenario.experiment, f"{where}: experiment", []
    positive = {"step": e.step, "stop": e.stop, "record_every": e.record_every, "bound": e.bound}
    wrong = [key for key, value in positive.items() if not (math.isfinite(value) and value > 0)]
    problems += [Problem(f"{where}.{key}", "a positive number", str(positive[key])) for key in wrong]
    if "stop" not in wrong and e.stop * NANOSECONDS > LONGEST:
        problems.append(Problem(f"{where}.stop", f"at most {LONGEST / NANOSECONDS:.2g} s", f"{e.stop:g} s"))
        return problems
    if "step" not in wrong and (e.step_ns < 1 or abs(e.step * NANOSECONDS - e.step_ns) > 1e-9 * e.step_ns):
        problems.append(Problem(f"{where}.step", "a whole number of nanoseconds", f"{e.step} s"))
    elif not wrong and abs(e.stop * NANOSECONDS - e.steps * e.step_ns) > 0.5:
        near = max(e.steps, 1) * e.step_ns / NANOSECONDS
        problems.append(
            Problem(f"{where}.stop", f"a whole number of steps of {e.step} s", f"{e.stop} s", f"{near:.12g} s is one")
        )
    if e.record_every >= 2**31:
        problems.append(Problem(f"{where}.record_every", "less than 2147483648 steps", str(e.record_every)))
    if not 0 <= e.seed < 2**31:
        problems.append(Problem(f"{where}.seed", "0 to 2147483647, which an FMU's integer holds", str(e.seed)))
    if e.tolerance is not None and not (math.isfinite(e.tolerance) and e.tolerance > 0):
        problems.append(Problem(f"{where}.tolerance", "a positive number", str(e.tolerance)))
    if e.fmi not in (2, 3):
        problems.append(Problem(f"{where}.fmi", "2 or 3", str(e.fmi)))
    for name in e.order:
        if name not in scenario.components:
            problems.append(
                Problem(f"{where}.order", "a component", repr(name), did_you_mean(name, scenario.components))
            )
    if e.order and (missing := set(scenario.components) - set(e.order)):
        problems.append(Problem(f"{where}.order", "every component", f"no {', '.join(sorted(missing))}"))
    return problems


def _check_file(component: Component, folder: Path, where: str) -> list[Problem]:
    if component.own:
        return _check_model(component.model_path(folder), f"{where}.model")
    name = component.fmu or component.recording
    if name is None or (component.recording and (folder / name).is_dir()):  # a ROS 2 bag is a folder
        return []
    problem = file_problem(folder / name, "a file", f"{where}.{'fmu' if component.fmu else 'recording'}")
    return [problem] if problem else []


def _check_model(path: Path, where: str) -> list[Problem]:
    """The problem of a model of the user's own that is not there."""
    if path.suffix == ".py":
        return [] if path.is_file() else [Problem(where, "a Python file", f"nothing at {path}")]
    if (path / "model.toml").is_file():
        return []
    advice = "`cosim new controller NAME` writes such a folder"
    return [Problem(where, "a folder with a model.toml", f"none at {path}", advice)]


def _check_set(component: Component, where: str) -> list[Problem]:
    if component.parameter_set is None:
        return []
    from cosim.arm.parameters import Mounting, parameter_set

    try:
        if component.model == "SerialArm":
            from cosim.arm.published import published_arm

            published_arm(component.parameter_set)
            return []
        chosen = parameter_set(component.parameter_set)
    except InputError as error:
        return [evolve(problem, where=f"{where}.parameter_set") for problem in error.problems]
    mounting = component.parameters.get("mounting", chosen.mounting.value)
    if chosen.fixed and mounting != Mounting.UPRIGHT.value and mounting != chosen.mounting.value:
        return [
            Problem(
                f"{where}.parameters.mounting",
                f"the mounting of set {chosen.name} ({chosen.mounting.value})",
                repr(mounting),
                "its gravity terms hold for that mounting only",
            )
        ]
    return []
