"""The layers of style.md, section 3: who may import whom, read from the sources."""

import ast
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]
PACKAGES = ("models", "kitasap_sim", "slam", "experiments")

MAY_IMPORT = {
    "models": set(),
    "kitasap_sim": {"kitasap_sim", "models", "numpy", "mujoco", "gymnasium"},
    "slam": {"slam", "numpy", "scipy", "numba"},
    "experiments": {
        *("experiments", "slam", "kitasap_sim", "models", "numpy", "mujoco"),
        *("gymnasium", "typer", "rich", "yaml", "jinja2", "markupsafe"),
    },
}
ONLY_IN = {
    "kitasap_sim/compiled.py": {"numba"},
    "kitasap_sim/window.py": {"glfw"},
    "slam/files/map_files.py": {"PIL", "yaml"},
    "slam/readers/bag_files.py": {
        *("rosbags", "apsw", "lz4", "backports", "compression", "yaml"),
    },
    "slam/files/yaml_files.py": {"yaml"},
    "slam/open3d_backend.py": {"open3d", "libusb_package"},
    "experiments/doctor.py": {"packaging"},
    "experiments/figures/against_bound.py": {"matplotlib"},
    "experiments/figures/canvas.py": {"matplotlib"},
    "experiments/figures/convergence.py": {"matplotlib"},
    "experiments/figures/grid.py": {"matplotlib"},
    "experiments/figures/hypotheses.py": {"matplotlib"},
    "experiments/figures/inline.py": {"matplotlib", "PIL"},
    "experiments/figures/kidnap_map.py": {"matplotlib"},
    "experiments/figures/localized_log.py": {"matplotlib"},
    "experiments/figures/learning_curve.py": {"matplotlib"},
    "experiments/figures/lost_roc.py": {"matplotlib"},
    "experiments/figures/map_difference.py": {"matplotlib"},
    "experiments/figures/mismatches.py": {"matplotlib"},
    "experiments/figures/one_trial.py": {"matplotlib"},
    "experiments/figures/over_time.py": {"matplotlib"},
    "experiments/figures/paper_scatter.py": {"matplotlib"},
    "experiments/figures/made_maps.py": {"matplotlib"},
    "experiments/figures/slam_map.py": {"matplotlib"},
    "experiments/figures/sweep.py": {"matplotlib"},
    "experiments/api_pages.py": {"pdoc"},
    "experiments/bag_writer.py": {"rosbags"},
    "experiments/ray_crew.py": {"ray"},
    "experiments/rerun_stream.py": {"rerun"},
    "experiments/fuzzing/bags.py": {"rosbags"},
    "experiments/fuzzing/child.py": {"atheris"},
    "experiments/gate/permutation.py": {"scipy"},
    "experiments/map_quality.py": {"scipy"},
    "experiments/map_worlds.py": {"scipy"},
    "experiments/train.py": {"torch", "stable_baselines3"},
    "experiments/film_drawing.py": {"PIL"},
    "experiments/video.py": {"PIL", "imageio_ffmpeg"},
    "experiments/figures/recorded_log.py": {"matplotlib"},
    "experiments/bench/registration_peers.py": {"scipy", "small_gicp", "kiss_icp"},
}

RANKS = (
    {"arrays", "se2", "kernels", "normal_points", "pose_arrays", "whole_files", "text_fields"}
    | {
        "yaml_files",
        "near_cells",
        "in_steps",
        "running_median",
        "compiling",
        "lazy",
        "records",
        "packed",
    },
    {
        "measurements",
        "odometry",
        "point_map",
        "occupancy_grid",
        "ray_counts",
        "likelihood_grid",
        "trajectory",
        "beams",
    }
    | {"scan_match", "range_noise", "laser_model", "segments", "segment_map", "surfel_grid"}
    | {"surfels", "map_files", "pose_lookup", "point_files", "kitti_files"},
    {"icp", "scan_matching", "beam_likelihood", "pose_graph", "deskew", "evidence"}
    | {"open3d_backend", "lines", "line_extraction", "observability", "drive_adjustment"}
    | {
        "surface_map",
        "surface_match",
        "surface_cells",
        "map_errors",
        "views",
        "frozen_laser",
        "pauses",
        "wheel_prior",
        "constant_velocity",
        "surface_window",
    }
    | {
        "match_verdict",
        "slam_map_checks",
        "wheel_scale",
        "keyframes",
        "kept_keyframes",
        "remaining",
        "told_steps",
        "step_factors",
    },
    {
        "relocalization",
        "hypotheses",
        "hypotheses_config",
        "guard_config",
        "telling_turn",
        "verdict_limits",
        "verdict",
        "laser_faults",
        "slip",
        "usual_fit",
        "last_views",
        "look",
        "unmapped",
        "lost_search",
        "lost",
        "front_end",
        "front_end_config",
        "open_matches",
        "candidates",
        "placing",
        "people_along",
        "seen_before",
        "prediction",
        "slipped_wheels",
        "still_scans",
        "loose_runs",
        "looseness",
        "older_keyframes",
        "second_look",
        "open_runs",
        "odometry_jumps",
        "contradictions",
        "witnesses",
        "strays",
        "stray_scans",
        "followers",
        "jumped_scans",
        "blind_poses",
        "scan_jumps",
        "driven_through",
        "icp_mapping",
        "loop_closing",
        "surfaces",
        "pieces",
        "map_consistency",
        "map_drift",
        "compared_ways",
        "drive_monitor",
        "heavy_tails",
        "fusion",
        "consistency",
        "innovation_scales",
        "straightening",
        "matchers",
        "calibration",
        "wheel_calibration",
        "sharpness",
    },
    {"localization", "known_map", "mapping", "map_session", "session_joining", "joint_adjustment"}
    | {"slam_map", "slam_map_files", "warm_up", "mapper_config", "keyframe_graph", "rescaling"}
    | {"drive", "hindsight", "finishing", "objections"}
    | {"hanging_pieces", "open_ways", "wheels_borne_out", "scan_places"}
    | {"weak_steps", "there_and_back", "moved_things", "breaks_borne_out"}
    | {"lone_loops", "ways_over_breaks", "shown_jumps", "range_offset"},
)
GROUPS = tuple(
    f"slam.{name}" for name in ("backend", "files", "frontend", "guard", "map_checks", "surface")
)
"""Packages that group modules of several ranks."""
BESIDE_THE_RANKS = {"metrics", "readers"}
"""They use the first two ranks, and no estimator uses them."""


def sources(package: str) -> list[Path]:
    return sorted((REPOSITORY / package).rglob("*.py"))


def imports(path: Path) -> Iterator[str]:
    """The full names of the modules that a file imports anywhere, also within functions."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative imports hide who imports whom"
            assert node.module is not None
            yield node.module
            # `from slam import icp` imports a module too
            if node.module in {*PACKAGES, *GROUPS}:
                yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call):
            yield from _imported_by_call(node)


def _imported_by_call(node: ast.Call) -> Iterator[str]:
    name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
    if name in ("import_module", "__import__") and isinstance(node.args[0], ast.Constant):
        yield str(node.args[0].value)


def forbidden(path: Path, package: str) -> set[str]:
    allowed = MAY_IMPORT[package] | set(sys.stdlib_module_names)
    allowed |= ONLY_IN.get(path.relative_to(REPOSITORY).as_posix(), set())
    return {name for name in imports(path) if name.split(".")[0] not in allowed}


def rank(module: str) -> int:
    return next(number for number, names in enumerate(RANKS) if module in names)


def ranked(parts: Sequence[str]) -> str | None:
    """The name that has a rank, of those below `slam`: of a package that has one, or of the module in a
    package that groups some of several ranks; None of a name that is no module's."""
    known = set().union(*RANKS) | BESIDE_THE_RANKS
    return next((name for name in parts[:2] if name in known), None)


def slam_modules(path: Path) -> set[str]:
    """The modules of `slam` that a file imports, by the names that have a rank."""
    names = (name.split(".") for name in imports(path))
    found = {ranked(parts[1:]) for parts in names if parts[0] == "slam"}
    return {name for name in found if name is not None}


@pytest.mark.parametrize("package", PACKAGES)
def test_package_imports_only_what_its_layer_may(package):
    found = {path.name: names for path in sources(package) if (names := forbidden(path, package))}
    assert found == {}


@pytest.mark.parametrize(
    ("line", "package", "name"),
    [
        ("import mujoco", "slam", "mujoco"),
        ("def f():\n    from matplotlib import image", "slam", "matplotlib"),
        ("from slam.se2 import SE2", "kitasap_sim", "slam.se2"),
        ("import importlib\nimportlib.import_module('open3d')", "slam", "open3d"),
        ("import experiments.runs", "slam", "experiments.runs"),
    ],
)
def test_forbidden_import_is_seen_wherever_it_stands(tmp_path, monkeypatch, line, package, name):
    monkeypatch.setattr(sys.modules[__name__], "REPOSITORY", tmp_path)
    path = tmp_path / package / "new.py"
    path.parent.mkdir()
    path.write_text(line)
    assert forbidden(path, package) == {name}


def own_parts(path: Path) -> list[str]:
    return [part.removesuffix(".py") for part in path.relative_to(REPOSITORY / "slam").parts]


def test_every_module_of_slam_has_a_rank():
    modules = [path for path in sources("slam") if path.name != "__init__.py"]
    assert [path.name for path in modules if ranked(own_parts(path)) is None] == []


def test_every_package_of_slam_is_a_group_or_has_a_rank():
    packages = {path.parent.name for path in sources("slam")} - {"slam"}
    assert packages == {n.split(".")[1] for n in GROUPS} | {
        "kernels",
        "pose_graph",
        *BESIDE_THE_RANKS,
    }


def test_imports_inside_slam_run_leftward():
    wrong = []
    for path in sources("slam"):
        module = ranked(own_parts(path))
        if module is None:
            continue  # the front of a package shows all ranks
        for imported in slam_modules(path) - {module}:
            if module in BESIDE_THE_RANKS:
                is_wrong = imported in BESIDE_THE_RANKS or rank(imported) > 1
            else:
                is_wrong = imported in BESIDE_THE_RANKS or rank(imported) > rank(module)
            if is_wrong:
                wrong.append(f"{module} imports {imported}")
    assert wrong == []


def test_importing_kitasap_sim_loads_neither_mujoco_nor_open3d():
    # nor the other half of the project: both are useful alone
    assert loaded_after("import kitasap_sim", "mujoco", "open3d", "slam", "numba") == []


def test_help_loads_nothing_heavy():
    # each of these takes longer to import than the 0.3 s in which the help answers
    code = "from experiments.cli import main; assert main(['--help']) == 0"
    heavy = ("jinja2", "mujoco", "open3d", "numpy", "scipy", "matplotlib", "numba", "gymnasium")
    assert loaded_after(code, *heavy) == []


def loaded_after(code: str, *modules: str) -> list[str]:
    """Which of some modules a fresh interpreter has loaded after some code."""
    listed = f"{code}\nimport sys\nprint(*[m for m in {modules!r} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", listed], cwd=REPOSITORY, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()[-1].split()


@pytest.mark.parametrize(
    "module",
    [
        "slam.kernels.facings",
        pytest.param("kitasap_sim.env.kernels", marks=pytest.mark.slow),
        pytest.param("kitasap_sim.range_errors", marks=pytest.mark.slow),
        pytest.param("slam.kernels.normal_equations", marks=pytest.mark.slow),
    ],
)
def test_kernels_are_compiled_though_no_disk_may_be_written(module):
    # a container whose root, home and all, is read-only: Numba finds no place for its cache
    code = f"""
from numba.core import caching
assert caching.CacheImpl._locator_classes
caching.CacheImpl._locator_classes = []
import {module}
"""
    subprocess.run([sys.executable, "-c", code], check=True, cwd=REPOSITORY)
