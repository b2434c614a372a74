"""Film sharp clips anew at random, measure their shutter from their own frames, and print how far that is from the truth.

    python tests/benchmarks/measured.py CLIPS... -o FILE [--each 2] [--frames 24] [--largest-side 640] [--exposure 0.5e-3 33e-3]
        [--readout 5e-3 30e-3] [--seed 0] [--change 4] [--keep DIR]

CLIPS are footage of short exposures. Of each, `rsvideo simulate --from-clip` makes --each clips at 30 frames a second: exposure 0.5
to 33 ms (log-uniform), readout 5 to 30 ms, 1 to 2 source frames a frame as far as the source has so many, from anywhere in it: more
would turn a hand's shake into an engine's. Sources are to have no rolling shutter of their own, which would add to that of the clips:
`rsvideo deblur --method rectify --codec ffv1` takes it away, with the readout that `rsvideo calibrate readout --from-clip` finds. The clips
are measured as by `rsvideo inspect --measure`. FILE gets the figures of each clip, and of all of them: the share that was answered,
and the relative errors of the answers, for clips with more than 4 px of blur, 2.5 to 4 px, and less. Another seed gives other clips: what
is chosen by the ones can be reported by the others. With --change the exposure of each clip's last frame is up to so many times that of
its first one, or one by that (log-uniform). DIR keeps the clips, and a later run takes them from there.

The true blur is the middle pixel's motion in the frames with most of it, the measured one the longest streak of such frames: these
differ where the scene is deep or the camera rolls.
"""

import argparse
import hashlib
import json
import sys
import tempfile
from fractions import Fraction
from pathlib import Path

import numpy as np
import published

from rsvideo.config.files import UnreadableError
from rsvideo.config.request import Camera
from rsvideo.physics.filming import Pace
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.pipeline import measuring
from rsvideo.pipeline.clip_facts import gather
from rsvideo.pipeline.simulated_clip import CLIP, FACTS, Filming, carry_out, prepare
from rsvideo.restoration import exposure
from rsvideo.video import decode

RATE = 30
EXPOSURE, READOUT, SPEED = (0.5e-3, 33e-3), (5e-3, 30e-3), (1.0, 2.0)
BANDS = {"more than 4 px": (4.0, np.inf), "2.5 to 4 px": (2.5, 4.0), "up to 2.5 px": (0.0, 2.5)}  # of blur in a clip's most blurred frames
DRAWS = 5  # of a part of a source that has cuts
QUANTITIES = ("exposure", "readout", "blur")


def name(source: Path) -> str:
    """By which a source is drawn for; `truth.mp4` alone would be that of many."""
    return f"{source.parent.name}/{source.name}"


def digest(source: Path) -> bytes:
    return hashlib.sha256(name(source).encode()).digest()


def drawn(source: Path, number: int, draw: int, args: argparse.Namespace) -> Filming:
    """The filming that the seeds give."""
    rng = np.random.default_rng([args.seed, number, draw, *digest(source)[:8]])
    seconds = float(np.exp(rng.uniform(*np.log(args.exposure))))
    readout, fast, begin = float(rng.uniform(*args.readout)), rng.uniform(*SPEED), rng.uniform()
    there = decode.probe(source).frames
    timing = ShutterTiming.from_readout(exposure=seconds, readout=readout, rows=1)
    paces = [Pace(timing=timing, period=1 / RATE, speed=float(speed)) for speed in (fast, *np.linspace(fast, SPEED[0], 20))]
    pace = next((each for each in paces if each.needed(args.frames) <= there), paces[-1])
    frames = min(args.frames, pace.frames(there))
    change = float(rng.uniform(-1, 1))
    return Filming(
        source=source,
        camera=Camera(exposure=round(seconds, 6), readout=round(readout, 6)),
        last_exposure=None if args.change == 1 else min(round(seconds * args.change**change, 6), 1 / RATE),
        speed=pace.speed,
        rate=Fraction(RATE),
        first=int(begin * (there - pace.needed(max(frames, 1)) + 1)),
        frames=frames,
        largest_side=args.largest_side,
        seed=number,
    )


def made(source: Path, number: int, folder: Path, args: argparse.Namespace) -> Path | None:
    """The folder of one clip, made unless it is there; None where the source has no part without a cut."""
    changing = "" if args.change == 1 else f"-{args.change:g}"
    case = folder / f"{source.stem}-{digest(source).hex()[:8]}-{args.frames}-{args.largest_side}-{args.seed}-{number}{changing}"
    if (case / FACTS).is_file():
        return case
    reason = ""
    for draw in range(DRAWS):
        try:
            done = carry_out(prepare(drawn(source, number, draw, args), case))
        except ValueError as error:
            reason = str(error)
            if isinstance(error, UnreadableError):
                break
        else:
            print("\n".join(f"{case.name}: {note}" for note in done.notes), end="\n" * bool(done.notes), file=sys.stderr)
            return case
    print(f"{name(source)}, clip {number}: {reason}", file=sys.stderr)
    return None


def measured(case: Path) -> dict:
    """True and measured numbers of one clip."""
    facts = json.loads((case / FACTS).read_text())
    take = gather(case / CLIP)
    found = measuring.of_take(take, Camera(), 0, facts["frames"])
    assert found is not None
    most = sorted(facts["blur_px"])[-exposure.FRAMES :]  # the frames from which the exposure is measured
    return {
        "blur_extent_px": facts["blur_extent_px"],
        "speed": facts["speed"],
        "exposure_s": float(np.median(facts.get("exposures_s", facts["exposure_s"]))),
        "exposure_measured_s": found.exposure and found.sharp,
        "readout_s": facts["readout_s"],
        "readout_measured_s": found.readout,
        "blur_px": float(np.median(most)),
        "blur_measured_px": found.blur,
        "unclear": "; ".join(found.unclear),
    }


def summary(rows: list[dict]) -> list[dict]:
    """Shares answered and relative errors, of clips with more and with less blur."""
    out = []
    for band, (least, most) in BANDS.items():
        some = [row for row in rows if least < row["blur_px"] <= most]
        figures: dict = {"blur": band, "clips": len(some)}
        for quantity in QUANTITIES:
            unit = "px" if quantity == "blur" else "s"
            pairs = [(row[f"{quantity}_{unit}"], row[f"{quantity}_measured_{unit}"]) for row in some]
            errors = [abs(b / a - 1) for a, b in pairs if a and b is not None]
            figures[f"{quantity}_answered"] = len(errors) / len(some) if some else None
            figures[f"{quantity}_median_error"] = float(np.median(errors)) if errors else None
            figures[f"{quantity}_p95_error"] = float(np.quantile(errors, 0.95)) if errors else None
        out.append(figures)
    return out


def main() -> None:
    """Make, measure, and print two Markdown tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clips", type=Path, nargs="+")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE")
    parser.add_argument("--each", type=int, default=2, metavar="N")
    parser.add_argument("--frames", type=int, default=24, metavar="N")
    parser.add_argument("--largest-side", type=int, default=640, metavar="PX")
    parser.add_argument("--exposure", type=float, nargs=2, default=EXPOSURE, metavar=("FROM", "TO"), help="seconds")
    parser.add_argument("--readout", type=float, nargs=2, default=READOUT, metavar=("FROM", "TO"), help="seconds")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--change", type=float, default=1.0, metavar="FACTOR")
    parser.add_argument("--keep", type=Path, metavar="DIR")
    args = parser.parse_args()
    rows: list[dict] = []
    with tempfile.TemporaryDirectory() as passing:
        folder = args.keep or Path(passing)
        folder.mkdir(parents=True, exist_ok=True)
        for number in range(args.each):
            for source in args.clips:
                if case := made(source, number, folder, args):
                    rows.append({"clip": case.name, "source": name(source)} | measured(case))
                    print(f"{len(rows)}: {case.name}", file=sys.stderr, flush=True)
    if not rows:
        sys.exit("no clip could be made")
    published.print_rows(rows)
    published.print_rows(summaries := summary(rows))
    published.write(args.output, {"measured": rows, "measured_summary": summaries})


if __name__ == "__main__":
    main()
