"""Maps in files: what is read is what was written, and what is none is refused."""

import io
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from slam.files.slam_map_checks import _check_numbers
from slam.files.slam_map_files import read_slam_map, write_slam_map
from slam.mapping import Mapper
from slam.slam_map import SlamMap
from slam.verdict import Status
from tests.slam import ring


@pytest.fixture(scope="module")
def slam_map() -> SlamMap:
    mapper = Mapper(ring.T_BASE_LASER)
    for measurement in ring.drive(ring.way(1.2, 0.3), np.random.default_rng(0)):
        mapper.update(measurement)
    return mapper.finish()


def test_map_read_and_written_again_has_the_same_bytes(slam_map, tmp_path):
    write_slam_map(tmp_path / "one.kitasap", slam_map)
    again = read_slam_map(tmp_path / "one.kitasap")
    write_slam_map(tmp_path / "two.kitasap", again)
    assert (tmp_path / "one.kitasap").read_bytes() == (tmp_path / "two.kitasap").read_bytes()


def test_map_read_is_the_one_written(slam_map, tmp_path):
    assert slam_map.loops
    write_slam_map(tmp_path / "map.kitasap", slam_map)
    again = read_slam_map(tmp_path / "map.kitasap")
    np.testing.assert_array_equal(again.trajectory.poses, slam_map.trajectory.poses)
    np.testing.assert_array_equal(again.points, slam_map.points)
    np.testing.assert_array_equal(again.grid().cells, slam_map.grid().cells)
    assert again.verdict == slam_map.verdict
    assert [loop.later for loop in again.loops] == [loop.later for loop in slam_map.loops]
    # the graph as well: solved again it stays where it is
    np.testing.assert_allclose(again.graph.solve().poses, slam_map.graph.solve().poses, atol=1e-9)


def test_scans_between_keyframes_are_kept_with_them(tmp_path):
    mapper = Mapper(ring.T_BASE_LASER)
    for measurement in ring.drive(ring.way(0.1, 0.1), np.random.default_rng(0)):
        mapper.update(measurement)
    path, slam_map = tmp_path / "map.kitasap", mapper.finish()
    write_slam_map(path, slam_map)
    again = read_slam_map(path)
    told = [[glance for one in keyframes.keyframes for glance in one.glances]
            for keyframes in (slam_map, again)]  # fmt: skip
    assert len(told[0]) > 10
    assert [glance.T_keyframe_base for glance in told[0]] == [g.T_keyframe_base for g in told[1]]
    for one, other in zip(*told, strict=True):
        assert one.ranges_m.tobytes() == other.ranges_m.tobytes()
        assert one.angles_rad.tobytes() == other.angles_rad.tobytes()
    assert [len(one.glances) for one in slam_map.keyframes] == [
        len(one.glances) for one in again.keyframes
    ]
    write_slam_map(tmp_path / "again.kitasap", again)
    assert (tmp_path / "again.kitasap").read_bytes() == path.read_bytes()


def test_map_of_version_2_is_read_without_scans_between_keyframes(slam_map, tmp_path):
    path, old = tmp_path / "map.kitasap", tmp_path / "old.kitasap"
    write_slam_map(path, slam_map)
    with zipfile.ZipFile(path) as whole, zipfile.ZipFile(old, "w") as archive:
        for name in whole.namelist():
            if name == "version.npy":
                member = io.BytesIO()
                np.save(member, np.array(2))
                archive.writestr(name, member.getvalue())
            elif not name.startswith("glance"):
                archive.writestr(name, whole.read(name))
    again = read_slam_map(old)
    assert len(again.keyframes) == len(slam_map.keyframes)
    assert not any(one.glances for one in again.keyframes)


def test_ties_are_kept_and_maps_of_version_3_have_none(slam_map, tmp_path):
    path, old = tmp_path / "map.kitasap", tmp_path / "old.kitasap"
    first, *others = slam_map.loops
    write_slam_map(path, replace(slam_map, loops=(replace(first, is_tie=True), *others)))
    assert [one.is_tie for one in read_slam_map(path).loops] == [True, *[False] * len(others)]
    with np.load(path) as file:
        arrays = dict(file)
    del arrays["loop_is_tie"]
    with old.open("wb") as out:
        np.savez(out, **arrays | {"version": np.array(3)})
    assert not any(one.is_tie for one in read_slam_map(old).loops)


def test_what_wheels_told_is_kept_and_maps_of_version_5_do_not_know_it(slam_map, tmp_path):
    path, old = tmp_path / "map.kitasap", tmp_path / "old.kitasap"
    write_slam_map(path, slam_map)
    again = read_slam_map(path)
    assert [one.told.motion for one in again.keyframes] == [
        one.told.motion for one in slam_map.keyframes
    ]
    assert np.array_equal(again.graph.information, slam_map.graph.information)
    with np.load(path) as file:
        arrays = {name: array for name, array in file.items() if "told" not in name}
    with old.open("wb") as out:
        np.savez(out, **arrays | {"version": np.array(5)})
    again = read_slam_map(old)
    assert all(one.told.is_guess for one in again.keyframes)
    # of each step one edge then, of wheels and scans together: they lead to the same place
    assert again.graph.edge_count < slam_map.graph.edge_count
    np.testing.assert_allclose(again.graph.solve().poses, slam_map.graph.solve().poses, atol=1e-6)


def test_gaps_are_kept_and_maps_of_version_6_have_none(slam_map, tmp_path):
    path, old = tmp_path / "map.kitasap", tmp_path / "old.kitasap"
    gaps = [k in (5, 9) for k in range(len(slam_map.keyframes))]
    keyframes = [
        replace(one, is_after_gap=gap) for one, gap in zip(slam_map.keyframes, gaps, strict=True)
    ]
    write_slam_map(path, replace(slam_map, keyframes=tuple(keyframes)))
    assert [one.is_after_gap for one in read_slam_map(path).keyframes] == gaps
    with np.load(path) as file:
        arrays = {name: array for name, array in file.items() if "after_gap" not in name}
    with old.open("wb") as out:
        np.savez(out, **arrays | {"version": np.array(6)})
    assert not any(one.is_after_gap for one in read_slam_map(old).keyframes)


def test_empty_map_is_kept_too(tmp_path):
    write_slam_map(tmp_path / "map.kitasap", Mapper(ring.T_BASE_LASER).finish())
    assert read_slam_map(tmp_path / "map.kitasap").poses.shape == (0, 3)


def test_file_cut_anywhere_or_changed_is_refused_by_name(slam_map, tmp_path):
    path = tmp_path / "map.kitasap"
    write_slam_map(path, slam_map)
    whole = path.read_bytes()
    for share in (0.0, 0.1, 0.5, 0.9, 0.999):
        path.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(ValueError, match=r"map\.kitasap: expected a map"):
            read_slam_map(path)
    middle = len(whole) // 2
    path.write_bytes(whole[:middle] + bytes(200) + whole[middle + 200 :])
    with pytest.raises(ValueError, match=r"map\.kitasap"):
        read_slam_map(path)


@pytest.mark.parametrize("method", [12, 14, 99])
def test_file_that_says_to_be_packed_another_way_is_refused_by_name(slam_map, tmp_path, method):
    path = tmp_path / "map.kitasap"
    write_slam_map(path, slam_map)
    content = bytearray(path.read_bytes())
    # of the last member, in the zip's directory: bzip2, LZMA, none that there is
    content[content.rfind(b"PK\x01\x02") + 10] = method
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"map\.kitasap: expected a map"):
        read_slam_map(path)


@pytest.mark.slow
def test_file_with_one_byte_changed_is_refused_or_read_as_it_was(slam_map, tmp_path):
    path, rng = tmp_path / "map.kitasap", np.random.default_rng(1)
    write_slam_map(path, slam_map)
    whole = path.read_bytes()
    for at in rng.integers(len(whole), size=100):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ rng.integers(1, 256)]) + whole[at + 1 :])
        try:
            again = read_slam_map(path)
        except ValueError as error:
            # not pytest.raises: most of the changes must be refused, but not all
            assert str(error).startswith(f"{path}: ")  # noqa: PT017
        else:
            np.testing.assert_array_equal(again.points, slam_map.points)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("version", None),
        ("points", np.array("text")),
        ("poses", np.nan),
        ("step_keyframes", 10**6),
        ("step_sessions", -1),
        ("keyframe_times_s", np.nan),
        ("beam_origins_m", np.nan),
        ("beam_angles_rad", np.inf),
        ("points", np.zeros((3, 1))),
        ("point_counts", -1),
        ("poses", 1e300),
        ("keyframe_covariances", -1.0),
        ("keyframe_told_covariances", -1.0),
        (
            "keyframe_covariances",
            np.tile([[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], (1, 1)),
        ),
        ("loop_ends", 10**6),
        ("loop_ends", np.full((1, 2), 5)),
        ("loops_kept", np.array(-5)),
        ("step_statuses", -1),
        ("verdict", np.zeros(2)),
    ],
)
def test_file_whose_arrays_make_no_map_is_refused_by_name(slam_map, tmp_path, name, value):
    path = tmp_path / "map.kitasap"
    write_slam_map(path, slam_map)
    with np.load(path) as file:
        arrays = dict(file)
    if value is None:
        del arrays[name]
    elif np.ndim(value) == 0 and not isinstance(value, np.ndarray):
        arrays[name].flat[0] = value
    else:
        arrays[name] = value
    with path.open("wb") as out:
        np.savez(out, **arrays)
    with pytest.raises(ValueError, match=r"map\.kitasap: "):
        read_slam_map(path)


@pytest.mark.parametrize(
    "name", ["keyframe_covariances", "keyframe_told_covariances", "loop_information"]
)
def test_file_of_uneven_matrices_is_refused_by_name(slam_map, tmp_path, name):
    path = tmp_path / "map.kitasap"
    write_slam_map(path, slam_map)
    with np.load(path) as file:
        arrays = dict(file)
    arrays[name][-1, 0, 1] += 1e-4 * arrays[name][-1].max()
    with path.open("wb") as out:
        np.savez(out, **arrays)
    with pytest.raises(ValueError, match=rf"map\.kitasap: .*{name} are not symmetric"):
        read_slam_map(path)


def test_later_version_is_refused(slam_map, tmp_path, monkeypatch):
    monkeypatch.setattr("slam.files.slam_map_files.VERSION", 6)
    write_slam_map(tmp_path / "map.kitasap", slam_map)
    monkeypatch.setattr("slam.files.slam_map_files.VERSION", 5)
    with pytest.raises(ValueError, match="its version is 6, and this library reads 1 to 5"):
        read_slam_map(tmp_path / "map.kitasap")


def test_old_map_is_whole_when_writing_fails(slam_map, tmp_path, monkeypatch):
    path = tmp_path / "map.kitasap"
    path.write_bytes(b"the old one")

    def fails(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr("slam.files.whole_files.os.replace", fails)
    with pytest.raises(OSError, match="disk full"):
        write_slam_map(path, slam_map)
    assert path.read_bytes() == b"the old one"
    assert [one.name for one in tmp_path.iterdir()] == ["map.kitasap"]


@pytest.mark.slow
def test_robot_finds_itself_on_a_map_that_was_read(slam_map, tmp_path):
    write_slam_map(tmp_path / "map.kitasap", slam_map)
    localizer = read_slam_map(tmp_path / "map.kitasap").localizer(ring.T_BASE_LASER)
    poses = ring.way(0.9, 0.3)[60:70]
    measurements = ring.drive(poses, np.random.default_rng(1))
    # a reflection beyond the laser's range is no wall
    ranges_m = measurements[-1].scan.ranges_m.copy()
    ranges_m[::4] = 30.0
    measurements[-1] = replace(
        measurements[-1], scan=replace(measurements[-1].scan, ranges_m=ranges_m)
    )
    estimates = [localizer.update(measurement) for measurement in measurements]
    assert estimates[0].verdict.status is not Status.TRACKING
    assert estimates[-1].verdict.status is Status.TRACKING
    # the map's frame is that of the first pose it was made from
    true = ring.way(1.2, 0.3)[0].inverse() @ poses[-1]
    assert estimates[-1].T_map_base.is_near(true, 0.1, 0.03)


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("glance_ranges_m", -1e38, "glance_ranges_m are below 0"),
        ("beam_ranges_m", -1.0, "beam_ranges_m are below 0"),
        ("glance_angles_rad", 1e30, "glance_angles_rad reach beyond 1000 rad"),
    ],
)
def test_beams_that_no_laser_has_make_no_map(name, value, said):
    beams = np.array([value, 1.0])
    with pytest.raises(ValueError, match=said):
        _check_numbers(name, beams)
    _check_numbers(name, np.array([0.5, 1.0]))


def test_numbers_of_other_machines_are_checked_without_a_warning():
    # found by fuzzing: 1e8 m is more than a float16 holds, and kernels are compiled for no such order
    _check_numbers("poses", np.array([[0.5, 1.0, 0.0]], dtype=np.float16))
    with pytest.raises(ValueError, match="order of bytes"):
        _check_numbers("poses", np.array([[0.5, 1.0, 0.0]], dtype=np.dtype("f8").newbyteorder("S")))
