"""The compiled geometry of a place, cut at a height: the very surfaces that beams hit."""

from collections.abc import Iterable

import mujoco
import numpy as np

_FACETS = 128
"""Sides of a tessellated circle: a pillar of 0.5 m radius is then off by 0.15 mm at most."""
_INFINITE_PLANE_M = 100.0
"""Half extent that stands for a plane of infinite size."""

_BOX_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_BOX_FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


_CUTS_PER_GEOM = 8
_MOST_TRIANGLES = 1_500_000
"""Chosen: their cuts take half a gigabyte."""


def static_triangles(model: mujoco.MjModel, *, seen_only: bool) -> dict[int, np.ndarray]:
    """Triangles (F, 3, 3) in the world [m] of each static geom by its id; floors are among them.

    seen_only: leave out what beams pass over (no alpha).
    Raises ValueError for kinds of geom that have no surface here (height fields, SDFs), and for more
    than a million and a half triangles.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    static = np.flatnonzero(model.body_weldid[model.geom_bodyid] == 0)
    triangles, count = {}, 0
    for geom in static.tolist():
        if seen_only and not is_seen(model, geom):
            continue
        local = _triangles(model, geom)
        count += len(local)
        if count > _MOST_TRIANGLES:
            raise ValueError(
                f"more than {_MOST_TRIANGLES} triangles: take simpler meshes, fewer round things"
            )
        rotation = data.geom_xmat[geom].reshape(3, 3)
        triangles[geom] = local @ rotation.T + data.geom_xpos[geom]
    return triangles


def slice_at(triangles: np.ndarray, height_m: float) -> np.ndarray:
    """(S, 2, 2) segments [m] in which triangles (F, 3, 3) meet the horizontal plane at a height."""
    # A tenth of a micrometre up: a vertex in the very plane would make a segment of no length
    above = triangles[:, :, 2] - (height_m + 1e-7)
    # by corners: NumPy is slow at least and most of three
    is_below, is_above = above < 0, above > 0
    crossing = triangles[
        (is_below[:, 0] | is_below[:, 1] | is_below[:, 2])
        & (is_above[:, 0] | is_above[:, 1] | is_above[:, 2])
    ]
    if not len(crossing):
        return np.empty((0, 2, 2))
    above = crossing[:, :, 2] - (height_m + 1e-7)
    start, end = crossing, np.roll(crossing, -1, axis=1)
    above_end = np.roll(above, -1, axis=1)
    is_cut = (above < 0) != (above_end < 0)  # two of the three edges, always
    share = np.divide(above, above - above_end, where=is_cut, out=np.zeros_like(above))
    points = start[:, :, :2] + share[:, :, None] * (end - start)[:, :, :2]
    result: np.ndarray = points[is_cut].reshape(-1, 2, 2)
    return result


def cuts_at(solids: Iterable[np.ndarray], height_m: float) -> np.ndarray:
    """(S, 2, 2) segments [m] in which solids (each its triangles) meet a horizontal plane."""
    return np.concatenate([np.empty((0, 2, 2)), *(slice_at(solid, height_m) for solid in solids)])


def cuts_between(solids: Iterable[np.ndarray], low_m: float, high_m: float) -> np.ndarray:
    """(S, 2, 2) segments [m] of solids cut at heights from low to high: a thin board counts too."""
    cuts = [np.empty((0, 2, 2))]
    for solid in solids:
        cuts += [slice_at(solid, height) for height in _cut_heights(solid, low_m, high_m)]
    return np.concatenate(cuts)


def _cut_heights(solid: np.ndarray, low_m: float, high_m: float) -> np.ndarray:
    """Heights from low to high at which a solid stands; none if it does not reach there."""
    bottom_m, top_m = np.clip([solid[:, :, 2].min(), solid[:, :, 2].max()], low_m, high_m)
    if not top_m > bottom_m:
        return np.empty(0)
    heights_m: np.ndarray = bottom_m + np.linspace(0.02, 0.98, _CUTS_PER_GEOM) * (top_m - bottom_m)
    return heights_m


def is_within(
    solids: Iterable[np.ndarray], point_m: np.ndarray, low_m: float, high_m: float
) -> bool:
    """Whether a point (2,) of the plane lies inside a solid cut at any of the heights of
    `cuts_between`: a line from it crosses the cut's outline an odd number of times."""
    x, y = point_m
    for solid in solids:
        lower, upper = solid[:, :, :2].min(axis=(0, 1)), solid[:, :, :2].max(axis=(0, 1))
        if (lower <= point_m).all() and (point_m <= upper).all():
            for height_m in _cut_heights(solid, low_m, high_m):
                (ax, ay), (bx, by) = slice_at(solid, height_m).transpose(1, 2, 0)
                is_crossed = (ay > y) != (by > y)
                share = np.divide(y - ay, by - ay, where=is_crossed, out=np.zeros_like(ay))
                if (is_crossed & (ax + share * (bx - ax) > x)).sum() % 2:
                    return True
    return False


def points_on(segments: np.ndarray, spacing_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (K, 2) at most spacing_m apart along segments (S, 2, 2), and (K,) whose they are.

    Both ends of every segment are among them.
    """
    lengths_m = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    counts = np.maximum(np.ceil(lengths_m / spacing_m).astype(int), 1) + 1
    owners = np.repeat(np.arange(len(segments)), counts)
    firsts = np.repeat(np.cumsum(counts) - counts, counts)
    share = (np.arange(counts.sum()) - firsts) / np.repeat(counts - 1, counts)
    start, end = segments[owners, 0], segments[owners, 1]
    return start + share[:, None] * (end - start), owners


def visible_runs(points: np.ndarray, owners: np.ndarray, is_visible: np.ndarray) -> np.ndarray:
    """(S, 2, 2) longest stretches of visible points on each segment."""
    is_joined = is_visible[1:] & is_visible[:-1] & (owners[1:] == owners[:-1])
    edges = np.diff(np.concatenate([[False], is_joined, [False]]).astype(int))
    firsts, lasts = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return np.stack([points[firsts], points[lasts]], axis=1)


def is_seen(model: mujoco.MjModel, geom: int) -> bool:
    """Whether beams end on a geom: they pass what has no alpha."""
    material = model.geom_matid[geom]
    rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    return bool(rgba[3] > 0)


def _triangles(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """(F, 3, 3) triangles of one geom in its own frame [m]."""
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    match kind:
        case mujoco.mjtGeom.mjGEOM_BOX:
            return np.asarray((_BOX_CORNERS * size)[_BOX_FACES])
        case mujoco.mjtGeom.mjGEOM_PLANE:
            x, y = (extent if extent > 0 else _INFINITE_PLANE_M for extent in size[:2])
            corners = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]])
            return np.asarray(corners[np.array([[0, 1, 2], [0, 2, 3]])])
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            profile = np.array(
                [[0, -size[1]], [size[0], -size[1]], [size[0], size[1]], [0, size[1]]]
            )
            return _revolved(profile)
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            bow = np.linspace(-np.pi / 2, np.pi / 2, _FACETS // 4 * 2)
            shift = np.where(bow < 0, -size[1], size[1])
            return _revolved(np.stack([size[0] * np.cos(bow), size[0] * np.sin(bow) + shift], 1))
        case mujoco.mjtGeom.mjGEOM_SPHERE | mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            bow = np.linspace(-np.pi / 2, np.pi / 2, _FACETS // 2 + 1)
            radii = size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else size[0]
            return np.asarray(_revolved(np.stack([np.cos(bow), np.sin(bow)], 1)) * radii)
        case mujoco.mjtGeom.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            faces = model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]
            return np.asarray(model.mesh_vert[first : first + count][faces], dtype=float)
    raise ValueError(
        f"geom '{model.geom(geom).name}' is a {kind.name.removeprefix('mjGEOM_').lower()}; "
        "a place may be made of planes, boxes, cylinders, capsules, spheres, ellipsoids and meshes"
    )


def _revolved(profile: np.ndarray) -> np.ndarray:
    """(F, 3, 3) surface of a profile (P, 2) of radius and height turned around the z axis."""
    angles = np.linspace(0, 2 * np.pi, _FACETS, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles), np.ones(_FACETS)], axis=1)
    rings = ring[None] * np.stack([profile[:, 0], profile[:, 0], profile[:, 1]], 1)[:, None]
    low, high = rings[:-1], rings[1:]
    low_next, high_next = np.roll(low, -1, axis=1), np.roll(high, -1, axis=1)
    lower = np.stack([low, low_next, high_next], axis=2)
    upper = np.stack([low, high_next, high], axis=2)
    return np.concatenate([lower, upper]).reshape(-1, 3, 3)
