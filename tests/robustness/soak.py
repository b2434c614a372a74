"""A long clip of small frames through `rsvideo run`: memory, open files and temporary files of all its processes, over time.

python tests/robustness/soak.py [--frames 10000] [--json FILE]
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[2])  # `tests` and the project, instead of this folder

from rsvideo.shooting.given_motion import COLUMNS
from tests.cli.forked import INSTALLED
from tests.video.clips import make

RATE = 24
_PAUSE = 0.1  # seconds from one sample to the next
_JOB = """clips: [long.mp4]
output: {folder: results}
defaults:
  camera: {exposure: 1/500, readout: 2ms, focal_px: 40}
  motion: {trajectory: motion.csv}
  deblur: {prior: tv, frames: alone}
"""


@dataclass(frozen=True, kw_only=True)
class Sample:
    """All processes of the command at one moment."""

    chunks: int  # done
    encoding: bool  # whether all frames are restored
    memory: int  # bytes
    handles: int
    temporary: int  # files outside the folder that keeps what is done


def soaked(folder: Path, frames: int) -> list[Sample]:
    """Restore a clip of so many frames; RuntimeError where that fails or leaves anything behind."""
    make(folder / "long.mp4", rows=32, cols=32, frames=frames, rate=RATE, options={"preset": "ultrafast", "g": str(RATE)})
    lines = (f"{t:.2f},0,{0.01 * np.sin(9 * t):.9f},0" for t in np.arange(0, frames / RATE + 0.2, 0.02))
    (folder / "motion.csv").write_text("\n".join([",".join(COLUMNS), *lines]))
    (folder / "job.yaml").write_text(_JOB)
    (folder / "temporary").mkdir()
    samples: list[Sample] = []
    words = [str(INSTALLED), "run", "job.yaml", "--progress", "none"]
    environment = os.environ | {"TMPDIR": str(folder / "temporary")}
    with (
        tempfile.TemporaryFile() as output,
        subprocess.Popen(words, cwd=folder, env=environment, stdout=output, stderr=output) as command,
    ):
        while command.poll() is None:
            samples += _sampled(command.pid, folder)
            time.sleep(_PAUSE)
        output.seek(0)
        if command.returncode:
            raise RuntimeError(output.read().decode(errors="replace"))
    left = sorted(path.name for part in ("temporary", "results") for path in (folder / part).iterdir())
    if left != ["long_rsvideo.gcsv", "long_rsvideo.mp4", "long_rsvideo.rsvideo.json"]:
        raise RuntimeError(f"there must be the results alone, there is {left}")
    return samples


def _sampled(pid: int, folder: Path) -> list[Sample]:
    """The command's processes now; nothing where one of them ended meanwhile."""
    try:
        pids = _tree(pid)
        memory = sum(int(Path(f"/proc/{one}/statm").read_text().split()[1]) for one in pids) * os.sysconf("SC_PAGESIZE")
        handles = sum(1 for one in pids for _ in Path(f"/proc/{one}/fd").iterdir())
        temporary = sum(1 for _ in (folder / "temporary").rglob("*"))
        kept = [path.name for path in (folder / "results").rglob("*")]
    except (FileNotFoundError, ProcessLookupError):
        return []
    chunks = sum(name.endswith(".zip") for name in kept)
    return [Sample(chunks=chunks, encoding=any(".mp4" in name for name in kept), memory=memory, handles=handles, temporary=temporary)]


def _tree(pid: int) -> list[int]:
    children = [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    return [pid, *(each for child in children for each in _tree(child))]


def quarters(samples: Sequence[Sample]) -> list[dict[str, Any]]:
    """The largest values within each quarter of the restoration, and of the encoding that follows."""
    rows: list[dict[str, Any]] = []
    for encoding, stage in ((False, "restoring"), (True, "encoding")):
        part = [sample for sample in samples if sample.encoding is encoding]
        for number in range(4):
            quarter = part[number * len(part) // 4 : (number + 1) * len(part) // 4]
            if quarter:
                rows.append(
                    {
                        "soak": f"{stage}, quarter {number + 1}",
                        "memory_mb": round(statistics.median(sample.memory for sample in quarter) / 1e6),
                        "handles": max(sample.handles for sample in quarter),
                        "temporary": max(sample.temporary for sample in quarter),
                    }
                )
    return rows


def main() -> None:
    """Soak, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows, as docs/results.json holds them")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows = quarters(soaked(Path(folder), args.frames))
    print("| soak | memory, MB | handles | temporary files |\n|---|---:|---:|---:|")
    for row in rows:
        print(f"| {' | '.join(map(str, row.values()))} |")
    if args.json:
        from tests.benchmarks import published

        published.write(args.json, {"soak": rows})


if __name__ == "__main__":
    main()
