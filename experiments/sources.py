"""From what the simulated robot's sensors say to what `slam` understands. Truth stays behind."""

import numpy as np

from kitasap_sim.laser import LaserSpec
from kitasap_sim.robot import KITASAP2
from kitasap_sim.simulation import SensorFrame
from slam.measurements import LaserScan, Measurement
from slam.odometry import DifferentialDrive, OdometryNoise

DRIVE = DifferentialDrive(
    wheel_radius_m=(KITASAP2.wheel_radius_m, KITASAP2.wheel_radius_m),
    track_m=KITASAP2.track_m,
    ticks_per_turn=KITASAP2.ticks_per_turn,
)
"""The geometry that the robot believes in, not the one it was built with."""


ODOMETRY_NOISE = OdometryNoise(
    wheel_travel_m_per_sqrt_m=0.0003,
    lateral_m_per_sqrt_m=0.0003,
    heading_rad_per_sqrt_turn=0.0015,
    floor_m=2e-5,
    floor_rad=2e-5,
)
"""What is assumed of Kitasap2's wheels beside their constants, which the filter learns. chosen: one
and a half times what was seen over 40 s on its tracks, as built and on a rough floor: 0.7 mm after
1.1 m, 1.9 mrad after two thirds of a turn; tires that creep when the robot speeds up."""

_SMOOTH_FLOOR = OdometryNoise(
    wheel_travel_m_per_sqrt_m=0.000005,
    lateral_m_per_sqrt_m=0.00001,
    heading_rad_per_sqrt_turn=0.00003,
    pivot_m_per_sqrt_turn=0.0005,
    floor_m=1e-6,
    floor_rad=2e-6,
)
"""The same on a smooth floor, beside the constants, as seen by a filter that is told the true pose
now and then: round circles at 0.2 m/s and 0.5 rad/s 0.006 mm ahead and aside and 0.017 mrad after
1 s, 0.02 mm and 0.01 mrad after 4 s. From scan to scan it assumes less than what is seen, 5 um and
15 urad: encoders count whole ticks, and what one motion lacks of a tick the next one has. On the
spot, after a quarter of a radian: 0.11 mm and 0.13 mrad."""

FLOOR_NOISE = {"ideal": _SMOOTH_FLOOR, "as_built": _SMOOTH_FLOOR, "rough_floor": ODOMETRY_NOISE}
"""What is assumed of the wheels on the floor that each odometry preset drives on."""


class MeasurementSource:
    """Turns frames into measurements; remembers where the encoders were."""

    def __init__(
        self, laser: LaserSpec, wheel_ticks: np.ndarray, noise: OdometryNoise = ODOMETRY_NOISE
    ) -> None:
        """wheel_ticks: (2,) counts where the odometry starts. noise: by default of any floor."""
        self._laser = laser
        self._ticks = np.array(wheel_ticks)
        self._noise = noise

    def measurement(self, frame: SensorFrame) -> Measurement:
        """The scan with the motion since the last measurement."""
        ticks_delta = frame.wheel_ticks - self._ticks
        self._ticks = np.array(frame.wheel_ticks)
        return Measurement(
            time_s=frame.time_s,
            motion=DRIVE.motion(ticks_delta),
            scan=LaserScan(
                time_s=frame.time_s,
                angles_rad=self._laser.angles_rad,
                ranges_m=frame.ranges_m,
                beam_times_s=frame.beam_times_s,
            ),
            motion_covariance=self._noise.covariance(DRIVE, ticks_delta),
        )
