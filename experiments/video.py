"""Moving pictures of what was driven: GIF by Pillow, MP4 where imageio-ffmpeg is installed."""

from importlib import import_module
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

FRAMES_PER_S = 10
_WIDTHS_PX, _COLOURS = (400, 320, 240, 160), 32
_MOST_BYTES = 3_000_000
"""Chosen: a picture in a README. A GIF is the widest of these that stays below."""


def checked_video(path: Path) -> Path:
    """The path, if a video can be written so; ValueError for another ending, or no encoder."""
    if path.suffix.lower() not in (".gif", ".mp4"):
        raise ValueError(f"--video takes a file that ends in .gif or .mp4, not {path.name}")
    if path.suffix.lower() == ".mp4" and find_spec("imageio_ffmpeg") is None:
        raise ValueError(
            "an .mp4 needs imageio-ffmpeg: pip install 'kitasap[video]', or give a .gif instead"
        )
    return path


def write_video(path: Path, frames: list[np.ndarray]) -> None:
    """Writes (height, width, 3) uint8 frames, 10 in a second; a GIF small, in few colours."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix.lower() == ".mp4":
        height, width = frames[0].shape[:2]
        writer = import_module("imageio_ffmpeg").write_frames(
            str(path), (width, height), fps=FRAMES_PER_S
        )
        writer.send(None)
        for frame in frames:
            writer.send(np.ascontiguousarray(frame))
        writer.close()
        return
    for width_px in _WIDTHS_PX:
        encoded = _gif(frames, width_px)
        if len(encoded) < _MOST_BYTES:
            break
    path.write_bytes(encoded)


def _gif(frames: list[np.ndarray], width_px: int) -> bytes:
    size = width_px, round(width_px * frames[0].shape[0] / frames[0].shape[1])
    images = [Image.fromarray(frame).resize(size) for frame in frames]
    # one palette for all, without dithering: what stands still then costs nothing
    # by coverage: the goal is a few pixels of a colour that nothing else has
    palette = images[0].quantize(_COLOURS, Image.Quantize.MAXCOVERAGE)
    few = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    file = BytesIO()
    few[0].save(
        file, "GIF", save_all=True, append_images=few[1:], duration=1000 // FRAMES_PER_S, loop=0,
        optimize=False,
    )  # fmt: skip
    return file.getvalue()
