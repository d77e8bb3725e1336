"""`kitasap drive`: the files it writes, the same for the same seed, and what it refuses."""

import json

import numpy as np
import pytest
from PIL import Image

from experiments.cli import main
from experiments.drive import DriveConfig, _episode, summarised
from experiments.video import write_video
from tests.experiments.refusals import refusal

KEYS = {
    *("task", "policy", "episodes", "seed", "success_rate", "success_ci95"),
    *("collision_rate", "collision_ci95", "time_s", "reward_mean"),
}


def drive(out, *more):
    arguments = ["drive", "GoTo", "--place", "symmetric_room", "--out", str(out), *more]
    return main(arguments)


@pytest.mark.parametrize("episodes", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_drive_writes_a_line_for_each_episode_and_a_summary(tmp_path, capsys, episodes):
    assert drive(tmp_path, "--episodes", str(episodes)) == 0
    lines = (tmp_path / "episodes.jsonl").read_text().splitlines()
    records = [json.loads(line) for line in lines]
    assert [record["index"] for record in records] == list(range(episodes))
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary.keys() >= KEYS
    assert summary["success_rate"] == 1.0  # an easy room
    assert summary["time_s"]["max"] == max(record["time_s"] for record in records)
    printed = capsys.readouterr().out
    assert "100.0 %" in printed
    assert printed.splitlines()[-1] == f"results: {tmp_path}"


@pytest.mark.slow
def test_episodes_that_ended_outlast_an_interruption(tmp_path, monkeypatch, capsys):
    assert drive(tmp_path, "--episodes", "1") == 0  # its line and summary are of another drive
    begun = []

    def second_is_interrupted(*arguments):
        begun.append(arguments)
        if len(begun) == 2:
            raise KeyboardInterrupt
        return _episode(*arguments)

    monkeypatch.setattr("experiments.drive._episode", second_is_interrupted)
    assert drive(tmp_path, "--episodes", "3", "--seed", "1") == 130
    # unlike a run it does not go on from there, and does not say so
    assert capsys.readouterr().err.splitlines()[-1] == "kitasap: interrupted"
    lines = (tmp_path / "episodes.jsonl").read_text().splitlines()
    assert [json.loads(line)["seed"] for line in lines] == [begun[0][2]]
    assert not (tmp_path / "summary.json").exists()


@pytest.mark.slow
def test_equal_seeds_give_equal_bytes_and_others_do_not(tmp_path):
    for name, seed in (("a", "4"), ("b", "4"), ("c", "5")):
        assert drive(tmp_path / name, "--policy", "random", "--episodes", "2", "--seed", seed) == 0
    a, b, c = ((tmp_path / name / "episodes.jsonl").read_bytes() for name in "abc")
    assert a == b
    assert a != c


def test_figures_of_known_records_are_right():
    records = [
        {"success": True, "collision": False, "time_s": 4.0, "reward": 1.0},
        {"success": True, "collision": False, "time_s": 8.0, "reward": 2.0},
        {"success": False, "collision": True, "time_s": 99.0, "reward": -6.0},
    ]
    summary = summarised(DriveConfig("GoTo", episodes=3), records)
    assert summary["success_rate"] == pytest.approx(2 / 3)
    assert summary["collision_rate"] == pytest.approx(1 / 3)
    assert summary["time_s"] == {"median": 6.0, "max": 8.0}  # of the successes
    assert summary["reward_mean"] == pytest.approx(-1.0)
    low, high = summary["success_ci95"]
    assert (low, high) == pytest.approx((0.2077, 0.9385), abs=1e-4)  # Wilson of 2 in 3


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("Fly", "no task called 'Fly'; there are: GoTo, Explore, Relocalize, Track"),
        ("GoTo --policy x", "no policy called 'x'; there are: baseline, trained, random"),
        ("Track --policy trained", "nothing was trained for Track: only for GoTo"),
        ("GoTo --place moon", "place: no place called 'moon', nor a file; there are: "),
        ("GoTo --difficulty 3", "difficulty: between 0 and 1, not 3"),
        ("GoTo --episodes 0", "Invalid value for '--episodes': "),
        ("GoTo --place room_fig4 --difficulty 1", "difficulty changes nothing of room_fig4"),
        ("Relocalize --difficulty 1", "difficulty changes nothing of symmetric_room"),
        ("GoTo --video a.avi", "--video takes a file that ends in .gif or .mp4, not a.avi"),
    ],
)
def test_wrong_input_is_refused_in_one_line(arguments, said, capsys, tmp_path):
    line = refusal(capsys, "drive", *arguments.split(), "--out", tmp_path / "out")
    assert line.startswith(said)
    assert not (tmp_path / "out").exists()


def test_mp4_without_its_encoder_names_the_extra(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("experiments.video.find_spec", lambda name: None)
    line = refusal(capsys, "drive", "GoTo", "--video", tmp_path / "a.mp4", "--out", tmp_path)
    assert "pip install 'kitasap[video]'" in line


def test_gif_has_all_frames_ten_in_a_second(tmp_path):
    # equal frames would be joined: a bar moves
    frames = [np.zeros((48, 64, 3), dtype=np.uint8) for _ in range(3)]
    for k, frame in enumerate(frames):
        frame[:, 16 * k : 16 * k + 16] = 255
    write_video(tmp_path / "a.gif", frames)
    with Image.open(tmp_path / "a.gif") as image:
        assert image.n_frames == 3
        assert image.info["duration"] == 100
