import glob
from pathlib import Path

import pytest

from rsvideo.config import patterns
from rsvideo.config.patterns import matching


def names(pattern: str, folder: Path) -> list[str]:
    return sorted({str(path.relative_to(folder)) for path in matching(pattern, folder)})


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    for name in ("a.mp4", "b.mov", ".hidden.mp4", "one/c.mp4", "one/two/d.mp4", "one/.git/e.mp4", "three/[x].mp4"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


@pytest.mark.parametrize(
    "pattern", ["*.mp4", "**/*.mp4", "one/*", "*/*.mp4", "**", "one/**", ".*", "**/d.mp4", "none/*", "on?/[c-d].mp4", "../*"]
)
def test_a_pattern_means_what_it_means_to_glob(tree: Path, pattern: str) -> None:
    found = {str(Path(name)) for name in glob.glob(pattern, root_dir=tree, recursive=True)} - {"."}  # noqa: PTH207 # the twin
    assert {str(path)[len(str(tree)) + 1 :] for path in matching(pattern, tree)} - {""} == found


def test_links_in_a_circle_end(tree: Path) -> None:
    for name in ("x", "y", "one/z"):
        (tree / name).symlink_to(tree)
    assert names("**/*.mp4", tree) == ["a.mp4", "one/c.mp4", "one/two/d.mp4", "three/[x].mp4"]


def test_an_absolute_pattern_begins_at_its_own_root(tree: Path) -> None:
    assert list(matching(f"{tree}/*.mov", Path("elsewhere"))) == [tree / "b.mov"]


def test_too_much_to_look_at_is_refused(tree: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(patterns, "MOST_LOOKED_AT", 5)
    with pytest.raises(ValueError, match="at most 5 files"):
        list(matching("**/*.mp4", tree))


def test_folders_within_folders_have_an_end(tmp_path: Path) -> None:
    deep = tmp_path.joinpath(*["d"] * (patterns.DEEPEST + 2))
    deep.mkdir(parents=True)
    with pytest.raises(ValueError, match=f"at most {patterns.DEEPEST} folders"):
        list(matching("**/*.mp4", tmp_path))
