import json

import pytest

from rsvideo.config.printable import in_unicode, printable


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("Strandläufer 海 1.mp4", "Strandläufer 海 1.mp4"),
        ("a\u202fb\u00a0c", "a\u202fb\u00a0c"),
        ("\x1b[31mred", r"\x1b[31mred"),
        ("two\nlines\r", r"two\x0alines\x0d"),
        ("\x7f\x9b2J", r"\u007f\u009b2J"),
        ("exe\u202egpj", r"exe\u202egpj"),
        ("\udcff", r"\udcff"),
        ("\U000e0001", r"\udb40\udc01"),
    ],
)
def test_what_acts_is_written_out_and_words_stay(text: str, shown: str) -> None:
    assert printable(text) == shown


def test_layout_may_be_kept() -> None:
    assert printable("one\n\ttwo\x1b", keep="\n\t") == "one\n\ttwo\\x1b"


def test_json_stays_what_it_says() -> None:
    text = json.dumps({"name": "a\x7f\x9b\u202e\U000e0001"}, ensure_ascii=False)
    assert json.loads(printable(text)) == json.loads(text)


def test_a_name_of_bytes_that_are_no_text_becomes_text() -> None:
    assert in_unicode("clip\udcff.mp4") == r"clip\xff.mp4"
    assert in_unicode("äöü.mp4") == "äöü.mp4"
