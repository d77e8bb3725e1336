"""Places of strangers: refused in one line, before they take all memory or leave files about."""

import logging
import os
import zipfile

import mujoco
import numpy as np
import pytest

from kitasap_sim import Place
from kitasap_sim.place_reading import _tried

WALLS = """
<geom type="box" size="2.1 .05 .5" pos="2 -.05 .5"/><geom type="box" size="2.1 .05 .5" pos="2 3.05 .5"/>
<geom type="box" size=".05 1.6 .5" pos="-.05 1.5 .5"/><geom type="box" size=".05 1.6 .5" pos="4.05 1.5 .5"/>
"""


def room(more: str = "", before: str = "", assets: str = "") -> str:
    return f"{before}<mujoco>{assets}<worldbody>{WALLS}{more}</worldbody></mujoco>"


def refusal(capfd: pytest.CaptureFixture[str], path: object) -> str:
    with pytest.raises(ValueError, match=r"^place ") as refused:
        Place(str(path))
    (line,) = str(refused.value).splitlines()
    printed = capfd.readouterr()
    assert printed.out + printed.err == ""
    return line.removeprefix(f"place {path} ")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (room(before='<!DOCTYPE m [<!ENTITY x SYSTEM "file:///etc/passwd">]>'), "has a DOCTYPE"),
        (room("&x;", before='<!DOCTYPE m [<!ENTITY x "lol">]>'), "has a DOCTYPE"),
        (room(before="<! entity x>"), "has a DOCTYPE"),
        (room('<geom type="box" size="1e9 1 1"/>'), "reaches farther than 10 km"),
        (room('<geom type="box" size="1 1 1" pos="1e300 0 0"/>'), "reaches farther than 10 km"),
        (room("<body>" * 100_000), "has 100006 elements; 50000 are the most"),
        (room("<body>" * 1000), "is not a valid MJCF file: "),
        (room()[:150], "is not a valid MJCF file: "),
        ("", "is not a valid MJCF file: "),
        ("\0" * 99, "is not a valid MJCF file: "),
        (" " * 20_000_001, "is longer than the 20 MB that are read of a place"),
    ],
)
def test_plain_files_are_refused_at_once(place_file, capfd, text, said):
    _tried.cache_clear()
    assert refusal(capfd, place_file(text)).startswith(said)
    assert _tried.cache_info().misses == 0


TOO_MUCH = "takes MuJoCo more than 300 MB or 10 s, or makes it fail"
COPIES = '<replicate count="999" offset="0 0 1">'
ENDLESS = room(f'{3 * COPIES}<geom size=".1"/>{3 * "</replicate>"}')
FIELD = '<asset><hfield name="h" nrow="60000" ncol="60000" size="1 1 1 1"/></asset>'
TEXTURE = '<texture name="t" type="2d" builtin="flat" width="99999" height="99999"/>'
MESH = '<mesh name="m" file="/etc/passwd"/>'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (room('<include file="/etc/passwd"/>'), "is not a valid MJCF file: "),
        (room('<include file="place.xml"/>'), "is not a valid MJCF file: "),
        (room('<include file="/dev/zero"/>'), "is not a valid MJCF file: "),
        (room('<geom type="box" size="nan 1 1"/>'), "has a nan in place of a number"),
        pytest.param(ENDLESS, TOO_MUCH, marks=pytest.mark.slow),
        (room(assets=FIELD), TOO_MUCH),
        (room(assets=f"<asset>{TEXTURE}</asset>"), "does not compile: "),
        (room(assets='<size memory="100G"/>'), "does not compile: "),
        (
            room('<geom type="mesh" mesh="m"/>', assets=f"<asset>{MESH}</asset>"),
            "does not compile: ",
        ),
    ],
)
def test_what_a_file_asks_for_is_tried_elsewhere(
    place_file, capfd, monkeypatch, tmp_path, text, said
):
    monkeypatch.chdir(tmp_path)

    def never(*_: object) -> None:
        raise AssertionError("it is read here as well")

    monkeypatch.setattr(mujoco.MjSpec, "from_file", never)
    assert refusal(capfd, place_file(text)).startswith(said)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_zip_bombs_are_refused(tmp_path, capfd):
    with zipfile.ZipFile(tmp_path / "bomb.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("bomb.xml", "<mujoco>" + " " * 400_000_000 + "</mujoco>")
    assert refusal(capfd, tmp_path / "bomb.zip").startswith("takes MuJoCo more than 300 MB")


@pytest.mark.slow
def test_what_takes_for_ever_is_given_up(place_file, capfd):
    endless = room('<replicate count="1000000000" offset="0 0 1"><geom size=".1"/></replicate>')
    assert refusal(capfd, place_file(endless)).startswith("takes MuJoCo more than 300 MB or 10 s")


def test_more_triangles_than_have_room_are_refused(place_file, capfd, monkeypatch):
    monkeypatch.setattr("kitasap_sim.geometry._MOST_TRIANGLES", 40)
    path = place_file(room())
    with pytest.raises(ValueError, match=r": more than 40 triangles: take simpler meshes"):
        Place(path)


def test_files_that_ask_for_more_are_read_all_the_same(place_file):
    replicated = '<replicate count="3" offset=".5 0 0"><geom type="box" size=".05 .05 .5" pos="1 1 .5"/></replicate>'
    text = f'<mujoco><include file="walls.xml"/><worldbody>{replicated}</worldbody></mujoco>'
    path = place_file(text)
    (path.parent / "walls.xml").write_text(f"<mujoco><worldbody>{WALLS}</worldbody></mujoco>")
    place = Place(path)
    assert place.model.ngeom == 7
    assert not place.is_free(np.array([[1.5, 1.0]]))[0]


def test_a_file_is_tried_once_until_it_changes(place_file):
    path = place_file(room('<include file="none.xml"/>'))
    _tried.cache_clear()
    for _ in range(2):
        with pytest.raises(ValueError, match="not a valid MJCF file"):
            Place(path)
    assert _tried.cache_info().misses == 1
    os.utime(path, ns=(1, 1))
    with pytest.raises(ValueError, match="not a valid MJCF file"):
        Place(path)
    assert _tried.cache_info().misses == 2


def test_warnings_of_mujoco_are_logged_and_make_no_file(place_file, tmp_path, monkeypatch, caplog):
    monkeypatch.chdir(tmp_path)
    Place(place_file(room()))
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qvel[0] = 1e20
    with caplog.at_level(logging.WARNING):
        mujoco.mj_step(model, data)
    assert "The simulation is unstable" in caplog.text
    assert not list(tmp_path.glob("*.TXT"))
