"""Draw the nodes of a soft tree: a list of weights with bars, or a distribution over actions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..trees import DecisionTree
from ..trees.actions import BoxActions
from ..trees.plot import COLOURS, leaf_colours
from ..trees.plot_boxes import LINE, PAD, PAPER, ROW, Pen, TextBox, rounded, shortened, text_width
from ..trees.plot_layout import Drawable
from .soft_view import SoftView, Term, in_preorder, percent

if TYPE_CHECKING:
    from jaxtyping import Float

_BAR, _SUM = "#D5D5D5", "#F3F3F3"
_STRIP = 0.09  # inches high


@dataclass(frozen=True)
class SumBox:
    """The box of a node: its features by weight, each with a bar that would fill the box at 1, and its threshold.

    Attributes:
        terms: The features.
        threshold: The threshold of their sum.
    """

    terms: tuple[Term, ...]
    threshold: str
    width: float
    """The width, equal in all nodes, so that bars can be compared."""

    @property
    def size(self) -> tuple[float, float]:
        """The width and height."""
        return self.width, (len(self.terms) + 1) * ROW + PAD

    def draw(self, pen: Pen, centre: Float[np.ndarray, " 2"]) -> None:
        """Draw it.

        Args:
            pen: What to draw with.
            centre: The centre of the box.
        """
        from matplotlib.patches import Rectangle

        width, height = self.size
        x, y = centre - np.array([width, height]) / 2
        add = pen.ax.add_patch
        sums = {"facecolor": pen.colour(_SUM), "edgecolor": "none", "zorder": 3}
        add(rounded(x, y, width, height, **sums))
        paper = {"facecolor": pen.colour(PAPER), "edgecolor": "none", "zorder": 3}
        high = PAD / 2 + len(self.terms) * ROW
        add(rounded(x, y, width, high, **paper))
        add(Rectangle((x, y + ROW / 2), width, high - ROW / 2, **paper))
        for row, term in enumerate(self.terms):
            top = y + PAD / 2 + row * ROW
            bar = {"facecolor": pen.colour(_BAR), "edgecolor": "none", "zorder": 4}
            add(Rectangle((x + PAD / 2, top + 0.015), (width - PAD) * term.weight, ROW - 0.03, **bar))
            pen.words(x + PAD, top + ROW / 2, shortened(term.name), align="left")
            pen.words(x + width - PAD, top + ROW / 2, weight_words(term.weight), align="right")
        pen.words(centre[0], y + height - (ROW + PAD / 2) / 2, self.threshold)
        add(rounded(x, y, width, height, facecolor="none", **pen.outline, zorder=5))


@dataclass(frozen=True)
class ChanceBox:
    """The box of a leaf: its likeliest choice, a strip for each component divided by probability, and its share.

    Attributes:
        rows: The likeliest choices as text.
        chances: The probabilities of each component.
        share: The share as text.
    """

    rows: tuple[str, ...]
    chances: tuple[tuple[float, ...], ...]
    share: str

    @property
    def size(self) -> tuple[float, float]:
        """The width and height."""
        rows = len(self.rows) + bool(self.share)
        height = rows * ROW + len(self.chances) * _STRIP + 1.5 * PAD
        return max(map(text_width, [*self.rows, self.share])) + 2 * PAD, height

    def draw(self, pen: Pen, centre: Float[np.ndarray, " 2"]) -> None:
        """Draw it.

        Args:
            pen: What to draw with.
            centre: The centre of the box.
        """
        from matplotlib.patches import Rectangle

        width, height = self.size
        x, y = centre - np.array([width, height]) / 2
        add = pen.ax.add_patch
        add(rounded(x, y, width, height, facecolor=pen.colour(PAPER), edgecolor="none", zorder=3))
        for row, words in enumerate(self.rows):
            pen.words(centre[0], y + PAD / 2 + (row + 0.5) * ROW, words)
        for row, chances in enumerate(self.chances):
            left, top = x + PAD, y + PAD / 2 + len(self.rows) * ROW + row * _STRIP
            for i, chance in enumerate(chances):
                wide = (width - 2 * PAD) * chance
                fill, line = pen.colour(COLOURS[i % len(COLOURS)]), pen.colour(LINE)
                strip = Rectangle((left, top), wide, _STRIP, facecolor=fill, edgecolor=line, zorder=4)
                strip.set_linewidth(0.4 * pen.scale)
                add(strip)
                left += wide
        if self.share:
            pen.words(centre[0], y + height - (ROW + PAD) / 2, self.share)
        add(rounded(x, y, width, height, facecolor="none", **pen.outline, zorder=5))


def boxes_of(view: SoftView, skeleton: DecisionTree, digits: int, *, downward: bool) -> list[Drawable]:
    """Return the boxes of all nodes, breadth-first.

    Args:
        view: The soft tree.
        skeleton: A hard tree of the same form.
        digits: The number of significant digits.
        downward: Whether the tree grows downward; a leaf's share is then below it, else behind.

    Returns:
        The boxes.
    """
    n_inner = len(view.thresholds)
    terms = [tuple(view.terms(node)) for node in range(n_inner)]
    sums = [f"Σ ≤ {threshold:.{digits}g}" for threshold in view.thresholds]
    named = [f"{shortened(t.name)}   {weight_words(t.weight)}" for row in terms for t in row]
    width = max(map(text_width, [*named, *sums])) + 2 * PAD
    boxes: list[Drawable] = [SumBox(t, s, width) for t, s in zip(terms, sums, strict=True)]
    place = {node: i for i, node in enumerate(in_preorder(n_inner))}
    colours = leaf_colours(skeleton) if isinstance(view.actions, BoxActions) else []
    for leaf in range(n_inner + 1):
        words = leaf_rows(view, leaf, digits)
        share = "" if view.shares is None else percent(float(view.shares[leaf]))
        if share and not downward:
            words, share = (*words[:-1], f"{words[-1]}   Ø {share}"), ""
        if isinstance(view.actions, BoxActions):
            own = colours[place[n_inner + leaf]]
            fill = (*own, own[0] if len(own) == 1 else PAPER)
            rows = (*words, f"Ø {share}") if share else words
            boxes.append(TextBox(rows, fill[: len(rows)]))
        else:
            boxes.append(ChanceBox(words, chances_of(view, leaf), share and f"Ø {share}"))
    return boxes


def leaf_rows(view: SoftView, leaf: int, digits: int) -> tuple[str, ...]:
    """Return the likeliest option of each component with its probability, or each component's mean.

    Args:
        view: The soft tree.
        leaf: The number of the leaf.
        digits: The number of significant digits.

    Returns:
        A row for each component.
    """
    values, actions = view.leaf_values[leaf : leaf + 1], view.actions
    words = actions.words(actions.decide(values)[0], digits)
    if isinstance(actions, BoxActions):
        return tuple(map(shortened, words))
    likeliest = [percent(max(chances)) for chances in chances_of(view, leaf)]
    return tuple(f"{shortened(word)}  {p}" for word, p in zip(words, likeliest, strict=True))


def chances_of(view: SoftView, leaf: int) -> tuple[tuple[float, ...], ...]:
    """Return the probability of each option of each component.

    Args:
        view: The soft tree.
        leaf: The number of the leaf.

    Returns:
        A tuple for each component.
    """
    values, actions = view.leaf_values[leaf : leaf + 1], view.actions
    found = actions.probabilities(values)
    parts = found if isinstance(found, tuple) else (found,)
    return tuple(tuple(part[0].tolist()) for part in parts)


def weight_words(weight: float) -> str:
    """Format a weight with two digits, which is the precision of a bar.

    Args:
        weight: The weight.

    Returns:
        The text.
    """
    return f"{weight:.2f}" if weight >= 0.005 else "<0.01"
