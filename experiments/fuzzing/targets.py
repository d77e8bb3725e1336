"""What is fuzzed: each target takes bytes, and ends well or says in one line why not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

Reading = Callable[[bytes, Path], None]
"""Takes an input and a folder for files; raises what the reader does, AssertionError for a result
that is none."""


@dataclass(frozen=True)
class Target:
    """Something that takes input of strangers.

    make: loads it, and gives valid inputs to begin with and what is to be done with one.
    instrumented: modules whose branches guide the search. file: what the name of the file that
    is read begins with, which every refusal has to tell; None: nothing may be refused.
    """

    make: Callable[[Path], tuple[list[bytes], Reading]]
    instrumented: tuple[str, ...]
    file: str | None


def _of(module: str, name: str) -> Callable[[Path], tuple[list[bytes], Reading]]:
    """Loaded by the process that fuzzes it, once its modules can be instrumented."""

    def make(folder: Path) -> tuple[list[bytes], Reading]:
        from importlib import import_module

        made: tuple[list[bytes], Reading] = getattr(import_module(module), name)(folder)
        return made

    return make


_LOGS = ("slam.readers",)
_FILES, _BAGS = "experiments.fuzzing.files", "experiments.fuzzing.bags"
_UPDATES = "experiments.fuzzing.updates"
_ESTIMATORS = tuple(
    f"slam.{name}"
    for name in (
        *("localization", "straightening", "fusion", "lost", "lost_search", "hypotheses", "deskew"),
        *("relocalization", "laser_faults", "slip", "usual_fit", "verdict_limits", "evidence"),
        *("matchers", "measurements", "mapping", "front_end", "drive_monitor", "loop_closing"),
        *("keyframe_graph", "map_consistency", "rescaling", "joint_adjustment", "wheel_scale"),
        *("open_ways", "compared_ways", "pauses"),
        *("session_joining", "surfaces", "surface_cells", "views", "beams"),
        *("heavy_tails", "consistency", "innovation_scales", "observability", "beam_likelihood"),
    )
)
"""Not those that Numba compiles."""

TARGETS: dict[str, Target] = {
    "carmen": Target(_of(_FILES, "carmen"), _LOGS, "log"),
    "ticks": Target(_of(_FILES, "ticks"), _LOGS, "log"),
    "bag-ros1": Target(_of(_BAGS, "ros1"), (*_LOGS, "rosbags"), "log"),
    "bag-mcap": Target(_of(_BAGS, "mcap"), (*_LOGS, "rosbags"), "log"),
    "bag-sqlite": Target(_of(_BAGS, "sqlite"), (*_LOGS, "rosbags"), "log"),
    "ros-map": Target(
        _of(_FILES, "ros_map"),
        ("slam.files.map_files", "slam.files.yaml_files", "yaml", "PIL"),
        "m.",
    ),
    "slam-map": Target(
        _of(_FILES, "slam_map"),
        ("slam.files.slam_map_files", "slam.files.slam_map_checks", "slam.slam_map"),
        "m.kitasap",
    ),
    "g2o": Target(_of(_FILES, "g2o"), ("slam.pose_graph",), "graph.g2o"),
    "tum": Target(_of(_FILES, "tum"), ("slam.trajectory",), "t.tum"),
    "kitti": Target(_of(_FILES, "kitti"), ("slam.files.kitti_files", "slam.trajectory"), "t.kitti"),
    "relations": Target(
        _of(_FILES, "relations"), ("slam.metrics.relation_files",), "all.relations"
    ),
    "plan": Target(
        _of(_FILES, "plan"), ("experiments.plan_files", "kitasap_sim.floor_plan", "yaml"), "plan."
    ),
    "house": Target(
        _of(_FILES, "house"), ("experiments.house_files", "kitasap_sim.rectangles"), "house."
    ),
    "baseline": Target(_of(_FILES, "baseline"), ("experiments.gate.baseline",), "baseline."),
    **{
        f"localizer-{name}": Target(_of(_UPDATES, f"localizer_{name}"), _ESTIMATORS, None)
        for name in ("limit", "fast", "open3d", "line", "paper")
    },
    "mapper": Target(_of(_UPDATES, "mapper"), _ESTIMATORS, None),
    "mapper-continued": Target(_of(_UPDATES, "mapper_continued"), _ESTIMATORS, None),
}
"""By name. Files of points are written here, and not read."""


def checked_targets(name: str) -> list[str]:
    """The targets that a name means. Raises ValueError, naming those that there are."""
    if name == "all":
        return list(TARGETS)
    if name not in TARGETS:
        raise ValueError(f"no target called '{name}'; there are: all, {', '.join(TARGETS)}")
    return [name]
