"""`cosim identify`: parameters, intervals and errors from measured data."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    data: Annotated[
        list[Path], typer.Argument(help="recordings: CSV, Parquet, MAT, or result.h5 of scenario identification")
    ],
    test: Annotated[list[Path] | None, typer.Option(help="recordings that are held out")] = None,
    description: Annotated[
        Path | None, typer.Option(help="what the columns are (TOML); default: beside the data")
    ] = None,
    out: Annotated[Path, typer.Option(help="folder for identification.json and report.html")] = Path("out/identify"),
    cutoff: Annotated[
        float | None, typer.Option(help="low-pass over both sides [Hz]; default: 12 times the motion's band")
    ] = None,
    velocity_cutoff: Annotated[float | None, typer.Option(help="low-pass before differentiation [Hz]")] = None,
    smooth_sign: Annotated[
        float | None, typer.Option(help="keep all rows, sign of dq smoothed over this speed")
    ] = None,
    robust: Annotated[bool, typer.Option("--robust", help="Huber weights against outliers")] = False,
    physical: Annotated[
        bool, typer.Option("--physical", help="force M > 0 over the workspace and friction that dissipates")
    ] = False,
) -> None:
    """Identify the parameters of a PHANToM, of one joint, or of a joint with given regressor columns."""
    import json
    import sys

    from cosim.cli.folder import made
    from cosim.identify.document import document
    from cosim.identify.identification import identify, identify_as_paper
    from cosim.identify.idim import idim
    from cosim.identify.method import adjusted, suggested
    from cosim.measured import read
    from cosim.report.html import write_report
    from cosim.report.identify import page, verdict

    print(f"reading {len(data) + len(test or [])} file(s)", file=sys.stderr)
    recording = read(data, test or (), description)
    made(out)
    method = adjusted(suggested(recording), cutoff, velocity_cutoff, smooth_sign, robust, physical)
    print("identifying", file=sys.stderr)
    found, paper = identify(recording, method), identify_as_paper(recording)
    reference = idim(recording, found.params[: len(paper.params)])
    (out / "identification.json").write_text(json.dumps(document(found, paper, reference), indent=1), encoding="utf-8")
    write_report(page(found, paper, reference), out / "report.html")
    for warning in found.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    print(verdict(found))
    for parameter in found.parameters:
        low, high = parameter.interval
        print(f"  {parameter.label!s:14s} {parameter.value: .6g}  [{low: .6g}, {high: .6g}] {parameter.unit}")
    print(f"written: {out / 'identification.json'}, {out / 'report.html'}")
