"""Streams of seeds and blocks of episode numbers: where everything random in a search comes from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt32


@dataclass(frozen=True)
class SeedStream:
    """A stream of random numbers that is named by words, such as a seed, a purpose, a stage and a turn.

    Streams of different words are independent, and the same words always give the same numbers: the words are the
    entropy of NumPy's `SeedSequence`.
    """

    words: tuple[int, ...]

    def __init__(self, *words: int | str) -> None:
        """Name a stream.

        Args:
            *words: Whole numbers of at least 0, or texts, which count as their bytes in UTF-8.

        Raises:
            ValueError: There are no words, or one of them is negative.
        """
        numbers = [
            number for word in words for number in (word.encode() if isinstance(word, str) else (int(word),))
        ]
        if not numbers or min(numbers) < 0:
            raise ValueError(
                f"a stream of seeds needs whole numbers of at least 0, got {words}; begin with the run's seed"
            )
        object.__setattr__(self, "words", tuple(numbers))

    def child(self, *words: int | str) -> SeedStream:
        """Return the stream of these words with others after them.

        Args:
            *words: As those of a stream.

        Returns:
            A stream that is independent of this one.

        Raises:
            ValueError: A word is negative.
        """
        return SeedStream(*self.words, *words)

    def generator(self) -> np.random.Generator:
        """Return a new generator at the beginning of the stream."""
        return np.random.default_rng(self._sequence())

    def integers(self, number: int) -> UInt32[np.ndarray, " number"]:
        """Return the first ``number`` words of 32 bits of the stream."""
        return self._sequence().generate_state(number)

    def seed(self, turn: int = 0) -> int:
        """Return a seed for what takes a single number.

        Args:
            turn: How often something is repeated with a seed of its own; each turn gets the next number, so a few
                turns never share one.

        Returns:
            A whole number from 0 to 2^32 - 1.
        """
        return (int(self.integers(1)[0]) + turn) % 2**32

    def _sequence(self) -> np.random.SeedSequence:
        return np.random.SeedSequence(self.words)


@dataclass(frozen=True)
class EpisodeBlock:
    """Consecutive episode numbers that are set aside for one use.

    What plays episodes takes the number of its first one. Uses whose blocks share no number share no episode.
    """

    start: int
    """The first number."""
    size: int
    """How many numbers."""

    def part(self, i: int, number: int) -> EpisodeBlock:
        """Return one of several equal parts.

        Args:
            i: Which part, counted from 0.
            number: How many parts; any remainder of the division is left out.

        Returns:
            A block within this one.

        Raises:
            ValueError: There is no such part, or it would be empty.
        """
        size = self.size // number if number > 0 else 0
        if not 0 <= i < number or size == 0:
            raise ValueError(f"a block of {self.size} episodes has no part {i} of {number}")
        return EpisodeBlock(self.start + i * size, size)
