"""Films of trials: what they show, that nothing changes for them, and that none is left half done."""

import json

import numpy as np
import pytest
from imageio_ffmpeg import count_frames_and_secs

from experiments.cli import main
from experiments.film import TrialFilm
from experiments.film_drawing import SIZE_PX, VIEW_PX, Frames
from experiments.film_shots import shots
from experiments.runs import trial_result
from experiments.trials import TrialConfig
from experiments.video import write_video
from kitasap_sim import rendering
from slam.verdict import Status
from tests.egl import needs_egl
from tests.experiments.refusals import refusal


@pytest.fixture(scope="module")
def drive(box_room):
    """What was seen of a drive of a second."""
    config = TrialConfig(poses="random", place=box_room, methods=("odometry",), duration_s=1.0)
    film = TrialFilm("odometry")
    result = trial_result("tracking", config, 0, 0, film)
    return film.seen("tracking", config, result)


def test_a_drive_is_shown_ten_times_a_second_and_the_pose_believed_is_carried_on(drive):
    told = list(shots(drive, most=100))
    times_s = [shot.moment.time_s for shot in told]
    assert times_s[0] == 0.0
    moving = [shot for shot in told if shot.doing != "At the end"]
    assert len(moving) == pytest.approx(11, abs=1)
    # the first sweep is complete after 0.07 s, the next 0.1 s later
    assert np.diff([shot.moment.time_s for shot in moving])[1:] == pytest.approx(0.1, abs=0.03)
    # odometry alone: what is believed is what the wheels say
    assert told[-1].believed.as_array() == pytest.approx(told[-1].odometry.as_array(), abs=1e-9)
    assert np.hypot(*(told[-1].moment.pose - told[0].moment.pose)[:2]) > 0.1
    assert len(told[-1].points_m) > 300


def test_a_long_trial_is_shown_in_time_lapse(drive):
    told = [shot for shot in shots(drive, most=3) if shot.doing != "At the end"]
    assert len(told) == 3
    assert told[0].lapse == 4


def test_a_frame_says_what_the_robot_says(drive):
    from dataclasses import replace

    shot = list(shots(drive, most=100))[-1]
    view = np.zeros((VIEW_PX[1], VIEW_PX[0], 3), dtype=np.uint8)
    pictures = {
        status: Frames(drive.config.known_place, "a drive").drawn(
            replace(shot, status=status), view
        )
        for status in Status
    }
    assert pictures[Status.LOST].shape == (SIZE_PX[1], SIZE_PX[0], 3)
    words = {status: picture[:34, 640:].astype(int) for status, picture in pictures.items()}
    red = {status: (one[..., 0] - one[..., 1]).max() for status, one in words.items()}
    green = {status: (one[..., 1] - one[..., 0]).max() for status, one in words.items()}
    assert red[Status.LOST] > 100 > red[Status.TRACKING]
    assert green[Status.TRACKING] > 50 > green[Status.LOST]


@pytest.mark.slow
@needs_egl
def test_a_trial_prints_the_same_with_a_film_and_the_film_plays(
    box_room, tmp_path, capsys, monkeypatch
):
    for variable in ("MUJOCO_GL", "DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    command = ["trial", "localization", "--place", box_room, "--poses", "random"]
    command += ["--method", "odometry", "--out", str(tmp_path)]
    assert main(command) == 0
    plain = capsys.readouterr().out
    assert main([*command, "--video"]) == 0
    assert capsys.readouterr().out == plain
    assert json.loads(plain)["status"] == "ok"
    film = tmp_path / "localization" / "trial_0.mp4"
    frames, seconds = count_frames_and_secs(str(film))
    assert frames > 30
    assert seconds == pytest.approx(frames / 10, abs=0.2)
    assert film.stat().st_size < 1_000_000
    # another time it is not written over
    assert "is there already, and is not written over" in refusal(capsys, *command, "--video")


def refuses_before_the_trial(monkeypatch, capsys, tmp_path, *options) -> str:
    def run(*_):
        raise AssertionError("the trial was run")

    monkeypatch.setattr("experiments.runs.trial_result", run)
    out = tmp_path / "out"
    line = refusal(capsys, "trial", "localization", "--method", "odometry", "--out", out, *options)
    assert not out.exists()
    return line


def test_without_the_encoder_the_extra_is_named_before_the_trial(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("experiments.video.find_spec", lambda name: None)
    line = refuses_before_the_trial(monkeypatch, capsys, tmp_path, "--video")
    assert "pip install 'kitasap[video]'" in line


def test_without_opengl_the_package_is_named_before_the_trial(monkeypatch, capsys, tmp_path):
    def missing(name, *_):
        raise OSError(f"{name}: cannot open shared object file")

    for variable in ("MUJOCO_GL", "DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr(rendering.ctypes, "CDLL", missing)
    line = refuses_before_the_trial(
        monkeypatch, capsys, tmp_path, "--video-file", tmp_path / "a.gif"
    )
    assert "apt-get install libegl1 libgl1" in line


def test_a_file_that_is_no_video_is_refused_before_the_trial(monkeypatch, capsys, tmp_path):
    line = refuses_before_the_trial(monkeypatch, capsys, tmp_path, "--video-file", "a.avi")
    assert line == "--video-file takes a file that ends in .gif or .mp4, not a.avi"


@pytest.mark.parametrize("name", ["a.mp4", "a.gif"])
@pytest.mark.parametrize("stop", [KeyboardInterrupt, ValueError])
def test_what_is_interrupted_leaves_nothing_and_what_was_there_stays(name, stop, tmp_path):
    def frames():
        for _ in range(3):
            yield np.zeros((32, 48, 3), dtype=np.uint8)
        raise stop

    with pytest.raises(stop):
        write_video(tmp_path / name, frames())
    assert list(tmp_path.iterdir()) == []
    (tmp_path / name).write_bytes(b"before")
    with pytest.raises(stop):
        write_video(tmp_path / name, frames())
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"before"]
    with pytest.raises(ValueError, match="a frame at least"):
        write_video(tmp_path / name, [])


@pytest.mark.slow
@needs_egl
def test_film_of_a_kidnap_shows_it_lifted_lost_and_found(tmp_path, monkeypatch):
    for variable in ("MUJOCO_GL", "DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    config = TrialConfig(poses="anywhere", methods=("limit",))
    film = TrialFilm("limit")
    result = trial_result("kidnap", config, 0, 37, film)
    seen = film.seen("kidnap", config, result)
    told = list(shots(seen, most=1000))
    said = [shot.status for shot in told]
    lost, found = said.index(Status.LOST), len(said) - 1
    carried = [number for number, shot in enumerate(told) if shot.moment.is_held]
    assert max(carried) < lost < found
    assert said[found] is Status.TRACKING
    # the wheels tell nothing of the way
    last = told[-1]
    assert np.hypot(*(last.odometry.as_array() - last.moment.pose)[:2]) > 0.5
    assert np.hypot(*(last.believed.as_array() - last.moment.pose)[:2]) < 0.01
    assert told[lost].candidates
    film.write(tmp_path / "a.gif", config, result, "kidnap 37")
    assert (tmp_path / "a.gif").stat().st_size < 3_000_000
