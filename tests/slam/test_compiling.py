"""Compiling is told of, and loading is not."""

import numba

from slam.compiling import told_of_compiling


def test_compiling_is_told_of_once_before_it_begins():
    told = []
    with told_of_compiling(lambda: told.append(twice.nopython_signatures)):
        twice = numba.njit(lambda number: 2 * number)
        thrice = numba.njit(lambda number: 3 * number)
        assert twice(2) + thrice(2) == 10
    assert told == [[]]


def test_what_is_compiled_is_not_told_of():
    twice, told = numba.njit(lambda number: 2 * number), []
    twice(2)
    with told_of_compiling(lambda: told.append("compiling")):
        twice(3)
    # nor what is compiled after
    twice(2.0)
    assert told == []


def test_what_is_loaded_is_not_told_of(tmp_path, monkeypatch):
    path = tmp_path / "kept_kernel.py"
    path.write_text(
        "import numba\n\n\n@numba.njit(cache=True)\ndef twice(number):\n    return 2 * number\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    told = []
    for _ in range(2):
        names: dict = {"__name__": "kept_kernel", "__file__": str(path)}
        exec(compile(path.read_text(), path, "exec"), names)
        with told_of_compiling(lambda: told.append("compiling")):
            assert names["twice"](2) == 4
    assert told == ["compiling"]
