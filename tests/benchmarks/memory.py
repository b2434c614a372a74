"""Peak memory of the installed command on clips brought to one size, and the worst of them: the size is to decide, not what a clip does.

    python tests/benchmarks/memory.py CLIPS... [--size 1920x1080] [--from S --to S] [--json FILE] [-- OPTIONS of rsvideo deblur]

CLIPS are clips, of which nothing is stated, or folders of cases as `rsvideo simulate --from-clip` makes them, whose exposure and readout
are stated; OPTIONS are stated instead. Each clip is stretched to the size by cubic interpolation, its blur with it, and cut to the seconds
from --from to --to. Memory is the largest resident set; a GB is a million KiB.
"""

import argparse
import json
import sys
import tempfile
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import published
from installed import RSVIDEO
from speed import ran

from rsvideo.pipeline.simulated_clip import CLIP, FACTS


def stretched(source: Path, target: Path, size: list[int], begin: float, end: float) -> int:
    """Write a piece of a clip in another size, without its sound; the count of its frames."""
    frames = 0
    with av.open(source) as there, av.open(target, "w") as here:
        of = there.streams.video[0]
        rate = of.average_rate or Fraction(30)
        stream = here.add_stream("libx264", rate=rate, options={"crf": "12", "preset": "veryfast"})
        stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
        for frame in there.decode(of):
            if begin <= frame.time < end:
                picture = frame.reformat(*size, format="yuv420p", interpolation="BICUBIC")
                picture.pts, picture.time_base = frames, 1 / rate
                here.mux(stream.encode(picture))
                frames += 1
        here.mux(stream.encode(None))
    return frames


def measured(source: Path, size: list[int], begin: float, end: float, options: list[str]) -> dict[str, Any]:
    """A row of the table."""
    facts = json.loads((source / FACTS).read_text()) if source.is_dir() else {}
    stated = options or [f"--{name}={facts[f'{name}_s']:.9f}s" for name in ("exposure", "readout") if facts]
    with tempfile.TemporaryDirectory() as folder:
        clip = Path(folder) / "clip.mp4"
        frames = stretched(source / CLIP if facts else source, clip, size, begin, end)
        seconds, peak = ran([RSVIDEO, "deblur", str(clip), "-o", str(Path(folder) / "out.mkv"), *stated])
    return {"clip": source.name, "frames": frames, "peak_gb": peak, "seconds": seconds}


def main() -> None:
    """Print a Markdown table, and the worst clip."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clips", type=Path, nargs="+")
    parser.add_argument("--size", default="1920x1080")
    parser.add_argument("--from", type=float, default=0.0, metavar="S", dest="begin")
    parser.add_argument("--to", type=float, default=float("inf"), metavar="S", dest="end")
    parser.add_argument("--json", type=Path)
    at = (*sys.argv, "--").index("--")
    args, options = parser.parse_args(sys.argv[1:at]), sys.argv[at + 1 :]
    size = [int(side) for side in args.size.split("x")]
    rows = []
    for clip in args.clips:
        rows.append(measured(clip, size, args.begin, args.end, options))
        print(rows[-1], file=sys.stderr, flush=True)
    published.print_rows(rows)
    worst = max(rows, key=lambda row: row["peak_gb"])
    print(f"most memory: {worst['peak_gb']:.2f} GB, of {worst['clip']}")
    if args.json:
        published.write(args.json, {"clip_memory": rows}, sys.argv[1:])


if __name__ == "__main__":
    main()
