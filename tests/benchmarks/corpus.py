"""Blur photographs at random, restore them blindly and with their motion known, and print how much of the known gain is kept.

    python tests/benchmarks/corpus.py PHOTOS -o FILE [--each 1] [--half choose] [--large] [--gyro LOG] [--seed 0] [--keep DIR] [--jobs 2]
    python tests/benchmarks/corpus.py --judged FILE

PHOTOS is a folder of sharp pictures. Of each, --each stills are drawn: size, exposure 6 to 33 ms, readout 6 to 31 ms, focal length,
2.5 to 34 px of blur (one in ten is sharp), roll in two thirds, noise, brightness, a third as JPEG; the motion is a random hand-shake,
and for one in two a random moment of LOG where one is given. FILE gets a row a still, and the figures of each half: what is
chosen by the one can be reported by the other. The half goes by a hash of the photograph's name. With --large stills have 1920 x 1080
pixels, and each is taken of four photographs of one half, two by two, since one is not large enough. DIR keeps the stills. With --judged
nothing is restored: the figures of a FILE are printed under the present limits of the verdict, as far as these leave more stills alone.
"""

import argparse
import hashlib
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import cached_property, partial
from itertools import product
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np
import published
from cases import facts_of

import rsvideo
from rsvideo.frame import Frame, Verdict
from rsvideo.physics import gyro, staging
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.gyro import GyroLog
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.simulate import render
from rsvideo.physics.tone import Transfer, decode, encode
from rsvideo.physics.trajectory import Trajectory, path_error
from rsvideo.pipeline.simulated_case import case_json, motion_csv
from rsvideo.report.metrics import psnr
from rsvideo.restoration import search, single_frame
from rsvideo.restoration.estimate import Estimate
from rsvideo.restoration.evidence import Evidence
from rsvideo.restoration.scanlines import View, to_scanlines
from rsvideo.restoration.scene import Scene
from rsvideo.restoration.settings import Settings
from rsvideo.restoration.verdict import believed
from rsvideo.shooting import given_motion

SIZES = ((400, 600), (432, 768), (450, 800), (540, 960))
LARGE, BESIDE = ((1080, 1920),), 4  # sizes, and photographs of one scene
EXPOSURE, READOUT, FOCAL = (6e-3, 33e-3), (6e-3, 31e-3), (0.75, 2.4)  # s, s, and the frame's columns
BLUR, NOISE, GAIN, JPEG = (2.5, 34.0), (1.5e-3, 10e-3), (0.75, 1.15), (82, 97)  # px, at half of white, of the light, quality
SHARP, SHARP_BLUR = 0.1, (0.05, 0.6)  # the share of stills that are sharp, and px of their blur
ROLL, COMPRESSED, LOGGED = 2 / 3, 1 / 3, 1 / 2  # shares of the stills
LONGEST = 0.1  # s, more than any still's interval
DRAWS = 8  # of a motion that a photograph is large enough for
WORTH, KEPT, HARM = 1.0, 0.8, 0.1  # dB of known gain that count; share of it that is enough; dB below the input that are harm
NEAR = 0.15, 1.0  # of the blur, and px, by which a path may be off for it to count as found
STAGES = ("search", "verdict", "latent image")  # in which a still can be lost
TIMES = 65  # at which paths are compared
RESAMPLES = 2000  # of the bootstrap


def digest(photograph: Path) -> bytes:
    return hashlib.sha256(photograph.name.encode()).digest()


def half(photograph: Path) -> str:
    return "choose" if digest(photograph)[0] % 2 else "report"


def mosaics(photographs: list[Path], folder: Path) -> list[Path]:
    """Scenes of four photographs of one half, named after the first, which says the half."""
    out = []
    for name in ("choose", "report"):
        some = sorted((p for p in photographs if half(p) == name), key=digest)
        for k in range(0, len(some) - BESIDE + 1, BESIDE):
            four = [cv2.imread(str(p), cv2.IMREAD_COLOR) for p in some[k : k + BESIDE]]
            rows, cols = np.min([p.shape[:2] for p in four if p is not None], axis=0)
            a, b, c, d = (p[:rows, :cols] for p in four if p is not None)
            out.append(folder / some[k].name)
            cv2.imwrite(str(out[-1]), np.vstack([np.hstack([a, b]), np.hstack([c, d])]), [cv2.IMWRITE_JPEG_QUALITY, 100])
    return out


def made(
    photograph: Path, number: int, folder: Path, seed: int, log: GyroLog | None, sizes: tuple[tuple[int, int], ...] = SIZES
) -> Path | None:
    """The folder of one still, made unless it is there; None where the photograph is too small for any motion drawn."""
    case = folder / f"{photograph.stem}-{seed}-{number}"
    if (case / "case.json").is_file():
        return case
    rng = np.random.default_rng([seed, number, *digest(photograph)[:8]])
    codes = cv2.imread(str(photograph), cv2.IMREAD_COLOR)
    if codes is None:
        return None
    scene = decode(Transfer.SRGB, codes[..., ::-1].astype(np.float32) / 255)
    for _ in range(DRAWS):
        rows, cols = sizes[rng.integers(len(sizes))]
        start, hand, logged = rng.uniform(), int(rng.integers(2**31)), rng.uniform() < LOGGED
        motion = staging.of_log(log, start=start * (log.times[-1] - LONGEST)) if log and logged else staging.hand(hand)
        low, high = SHARP_BLUR if rng.uniform() < SHARP else BLUR
        try:
            staged = staging.stage(
                *scene.shape[:2],
                motion=motion,
                focal=float(rng.uniform(*FOCAL) * cols),
                exposure=float(rng.uniform(*EXPOSURE)),
                readout=float(rng.uniform(*READOUT)),
                frame=(rows, cols),
                roll=bool(rng.uniform() < ROLL),
                blur=float(np.exp(rng.uniform(np.log(low), np.log(high)))),
            )
            break
        except ValueError:
            continue
    else:
        return None
    noise, gain = float(np.exp(rng.uniform(*np.log(NOISE)))), float(rng.uniform(*GAIN))
    rendering = render(scene, camera=staged.camera, trajectory=staged.trajectory, noise=Noise.at_half(noise), rng=rng, gain=gain)
    quality = int(rng.integers(*JPEG)) if rng.uniform() < COMPRESSED else None
    case.mkdir(parents=True)
    for name, light in (("blurred", rendering.blurred), ("truth", rendering.truth)):
        shown = np.round(encode(Transfer.SRGB, light)[..., ::-1] * 255).astype(np.uint8)
        if quality and name == "blurred":
            cv2.imwrite(str(case / "blurred.jpg"), shown, [cv2.IMWRITE_JPEG_QUALITY, quality])
        else:
            cv2.imwrite(str(case / f"{name}.png"), shown)
    (case / "motion.csv").write_bytes(motion_csv(staged))
    facts = {"source": photograph.name, "noise_sigma_linear": noise, "brightness": gain, "jpeg_quality": quality}
    (case / "case.json").write_bytes(case_json(staged, facts))
    return case


@dataclass(frozen=True, kw_only=True, eq=False)
class Still:
    """A case, and how near pictures are to its truth."""

    facts: dict
    view: View
    motion: Trajectory
    truth: np.ndarray  # codes of sRGB

    @cached_property
    def before(self) -> float:
        """dB of the blurred frame."""
        return psnr(encode(Transfer.SRGB, self.view.pixels), self.truth)

    def gain(self, light: np.ndarray) -> float:
        """dB by which a picture is nearer to the truth than the blurred frame."""
        return psnr(encode(Transfer.SRGB, np.clip(light, 0, 1).astype(np.float32)), self.truth) - self.before

    def error(self, path: Trajectory) -> float:
        """px by which a path is off."""
        times = np.linspace(*self.view.camera.timing.interval, TIMES)
        return path_error(path.at(times)[:, :2], self.motion.at(times)[:, :2])


def opened(case: Path) -> Still:
    facts = facts_of(case)
    picture = rsvideo.read(next(case.glob("blurred.*")))
    truth = encode(Transfer.SRGB, rsvideo.read(case / "truth.png").pixels)
    timing = ShutterTiming(exposure=facts["exposure_s"], row_time=facts["row_time_s"], rows=facts["rows"])
    lens = Intrinsics.centred(focal=facts["focal_px"], rows=facts["rows"], cols=facts["cols"])
    camera = Camera(timing=timing, intrinsics=lens)
    view = to_scanlines(Frame(pixels=picture.pixels, clipped=picture.clipped), camera)
    return Still(facts=facts, view=view, motion=given_motion.read(case / "motion.csv", camera), truth=truth)


def restored(case: Path) -> dict:
    """What became of one still, blindly and along its true motion, and how far its path is off."""
    still, last = opened(case), list[Estimate]()

    def watched(scene: Scene, settings: Settings) -> Iterator[Estimate]:
        for each in search.estimate(scene, settings):
            last[:] = [each]
            yield each

    found = single_frame.restore(still.view, Settings(), estimate=watched)
    known = single_frame.restore(still.view, Settings(prior="tv"), trajectory=still.motion)
    return {
        "case": case.name,
        "half": half(Path(still.facts["source"])),
        "blur_px": still.facts["blur_px"],
        "noise": still.facts["noise_sigma_linear"],
        "jpeg_quality": still.facts["jpeg_quality"],
        "before_db": still.before,
        "known_tv_gain_db": still.gain(known.latent),
        "gain_db": still.gain(found.latent),
        "verdict": found.verdict.name,
        "path_error_px": still.error(found.trajectory),
        "evidence": asdict(last[0].evidence) if last and last[0].evidence else None,
        "seconds": found.seconds,
    }


def judged(row: dict) -> dict:
    """The row of a still under the present limits of the verdict, if they are stricter than those that it was measured with."""
    enough = row["evidence"] is None or believed(Evidence(**row["evidence"])).name == row["verdict"]
    return row if enough or not Verdict[row["verdict"]].deblurred else {**row, "verdict": "UNEXPLAINED", "gain_db": 0.0}


def lost(row: dict) -> str:
    """Where a still that is worth restoring was lost; nothing where it was not."""
    gain, worth = row["gain_db"], row["known_tv_gain_db"]
    if worth < WORTH or gain > KEPT * worth:
        return ""
    near = max(NEAR[0] * row["blur_px"], NEAR[1])
    if row["path_error_px"] > near:
        return "search"
    return "latent image" if row["verdict"] == "RESTORED" else "verdict"


def summary(rows: list[dict]) -> list[dict]:
    """The figures of each half."""
    out = []
    for name in ("choose", "report"):
        some = [row for row in rows if row["half"] == name]
        worth = [row for row in some if row["known_tv_gain_db"] >= WORTH]
        if not worth:
            continue
        share = np.array([row["gain_db"] / row["known_tv_gain_db"] for row in worth])
        rng = np.random.default_rng(0)
        means = [rng.choice(share, len(share)).mean() for _ in range(RESAMPLES)]
        gains = np.array([row["gain_db"] for row in some])
        left = [row for row in worth if not Verdict[row["verdict"]].deblurred]
        out.append(
            {
                "half": name,
                "stills": len(some),
                "share": float(share.mean()),
                "share_low": float(np.quantile(means, 0.025)),
                "share_high": float(np.quantile(means, 0.975)),
                "above_80": float((share > KEPT).mean()),
                "harmed": float((gains < -HARM).mean()),
                "least_db": float(gains.min()),
                "left_though_worth": len(left) / len(worth),
                "restored_in_vain": sum(r["known_tv_gain_db"] < 0 and Verdict[r["verdict"]].deblurred for r in some) / len(some),
                "mean_gain_db": float(gains.mean()),
                "seconds": float(np.mean([row["seconds"] for row in some])),
                **{f"lost_{stage.replace(' ', '_')}": sum(lost(r) == stage for r in some) for stage in STAGES},
            }
        )
    return out


def main() -> None:
    """Draw, restore, and write FILE."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photographs", type=Path, nargs="?", metavar="PHOTOS")
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--judged", type=Path, metavar="FILE")
    parser.add_argument("--each", type=int, default=1)
    parser.add_argument("--half", choices=("choose", "report"))
    parser.add_argument("--large", action="store_true")
    parser.add_argument("--gyro", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    if args.judged:
        published.print_rows(summary([judged(row) for row in json.loads(args.judged.read_text())["stills"]]))
        return
    if not args.photographs or not args.output:
        parser.error("PHOTOS and -o FILE, or --judged FILE")
    os.environ |= {"OMP_NUM_THREADS": "1", "RSVIDEO_THREADS": "1"} if args.jobs > 1 else {}
    photographs = sorted(p for p in args.photographs.iterdir() if p.suffix.lower() in (".jpg", ".png") and args.half in (None, half(p)))
    if not photographs:
        sys.exit(f"{args.photographs} must hold JPEG or PNG pictures")
    log = gyro.parse(args.gyro.read_text().splitlines()) if args.gyro else None
    with tempfile.TemporaryDirectory() as name, ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        if args.large:
            photographs = mosaics(photographs, Path(name))
        sizes = LARGE if args.large else SIZES
        draw = partial(made, folder=args.keep or Path(name, "stills"), seed=args.seed, log=log, sizes=sizes)
        cases = [case for case in pool.map(draw, *zip(*product(photographs, range(args.each)), strict=True)) if case]
        rows = []
        for row in pool.map(restored, cases):
            rows.append(row)
            print(f"{row['case']}: {row['gain_db']:.2f} of {row['known_tv_gain_db']:.2f} dB, {row['verdict']} {lost(row)}", flush=True)
    args.output.write_text(json.dumps({"summary": summary(rows), "stills": rows}, indent=1) + "\n")
    published.print_rows(summary(rows))


if __name__ == "__main__":
    main()
