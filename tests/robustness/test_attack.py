"""Hostile files and requests, through the real command: refused in one line, or restored whole; nothing else."""

import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor

import pytest

from tests.robustness import attack, pictures
from tests.robustness.harness import RIGHT
from tests.robustness.liars import LIARS, judged

FILES, REQUESTS = 3000, 500


def check(names: list[str], jobs: int) -> None:
    found = list(attack.answers(names, jobs))
    print(attack.printed(attack.rows(found)))
    wrong = [f"{each.verdict}: {each.name} ({each.family}): {each.words}" for each in found if each.verdict not in RIGHT]
    assert not wrong, "\n".join(wrong)


@pytest.mark.slow
def test_a_sample_of_the_attack_is_refused_or_restored() -> None:
    check(attack.sample(45, 15, attack.names(FILES, REQUESTS)), jobs=1)


@pytest.mark.long
def test_the_whole_attack_is_refused_or_restored() -> None:
    check(attack.names(FILES, REQUESTS), jobs=2)


@pytest.mark.parametrize("name", ["media/33", "pictures/40", "texts/7", "commands/20"])
def test_a_case_is_the_same_every_time(name: str) -> None:
    one, again = attack.case(name), attack.case(name)
    assert (one.words, {k: v for k, v in one.files.items() if isinstance(v, bytes)}) == (
        again.words,
        {k: v for k, v in again.files.items() if isinstance(v, bytes)},
    )


@pytest.fixture(scope="module")
def process() -> Iterator[ProcessPoolExecutor]:
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as executor:
        yield executor


@pytest.mark.parametrize("name", LIARS)
def test_the_harness_notices_each_thing_that_can_go_wrong(process: ProcessPoolExecutor, name: str) -> None:
    assert process.submit(judged, name, pictures.whole("png")).result() == LIARS[name][1]
