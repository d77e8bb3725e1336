"""What a place's sites mark: where the robot starts, and the track that it drives."""

import mujoco
import numpy as np

from kitasap_sim import names


def start_site(model: mujoco.MjModel) -> np.ndarray | None:
    """(3,) x, y [m] and heading [rad] of the site `start`, its x axis; None if there is none."""
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE.value, names.START)
    if site < 0:
        return None
    data = _placed(model)
    (x, y, _), axes = data.site_xpos[site], data.site_xmat[site].reshape(3, 3)
    return np.array([x, y, np.arctan2(axes[1, 0], axes[0, 0])])


def track_sites(model: mujoco.MjModel) -> np.ndarray:
    """(T, 2) where the sites `track_...` are, by name [m]."""
    data = _placed(model)
    sites = [model.site(i).name for i in range(model.nsite)]
    chosen = sorted(name for name in sites if name.startswith(names.TRACK_PREFIX))
    corners = [data.site(name).xpos[:2] for name in chosen]
    return np.array(corners).reshape(-1, 2)


def _placed(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return data
