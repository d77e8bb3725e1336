"""The baselines of the driving tasks: they get there, touch nothing, use the observation alone."""

import math

import gymnasium
import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

import kitasap_sim  # noqa: F401  registers the tasks
from experiments.policies import kernels, policy
from experiments.policies.arcs import room_on_arc
from experiments.policies.driving import OUTLINE_M
from experiments.policies.local_grid import LocalGrid
from experiments.policies.placing import nudged


def driven(task, seed, **keywords):
    """The last info of one episode under the baseline."""
    env = gymnasium.make(f"Kitasap2/{task}-v0", **keywords)
    driver = policy(task, "baseline", env)
    observation, info = env.reset(seed=seed)
    driver.reset()
    is_over = False
    while not is_over:
        observation, _, is_ended, is_late, info = env.step(driver(observation))
        is_over = is_ended or is_late
    env.close()
    return info


@pytest.mark.slow
def test_goto_baseline_reaches_the_goals_of_five_rooms_and_touches_nothing():
    infos = [driven("GoTo", seed, place="random", difficulty=1.0) for seed in range(5)]
    assert [info["is_success"] for info in infos] == [True] * 5
    assert not any(info["collision"] for info in infos)


@pytest.mark.slow
def test_goto_baseline_finds_the_goal_though_its_odometry_drifts():
    # tires 2 % unlike turn the odometry by half a radian on 8 m; the scans hold it
    info = driven("GoTo", 3, place="place_fig6", wheel_radii=(-0.01, 0.01))
    assert info["is_success"]


@pytest.mark.slow
def test_explore_baseline_sees_the_room():
    assert driven("Explore", 2, place="random", difficulty=0.5)["is_success"]


@pytest.mark.slow
def test_track_baseline_drives_a_path_to_its_end():
    info = driven("Track", 1, place="symmetric_room")
    assert info["is_success"]
    assert info["mean_aside_m"] < 0.05  # it cuts corners by centimetres


@pytest.mark.parametrize(
    "task", ["GoTo", *(pytest.param(task, marks=pytest.mark.slow) for task in ("Explore", "Track"))]
)
def test_policies_never_see_the_simulation(task):
    """Made from the laser alone, they do the same where there is no environment any more."""
    env = gymnasium.make(f"Kitasap2/{task}-v0", place="symmetric_room")
    alive, alone = (policy(task, "baseline", env) for _ in range(2))
    observation, _ = env.reset(seed=0)
    seen, actions = [], []
    for _ in range(30):
        seen.append(observation)
        actions.append(alive(observation))
        observation, *_ = env.step(actions[-1])
    env.unwrapped._sim = None
    again = [alone(one) for one in seen]
    np.testing.assert_array_equal(again, actions)
    assert np.abs(actions).max() > 0.1


def test_random_actions_are_the_same_for_the_same_seed_and_fill_the_box():
    env = gymnasium.make("Kitasap2/GoTo-v0", place="symmetric_room")
    first, again = (policy("GoTo", "random", env, seed=7) for _ in range(2))
    drawn = np.array([first({}) for _ in range(200)])
    np.testing.assert_array_equal(drawn, [again({}) for _ in range(200)])
    assert drawn.min() < -0.9
    assert drawn.max() > 0.9


def test_baseline_refuses_wheels_for_actions():
    env = gymnasium.make("Kitasap2/GoTo-v0", place="symmetric_room", control="wheels")
    with pytest.raises(ValueError, match="control=twist"):
        policy("GoTo", "baseline", env)


def test_costs_are_those_of_an_obvious_dijkstra():
    price = np.random.default_rng(0).uniform(1.0, 5.0, (12, 9))
    price[4, :7] = np.inf
    costs = kernels.costs_to(price, np.array([[1, 2], [10, 8]]))
    edges = [
        (i * 9 + j, a * 9 + b, math.hypot(a - i, b - j) * (price[i, j] + price[a, b]) / 2.0)
        for i in range(12)
        for j in range(9)
        for a in range(max(i - 1, 0), min(i + 2, 12))
        for b in range(max(j - 1, 0), min(j + 2, 9))
        if (a, b) != (i, j) and np.isfinite(price[i, j] + price[a, b])
    ]
    start, end, cost = zip(*edges, strict=True)
    ends = np.array([start, end], dtype=np.int32)  # older SciPy takes no others
    graph = coo_array((cost, tuple(ends)), shape=(108, 108)).tocsr()
    expected = dijkstra(graph, indices=[1 * 9 + 2, 10 * 9 + 8]).min(axis=0).reshape(12, 9)
    np.testing.assert_allclose(costs, expected, rtol=1e-12)
    way = kernels.way_down(costs, np.array([0, 0]), 40)
    assert way[-1].tolist() == [1, 2]


def test_clearance_is_the_distance_to_the_nearest_hit():
    rng = np.random.default_rng(1)
    evidence = (rng.random((20, 15)) < 0.05).astype(np.int8)
    hits_m = (np.indices((20, 15)).transpose(1, 2, 0) + rng.random((20, 15, 2))) * 0.1
    room_m = kernels.clearances(
        evidence, hits_m.astype(np.float32), np.zeros(2), 0.1, (2, 1, 18, 14), 0.6
    )
    middles_m = (np.indices((20, 15)).transpose(1, 2, 0) + 0.5) * 0.1
    far_m = np.hypot(*(middles_m[:, :, None] - hits_m[evidence > 0]).transpose(3, 0, 1, 2))
    np.testing.assert_allclose(room_m, far_m.min(axis=2).clip(0, 0.6)[2:18, 1:14], atol=1e-6)


def test_room_on_an_arc_is_what_is_left_before_a_wall_after_braking():
    # 0.4 s at 0.5 m/s and 0.125 m of braking by 1 m/s2; bow at 0.22 m
    wall_m = np.array([[1.0, 0.0]])
    room_m, now_m = room_on_arc(
        wall_m, OUTLINE_M, (0.5, 0.0), (0.5, 0.0), (1.0, 4.0), (0.0, 0.4, 0.005)
    )
    assert now_m == pytest.approx(0.78)
    assert room_m == pytest.approx(0.78 - 0.2 - 0.125, abs=0.005)
    assert room_on_arc(
        np.array([[0.3, 0.0]]), OUTLINE_M, (0.5, 0.0), (0.5, 0.0), (1.0, 4.0), (0.0, 0.4, 0.005)
    )[0] == pytest.approx(0.0)  # it runs into it


def test_a_known_shift_is_found_again():
    # a corner of two walls with a hit in each cell
    evidence = np.zeros((60, 60), dtype=np.int8)
    hits_m = np.zeros((60, 60, 2), dtype=np.float32)
    walls_m = [(0.5, 0.5 + 0.05 * k + 0.02) for k in range(40)]
    walls_m += [(0.5 + 0.05 * k + 0.02, 0.5) for k in range(40)]
    for x, y in walls_m:
        evidence[int(x / 0.05 + 1e-6), int(y / 0.05 + 1e-6)] = 5
        hits_m[int(x / 0.05 + 1e-6), int(y / 0.05 + 1e-6)] = x, y
    true = np.array([1.5, 1.5, 0.0])
    points_m = np.array(walls_m) - true[:2]
    pose, share = nudged(
        evidence, hits_m, np.zeros(2), 0.05, points_m, true + np.array([0.02, -0.012, 0.006]),
        np.array([0.004, 0.002]), 0.1, 20,
    )  # fmt: skip
    np.testing.assert_allclose(pose, true, atol=0.004)  # a step of it
    assert share == 1.0


def test_a_beam_that_is_lost_leaves_no_mark():
    env = gymnasium.make("Kitasap2/GoTo-v0", place="symmetric_room")
    grid = LocalGrid(env.unwrapped.laser)
    scan = np.full(60, 1.5, dtype=np.float32)
    scan[30] = 5.6
    still = {"odometry": np.zeros(3, np.float32), "velocity": np.zeros(2, np.float32)}
    grid.update({"scan": scan, **still})
    i, j = grid.cell(np.array([3.0, 3.0 * math.tan(env.unwrapped.laser.angles_rad[30])]))
    assert not grid.is_seen[i - 2 : i + 3, j - 2 : j + 3].any()
    assert (grid.evidence > 0).sum() > 40
