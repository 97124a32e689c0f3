"""`cosim plot`: figures of a run for papers, and its arms as a movie."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    result: Annotated[Path, typer.Argument(help="folder, or result.h5, of a run")],
    signals: Annotated[
        list[str] | None, typer.Argument(help="arm_l.x, or arm_l.x[1]; none: the figure of the report")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="the figure: .pdf, .svg, .eps, .png (default: results/NAME.pdf)")
    ] = None,
    movie: Annotated[Path | None, typer.Option(help="the arms in motion: .gif, or .mp4 where ffmpeg is there")] = None,
    width: Annotated[float, typer.Option(min=20.0, max=1000.0, help="of the figure [mm]; a column is often 85")] = 85.0,
    height: Annotated[float | None, typer.Option(min=15.0, max=1000.0, help="[mm]; default: by the plots")] = None,
    together: Annotated[
        bool, typer.Option("--together", help="all signals in one plot; their unit must be one")
    ] = False,
    speed: Annotated[float, typer.Option(min=0.01, max=1000.0, help="of the movie, times that of the run")] = 1.0,
) -> None:
    """A figure of recorded signals, sized for a paper; --movie: the arms in motion."""
    import cosim
    from cosim.cli.folder import named

    found = cosim.open_result(result)
    if movie is not None:
        print(f"written: {found.save_movie(movie, speed=speed)}")
    if movie is None or out is not None or signals:
        path = out or named(found.scenario.name).with_suffix(".pdf")
        written = found.save_plot(path, signals or (), width=width, height=height, together=together)
        print(f"written: {written}")
