"""Laser range sensors: what one sweep looks at, when, and how wrong each range is.

Angles are in the laser's frame: 0 straight ahead, counter-clockwise, and increasing with the beam's
index whichever way the mirror turns. Ranges follow REP-117: +inf no return, -inf too close,
nan invalid.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from kitasap_sim.laser_changes import changed
from kitasap_sim.range_errors import disturb, mix_pixels

LOW_FRONT_M = (0.19, 0.0, 0.10)
"""Where Kitasap2 carries its laser: "in front of the bottom of the robot" (paper, Section 2)."""
ABOVE_WHEELS_M = (0.19, 0.0, 0.17)
"""Where a laser that sees 270 degrees must sit: lower, the tires would stand in its outer beams."""
ON_TOP_M = (0.0, 0.0, 0.40)
"""Where a laser that sees all around must sit: below, the robot itself would fill half of its view."""


@dataclass(frozen=True)
class LaserSpec:
    """One laser range sensor; `LASERS` has the ones that are sold.

    first_angle_rad, step_rad: direction of beam 0, and from each beam to the next [rad].
    period_s: a full turn of the mirror (of `interlace` mirror turns) [s].
    first_beam_s: from the start of the turn to the first beam fired [s].
    is_clockwise: the mirror turns clockwise, so the last index is fired first.
    interlace: the beams are taken in this many turns of the mirror, every interlace-th in each.
    range_min_m, range_max_m: nearer gives -inf, farther +inf; 0 and inf switch the limits off.
    resolution_m: ranges are multiples of it; 0 switches quantisation off.
    sigma_at_m: points (range [m], standard deviation [m]) of the noise, straight lines between,
        constant outside; () switches the noise off.
    dropout_rate: share of beams that come back invalid (nan); 0 switches dropouts off.
    mixed_pixel_rate: share of the beams at a range jump of over mixed_pixel_jump_m that give a
        range between the near and the far surface; 0 switches mixed pixels off.
    mount_m: origin in the robot's frame, z above the floor [m].
    range_bias_m: what every range reads too long, whatever the distance; 0 switches it off.
    """

    name: str
    beam_count: int
    first_angle_rad: float
    step_rad: float
    period_s: float
    first_beam_s: float = 0.0
    is_clockwise: bool = False
    interlace: int = 1
    range_min_m: float = 0.0
    range_max_m: float = math.inf
    resolution_m: float = 0.0
    sigma_at_m: tuple[tuple[float, float], ...] = ()
    dropout_rate: float = 0.0
    mixed_pixel_rate: float = 0.0
    mixed_pixel_jump_m: float = 0.1
    mount_m: tuple[float, float, float] = LOW_FRONT_M
    range_bias_m: float = 0.0

    def __post_init__(self) -> None:
        sizes = (self.beam_count, self.step_rad, self.period_s, self.interlace)
        if not all(math.isfinite(size) and size > 0 for size in sizes):
            raise ValueError(
                f"laser {self.name}: beam_count, step_rad, period_s and interlace must be positive"
            )
        if not 0 <= self.range_min_m < self.range_max_m or not self.resolution_m >= 0:
            raise ValueError(
                f"laser {self.name}: needs 0 <= range_min_m < range_max_m and resolution_m >= 0"
            )
        if not (0 <= self.dropout_rate <= 1 and 0 <= self.mixed_pixel_rate <= 1):
            raise ValueError(f"laser {self.name}: rates lie between 0 and 1")
        at_m, sigmas_m = [at for at, _ in self.sigma_at_m], [sigma for _, sigma in self.sigma_at_m]
        if at_m != sorted(set(at_m)) or not all(sigma > 0 for sigma in sigmas_m):
            raise ValueError(
                f"laser {self.name}: sigma_at_m needs increasing ranges and sigmas above 0"
            )
        if not self.mount_m[2] > 0:
            raise ValueError(f"laser {self.name}: mount_m lies {self.mount_m[2]} m above the floor")
        if not math.isfinite(self.range_bias_m):
            raise ValueError(f"laser {self.name}: range_bias_m must be a finite number")
        if (self.beam_count - 1) * self.step_rad > 2 * math.pi - 1e-9:
            raise ValueError(
                f"laser {self.name}: {self.beam_count} beams of {self.step_rad:.6f} rad "
                "are more than a full turn"
            )
        if self.delays_s().max() >= self.period_s:
            raise ValueError(f"laser {self.name}: the last beam fires after the period has ended")

    @property
    def angles_rad(self) -> np.ndarray:
        """(N,) direction of each beam in the laser's frame, increasing [rad]."""
        return self.first_angle_rad + self.step_rad * np.arange(self.beam_count)

    def delays_s(self) -> np.ndarray:
        """(N,) when each beam fires after the start of the period [s]."""
        order = np.arange(self.beam_count)
        if self.is_clockwise:
            order = order[::-1]
        mirror_turn_s = self.period_s / self.interlace
        in_turn_s = order * self.step_rad / (2 * math.pi) * mirror_turn_s
        return self.first_beam_s + (order % self.interlace) * mirror_turn_s + in_turn_s

    def sigma_m(self, ranges_m: np.ndarray) -> np.ndarray:
        """(N,) standard deviation of the noise at each range [m]; 0 where noise is switched off."""
        ranges_m = np.asarray(ranges_m, dtype=float)
        if not self.sigma_at_m:
            return np.zeros_like(ranges_m)
        if len(self.sigma_at_m) == 1:
            return np.full_like(ranges_m, self.sigma_at_m[0][1])
        result: np.ndarray = np.interp(ranges_m, *self._sigma_table)
        return result

    @cached_property
    def _sigma_table(self) -> np.ndarray:
        """(2, K) ranges and the standard deviations there [m]."""
        return np.array(self.sigma_at_m, dtype=float).reshape(-1, 2).T.copy()

    @cached_property
    def _errors(self) -> tuple[float, ...]:
        """What `disturb` asks for behind the noise."""
        errors = (self.range_bias_m, self.resolution_m, self.range_min_m, self.range_max_m)
        return (*map(float, errors), float(self.dropout_rate))

    def without_errors(self) -> "LaserSpec":
        """The same beams with every imperfection switched off, the range limits included."""
        return replace(
            self,
            range_min_m=0.0,
            range_max_m=math.inf,
            resolution_m=0.0,
            sigma_at_m=(),
            dropout_rate=0.0,
            mixed_pixel_rate=0.0,
            range_bias_m=0.0,
        )


def measured_ranges(
    spec: LaserSpec, true_ranges_m: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """(N,) what the sensor reports for true ranges (N,), +inf where the beam hits nothing [m].

    The order is the light's: mixed pixels where surfaces end, bias, noise as wide as at the
    unbiased range, quantisation, limits, dropouts. The same number of random values is drawn whatever
    happens to the beams.
    """
    ranges_m = np.array(true_ranges_m, dtype=float)
    if spec.mixed_pixel_rate > 0:
        chosen, share = rng.random((2, ranges_m.size))
        mix_pixels(ranges_m, chosen, share, spec.mixed_pixel_rate, spec.mixed_pixel_jump_m)
    disturb(
        ranges_m, rng.standard_normal(ranges_m.size), rng.random(ranges_m.size), spec._sigma_table,
        *spec._errors,
    )  # fmt: skip
    return ranges_m


_URG_STEP_RAD = 2 * math.pi / 1024
_DROPOUT_RATE = 0.002
_MIXED_PIXEL_RATE = 0.3
"""Assumed for all: one beam in 500 lost; three edges in ten mixed, as seen in Hokuyo and SICK logs."""

LASERS: dict[str, LaserSpec] = {
    spec.name: spec
    for spec in (
        # Hokuyo URG-04LX, as it answers SCIP 2.0's PP command: AMIN 44, AMAX 725, AFRT 384,
        # ARES 1024, 600 rpm, DMIN 20, DMAX 5600. Data sheet: +-10 mm to 1 m, +-1 % to 4.095 m,
        # here read as one sigma (severe), and held on to 5.6 m (assumed: no figure is given).
        LaserSpec(
            "urg_04lx", 682, (44 - 384) * _URG_STEP_RAD, _URG_STEP_RAD, 0.1, 0.1 * 44 / 1024,
            range_min_m=0.02, range_max_m=5.6, resolution_m=0.001,
            sigma_at_m=((1.0, 0.010), (5.6, 0.056)), dropout_rate=_DROPOUT_RATE, mixed_pixel_rate=_MIXED_PIXEL_RATE,
        ),
        # Hokuyo UTM-30LX data sheet: 270 degrees by 0.25, 25 ms, 0.1 to 30 m,
        # repeated accuracy sigma < 10 mm to 10 m and < 30 mm to 30 m.
        LaserSpec(
            "utm_30lx", 1081, math.radians(-135), math.radians(0.25), period_s=0.025, first_beam_s=0.025 / 8,
            range_min_m=0.1, range_max_m=30.0, resolution_m=0.001,
            sigma_at_m=((10.0, 0.010), (30.0, 0.030)), mount_m=ABOVE_WHEELS_M, dropout_rate=_DROPOUT_RATE, mixed_pixel_rate=_MIXED_PIXEL_RATE,
        ),
        # Hokuyo UST-10LX data sheet: 270 degrees by 0.25, 25 ms, 0.06 to 10 m, +-40 mm,
        # repeatability sigma < 30 mm; 10 mm assumed as typical indoors on bright walls.
        LaserSpec(
            "ust_10lx", 1081, math.radians(-135), math.radians(0.25), period_s=0.025, first_beam_s=0.025 / 8,
            range_min_m=0.06, range_max_m=10.0, resolution_m=0.001,
            sigma_at_m=((10.0, 0.010),), mount_m=ABOVE_WHEELS_M, dropout_rate=_DROPOUT_RATE, mixed_pixel_rate=_MIXED_PIXEL_RATE,
        ),
        # SICK LMS200: 75 turns a second, 180 degrees by 0.5 interlaced from two of them,
        # mm mode to 8.191 m, statistical error 5 mm (one sigma).
        LaserSpec(
            "lms200", 361, math.radians(-90), math.radians(0.5), period_s=2 / 75, interlace=2,
            range_min_m=0.0, range_max_m=8.191, resolution_m=0.001,
            sigma_at_m=((8.0, 0.005),), dropout_rate=_DROPOUT_RATE, mixed_pixel_rate=_MIXED_PIXEL_RATE,
        ),
        # SICK LMS1xx: 270 degrees by 0.5 at 50 Hz, 0.5 to 20 m, statistical error 12 mm.
        LaserSpec(
            "lms1xx", 541, math.radians(-135), math.radians(0.5), period_s=0.02, first_beam_s=0.02 / 8,
            range_min_m=0.5, range_max_m=20.0, resolution_m=0.001,
            sigma_at_m=((20.0, 0.012),), mount_m=ABOVE_WHEELS_M, dropout_rate=_DROPOUT_RATE, mixed_pixel_rate=_MIXED_PIXEL_RATE,
        ),
        # SICK TiM571: 270 degrees by 1/3 at 15 Hz, 0.05 to 25 m, statistical error 20 mm.
        LaserSpec(
            "tim571", 811, math.radians(-135), math.radians(1 / 3), period_s=1 / 15, first_beam_s=1 / 120,
            range_min_m=0.05, range_max_m=25.0, resolution_m=0.001,
            sigma_at_m=((25.0, 0.020),), mount_m=ABOVE_WHEELS_M, dropout_rate=_DROPOUT_RATE, mixed_pixel_rate=_MIXED_PIXEL_RATE,
        ),
        # Slamtec RPLIDAR A1: 360 samples at 5.5 Hz, clockwise, 0.15 to 12 m, resolution
        # < 0.5 mm below 1.5 m and < 1 % of the range, here read as one sigma.
        LaserSpec(
            "rplidar_a1", 360, math.radians(-180), math.radians(1.0), period_s=1 / 5.5, is_clockwise=True,
            range_min_m=0.15, range_max_m=12.0, resolution_m=0.00025,
            sigma_at_m=((0.05, 0.0005), (12.0, 0.12)), mount_m=ON_TOP_M, dropout_rate=_DROPOUT_RATE, mixed_pixel_rate=_MIXED_PIXEL_RATE,
        ),
        # Slamtec RPLIDAR A2: 400 samples at 10 Hz, clockwise, 0.15 to 12 m, 1 % of the range.
        LaserSpec(
            "rplidar_a2", 400, math.radians(-180), math.radians(0.9), period_s=0.1, is_clockwise=True,
            range_min_m=0.15, range_max_m=12.0, resolution_m=0.00025,
            sigma_at_m=((0.05, 0.0005), (12.0, 0.12)), mount_m=ON_TOP_M, dropout_rate=_DROPOUT_RATE, mixed_pixel_rate=_MIXED_PIXEL_RATE,
        ),
        # LDROBOT LD06: 4500 samples a second at 10 Hz, clockwise, 0.02 to 12 m, sigma 10 mm.
        LaserSpec(
            "ld06", 450, math.radians(-180), math.radians(0.8), period_s=0.1, is_clockwise=True,
            range_min_m=0.02, range_max_m=12.0, resolution_m=0.001,
            sigma_at_m=((12.0, 0.010),), mount_m=ON_TOP_M, dropout_rate=_DROPOUT_RATE, mixed_pixel_rate=_MIXED_PIXEL_RATE,
        ),
    )
}  # fmt: skip
"""The presets by name; where a figure is not in the data sheet, the comment says "assumed"."""


def laser(name: str) -> LaserSpec:
    """The preset of that name, or one that differs from it: `urg_04lx:beams=181:range_noise=2`.

    Raises ValueError, naming those there are, if there is none.
    """
    sold, *changes = name.split(":")
    if sold not in LASERS:
        raise ValueError(f"no laser called '{sold}'; there are: {', '.join(LASERS)}")
    return changed(LASERS[sold], name, changes)
