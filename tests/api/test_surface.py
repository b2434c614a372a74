"""What `import rsvideo` offers, and what it costs."""

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import rsvideo

HEAVY = ("numpy", "scipy", "numba", "cv2", "av", "pydantic", "matplotlib", "rsvideo.api")


def test_importing_loads_none_of_the_libraries() -> None:
    code = f"import sys, rsvideo; dir(rsvideo); print([name for name in {HEAVY} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_every_public_name_is_there_and_documented() -> None:
    for name in rsvideo.__all__:
        assert name in dir(rsvideo)
        assert getattr(rsvideo, name).__doc__


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'deblurr'"):
        rsvideo.deblurr  # noqa: B018 # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.slow
def test_a_type_checker_sees_every_public_name(tmp_path: Path) -> None:
    checker = Path(sys.executable).with_name("basedpyright")
    used = tmp_path / "used.py"
    used.write_text(
        "import rsvideo\n"
        + "".join(f"rsvideo.{name}\n" for name in rsvideo.__all__)
        + "found: rsvideo.Result = rsvideo.deblur(rsvideo.simulate)\n"  # which is no picture
    )
    done = subprocess.run(
        [checker, "--level", "error", "--pythonpath", sys.executable, used], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    errors = [line for line in done.stdout.splitlines() if " error: " in line]
    assert len(errors) == 1, done.stdout
    assert "reportArgumentType" in done.stdout


def test_without_vapoursynth_its_module_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "vapoursynth", None)
    monkeypatch.delitem(sys.modules, "rsvideo.vs", raising=False)
    with pytest.raises(ImportError, match=r"pip install 'rsvideo\[vapoursynth\]' brings it, on Python 3.12"):
        importlib.import_module("rsvideo.vs")


def test_the_package_says_that_it_is_typed() -> None:
    assert (Path(rsvideo.__file__).parent / "py.typed").is_file()
