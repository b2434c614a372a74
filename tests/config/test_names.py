import pytest

from rsvideo.config import names


def test_a_name_that_need_not_exist_may_be(tmp_path) -> None:
    names.check(tmp_path / "absent", tmp_path / "absent" / "too", tmp_path / ("x" * 255))


def test_what_the_system_refuses_is_named(tmp_path) -> None:
    (tmp_path / "loop").symlink_to("loop")
    for path, why in ((tmp_path / ("x" * 256), "too long"), (tmp_path / "loop" / "out.png", "symbolic links")):
        with pytest.raises(ValueError, match=f"cannot be a file's name: .*{why}"):
            names.check(path)
