"""What a live page lets its reader change: start values with a slider each, and the laws of delay."""

from collections.abc import Iterable, Mapping

from attrs import frozen

from cosim.exports.module import StartPlace
from cosim.wiring import Wiring


@frozen
class Slider:
    """Start values that a slider sets together: all elements of a variable in all components of a model.

    names: `component.variable`; least, most: the ends of the slider [unit]; at_once: whether a running
    component takes it.
    """

    label: str
    unit: str
    names: tuple[str, ...]
    value: float
    least: float
    most: float
    at_once: bool


@frozen
class DelaySliders:
    """Delay and jitter of the channels of a model, a slider each: delay +- jitter [s] by a law that varies, or the
    delay alone.

    law, mean, least, most: names of start values; own, constant, uniform: items of the enumeration `law`: the
    scenario's, the one without jitter, and the one that a constant delay with jitter gets.
    """

    label: str
    law: tuple[str, ...]
    mean: tuple[str, ...]
    least: tuple[str, ...]
    most: tuple[str, ...]
    own: float
    constant: float
    uniform: float
    delay: float
    jitter: float

    @property
    def names(self) -> tuple[str, ...]:
        """All start values that it sets."""
        return self.law + self.mean + self.least + self.most


STEMS: Mapping[str, tuple[str, float]] = {
    "stiffness": ("stiffness K", 1.0),
    "damping": ("damping B", 0.5),
    "joint_stiffness": ("stiffness K", 1.0),
    "joint_damping": ("damping B", 0.5),
    "loss_to_bad": ("loss: good to bad, per sample", 0.2),
    "loss_good": ("loss: in the good state, per sample", 0.5),
    "offset": ("wall: place", 0.1),
    "contact_stiffness": ("wall: stiffness", 100.0),
    "contact_distance": ("wall: place", 0.1),
}
"""Variables that get a slider, in words, and the end of the slider where four times the scenario's value is less (of a
place: how far it may be moved to either side).
"""
_PLACES = ("offset", "contact_distance")
_LAW = {"law": "law", "mean": "delay_mean", "least": "delay_min", "most": "delay_max"}


def slider_names(wiring: Wiring) -> dict[tuple[str, str], list[str]]:
    """{(model, stem): names of start values} that get a slider."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name, component in wiring.scenario.components.items():
        description = wiring.descriptions[name]
        for stem in STEMS:
            elements = [stem] if stem in description.variables else description.elements(stem)
            if elements and _acts(wiring, name, stem):
                groups.setdefault((component.kind, stem), []).extend(f"{name}.{e}" for e in elements)
    return groups


def coupling(groups: Mapping[tuple[str, str], list[str]]) -> tuple[str, list[str], list[str]] | None:
    """The model whose stiffness and damping couple the arms, the first that has sliders for both, and the names of the
    start values of each; None without one.
    """
    for model, stem in groups:
        other = stem.replace("stiffness", "damping")
        if stem in ("stiffness", "joint_stiffness") and (model, other) in groups:
            return model, groups[model, stem], groups[model, other]
    return None


def _acts(wiring: Wiring, name: str, stem: str) -> bool:
    """Whether a variable of a component does anything in this scenario: of an arm its wall, of a surface its place, of
    a coupling the gains of the space that it acts in.
    """
    variables = wiring.descriptions[name].variables
    if "q[1]" in wiring.descriptions[name].outputs:
        return stem.startswith("contact_") and wiring.start(name, "contact_stiffness") > 0
    joint = "space" in variables and variables["space"].item(wiring.start(name, "space")) == "joint"
    if "space" in variables and stem.endswith(("stiffness", "damping")) and stem.startswith("joint_") != joint:
        return False
    if stem == "offset":
        return "surface" in variables and variables["surface"].item(wiring.start(name, "surface")) == "wall"
    return variables[stem if stem in variables else f"{stem}[1]"].causality not in ("input", "output")


def slider(wiring: Wiring, key: tuple[str, str], names: Iterable[str], starts: Mapping[str, StartPlace]) -> Slider:
    """The slider of a group of `slider_names`."""
    names, (model, stem) = tuple(names), key
    component, _, variable = names[0].partition(".")
    words, most = STEMS[stem]
    value, described = starts[names[0]].value, wiring.descriptions[component].variables[variable]
    return Slider(
        f"{model}: {words}",
        "" if described.unit.name == "1" else described.unit.name,
        names,
        value,
        value - most if stem in _PLACES else 0.0,
        min(value + most if stem in _PLACES else max(most, 4 * value), described.limits[1]),
        all(starts[name].reference is not None for name in names),
    )


def delay_laws(wiring: Wiring) -> list[DelaySliders]:
    """The channels of each model whose delay follows a law of its own, not a recording."""
    groups: dict[str, list[str]] = {}
    for name, component in wiring.scenario.components.items():
        variables = wiring.descriptions[name].variables
        known = set(_LAW.values()) <= set(variables)
        if known and variables["law"].item(wiring.start(name, "law")) != "recorded":
            groups.setdefault(component.kind, []).append(name)
    return [_law(wiring, model, names) for model, names in groups.items()]


def _law(wiring: Wiring, model: str, channels: list[str]) -> DelaySliders:
    first, law = channels[0], wiring.descriptions[channels[0]].variables["law"]
    numbers = dict(zip(law.items, law.item_values))
    own = wiring.start(first, "law")
    mean, least, most = (float(wiring.start(first, _LAW[key])) for key in ("mean", "least", "most"))
    constant = law.item(own) == "constant"
    return DelaySliders(
        model,
        **{key: tuple(f"{name}.{variable}" for name in channels) for key, variable in _LAW.items()},
        own=float(own),
        constant=float(numbers["constant"]),
        uniform=float(numbers["uniform"]),
        delay=mean if constant else 0.5 * (least + most),
        jitter=0.0 if constant else 0.5 * (most - least),
    )
