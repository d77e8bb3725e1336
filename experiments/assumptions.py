"""What the estimators assume of each laser, and of where it is: read from the data sheets.

The simulator draws its noise from `kitasap_sim.laser`. That the two agree is how a well-informed
user would set things up; `--mismatch` makes them differ.
"""

from dataclasses import replace

from kitasap_sim.laser import LaserSpec, laser
from kitasap_sim.robot import KITASAP2
from slam.laser_model import LaserModel
from slam.range_noise import RangeNoise

ASSUMED_LASERS: dict[str, LaserModel] = {
    # Hokuyo: +-10 mm to 1 m, +-1 % beyond, as one sigma
    "urg_04lx": LaserModel(RangeNoise(((1.0, 0.010), (5.6, 0.056))), 0.02, 5.6),
    # Hokuyo: sigma < 10 mm to 10 m, < 30 mm to 30 m
    "utm_30lx": LaserModel(RangeNoise(((10.0, 0.010), (30.0, 0.030))), 0.1, 30.0),
    "ust_10lx": LaserModel(RangeNoise(((10.0, 0.010),)), 0.06, 10.0),
    # SICK: statistical errors, one sigma
    "lms200": LaserModel(RangeNoise(((8.0, 0.005),)), 0.0, 8.191),
    "lms1xx": LaserModel(RangeNoise(((20.0, 0.012),)), 0.5, 20.0),
    "tim571": LaserModel(RangeNoise(((25.0, 0.020),)), 0.05, 25.0),
    # Slamtec: 1 % of the range, as one sigma; half a millimetre at the least
    "rplidar_a1": LaserModel(RangeNoise(((0.05, 0.0005), (12.0, 0.12))), 0.15, 12.0),
    "rplidar_a2": LaserModel(RangeNoise(((0.05, 0.0005), (12.0, 0.12))), 0.15, 12.0),
    "ld06": LaserModel(RangeNoise(((12.0, 0.010),)), 0.02, 12.0),
}


_LEAN_RAD = (3.5e-4, 5e-5)
"""How far the robot is thought to lean forward and aside: wheels whose radius is known to 0.1 %, and to
0.02 % of each other, on a caster 0.22 m behind them."""


def assumed_mount_sigma(spec: LaserSpec) -> tuple[float, float, float]:
    """(m, m, rad) to which the place of a laser on the robot is thought to be known.

    What leans forward has its mast ahead of its axle.
    """
    above_m = abs(spec.mount_m[2] - KITASAP2.axle_height_m)
    return above_m * _LEAN_RAD[0], above_m * _LEAN_RAD[1], 0.0


def assumed_laser(name: str) -> LaserModel:
    """The model of a laser by name. Raises ValueError, naming those there are, if there is none.

    What is changed of one that is sold (`urg_04lx:range_noise=2`) its user knows as well: the model
    has its noise and its limits.
    """
    sold = name.partition(":")[0]
    if sold not in ASSUMED_LASERS:
        raise ValueError(f"no laser called '{sold}'; there are: {', '.join(ASSUMED_LASERS)}")
    model = ASSUMED_LASERS[sold]
    return model if name == sold else _assumed_of(laser(name), laser(sold), model)


def _assumed_of(spec: LaserSpec, sold: LaserSpec, model: LaserModel) -> LaserModel:
    """The model of the laser that is sold, as far as the other differs from that."""
    if spec.sigma_at_m != sold.sigma_at_m:
        factor = spec.sigma_at_m[0][1] / sold.sigma_at_m[0][1]
        noise = RangeNoise(tuple((at, factor * s) for at, s in model.noise.sigma_at_m))
        model = replace(model, noise=noise)
    if spec.range_min_m != sold.range_min_m:
        model = replace(model, range_min_m=spec.range_min_m)
    if spec.range_max_m != sold.range_max_m:
        model = replace(model, range_max_m=spec.range_max_m)
    return model
