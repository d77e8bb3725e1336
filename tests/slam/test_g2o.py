"""Pose graphs in g2o files."""

import numpy as np
import pytest

from slam.pose_graph import EdgeKernel, PoseGraph, read_g2o, write_g2o
from slam.se2 import SE2
from tests.slam.manhattan import town

OTHERS = """\
VERTEX_SE2 10 0 0 0
VERTEX_SE2 11 1 0 0.1
# a comment
VERTEX_SE2 20 2 0.5 -0.1
FIX 11
EDGE_SE2 10 11 1 0 0.1 500 1 2 400 3 1000

EDGE_SE2 10 20 2 0.5 -0.1 500 0 0 500 0 1000
"""


def graph_of_all_kinds():
    graph = town(0, nodes=60, loops=8, wrong_share=0.2, half_width_m=4.0).graph()
    # another kernel, information off the diagonal, numbers of many digits
    information = np.array([[3.0, 1 / 3, 0.1], [1 / 3, 2.0, -0.7], [0.1, -0.7, 5.0]])
    graph.add_edge(3, 1, SE2(0.1, 1e-17, np.pi), information, EdgeKernel.HUBER)
    return graph


def test_round_trip_gives_the_same_bytes_and_values(tmp_path):
    graph = graph_of_all_kinds()
    write_g2o(tmp_path / "a.g2o", graph)
    back = read_g2o(tmp_path / "a.g2o")
    write_g2o(tmp_path / "b.g2o", back)
    assert (tmp_path / "a.g2o").read_bytes() == (tmp_path / "b.g2o").read_bytes()
    for name in ("poses", "is_fixed", "ends", "measured", "information", "edge_kernels"):
        np.testing.assert_array_equal(getattr(back, name), getattr(graph, name))
    np.testing.assert_array_equal(back.solve().poses, graph.solve().poses)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.g2o", "b.g2o"]


def test_dropped_edges_are_not_written(tmp_path):
    graph = graph_of_all_kinds()
    graph.drop_edges([60, 61])
    write_g2o(tmp_path / "a.g2o", graph)
    assert read_g2o(tmp_path / "a.g2o").edge_count == graph.edge_count - 2


def test_file_of_others_is_read(tmp_path):
    (tmp_path / "a.g2o").write_text(OTHERS)
    graph = read_g2o(tmp_path / "a.g2o")
    np.testing.assert_array_equal(graph.poses[2], [2.0, 0.5, -0.1])
    np.testing.assert_array_equal(graph.is_fixed, [False, True, False])
    np.testing.assert_array_equal(graph.ends, [[0, 1], [0, 2]])
    np.testing.assert_array_equal(
        graph.information[0], [[500.0, 1.0, 2.0], [1.0, 400.0, 3.0], [2.0, 3.0, 1000.0]]
    )
    assert graph.edge_kernels.tolist() == [EdgeKernel.PLAIN, EdgeKernel.LOOP]


def test_errors_of_g2o_and_ours_are_the_same_to_first_order():
    # so that the information needs no conversion
    rng = np.random.default_rng(0)
    for twist in rng.uniform(-1.0, 1.0, (20, 3)):
        deviation = SE2.exp(1e-4 * twist)
        # the next order is theta / 2 times the shift
        np.testing.assert_allclose(deviation.as_array(), deviation.log(), atol=1e-8)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "/a.g2o: no VERTEX_SE2 in it, not a g2o pose graph$"),
        (
            "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n",
            "/a.g2o line 1: expected VERTEX_SE2, EDGE_SE2 or FIX",
        ),
        ("VERTEX_SE2 0 0 0\n", "/a.g2o line 1: VERTEX_SE2 has 4 numbers, found 3$"),
        (OTHERS + "EDGE_SE2 10 11 1 0\n", "/a.g2o line 9: EDGE_SE2 has 11 numbers, found 4$"),
        (
            OTHERS + "EDGE_SE2 10 12 1 0 0 1 0 0 1 0 1\n",
            "/a.g2o line 9: edge 10 -> 12, but there is",
        ),
        (
            OTHERS + "EDGE_SE2 10 11 1 0 0 0 0 0 0 0 0\n",
            "/a.g2o line 9: edge 0 -> 1: its information",
        ),
        (OTHERS + "VERTEX_SE2 10 0 0 0\n", "/a.g2o line 9: a second vertex 10$"),
        (OTHERS + "FIX 3\n", "/a.g2o: fixes vertex 3, which it does not have$"),
        (OTHERS + "FIX x\n", "/a.g2o line 9: expected the number of a vertex, found 'x'$"),
        (OTHERS + f"FIX {3 * '1234567'}\n", "/a.g2o line 9: expected the number of a vertex"),
        # found by fuzzing: two lines, and one of thousands of letters
        (
            "# kitasap pose graph, version 1: 2 nodes\x0bVERTEX_SE2 7 0 0 0\n" + OTHERS,
            r"/a.g2o: cut short: '2 nodes\\x0bVERTEX_SE2 7 0 0 0' promised",
        ),
        (
            OTHERS + "VERTEX_SE2 1 " + 300 * "\x00" + " 0 0\n",
            r"/a.g2o line 9: expected a number, found '(\\x00){40}'\.\.\.$",
        ),
        (OTHERS + "VERTEX_SE2 1 0 nan 0\n", "/a.g2o line 9: a number is not finite$"),
        (
            OTHERS + "# kernel SOFT\n",
            "/a.g2o line 9: expected a kernel of PLAIN, HUBER, LOOP, found",
        ),
        (
            "# kitasap pose graph, version 9: x\n" + OTHERS,
            "/a.g2o: expected '# kitasap pose graph, v",
        ),
    ],
)
def test_file_that_is_no_planar_graph_is_named_in_one_line(tmp_path, text, message):
    (tmp_path / "a.g2o").write_text(text)
    with pytest.raises(ValueError, match=message) as error:
        read_g2o(tmp_path / "a.g2o")
    assert len(str(error.value).splitlines()) == 1


def test_line_ends_of_another_system_are_no_damage(tmp_path):
    (tmp_path / "a.g2o").write_text(OTHERS)
    graph = read_g2o(tmp_path / "a.g2o")
    write_g2o(tmp_path / "b.g2o", graph)
    as_written = (tmp_path / "b.g2o").read_bytes()
    (tmp_path / "c.g2o").write_bytes(as_written.replace(b"\n", b"\r\n"))
    write_g2o(tmp_path / "b.g2o", read_g2o(tmp_path / "c.g2o"))
    assert (tmp_path / "b.g2o").read_bytes() == as_written


def test_binary_file_is_named(tmp_path):
    (tmp_path / "a.g2o").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match=r"/a.g2o: binary, not a g2o pose graph$"):
        read_g2o(tmp_path / "a.g2o")


def test_file_of_ours_cut_anywhere_is_refused(tmp_path):
    graph = PoseGraph()
    for i in range(3):
        graph.add_node(SE2(0.25 * i, 0.5, 0.125))
        if i:
            graph.add_edge(i - 1, i, SE2(0.25, 0.0, 0.0), np.eye(3), EdgeKernel(i))
    write_g2o(tmp_path / "a.g2o", graph)
    whole = (tmp_path / "a.g2o").read_bytes()
    for length in range(len(whole)):
        (tmp_path / "a.g2o").write_bytes(whole[:length])
        with pytest.raises(ValueError, match=r"/a\.g2o"):
            read_g2o(tmp_path / "a.g2o")


def test_file_that_cannot_be_written_leaves_the_old_one(tmp_path, monkeypatch):
    graph = graph_of_all_kinds()
    write_g2o(tmp_path / "a.g2o", graph)
    old = (tmp_path / "a.g2o").read_bytes()
    graph.add_node(SE2.identity())
    monkeypatch.setattr("os.replace", _no_space)
    with pytest.raises(OSError, match="no space"):
        write_g2o(tmp_path / "a.g2o", graph)
    assert (tmp_path / "a.g2o").read_bytes() == old
    assert [path.name for path in tmp_path.iterdir()] == ["a.g2o"]


def _no_space(*_):
    raise OSError("no space")
