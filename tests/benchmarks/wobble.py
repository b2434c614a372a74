"""Rectify clips of known motion and print how far their points lie from where a global shutter had seen them, before and after.

    python tests/benchmarks/wobble.py [--shared FOLDER]

Simulated clips have short exposures and a hand's shake, 0.3 and 0.6 rad/s RMS (a recording of vigorous hands has 0.6). `told` are
pixels whose places the true motion tells; `tracked` are corners of the true frames found again by Lucas-Kanade, whose own
error of some 0.1 px is in both. Of each frame the mean displacement is removed: it is no wobble. FOLDER holds cases/clips, which are
blurred, and real/dual_reversed_real, pairs of one moment read downwards and upwards, whose points must meet: of these every other
point tells the motion and the others are measured, RMS and median; their focal length is taken for their width.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import skimage.data
from cases import cases_of, facts_of

from rsvideo.baselines.rectify import movement
from rsvideo.frame import Frame
from rsvideo.physics import gyro
from rsvideo.physics.camera import Camera, Intrinsics, turned
from rsvideo.physics.luminance import luminance
from rsvideo.physics.noise import Noise
from rsvideo.physics.shake import shake
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.simulate import margin, render
from rsvideo.physics.trajectory import Spline, Trajectory
from rsvideo.restoration.camera_path import follow, unexplained, within
from rsvideo.restoration.clip_motion import gather
from rsvideo.restoration.movement import Movement
from rsvideo.restoration.parallax import Flow, Points, flows
from rsvideo.restoration.rectification import rectified
from rsvideo.restoration.scanlines import path_along_scanlines, to_scanlines
from rsvideo.restoration.settings import Settings
from rsvideo.restoration.tracks import Tracks, codes, track
from rsvideo.stills import still
from rsvideo.video import colour
from rsvideo.video.decode import pictures, probe

FRAMES, RATE = 16, 30
ROWS, COLS, FOCAL = 240, 360, 400.0
SCENES = ("coffee.png", "astronaut.png", "rocket.jpg", "camera.png", "motorcycle_left.png")


@dataclass(frozen=True, kw_only=True, eq=False)
class Clip:
    """Frames, what they should have been, and the true motion within each, in seconds of that frame."""

    name: str
    frames: list[Frame]
    truth: list[np.ndarray]
    ways: Sequence[Trajectory]
    camera: Camera


def simulated(scene: str, rms: float, seed: int, direction: Direction) -> Clip:
    """A sharp clip of a shaken camera."""
    light = still.read(Path(skimage.data.__file__).parent / scene).pixels.astype(np.float64)
    lens = Intrinsics.centred(focal=FOCAL, rows=ROWS, cols=COLS)
    lines = COLS if direction in (Direction.LEFT_TO_RIGHT, Direction.RIGHT_TO_LEFT) else ROWS
    timing = ShutterTiming.from_readout(exposure=0.5e-3, readout=0.025, rows=lines, direction=direction)
    camera = Camera(timing=timing, intrinsics=lens)
    begins = np.arange(FRAMES) / RATE
    step = 0.5e-3
    angles = shake(np.random.default_rng(seed), float(begins[-1]) + timing.interval[1], 1 / step, rms=rms)
    angles -= angles.mean(axis=0)
    whole = gyro.spline_through(gyro.poses_from_angles(angles, camera=lens), duration=step * (len(angles) - 1), spacing=0.0025)
    assert isinstance(whole, Spline)
    ways = [replace(whole, t0=whole.t0 - b, t1=whole.t1 - b) for b in begins]
    needed = np.max([margin(camera=camera, trajectory=way) for way in ways], axis=0)
    if (np.array(light.shape[:2]) < np.array([ROWS, COLS]) + 2 * needed).any():
        light = np.pad(light, ((needed[0], needed[0]), (needed[1], needed[1]), (0, 0)), mode="reflect")
    rng = np.random.default_rng([seed, 1])
    made = [render(light, camera=camera, trajectory=w, noise=Noise.at_half(0.005), rng=rng, samples=4) for w in ways]
    frames = [
        Frame(pixels=m.blurred, clipped=m.blurred >= 1, time=float(b), index=k) for k, (m, b) in enumerate(zip(made, begins, strict=True))
    ]
    name = f"{Path(scene).stem} {rms:g} rad/s {direction.value}"
    return Clip(name=name, frames=frames, truth=[m.truth for m in made], ways=ways, camera=camera)


def rendered(case: Path) -> Clip:
    """A blurred clip with its truth."""
    facts = facts_of(case)
    lens = Intrinsics.centred(focal=facts["focal_px"], rows=facts["rows"], cols=facts["cols"])
    timing = ShutterTiming.from_readout(exposure=facts["exposure_s"], readout=facts["readout_s"], rows=facts["rows"])
    t, *angles = np.loadtxt(case / "motion.csv", delimiter=",", skiprows=1).T
    poses = gyro.poses_from_angles(np.stack(angles, axis=1), camera=lens)
    even = np.linspace(t[0], t[-1], len(t))
    poses = np.stack([np.interp(even, t, p) for p in poses.T], axis=1)
    whole = gyro.spline_through(poses, duration=float(t[-1] - t[0]), spacing=0.002)
    assert isinstance(whole, Spline)
    frames, truth = list(decoded(case / "clip.mp4")), [f.pixels for f in decoded(case / "truth.mp4")]
    ways = [replace(whole, t0=t[0] - f.time, t1=t[-1] - f.time) for f in frames]
    camera = Camera(timing=timing, intrinsics=lens)
    return Clip(name=case.name, frames=frames, truth=truth, ways=ways, camera=camera)


def decoded(path: Path) -> Iterator[Frame]:
    """A clip's frames."""
    stream = probe(path)
    for picture in pictures(stream):
        pixels, clipped = colour.light(picture, stream.colour)
        yield Frame(pixels=pixels, clipped=clipped, time=picture.time, index=picture.index)


def poses(way: Trajectory, timing: ShutterTiming, scanlines: np.ndarray) -> np.ndarray:
    """The mean pose over each scanline's exposure, relative to the pose of the middle."""
    times = scanlines[:, None] * timing.row_time + timing.sample_times(16)[0]
    return way.at(times).mean(axis=1) - way.at(np.array([timing.middle]))


def told(moving: Clip, k: int, found: Movement | None) -> np.ndarray:
    """How far what frame k shows in its pixels, as it is or rectified, lies from where it belongs: places are rectified like light."""
    timing, lens = moving.camera.timing, moving.camera.intrinsics
    extent = np.array([lens.cols, lens.rows])
    y, x = np.mgrid[: lens.rows, : lens.cols].astype(float)
    scanlines = timing.direction.image(np.broadcast_to(np.arange(timing.rows)[:, None], timing.direction.scanlines(x).shape))
    here = np.stack([x, y], axis=-1)
    home = here + turned(lens, x, y, poses(moving.ways[k], timing, np.arange(float(timing.rows)))[scanlines])
    pixels = (0.25 + 0.5 * home / extent).astype(np.float32)  # so that places somewhat outside lie in [0, 1] too
    shown = Frame(pixels=pixels, clipped=np.zeros(pixels.shape, bool))
    if found is not None and (way := found.within[k]) is not None:
        shown = straight(moving, shown, way, found.evidence[k].flow)
    inside = ~shown.clipped.any(axis=2)
    return ((shown.pixels - 0.25) / 0.5 * extent - here)[inside]


def straight(moving: Clip, frame: Frame, way: Trajectory, flow: Flow | None) -> Frame:
    """The frame rectified along a path in image axes."""
    view = to_scanlines(frame, moving.camera)
    return rectified(view, path_along_scanlines(way, moving.camera.timing.direction), flow=flow).frame


def tracked(pixels: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """How far the true frame's corners lie from where they belong."""
    pair = track(codes(luminance(truth)), codes(luminance(pixels)))
    return pair.after - pair.before


def rms(displacements: list[np.ndarray]) -> float:
    """Over all points of all frames, each frame's mean removed."""
    apart = np.concatenate([d - d.mean(axis=0) for d in displacements if len(d)])
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


def measured(moving: Clip) -> tuple[float, ...]:
    """Wobble before and after, as the true motion tells it and as corners show it."""
    found = movement(gather(moving.frames, moving.camera, Settings(), blur=False))
    before, now = (rms([told(moving, k, how) for k in range(len(moving.frames))]) for how in (None, found))
    ways = zip(moving.frames, found.within, [one.flow for one in found.evidence], strict=True)
    shown = [straight(moving, f, w, u) if w else f for f, w, u in ways]
    seen = rms([tracked(f.pixels, t) for f, t in zip(moving.frames, moving.truth, strict=True)])
    left = rms([tracked(f.pixels, t) for f, t in zip(shown, moving.truth, strict=True)])
    return before, now, now / before, seen, left, left / seen


def paired(folder: Path, name: str) -> tuple[float, ...]:
    """How far the points of a pair lie apart, RMS before and after, and the same of the median."""
    down, up = (still.read(folder / f"{name}_{way}.png").pixels for way in ("t2b", "b2t"))
    rows, cols = down.shape[:2]
    camera = Intrinsics.centred(focal=float(cols), rows=rows, cols=cols)
    timing = ShutterTiming.from_readout(exposure=1e-3, readout=0.03, rows=rows)
    points = track(codes(luminance(down)), codes(luminance(up)))
    half, rest = (Tracks(before=points.before[k::2], after=points.after[k::2]) for k in (0, 1))
    path = follow([half], np.zeros(2), Camera(timing=timing, intrinsics=camera), 3, backwards=(1,)).spline
    ((moved, elapsed),) = unexplained(path, [half], np.zeros(2), Camera(timing=timing, intrinsics=camera), backwards=(1,))
    (flow,) = flows([Points(at=half.before, moved=moved, elapsed=elapsed)], max(rows, cols))
    way, home = within(path, 0.0, timing), []
    for seen, scanlines in ((rest.before, rest.before[:, 1]), (rest.after, rows - 1 - rest.after[:, 1])):
        when = scanlines * timing.row_time + timing.exposure / 2 - timing.middle
        own = when[:, None] * flow.at(seen) if flow else 0.0
        home.append(seen + turned(camera, seen[:, 0], seen[:, 1], poses(way, timing, scanlines)) - own)
    apart = [d - d.mean(axis=0) for d in (rest.after - rest.before, home[1] - home[0])]
    before, now = (float(np.sqrt((d**2).sum(axis=1).mean())) for d in apart)
    seen, left = (float(np.median(np.linalg.norm(d, axis=1))) for d in apart)
    return before, now, now / before, seen, left, left / seen


def main() -> None:
    """Print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shared", type=Path)
    args = parser.parse_args()
    print("| clip | told: before px | after px | ratio | tracked: before px | after px | ratio |\n|---|---|---|---|---|---|---|")
    ways = list(Direction)
    made = (simulated(scene, level, n, ways[(n + k) % 4]) for n, scene in enumerate(SCENES) for k, level in enumerate((0.3, 0.6)))
    for moving in made:
        print(f"| {moving.name} | " + " | ".join(f"{v:.2f}" for v in measured(moving)) + " |", flush=True)
    if args.shared:
        for name in ("r0", "r1", "s0", "s1"):
            values = paired(args.shared / "real" / "dual_reversed_real", name)
            print(f"| pair {name}, RMS and median | " + " | ".join(f"{v:.2f}" for v in values) + " |", flush=True)
        for case in cases_of(args.shared / "cases" / "clips"):
            print(f"| {case.name}, blurred | " + " | ".join(f"{v:.2f}" for v in measured(rendered(case))) + " |", flush=True)


if __name__ == "__main__":
    main()
