"""The ways through one tree as many pictures, for films: what they share is drawn once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .base import BaseTree
from .plot import arrange, draw
from .plot_fonts import drawn_in, style_for

if TYPE_CHECKING:
    from jaxtyping import Bool, UInt8
    from matplotlib.backends.backend_agg import FigureCanvasAgg

_LEAST_DPI = 30.0
"""Fonts are not drawn smaller; the picture is made smaller instead."""


class Ways:
    """Pictures of a tree, each with the way to another leaf lit, as `plot` draws with ``highlight``.

    The pale tree is drawn once and a way is drawn over it: that takes as long as the way, not as the tree.
    They are as large as ``dpi`` makes them, or as fits into ``most_pixels``, width and height.
    """

    def __init__(self, tree: BaseTree, *, most_pixels: tuple[int, int], dpi: float) -> None:
        self._tree, self._parents, self._style = tree, _parents(tree), style_for(tree)
        with drawn_in(self._style):
            self._layout, self._boxes = arrange(tree, 4)
            self._scale = min(1.0, *(np.array(most_pixels) / (dpi * self._layout.extent)))
            self._dpi = max(_LEAST_DPI, dpi * self._scale)
            self._canvas = self._blank()
            draw(tree, self._layout, self._boxes, self._canvas.figure.axes[0], np.zeros(tree.n_nodes, bool))
            self._canvas.draw()
        self._pale = self._canvas.copy_from_bbox(self._canvas.figure.bbox)
        width, height = self._canvas.get_width_height()
        if self._dpi > dpi * self._scale:
            width, height = (max(1, round(length)) for length in dpi * self._scale * self._layout.extent)
        self.size = width, height
        """Width and height."""

    def whole(self) -> UInt8[np.ndarray, "height width 3"]:
        """Draw the tree, nothing lit."""
        with drawn_in(self._style):
            canvas = self._blank()
            draw(self._tree, self._layout, self._boxes, canvas.figure.axes[0])
            canvas.draw()
        return self._pixels(canvas)

    def way(self, leaf: int) -> UInt8[np.ndarray, "height width 3"]:
        """Draw the tree with the way to a leaf lit."""
        lit: Bool[np.ndarray, " nodes"] = np.zeros(self._tree.n_nodes, bool)
        node = leaf
        while node >= 0:
            lit[node] = True
            node = int(self._parents[node])
        canvas, ax = self._canvas, self._canvas.figure.axes[0]
        with drawn_in(self._style):
            ax.clear()
            draw(self._tree, self._layout, self._boxes, ax, lit, only_lit=True)
            canvas.restore_region(self._pale)
            for artist in sorted((*ax.patches, *ax.texts), key=lambda artist: artist.get_zorder()):
                ax.draw_artist(artist)
        return self._pixels(canvas)

    def _blank(self) -> FigureCanvasAgg:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure(figsize=tuple(self._layout.extent), dpi=self._dpi)
        figure.add_axes((0, 0, 1, 1))
        return FigureCanvasAgg(figure)

    def _pixels(self, canvas: FigureCanvasAgg) -> UInt8[np.ndarray, "height width 3"]:
        from PIL import Image

        picture = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())
        if picture.size != self.size:
            picture = picture.resize(self.size, Image.Resampling.HAMMING)
        return np.asarray(picture)


def _parents(tree: BaseTree) -> np.ndarray:
    """Return each node's parent, -1 for the root."""
    parents = np.full(tree.n_nodes, -1)
    for node in np.flatnonzero(~tree.is_leaf):
        parents[[tree.children_left[node], tree.children_right[node]]] = node
    return parents
