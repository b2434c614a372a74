"""The examples in the documentation of the public names, run as they stand."""

import doctest
import importlib
import re
from pathlib import Path

import pytest

import rsvideo

CHECKOUT = Path(__file__).resolve().parents[2]
HOMES = sorted(path.stem for path in (CHECKOUT / "rsvideo" / "api").glob("*.py") if not path.stem.startswith("_"))


@pytest.mark.slow
@pytest.mark.parametrize("name", HOMES)
def test_every_example_shows_what_it_says(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(CHECKOUT)  # examples read samples/
    module = importlib.import_module(f"rsvideo.api.{name}")
    found = doctest.testmod(module, optionflags=doctest.ELLIPSIS)
    assert found.failed == 0


@pytest.mark.parametrize(
    "name", ["deblur", "deblur_clip", "read", "read_clip", "simulate", "track", "write", "Camera", "Settings", "Shutter"]
)
def test_what_is_called_shows_an_example(name: str) -> None:
    assert ">>> " in (getattr(rsvideo, name).__doc__ or "")


@pytest.mark.slow
@pytest.mark.parametrize("page", ["README.md", "docs/api.md"])
def test_what_a_page_shows_runs_as_it_stands(page: str, samples: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    examples = re.findall(r"^```python\n(.*?)^```", (CHECKOUT / page).read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    assert examples
    (tmp_path / "samples").symlink_to(samples)
    monkeypatch.chdir(tmp_path)
    for example in examples:
        exec(example, {})  # of our own pages
    latent, source = (rsvideo.read(name).pixels for name in ("restored.png", "samples/coffee/blurred.png"))
    assert latent.shape == source.shape
    assert (latent != source).any()
