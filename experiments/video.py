"""Moving pictures: GIF by Pillow, MP4 where imageio-ffmpeg is installed; whole files, or none."""

import os
from collections.abc import Generator, Iterable, Sequence
from importlib import import_module
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image, ImageColor

from slam.files.whole_files import write_whole

FRAMES_PER_S = 10
_WIDTHS_PX, _COLOURS = (800, 640, 560, 480, 400, 320, 240, 160), 32
_MOST_BYTES = 3_000_000
"""Chosen: a picture in a README. A GIF is the widest of these that stays below."""


def checked_video(path: Path, option: str = "--video") -> Path:
    """The path, if a video can be written so; ValueError for another ending, or no encoder."""
    if path.suffix.lower() not in (".gif", ".mp4"):
        raise ValueError(f"{option} takes a file that ends in .gif or .mp4, not {path}")
    if path.suffix.lower() == ".mp4" and find_spec("imageio_ffmpeg") is None:
        raise ValueError(
            "an .mp4 needs imageio-ffmpeg: pip install 'kitasap[video]', or give a .gif instead"
        )
    return path


def write_video(
    path: Path,
    frames: Iterable[np.ndarray],
    colours: int = _COLOURS,
    widest_px: int = 400,
    kept: Sequence[str] = (),
) -> None:
    """Writes (height, width, 3) uint8 frames, 10 in a second; a GIF small, in few colours.

    kept: colours that a GIF has as they are, however few pixels have them.

    The file is there whole or not at all, also when a frame cannot be drawn. Raises OSError when it
    cannot be written, ValueError for no frames.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix.lower() == ".mp4":
        _write_mp4(path, frames)
        return
    images = [_narrowed(Image.fromarray(frame), widest_px) for frame in frames]
    if not images:
        raise ValueError("a video needs a frame at least")
    for width_px in (width for width in _WIDTHS_PX if width <= widest_px):
        encoded = _gif([_narrowed(image, width_px) for image in images], colours, kept)
        if len(encoded) < _MOST_BYTES:
            break
    write_whole(path, encoded)


def _write_mp4(path: Path, frames: Iterable[np.ndarray]) -> None:
    unfinished = path.with_name(f".{path.stem}.{os.getpid()}.mp4")
    writer: Generator[None, np.ndarray | None, None] | None = None
    try:
        for frame in frames:
            if writer is None:
                height, width = frame.shape[:2]
                # any player takes even sides; quiet: what ffmpeg says of its own options helps nobody
                writer = import_module("imageio_ffmpeg").write_frames(
                    str(unfinished), (width, height), fps=FRAMES_PER_S, macro_block_size=2,
                    quality=7, ffmpeg_log_level="error",
                )  # fmt: skip
                writer.send(None)
            writer.send(np.ascontiguousarray(frame))
        if writer is None:
            raise ValueError("a video needs a frame at least")
        writer.close()
        _check_finished(unfinished, path)
        os.replace(unfinished, path)
    finally:
        if writer is not None:
            writer.close()
        unfinished.unlink(missing_ok=True)


def _check_finished(unfinished: Path, path: Path) -> None:
    """Raises OSError if what the encoder left is no whole film: it does not say so itself."""
    is_there = unfinished.exists() and unfinished.stat().st_size > 0
    # the index of an .mp4 is written last: without it nothing plays
    if not (is_there and b"moov" in unfinished.read_bytes()):
        raise OSError(f"{path}: ffmpeg could not write the whole film; is the disk full?")


def _narrowed(image: Image.Image, width_px: int) -> Image.Image:
    if image.width <= width_px:
        return image
    size = width_px, round(width_px * image.height / image.width)
    return image.resize(size, Image.Resampling.LANCZOS)


def _gif(images: list[Image.Image], colours: int, kept: Sequence[str]) -> bytes:
    # one palette for all, without dithering: what stands still then costs nothing
    # with none to keep, by coverage: the goal is a few pixels of a colour that nothing else has
    some = images[:: max(1, len(images) // 5)]
    strip = Image.new("RGB", (some[0].width, sum(image.height for image in some)))
    for number, image in enumerate(some):
        strip.paste(image, (0, number * image.height))
    method = Image.Quantize.MEDIANCUT if kept else Image.Quantize.MAXCOVERAGE
    palette = strip.quantize(colours - len(kept), method)
    if kept:
        own = (palette.getpalette() or [])[: 3 * (colours - len(kept))]
        palette.putpalette([*own, *(part for name in kept for part in ImageColor.getrgb(name))])
    few = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    file = BytesIO()
    few[0].save(
        file, "GIF", save_all=True, append_images=few[1:], duration=1000 // FRAMES_PER_S, loop=0,
        optimize=False,
    )  # fmt: skip
    return file.getvalue()
