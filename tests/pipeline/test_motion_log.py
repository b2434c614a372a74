"""The log of a clip: joined a few frames at a time, it is the log of the whole."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from rsvideo.config.sidecar import FrameRecord, Sampled, Timing
from rsvideo.physics.camera import Camera
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.pipeline import motion_log
from rsvideo.restoration.movement import joined
from rsvideo.shooting import gcsv
from tests.pipeline.moving import Moving

CLIP = Moving(frames=60)


def records(frames: int) -> list[FrameRecord]:
    """What a perfect method would say of frames that begin 1 s into the clip."""
    timing, begins = CLIP.timing, 1.0 + np.arange(frames) / 24
    t = Sampled.times(*timing.interval)
    way = [CLIP.path.at(t + b - 1.0) - CLIP.path.at(np.array([b - 1.0 + timing.middle])) for b in begins]
    middles = CLIP.path.at(begins - 1.0 + timing.middle)
    shutter = Timing(exposure_s=timing.exposure, row_time_s=timing.row_time, source="explicit")
    return [
        FrameRecord(
            index=k,
            time_s=begins[k],
            timing=shutter,
            trajectory=Sampled.of(t, way[k]),
            to_next=[*(middles[k + 1] - middles[k]), 0.0][:3] if k + 1 < frames else None,
            verdict="restored",
            seconds=1.0,
        )
        for k in range(frames)
    ]


def at_rest(frames: int, rate: float, timing: ShutterTiming) -> Iterator[FrameRecord]:
    t = np.linspace(*timing.interval, 4)
    shutter = Timing(exposure_s=timing.exposure, row_time_s=timing.row_time, source="explicit")
    way = Sampled.of(t, np.zeros((4, 3)))
    for k in range(frames):
        yield FrameRecord(index=k, time_s=k / rate, timing=shutter, trajectory=way, to_next=[0.0] * 3, verdict="restored", seconds=1.0)


def quick(rate: float) -> Camera:
    """A camera whose readout and exposure fit frames at that rate."""
    return replace(CLIP.camera, timing=ShutterTiming.from_readout(exposure=0.2 / rate, readout=0.5 / rate, rows=96))


def test_parts_are_pieces_of_the_whole_path_and_cover_it() -> None:
    frames = records(60)
    steps = np.array([frame.to_next or [0.0] * 3 for frame in frames])
    within = [(np.array(frame.trajectory.t_s), frame.trajectory.poses()) for frame in frames]
    t, poses = joined(np.array([frame.time_s for frame in frames]), within, steps, CLIP.timing)
    angles = np.stack([-poses[:, 1] / CLIP.lens.fy, poses[:, 0] / CLIP.lens.fx, poses[:, 2]], axis=1)
    begun, parts = 0.0, list(motion_log.parts(iter(frames), 24.0, CLIP.camera))
    assert len(parts) > 2
    for part in parts:
        assert part.t_s[0] <= begun < part.until <= part.t_s[-1] + 1e-9
        mine = (part.t_s >= begun) & (part.t_s <= part.until)
        expected = np.stack([np.interp(part.t_s[mine], t - t[0], angles[:, axis]) for axis in range(3)], axis=1)
        assert np.abs(part.angles[mine] - expected).max() * CLIP.lens.fx < 0.02  # px
        begun = part.until
    assert begun > t[-1] - t[0] - 2e-3


@pytest.mark.parametrize(("frames", "rate"), [(1, 24), (3, 1000), (3, 100_000)])
def test_one_frame_and_a_few_milliseconds_make_no_log(frames: int, rate: int) -> None:
    camera = quick(rate)
    assert list(motion_log.parts(at_rest(frames, rate, camera.timing), rate, camera)) == []


@pytest.mark.parametrize("rate", [0.5, 1000, 20_000])
def test_any_rate_makes_a_log_of_the_whole_clip(rate: float) -> None:
    camera, frames = quick(rate), max(30, round(rate / 5))
    parts = list(motion_log.parts(at_rest(frames, rate, camera.timing), rate, camera))
    assert parts[-1].until == pytest.approx((frames - 0.5) / rate, abs=2e-3 + 0.3 / rate)
    assert len(b"".join(gcsv.encoded(parts, timing=camera.timing)).splitlines()) > 1000 * (parts[-1].until - camera.timing.middle)
