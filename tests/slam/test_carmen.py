"""CARMEN logs and their traps."""

import codecs
import gzip
import math
import os
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from slam.files.map_files import read_map
from slam.metrics import read_relations
from slam.pose_graph import read_g2o
from slam.readers.carmen import CarmenConfig, read_carmen
from slam.readers.lines import text_lines
from slam.readers.log import MotionSinceScan
from slam.readers.recognition import read_log
from slam.se2 import SE2
from slam.trajectory import read_tum
from tests.slam.logs import shared_log

EXCERPT = Path(__file__).parents[1] / "data" / "fr101-excerpt.clf.gz"


def odom(x: float, y: float, theta: float, time_s: float) -> str:
    """An ODOM line."""
    return f"ODOM {x} {y} {theta} 0 0 0 {time_s} nohost {time_s + 0.5}"


def flaser(ranges: list[float], pose: SE2, time_s: float, mounting: SE2 | None = None) -> str:
    """A FLASER line; the logger's stamp differs from the sensor's."""
    sensor = pose @ (mounting or SE2.identity())
    numbers = " ".join(map(str, ranges))
    poses = f"{sensor.x} {sensor.y} {sensor.theta} {pose.x} {pose.y} {pose.theta}"
    return f"FLASER {len(ranges)} {numbers} {poses} {time_s} nohost {time_s + 0.5}"


def robotlaser(ranges: list[float], time_s: float) -> str:
    """A ROBOTLASER1 line of a laser of one degree, at the origin."""
    facts, listed = (
        f"0 -1.570796 3.141593 0.017453 80 0.01 0 {len(ranges)}",
        " ".join(map(str, ranges)),
    )
    return " ".join(f"ROBOTLASER1 {facts} {listed} 0 {'0 ' * 11} {time_s} nohost {time_s}".split())


def written(tmp_path: Path, *lines: str) -> Path:
    """A plain log of these lines."""
    path = tmp_path / "a.clf"
    path.write_text("\n".join(lines) + "\n")
    return path


RANGES = [1.0] * 179 + [1.1]  # all alike would be no return


@pytest.mark.parametrize(
    ("count", "last_deg", "step_deg"), [(180, 89.0, 1.0), (360, 89.5, 0.5), (361, 90.0, 0.5)]
)
def test_beams_start_at_the_right_and_end_where_their_number_says(
    tmp_path, count, last_deg, step_deg
):
    path = written(tmp_path, flaser([1.0] * count, SE2.identity(), 1.0))
    angles_deg = np.degrees(next(read_carmen(path).measurements()).scan.angles_rad)
    assert angles_deg[0] == pytest.approx(-90.0)
    assert angles_deg[-1] == pytest.approx(last_deg)
    np.testing.assert_allclose(np.diff(angles_deg), step_deg, atol=1e-9)


@pytest.mark.parametrize(
    ("count", "first_deg", "last_deg"),
    [
        *((101, -50.0, 50.0), (270, -135.0, 134.0), (513, -90.0, 90.0), (541, -135.0, 135.0)),
        *((682, -119.7, 119.7), (769, -135.0, 135.0), (1080, -135.0, 134.75)),
    ],
)
def test_beams_of_wide_sensors_are_told_by_their_number(tmp_path, count, first_deg, last_deg):
    path = written(tmp_path, flaser([1.0] * count, SE2.identity(), 1.0))
    angles_deg = np.degrees(next(read_carmen(path).measurements()).scan.angles_rad)
    assert angles_deg[0] == pytest.approx(first_deg, abs=0.01)
    assert angles_deg[-1] == pytest.approx(last_deg, abs=0.01)


def test_unusual_number_of_beams_needs_its_step(tmp_path):
    path = written(tmp_path, flaser([1.0] * 7, SE2.identity(), 1.0))
    said = (
        r"/a.clf line 1: .* its 7 beams point, .*: PARAM laser_front_laser_resolution 0.5 nohost 0$"
    )
    with pytest.raises(ValueError, match=said):
        read_carmen(path)
    config = CarmenConfig(first_beam_rad=-0.3, step_rad=0.1)
    scan = next(read_carmen(path, config).measurements()).scan
    assert scan.angles_rad[-1] == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("count", "step", "first_deg"),
    [(91, "2.0", -90.0), (640, "0.25", -80.0), (1440, "0.25", -180.0)],
)
def test_unusual_number_of_beams_goes_by_the_parameter(tmp_path, count, step, first_deg):
    told = f"PARAM laser_front_laser_resolution {step} nohost 0"
    path = written(tmp_path, told, flaser([1.0] * count, SE2.identity(), 1.0))
    angles_deg = np.degrees(next(read_carmen(path).measurements()).scan.angles_rad)
    np.testing.assert_allclose(angles_deg, first_deg + float(step) * np.arange(count), atol=1e-9)


@pytest.mark.parametrize(
    ("count", "step"), [(360, "1"), (361, "1.0"), (720, "0.5"), (721, "0.5"), (180, "2")]
)
def test_usual_number_of_beams_that_the_parameter_makes_a_turn_is_one(tmp_path, count, step):
    # 360 beams half a degree apart, as a SICK has them: a map 7 m off, and failed
    told = f"PARAM laser_front_laser_resolution {step} nohost 0"
    path = written(tmp_path, told, flaser([1.0] * count, SE2.identity(), 1.0))
    angles_deg = np.degrees(next(read_carmen(path).measurements()).scan.angles_rad)
    np.testing.assert_allclose(np.diff(angles_deg), float(step), atol=1e-9)
    assert angles_deg[0] == pytest.approx(-180.0)


@pytest.mark.parametrize("step", ["0.5", "0.25", "2", "half"])
def test_usual_number_of_beams_is_believed_else(tmp_path, step):
    told = f"PARAM laser_front_laser_resolution {step} nohost 0"
    path = written(tmp_path, told, flaser([1.0] * 360, SE2.identity(), 1.0))
    angles_deg = np.degrees(next(read_carmen(path).measurements()).scan.angles_rad)
    np.testing.assert_allclose(angles_deg, -90.0 + 0.5 * np.arange(360), atol=1e-9)


def test_scans_without_beams_see_nothing(tmp_path):
    # whole logs were refused for them, by ROBOTLASER1 in words that were not true
    whole, none = (flaser(ranges, SE2.identity(), 1.0) for ranges in (RANGES, []))
    found = [m.scan for m in read_carmen(written(tmp_path, whole, none)).measurements()]
    assert [len(scan.ranges_m) for scan in found] == [180, 0]
    robot = robotlaser(RANGES, 1.0), robotlaser([], 2.0)
    found = [m.scan for m in read_carmen(written(tmp_path, *robot)).measurements()]
    assert [len(scan.ranges_m) for scan in found] == [180, 0]


def test_a_byte_order_mark_hides_no_scan(tmp_path):
    path = tmp_path / "a.clf"
    line = flaser(RANGES, SE2.identity(), 1.0)
    path.write_bytes(codecs.BOM_UTF8 + f"{line}\n{line}\n".encode())
    assert read_carmen(path).scan_count == 2


def test_lines_of_other_lasers_that_are_not_taken_are_told(tmp_path):
    flaser_line, other = flaser(RANGES, SE2.identity(), 1.0), robotlaser(RANGES, 2.0)
    path = written(tmp_path, flaser_line, other, flaser_line)
    assert read_carmen(path).notes == ("FLASER is taken, and not 1 ROBOTLASER1",)
    assert read_carmen(written(tmp_path, flaser_line)).notes == ()


def test_a_stray_line_of_another_laser_is_not_the_log(tmp_path):
    # one scan was mapped, 691 were not, and the map was good
    stray, lines = (
        flaser(RANGES, SE2.identity(), 1.0),
        [robotlaser(RANGES, 2.0 + k) for k in range(12)],
    )
    log = read_carmen(written(tmp_path, stray, *lines))
    assert log.scan_count == 12
    assert log.notes == ("ROBOTLASER1 is taken, and not 1 FLASER",)


def test_parameters_that_have_the_laser_elsewhere_than_its_poses_are_told(tmp_path):
    told = "PARAM robot_frontlaser_offset 0.3 nohost 0"
    log = read_carmen(written(tmp_path, told, flaser(RANGES, SE2.identity(), 1.0)))
    assert log.T_base_laser == SE2.identity()
    assert "0 m ahead, the PARAM lines 0.3 m: the poses are believed" in log.notes[0]
    same = flaser(RANGES, SE2.identity(), 1.0, SE2(0.3, 0.0, 0.0))
    assert read_carmen(written(tmp_path, told, same)).notes == ()


@pytest.mark.parametrize("step", ["0", "-1.0", "nan", "60.1", "half"])
def test_parameter_that_makes_no_fan_is_refused_where_it_is_needed(tmp_path, step):
    told = f"PARAM laser_front_laser_resolution {step} nohost 0"
    path = written(tmp_path, told, flaser([1.0] * 7, SE2.identity(), 1.0))
    with pytest.raises(ValueError, match=rf"/a.clf line 2: 7 beams {step} degrees apart"):
        read_carmen(path)
    # those of SICK units are known, whatever the parameter says
    assert read_carmen(written(tmp_path, told, flaser(RANGES, SE2.identity(), 1.0))).scan_count == 1


def test_no_return_values_are_infinite_and_what_is_not_above_zero_invalid(tmp_path):
    ranges = [81.83, 81.91, 50.0, 49.99, 50.01, 79.5, -1.0, 0.0] + [1.0] * 172
    path = written(tmp_path, flaser(ranges, SE2.identity(), 1.0))
    found = next(read_carmen(path).measurements()).scan.ranges_m[:8]
    np.testing.assert_equal(found, [*[np.inf] * 3, 49.99, 50.01, 79.5, np.nan, np.nan])


def test_mounting_is_the_sensor_seen_from_the_odometry(tmp_path):
    mounting = SE2(-0.04, 0.0, 0.0)
    lines = [
        flaser(RANGES, SE2(1.0, 2.0, 1.5), 1.0, mounting),
        flaser(RANGES, SE2(3.0, 2.0, -2.0), 2.0, mounting),
    ]
    found = read_carmen(written(tmp_path, *lines)).T_base_laser
    np.testing.assert_allclose(found.as_array(), [-0.04, 0.0, 0.0], atol=1e-6)


def test_sensor_that_moves_on_the_robot_needs_its_mounting(tmp_path):
    lines = [
        flaser(RANGES, SE2.identity(), 1.0, SE2(0.1, 0.0, 0.0)),
        flaser(RANGES, SE2.identity(), 2.0, SE2(0.2, 0.0, 0.0)),
    ]
    path = written(tmp_path, *lines)
    with pytest.raises(ValueError, match="give T_base_laser"):
        read_carmen(path)
    assert read_carmen(path, CarmenConfig(T_base_laser=SE2(0.1, 0, 0))).T_base_laser.x == 0.1


def test_motion_goes_over_all_odometry_since_the_last_scan(tmp_path):
    # out and back between the scans: the ends alone would show no way, the covariance must
    path = written(
        tmp_path,
        flaser(RANGES, SE2.identity(), 1.0),
        odom(2.0, 0.0, 0.0, 1.2),
        odom(0.5, 0.0, 0.1, 1.4),
        flaser(RANGES, SE2(0.5, 0.0, 0.1), 1.4),
    )
    first, second = read_carmen(path).measurements()
    assert first.motion == SE2.identity()
    np.testing.assert_allclose(second.motion.as_array(), [0.5, 0.0, 0.1], atol=1e-12)
    # 3.5 m at 5 cm per root metre
    assert second.motion_covariance[0, 0] > 0.05**2 * 3.4


def test_order_of_the_lines_stands_where_the_stamps_go_back(tmp_path):
    path = written(
        tmp_path,
        flaser(RANGES, SE2(0.0, 0.0, 0.0), 10.0),
        flaser(RANGES, SE2(1.0, 0.0, 0.0), 9.0),
        flaser(RANGES, SE2(2.0, 0.0, 0.0), 11.0),
    )
    measurements = list(read_carmen(path).measurements())
    assert [m.time_s for m in measurements] == [10.0, 9.0, 11.0]
    assert [m.motion.x for m in measurements] == [0.0, 1.0, 1.0]


def test_stamp_is_the_sensors_and_not_the_loggers(tmp_path):
    path = written(tmp_path, flaser(RANGES, SE2.identity(), 976052857.25))
    assert next(read_carmen(path).measurements()).time_s == 976052857.25


def test_comments_parameters_blank_and_foreign_lines_are_passed_over(tmp_path):
    path = written(
        tmp_path,
        "# FLASER 3 1 2 3",
        "",
        "PARAM robot_frontlaser_offset 0.0 nohost 0",
        "NEFF 3 4",
        flaser(RANGES, SE2.identity(), 1.0),
    )
    assert read_carmen(path).scan_count == 1


def test_gzip_is_told_from_the_content_and_not_from_the_name(tmp_path):
    text = flaser(RANGES, SE2.identity(), 1.0).encode()
    (tmp_path / "a.clf").write_bytes(gzip.compress(text))
    (tmp_path / "b.gz").write_bytes(text)
    assert read_carmen(tmp_path / "a.clf").scan_count == 1
    assert read_carmen(tmp_path / "b.gz").scan_count == 1


GOOD = flaser(RANGES, SE2.identity(), 1.0)


@pytest.mark.parametrize(
    ("last_line", "message"),
    [
        (GOOD.replace("180 1.0", "180"), "FLASER announces 180 ranges, found 179"),
        (GOOD[:200], r"FLASER announces 180 ranges, found \d+"),
        ("FLASER", "FLASER announces no number of ranges, found 0"),
        ("FLASER 1.", r"FLASER announces 1\. ranges, found 0"),
        ("ODOM 1.0 2.0 0.", "ODOM has 10 fields, found 4"),
        (GOOD.replace("180 1.0", "180 1.0x"), "expected a number, found '1.0x'"),
        (odom(math.nan, 0.0, 0.0, 1.0), "a pose or a stamp is not finite"),
        (odom(1e300, 0.0, 0.0, 1.0), r"a pose of 1e\+300 0 0; expected metres and radians, .*"),
        (flaser(RANGES, SE2(0.0, -1e9, 0.0), 1.0), r"a pose of 0 -1e\+09 0; expected metres .*"),
    ],
)
def test_broken_line_is_named_in_one_line(tmp_path, last_line, message):
    path = written(tmp_path, "# comment", GOOD, last_line)
    with pytest.raises(ValueError, match=rf"/a.clf line 3: {message}$"):
        read_carmen(path)


def test_log_without_a_scan_is_refused(tmp_path):
    for lines in ([odom(0, 0, 0, 1)], [""], ["just some text"]):
        with pytest.raises(
            ValueError,
            match=r"/a.clf: no FLASER, ROBOTLASER1 or RAWLASER line, so no scan to work with$",
        ):
            read_carmen(written(tmp_path, *lines))


def test_cut_gzip_is_refused(tmp_path):
    whole = EXCERPT.read_bytes()
    for cut in (whole[: len(whole) // 2], whole[:-4], whole[:3]):
        (tmp_path / "a.gz").write_bytes(cut)
        with pytest.raises(
            ValueError, match=r"/a.gz: the gzip file is cut or damaged.*$"
        ) as caught:
            read_carmen(tmp_path / "a.gz")
        assert "\n" not in str(caught.value)


def test_gzip_of_a_thousand_times_its_size_is_refused_before_it_is_read(tmp_path):
    line = b"ODOM 0 0 0 0 0 0 1 h 1\n"
    (tmp_path / "a.gz").write_bytes(gzip.compress(line * 1_000_000))
    with pytest.raises(ValueError, match=r"/a.gz: unpacks to more than 200 times its size"):
        list(text_lines(tmp_path / "a.gz", "a CARMEN log"))
    # as many lines as they are, not packed, are read
    (tmp_path / "a.clf").write_bytes(line * 200_000)
    assert sum(1 for _ in text_lines(tmp_path / "a.clf", "a CARMEN log")) == 200_000


@pytest.mark.parametrize("read", [read_log, read_tum, read_g2o, read_relations, read_map])
def test_pipe_is_refused_and_not_waited_for(tmp_path, read):
    os.mkfifo(tmp_path / "a.yaml")
    with pytest.raises(ValueError, match=r"/a.yaml: a pipe or a device; expected a file$"):
        read(tmp_path / "a.yaml")


def test_damaged_gzip_is_refused(tmp_path):
    damaged = bytearray(EXCERPT.read_bytes())
    damaged[len(damaged) // 2] ^= 0xFF
    (tmp_path / "a.gz").write_bytes(damaged)
    # the damage shows as a bad block, a bad checksum or a line that is no longer one
    with pytest.raises(ValueError, match=r"/a.gz[^\n]*$"):
        read_carmen(tmp_path / "a.gz")


def test_comment_of_another_alphabet_is_no_binary(tmp_path):
    whole = gzip.decompress(EXCERPT.read_bytes())
    (tmp_path / "a.clf").write_bytes(b"# taken in the caf\xe9\n" + whole)
    assert read_carmen(tmp_path / "a.clf").scan_count == read_carmen(EXCERPT).scan_count


@pytest.mark.parametrize("name", ["ODOM", "FLASER"])
def test_stamp_in_nanoseconds_is_refused_with_its_line(tmp_path, name):
    lines = gzip.decompress(EXCERPT.read_bytes()).decode().splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith(name))
    fields = lines[at].split()
    fields[-3] = "1.1e18"
    lines[at] = " ".join(fields)
    (tmp_path / "a.clf").write_text("\n".join(lines) + "\n")
    with pytest.raises(
        ValueError, match=rf"/a.clf line {at + 1}: a stamp of 1.1e\+18; expected sec"
    ):
        read_carmen(tmp_path / "a.clf")


@pytest.mark.parametrize("content", [bytes(range(256)) * 20, b"\xff\xfe\xfd\n" * 10])
def test_binary_file_is_refused(tmp_path, content):
    (tmp_path / "a.bin").write_bytes(content)
    with pytest.raises(ValueError, match=r"/a.bin line 1: binary, not a CARMEN log$"):
        read_carmen(tmp_path / "a.bin")


def test_missing_file_is_an_os_error(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_carmen(tmp_path / "none.clf")


def test_excerpt_of_fr101_is_read_whole():
    log = read_carmen(EXCERPT)
    assert (log.scan_count, len(log.records)) == (20, 290)
    assert log.T_base_laser.x == pytest.approx(-0.04, abs=1e-6)
    assert all(len(m.scan.ranges_m) == 360 for m in log.measurements())


@pytest.mark.parametrize(
    ("name", "scans", "odometry", "beams"),
    [
        ("fr101", 292, 4277, 360),
        ("aces", 440, 7374, 180),
        pytest.param("mit-csail", 1988, 1988, 361, marks=pytest.mark.slow),
        pytest.param("intel", 5437, 13631, 180, marks=pytest.mark.slow),
    ],
)
def test_whole_log_has_the_records_it_is_known_to_have(name, scans, odometry, beams):
    log = read_carmen(shared_log(f"{name}.clf.gz"))
    assert (log.scan_count, len(log.records) - log.scan_count) == (scans, odometry)
    assert len(next(log.measurements()).scan.ranges_m) == beams
    assert max(m.scan.ranges_m[m.scan.is_hit].max() for m in log.measurements()) < 80.0


def test_a_log_cut_within_a_keyword_is_refused(tmp_path):
    whole = "ODOM 0 0 0 0 0 0 1.0 nohost 1.0\n"
    (tmp_path / "cut.clf").write_text(whole + "FLAS")
    with pytest.raises(ValueError, match=r"cut\.clf line \d+: cut within its first word"):
        read_carmen(tmp_path / "cut.clf")


@pytest.mark.slow
def test_a_log_is_read_anew_by_each_pass_and_keeps_no_scan(tmp_path):
    lines = [flaser(RANGES, SE2(0.1 * i, 0.0, 0.0), float(i)) for i in range(800)]
    path = written(tmp_path, *lines)
    tracemalloc.start()
    log = read_carmen(path)
    for passes in range(2):
        assert sum(1 for _ in log.measurements()) == log.scan_count == 800, passes
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # the ranges of all scans alone are 1.2 MB
    assert peak < 0.5e6


def test_sensor_pose_off_the_odometry_leaves_the_mounting_to_the_parameters(tmp_path):
    # logs that somebody corrected: the pose of the sensor is the corrected one
    lines = [
        "PARAM robot_frontlaser_offset 0.08 nohost 0",
        flaser(RANGES, SE2.identity(), 1.0, SE2(0.1, 0.0, 0.0)),
        flaser(RANGES, SE2.identity(), 2.0, SE2(0.2, 0.0, 0.0)),
    ]
    assert read_carmen(written(tmp_path, *lines)).T_base_laser == SE2(0.08, 0.0, 0.0)


def test_a_pose_for_every_record_follows_from_the_motion_since_the_last_scan(tmp_path):
    path = written(
        tmp_path,
        flaser(RANGES, SE2.identity(), 1.0),
        odom(0.2, 0.0, 0.0, 1.2),
        odom(0.5, 0.0, 0.1, 1.4),
        flaser(RANGES, SE2(0.5, 0.0, 0.1), 1.4),
    )
    log = read_carmen(path)
    motion = MotionSinceScan(log.noise)
    at_record = []
    for record in log.records:
        measurement = motion.add(record)
        at_record.append((measurement is not None, motion.motion.x))
    assert at_record == [(True, 0.0), (False, 0.2), (False, 0.5), (True, 0.0)]
