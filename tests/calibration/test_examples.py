"""The examples in the documentation of what `import calibration` offers, run as a person would type them."""

import doctest
import importlib

import pytest

import calibration

EXAMPLES = [
    "calibration.boards.sheet.board",
    "calibration.intrinsics.measure.lens",
    "calibration.timing.measure.readout",
    "calibration.timing.cannot_tell.CannotTell",
    "calibration.radiometry.measure.response",
    "calibration.profile.read",
    "calibration.profile.write",
    "calibration.profile.merge",
    "calibration.profile.show",
    "calibration.profile.convert",
    "calibration.flicker.gains",
    "calibration.flicker.lit",
    "calibration.flicker.wall",
    "calibration.boards.render.photographs",
]


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_gives_what_it_shows(name: str) -> None:
    module, _, function = name.rpartition(".")
    # found by name: functions whose shapes are checked at every call no longer say which module they are of
    found = doctest.DocTestFinder(recurse=False).find(getattr(importlib.import_module(module), function), name, module=False, globs={})
    examples = [example for example in found if example.examples]
    assert examples, f"{name} has no example"
    runner = doctest.DocTestRunner(optionflags=doctest.REPORT_NDIFF)
    report: list[str] = []
    for example in examples:
        runner.run(example, out=report.append)
    assert not runner.failures, "".join(report)


def test_all_that_is_offered_is_there_and_documented() -> None:
    for name in calibration.__all__:
        assert getattr(calibration, name).__doc__, name
    with pytest.raises(AttributeError, match="no attribute 'lenses'"):
        calibration.lenses  # noqa: B018 # pyright: ignore[reportAttributeAccessIssue]
