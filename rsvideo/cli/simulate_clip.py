"""rsvideo simulate --from-clip: a sharp clip in, a folder with a blurred and sheared one and its truth out."""

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rsvideo.cli import options
from rsvideo.cli.exit_codes import note
from rsvideo.cli.terminal import say

_OF_BOTH = {"output", "overwrite", "noise", "seed", "exposure", "readout", "row_time", "direction"}
_OF_CLIPS = {"from_clip", "last_exposure", "speed", "rate", "first", "frames", "largest_side"}


def check_options(command: Callable[..., None], values: Mapping[str, Any]) -> None:
    """Refuse a request without a source, with two, and with options that are not of its kind."""
    given = [name for name, parameter in inspect.signature(command).parameters.items() if values[name] != parameter.default]
    if ("source" in given) == ("from_clip" in given):
        raise ValueError(f"either SHARP, a photograph, or --from-clip must be given, got {'both' if 'source' in given else 'neither'}")
    of_clip = "from_clip" in given
    for name in given:
        if of_clip and name not in _OF_BOTH | _OF_CLIPS:
            raise ValueError(
                f"{_flag(name)} must not be given with --from-clip: it is for a photograph, a clip has its own motion and size"
            )
        if not of_clip and name in _OF_CLIPS:
            raise ValueError(f"{_flag(name)} must be given with --from-clip: a photograph has no frames to choose from")


def film(
    source: Path | None, output: Path, shutter: options.Given, rate: str | None, chosen: Mapping[str, Any], *, overwrite: bool
) -> None:
    """Make the folder, and report what was made; `shutter` and `chosen` hold None for what was not given."""
    from rsvideo.cli import quiet
    from rsvideo.cli.progress import progress_bar
    from rsvideo.config.quantity import frame_rate, seconds
    from rsvideo.pipeline.simulated_clip import Filming, carry_out, prepare

    assert source is not None  # as check_options holds
    camera = options.sections({f"camera.{name}": value for name, value in shutter.items() if value is not None}).camera
    rest = {name: value for name, value in chosen.items() if value is not None}
    if "last_exposure" in rest:
        rest["last_exposure"] = seconds("last-exposure", rest["last_exposure"])
    with quiet.c_libraries():
        filming = Filming(source=source, camera=camera, rate=None if rate is None else frame_rate(rate), **rest)
        plan = prepare(filming, output, overwrite=overwrite)
    note(plan.notes)
    with progress_bar() as observe:
        made = carry_out(plan, observe)
    note(made.notes)
    say(f"filmed {made.frames} frames of {made.cols} x {made.rows}, {made.blur:.1f} px of blur: {plan.output}")


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")
