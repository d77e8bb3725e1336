"""The policy for GoTo that was trained by `python -m experiments.train GoTo`: a small network."""

import itertools
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from experiments.policies.surroundings import FEATURES, REPEAT, Surroundings
from kitasap_sim.laser import LaserSpec

SHIPPED = files("experiments") / "policies" / "goto.npz"
_ACTIONS = 2


class GoToTrained:
    """Drives as the network says, five times a second, held back where it could not stop any more.

    path: of another network than that which ships, as `save_network` writes it. Raises ValueError,
    in one line, for a file that holds none.
    """

    def __init__(self, laser: LaserSpec, path: str | Path | None = None) -> None:
        self._layers = load_network(Path(str(SHIPPED)) if path is None else Path(path))
        self._surroundings = Surroundings(laser)
        self.reset()

    def reset(self) -> None:
        """Forgets the last episode."""
        self._surroundings.reset()
        self._count, self._action = 0, np.zeros(_ACTIONS, dtype=np.float32)

    def __call__(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        """(2,) action for an observation."""
        self._surroundings.see(observation)
        if self._count % REPEAT == 0:
            self._action = answer(self._layers, self._surroundings.features())
        self._count += 1
        return self._surroundings.held_back(self._action)


Layers = list[tuple[np.ndarray, np.ndarray]]
"""Weights (out, in) and biases (out,), first layer first."""


def answer(layers: Layers, features: np.ndarray) -> np.ndarray:
    """(2,) action of a network with tanh between its layers, clipped to its bounds."""
    values = features
    for weights, biases in layers[:-1]:
        values = np.tanh(weights @ values + biases)
    weights, biases = layers[-1]
    return np.asarray((weights @ values + biases).clip(-1.0, 1.0), dtype=np.float32)


def save_network(path: Path, layers: Layers, told: str) -> None:
    """Writes a network with a text that tells how it was trained. Raises OSError if it cannot."""
    arrays: dict[str, Any] = {"told": np.array(told)}
    for number, (weights, biases) in enumerate(layers):
        arrays[f"weights_{number}"] = weights.astype(np.float32)
        arrays[f"biases_{number}"] = biases.astype(np.float32)
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)


def load_network(path: Path) -> Layers:
    """The layers of a network. Raises ValueError, naming the file, for one that holds none."""
    layers: Layers = []
    try:
        with np.load(path, allow_pickle=False) as arrays:
            while f"weights_{len(layers)}" in arrays:
                number = len(layers)
                layers.append((arrays[f"weights_{number}"], arrays[f"biases_{number}"]))
    except (OSError, EOFError, ValueError, KeyError) as error:
        raise ValueError(f"{path}: no network of the trained policy ({error})") from error
    sizes = [(weights.shape[1], weights.shape[0]) for weights, _ in layers]
    is_chain = all(one[1] == other[0] for one, other in itertools.pairwise(sizes))
    if not layers or sizes[0][0] != FEATURES or sizes[-1][1] != _ACTIONS or not is_chain:
        raise ValueError(
            f"{path}: layers of {sizes}, where {FEATURES} features and {_ACTIONS} actions are"
            " expected"
        )
    return layers


def told(path: Path | None = None) -> str:
    """How a network was trained, as it says itself."""
    with np.load(Path(str(SHIPPED)) if path is None else path, allow_pickle=False) as arrays:
        return str(arrays["told"])
