"""Localise your own log: map a drive, keep the map, and follow a drive on it from an unknown start.

`python -m experiments.examples.localise_own_log [LOG [MAP]]`; the log is a CARMEN file, a ROS bag or
encoder ticks. MAP is a `map.kitasap`, which is read; without one the log is mapped first. Without a
log it is the piece of a real building that the tests use.
"""

import sys
import tempfile
from pathlib import Path

from slam import Localizer, Mapper, SlamMap, read_log, read_slam_map, write_slam_map

EXCERPT = Path(__file__).parents[2] / "tests" / "data" / "fr101-excerpt.clf.gz"


def mapped(log_path: Path, map_path: Path) -> None:
    """Maps the drive, and keeps the map in a file."""
    log = read_log(log_path)
    mapper = Mapper(log.T_base_laser)  # where the laser sits on the robot, as the log has it
    for measurement in log.measurements():  # a scan, and the wheels' motion since the one before
        mapper.update(measurement)
    slam_map = mapper.finish()  # loops closed, all poses adjusted
    print(f"mapped {log.scan_count} scans of {log.name}: {len(slam_map.points)} points on walls")
    print("the map is good" if slam_map.verdict.is_good else "; ".join(slam_map.verdict.reasons))
    write_slam_map(map_path, slam_map)


def followed(log_path: Path, slam_map: SlamMap) -> Localizer:
    """Follows the drive on a map; says so whenever the robot thinks otherwise of its pose."""
    log = read_log(log_path)
    localizer = slam_map.localizer(log.T_base_laser)  # start=SE2(x, y, theta), if it is known
    status = None
    for index, measurement in enumerate(log.measurements()):
        estimate = localizer.update(measurement)
        if estimate.verdict.status is not status:
            status, pose = estimate.verdict.status, estimate.T_map_base
            where = f"x {pose.x:6.2f} m, y {pose.y:6.2f} m, heading {pose.theta:5.2f} rad"
            print(f"scan {index + 1:4}: {status.value:8} {where}", *estimate.verdict.reasons[:1])
    return localizer


def main(log_path: Path = EXCERPT, map_path: Path | None = None) -> Localizer:
    """The localizer after the last scan."""
    with tempfile.TemporaryDirectory() as folder:
        if map_path is None:
            map_path = Path(folder) / "map.kitasap"
            mapped(log_path, map_path)
        return followed(log_path, read_slam_map(map_path))


if __name__ == "__main__":
    try:
        main(*map(Path, sys.argv[1:3]))
    except (ValueError, OSError, ImportError) as error:  # no log, no map: one line tells why
        print(f"localise_own_log: {error}", file=sys.stderr)
        sys.exit(2)
