"""Actions drawn at random: what any policy has to beat."""

import numpy as np


class RandomActions:
    """Uniform over all actions, from a generator of its own; episodes draw on from the last."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def reset(self) -> None:
        """Nothing to forget."""

    def __call__(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        """(2,) action, whatever is observed."""
        return self._rng.uniform(-1.0, 1.0, 2).astype(np.float32)
