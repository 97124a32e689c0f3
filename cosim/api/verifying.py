"""A certificate checked without optimising, and whether it is one of a scenario's loop."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, final

from attrs import frozen

from cosim.analysis.certificate_file import SAME, ProvenSystem, load_certificate
from cosim.analysis.delay_verdict import OpenedAtRest, open_at_rest
from cosim.analysis.proof import Proof, proven
from cosim.api.card import card
from cosim.api.runs import loaded
from cosim.engine.isolation import called
from cosim.fmu import open_system
from cosim.results.summary import number
from cosim.scenario import Scenario


def verify(
    certificate: str | Path,
    scenario: Scenario | str | Path | None = None,
    *,
    say: Callable[[str], None] | None = None,
) -> VerifiedCertificate:
    """Check a certificate.json of `cosim.stability(..., any_delay=True)` in exact and interval arithmetic.

    scenario: one whose loop it has to be of: it is linearised again and compared. say: is told what is being done.
    Raises InputError where the file is not as it was written, or does not fit together; RunError where an FMU fails.
    """
    said = say or (lambda text: None)
    system = load_certificate(certificate)
    proofs = []
    for number_, item in enumerate(system.certificates, 1):
        said(f"checking loop {number_} of {len(system.certificates)}")
        proofs.append(proven(item))
    if scenario is None:
        return VerifiedCertificate(system, tuple(proofs), None, None, "")
    chosen = loaded(scenario)
    said(f"comparing with the loop of {chosen.name}")
    with open_system(chosen) as fmus:
        found = called(partial(open_at_rest, chosen, fmus), OpenedAtRest, chosen, fmus, "the loop was opened")
    if found.loop is None or found.bent:
        return VerifiedCertificate(system, tuple(proofs), chosen.name, float("inf"), found.why or found.bent)
    return VerifiedCertificate(system, tuple(proofs), chosen.name, system.differs_from(found.loop), "")


@final
@frozen(eq=False, repr=False)
class VerifiedCertificate:
    """What the check of a certificate showed.

    differs: greatest part of the response by which the scenario's loop differs from the one in the file; None where no
    scenario was asked for; `why` says why it cannot be compared.
    """

    system: ProvenSystem
    proofs: tuple[Proof, ...]
    scenario: str | None
    differs: float | None
    why: str

    @property
    def proven(self) -> bool:
        """Whether every condition was proven for every loop."""
        return all(proof.holds for proof in self.proofs)

    @property
    def same_loop(self) -> bool | None:
        """Whether the scenario's loop is that of the file; None where none was asked for."""
        return None if self.differs is None else self.differs <= SAME

    @property
    def holds(self) -> bool:
        """Whether all that was asked for holds."""
        return self.proven and self.same_loop is not False

    def to_dict(self) -> dict[str, Any]:
        """Plain values: what was checked and what was seen."""
        return {
            "claim": self.system.claim,
            "holds": self.holds,
            "proven": self.proven,
            "max_delay": self.system.certified,
            "loops": [
                [{"condition": c.condition, "holds": c.holds, "seen": c.seen} for c in proof.checks]
                for proof in self.proofs
            ],
            "scenario": self.scenario,
            "same_loop": self.same_loop,
            "differs": None if self.differs is None else number(self.differs),
            "why": self.why or None,
        }

    def __str__(self) -> str:
        """What `cosim verify` prints."""
        lines = [f"{'proven' if self.proven else 'NOT PROVEN'}: {self.system.claim}"]
        for loop, proof in enumerate(self.proofs, 1):
            lines += [f"  loop {loop}: {'' if c.holds else 'NOT '}{c.condition} ({c.seen})" for c in proof.checks]
        if self.scenario is None:
            return "\n".join([*lines, "  whether this loop is that of a scenario: --scenario NAME compares them"])
        told = self.why or f"their responses differ by a part of {self.differs:.2g}"
        said = f"it is the loop of {self.scenario}" if self.same_loop else f"it is NOT the loop of {self.scenario}"
        return "\n".join([*lines, f"  {said}: {told}"])

    def __repr__(self) -> str:
        return f"<VerifiedCertificate {self.system.scenario}: {'holds' if self.holds else 'does not hold'}>"

    def _repr_html_(self) -> str:
        return card(str(self).partition("\n")[0], {"holds": self.holds})
