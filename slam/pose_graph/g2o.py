"""Pose graphs in g2o's text format: VERTEX_SE2, EDGE_SE2 and FIX lines.

g2o's error of an edge is (x, y, theta) of measured^-1 @ pose_i^-1 @ pose_j, ours the logarithm of
it. Both are the same to first order, so the information is the same matrix; only far from the
measurement do chi-squares differ.

What the format lacks stands in comments, which g2o skips: a first line with version and counts, so
that a file cut short is told from a whole one, and the kernel of the edges that follow.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from slam.files.text_fields import finite_numbers
from slam.files.whole_files import read_text, write_whole
from slam.pose_graph.graph import PoseGraph
from slam.pose_graph.robust import EdgeKernel
from slam.se2 import SE2

_HEADER = "# kitasap pose graph, version 1:"
_KERNEL = "# kernel"
_SIZES = {"VERTEX_SE2": 4, "EDGE_SE2": 11}
_UPPER = np.triu_indices(3)
_LONGEST_NUMBER = 18
"""Letters: a vertex' number is of 64 bits."""


def write_g2o(path: str | Path, graph: PoseGraph) -> None:
    """Writes the graph but for its dropped edges, numbers to the last digit.

    The file appears whole or not at all. Raises OSError when the folder cannot be written.
    """
    kept = np.flatnonzero(~graph.is_dropped)
    lines = [f"{_HEADER} {graph.node_count} nodes, {len(kept)} edges"]
    for node, pose in enumerate(graph.poses):
        lines.append(f"VERTEX_SE2 {node} {_numbers(pose)}")
    lines += [f"FIX {node}" for node in np.flatnonzero(graph.is_fixed)]
    ends, measured, information = graph.ends, graph.measured, graph.information
    kernels, last = graph.edge_kernels, None
    for edge in kept:
        if kernels[edge] != last:
            last = kernels[edge]
            lines.append(f"{_KERNEL} {EdgeKernel(last).name}")
        i, j = ends[edge]
        values = f"{_numbers(measured[edge])} {_numbers(information[edge][_UPPER])}"
        lines.append(f"EDGE_SE2 {i} {j} {values}")
    write_whole(Path(path), ("\n".join(lines) + "\n").encode())


def read_g2o(path: str | Path) -> PoseGraph:
    """The pose graph of a g2o file; nodes are numbered in the order in which they stand there.

    In files of others, edges between numbers that follow each other are plain and the rest loops.
    Raises ValueError in one line for what is no planar pose graph, and for a file cut short, OSError
    when the file cannot be opened.
    """
    path = Path(path)
    text = read_text(path, "a g2o pose graph")
    lines = text.splitlines()
    vertices: dict[int, SE2] = {}
    fixed: set[int] = set()
    edges: list[tuple[str, int, int, SE2, np.ndarray, EdgeKernel]] = []
    kernel: EdgeKernel | None = None
    for number, line in enumerate(lines, start=1):
        place = f"{path} line {number}"
        if line.startswith(_KERNEL):
            kernel = _kernel(line, place)
        fields = line.split()
        if not fields or fields[0].startswith("#"):
            continue
        tag = fields[0]
        if tag == "FIX":
            fixed.update(_whole(field, place) for field in fields[1:])
            continue
        if tag not in _SIZES:
            raise ValueError(
                f"{place}: expected VERTEX_SE2, EDGE_SE2 or FIX, found {tag!r:.60}: "
                "only pose graphs in the plane can be read"
            )
        if len(fields) - 1 != _SIZES[tag]:
            raise ValueError(f"{place}: {tag} has {_SIZES[tag]} numbers, found {len(fields) - 1}")
        if tag == "VERTEX_SE2":
            name = _whole(fields[1], place)
            if name in vertices:
                raise ValueError(f"{place}: a second vertex {name}")
            vertices[name] = SE2(*finite_numbers(fields[2:], place))
            continue
        i, j = _whole(fields[1], place), _whole(fields[2], place)
        values = finite_numbers(fields[3:], place)
        information = np.zeros((3, 3))
        information[_UPPER] = values[3:]
        information.T[_UPPER] = values[3:]
        usual = EdgeKernel.PLAIN if abs(i - j) == 1 else EdgeKernel.LOOP
        edges.append(
            (place, i, j, SE2(*values[:3]), information, usual if kernel is None else kernel)
        )
    if not vertices:
        raise ValueError(f"{path}: no VERTEX_SE2 in it, not a g2o pose graph")
    _check_whole(str(path), text, len(vertices), len(edges))
    return _graph(str(path), vertices, fixed, edges)


def _graph(
    file: str,
    vertices: dict[int, SE2],
    fixed: set[int],
    edges: list[tuple[str, int, int, SE2, np.ndarray, EdgeKernel]],
) -> PoseGraph:
    unknown = sorted(fixed - vertices.keys())
    if unknown:
        raise ValueError(f"{file}: fixes vertex {unknown[0]}, which it does not have")
    graph = PoseGraph()
    node = {name: graph.add_node(pose, name in fixed) for name, pose in vertices.items()}
    for place, i, j, T_i_j, information, kernel in edges:
        for name in (i, j):
            if name not in node:
                raise ValueError(f"{place}: edge {i} -> {j}, but there is no vertex {name}")
        try:
            graph.add_edge(node[i], node[j], T_i_j, information, kernel)
        except ValueError as error:
            raise ValueError(f"{place}: {error}") from error
    return graph


def _check_whole(file: str, text: str, node_count: int, edge_count: int) -> None:
    """That a file of ours holds what its first line promises; files of others promise nothing."""
    first = text.split("\n", maxsplit=1)[0]
    if not first.startswith("# kitasap"):
        return
    if not first.startswith(_HEADER):
        raise ValueError(f"{file}: expected '{_HEADER} ...', found {first!r:.60}")
    found = f"{_HEADER} {node_count} nodes, {edge_count} edges"
    if first != found or not text.endswith("\n"):
        raise ValueError(
            f"{file}: cut short: {first.removeprefix(_HEADER).strip()!r:.60} promised, "
            f"{node_count} nodes, {edge_count} edges found"
        )


def _kernel(line: str, place: str) -> EdgeKernel:
    name = line.removeprefix(_KERNEL).strip()
    try:
        return EdgeKernel[name]
    except KeyError:
        known = ", ".join(kernel.name for kernel in EdgeKernel)
        raise ValueError(f"{place}: expected a kernel of {known}, found {name!r:.60}") from None


def _whole(field: str, place: str) -> int:
    if len(field) > _LONGEST_NUMBER or not field.removeprefix("-").isdecimal():
        raise ValueError(f"{place}: expected the number of a vertex, found {field!r:.60}")
    return int(field)


def _numbers(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)
