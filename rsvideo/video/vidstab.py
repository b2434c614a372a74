"""A clip stabilised by vid.stab, the peer that most people have: FFmpeg's two passes, by the program that imageio-ffmpeg brings.

vid.stab turns and shifts whole frames; it knows nothing of rows. The program is under the GPL and runs as a process of its own.
"""

import importlib
import importlib.util
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rsvideo.config.files import UnreadableError
from rsvideo.video.decode import probe

SECONDS = 3600.0
_MOST_BYTES = 4000  # of what the program says at last
_MOTION = "motion.trf"
_QUIET = ("-hide_banner", "-nostdin", "-loglevel", "error", "-xerror", "-protocol_whitelist", "file")


class UnavailableError(Exception):
    """The program is not there."""


def available() -> bool:
    """Whether the program is installed."""
    return importlib.util.find_spec("imageio_ffmpeg") is not None


def stabilised(path: Path, out: Path, folder: Path, *, timeout: float = SECONDS, smoothing: int = 15) -> Path:
    """The clip in `path` as FFV1 in `out` (.mkv), of as many frames at the same times and of the same size, without sound.

    `smoothing` counts the frames on either side that the camera's path is smoothed over. Borders keep what the frame before showed.
    Each of two passes may take `timeout` seconds; between them the motion lies in `folder`.
    """
    if not available():
        raise UnavailableError("vid.stab is not installed; pip install 'rsvideo[vidstab]' brings it")
    module: Any = importlib.import_module("imageio_ffmpeg")
    program, source = module.get_ffmpeg_exe(), f"file:{path.absolute()}"
    taken = ("-noautorotate", "-i", source, "-map", "0:v:0")  # in sensor order
    find, turn = f"vidstabdetect=result={_MOTION}", f"vidstabtransform=input={_MOTION}:smoothing={smoothing}:optzoom=0:interpol=bicubic"
    _run([program, *_QUIET, *taken, "-vf", find, "-f", "null", "-"], path, folder, timeout)
    written = ("-c:v", "ffv1", "-level", "3", "-slicecrc", "1", "-fps_mode", "passthrough", "-f", "matroska", "-y")
    _run([program, *_QUIET, *taken, "-vf", turn, *written, f"file:{out.absolute()}"], path, folder, timeout)
    before, now = probe(path), probe(out)
    if (now.frames, now.rows, now.cols) != (before.frames, before.rows, before.cols):
        raise UnreadableError(
            f"{path} has {before.frames} frames of {before.cols} x {before.rows} px, vid.stab made {now.frames} of {now.cols} x {now.rows}"
        )
    return out


def _run(words: Sequence[str], path: Path, folder: Path, timeout: float) -> None:
    with tempfile.TemporaryFile() as log:
        try:
            done = subprocess.run(
                words, cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=log, timeout=timeout, check=False
            )
        except subprocess.TimeoutExpired as error:
            raise UnreadableError(f"{path}: vid.stab took more than {timeout:g} s") from error
        log.seek(max(0, log.seek(0, 2) - _MOST_BYTES))
        lines = log.read().decode("utf-8", "replace").strip().splitlines()
    if done.returncode:
        words = "".join(letter for letter in (lines[-1] if lines else "") if letter.isprintable())
        raise UnreadableError(f"{path} could not be stabilised by vid.stab: {words or f'it ended with {done.returncode}'}")
