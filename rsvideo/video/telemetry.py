"""What makers embed beside the picture (GoPro's GPMF), read by telemetry-parser in a process of its own, with limits."""

import contextlib
import importlib
import importlib.util
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
from array import array
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

SECONDS = 30  # of the processor's time and of the clock
MEMORY = 4 << 30  # bytes
_MOST_BYTES = 64_000  # of the answer
MOST_CHARACTERS = 80  # of a name that a file states
_READOUT, _STABILISED = "0x53524f54", "0x45495341"  # GPMF's SROT in ms, and EISA
_MOST = 1e9  # of a time in ms that a file states; more is damage


@dataclass(frozen=True, kw_only=True)
class Telemetry:
    """What was found; None where the camera did not say."""

    make: str | None = None
    model: str | None = None
    exposure: tuple[float, float, float] | None = None  # seconds: least, median, most
    iso: float | None = None  # median
    readout: float | None = None  # seconds
    stabilised: bool = False  # by the camera itself


class UnavailableError(Exception):
    """Nothing could be read, and why."""


def available() -> bool:
    """Whether the reader is installed."""
    return importlib.util.find_spec("telemetry_parser") is not None


def read(path: Path) -> Telemetry:
    """What a clip's maker embedded; nothing where none of it is understood."""
    text = answer(path, "facts", _MOST_BYTES)
    with contextlib.suppress(ValueError):
        if isinstance(found := json.loads(text), dict):
            return _checked(found)
    return Telemetry()


def answer(path: Path, what: str, most: int) -> bytes:
    """What another process reads from a clip, `facts` or the `gyroscope`'s log, in at most so many bytes; nothing if it fails."""
    if not available():
        raise UnavailableError("telemetry-parser is not installed; pip install 'rsvideo[gyro]' brings it")
    with tempfile.TemporaryFile() as out:
        try:
            done = subprocess.run(
                [sys.executable, "-P", "-m", __name__, what, str(most), str(path.absolute())],
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=subprocess.DEVNULL,
                timeout=SECONDS,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise UnavailableError(f"reading it took more than {SECONDS} s") from error
        out.seek(0)
        return b"" if done.returncode else out.read(most)


def _checked(found: Mapping[str, Any]) -> Telemetry:
    """The answer of another process, trusted in nothing."""
    exposure = found.get("exposure")
    spread = [_positive(value) for value in exposure] if isinstance(exposure, list) and len(exposure) == 3 else []
    least, median, most = spread or (None, None, None)
    readout = _positive(found.get("readout_ms"))
    return Telemetry(
        make=_word(found.get("make")),
        model=_word(found.get("model")),
        exposure=(least, median, most) if least and median and most else None,
        iso=_positive(found.get("iso")),
        readout=readout * 1e-3 if readout else None,
        stabilised=found.get("stabilised") is True,
    )


def _positive(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and 0 < value < _MOST else None


def _word(value: object) -> str | None:
    text = value.strip()[:MOST_CHARACTERS] if isinstance(value, str) else ""
    return text if text.isprintable() and text else None


def _gathered(samples: Iterable[Mapping[str, Mapping[str, Any]]]) -> dict[str, Any]:
    """What matters of all samples of a clip."""
    exposures: list[float] = []
    gains: list[float] = []
    found: dict[str, Any] = {}
    for groups in samples:
        general, exposure = groups.get("Default", {}), groups.get("Exposure", {})
        if exposure.get("Unit") == "s":
            exposures += _numbers(exposure.get("Data"))
        gains += _numbers(groups.get("SensorISO", {}).get("Data"))
        if _READOUT in general:
            found["readout_ms"] = general[_READOUT]
        if isinstance(mode := general.get(_STABILISED), str) and mode.strip().upper() not in ("", "N", "N/A"):
            found["stabilised"] = True
    if exposures:
        found["exposure"] = [min(exposures), statistics.median(exposures), max(exposures)]
    if gains:
        found["iso"] = statistics.median(gains)
    return found


def _numbers(values: object) -> list[float]:
    return [value for value in values if isinstance(value, int | float) and math.isfinite(value)] if isinstance(values, list) else []


def _turning(samples: Iterable[Mapping[str, Any]]) -> bytes:
    """Time in ms and three rates in degrees/s of each sample, as doubles."""
    table = array("d")
    for sample in samples:
        if sample.get("gyro") is not None:
            table.extend((sample["timestamp_ms"], *sample["gyro"]))
    return table.tobytes()


def _limit(most: int) -> None:
    with contextlib.suppress(ImportError, ValueError, OSError):  # there is no such module on Windows
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _answer(what: str, most: str, path: str) -> None:
    """The other process: read, and write what was found on standard output."""
    standard_output = os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)  # the parser's own remarks
    _limit(int(most))
    parser: Any = importlib.import_module("telemetry_parser")  # compiled, and without types

    with tempfile.TemporaryDirectory() as alone:  # away from logs beside the clip, which the parser would take for the clip's own
        link = Path(alone) / f"clip{Path(path).suffix}"
        link.symlink_to(path)
        clip = parser.Parser(str(link))
        if what == "gyroscope":
            found = _turning(clip.normalized_imu())
        else:
            found = json.dumps({"make": clip.camera, "model": clip.model, **_gathered(clip.telemetry())}).encode()
    with os.fdopen(standard_output, "wb") as out:
        out.write(found)


if __name__ == "__main__":
    _answer(*sys.argv[1:])
