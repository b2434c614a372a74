"""A process of its own compiles the denoiser's loops, once, and only where another core is to be had."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from rsvideo import threads
from rsvideo.solvers import ahead, collaborative_filter


@pytest.fixture
def elsewhere(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Stands in for starting processes; answers which would have been started."""
    started: list[list[str]] = []
    monkeypatch.setattr(subprocess, "Popen", lambda words, **_: started.append(words))
    monkeypatch.setattr(ahead, "_begun", [])
    monkeypatch.setattr(threads, "most", lambda: 2)
    return started


def test_a_process_is_started_once_where_nothing_is_compiled(elsewhere: list[list[str]], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "compiled", lambda: False)
    ahead.begin()
    ahead.begin()
    assert [words[0] for words in elsewhere] == [sys.executable]


def test_none_is_started_where_all_is_compiled(elsewhere: list[list[str]], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "compiled", lambda: True)
    ahead.begin()
    assert elsewhere == []


def test_none_is_started_on_a_single_core(elsewhere: list[list[str]], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "compiled", lambda: False)
    monkeypatch.setattr(threads, "most", lambda: 1)
    ahead.begin()
    assert elsewhere == []


@pytest.mark.slow
def test_what_the_process_has_compiled_is_found(tmp_path: Path) -> None:
    begin = "from rsvideo.solvers import ahead\nassert not ahead.compiled()\nahead.begin()\n"
    wait = "(process,) = ahead._begun\nassert process.wait() == 0\nassert ahead.compiled()\n"
    use = "import numpy as np\nfrom rsvideo.solvers import collaborative_filter as f\n"
    use += "f.denoise(np.zeros((16, 16, 3), np.float32), 1.0)\nassert not f._filter.stats.cache_misses, f._filter.stats\n"
    fresh = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "RSVIDEO_THREADS": "2"}
    subprocess.run([sys.executable, "-c", begin + wait + use], check=True, env=fresh, timeout=300)
    assert list(tmp_path.rglob(f"{Path(collaborative_filter.__file__).stem}._filter-*.nbc"))
