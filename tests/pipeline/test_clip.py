"""One clip from file to file: chunks that cover it, work that can be repeated, and all that a null run keeps."""

import errno
import json
import tracemalloc
import weakref
from collections import Counter
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsvideo.config.files import UnreadableError
from rsvideo.config.method import Method
from rsvideo.config.placing import place
from rsvideo.config.request import Request, option_fields
from rsvideo.frame import Verdict
from rsvideo.physics.shutter import Direction
from rsvideo.physics.tone import Curve, Transfer
from rsvideo.pipeline.chunk import AHEAD, LONGEST, WARM_UP, chunks, planned, treated, work
from rsvideo.pipeline.clip import Tally, carry_out, finish, outcome
from rsvideo.pipeline.pieces import Chunk, ChunkRecord, Outcome, frame_records
from rsvideo.pipeline.prepare import Task, prepare
from rsvideo.progress import Progress
from rsvideo.video import decode, vidstab
from rsvideo.video import planes as zipped
from rsvideo.video.stream import Picture, Stream
from tests.pipeline.moving import Moving, encode, luma, planes
from tests.video.clips import make, packets, still
from tests.video.test_decode import in_the_middle

KNOWN: dict[str, Any] = {"exposure": 0.02, "readout": 0.02, "focal_px": 192.0}


def asked(source: Path, output: Path, *, overwrite: bool = False, **words: Any) -> Request:
    """A request by its fields' names, whatever section they are in."""
    sections: dict[str, dict[str, Any]] = {}
    for each in option_fields():
        if each.name in words:
            sections.setdefault(each.section, {})[each.name] = words.pop(each.name)
    assert not words
    return Request.model_validate({"source": source, "output": output, "overwrite": overwrite, **sections})


def silent(*_: object) -> None:
    """Watch nothing."""


def carried_out(task: Task, folder: Path) -> tuple[Outcome, list[ChunkRecord]]:
    records = [work(task, chunk, folder, silent) for chunk in chunks(task)]
    finished = finish(task, records, folder)
    place(finished.made)
    return finished.outcome, records


def decoded(path: Path) -> tuple[Stream, list[tuple[np.ndarray, ...]]]:
    stream = decode.probe(path)
    return stream, [picture.planes for picture in decode.pictures(stream)]


def test_a_profile_answers_for_lens_readout_and_tone(tmp_path: Path) -> None:
    profile = tmp_path / "mine.yaml"
    profile.write_text(
        "name: Mine\nmode: {rows: 96, cols: 160}\nintrinsics: {fx: 120, fy: 121, cx: 31, cy: 24}\n"
        "timing: {readout_s: 0.024, direction: bottom-to-top}\ntone: {curve: [0, 0.25, 1], clip: 0.9}\n"
    )
    source = tmp_path / "a.mp4"
    make(source, rows=96, cols=160, frames=2)
    task = prepare(asked(source, tmp_path / "b.mp4", exposure=0.01, profile=str(profile)))
    assert (task.camera.fx, task.camera.fy, task.camera.cx, task.camera.cy) == (120, 121, 31, 24)
    assert task.timing.readout == pytest.approx(0.024)
    assert task.timing.direction is Direction.BOTTOM_TO_TOP
    assert (task.stream.colour.transfer, task.stream.colour.saturation) == (Curve(light=(0.0, 0.25, 1.0)), 0.9)
    over = prepare(asked(source, tmp_path / "b.mp4", exposure=0.01, profile=str(profile), transfer="s-log3", focal_px=99.0))
    assert over.stream.colour.transfer is Transfer.SLOG3
    assert over.camera.source == "explicit"


def joined_scenes(path: Path, lengths: tuple[int, ...]) -> Path:
    """Scenes of noise, each still and of another brightness, one after the other."""
    pictures = []
    for k, length in enumerate(lengths):
        scene = np.random.default_rng(k).integers(20 + 80 * (k % 2), 60 + 160 * (k % 2), (36, 48)).astype(np.uint8)
        pictures += [(scene, *[np.full((18, 24), 128, np.uint8)] * 2)] * length
    return encode(path, pictures)


def test_chunks_cover_the_clip_exactly_and_begin_at_its_cuts(tmp_path: Path) -> None:
    source = joined_scenes(tmp_path / "in.mkv", (70, 5, 40))
    found = chunks(prepare(asked(source, tmp_path / "out.mkv", **KNOWN)))
    assert [chunk.index for chunk in found] == list(range(len(found)))
    assert [i for chunk in found for i in range(chunk.first, chunk.last + 1)] == list(range(115))
    assert {0, 70, 75} <= {chunk.first for chunk in found}
    assert max(chunk.last - chunk.first + 1 for chunk in found) <= LONGEST
    for chunk in found:
        scene = max(begin for begin in (0, 70, 75) if begin <= chunk.first)
        assert chunk.warm_up == min(WARM_UP, chunk.first - scene)  # never from before a cut


def test_chunks_depend_on_the_clip_alone(tmp_path: Path) -> None:
    source = joined_scenes(tmp_path / "in.mkv", (20, 50))
    (tmp_path / "elsewhere").mkdir()
    one = chunks(prepare(asked(source, tmp_path / "out.mkv", **KNOWN)))
    other = chunks(prepare(asked(source, tmp_path / "elsewhere" / "b.mp4", **KNOWN, codec="h264", path="smooth")))
    assert one == other


def test_a_picture_is_let_go_once_it_is_shown(tmp_path: Path) -> None:
    task = prepare(asked(joined_scenes(tmp_path / "in.mkv", (9,)), tmp_path / "out.mkv", **KNOWN))
    (chunk,) = chunks(task)
    held: list[weakref.ref[Picture]] = []

    def seen() -> Iterator[Picture]:
        for picture in decode.pictures(task.stream):
            held.append(weakref.ref(picture))
            yield picture

    left = []
    for picture, _, _ in treated(task.treatment, chunk, seen(), task.stream.colour, None, silent):
        assert picture.index == len(left)
        del picture
        left.append(sum(ref() is not None for ref in held))
    assert left == list(range(9, 0, -1))  # the one that is shown is held until the next one is


def test_chunks_that_do_not_hold_every_frame_once_make_no_clip(tmp_path: Path) -> None:
    source = joined_scenes(tmp_path / "in.mkv", (12, 12))
    task = prepare(asked(source, tmp_path / "out.mkv", **KNOWN, method="none"))
    parts = planned(0, 24, (12,), task.picture_bytes)
    (tmp_path / "work").mkdir()
    one, other = (work(task, chunk, tmp_path / "work", silent) for chunk in parts)
    for records in ([one], [other], [one, other, other]):
        with pytest.raises(ValueError, match=r"frames 0 to 23, each once"):
            finish(task, records, tmp_path / "work")
    assert len(finish(task, [one, other], tmp_path / "work").made) == 2
    assert not task.request.output.exists()


@pytest.mark.parametrize("stage", ["encoded", "rename"])
def test_a_clip_whose_sidecar_cannot_be_written_does_not_appear(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stage: str) -> None:
    source = joined_scenes(tmp_path / "in.mkv", (4,))
    task = prepare(asked(source, tmp_path / "out.mkv", **KNOWN, method="none"))
    rename = Path.rename

    def full(*_: object) -> Iterator[bytes]:
        yield b"{"
        raise OSError(errno.ENOSPC, "No space left on device")

    def refused(self: Path, target: Path) -> Path:
        if target == task.request.record:
            raise OSError(errno.ENOSPC, "No space left on device")
        return rename(self, target)

    if stage == "encoded":
        monkeypatch.setattr("rsvideo.config.sidecar.encoded", full)
    else:
        monkeypatch.setattr(Path, "rename", refused)
    with pytest.raises(OSError, match=r"No space left.*out\.rsvideo\.json"):
        carry_out(task, silent)
    assert [path.name for path in tmp_path.iterdir()] == ["in.mkv"]


def test_a_range_is_cut_into_chunks_by_itself(tmp_path: Path) -> None:
    source = joined_scenes(tmp_path / "in.mkv", (20, 20))
    task = prepare(asked(source, tmp_path / "out.mkv", **KNOWN, range=(0.5, 1.0)))
    assert (task.first, task.last, task.frames) == (12, 24, 12)
    assert [(chunk.first, chunk.last, chunk.warm_up) for chunk in chunks(task)] == [(12, 19, 0), (20, 23, 0)]


def test_a_range_beyond_the_clip_is_refused(tmp_path: Path) -> None:
    source = joined_scenes(tmp_path / "in.mkv", (20,))
    with pytest.raises(ValueError, match=r"at least one frame of the clip's 0\.83"):
        prepare(asked(source, tmp_path / "out.mkv", **KNOWN, range=(60.0, 120.0)))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"readout": 0.05}, "readout"),
        ({"codec": "prores"}, "ProRes must be written to .mov"),
        ({"rate": "fast"}, "rate must be a number of frames a second"),
        ({"degree": 99}, r"degree\n.*less than or equal to 12"),
    ],
)
def test_what_cannot_be_is_refused_before_any_work(tmp_path: Path, words: dict[str, Any], said: str) -> None:
    source = joined_scenes(tmp_path / "in.mp4", (4,))
    with pytest.raises(ValueError, match=said):
        prepare(asked(source, tmp_path / "out.mp4", **{**KNOWN, **words}))
    assert [path.name for path in tmp_path.iterdir()] == ["in.mp4"]


def test_a_frame_too_small_to_measure_motion_by_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UnreadableError, match="at least 32 x 32 px, it is 64 x 24"):
        prepare(asked(make(tmp_path / "in.mp4", rows=24), tmp_path / "out.mp4", **KNOWN))


@pytest.mark.parametrize("name", ["out.mp4", "out.rsvideo.json", "out.gcsv"])
def test_what_is_there_is_not_replaced_unless_asked(tmp_path: Path, name: str) -> None:
    source = joined_scenes(tmp_path / "in.mp4", (4,))
    (tmp_path / name).write_text("mine")
    with pytest.raises(FileExistsError, match=name):
        prepare(asked(source, tmp_path / "out.mp4", **KNOWN))
    prepare(asked(source, tmp_path / "out.mp4", **KNOWN, overwrite=True))
    with pytest.raises(ValueError, match="must not be INPUT"):
        prepare(asked(source, source, **KNOWN, overwrite=True))


IRREGULAR = [0, 33, 67, 78, 133, 134, 222, 1000]  # ms


@pytest.mark.parametrize("layout", ["yuv420p", "yuv422p10le"])
def test_a_null_run_keeps_every_bit_time_and_packet(tmp_path: Path, layout: str) -> None:
    source = make(tmp_path / "in.mkv", codec="ffv1", layout=layout, rows=47, cols=61, sound=True, base=Fraction(1, 1000), times=IRREGULAR)
    task = prepare(asked(source, tmp_path / "out.mkv", method=Method.NONE))
    outcome, records = carried_out(task, tmp_path)
    (before, one), (after, other) = decoded(source), decoded(tmp_path / "out.mkv")
    for p, q in zip(one, other, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(p, q, strict=True))
    assert [int(t) * before.time_base for t in before.times] == [int(t) * after.time_base for t in after.times]
    assert packets(source, "audio") == packets(tmp_path / "out.mkv", "audio") != []
    assert (outcome.restored, outcome.left, outcome.failed) == (0, 8, 0)
    assert {frame.verdict for frame in frame_records(records, tmp_path)} == {"left as it was: no restoration was asked for"}
    assert not (tmp_path / "out.gcsv").exists()


@pytest.mark.parametrize(
    ("taken", "words"), [(0.02, ()), (0.026, ("26 ms is taken for 2 frames, which are in better focus with it than with 20 ms",))]
)
def test_frames_that_were_restored_with_another_exposure_than_the_stated_one_are_told_of(
    taken: float, words: tuple[str, ...], tmp_path: Path
) -> None:
    task = prepare(asked(make(tmp_path / "in.mkv", codec="ffv1", rows=96, cols=160), tmp_path / "out.mkv", **KNOWN))
    tally = Tally(verdicts=Counter({Verdict.RESTORED: 2}), exposures=[taken, taken])
    notes = outcome(task, tally, ()).notes
    assert len(notes) == len(words)
    assert all(text in note for text, note in zip(words, notes, strict=True))


@pytest.mark.parametrize(("shares", "words"), [([], ()), ([0.02, 0.0312], ("covers up to 3.1 % of 2 frames; it is left as it was",))])
def test_graphics_that_are_left_as_they_were_are_told_of(shares: list[float], words: tuple[str, ...], tmp_path: Path) -> None:
    task = prepare(asked(make(tmp_path / "in.mkv", codec="ffv1", rows=96, cols=160), tmp_path / "out.mkv", **KNOWN))
    notes = outcome(task, Tally(verdicts=Counter({Verdict.RESTORED: 2}), overlaid=shares), ()).notes
    assert len(notes) == len(words)
    assert all(text in note for text, note in zip(words, notes, strict=True))


def test_a_null_run_keeps_rotation_dates_and_tags(tmp_path: Path) -> None:
    source = make(tmp_path / "in.mp4", rotation=90, sound=True, tags={"title": "a walk", "creation_time": "2024-05-06T07:08:09.000000Z"})
    carried_out(prepare(asked(source, tmp_path / "out.mp4", method=Method.NONE)), tmp_path)
    before, after = decode.probe(source), decode.probe(tmp_path / "out.mp4")
    assert before.rotation == after.rotation == 90
    assert before.created == after.created
    assert after.metadata["title"] == "a walk"
    assert before.colour == after.colour
    assert packets(source, "audio") == packets(tmp_path / "out.mp4", "audio")


@pytest.mark.parametrize("layout", ["yuv420p", "yuv422p"])
def test_source_and_result_stand_side_by_side_an_odd_column_less(tmp_path: Path, layout: str) -> None:
    source = make(tmp_path / "in.mkv", codec="ffv1", layout=layout, rows=47, cols=61)
    carried_out(prepare(asked(source, tmp_path / "out.mkv", method=Method.NONE, side_by_side=True)), tmp_path)
    one, other = (luma(tmp_path / name) for name in ("in.mkv", "out.mkv"))
    for p, q in zip(one, other, strict=True):
        np.testing.assert_array_equal(q[:, :60], p[:, :60])
        np.testing.assert_array_equal(q[:, 60:121], p)


@pytest.fixture(scope="module")
def moving(tmp_path_factory: pytest.TempPathFactory) -> tuple[Moving, Path]:
    """Six frames before one scene and four before another, as FFV1."""
    first, second = Moving(frames=6, reach=10.0), Moving(frames=4, reach=10.0, scene="page")
    pictures = [planes(r.blurred) for r in (*first.renderings, *second.renderings)]
    return first, encode(tmp_path_factory.mktemp("moving") / "in.mkv", pictures)


def task_of(moving: tuple[Moving, Path], output: Path, **words: Any) -> Task:
    first, source = moving
    return prepare(asked(source, output, exposure=0.02, readout=0.02, focal_px=first.lens.fx, **words))


@pytest.mark.slow
def test_a_chunk_restored_twice_and_in_any_order_has_the_same_bytes(moving: tuple[Moving, Path], tmp_path: Path) -> None:
    task = task_of(moving, tmp_path / "out.mkv", prior="tv", quality="draft")
    cut = chunks(task)
    assert [(chunk.first, chunk.last) for chunk in cut] == [(0, 5), (6, 9)]
    folders = [tmp_path / name for name in ("one", "other")]
    for folder in folders:
        folder.mkdir()
    one = [work(task, chunk, folders[0], silent) for chunk in cut]
    again = prepare(task.request)
    other = [work(again, chunk, folders[1], silent) for chunk in reversed(cut)][::-1]
    for a, b in zip(one, other, strict=True):
        assert a.sha256[a.pictures] == b.sha256[b.pictures]
        assert (folders[0] / a.pictures).read_bytes() == (folders[1] / b.pictures).read_bytes()
        for f, g in zip(frame_records([a], folders[0]), frame_records([b], folders[1]), strict=True):
            assert (f.index, f.to_next, f.trajectory, f.verdict) == (g.index, g.to_next, g.trajectory, g.verdict)
    assert ChunkRecord.model_validate_json(one[0].model_dump_json()) == one[0]
    steps = [frame.to_next for frame in frame_records(one[:1], folders[0])]
    assert max(max(map(abs, step[:2])) for step in steps[:-1] if step) > 1
    assert steps[-1] is None  # nothing leads over a cut


def test_pictures_that_are_passed_on_are_held_one_at_a_time_and_never_in_linear_light(tmp_path: Path) -> None:
    source = still(tmp_path / "in.mp4", rows=480, cols=640, frames=12)
    sections = {"deblur": {"method": "none"}, "camera": {"exposure": 0.01, "readout": 0.01}}
    task = prepare(Request.model_validate({"source": source, "output": tmp_path / "out.mp4", **sections}))
    (chunk,) = chunks(task)
    tracemalloc.start()
    record = work(task, chunk, tmp_path, silent)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert [frame.verdict for frame in frame_records([record], tmp_path)] == [Verdict.UNTOUCHED] * 12
    assert most < 6 * task.picture_bytes  # its planes in linear light would be 8


def test_a_chunk_that_begins_with_damage_holds_the_picture_before_it(tmp_path: Path) -> None:
    source = in_the_middle(tmp_path / "in", "libx264", ".mp4")
    sections = {"deblur": {"method": "none"}, "camera": {"exposure": 0.01, "readout": 0.01}, "input": {"on_damage": "passthrough"}}
    task = prepare(Request.model_validate({"source": source, "output": tmp_path / "out.mp4", **sections}))
    whole = list(decode.pictures(task.stream, on_damage="passthrough"))
    record = work(task, Chunk(index=0, first=5, last=6, warm_up=4), tmp_path, silent)
    shown = list(zipped.read(tmp_path / record.pictures, task.stream, (5, 6)))
    assert [frame.verdict for frame in frame_records([record], tmp_path)] == [Verdict.DAMAGED] * 2
    for one, other in zip(shown, whole[5:7], strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(one.planes, other.planes, strict=True)), one.index


@pytest.mark.slow
def test_progress_names_every_frame_and_ends_at_the_whole(moving: tuple[Moving, Path], tmp_path: Path) -> None:
    task = task_of(moving, tmp_path / "out.mkv", prior="tv", quality="draft", range=(0.0, 0.12))
    reports: list[Progress] = []
    work(task, chunks(task)[0], tmp_path, reports.append)
    assert {at.frame for at in reports if at.stage == "motion"} == {0, 1, 2}
    for index in range(3):
        mine = [at.fraction for at in reports if at.frame == index and at.stage == "restoring"]
        assert mine == sorted(mine)
        assert mine[-1] == 1


def test_a_chunk_looks_a_few_frames_ahead_but_not_over_the_end_of_a_range(moving: tuple[Moving, Path], tmp_path: Path) -> None:
    assert AHEAD >= 1
    task = task_of(moving, tmp_path / "out.mkv", prior="tv", quality="draft", range=(0.0, 0.08))
    (chunk,) = chunks(task)
    record = work(task, chunk, tmp_path, silent)
    assert [frame.index for frame in frame_records([record], tmp_path)] == [0, 1]


def test_the_sidecar_says_what_was_done(moving: tuple[Moving, Path], tmp_path: Path) -> None:
    given = moving[0].motion(tmp_path / "motion.csv")
    task = task_of(moving, tmp_path / "out.mkv", prior="tv", quality="draft", trajectory=given, range=(0.0, 0.16))
    outcome, records = carried_out(task, tmp_path)
    assert outcome.restored + outcome.left == 4
    said = json.loads(task.request.record.read_text())
    assert said["settings"]["trajectory_from"] == str(given)
    assert said["settings"]["transfer"] == "bt709"
    assert len(said["settings"]["input_sha256"]) == 64
    assert [frame["index"] for frame in said["frames"]] == [0, 1, 2, 3]
    assert [frame["time_s"] for frame in said["frames"]] == pytest.approx([0, 1 / 24, 2 / 24, 3 / 24], abs=1e-3)
    assert {frame["timing"]["source"] for frame in said["frames"]} == {task.timing_source}
    path = moving[0].path
    for k, frame in enumerate(frame_records(records, tmp_path)):
        t = np.array(frame.trajectory.t_s)
        true = path.at(t + frame.time_s) - path.at(np.array([frame.time_s + moving[0].timing.middle]))
        np.testing.assert_allclose(frame.trajectory.poses()[:, :2], true[:, :2], atol=0.3, err_msg=f"frame {k}")


@pytest.mark.skipif(not vidstab.available(), reason="the extra `vidstab` is not installed")
def test_vid_stabs_frames_take_the_place_of_the_clips(tmp_path: Path) -> None:
    source = Moving(frames=10, exposure=0.5e-3, readout=0.01, rows=144, cols=208, reach=6.0).clip(tmp_path / "in.mkv")
    task = prepare(asked(source, tmp_path / "out.mkv", exposure=0.01, readout=0.01, method=Method.VIDSTAB))
    outcome, _ = carried_out(task, tmp_path)
    assert outcome.restored == 10
    expected = vidstab.stabilised(source, tmp_path / "expected.mkv", tmp_path)
    for ours, theirs in zip(decoded(tmp_path / "out.mkv")[1], decoded(expected)[1], strict=True):
        np.testing.assert_array_equal(ours[0], theirs[0])


def test_where_a_log_lies_along_the_clip_is_settled_once(tmp_path: Path) -> None:
    moving = Moving(frames=3)
    source, log = moving.clip(tmp_path / "in.mkv"), moving.motion(tmp_path / "log.csv")
    words = {**KNOWN, "method": Method.GYRO}
    task = prepare(asked(source, tmp_path / "out.mkv", gyro=log, **words))
    motion = task.request.motion
    assert (motion.gyro, motion.gyro_offset, motion.gyro_axes) == (log, 0.0, "XYZ")
    assert prepare(task.request).request == task.request
    with pytest.raises(ValueError, match="must cover the clip"):
        prepare(asked(source, tmp_path / "out.mkv", gyro=log, gyro_offset=9.0, **words))
