import json
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rsvideo.config import sidecar
from rsvideo.config.files import UnreadableError, write_whole
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.distortion import Distortion
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.tone import Transfer
from rsvideo.physics.trajectory import Polynomial, centred
from rsvideo.shooting import given_motion

LENS = Intrinsics.centred(focal=1000, rows=400, cols=600)
TIMING = ShutterTiming.from_readout(exposure=0.03, readout=0.02, rows=400)
COEFFICIENTS = np.array([[0, 0, 0], [3, -1, 0.002], [1, 2, 0], [0.5, 0, 0.001]])
CURVE = centred(Polynomial(t0=0, t1=0.05, coefficients=COEFFICIENTS), TIMING.middle)
T = sidecar.Sampled.times(0, 0.05)


def example() -> sidecar.Sidecar:
    return sidecar.Sidecar(
        input="in.png",
        settings=sidecar.Settings(
            rsvideo="0",
            camera=sidecar.Camera.of(LENS, "explicit"),
            direction=Direction.TOP_TO_BOTTOM,
            transfer=Transfer.SRGB,
            trajectory_from=None,
            restoration={"degree": 4},
        ),
        frames=[
            sidecar.FrameRecord(
                index=0,
                time_s=0,
                timing=sidecar.Timing(exposure_s=0.03, row_time_s=0.02 / 400, source="explicit"),
                trajectory=sidecar.Sampled.of(T, CURVE.at(T)),
                verdict="restored",
                seconds=1.5,
            )
        ],
    )


def test_a_sidecar_comes_back_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "out.rsvideo.json"
    path.write_bytes(example().encode())
    assert sidecar.read(path) == example()


def of_many(path: Path, count: int) -> sidecar.Sidecar:
    one = example()
    frames = [one.frames[0].model_copy(update={"index": k, "to_next": [1.0, 2.0, 0.0] if k % 2 else None}) for k in range(3, 3 + count)]
    made = one.model_copy(update={"frames": frames})
    path.write_bytes(made.encode())
    return made


@pytest.mark.parametrize("written", ["by us", "by others", "cut short by others"])
def test_chosen_frames_are_found_however_the_file_is_laid_out(tmp_path: Path, written: str) -> None:
    path = tmp_path / "out.rsvideo.json"
    made = of_many(path, 5)
    if written != "by us":
        path.write_text(json.dumps(json.loads(path.read_text()), indent=2))
    if written == "cut short by others":
        path.write_text(path.read_text()[:-20])
        with pytest.raises(UnreadableError, match=r"out\.rsvideo\.json"):
            sidecar.frames(path, {4})
    else:
        assert sidecar.frames(path, {4, 7, 99}) == {4: made.frames[1], 7: made.frames[4]}
        assert sidecar.read(path) == made


def test_a_sidecar_that_is_cut_short_or_absent_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "out.rsvideo.json"
    of_many(path, 5)
    path.write_bytes(path.read_bytes()[:-40])
    for each in (path, tmp_path / "absent.json"):
        with pytest.raises(UnreadableError, match=each.name):
            sidecar.frames(each, {4})


def test_memory_does_not_grow_with_the_number_of_frames(tmp_path: Path) -> None:
    one = example()

    def peak(count: int) -> int:
        def frames() -> Iterator[sidecar.FrameRecord]:
            for index in range(count):
                yield one.frames[0].model_copy(update={"index": index})

        tracemalloc.start()
        write_whole({tmp_path / "x.json": sidecar.encoded("in.mp4", one.settings, frames())})
        assert list(sidecar.frames(tmp_path / "x.json", {count - 1})) == [count - 1]
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    assert peak(200) < 2 * peak(20)


def test_what_was_written_with_it_is_read_from_its_head_if_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "out.rsvideo.json"
    mark = sidecar.Mark(job="../job.yaml", input="../in.png", settings="a", source="b")
    stated = sidecar.Written(sha256={"out.png": "c"}, restored=1, left=0, failed=0, seconds=1.5, notes=("cropped",), mark=mark)
    whole = example().model_copy(update={"written": stated}).encode()
    path.write_bytes(whole)
    assert sidecar.written(path) == sidecar.read(path).written == stated
    for damaged in (
        whole[:-1],
        whole[:200],
        b"",
        b"{",
        whole.replace(b'"seconds":1.5,"notes"', b'"seconds":-1,"notes"'),
        example().encode(),
    ):
        path.write_bytes(damaged)
        assert sidecar.written(path) is None
    assert sidecar.written(tmp_path / "absent") is None


def test_its_keys_are_those_that_are_promised() -> None:
    record = json.loads(example().encode())
    assert list(record) == ["version", "input", "settings", "frames"]
    assert list(record["frames"][0]) == ["index", "time_s", "timing", "trajectory", "verdict", "seconds"]
    assert list(record["frames"][0]["timing"]) == ["exposure_s", "row_time_s", "source"]
    assert list(record["frames"][0]["trajectory"]) == ["t_s", "x_px", "y_px", "roll_rad"]


def test_the_trajectory_is_sampled_over_the_whole_interval_a_quarter_millisecond_apart() -> None:
    sampled = example().frames[0].trajectory
    assert (sampled.t_s[0], sampled.t_s[-1]) == (0, 0.05)
    assert len(sampled.t_s) >= 64
    assert np.diff(sampled.t_s).max() <= 0.25e-3 + 1e-12


def test_a_sidecar_given_as_motion_is_the_motion_it_records(tmp_path: Path) -> None:
    path = tmp_path / "out.rsvideo.json"
    path.write_bytes(example().encode())
    t = np.linspace(0, 0.05, 777)
    difference = np.abs(given_motion.read(path, Camera(timing=TIMING, intrinsics=LENS)).at(t) - CURVE.at(t))
    assert difference[:, :2].max() < 0.02
    assert difference[:, 2].max() * 360 < 0.02


def test_timing_and_camera_come_back_as_the_nouns() -> None:
    record = example()
    assert record.timing(record.frames[0]) == TIMING
    assert record.settings.camera.intrinsics == LENS


def test_a_lens_and_its_sensors_noise_come_back_and_are_left_out_where_there_are_none(tmp_path: Path) -> None:
    lens = Distortion(model="brown-conrady", coefficients=(-0.1, 0.02, 0.001, 0.0, 0.0))
    camera = sidecar.Camera.of(replace(LENS, distortion=lens), "mine", Noise(read=0.002, shot=1e-4))
    record = example()
    record = record.model_copy(update={"settings": record.settings.model_copy(update={"camera": camera})})
    (tmp_path / "out.json").write_bytes(record.encode())
    found = sidecar.read(tmp_path / "out.json").settings.camera
    assert found.intrinsics == replace(LENS, distortion=lens)
    assert found.sensor_noise == Noise(read=0.002, shot=1e-4)
    plain = json.loads(example().encode())["settings"]["camera"]
    assert list(plain) == ["fx", "fy", "cx", "cy", "rows", "cols", "source"]
    assert sidecar.Camera.model_validate(plain).sensor_noise is None


@pytest.mark.parametrize(
    ("break_it", "where"),
    [
        (lambda r: r.update(version=2), "version"),
        (lambda r: r.update(frames=[]), "frames"),
        (lambda r: r.update(extra=1), "extra"),
        (lambda r: r["frames"][0]["timing"].update(exposure_s=-1), r"frames\.0\.timing\.exposure_s"),
        (lambda r: r["frames"][0]["trajectory"]["x_px"].pop(), "equally long"),
        (lambda r: r["frames"][0]["trajectory"]["t_s"].reverse(), "t_s must rise"),
        (lambda r: r["frames"][0]["trajectory"]["y_px"].__setitem__(3, None), r"frames\.0\.trajectory\.y_px\.3"),
        (lambda r: r["frames"][0]["trajectory"]["x_px"].__setitem__(3, 1e300), r"frames\.0\.trajectory\.x_px\.3"),
        (lambda r: r["frames"][0]["trajectory"]["t_s"].__setitem__(1, 1e-300), "t_s must rise"),
        (lambda r: r["frames"][0]["timing"].update(exposure_s=1e9), r"frames\.0\.timing\.exposure_s"),
        (lambda r: r["frames"][0]["timing"].update(row_time_s=5), "readout must lie in"),
        (lambda r: r["frames"][0].update(psfs=[[[[1.0], [1.0, 2.0]]]]), "all of one size"),
        (lambda r: r["frames"][0].update(verdict="x" * 10_000), r"frames\.0\.verdict"),
        (lambda r: r["settings"]["camera"].update(rows=10**18), r"settings\.camera\.rows"),
        (lambda r: r["settings"]["camera"].update(fx=1e-300), r"settings\.camera\.fx"),
        (lambda r: r["settings"]["camera"].update(distortion={"model": "fisheye", "coefficients": [1e9] * 4}), r"settings\.camera"),
        (lambda r: r["settings"]["camera"].update(noise={"read": -1, "shot": 0}), r"settings\.camera"),
    ],
)
def test_a_broken_sidecar_is_refused_with_its_file_and_key(tmp_path: Path, break_it, where: str) -> None:
    record = json.loads(example().encode())
    break_it(record)
    path = tmp_path / "out.rsvideo.json"
    path.write_text(json.dumps(record))
    with pytest.raises(UnreadableError, match=rf"out\.rsvideo\.json: .*{where}"):
        sidecar.read(path)


@pytest.mark.parametrize("text", ["[]", "{", "NaN", '{"version": 1, "input": "x"}', "[" * 100_000])
def test_text_that_is_no_sidecar_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "x.json"
    path.write_text(text)
    with pytest.raises(UnreadableError, match=r"x\.json"):
        sidecar.read(path)


def test_more_values_than_a_sidecar_has_are_refused_before_they_are_made(tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    path.write_text("[" + "1," * 3_000_000 + "1]")
    tracemalloc.start()
    try:
        with pytest.raises(UnreadableError, match="at most 2000000 values"):
            sidecar.read(path)
        assert tracemalloc.get_traced_memory()[1] < 5 * path.stat().st_size
    finally:
        tracemalloc.stop()


def test_a_figure_s_frame_is_read_without_the_others(tmp_path: Path) -> None:
    path = tmp_path / "out.rsvideo.json"
    made = of_many(path, 5)
    path.write_bytes(path.read_bytes().replace(b'"index":5', b'"index":-5'))
    assert sidecar.read(path, most_frames=1).frames == made.frames[:1]
    with pytest.raises(UnreadableError, match="index"):
        sidecar.read(path)


def test_a_name_that_is_no_text_can_be_written_and_read_back(tmp_path: Path) -> None:
    settings = example().settings.model_copy(update={"trajectory_from": None})
    path = tmp_path / "out.rsvideo.json"
    path.write_bytes(b"".join(sidecar.encoded("clip\udcff.mp4", settings, example().frames)))
    assert sidecar.read(path).input == "clip\\xff.mp4"
