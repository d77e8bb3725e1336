"""The engines by the names that users type."""

from experiments.engines import Engine, SerialEngine
from experiments.processes import local_engine

ENGINES = ("local", "serial", "ray")
_MOST_S = 86_400.0
"""Chosen: nobody waits longer for a trial, and what waits for its process can."""


def engine_named(
    name: str, jobs: int | None, limit_s: float | None = None, address: str | None = None
) -> Engine:
    """jobs: processes, None: one per core; limit_s: of a trial; address: of a Ray cluster.

    Raises ValueError, naming those there are, for an unknown one, and for what it does not know;
    ImportError for Ray where it is not installed.
    """
    if name not in ENGINES:
        raise ValueError(f"no engine called '{name}'; there are: {', '.join(ENGINES)}")
    if limit_s is not None and not 0.0 < limit_s <= _MOST_S:
        raise ValueError(
            f"--trial-timeout takes seconds above 0 and up to {_MOST_S:g}, a day, not {limit_s:g}"
        )
    if address is not None and name != "ray":
        raise ValueError("--address is that of a Ray cluster: it goes with --engine ray")
    if name == "ray":
        from experiments.ray_crew import ray_engine

        return ray_engine(jobs, limit_s, address)
    if name == "serial":
        if limit_s is not None or jobs not in (None, 1):
            raise ValueError(
                "--engine serial is this process alone, which stops no trial: without --jobs and"
                " --trial-timeout"
            )
        return SerialEngine()
    return local_engine(jobs, limit_s)
