"""Maps as ROS keeps them: a YAML file that describes an image, one pixel per cell.

What `map_server` (ROS 1) and `nav2_map_server` (ROS 2) read and write. Where the two differ, nav2 is
followed, since ROS 1 has ended; each such place says so.
"""

from __future__ import annotations

import io
import math
import os
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from slam.files.text_fields import in_one_line
from slam.files.whole_files import read_at_most, write_whole
from slam.files.yaml_files import read_yaml, shown
from slam.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from slam.se2 import FARTHEST_M, SE2

MapMode = Literal["trinary", "scale", "raw"]
ImageFormat = Literal["pgm", "png"]

_PILLOW_FORMATS: dict[ImageFormat, str] = {"pgm": "PPM", "png": "PNG"}
_GREYS = {"free": 254, "occupied": 0, "unknown": 205}
"""What both map_savers write in trinary mode."""
_THRESHOLDS: dict[MapMode, tuple[float, float]] = {
    "trinary": (0.65, 0.196),
    "scale": (1.0, 0.0),
    "raw": (0.65, 0.196),
}
"""Occupied and free. The grey of the unknown is a probability of 0.19608: with the 0.25 that nav2
wrote until 2025 (its pull request 5278) the unknown comes back as free. Scale: all from 0 to 100."""
_TRUE, _FALSE = ("true", "yes", "on", "y"), ("false", "no", "off", "n")

_READ_FORMATS = ("PPM", "PNG", "BMP", "GIF", "JPEG", "TIFF")
"""Of what Pillow knows: some of its formats start other programs."""
_MOST_CELLS = 16_000_000
"""Chosen: 200 x 200 m at 5 cm."""
_MOST_IMAGE_BYTES = 8 * _MOST_CELLS
_PIXELS_AT_ONCE = 1 << 20
_TOO_LARGE = (
    f"a map may have {_MOST_CELLS // 1_000_000} million: take a coarser one, or a part of it"
)


@dataclass(frozen=True)
class _Header:
    """What the YAML file says."""

    image: Path
    resolution_m: float
    T_map_grid: SE2
    mode: MapMode
    negate: bool
    occupied_thresh: float
    free_thresh: float


def read_map(path: str | Path) -> OccupancyGrid:
    """The map that a YAML file of map_server describes, with its image beside it.

    The image: PGM, PNG, BMP, GIF, JPEG or TIFF, within the folder of the YAML file; colours are
    averaged, 16 bits a pixel are taken in full where there is one channel, and as 8 where there are
    three. With p the darkness of a pixel (its brightness, with negate), from 0 to 1:
    trinary: 100 for p > occupied_thresh, 0 for p < free_thresh, else -1.
    scale: between the thresholds 0 to 100 in proportion; -1 where the pixel is not opaque.
    raw: the pixel's value from 0 to 255 itself up to 100, else -1.
    Raises ValueError, one line that names the file, for what is not such a map, is cut or has more
    than 16 million cells; OSError when one of the files cannot be opened.
    """
    path = Path(path)
    header = _read_header(path)
    picture = _decoded(header.image)
    has_alpha = picture.has_transparency_data
    columns, rows = picture.size
    cells = np.empty((rows, columns), dtype=np.int8)
    at_once = max(1, _PIXELS_AT_ONCE // columns)
    for top in range(0, rows, at_once):
        part = picture.crop((0, top, columns, min(top + at_once, rows)))
        cells[top : top + at_once] = _cells_of(part, header, has_alpha)
    # an image starts at its top, a grid at its lowest y
    return OccupancyGrid(cells[::-1], header.resolution_m, header.T_map_grid)


def write_map(
    path_yaml: str | Path,
    grid: OccupancyGrid,
    mode: MapMode = "trinary",
    image: ImageFormat | None = None,
) -> None:
    """Writes the YAML file, and first its image beside it, of the same name; each whole or not at all.

    mode: trinary keeps free, occupied and unknown alone; scale and raw keep all values, raw for
    readers of nav2. image: None takes pgm, or png for scale, whose unknown cells are transparent.
    Raises ValueError for another mode, format or ending than .yaml and .yml, or for scale with
    unknown cells in a pgm; OSError when the folder cannot be written.
    """
    path = Path(path_yaml)
    if path.suffix not in (".yaml", ".yml"):
        raise ValueError(f"{path}: a map's file must end in .yaml, its image lies beside it")
    if mode not in get_args(MapMode):
        raise ValueError(f"{path}: mode must be trinary, scale or raw, not {mode!r}")
    image = image or ("png" if mode == "scale" else "pgm")
    if image not in _PILLOW_FORMATS:
        raise ValueError(f"{path}: image must be pgm or png, not {image!r}")
    pixels = _pixels(grid, mode)[::-1]
    if mode == "scale" and image == "pgm":
        if (grid.cells == UNKNOWN).any():
            raise ValueError(f"{path}: in scale mode a pgm cannot say unknown; take png")
        pixels = pixels[..., 0]
    image_path = path.with_suffix(f".{image}")
    encoded = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(encoded, _PILLOW_FORMATS[image])
    occupied_thresh, free_thresh = _THRESHOLDS[mode]
    header = {
        "image": image_path.name,
        "mode": mode,
        "resolution": grid.resolution_m,
        "origin": grid.T_map_grid.as_array().tolist(),
        "negate": 0,
        "occupied_thresh": occupied_thresh,
        "free_thresh": free_thresh,
    }
    text = yaml.safe_dump(header, sort_keys=False, default_flow_style=None, allow_unicode=True)
    write_whole(image_path, encoded.getvalue())
    write_whole(path, text.encode("utf-8"))


def _read_header(path: Path) -> _Header:
    """What the YAML file says, all of it checked.

    Raises ValueError that names the file and the key.
    """
    fields = read_yaml(path)
    if not isinstance(fields, dict):
        found = "nothing" if not fields else f"a {type(fields).__name__}"
        raise ValueError(f"{path}: expected keys such as image and resolution, found {found}")
    # nav2 and ROS 1 refuse a map without its thresholds alike: the defaults are map_saver's
    image = _field(fields, "image", path)
    if not isinstance(image, str) or not image or "\0" in image:
        raise ValueError(f"{path}: image must be the name of a file, not {shown(image)}")
    resolution_m = _number(fields, "resolution", path)
    if not resolution_m > 0.0:
        raise ValueError(f"{path}: resolution must be above 0 m, not {resolution_m}")
    return _Header(
        _beside(path, image),
        resolution_m,
        _origin(fields, path),
        _mode(fields, path),
        _is_negated(fields, path),
        *_thresholds(fields, path),
    )


def _field(fields: dict[object, object], key: str, path: Path) -> object:
    if key not in fields:
        known = in_one_line(", ".join(map(str, fields)), 200) or "none"
        raise ValueError(f"{path}: the key {key} is missing (found: {known})")
    return fields[key]


def _number(fields: dict[object, object], key: str, path: Path) -> float:
    return _finite(_field(fields, key, path), key, path)


def _finite(value: object, key: str, path: Path) -> float:
    try:
        number = float(value) if isinstance(value, str) else math.nan
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{path}: {key} must be a number, not {shown(value)}")
    return number


def _origin(fields: dict[object, object], path: Path) -> SE2:
    origin = _field(fields, "origin", path)
    if not isinstance(origin, list) or len(origin) != 3:
        raise ValueError(f"{path}: origin must be a list of x, y and yaw, not {shown(origin)}")
    x, y, yaw = (_finite(value, "origin", path) for value in origin)
    if max(abs(x), abs(y), abs(yaw)) > FARTHEST_M:
        raise ValueError(
            f"{path}: origin must be x and y in metres and a yaw in radians, none beyond"
            f" {FARTHEST_M:g}, not {shown(origin)}; give where the lower left corner of the map lies"
        )
    return SE2(x, y, yaw)


def _mode(fields: dict[object, object], path: Path) -> MapMode:
    mode = fields.get("mode", "trinary")
    known: tuple[MapMode, ...] = get_args(MapMode)
    for one in known:
        if mode == one:
            return one
    raise ValueError(f"{path}: mode must be trinary, scale or raw, not {shown(mode)}")


def _is_negated(fields: dict[object, object], path: Path) -> bool:
    """ROS 1 takes 0 and 1 alone, nav2 the words of YAML as well."""
    negate = _field(fields, "negate", path)
    word = negate.lower() if isinstance(negate, str) else ""
    if word in ("0", "1"):
        return word == "1"
    if word in _TRUE or word in _FALSE:
        return word in _TRUE
    raise ValueError(f"{path}: negate must be 0 or 1, true or false, not {shown(negate)}")


def _thresholds(fields: dict[object, object], path: Path) -> tuple[float, float]:
    """Of the occupied and of the free."""
    occupied = _number(fields, "occupied_thresh", path)
    free = _number(fields, "free_thresh", path)
    if not 0.0 <= free < occupied <= 1.0:
        raise ValueError(
            f"{path}: expected 0 <= free_thresh < occupied_thresh <= 1, found {free} and {occupied}"
        )
    return occupied, free


def _cells_of(picture: Image.Image, header: _Header, has_alpha: bool) -> NDArray[np.int8]:
    """(rows, columns) the cells that pixels stand for, in their order."""
    sums, full, is_opaque = _sums(picture, header, has_alpha)
    cells = _cell_values(full, header)[sums]
    if header.mode == "scale" and is_opaque is not None:
        # ROS 1 looks at it between the thresholds alone, and takes what is half transparent as it is
        cells[~is_opaque] = UNKNOWN
    return cells


def _sums(
    picture: Image.Image, header: _Header, has_alpha: bool
) -> tuple[NDArray[np.int64], int, NDArray[np.bool_] | None]:
    """(rows, columns) sum of each pixel's channels, the largest that it can be, and whether each
    pixel is opaque, None where all are."""
    if picture.mode in ("1", "L") and not has_alpha:
        return np.asarray(picture.convert("L"), dtype=np.int64), 255, None
    # Pillow brings a PGM of any depth to 16 bits, and only those and a PNG's come so far
    if picture.mode == "I" or picture.mode.startswith("I;16"):
        return np.asarray(picture, dtype=np.int64), 65535, None
    if not has_alpha:
        return np.asarray(picture.convert("RGB")).sum(axis=2, dtype=np.int64), 3 * 255, None
    channels = np.asarray(picture.convert("RGBA"))
    is_opaque = channels[..., 3] == 255
    # both loaders take the opacity for one more colour here: what is transparent gets darker
    taken = channels if header.mode == "trinary" else channels[..., :3]
    return taken.sum(axis=2, dtype=np.int64), taken.shape[2] * 255, is_opaque


def _beside(path: Path, image: str) -> Path:
    """The image's file. Raises ValueError unless it lies in the folder of the YAML file, or below."""
    found = path.parent / image
    # a link that leads elsewhere leads outside; the YAML file may be such a link itself
    folders = {path.parent.resolve(), path.resolve().parent}
    if not any(found.resolve().is_relative_to(folder) for folder in folders):
        raise ValueError(
            f"{path}: its image {shown(image)} lies outside of its folder, where nothing is"
            f" read: put it beside {path.name}, and write image: {os.path.basename(image)[:60]}"
        )
    return found


def _decoded(path: Path) -> Image.Image:
    """The image in a file. Raises ValueError that names it when it is none, not whole or too large."""
    content = read_at_most(path, _MOST_IMAGE_BYTES)
    try:
        with warnings.catch_warnings():
            # what is too large is told by the number of cells, before anything is decoded
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            picture = Image.open(io.BytesIO(content), formats=_READ_FORMATS)
            columns, rows = picture.size
            is_too_large = columns * rows > _MOST_CELLS
            if not is_too_large:
                picture.load()
    except UnidentifiedImageError as error:
        known = ", ".join(name.lower() for name in ("PGM", *_READ_FORMATS[1:]))
        raise ValueError(f"{path}: not an image of a known format ({known})") from error
    except Image.DecompressionBombError as error:
        raise ValueError(f"{path}: far too many cells; {_TOO_LARGE}") from error
    except Exception as error:
        # the decoders raise what they like: OSError, SyntaxError, struct.error, zlib.error ...
        reason = " ".join(str(error).split())
        raise ValueError(f"{path}: the image is cut or damaged ({reason})") from error
    if is_too_large:
        raise ValueError(f"{path}: {columns} x {rows} cells; {_TOO_LARGE}")
    is_deep = picture.mode == "I" and picture.format in ("PPM", "PNG")
    if picture.mode in ("I", "F") and not is_deep:
        raise ValueError(f"{path}: expected 8 or 16 bits a pixel, found 32")
    return picture


def _cell_values(full: int, header: _Header) -> NDArray[np.int8]:
    """(full + 1,) the cell for each sum of channels from 0 to full."""
    sums = np.arange(full + 1)
    if header.mode == "raw":
        # ROS 1 negates here as well, and hands out values above 100
        values = np.rint(sums / full * 255.0)
        return np.where(values <= OCCUPIED, values, UNKNOWN).astype(np.int8)
    # formed so that p is the nearest number to what the documentation says, (255 - x) / 255
    p = (sums if header.negate else full - sums) / full
    if header.mode == "trinary":
        between = np.full(p.shape, float(UNKNOWN))
    else:
        # ROS 1: 99 in place of 100, and cut, not rounded
        free, occupied = header.free_thresh, header.occupied_thresh
        between = np.rint((np.clip(p, free, occupied) - free) / (occupied - free) * 100.0)
    is_occupied, is_free = p > header.occupied_thresh, p < header.free_thresh
    return np.select([is_occupied, is_free], [OCCUPIED, FREE], between).astype(np.int8)


def _pixels(grid: OccupancyGrid, mode: MapMode) -> NDArray[np.uint8]:
    """(rows, columns), in scale mode (rows, columns, 4): the grid's cells as grey, lowest y first."""
    is_unknown = grid.cells == UNKNOWN
    if mode == "trinary":
        greys = np.full(grid.cells.shape, _GREYS["unknown"], dtype=np.uint8)
        greys[grid.is_free], greys[grid.is_occupied] = _GREYS["free"], _GREYS["occupied"]
        return greys
    if mode == "raw":
        return np.where(is_unknown, 255, grid.cells).astype(np.uint8)
    brightness = np.where(is_unknown, 0.5, (OCCUPIED - grid.cells.astype(np.float64)) / OCCUPIED)
    greys = np.rint(255.0 * brightness).astype(np.uint8)
    # as nav2 writes it, since GraphicsMagick loses the opacity of a grey image
    return np.stack([greys, greys, greys, np.where(is_unknown, 0, 255).astype(np.uint8)], axis=-1)
