"""The command `kitasap doctor`."""

import typer


def doctor() -> None:
    """Tells what is installed and what is missing, with the line that mends it."""
    from experiments.doctor import examined, told

    checks = examined()
    print(told(checks))
    raise typer.Exit(0 if all(one.is_well for one in checks) else 1)
