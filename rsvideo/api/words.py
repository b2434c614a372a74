"""Words that a user chooses from."""

from collections.abc import Sequence
from difflib import get_close_matches

from rsvideo.physics.tone import Transfer


def one_of(name: str, word: str, choices: Sequence[str]) -> str:
    """`word` itself where it is one of `choices`; else ValueError, with the nearest of them."""
    if word not in choices:
        near = get_close_matches(word.lower()[:100], choices, n=1)
        slip = f"; did you mean {near[0]}?" if near else ""
        raise ValueError(f"{name} must be one of {', '.join(choices)}, got {word!r}{slip}")
    return word


def transfer_named(name: str | None) -> Transfer | None:
    """The transfer function of a name such as "srgb"; ValueError where there is none."""
    return None if name is None else Transfer(one_of("transfer", str(name), list(Transfer)))
