"""Names of what a compiled place holds: equal places, equal names."""

from __future__ import annotations

import hashlib

import mujoco
import numpy as np


def digest_of(model: mujoco.MjModel) -> str:
    """SHA-256 of all that MuJoCo compiles, to the last digit: of one machine and one MuJoCo."""
    content = np.zeros(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, content)
    return hashlib.sha256(content.tobytes()).hexdigest()


def shape_digest_of(model: mujoco.MjModel) -> str:
    """SHA-256 of what stands where, to a micrometre: of one MuJoCo, the same on every machine, where the
    last digits of what is compiled are not."""
    said = hashlib.sha256()
    placed = (model.body_pos, model.body_quat, model.geom_pos, model.geom_quat)
    for array in (model.geom_type, *placed, model.geom_size, model.mesh_vert):
        # no zero with a sign
        rounded = np.round(np.asarray(array, dtype=np.float64), 6) + 0.0
        said.update(rounded.tobytes())
    return said.hexdigest()
