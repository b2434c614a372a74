"""The measures that a comparison shows of every frame: their names, units, meaning, and whether more is better."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Measure:
    """A number of every frame, and whether more of it is better."""

    key: str
    name: str
    unit: str
    more_is_better: bool
    digits: int
    words: str  # what it is, for who wonders
    praise: str  # what the better method has, as a sentence says it

    def written(self, value: float) -> str:
        """As people read it; a dash where there is nothing."""
        return f"{value:.{self.digits}f}" if math.isfinite(value) else "–"


MEASURES = (
    Measure(
        key="psnr",
        name="PSNR",
        unit="dB",
        more_is_better=True,
        digits=2,
        words="Nearness to the truth, after the best shift and the best scale of brightness, which no single blurred frame can tell.",
        praise="a higher PSNR",
    ),
    Measure(
        key="ssim",
        name="SSIM",
        unit="",
        more_is_better=True,
        digits=3,
        words="Likeness of structure to the truth, after the same shift and scale; 1 is the truth itself.",
        praise="a higher SSIM",
    ),
    Measure(
        key="edge_width",
        name="Edge width",
        unit="px",
        more_is_better=False,
        digits=2,
        words="Sharpness: the distance over which the strongest edges rise from 10 to 90 % of their height.",
        praise="the better edge width",
    ),
    Measure(
        key="ringing",
        name="Ringing",
        unit="%",
        more_is_better=False,
        digits=2,
        words="What shows where the recording is flat, in % of white. Blurred pictures ring least; the truth's own value is what is there.",
        praise="the better ringing",
    ),
    Measure(
        key="whiteness",
        name="Residual",
        unit="",
        more_is_better=False,
        digits=3,
        words="How much the recording and the result, blurred again by the motion found, differ by more than noise: RMS correlation of"
        " their difference between neighbouring pixels, 0 for white noise.",
        praise="a whiter residual",
    ),
    Measure(
        key="straightness",
        name="Bent lines",
        unit="px",
        more_is_better=False,
        digits=2,
        words="RMS distance of long edges from straight lines, where at least three are found. What is curved in the world counts for all.",
        praise="the better lines",
    ),
    Measure(
        key="flicker",
        name="Flicker",
        unit="",
        more_is_better=False,
        digits=3,
        words="Difference between neighbouring frames once motion is undone, relative to their fine detail.",
        praise="the better flicker",
    ),
)
BY_KEY = {measure.key: measure for measure in MEASURES}
