"""`certificate.json`: the certificates of a scenario's loop, what they are of, and a check that it is all there.

The digest tells a file that was changed, or cut short, from one that was written; the proof does not rest on it.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from attrs import field, frozen

from cosim.analysis.any_delay import laws
from cosim.analysis.certificate import Certificate, certificate_of
from cosim.analysis.opened import OpenedLoop
from cosim.analysis.parting import LoopPart, joined_apart
from cosim.errors import InputError, Problem
from cosim.opening import read_json
from cosim.results.provenance import versions
from cosim.results.saving import write_json
from cosim.scenario import Scenario

FORMAT = "haptic-cosim stability certificate 3"
SAME = 1e-6
"""Part of its response by which a scenario's loop may differ from that of a file: what differences of FMUs are right
to.
"""
_ADVICE = "`cosim stability SCENARIO --any-delay` writes one"


@frozen
class ProvenSystem:
    """The loops into which a scenario's loop falls, and a certificate for each (none where nothing is proven).

    channels: name and inputs of each channel; step [s].
    """

    scenario: str
    channels: Mapping[str, tuple[str, ...]]
    parts: tuple[LoopPart, ...] = field(converter=tuple)
    certificates: tuple[Certificate, ...] = field(converter=tuple)
    versions: Mapping[str, str] = field(factory=versions)

    @classmethod
    def of(
        cls, scenario: Scenario, loop: OpenedLoop, parts: Sequence[LoopPart], certificates: Sequence[Certificate]
    ) -> "ProvenSystem":
        """What was found of a scenario."""
        return cls(scenario.name, loop.channels, parts, certificates)

    @property
    def step(self) -> float:
        """Communication step [s]."""
        return self.parts[0].loop.step

    @property
    def certified(self) -> float:
        """Largest T [s] that all certificates cover."""
        return min(certificate.max_delay for certificate in self.certificates)

    @property
    def claim(self) -> str:
        """What the file claims, in words."""
        return (
            f"the sampled linear loop of {self.scenario} is exponentially stable for every delay law from 0 to "
            f"{self.certified:.9g} s: {self.laws}"
        )

    @property
    def laws(self) -> str:
        """The class of laws, in words; of different classes, the narrowest."""
        slopes = [c.grid.slope for c in self.certificates if c.grid.slope is not None]
        return laws(min(slopes, default=None))

    def differs_from(self, loop: OpenedLoop) -> float:
        """Greatest part of the response by which a scenario's loop differs from the one proven; inf for other
        channels.
        """
        same = {n: tuple(s) for n, s in self.channels.items()} == {n: tuple(s) for n, s in loop.channels.items()}
        if not same or self.step != loop.loop.step:
            return np.inf
        return joined_apart(loop.loop, self.parts)


def save_certificate(system: ProvenSystem, path: Path) -> Path:
    """Write certificate.json."""
    loops = [
        certificate.to_dict() | {"turns": [turn.tolist() for turn in part.turns]}
        for part, certificate in zip(system.parts, system.certificates)
    ]
    content: dict[str, Any] = {
        "format": FORMAT,
        "claim": system.claim,
        "class": system.laws,
        "scenario": system.scenario,
        "channels": {name: list(signals) for name, signals in system.channels.items()},
        "loops": loops,
        "versions": dict(system.versions),
    }
    return write_json(content | {"digest": _digest(content)}, path, indent=1)


def _digest(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def load_certificate(path: str | Path) -> ProvenSystem:
    """Read what `save_certificate` wrote. Raises InputError where it is another file, or was changed."""
    content = read_json(Path(path), "a certificate", _ADVICE)
    if content.get("format") != FORMAT:
        raise InputError(Problem(str(path), f'"format": "{FORMAT}"', str(content.get("format")), _ADVICE))
    digest = content.pop("digest", None)
    if digest != _digest(content):
        raise InputError(
            Problem(str(path), "the content that was written", "another one (its digest differs)", _ADVICE)
        )
    try:
        return _read(content, str(path))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(Problem(str(path), "the keys and numbers of a certificate", repr(error), _ADVICE)) from error


def _read(content: dict[str, Any], where: str) -> ProvenSystem:
    turns = [loop.pop("turns") for loop in content["loops"]]
    certificates = [certificate_of(data, f"{where}, loop {k + 1}") for k, data in enumerate(content["loops"])]
    channels = {str(name): tuple(signals) for name, signals in content["channels"].items()}
    parts = [LoopPart(certificate.loop, turn) for certificate, turn in zip(certificates, turns)]
    system = ProvenSystem(content["scenario"], channels, parts, certificates, content["versions"])
    problems = [
        Problem(f"{where}, loop {k + 1}", "turns that fit its channels", "others", _ADVICE)
        for k, part in enumerate(parts)
        if [len(turn) for turn in part.turns] != [len(signals) for signals in channels.values()]
        or len(part.owner) != part.loop.channels
        or not all(np.all(np.isfinite(turn)) for turn in part.turns)
    ]
    if not parts or problems:
        raise InputError(problems or Problem(where, "a loop", "none", _ADVICE))
    for key, said in (("class", system.laws), ("claim", system.claim)):
        if content[key] != said:
            raise InputError(Problem(f"{where}: {key}", repr(said), repr(content[key]), _ADVICE))
    return system
