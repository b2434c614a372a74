"""Compress cases once more at random rates, as cases for footage.py, and print how far the exposures that they show are from the truth.

    python tests/benchmarks/compressed.py CASES -o COMPRESSED [--bits 0.1 1] [--encoder libx264 medium] [--seed 1] [--law] [--json FILE]

CASES holds a folder a case, as `rsvideo simulate --from-clip` makes it, which is hardly compressed. Each clip gets --bits bits a pixel
(log-uniform), by one of ENCODERS or by the one that is given. With --law, which states the readout, the answer is what their blur's
differences show of each exposure, and what (15d) of docs/method.md expects of that; the summary is of those clips whose differences show
something, by a deviation of VAGUE at most. COMPRESSED gets the same folders, their truth as it was; a later run takes the cases from there.
"""

import argparse
import json
import shutil
import sys
from pathlib import Path

import numpy as np
import published
from cases import cases_of, encoded_anew, facts_of
from measured import measured, summary

from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.pipeline.clip_frames import decoded
from rsvideo.restoration import exposure
from rsvideo.restoration.clip_motion import beside, gather, path_from_tracks
from rsvideo.restoration.relative_blur import shortened
from rsvideo.restoration.relative_exposure import compared
from rsvideo.restoration.settings import Settings
from rsvideo.shooting import usual
from rsvideo.video.decode import probe

ENCODERS = (("libx264", "veryfast"), ("libx264", "medium"), ("libx265", "fast"))  # and their presets
VAGUE = 0.25  # standard deviation of the exposure's logarithm
QUIET = {"libx265": {"x265-params": "log-level=none"}}


def compressed(case: Path, out: Path, bits: float, encoder: str, preset: str) -> Path:
    """The case with its clip at so many bits a pixel, made unless it is there."""
    if (out / "case.json").is_file():
        return out
    out.mkdir(parents=True, exist_ok=True)
    facts = facts_of(case)
    rate = round(bits * facts["rows"] * facts["cols"] * facts["fps"])
    options = {"preset": preset, "b": str(rate), "maxrate": str(rate), "bufsize": str(rate)} | QUIET.get(encoder, {})
    shutil.copy(case / "truth.mp4", out)
    encoded_anew(case / "clip.mp4", out / "clip.mp4", lambda _, planes: planes, options, encoder)
    (out / "case.json").write_text(json.dumps(facts | {"bits_a_pixel": bits, "encoder": f"{encoder} {preset}"}, indent=1))
    return out


def law(case: Path) -> dict:
    """What differences in blur show of a case's exposure, the standard deviation of its logarithm, and what is expected."""
    facts, stream = facts_of(case), probe(case / "clip.mp4")
    period, scanlines = 1 / facts["fps"], facts["rows"]
    timing = ShutterTiming.from_readout(exposure=usual.READOUT * period, readout=facts["readout_s"], rows=scanlines)
    lens = Intrinsics.centred(focal=usual.FOCAL * max(facts["rows"], facts["cols"]), rows=facts["rows"], cols=facts["cols"])
    run = gather(decoded(stream, 0, stream.frames), Camera(timing=timing, intrinsics=lens), Settings())
    path = path_from_tracks(run)
    pairs = compared(run, path, lambda: beside(run, path), range(len(run.begins)), (exposure.SHORTEST * period, period))
    likelihood = pairs.likelihood(pairs.exposures, np.zeros(1))[:, 0]
    weight, shown = np.exp(likelihood - likelihood.max()), np.log(pairs.exposures / facts["exposure_s"])
    mean = np.average(shown, weights=weight)
    deviation = np.sqrt(np.average((shown - mean) ** 2, weights=weight))
    return {"bits": stream.bits, "shown": float(np.exp(mean)), "deviation": float(deviation), "expected": np.exp(-shortened(stream.bits))}


def of_law(rows: list[dict]) -> list[dict]:
    """The medians of the clips that show something."""
    plain = [row for row in rows if row["deviation"] <= VAGUE]
    medians = {name: float(np.median([row[name] for row in plain])) for name in ("bits_a_pixel", "bits", "shown", "expected") if plain}
    return [{"clips": len(rows), "plain": len(plain)} | medians]


def main() -> None:
    """Compress, measure, and print two Markdown tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--bits", type=float, nargs=2, default=(0.1, 1.0), metavar=("FROM", "TO"))
    parser.add_argument("--encoder", nargs=2, metavar=("NAME", "PRESET"))
    parser.add_argument("--law", action="store_true")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    rng, rows = np.random.default_rng(args.seed), list[dict]()
    for case in cases_of(args.cases):
        bits, (encoder, preset) = float(np.exp(rng.uniform(*np.log(args.bits)))), ENCODERS[rng.integers(len(ENCODERS))]
        encoder, preset = args.encoder or (encoder, preset)
        made = compressed(case, args.output / case.name, bits, encoder, preset)
        rows.append({"clip": case.name, "bits_a_pixel": bits, "encoder": f"{encoder} {preset}"} | (law if args.law else measured)(made))
        print(f"{len(rows)}: {case.name}", file=sys.stderr, flush=True)
    published.print_rows(rows)
    published.print_rows(summaries := (of_law if args.law else summary)(rows))
    if args.json:
        published.write(args.json, {"compressed": rows, "compressed_summary": summaries})


if __name__ == "__main__":
    main()
