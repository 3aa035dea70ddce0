"""Every answer is z3's: `python -m studies.benchmarks.verify` asks ten thousand times, this as often as is quick."""

import numpy as np
import pytest

pytest.importorskip("z3", reason="the oracle, pip install z3-solver")

from .oracle import Answer, ask
from .questions import float32_number, greatest


@pytest.mark.parametrize("grouped", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_every_answer_is_that_of_z3(grouped, seed):
    rng = np.random.default_rng([seed, grouped])
    answers: list[Answer] = [ask(rng, grouped=grouped) for _ in range(100)]
    for answer in answers:
        assert answer.ours == answer.z3, answer.said
    held = np.mean([answer.ours[0] for answer in answers])
    assert 0.15 < held < 0.85, "too many of the questions have the same answer to tell us anything"


def test_the_oracle_counts_float32_numbers():
    assert greatest(float32_number(7), below=False) == float32_number(7)
    assert greatest(float32_number(7), below=True) == float32_number(6)
    assert float32_number(1) == np.finfo(np.float32).smallest_normal
    assert greatest(float32_number(1), below=True) == 0
    assert greatest(float32_number(1) / 2, below=False) == 0
