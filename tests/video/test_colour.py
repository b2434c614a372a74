import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsvideo.physics import tone
from rsvideo.physics.tone import Transfer
from rsvideo.video import colour as subject
from rsvideo.video.colour import codes, encoded, light, relaid
from rsvideo.video.stream import Colour, Matrix, Picture, planar
from tests.video.clips import planes as planes_of
from tests.video.clips import scene


def colour(layout: str, matrix: Matrix = Matrix.BT709, transfer: Transfer = Transfer.BT709, *, full: bool = False) -> Colour:
    """What a stream of this layout would say."""
    facts = planar(layout)
    assert facts is not None
    rgb = layout.startswith("gbr")
    return Colour(
        matrix=Matrix.RGB if rgb else matrix,
        transfer=transfer,
        primaries="bt709",
        full_range=full or rgb,
        depth=facts[0],
        subsampling=facts[1],
        chroma_shift=facts[2],
        pixel_format=layout,
    )


def picture(*planes: np.ndarray) -> Picture:
    return Picture(planes=planes, index=3, pts=300, duration=100, time=0.3)


def noise(layout: str, seed: int = 0, rows: int = 47, cols: int = 63) -> Picture:
    """Any code anywhere: below black, above white, out of gamut."""
    facts, rng = planar(layout), np.random.default_rng(seed)
    assert facts is not None
    kind = np.uint8 if facts[0] <= 8 else np.uint16
    chroma = (-(-rows // (1 << facts[2][0])), -(-cols // (1 << facts[2][1])))
    shapes = [(rows, cols)] if facts[1] == "4:0:0" else [(rows, cols), chroma, chroma]
    return picture(*(rng.integers(0, 1 << facts[0], shape).astype(kind) for shape in shapes))


def grey(code: int, layout: str = "yuv420p", rows: int = 4, cols: int = 6) -> Picture:
    """One luma code and no colour."""
    facts = planar(layout)
    assert facts is not None
    kind = np.uint8 if facts[0] <= 8 else np.uint16
    small = np.full((-(-rows // (1 << facts[2][0])), -(-cols // (1 << facts[2][1]))), 1 << (facts[0] - 1), kind)
    return picture(np.full((rows, cols), code, kind), small, small)


LAYOUTS = [
    "yuv420p",
    "yuv422p",
    "yuv444p",
    "yuv411p",
    "yuv440p",
    "yuv420p10le",
    "yuv422p10le",
    "yuv444p12le",
    "gbrp",
    "gbrp10le",
    "gbrp16le",
    "gray",
    "gray16le",
]


@pytest.mark.parametrize("transfer", Transfer)
@pytest.mark.parametrize("layout", LAYOUTS)
def test_light_of_a_picture_gives_all_its_codes_back(layout: str, transfer: Transfer) -> None:
    original = noise(layout)
    for matrix in (Matrix.BT601, Matrix.BT709, Matrix.BT2020):
        for full in (False, True):
            meaning = colour(layout, matrix, transfer, full=full)
            pixels, _ = light(original, meaning)
            assert pixels.min() >= 0
            assert pixels.max() <= 1
            again = codes(pixels, original, meaning)
            assert (again.index, again.pts, again.duration, again.time) == (3, 300, 100, 0.3)
            for plane, twin in zip(original.planes, again.planes, strict=True):
                assert plane.dtype == twin.dtype
                np.testing.assert_array_equal(plane, twin)


@pytest.mark.parametrize(("layout", "worst"), [("yuv444p", 1), ("yuv420p", 4), ("yuv420p10le", 16)])
def test_without_the_original_a_natural_picture_comes_back_nearly(layout: str, worst: int) -> None:
    original, meaning = picture(*planes_of(scene(0, 63, 65, layout))), colour(layout, Matrix.BT601)
    again = encoded(light(original, meaning)[0], original, meaning)
    for plane, twin in zip(original.planes, again.planes, strict=True):
        assert np.abs(plane.astype(int) - twin).max() <= worst


@pytest.mark.parametrize(
    ("layout", "full", "black", "white"),
    [
        ("yuv420p", False, 16, 235),
        ("yuv420p", True, 0, 255),
        ("yuv420p10le", False, 64, 940),
        ("yuv422p12le", False, 256, 3760),
        ("yuv420p10le", True, 0, 1023),
    ],
)
def test_black_and_white_have_the_codes_of_the_range(layout: str, full: bool, black: int, white: int) -> None:
    meaning = colour(layout, full=full)
    assert abs(light(grey(black, layout), meaning)[0]).max() < 1e-6
    above = light(grey(white, layout), meaning)[0].max()
    assert abs(above - 1) < 1e-6 if full else above < 0.9  # room for what stands above white
    top = planar(layout)
    assert top is not None
    assert light(grey((1 << top[0]) - 1, layout), meaning)[0].min() > 1 - 1e-6
    pixels, _ = light(grey(white, layout), meaning)
    assert encoded(pixels, grey(0, layout), meaning).planes[0].flat[0] == white


@pytest.mark.parametrize("matrix", [Matrix.BT601, Matrix.BT709, Matrix.BT2020])
def test_primaries_have_the_codes_of_the_standard(matrix: Matrix) -> None:
    kr, kb = {Matrix.BT601: (0.299, 0.114), Matrix.BT709: (0.2126, 0.0722), Matrix.BT2020: (0.2627, 0.0593)}[matrix]
    meaning = colour("yuv444p", matrix, Transfer.LINEAR, full=True)
    red = np.zeros((2, 2, 3), np.float32)
    red[..., 0] = 1
    y, cb, cr = (int(plane[0, 0]) for plane in encoded(red, grey(0, "yuv444p"), meaning).planes)
    assert y == round(255 * kr)
    assert cb == round(128 - 255 * 0.5 * kr / (1 - kb))
    assert cr == 255


def test_the_curve_is_the_named_one() -> None:
    for transfer in (Transfer.BT709, Transfer.SRGB, Transfer.PQ, Transfer.GAMMA28):
        pixels, _ = light(grey(100), colour("yuv420p", transfer=transfer, full=True))
        np.testing.assert_allclose(pixels, tone.decode(transfer, np.full(pixels.shape, 100 / 255, np.float32)), rtol=1e-4)


def test_log_curves_are_read_by_whole_codes_in_limited_range_too() -> None:
    pixels, _ = light(grey(420, "yuv422p10le"), colour("yuv422p10le", transfer=Transfer.SLOG3))  # Sony's code of 18 % grey
    whole = tone.decode(Transfer.SLOG3, np.full((1, 1), 420 / 1023, np.float32))
    np.testing.assert_allclose(pixels, whole[0, 0], rtol=1e-4)


def test_a_plateau_at_white_and_the_top_codes_count_as_clipped() -> None:
    for code, full, expected in [
        (235, False, True),
        (237, False, True),
        (228, False, False),
        (245, False, False),
        (250, False, True),
        (254, False, True),
    ]:
        assert light(grey(code), colour("yuv420p", full=full))[1].all() == expected, code
    assert light(grey(254), colour("yuv420p", full=True))[1].all()
    assert not light(grey(250), colour("yuv420p", full=True))[1].any()


def test_chroma_lies_with_the_left_column_and_midway_between_rows() -> None:
    """A ramp of chroma by its own samples' places is a ramp by the pixels' places."""
    meaning = colour("yuv420p", transfer=Transfer.LINEAR, full=True)
    rows, cols = np.mgrid[:8, :10]
    luma = np.full((16, 20), 128, np.uint8)
    flat = np.full((8, 10), 128, np.uint8)
    across = light(picture(luma, flat, (100 + 4 * cols).astype(np.uint8)), meaning)[0][8, 2:-2, 0]
    expected = (128 + 2 * (1 - 0.2126) * (100 + 2 * np.arange(20)[2:-2] - 128)) / 255
    np.testing.assert_allclose(across, expected, atol=1e-5)
    down = light(picture(luma, flat, (100 + 4 * rows).astype(np.uint8)), meaning)[0][2:-2, 8, 0]
    expected = (128 + 2 * (1 - 0.2126) * (100 + 2 * (np.arange(16)[2:-2] - 0.5) - 128)) / 255
    np.testing.assert_allclose(down, expected, atol=1e-5)


def test_a_ramp_of_colour_is_written_where_it_was_read() -> None:
    meaning = colour("yuv420p", transfer=Transfer.LINEAR, full=True)
    rows, cols = np.mgrid[:8, :10]
    flat = np.full((8, 10), 128, np.uint8)
    for ramp in (cols, rows):
        original = picture(np.full((16, 20), 128, np.uint8), flat, (110 + 3 * ramp).astype(np.uint8))
        again = encoded(light(original, meaning)[0], original, meaning)
        np.testing.assert_array_equal(again.planes[2][1:-1, 1:-1], original.planes[2][1:-1, 1:-1])


@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize("layout", ["yuv420p", "yuv422p10le", "yuv440p", "yuv444p"])
def test_what_is_computed_at_once_is_what_is_computed_step_by_step(layout: str, full: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    meaning, given = colour(layout, full=full), noise(layout)

    def both() -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, ...]]:
        pixels, clipped = light(given, meaning)
        return pixels, clipped, codes(pixels + np.float32(0.01) * (pixels > 0.3), given, meaning).planes

    at_once = both()
    monkeypatch.setattr(subject, "_halved_at_most", lambda _: False)
    step_by_step = both()
    for one, other in zip((*at_once[:2], *at_once[2]), (*step_by_step[:2], *step_by_step[2]), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("shift", [(1, 1), (0, 1), (1, 0), (0, 2), (2, 2)])
def test_chroma_is_made_coarser_by_the_weights_that_make_it_finer(shift: tuple[int, int]) -> None:
    """<fine c, f> = n <c, coarse f> with n pixels to a sample, where nothing lies at the borders."""
    rng, shape = np.random.default_rng(0), (32, 40)
    fine, coarse = np.zeros(shape, np.float32), rng.random((shape[0] >> shift[0], shape[1] >> shift[1]), np.float32)
    fine[8:-8, 8:-8] = rng.random((shape[0] - 16, shape[1] - 16), np.float32)
    pixels = 1 << sum(shift)
    finer, coarser = subject._fine(coarse, shape, shift), subject._coarse(fine, shift)
    assert float((finer * fine).sum()) == pytest.approx(pixels * float((coarse * coarser).sum()), rel=1e-5)


def test_pixels_of_another_size_are_refused() -> None:
    with pytest.raises(ValueError, match="pixels must be as the picture's"):
        codes(np.zeros((3, 6, 3), np.float32), grey(100), colour("yuv420p"))


@pytest.mark.parametrize("layout", ["yuv420p", "yuv422p10le", "gbrp16le", "gray"])
def test_more_light_gives_higher_codes(layout: str) -> None:
    original = picture(*planes_of(scene(0, 32, 32, layout)))
    meaning = colour(layout)
    pixels, _ = light(original, meaning)
    brighter = codes(np.clip(pixels * np.float32(1.2), 0, 1), original, meaning)
    assert brighter.planes[0].astype(int).mean() > 1.02 * original.planes[0].astype(int).mean()
    np.testing.assert_allclose(light(brighter, meaning)[0].mean(), 1.2 * pixels.mean(), rtol=0.02)


@settings(max_examples=20)
@given(seed=st.integers(0, 1000), rows=st.integers(1, 9), cols=st.integers(1, 9), layout=st.sampled_from(LAYOUTS))
def test_any_size_goes_through(seed: int, rows: int, cols: int, layout: str) -> None:
    original, meaning = noise(layout, seed, rows, cols), colour(layout)
    pixels, clipped = light(original, meaning)
    assert pixels.shape == clipped.shape == (rows, cols, 1 if "gray" in layout else 3)
    for plane, twin in zip(original.planes, encoded(pixels, original, meaning).planes, strict=True):
        assert plane.shape == twin.shape


@pytest.mark.parametrize("deeper", ["yuv422p10le", "yuv444p12le"])
def test_a_deeper_layout_holds_the_same_picture(deeper: str) -> None:
    original, meaning = picture(*planes_of(scene(0, 48, 64, "yuv420p"))), colour("yuv420p")
    there = relaid(original, meaning, colour(deeper))
    np.testing.assert_array_equal(there.planes[0], original.planes[0].astype(int) << (colour(deeper).depth - 8))
    back = relaid(there, colour(deeper), meaning)
    np.testing.assert_array_equal(back.planes[0], original.planes[0])
    assert all(np.abs(a.astype(int) - b).max() <= 6 for a, b in zip(back.planes[1:], original.planes[1:], strict=True))


def test_a_grey_picture_in_colour_has_none() -> None:
    there = relaid(noise("gray"), colour("gray"), colour("yuv422p10le"))
    assert (there.planes[1] == 512).all()
    assert (there.planes[2] == 512).all()


def test_light_beyond_one_in_floating_point_stays() -> None:
    planes = tuple(np.random.default_rng(0).normal(1, 2, (3, 5, 7)).astype(np.float32))
    meaning = colour("gbrpf32le", transfer=Transfer.LINEAR)
    pixels, clipped = light(picture(*planes), meaning)
    assert clipped.any()
    np.testing.assert_array_equal(np.stack(codes(pixels, picture(*planes), meaning).planes), np.stack(planes))


def test_the_same_codes_in_another_curve_show_the_same_light() -> None:
    source, target = colour("gbrp16le", transfer=Transfer.LINEAR), colour("yuv444p12le", transfer=Transfer.BT709)
    original = picture(*(np.full((4, 4), code, np.uint16) for code in (9000, 20000, 30000)))
    there = relaid(original, source, target)
    scale = light(grey(3760, "yuv444p12le"), target)[0].max()  # the light of nominal white, where the highest code is 1
    np.testing.assert_allclose(light(there, target)[0][0, 0], scale * np.array([9000, 20000, 30000]) / 65535, rtol=0.004)
