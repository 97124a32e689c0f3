"""`cosim identify`: parameters, intervals and errors from measured data."""

from pathlib import Path
from typing import Annotated

import typer

from cosim.cli.folder import TableFormat


def command(
    data: Annotated[
        list[Path], typer.Argument(help="recordings: CSV, Parquet, MAT, or result.h5 of scenario identification")
    ],
    test: Annotated[list[Path] | None, typer.Option(help="recordings that are held out")] = None,
    description: Annotated[
        Path | None, typer.Option(help="what the columns are (TOML); default: beside the data")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="folder (default: results/STEM-identification)")] = None,
    export: Annotated[
        list[TableFormat] | None,
        typer.Option(help="also write the parameters as identification.csv or identification.parquet"),
    ] = None,
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
    """Identify the parameters of a PHANToM, of one joint, of a joint with given columns, or of an arm by its URDF."""
    import sys

    import cosim
    from cosim.cli.folder import named, results

    print(f"identifying from {len(data) + len(test or [])} file(s)", file=sys.stderr)
    with results(out or named(f"{data[0].stem}-identification")) as folder:
        found = cosim.identify(
            data,
            test,
            description=description,
            cutoff=cutoff,
            velocity_cutoff=velocity_cutoff,
            smooth_sign=smooth_sign,
            robust=robust,
            physical=physical,
        )
    found.save(folder, export=[kind.value for kind in export or ()])
    for warning in found.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    print(f"{found}\nwritten: {folder / 'identification.json'}, {folder / 'report.html'}")
