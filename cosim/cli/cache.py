"""`cosim cache list|clean`."""

from typing import Annotated

import typer

app: typer.Typer = typer.Typer(no_args_is_help=True)


@app.command("list")
def show() -> None:
    """What is kept between runs: compiled FMUs, what was unpacked, what the compiler keeps; and how large it is."""
    from build_fmus.cache import cache_folder, kept

    folder = cache_folder()
    entries = kept(folder)
    width = max((len(name) for name in entries), default=0)
    for name, (files, size) in entries.items():
        print(f"{name:<{width}}  {files:7d} files  {size / 1e6:9.1f} MB")
    print(f"{sum(size for _, size in entries.values()) / 1e6:.1f} MB in {folder}")


@app.command()
def clean(
    name: Annotated[
        list[str] | None, typer.Argument(help="parts of the cache, as `cosim cache list` names them")
    ] = None,
) -> None:
    """Remove what is kept between runs (or the named parts of it); it is built again when it is needed."""
    from build_fmus.cache import cache_folder, forget, kept
    from cosim.errors import InputError, Problem, did_you_mean

    folder = cache_folder()
    entries = kept(folder)
    if unknown := [one for one in name or () if one not in entries]:
        expected = " or ".join(entries) or "nothing: the cache is empty"
        raise InputError([Problem("cache clean", expected, repr(one), did_you_mean(one, entries)) for one in unknown])
    chosen = name or list(entries)
    forget(folder, chosen)
    print(f"removed {sum(entries[one][1] for one in chosen) / 1e6:.1f} MB from {folder}")
