"""`kitasap bench sim`: how fast and how true the simulation is, measured here and now.

Speeds are processor time and ratios within one run: other work on the machine does not move them.
"""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
from rich.table import Table

from experiments.tables import wide_console
from kitasap_sim.drive import Pilot, square
from kitasap_sim.hand import kidnap
from kitasap_sim.places import Place
from kitasap_sim.simulation import Simulation

_SIM_S = 20.0
_ROUNDS = 5
_SQUARE_SIDE_M = 2.5


@dataclass(frozen=True)
class SpeedResult:
    """Simulated seconds per processor second of the whole simulation, and of bare MuJoCo."""

    with_fan: float
    bare: float

    @property
    def ratio(self) -> float:
        """1 would be a laser for nothing."""
        return self.with_fan / self.bare


def print_benchmark(place_name: str, laser_name: str) -> None:
    """Prints the benchmark of the simulation."""
    console = wide_console()
    table = Table(title=f"Simulation, {place_name}, {laser_name}")
    table.add_column("what")
    table.add_column("figure", justify="right")
    place = Place(place_name)
    speed = simulation_speed(place, laser_name)
    table.add_row("frames of the rolling fan, simulated s per CPU s", f"{speed.with_fan:.0f}")
    table.add_row("bare mj_step, no fan, simulated s per CPU s", f"{speed.bare:.0f}")
    table.add_row("ratio", f"{speed.ratio:.2f}")
    table.add_row("fan against mj_multiRay, largest difference", f"{fan_difference_m(place):.1e} m")
    plain = open_floor()
    offset_mm, offset_percent = 1000 * straight_error_m(plain), 100 * turning_error(plain)
    table.add_row("5 m straight, ideal, truth against odometry", f"{offset_mm:.2f} mm")
    table.add_row("5 turns in place, ideal, truth against odometry", f"{offset_percent:.4f} %")
    for odometry in ("ideal", "as_built"):
        for is_clockwise in (False, True):
            x_mm, y_mm = 1000 * square_error_m(plain, odometry, is_clockwise=is_clockwise)
            way = "clockwise" if is_clockwise else "counter-clockwise"
            table.add_row(
                f"10 m square, {odometry}, {way}: end - start", f"{x_mm:.1f}, {y_mm:.1f} mm"
            )
    placed_mm, counts = kidnap_accuracy(place)
    table.add_row("20 kidnaps, wheels held: placed - commanded, largest", f"{placed_mm:.5f} mm")
    table.add_row("20 kidnaps, wheels held: encoders, largest", f"{counts} counts")
    console.print(table)


def open_floor() -> Place:
    """A floor to drive on, with nothing near."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "open_floor.xml"
        path.write_text(
            '<mujoco><worldbody><geom type="plane" size="50 50 0.1"/>'
            '<geom type="box" size="0.5 0.5 0.5" pos="40 40 0.5"/>'
            '<site name="start"/></worldbody></mujoco>'
        )
        return Place(path)


def simulation_speed(place: Place, laser_name: str) -> SpeedResult:
    """Driving circles, frames with noise taken, against the same robot without a fan.

    The best of some rounds each, taken in turns: what else runs on the machine only ever slows.
    """
    with_fan = Simulation(place, laser_name, rng=np.random.default_rng(0))
    bare = Simulation(place, None, rng=np.random.default_rng(0))
    steps = round(_SIM_S / bare.timestep_s)
    fan_s, bare_s = [], []
    for _ in range(_ROUNDS):
        for simulation in (with_fan, bare):
            simulation.reset()
            simulation.drive(0.1, 0.5)
        fan_s.append(_cpu_s(lambda: with_fan.run(_SIM_S)))
        bare_s.append(_cpu_s(lambda: mujoco.mj_step(bare.model, bare.data, nstep=steps)))
    return SpeedResult(_SIM_S / min(fan_s), _SIM_S / min(bare_s))


def fan_difference_m(place: Place) -> float:
    """Largest difference between the fan's beams and mj_multiRay, over 20 free poses [m]."""
    simulation, rng = Simulation(place, rng=np.random.default_rng(0)), np.random.default_rng(1)
    worst_m = 0.0
    for _ in range(20):
        simulation.reset(place.draw_free_pose(rng))
        simulation.next_frame()
        # the fan's beams were fired over 67 ms in which a robot at rest still sinks by nanometres
        mujoco.mj_sensorPos(simulation.model, simulation.data)
        fan_m, exact_m = simulation.fan_ranges_m(), simulation.true_ranges_m()
        is_hit = np.isfinite(exact_m)
        worst_m = max(worst_m, float(np.abs(fan_m[is_hit] - exact_m[is_hit]).max()))
    return worst_m


def straight_error_m(floor: Place) -> float:
    """Distance of the truth from the robot's own odometry after 5 m straight, ideal preset [m]."""
    simulation = _on(floor, "ideal")
    pilot = Pilot(simulation)
    _finish(pilot.follow(np.array([[5.0, 0.0]])))
    return float(np.hypot(*(simulation.truth().pose - pilot.pose)[:2]))


def turning_error(floor: Place) -> float:
    """Share of 5 turns in place by which truth and the robot's own odometry differ, ideal."""
    simulation = _on(floor, "ideal")
    pilot = Pilot(simulation)
    _finish(pilot.turn(5 * math.tau))
    return abs(math.remainder(simulation.truth().pose[2] - pilot.pose[2], math.tau)) / (
        5 * math.tau
    )


def square_error_m(floor: Place, odometry: str, *, is_clockwise: bool) -> np.ndarray:
    """(2,) where a square of 10 m, driven by the robot's own odometry, ends off its start [m]."""
    simulation = _on(floor, odometry)
    _finish(Pilot(simulation).follow(square(_SQUARE_SIDE_M, is_clockwise=is_clockwise)))
    return simulation.truth().pose[:2]


def kidnap_accuracy(place: Place) -> tuple[float, int]:
    """Largest distance from the command [mm] and of the encoders [counts] over 20 kidnaps."""
    simulation, rng = Simulation(place, rng=np.random.default_rng(0)), np.random.default_rng(2)
    distances_mm, counts = [], []
    for _ in range(20):
        simulation.reset(place.draw_free_pose(rng))
        done = kidnap(simulation, place.draw_free_pose(rng), wheels="held")
        distances_mm.append(1000 * np.hypot(*(done.placed - done.commanded)[:2]))
        counts.append(np.abs(done.ticks_after - done.ticks_before).max())
    return float(max(distances_mm)), int(max(counts))


def _on(floor: Place, odometry: str) -> Simulation:
    return Simulation(floor, None, odometry, rng=np.random.default_rng(0))


def _finish(frames: Iterator[object]) -> None:
    for _ in frames:
        pass


def _cpu_s(work: Callable[[], object]) -> float:
    started_s = time.process_time()
    work()
    return time.process_time() - started_s
