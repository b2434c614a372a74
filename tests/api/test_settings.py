"""What a user states is what the rooms take; what cannot be is refused in one line."""

import subprocess
import sys
from dataclasses import replace
from typing import get_type_hints

import numpy as np
import pytest

import rsvideo
from rsvideo.config import request
from rsvideo.pipeline.prepare import settings_of
from rsvideo.restoration.settings import Settings as RestorationSettings


def test_the_defaults_are_those_of_the_command() -> None:
    stated = rsvideo.Settings()
    assert stated.sections() == (request.Motion(), request.Deblur())
    assert replace(settings_of(*stated.sections()), device="cpu") == RestorationSettings()


@pytest.mark.parametrize("name", ["motion", "start", "refinement", "prior", "quality", "frames"])
def test_the_words_are_those_of_the_command(name: str) -> None:
    section = request.Motion if name in ("motion", "start", "refinement") else request.Deblur
    field = section.model_fields["model" if name == "motion" else name]
    assert get_type_hints(rsvideo.Settings)[name] == field.annotation


def test_settings_that_cannot_be_are_refused_in_one_line() -> None:
    code = """
import rsvideo
for words in ({"motion": "rotations"}, {"prior": "bm3d"}, {"degree": 0}):
    try:
        rsvideo.Settings(**words)
    except ValueError as error:
        print(error)
"""  # by itself: where shapes and types are checked at every call, a wrong word does not get so far
    lines = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.splitlines()
    assert lines == [
        "motion must be one of rotation, shift, got 'rotations'; did you mean rotation?",
        "prior must be one of denoiser, tv, got 'bm3d'",
        "degree must lie in [1, 12], got 0; one frame does not determine more",
    ]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ({"exposure": 20.0}, "exposure must lie in .* is it in milliseconds"),
        ({"exposure": 0.0}, "no light is collected in no time"),
        ({"readout": "20 parsecs"}, "the units are s, ms and us"),
        ({"readout": -0.01}, r"readout must lie in \[0, 1\] s"),
        ({"direction": "upwards"}, "direction must be one of top-to-bottom"),
    ],
)
def test_a_shutter_that_cannot_be_is_refused(words: dict, line: str) -> None:
    with pytest.raises(ValueError, match=line):
        rsvideo.Shutter(**words)


def test_times_may_be_written_as_on_the_command_line() -> None:
    assert rsvideo.Shutter(exposure="1/50", readout="20ms") == rsvideo.Shutter(exposure=0.02, readout=0.02)


@pytest.mark.parametrize("focal", [0.0, -3.0, float("nan"), "wide"])
def test_a_focal_length_that_cannot_be_is_refused(focal: float | str) -> None:
    with pytest.raises(ValueError, match="focal-px must be a positive number of pixels"):
        rsvideo.Camera(focal_px=focal)


def test_distortion_that_has_no_such_model_is_refused() -> None:
    with pytest.raises(ValueError, match="brown-conrady has 4 or 5 or 8 or 12 coefficients, got 3"):
        rsvideo.Camera(focal_px=100, distortion=(0.1, 0.2, 0.3))


def test_a_trajectory_goes_through_its_samples() -> None:
    t = np.linspace(0, 0.04, 33)
    poses = np.stack([3 * np.sin(90 * t), 2 * np.cos(70 * t), 0.01 * t], axis=1)
    path = rsvideo.Trajectory.through(t, poses)
    np.testing.assert_allclose(path.at(t), poses, atol=2e-3)
    np.testing.assert_allclose(path.at(float(t[7])), poses[7], atol=2e-3)
    assert path.interval == (0.0, pytest.approx(0.04))


@pytest.mark.parametrize(
    ("times", "poses", "line"),
    [
        ([0.0, 0.1], np.zeros((3, 3)), "must have times"),
        ([0.1, 0.0], np.zeros((2, 3)), "must rise"),
        ([0.0, np.nan], np.zeros((2, 3)), "must be finite"),
    ],
)
def test_samples_that_are_no_trajectory_are_refused(times: list[float], poses: np.ndarray, line: str) -> None:
    with pytest.raises(ValueError, match=line):
        rsvideo.Trajectory.through(np.array(times), poses)
