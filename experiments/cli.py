"""The command `kitasap`. Heavy imports wait within the commands: `--help` answers at once."""

import os
import sys
from pathlib import Path
from traceback import walk_tb
from typing import Annotated

import typer

from experiments.commands import (
    bench,
    convert,
    doctor,
    drive,
    gate,
    logs,
    reports,
    shards,
    simulated,
    sweep,
    trajectories,
    view,
    world,
)
from experiments.commands.options import check_words, viewer_told
from experiments.standard_streams import outlive_readers
from experiments.termination import interrupt_when_terminated, is_terminated

# Typer brings its own copy of Click, or uses the one installed, by its version; either way this is
# the base class of what it raises for wrong usage.
_WrongUsage: type[Exception] = next(
    c for c in typer.BadParameter.__mro__ if c.__name__ == "ClickException"
)
_INTERRUPTED, _TERMINATED = 130, 143

app = typer.Typer(
    name="kitasap",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _print_version(is_asked: bool) -> None:
    if is_asked:
        from experiments.provenance import commit, versions

        at = commit()
        print(versions().get("kitasap", "not installed"), *([f"commit {at}"] if at else []))
        raise typer.Exit()


@app.callback()
def _of_all_commands(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print it.")
    ] = False,
) -> None:
    """Kitasap2 drives, is lifted, and finds itself: the testbed and its experiments."""


app.command()(simulated.run)
app.command()(shards.merge)
app.command()(sweep.sweep)
app.command()(simulated.trial)
app.command()(simulated.picture)
app.command()(view.view)
app.command()(simulated.calibrate)
app.command()(drive.drive)
app.command()(drive.train)
app.command("real-log")(logs.real_log)
app.command()(logs.slam)
app.command()(logs.localize)
app.command()(trajectories.evaluate)
app.command()(convert.convert)
app.command()(reports.report)
app.command()(reports.reproduce)
app.command()(gate.baseline)
app.command()(gate.check)
app.command()(doctor.doctor)
app.add_typer(bench.app, name="bench")
app.add_typer(world.app, name="world")


def main(arguments: list[str] | None = None) -> int:
    """The exit status: 0 done, 1 fell short, 2 wrong usage or unreadable input, in one line; 130 and
    143 interrupted, by Ctrl-C and by SIGTERM.

    KITASAP_TRACEBACK in the environment lets the exception behind that line through.
    """
    # one thread each: the trials are spread over processes, and sums keep their order
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    given = sys.argv[1:] if arguments is None else arguments
    try:
        check_words(given)
        typed = viewer_told(given)
        status = app(typed, prog_name="kitasap", standalone_mode=False)
    except _WrongUsage as error:
        # looked up by name above, so the type checker cannot know the method
        said = error.format_message()  # type: ignore[attr-defined]
        said += _numbers_wanted(error)
        is_unknown = not typed or said.startswith("No such command")
        return _refused(said + (" See kitasap --help." if is_unknown else ""))
    except (ValueError, OSError, RuntimeError, ImportError, AttributeError) as error:
        asked_in_vain = _opengl_asked_in_vain(error)
        is_fault = isinstance(error, AttributeError) and not asked_in_vain
        if is_fault or os.environ.get("KITASAP_TRACEBACK"):
            raise
        return _refused(asked_in_vain or _reason(error))
    except MemoryError:
        return _refused("there is not enough memory for this")
    except (KeyboardInterrupt, typer.Abort):
        status = _INTERRUPTED
    if status == _INTERRUPTED:  # Typer returns most interrupts as a status, and says nothing
        goes_on = "; the same command goes on from here"
        is_run = given[:1] in (["run"], ["reproduce"], ["sweep"])
        how, status = ("terminated", _TERMINATED) if is_terminated() else ("interrupted", status)
        print(f"\nkitasap: {how}{goes_on if is_run else ''}", file=sys.stderr)
    return status if isinstance(status, int) else 0


def _numbers_wanted(error: Exception) -> str:
    """What an option takes that takes several values, where it did not get them."""
    option = getattr(error, "param", None)
    if option is None or getattr(option, "nargs", 1) < 2 or option.metavar is None:
        return ""
    return f" ({option.opts[0]} takes {option.nargs} values: {option.metavar})"


def _reason(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename and error.strerror:
        return f"{error.filename}: {error.strerror}"
    return str(error) or type(error).__name__


def _opengl_asked_in_vain(error: Exception) -> str:
    """What to do where MuJoCo could not load the OpenGL that MUJOCO_GL asks for, whatever it raised
    then; nothing for all other errors."""
    asked = os.environ.get("MUJOCO_GL")
    files = [Path(frame.f_code.co_filename) for frame, _ in walk_tb(error.__traceback__)]
    loads = any(file.name == "gl_context.py" and "mujoco" in file.parts for file in files)
    if not asked or not loads:
        return ""
    return (
        f"MuJoCo cannot load the OpenGL that MUJOCO_GL={asked} asks for ({error}): unset MUJOCO_GL, "
        "or see kitasap doctor"
    )


def _refused(reason: str) -> int:
    print("kitasap:", " ".join(reason.split()), file=sys.stderr)
    return 2


def _process(arguments: list[str] | None = None) -> int:
    """`main` of a process that is this command's alone: its streams, its signals."""
    outlive_readers()
    interrupt_when_terminated()
    status = main(arguments)
    try:
        sys.stdout.flush()
    except OSError as error:
        return _refused(_reason(error)) if status in (0, 1) else status
    return status


def run_script(experiment: str) -> None:
    """What `python -m experiments.<experiment>` does: `kitasap run` of that experiment."""
    sys.exit(_process(["run", experiment, *sys.argv[1:]]))


def entry() -> None:
    """The console script."""
    sys.exit(_process())


if __name__ == "__main__":
    entry()
