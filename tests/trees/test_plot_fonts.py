"""Names in scripts that the pictures' own font lacks: another font's, or a warning that there is none."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from sympol.trees import DecisionTree, DiscreteActions, Group
from sympol.trees.plot import PathPictures
from sympol.trees.plot_style import style_for

CHINESE, LETTER = "水位", "\N{MATHEMATICAL SANS-SERIF SMALL G}"


def named(feature: str, action: str = "go", category: str = "c") -> DecisionTree:
    return DecisionTree.from_complete(
        np.array([0]),
        np.array([0.0]),
        np.eye(2),
        actions=DiscreteActions(2, (action, "stay")),
        feature_names=[feature, "g"],
        groups=[Group("", (1,), (category,))],
    )


@pytest.mark.parametrize("suffix", ["svg", "pdf", "png"])
def test_boxes_are_announced_once(tmp_path, suffix):
    for tree in (named(CHINESE), named("x", CHINESE), named("x", "go", CHINESE)):
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            tree.plot(tmp_path / f"tree.{suffix}")
        (warning,) = said
        assert str(warning.message) == (
            "no font on this machine has these characters of the tree's names, so they become boxes in the picture: "
            "位 ('\\u4f4d'), 水 ('\\u6c34'); install one that has them, such as Noto"
        )


def test_films_announce_them_once():
    with pytest.warns(UserWarning, match="no font on this machine") as said:
        pictures = PathPictures(named(CHINESE), most_pixels=(400, 400), dpi=50)
    assert len(said) == 1
    pictures.whole()  # without another one
    pictures.path_to(1)


def test_nothing_is_said_of_what_the_font_has(tmp_path):
    named("cos θ (°/s²) é ≤ ∞", "Größe", "Ж").plot(tmp_path / "tree.png")


def test_another_font_that_has_it_is_used(tmp_path: Path):
    """STIX, which is a part of Matplotlib, has the letters of mathematics that DejaVu Sans lacks."""
    from matplotlib import font_manager

    own = font_manager.get_font(font_manager.findfont("DejaVu Sans")).get_charmap()
    lacking = next(chr(c) for c in range(0x2900, 0x2AFF) if c not in own) if ord(LETTER) in own else LETTER
    families = style_for(named(f"speed {lacking}"))["font.family"]
    assert families[0] == "DejaVu Sans"
    assert len(families) == 2
    named(f"speed {lacking}").plot(tmp_path / "tree.png")  # without a warning
    assert style_for(named("speed"))["font.family"] == ["DejaVu Sans"]
