"""`cosim list`."""


def command() -> None:
    """Shipped scenarios and sweeps, one line each."""
    import tomllib

    from cosim.scenario import shipped

    for room, heading in (("scenario", "scenarios (cosim run NAME)"), ("sweeps", "sweeps (cosim sweep NAME)")):
        paths = shipped(room)
        if not paths:
            continue
        print(heading)
        width = max(len(path.stem) for path in paths) + 2
        for path in paths:
            print(f"  {path.stem:<{width}}{tomllib.loads(path.read_text(encoding='utf-8')).get('title', '')}")
