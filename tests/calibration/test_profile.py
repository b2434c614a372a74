"""A profile on one page, and the parts that it is made of."""

import numpy as np
import pytest

from calibration import profile, profile_page
from rsvideo.config.yaml import ConfigError
from rsvideo.shooting.camera_profile import CameraProfile
from rsvideo.shooting.profiles import find, names

WHOLE = {
    "name": "$1 camera",
    "mode": {"rows": 480, "cols": 640, "fps": 25},
    "intrinsics": {"fx": {"value": 500, "std": 1}, "fy": 500, "cx": 320, "cy": 240},
    "timing": {"readout_s": {"value": 0.02, "std": 1e-4}, "direction": "right-to-left"},
    "tone": {"curve": [0, 0.1, 1], "clip": 0.99, "curve_std": 0.01, "found": {"how": "8 exposures"}},
    "noise": {"read": 0, "shot": 1e-4},
}


def camera(**other) -> CameraProfile:
    return CameraProfile.model_validate(WHOLE | other)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["png", "pdf", "svg"])
def test_a_whole_profile_is_drawn(kind: str) -> None:
    assert len(profile_page.draw(camera(), kind)) > 5000


@pytest.mark.parametrize("name", names())
def test_the_profiles_that_ship_are_drawn_with_what_they_lack(name: str) -> None:
    assert profile_page.draw(find(name), "png").startswith(b"\x89PNG")


@pytest.mark.parametrize("model", ["brown-conrady", "fisheye"])
def test_the_grid_bends_as_the_lens_does(model: str) -> None:
    lens = camera(
        intrinsics=WHOLE["intrinsics"] | {"distortion": {"model": model, "coefficients": [-0.1, 0, 0, 0]}}  # pyright: ignore[reportOperatorIssue]
    ).intrinsics
    assert lens is not None
    points = np.array([[320.0, 240.0], [620.0, 240.0]])
    r = 300 / 500
    bent_r = r * (1 - 0.1 * r**2) if model == "brown-conrady" else np.arctan(r) * (1 - 0.1 * np.arctan(r) ** 2)
    np.testing.assert_allclose(profile_page.bent(lens, points), [[320, 240], [320 + 500 * bent_r, 240]], atol=1e-6)


def test_what_was_measured_replaces_its_part_alone() -> None:
    measured = CameraProfile.model_validate({"name": "x", "mode": {"rows": 480, "cols": 640}, "noise": {"read": 0.1, "shot": 0}})
    merged = profile.merge(camera(), measured)
    assert merged.noise == measured.noise
    assert merged.intrinsics == camera().intrinsics
    assert (merged.name, merged.mode.fps) == ("$1 camera", 25)


def test_another_modes_measurement_is_not_mixed_in() -> None:
    for mode in ({"rows": 480, "cols": 641}, {"rows": 480, "cols": 640, "fps": 50}):
        measured = CameraProfile.model_validate({"name": "x", "mode": mode})
        with pytest.raises(ConfigError, match="another mode needs another profile"):
            profile.merge(camera(), measured)
