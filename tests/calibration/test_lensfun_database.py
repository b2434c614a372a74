"""Lenses looked up in lensfun's database."""

import importlib
from typing import Any

import numpy as np
import pytest

from calibration.intrinsics.lensfun_database import look_up_lens
from calibration.profile_page import bent

CAMERA, LENS = "Canon EOS 70D", "EF-S 18-135mm f/3.5-5.6 IS STM"


def test_the_focal_length_in_pixels_follows_from_the_sensor() -> None:
    photograph = look_up_lens(CAMERA, LENS, focal_mm=24, rows=3648, cols=5472)
    assert photograph.lens.fx.value == pytest.approx(24 / 22.5 * 5472, rel=5e-3)  # the sensor is 22.5 mm wide
    clip = look_up_lens(CAMERA, LENS, focal_mm=24, rows=1080, cols=1920)
    assert clip.lens.fx.value == pytest.approx(24 / 22.5 * 1920, rel=5e-3)
    assert any("full width" in note for note in clip.notes)
    assert clip.lens.found is not None
    assert "not measured" in str(clip.lens.found.how)


@pytest.mark.parametrize("focal", [18.0, 24.0, 135.0])
def test_lines_bend_as_lensfun_bends_them(focal: float) -> None:
    rows, cols = 3648, 5472
    prior = look_up_lens(CAMERA, LENS, focal_mm=focal, rows=rows, cols=cols)
    lensfunpy: Any = importlib.import_module("lensfunpy")
    database = lensfunpy.Database()
    body = database.find_cameras(None, CAMERA, loose_search=True)[0]
    lens = database.find_lenses(body, None, LENS, loose_search=True)[0]
    modifier = lensfunpy.Modifier(lens, body.crop_factor, cols, rows)
    modifier.initialize(focal, 8.0, 1000.0, pixel_format=np.uint8, flags=lensfunpy.ModifyFlags.DISTORTION)
    theirs = modifier.apply_geometry_distortion(0, 0, cols, rows)
    edge = np.array([[x, 20.0] for x in range(0, cols, 200)])  # straight in lensfun's corrected picture
    observed = np.array([theirs[int(y), int(x)] for x, y in edge], float)
    assert prior.lens.distortion is not None
    straight = observed
    for _ in range(50):
        straight = straight + observed - bent(prior.lens, straight)
    assert np.ptp(observed[:, 1]) > 10  # it does bend
    assert np.ptp(straight[:, 1]) < 5e-4 * cols  # lensfun's odd powers of the radius are not Brown-Conrady's
    np.testing.assert_allclose(bent(prior.lens, straight), observed, atol=0.01)


@pytest.mark.parametrize(
    ("camera", "lens", "focal", "line"),
    [
        ("no such camera at all zzz", LENS, 24.0, "lensfun knows no camera named"),
        (CAMERA, "zzzz qqqq", 24.0, "lensfun knows no lens named zzzz qqqq"),
        (CAMERA, LENS, 200.0, "has 18 to 135 mm, got 200 mm; is it the equivalent?"),
        (CAMERA, LENS, float("nan"), "focal-mm must lie in 1 to 5000 mm"),
    ],
)
def test_what_is_not_in_the_database_is_refused(camera: str, lens: str, focal: float, line: str) -> None:
    with pytest.raises(ValueError, match=line):
        look_up_lens(camera, lens, focal_mm=focal, rows=1080, cols=1920)
