"""Write your own place as MJCF, drive the robot in it, lift it away, and let it find itself.

`python -m experiments.examples.own_place`. Saved as a file, the place works in every command, too:
`kitasap run kidnap --poses anywhere --place my_room.xml`.
"""

import math
import tempfile
from pathlib import Path

import numpy as np

from experiments.assumptions import assumed_laser
from experiments.sources import MeasurementSource
from kitasap_sim import Pilot, Simulation, kidnap
from slam import SE2, Estimate, KnownMap, SegmentMap

# a room of 5 x 4 m with a cupboard and a pillar: static geoms, sizes are halves [m]; the floor comes
# by itself, free space is found from the geometry, and the site says where the robot starts
MY_ROOM = """
<mujoco>
  <worldbody>
    <geom type="box" size="2.6 0.05 0.5" pos="2.5 -0.05 0.5"/>
    <geom type="box" size="2.6 0.05 0.5" pos="2.5  4.05 0.5"/>
    <geom type="box" size="0.05 2.1 0.5" pos="-0.05 2 0.5"/>
    <geom type="box" size="0.05 2.1 0.5" pos=" 5.05 2 0.5"/>
    <geom type="box" size="0.5 0.2 0.4" pos="4 0.2 0.4"/>
    <geom type="cylinder" size="0.15 0.5" pos="3.2 2.6 0.5"/>
    <site name="start" pos="1 1 0"/>
  </worldbody>
</mujoco>
"""
CARRIED_TO = np.array([4.2, 3.2, math.pi / 2])  # x, y [m], heading [rad]


def main() -> Estimate:
    """What the robot believes in the end, where it was set down at CARRIED_TO."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "my_room.xml"
        path.write_text(MY_ROOM)
        robot = Simulation(path, "urg_04lx", "as_built", rng=np.random.default_rng(0))
    laser = robot.laser
    assert laser is not None

    # what the robot is told: the walls at the height of its laser, and where that sits
    walls = SegmentMap.known(robot.place.map_at(laser.mount_m[2]).segments_m, is_one_sided=True)
    known = KnownMap.of_walls(walls, assumed_laser("urg_04lx"))
    start, mount = SE2.from_array(robot.truth().pose), SE2(*laser.mount_m[:2], 0.0)
    localizer = known.localizer("limit", start, mount)
    source = MeasurementSource(laser, robot.wheel_ticks())

    for frame in Pilot(robot).follow(np.array([[2.4, 1.0], [2.4, 2.0]])):
        estimate = localizer.update(source.measurement(frame))
    tell("driven", robot, estimate)

    kidnap(robot, CARRIED_TO)  # the wheels are held: the encoders tell nothing of it
    for look in range(3):
        estimate = localizer.update(source.measurement(robot.next_frame()))
        tell(f"carried away, look {look + 1}", robot, estimate)
    return estimate


def tell(what: str, robot: Simulation, estimate: Estimate) -> None:
    """Where the robot is, what it believes, and by how much it errs."""
    x, y, _ = robot.truth().pose
    off_mm = 1e3 * math.hypot(estimate.T_map_base.x - x, estimate.T_map_base.y - y)
    believed = f"{estimate.verdict.status.value}, {off_mm:.1f} mm off"
    print(f"{what}: truly at {x:.2f}, {y:.2f} m; {believed}", *estimate.verdict.reasons[:1])


if __name__ == "__main__":
    main()
