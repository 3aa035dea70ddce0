"""Streams of seeds: the same words give the same numbers, other words others; blocks of episodes share nothing."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from sympol.search.front.distillation import BLOCKS, DISTILLATION
from sympol.search.front.task import FINE_TUNING, MAX_RESPLITS, stages
from sympol.search.insert_splits import EPISODES
from sympol.seeds import EpisodeBlock, SeedStream


@pytest.mark.parametrize("seed", [0, 7, 2**32 - 1, 2**40])
def test_a_seed_alone_is_numpys(seed):
    assert SeedStream(seed).generator().integers(1 << 62) == np.random.default_rng(seed).integers(1 << 62)


def test_words_are_the_entropy_of_a_seed_sequence():
    words = [3, 1, *b"scratch"]
    stream = SeedStream(3, 1, "scratch")
    assert stream.words == tuple(words)
    assert stream.seed() == np.random.SeedSequence(words).generate_state(1)[0]
    np.testing.assert_array_equal(stream.integers(5), np.random.SeedSequence(words).generate_state(5))
    assert stream.generator().random() == np.random.default_rng(words).random()
    assert SeedStream(3).child(1, "scratch") == stream


def test_each_turn_has_a_seed_of_its_own_between_0_and_2_to_the_32():
    seeds = [SeedStream(5, "teacher").seed(turn) for turn in range(100)]
    assert len({*seeds}) == 100
    last = next(stream for i in range(10**6) if (stream := SeedStream(i)).seed() >= 2**32 - 10**5)
    assert 0 <= last.seed(10**5) < 10**5


@pytest.mark.parametrize("words", [(), (-1,), (0, -3)])
def test_what_is_no_stream_is_refused(words):
    with pytest.raises(ValueError, match=r"whole numbers of at least 0, got"):
        SeedStream(*words)


def test_parts_of_a_block_are_disjoint_and_within_it():
    block = EpisodeBlock(100, 64)
    parts = [block.part(i, 4) for i in range(4)]
    assert [part.start for part in parts] == [100, 116, 132, 148]
    assert {part.size for part in parts} == {16}


@pytest.mark.parametrize(("i", "number"), [(4, 4), (-1, 4), (0, 65), (0, 0)])
def test_what_is_no_part_is_refused(i, number):
    with pytest.raises(ValueError, match=r"a block of 64 episodes has no part"):
        EpisodeBlock(100, 64).part(i, number)


def test_episodes_of_a_search_are_below_2_to_the_31_and_uses_share_none():
    last = DISTILLATION.part(BLOCKS - 1, BLOCKS)
    assert last.start + last.size <= FINE_TUNING.start
    blocks = [stage.episodes for stage in stages(1023)]
    assert blocks[0].start == FINE_TUNING.start
    assert all(a.start + a.size == b.start for a, b in pairwise(blocks))
    assert blocks[-1].start + blocks[-1].size <= 1 << 31
    resplit = blocks[0].part(1, 2).part(0, MAX_RESPLITS)
    assert resplit.size == EPISODES
