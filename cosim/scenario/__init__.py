"""A scenario: components with their parameters, the connections between them, and how they are stepped.

The file is TOML. Everything wrong with it is collected and reported at once (`cosim.errors.InputError`); what only the
FMUs know (variables, units, causality) is checked by `cosim.wiring`.
"""

from cosim.scenario.changing import joints_of, parse_override, start_values
from cosim.scenario.loading import draft, load_scenario, load_text, shipped
from cosim.scenario.parts import (
    FORMAT,
    NANOSECONDS,
    Algorithm,
    Component,
    Connection,
    Conversion,
    Experiment,
    Extrapolation,
    FmuLogging,
    Teleoperation,
)
from cosim.scenario.scenario import Scenario
from cosim.scenario.writing import to_toml

__all__ = [
    "FORMAT",
    "NANOSECONDS",
    "Algorithm",
    "Component",
    "Connection",
    "Conversion",
    "Experiment",
    "Extrapolation",
    "FmuLogging",
    "Scenario",
    "Teleoperation",
    "draft",
    "joints_of",
    "load_scenario",
    "load_text",
    "parse_override",
    "shipped",
    "start_values",
    "to_toml",
]
