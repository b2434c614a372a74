import os
from pathlib import Path

import pytest

from rsvideo.config import memory
from rsvideo.config.files import UnreadableError


def test_work_beyond_what_there_is_is_refused_with_both_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "available", lambda: 2_000_000_000)
    memory.check(Path("a.mp4"), "it is large", 1.9e9)
    with pytest.raises(UnreadableError, match=r"a\.mp4 needs about 6\.9 GB of memory, since it is large; there are 2 GB"):
        memory.check(Path("a.mp4"), "it is large", 6.9e9)


def test_a_control_group_counts_as_much_as_the_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    inner = tmp_path / Path("/proc/self/cgroup").read_text(encoding="utf-8").splitlines()[-1].split(":", 2)[2].strip("/")
    inner.mkdir(parents=True, exist_ok=True)
    (inner / "memory.max").write_text("3000000\n")
    (inner / "memory.current").write_text("2000000\n")
    (inner / "memory.stat").write_text("anon 5\ninactive_file 500000\n")
    monkeypatch.setattr(memory, "_GROUPS", tmp_path)
    assert memory.available() == 1_500_000
    (inner / "memory.max").write_text("max\n")
    assert (memory.available() or 0) > 1_500_000


def test_a_limit_of_the_process_counts_too(monkeypatch: pytest.MonkeyPatch) -> None:
    import resource

    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    limit = pages * os.sysconf("SC_PAGE_SIZE") + 10_000_000
    monkeypatch.setattr(resource, "getrlimit", lambda _: (limit, limit))
    assert (memory.available() or 0) <= 10_000_000
