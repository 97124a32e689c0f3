"""What a two-sided verdict on every delay law leaves in a folder."""

from collections.abc import Callable
from pathlib import Path

from cosim.analysis.certificate_file import save_certificate
from cosim.analysis.delay_verdict import AnyDelay
from cosim.analysis.replay import write_trace
from cosim.results.saving import write_text
from cosim.scenario import to_toml

TWO_SIDED = ("certificate.json", "destroying.csv", "destroying.toml")


def two_sided_files(found: AnyDelay | None) -> dict[str, Callable[[Path], object]]:
    """{name: what writes it} of those of TWO_SIDED that there are: the proof, a period of the law, its scenario."""
    files: dict[str, Callable[[Path], object]] = {}
    if found is None or found.system is None:
        return files
    system, destroyer, replay = found.system, found.destroyer, found.replay
    if system.certificates:
        files["certificate.json"] = lambda path: save_certificate(system, path)
    if destroyer is not None and replay is not None and (played := replay.scenario) is not None:
        files["destroying.csv"] = lambda path: write_trace(destroyer.ages, system.step, system.channels, path)
        files["destroying.toml"] = lambda path: write_text(to_toml(played), path)
    return files
