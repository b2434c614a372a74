import json
from collections.abc import Callable
from pathlib import Path

import pytest

from rsvideo.batch.job import Clip, JobFile, overrides, parsed
from rsvideo.config import yaml
from rsvideo.config.request import Sections
from rsvideo.config.yaml import ConfigError
from rsvideo.physics.shutter import Direction

Understand = Callable[[str], JobFile]
EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "configs" / "jobs").glob("*.yaml"))


@pytest.fixture
def understand(tmp_path: Path) -> Understand:
    def from_text(text: str) -> JobFile:
        path = tmp_path / "job.yaml"
        path.write_text(text)
        return parsed(*yaml.load(path))

    return from_text


def treatment(job: JobFile, clip: Clip, given: Sections | None = None) -> Sections:
    return Sections.layered(job.sections(clip, given or Sections()))


def test_a_clip_may_be_just_its_name(understand: Understand) -> None:
    job = understand("clips: [a.mp4, {source: b.mp4}, {source: [c.mp4, d.mp4]}]")
    assert [clip.source for clip in job.clips] == [["a.mp4"], ["b.mp4"], ["c.mp4", "d.mp4"]]


@pytest.mark.parametrize("text", ["1/50", "20ms", "0.02", "2e-2", "'0.02 s'"])
def test_times_are_written_as_on_the_command_line(understand: Understand, text: str) -> None:
    assert understand(f"clips: [{{source: a, camera: {{exposure: {text}}}}}]").clips[0].camera.exposure == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("clips: []", ["job.yaml:1: clips: "]),
        ("output: {}", ["job.yaml:1: clips: must be given"]),
        ("[a, b]", ["job.yaml:1: must map words"]),
        ("clips:\n- source: a\n  camera:\n    exposur: 1/50", ["job.yaml:4: clips.0.camera.exposur: ", "did you mean exposure?"]),
        ("clips: [a]\ndefault: {}", ["job.yaml:2: default: ", "did you mean defaults?"]),
        ("clips: [a]\npresets:\n  p:\n    motion: {modle: shift}", ["job.yaml:4: presets.p.motion.modle", "did you mean model?"]),
        ("clips:\n- source: a\n  preset: gpro\npresets: {gopro: {}}", ["job.yaml:3: clips.0.preset", "did you mean gopro?"]),
        ("clips:\n- source: a\n  camera: {exposure: 20}", ["job.yaml:3: clips.0.camera.exposure", "(0, 1] s", "milliseconds"]),
        ("clips:\n- source: a\n  camera: {exposure: true}", ["job.yaml:3: ", "must be a time such as 1/50"]),
        ("clips:\n- source: a\n  camera: {readout: -0.02}", ["job.yaml:3: ", "must not be negative"]),
        ("clips:\n- source: a\n  camera: {direction: up}", ["job.yaml:3: clips.0.camera.direction", "bottom-to-top"]),
        ("clips:\n- source: a\n  motion: {model: rotations}", ["job.yaml:3: ", "did you mean rotation?"]),
        ("clips:\n- source: a\n  camera: {transfer: slog3}", ["job.yaml:3: ", "did you mean s-log3?"]),
        ("clips:\n- source: a\n  encoding: {codec: prores422}", ["job.yaml:3: ", "did you mean prores?"]),
        ("clips:\n- source: a\n  camera: {focal_px: 35mm}", ["job.yaml:3: ", "pixels", "width of the sensor"]),
        ("clips:\n- source: a\n  input: {range: 00:12-00:10}", ["job.yaml:3: ", "from an earlier to a later time"]),
        ("clips:\n- source: a\n  input: {range: 12}", ["job.yaml:3: ", "must read like 00:10-00:12"]),
        ("clips:\n- source: a\n  name: ../{stem}.mp4", ["job.yaml:3: clips.0.name", "output.folder"]),
        ("clips: [a]\noutput: {name: '{stem.__class__}'}", ["job.yaml:2: output.name", "{stem}"]),
        ("clips: [a]\noutput: {name: '{stem'}", ["job.yaml:2: output.name", "{stem}"]),
    ],
)
def test_every_fault_is_told_with_its_line_and_what_was_meant(understand: Understand, text: str, words: list[str]) -> None:
    with pytest.raises(ConfigError) as caught:
        understand(text)
    for word in words:
        assert word in str(caught.value)


def test_a_part_of_a_clip_is_given_in_minutes_and_seconds(understand: Understand) -> None:
    job = understand("clips: [{source: a, input: {range: 00:10-1:00:12.5}}, {source: a, input: {range: 10 - 12.5}}]")
    assert [clip.input.range for clip in job.clips] == [(10, 3612.5), (10, 12.5)]


def test_a_clip_goes_over_its_preset_the_preset_over_defaults_and_the_command_line_over_all(understand: Understand) -> None:
    job = understand(
        "defaults: {camera: {exposure: 1/50, focal_px: 1000}, motion: {degree: 3}, deblur: {prior: tv}}\n"
        "presets: {p: {camera: {focal_px: 1100, direction: bottom-to-top}, motion: {degree: 5}}}\n"
        "clips: [{source: a, preset: p, motion: {degree: 6, start: tracing}}]\n"
    )
    treated = treatment(job, job.clips[0], overrides(["motion.start=kernels", "camera.force=true"]))
    assert (treated.camera.exposure, treated.camera.focal_px, treated.camera.direction) == (0.02, 1100, Direction.BOTTOM_TO_TOP)
    assert (treated.motion.degree, treated.motion.start, treated.deblur.prior, treated.camera.force) == (6, "kernels", "tv", True)


def test_one_way_to_say_a_time_takes_the_place_of_another(understand: Understand) -> None:
    job = understand(
        "defaults: {camera: {exposure: 1/50, readout: 20ms}}\n"
        "clips: [{source: a, camera: {shutter_angle: 180, row_time: 10us}}, {source: b, camera: {scanlines_total: null}}]\n"
    )
    first, second = (treatment(job, clip).camera for clip in job.clips)
    assert (first.exposure, first.shutter_angle, first.readout, first.row_time) == (None, 180, None, pytest.approx(1e-5))
    assert (second.exposure, second.readout) == (0.02, 0.02)


@pytest.mark.parametrize(
    ("word", "words"),
    [
        ("camera.exposur=1/50", "--set camera.exposur: there is no such key; did you mean exposure?"),
        ("exposure=1/50", "--set must read like camera.exposure=1/100"),
        ("camera.exposure", "--set must read like camera.exposure=1/100"),
        ("camra.exposure=1", "--set camra: there is no such key; did you mean camera?"),
        ("camera.exposure=20", "milliseconds"),
        ("motion.degree=many", "--set motion.degree: "),
    ],
)
def test_a_wrong_set_is_told_by_name(word: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        overrides([word])
    assert words in str(caught.value)


def test_the_schema_knows_all_sections_and_forbids_others() -> None:
    schema = json.loads(json.dumps(JobFile.model_json_schema()))
    assert schema["additionalProperties"] is False
    sections = {"input", "camera", "motion", "deblur", "encoding", "pipe"}
    assert set(schema["$defs"]["Clip"]["properties"]) == {"source", "preset", "name", *sections}
    assert {"type": "number"} in schema["$defs"]["Camera"]["properties"]["exposure"]["anyOf"][0]["anyOf"]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_the_examples_are_understood(path: Path) -> None:
    parsed(*yaml.load(path))


def test_there_are_examples() -> None:
    assert {path.stem for path in EXAMPLES} >= {"one_clip", "folder", "raw_sequence"}
