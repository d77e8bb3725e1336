"""Driving tasks for Gymnasium on the real physics: `Kitasap2/GoTo-v0` and the others.

Importing this module registers nothing and loads no MuJoCo; `kitasap_sim` registers the ids.
"""

import gymnasium

ENTRY_POINTS = {
    "Kitasap2/GoTo-v0": ("kitasap_sim.env.goto:GoToEnv", 800),
    "Kitasap2/Explore-v0": ("kitasap_sim.env.explore:ExploreEnv", 2400),
    "Kitasap2/Relocalize-v0": ("kitasap_sim.env.relocalize:RelocalizeEnv", 600),
    "Kitasap2/Track-v0": ("kitasap_sim.env.track:TrackEnv", 1600),
}
"""Id to its class and its time limit in steps of 50 ms."""


def register_envs() -> None:
    """Makes the ids known to `gymnasium.make` and `gymnasium.make_vec`; again changes nothing."""
    for env_id, (entry_point, max_episode_steps) in ENTRY_POINTS.items():
        if env_id not in gymnasium.registry:
            task = env_id.removeprefix("Kitasap2/").removesuffix("-v0")
            gymnasium.register(
                env_id,
                entry_point=entry_point,
                vector_entry_point=f"kitasap_sim.env.vector:{task}VectorEnv",
                max_episode_steps=max_episode_steps,
            )
